"""One method on one task: times, iterations, margins, jumps, verdicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce._util.clock import hot, no_op
from graspforce.columns import Columns
from graspforce.errors import MissingExtraError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.study.compare import flops
from graspforce.study.compare.methods import Method
from graspforce.study.compare.tasks import Task


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What a method did on a task. Numbers about forces are over the problems it solved.

    Attributes:
        method: its name.
        task: the task's name.
        missing: the pip line where a package is not installed; nothing was run then.
        ran: indices of the task's problems that were run, shape (R,).
        of: how many problems the task has.
        cold_us: time of each solve from scratch, shape (R,) [µs].
        warm_us: time of each solve from the one before, shape (R,) [µs]; None where the method
            or the task has no such thing.
        iterations: of each solve from scratch, shape (R,).
        warm_iterations: of each solve from the one before, or None.
        step_flops: operations of a step by formula, for the first problem; None without one.
        slip_margin: least mu n − ‖tangential force‖ on the true cones [N].
        torque_margin: least distance of a joint torque to its limit [N·m].
        largest_normal: [N].
        largest_jump: largest change of any normal force from a tick to the next [N]; None where
            no two neighbours were solved.
        normal_forces: shape (R, n), NaN where not solved; None where n varies [N].
        statuses: how many problems ended how, by the name of the status. Where a problem ends
            differently warm and from scratch the worse counts: a failure is worse than no
            answer, no answer worse than SOLVED.
    """

    method: str
    task: str
    missing: str | None
    ran: NDArray[np.int64]
    of: int
    cold_us: Array
    warm_us: Array | None
    iterations: NDArray[np.int64]
    warm_iterations: NDArray[np.int64] | None
    step_flops: float | None
    slip_margin: float | None
    torque_margin: float | None
    largest_normal: float | None
    largest_jump: float | None
    normal_forces: Array | None
    statuses: dict[str, int]

    @property
    def solved(self) -> int:
        """How many of the problems were SOLVED."""
        return self.statuses.get(Status.SOLVED.name, 0)

    @property
    def infeasible(self) -> int:
        """How many were proved to have no answer."""
        return sum(self.statuses.get(each.name, 0) for each in _NO_ANSWER)

    @property
    def unbounded(self) -> int:
        """How many have no best answer, because nothing limits the grip."""
        return self.statuses.get(Status.UNBOUNDED.name, 0)

    @property
    def failures(self) -> int:
        """How many ended without a verdict."""
        return len(self.ran) - self.solved - self.infeasible - self.unbounded

    @property
    def solve_flops(self) -> float | None:
        """Operations of a mean solve: warm where the method can, else from scratch."""
        counts = self.iterations if self.warm_iterations is None else self.warm_iterations
        if self.step_flops is None or not len(counts):
            return None
        return self.step_flops * float(counts.mean())


_NO_ANSWER = (Status.INFEASIBLE, Status.WRENCH_UNREACHABLE, Status.ON_EDGE)
_VERDICTS = (Status.SOLVED, Status.UNBOUNDED, *_NO_ANSWER)


def measure(method: Method, task: Task, whole: bool) -> Measured:
    """Run a method on a task, after one run of the first problem that does not count.

    A tick of a fast method takes less time than loading its problem from memory, so each pass runs
    twice and the second one counts.

    Args:
        method: what to run.
        task: on what.
        whole: all problems, also with a method for which fewer are enough.
    """
    first = task.problems[0]
    try:
        method.cold(first)
    except MissingExtraError as error:
        return _not_installed(method, task, str(error))
    ran = task.subset(None if whole else method.max_problems)
    problems = [task.problems[int(i)] for i in ran]

    fast = method.max_problems is None
    cold_us, cold = _timed(lambda: method.cold, problems, warm_up=fast)
    warm_us = warm = None
    if method.warm is not None and task.t is not None:
        warm_us, warm = _timed(method.warm, problems, warm_up=fast)
    ends = [Status(each) for each in cold.status]
    if warm is not None:
        ends = [
            max(pair, key=_severity) for pair in zip(ends, map(Status, warm.status), strict=True)
        ]
    columns = cold if warm is None else warm
    solved = columns.solved
    forces = _normal_forces(columns)
    formula = flops.STEP.get(method.name)
    return Measured(
        method=method.name,
        task=task.name,
        missing=None,
        ran=ran,
        of=len(task.problems),
        cold_us=cold_us,
        warm_us=warm_us,
        iterations=cold.newton_steps,
        warm_iterations=None if warm is None else warm.newton_steps,
        step_flops=None if formula is None else formula(first),
        slip_margin=_extreme(np.nanmin, columns.friction_margins[solved]),
        torque_margin=_finite(_extreme(np.nanmin, columns.torque_residual[solved])),
        largest_normal=_extreme(np.nanmax, columns.normal_forces[solved]),
        largest_jump=None if task.t is None or forces is None else _jump(ran, forces),
        normal_forces=forces,
        statuses=dict(Counter(each.name for each in ends)),
    )


def _not_installed(method: Method, task: Task, missing: str) -> Measured:
    none = np.zeros(0, dtype=np.int64)
    return Measured(
        method=method.name,
        task=task.name,
        missing=missing,
        ran=none,
        of=len(task.problems),
        cold_us=np.zeros(0),
        warm_us=None,
        iterations=none,
        warm_iterations=None,
        step_flops=None,
        slip_margin=None,
        torque_margin=None,
        largest_normal=None,
        largest_jump=None,
        normal_forces=None,
        statuses={},
    )


def _timed(
    make: Callable[[], Callable[[ForceProblem], Solution]],
    problems: Sequence[ForceProblem],
    warm_up: bool,
) -> tuple[Array, Columns]:
    """Return each solve's time with reading its forces [µs], and the solutions.

    Args:
        make: called before each pass, for the function that solves.
        problems: one after the other.
        warm_up: whether a first pass does not count.
    """
    solve, found = make(), list[Solution]()

    def begin() -> None:
        nonlocal solve
        solve = make()
        found.clear()

    def run(problem: ForceProblem) -> None:
        solution = solve(problem)
        _ = solution.c
        found.append(solution)

    before = [begin] + [no_op] * (len(problems) - 1)
    calls = [partial(run, problem) for problem in problems]
    times = hot(list(zip(before, calls, strict=True)), rounds=1, warm_up=warm_up)
    return times, Columns(found)


def _severity(status: Status) -> int:
    """Rank a status: SOLVED, no best answer, no answer, no verdict."""
    return _VERDICTS.index(status) if status in _VERDICTS else len(_VERDICTS)


def _extreme(of: Callable[[Array], Any], values: Array) -> float | None:
    return float(of(values)) if values.size else None


def _normal_forces(columns: Columns) -> Array | None:
    if len({each.problem.n for each in columns}) != 1:
        return None
    return np.where(columns.solved[:, None], columns.normal_forces, np.nan)


def _jump(ran: NDArray[np.int64], forces: Array) -> float | None:
    neighbours = np.diff(ran) == 1
    changes = np.abs(np.diff(forces, axis=0))[neighbours]
    changes = changes[np.isfinite(changes).all(axis=1)]
    return float(changes.max()) if len(changes) else None


def _finite(number: float | None) -> float | None:
    return number if number is not None and np.isfinite(number) else None
