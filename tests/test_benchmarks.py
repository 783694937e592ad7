"""The programs in benchmarks/ run: what they measure is their own business."""

import importlib
from pathlib import Path

import every_core
import pytest
import reading

from graspforce import _engine

PROGRAMS = sorted(Path(every_core.__file__).parent.glob("*.py"))


@pytest.mark.parametrize("name", [program.stem for program in PROGRAMS])
def test_every_program_can_be_imported(name):
    importlib.import_module(name)


def test_every_core_decides_planted_grasps():
    table = every_core.hard_ends(seed=1, count=20)
    solved, undecided, wrong = (list(table.columns[i].cells) for i in (1, 2, 3))
    assert solved == ["20"] * len(_engine.modules)
    assert undecided == wrong == ["0"] * len(_engine.modules)


def test_reading_times_each_call():
    pytest.importorskip("mujoco")
    for tip in reading.TIPS.values():
        assert all(len(times) == 2 for times in reading.times(tip, rounds=2).values())
