"""GRASPFORCE_CORE, the environment variable that chooses among the compiled cores."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from graspforce import _core, _engine

PRINT = """
from graspforce._engine import dispatch, module
print(module.__name__, dispatch.NativeServo.__module__)
"""


def run(core):
    environment = {k: v for k, v in os.environ.items() if k != "GRASPFORCE_CORE"}
    if core is not None:
        environment["GRASPFORCE_CORE"] = core
    return subprocess.run(
        [sys.executable, "-c", PRINT], env=environment, capture_output=True, encoding="utf-8"
    )


@pytest.mark.parametrize("module", _engine.modules)
def test_every_core_can_be_forced(module):
    name = module.removeprefix("graspforce._core").removeprefix("_") or "baseline"
    assert run(name).stdout.split() == [module, module]


@pytest.mark.parametrize("nothing", [None, ""])
def test_without_it_the_best_core_serves(nothing):
    assert run(nothing).stdout.split() == [_engine.modules[-1]] * 2


def test_an_unknown_core_is_refused_with_the_names_of_those_that_are_there():
    answer = run("sse9")
    assert answer.returncode != 0
    last = answer.stderr.strip().splitlines()[-1]
    assert "InvalidInputError: GRASPFORCE_CORE" in last
    assert "got 'sse9'" in last
    assert "baseline" in last


def test_the_cores_are_those_whose_instructions_linux_says_the_processor_has():
    cpuinfo = Path("/proc/cpuinfo")
    if platform.machine() != "x86_64" or not cpuinfo.exists():
        pytest.skip("reads what Linux says of an x86-64 processor")
    flags = set(cpuinfo.read_text(encoding="utf-8").partition("\nflags")[2].split("\n")[0].split())
    needed = {"avx2": {"avx2", "fma"}, "avx512": {"avx512f", "avx512vl", "avx512dq"}}
    assert _core.instruction_sets() == [name for name, own in needed.items() if own <= flags]
