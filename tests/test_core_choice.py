"""GRASPFORCE_CORE, the environment variable that chooses among the compiled cores."""

import os
import subprocess
import sys

import pytest

from graspforce import _engine

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
