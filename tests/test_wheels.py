"""What `make wheels` asks of a wheel."""

import re
import tomllib
import zipfile

import pytest
import wheels
from pages import ROOT

ALL = [f"graspforce/{core}.cpython-311-x86_64-linux-gnu.so" for core in wheels.CORES["x86_64"]]


def wheel(folder, names, content=b"\0memcpy\0"):
    path = folder / "graspforce-0.1.0-cp311-cp311-manylinux2014_x86_64.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, content)
    return path


def test_a_wheel_with_all_cores_has_no_flaw(tmp_path):
    assert wheels.find_flaw(wheel(tmp_path, ["graspforce/__init__.py", *ALL]), "x86_64") is None


@pytest.mark.parametrize("names", [ALL[:2], [*ALL, "graspforce.libs/libstdc++.so"]])
def test_a_core_that_is_missing_and_a_library_that_came_along_are_flaws(tmp_path, names):
    flaw = wheels.find_flaw(wheel(tmp_path, names), "x86_64")
    assert flaw is not None
    assert "_core_avx512" in flaw


def test_a_core_with_a_c_library_of_its_own_is_a_flaw(tmp_path):
    flaw = wheels.find_flaw(wheel(tmp_path, ALL, b"memcpy of Zig"), "x86_64")
    assert "with a memcpy of its own" in flaw


def test_a_large_wheel_is_a_flaw(tmp_path):
    large = wheel(tmp_path, ALL, b"\0memcpy\0" + bytes(1_000_000))
    expected = f"got {large.stat().st_size} bytes, expected at most 3000000"
    assert wheels.find_flaw(large, "x86_64") == expected


def test_the_hosted_wheels_are_for_every_python_that_the_tests_run_under():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    built = project["tool"]["cibuildwheel"]["build"].split()
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    tested = re.findall(r'"3\.(\d+)"', re.search(r"python: \[(.*)\]", workflow)[1])
    assert built == [f"cp3{minor}-*" for minor in tested]


def test_the_cores_of_a_wheel_are_those_that_are_built():
    cmake = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    assert tuple(re.findall(r"add_core\((_core\w*)", cmake)) == wheels.CORES["x86_64"]
