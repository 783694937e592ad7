"""A misspelt keyword is an error in an editor, and the types cannot drift from the signatures."""

import importlib.util
import inspect
import json
import subprocess
import sys
from pathlib import Path
from typing import Unpack, get_type_hints

import pytest

import graspforce as gf
from graspforce import scenarios
from graspforce.problem import ProblemArguments, ProblemOptions
from graspforce.scenarios.paper import RegraspOptions, ScenarioOptions

CALLS = Path(__file__).with_name("typed_calls.py")


def arguments(function):
    """The arguments' names and types."""
    hints = get_type_hints(function)
    names = inspect.signature(function).parameters
    return {name: hints[name] for name in names if name != "self"}


@pytest.mark.parametrize(
    ("keywords", "function"),
    [
        (ProblemArguments, gf.ForceProblem.__init__),
        (ScenarioOptions, scenarios.static),
        (ScenarioOptions, scenarios.dynamic),
        (RegraspOptions, scenarios.regrasp),
    ],
    ids=lambda each: each.__name__,
)
def test_typed_keywords_are_the_arguments(keywords, function):
    assert get_type_hints(keywords) == arguments(function)
    assert not keywords.__required_keys__


def test_the_options_of_a_grasps_problem_are_what_the_grasp_does_not_know():
    everything = get_type_hints(ProblemArguments)
    assert get_type_hints(ProblemOptions) == {
        name: kind for name, kind in everything.items() if name not in ("W", "f", "models")
    }
    assert set(gf.Grasp([gf.Contact((0, 0, 0), (0, 0, 1), gf.FPC())]).problem(
        [0] * 6, c_max=1).arguments()) == set(everything)  # fmt: skip


def test_a_tick_takes_the_arguments_of_a_problem():
    assert get_type_hints(gf.Servo.step)["changes"] == Unpack[ProblemArguments]


def test_every_scenario_has_its_types():
    assert set(scenarios.NAMES) == {"static", "dynamic", "regrasp"}


@pytest.mark.skipif(
    importlib.util.find_spec("basedpyright") is None, reason="basedpyright is not installed"
)
def test_the_type_checker_objects_to_misspelt_keywords_and_to_nothing_else():
    run = subprocess.run(
        [
            sys.executable,
            "-m",
            "basedpyright",
            "--outputjson",
            "--pythonpath",
            sys.executable,
            CALLS,
        ],
        capture_output=True,
        encoding="utf-8",
        cwd=CALLS.parents[1],
        check=False,
    )
    found = json.loads(run.stdout)["generalDiagnostics"]
    red = {
        number
        for number, line in enumerate(CALLS.read_text("utf-8").splitlines())
        if line.endswith("# red")
    }
    assert len(red) == 10
    assert {each["range"]["start"]["line"] for each in found} == red, found
