"""Times of graspforce itself: ticks, cold solves, growth with the contacts, import."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from graspforce import _engine, scenarios
from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array
from graspforce._util.clock import Call, Pair, hot, no_op, paced
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.scenarios import random
from graspforce.servo import Servo
from graspforce.solution import Solution
from graspforce.solve import solve
from graspforce.study.bench.measurement import Measurement

RATE = 1000.0  # 1/s
CONTACTS = (4, 8, 16, 32, 64)


def ticks_and_solves(effort: int) -> Iterator[Measurement]:
    """Time the dynamic task from C++ and from Python, ``effort`` rounds of 500 ticks each."""
    problems = list(scenarios.dynamic().problems())
    task = "tick, the paper's dynamic task"
    cores = {name.rpartition(".")[2]: importlib.import_module(name) for name in _engine.modules}
    for name, module in cores.items():
        yield Measurement(task, f"C++, {name}", _core_times(module, problems, effort))
    bound, whole, passed = bound_ticks(problems), written_ticks(problems), steps(problems)
    yield Measurement(task, "servo.tick(), its arrays written before", hot(bound, effort))
    yield Measurement(task, "the same and writing f, W, J", hot(whole, effort))
    yield Measurement(task, "servo.step(f=, W=, J=)", hot(passed, effort))
    at_rate = f"tick, paced at {RATE:.0f} Hz"
    count = 100 * effort
    yield Measurement(at_rate, "an empty call", paced([(no_op, no_op)], RATE, count))
    yield Measurement(at_rate, "servo.tick(), its arrays written before", paced(bound, RATE, count))
    yield Measurement(at_rate, "servo.step(f=, W=, J=)", paced(passed, RATE, count))
    cold = "cold solve"
    for name, module in cores.items():
        times = _core_times(module, problems, effort, cold=True)
        yield Measurement(cold, f"dynamic task, C++, {name}", times)
    for name, some in (
        ("dynamic task, solve(problem)", problems),
        ("random grasps, solve(problem)", random.grasps(500)),
    ):
        calls: list[Pair] = [(no_op, partial(solve, problem)) for problem in some]
        yield Measurement(cold, name, hot(calls, effort))


def growth(effort: int) -> Iterator[Measurement]:
    """Time grasps of more and more contacts in C++: a tick, and one Newton step."""
    module = _engine.module
    for contacts in CONTACTS:
        problems = random.stream(contacts)
        times = _core_times(module, problems, effort)
        yield Measurement("tick by number of contacts, C++", f"{contacts} contacts", times)
    for contacts in CONTACTS:
        times = _newton_step(random.stream(contacts, 1)[0], effort)
        yield Measurement("one Newton step of a cold solve", f"{contacts} contacts", times)


def import_time(effort: int) -> Iterator[Measurement]:
    """Time the import of graspforce beyond NumPy's, in fresh interpreters with cached bytecode."""
    code = (
        "import time, numpy; t = time.perf_counter(); import graspforce; "
        "print(1e6 * (time.perf_counter() - t))"
    )
    with tempfile.TemporaryDirectory() as cache:
        # The cache is a folder of our own: a setting against writing bytecode does not count.
        settings = {key: v for key, v in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        settings["PYTHONPYCACHEPREFIX"] = cache
        run = partial(subprocess.run, [sys.executable, "-c", code], check=True, env=settings)
        runs = [float(run(stdout=subprocess.PIPE).stdout) for _ in range(1 + min(effort, 10))]
    yield Measurement("import", "import graspforce, beyond NumPy's", np.array(runs[1:]))


def steps(problems: list[ForceProblem]) -> list[tuple[Call, Callable[[], Solution]]]:
    """Return ticks that pass f, W, J and what else changes to ``servo.step``, as their own arrays.

    ``servo.step_to(problem)`` would be shorter, but a controller has arrays and no ForceProblem:
    this is the call that it makes.
    """
    servo = Servo(problems[0])
    others = [name for name in changing_fields(problems) if name not in {"f", "W", "J"}]

    def step(problem: ForceProblem) -> Callable[[], Solution]:
        f, W, J = (np.array(values) for values in (problem.f, problem.W, problem.J))
        if not others:  # a call without **, as a controller writes it, is 0.2 µs shorter
            return lambda: servo.step(f=f, W=W, J=J)
        changes: dict[str, Any] = {name: np.array(getattr(problem, name)) for name in others}
        return lambda: servo.step(f=f, W=W, J=J, **changes)

    return [(no_op, step(problem)) for problem in problems]


def changing_fields(problems: list[ForceProblem]) -> list[str]:
    """Return the names of the fields that change in a stream of problems of one layout."""
    stack = problems[0].layout.views(np.array([problem.packed for problem in problems]))
    return [name for name, values in stack.items() if (values != values[0]).any()]


def bound_ticks(problems: list[ForceProblem]) -> list[Pair]:
    """Return ticks from arrays that were written before the clock starts."""
    servo = Servo(problems[0])
    write = _writer(servo, problems)
    return [(partial(write, p.f, p.W, p.J), servo.tick) for p in problems]


def written_ticks(problems: list[ForceProblem]) -> list[Pair]:
    """Return ticks with the writing of the arrays."""
    servo = Servo(problems[0])
    write = _writer(servo, problems)

    def tick(new_f: Array, new_W: Array, new_J: Array) -> None:
        write(new_f, new_W, new_J)
        servo.tick()

    return [(no_op, partial(tick, p.f, p.W, p.J)) for p in problems]


def _writer(servo: Servo, problems: list[ForceProblem]) -> Callable[[Array, Array, Array], None]:
    """Return a function that writes f, W and J, all that may change in these problems."""
    others = set(changing_fields(problems)) - {"f", "W", "J"}
    if others:
        raise InvalidInputError(
            f"problems: {', '.join(sorted(others))} changed, expected only f, W and J to change"
        )
    f, W, J = servo.f, servo.W, servo.J

    def write(new_f: Array, new_W: Array, new_J: Array) -> None:
        f[:] = new_f
        W[:] = new_W
        J[:] = new_J

    return write


def _core_times(
    module: Any, problems: list[ForceProblem], rounds: int, cold: bool = False
) -> Array:
    defaults, stream = Settings(), np.stack([problem.packed for problem in problems])
    layout = problems[0].layout
    return 1e-3 * module.time_ticks(layout, stream, rounds, defaults.tol, defaults.max_steps, cold)


def _newton_step(problem: ForceProblem, rounds: int) -> Array:
    """Time a step: the difference of cold solves under two step limits, by the steps between."""
    far = problem.replace(alpha=1000.0)
    most = solve(far).newton_steps - 1
    stream = np.stack([far.packed] * 20)
    ends = [
        _engine.module.time_ticks(far.layout, stream, 5 * rounds, 1e-9, budget, True)
        for budget in (1, most)
    ]
    return 1e-3 * (ends[1] - np.median(ends[0])) / (most - 1)
