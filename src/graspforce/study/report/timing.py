"""The servo's times on this machine, through the Python interface.

Ticks come back to back, so the caches are warm, as they are not in a paced loop; the first, cold
tick of every pass is counted like any other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce._util.clock import Pair, hot, no_op
from graspforce.problem import ForceProblem
from graspforce.regrasp import is_removed
from graspforce.scenarios import Log
from graspforce.solution import Solution
from graspforce.solve import solve
from graspforce.study.bench.own import steps

# How often the ticks of a scenario are timed: enough for a steady 99th percentile.
PASSES = 10


def measure_times(
    dynamic: Log, regrasp: Log, progress: Callable[[str, int, int], None]
) -> dict[str, Any]:
    """Return mean and percentiles of ticks and cold solves of two scenarios [µs].

    Args:
        dynamic: log of the scenario with four fingers throughout.
        regrasp: log of the scenario in which one of them is away for a while.
        progress: called with the stage, how much of it is done and its total.
    """
    problems = list(dynamic.scenario.problems())
    away = is_removed(regrasp.engagement).any(axis=1)
    whole = (regrasp.engagement == 1).all(axis=1)
    ticks = _tick_times(problems, "timing four fingers", progress)
    changing = _tick_times(list(regrasp.scenario.problems()), "timing the regrasp", progress)
    solves: list[Pair] = [(no_op, _reading(partial(solve, problem))) for problem in problems]
    cold = hot(solves, rounds=1, warm_up=False)
    return {
        "passes": PASSES,
        "dynamic, every tick [us]": _percentiles(ticks),
        "regrasp, ticks with four fingers [us]": _percentiles(changing[:, whole]),
        "regrasp, ticks with three fingers [us]": _percentiles(changing[:, away]),
        "cold solve [us]": _percentiles(cold),
    }


def _tick_times(
    problems: list[ForceProblem], stage: str, progress: Callable[[str, int, int], None]
) -> Array:
    """Return the time of every tick, ``servo.step`` and the reading of c; (passes, T) [µs]."""
    times = np.empty((PASSES, len(problems)))
    for index in range(PASSES):
        ticks = [(before, _reading(step)) for before, step in steps(problems)]  # of a new Servo
        times[index] = hot(ticks, rounds=1, warm_up=False)
        progress(stage, index + 1, PASSES)
    return times


def _reading(solve: Callable[[], Solution]) -> Callable[[], Array]:
    """Return a function that solves and reads the forces."""
    return lambda: solve().c


def _percentiles(times: Array) -> dict[str, float]:
    p50, p99 = np.percentile(times, (50, 99))
    return {"mean": float(times.mean()), "p50": float(p50), "p99": float(p99)}


def time_claims(times: dict[str, Any]) -> list[Claim]:
    """Compare what :func:`measure_times` returned with the times that the paper gives."""

    def words(name: str) -> str:
        got = times[name]
        return f"p50 {got['p50']:.1f} µs, p99 {got['p99']:.1f} µs, mean {got['mean']:.1f} µs"

    return [
        Claim(
            paper=(
                "Four fingers: roughly 700 µs in the mean, in an interpreted language on a "
                "Pentium M at 1.5 GHz; far less is expected from compiled code."
            ),
            measured=f"Dynamic task, every tick: {words('dynamic, every tick [us]')}.",
            numbers={},
            holds=None,
        ),
        Claim(
            paper="Three fingers, during the regrasp: roughly 600 µs; with four again 700 µs.",
            measured=(
                f"Three fingers: {words('regrasp, ticks with three fingers [us]')}. "
                f"Four: {words('regrasp, ticks with four fingers [us]')}."
            ),
            numbers={},
            holds=None,
        ),
        Claim(
            paper="(Gives no time for a start from scratch.)",
            measured=f"Cold solve of the same ticks: {words('cold solve [us]')}.",
            numbers={},
            holds=None,
        ),
    ]
