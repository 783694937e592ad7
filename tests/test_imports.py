"""What an import of graspforce may and may not bring along."""

import re
import subprocess
import sys
from pathlib import Path

import graspforce

PACKAGE = Path(graspforce.__file__).parent


def test_one_module_imports_the_compiled_core():
    importing = re.compile(r"^\s*(from\s+\S*\s+)?import\s+.*\b_core\b|graspforce\._core", re.M)
    files = {
        file.name
        for file in PACKAGE.rglob("*.py")
        if importing.search(file.read_text(encoding="utf-8"))
    }
    assert files == {"native.py"}


def test_importing_graspforce_imports_numpy_and_nothing_heavy():
    code = "import sys, numpy; before = set(sys.modules); import graspforce; " \
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before}))"  # fmt: skip
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    third_party = set(run.stdout.split()) - set(sys.stdlib_module_names)
    assert third_party <= {"graspforce", "numpy"}


def test_every_public_name_is_there():
    for name in graspforce.__all__:
        assert getattr(graspforce, name) is not None
    assert set(graspforce.__all__) <= set(dir(graspforce))


def test_warp_is_found_at_first_use_and_asks_for_its_extra():
    code = "import sys, graspforce as gf; sys.modules['warp'] = None; gf.warp"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "MissingExtraError: graspforce.warp needs warp-lang" in run.stderr


def test_the_version_is_said_once_and_cited():
    root = Path(__file__).parents[1]
    said = re.search(r"project\(graspforce VERSION (\S+)", (root / "CMakeLists.txt").read_text())
    cited = re.search(r"^version: (\S+)$", (root / "CITATION.cff").read_text(), re.M)
    assert said
    assert cited
    assert graspforce.__version__ == said[1] == cited[1]
