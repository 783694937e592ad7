"""The README's snippets and commands do what it says."""

import re
import shlex
import subprocess
import sys

import pytest
from pages import PAGES, ROOT, blocks, run

README = ROOT / "README.md"
COMMANDS = [line for block in blocks(README, r"\w*") for line in block.splitlines()]


def test_the_python_snippets_run_in_one_session(capsys):
    assert len(blocks(README, "python")) >= 2
    run(README)
    assert capsys.readouterr().out.startswith("SOLVED")


@pytest.mark.parametrize("line", [c for c in COMMANDS if c.startswith("graspforce ")])
def test_the_commands_run(line, tmp_path):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    command = [sys.executable, "-m", *shlex.split(line, comments=True)]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8", check=False)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("line", [c for c in COMMANDS if c.startswith("make ")])
def test_the_make_targets_exist(line):
    target = shlex.split(line, comments=True)[1]
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)


def test_every_file_that_the_docs_link_to_exists():
    for page in PAGES:
        for link in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if not link.startswith("http"):
                assert (page.parent / link).exists(), f"{page.name}: {link}"


def test_every_source_file_that_the_docs_name_exists():
    folders = ("src", "cpp", "tests", "benchmarks", "examples")
    files = [f"/{file}" for folder in folders for file in (ROOT / folder).rglob("*.?pp")]
    files += [f"/{file}" for folder in folders for file in (ROOT / folder).rglob("*.py")]
    names = re.compile(r"`([\w/]+\.(?:py|hpp|cpp))`")
    named = [(page, name) for page in PAGES for name in names.findall(page.read_text("utf-8"))]
    assert len(named) > 60
    for page, name in named:
        assert any(file.endswith(f"/{name}") for file in files), f"{page.name}: {name}"


def test_the_snippets_about_batches_run_in_one_session():
    page = ROOT / "docs" / "batch.md"
    session: dict[str, object] = {}
    snippets = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)
    assert len(snippets) == 2
    for code in snippets:
        exec(compile(code, str(page), "exec"), session)
