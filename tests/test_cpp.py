"""The core as a C++ library: installed, found, built against, and the same forces as Python's.

On baseline x86-64 they are the same to the last digit by the rules of the language, whatever the
compiler and its optimisation: no operation is fused or reordered. Elsewhere compilers choose which
products to fuse, and forces agree to rounding.
"""

import importlib
import importlib.util
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import graspforce as gf
from graspforce import _engine
from graspforce._engine import dispatch

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "cpp"
CMAKE = shutil.which("cmake")
pytestmark = pytest.mark.skipif(CMAKE is None, reason="needs cmake and a C++ compiler")

spec = importlib.util.spec_from_file_location("write_task", EXAMPLE / "write_task.py")
write_task = importlib.util.module_from_spec(spec)
spec.loader.exec_module(write_task)


def run(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    """Where the package is installed."""
    folder = tmp_path_factory.mktemp("package")
    run(CMAKE, "-S", ROOT, "-B", folder / "build", f"-DCMAKE_INSTALL_PREFIX={folder / 'prefix'}")
    run(CMAKE, "--install", folder / "build")
    return folder / "prefix"


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    path = tmp_path_factory.mktemp("task") / "task.txt"
    path.write_text("".join(line + "\n" for line in write_task.lines()))
    return path


@pytest.fixture(scope="module")
def debug(prefix, tmp_path_factory):
    """The examples, for the baseline and without optimisation."""
    folder = tmp_path_factory.mktemp("debug")
    build(prefix, folder, "all", "-DCMAKE_BUILD_TYPE=Debug")
    return folder


@pytest.fixture(scope="module")
def release(prefix, tmp_path_factory):
    """The controller for the best instructions that this processor has, optimised."""
    folder = tmp_path_factory.mktemp("release")
    instructions = instructions_of(_engine.modules[-1])
    build(prefix, folder, "controller", f"-DCMAKE_CXX_FLAGS={instructions}")
    return folder


def build(prefix, folder, target, *options):
    run(CMAKE, "-S", EXAMPLE, "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}", *options)
    run(CMAKE, "--build", folder, "--target", target)


def instructions_of(module):
    """The compiler's options with which the top CMakeLists.txt builds a module."""
    text = (ROOT / "CMakeLists.txt").read_text()
    return re.search(rf"add_core\({module.rpartition('.')[2]} ?(.*)\)", text)[1]


def forces_of_python(module, monkeypatch):
    """What a compiled core answers to the task, tick by tick."""
    monkeypatch.setattr(dispatch, "NativeServo", importlib.import_module(module).Servo)
    servo = None
    for problem in write_task.problems():
        servo = servo or gf.Servo(problem)
        for name in ("W", "f", "J", "engagement"):
            getattr(servo, name)[...] = getattr(problem, name)
        assert servo.tick() is gf.Status.SOLVED
        yield servo.c.copy()


@pytest.mark.parametrize("module", _engine.modules)
def test_the_controller_prints_the_forces_of_python(module, debug, release, task, monkeypatch):
    forces = np.array(list(forces_of_python(module, monkeypatch)))
    assert len(forces) == write_task.TICKS
    for folder in (debug, release):
        printed = np.loadtxt(run(folder / "controller", task).splitlines())
        np.testing.assert_allclose(printed, forces, rtol=0, atol=1e-12)
        baseline = platform.machine() in ("x86_64", "AMD64") and module == _engine.modules[0]
        if folder is debug and baseline:
            np.testing.assert_array_equal(printed, forces)


def test_the_cube_is_held(debug):
    held = run(debug / "hold_cube").splitlines()
    assert len(held) == 6
    assert all(line.startswith("SOLVED") for line in held)
    assert " 0.000 N" in held[3]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no layout"),
        ("{}friction 1\ntick\n", "no field friction"),
        ("{}f 1 2 nan\n", "numbers"),
    ],
)
def test_a_task_that_cannot_be_read_says_why(text, words, debug, task, tmp_path):
    layout = task.read_text().splitlines()[0] + "\n"
    (tmp_path / "bad.txt").write_text(text.format(layout))
    command = [str(debug / "controller"), str(tmp_path / "bad.txt")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode != 0
    assert words in done.stderr


def test_a_task_is_written_by_the_script(task):
    assert run(sys.executable, EXAMPLE / "write_task.py") == task.read_text()


def test_another_version_is_not_found(prefix, tmp_path):
    asking = (EXAMPLE / "CMakeLists.txt").read_text().replace("graspforce 0.1", "graspforce 0.2")
    assert "graspforce 0.2" in asking
    (tmp_path / "CMakeLists.txt").write_text(asking)
    command = [CMAKE, "-S", tmp_path, "-B", tmp_path / "b", f"-DCMAKE_PREFIX_PATH={prefix}"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode != 0
    assert re.search(r'compatible with\s+requested version "0.2"', done.stderr)


def test_the_page_shows_the_files_that_run():
    page = (ROOT / "docs" / "cpp.md").read_text(encoding="utf-8")
    sources = [
        path.read_text(encoding="utf-8")
        for path in EXAMPLE.iterdir()
        if path.suffix in (".cpp", ".txt")
    ]
    snippets = re.findall(r"^```(?:cpp|cmake)\n(.*?)^```", page, re.S | re.M)
    assert len(snippets) >= 3
    for snippet in snippets:
        assert any(snippet in source for source in sources), snippet
