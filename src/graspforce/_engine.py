"""The one place that imports the compiled core, and the choice between it and the reference."""

from __future__ import annotations

import importlib
import threading
from typing import Protocol

import numpy as np

from graspforce import _core, reference
from graspforce._arrays import Array
from graspforce.outcome import Outcome, TickOutcome
from graspforce.problem import ForceProblem, Layout
from graspforce.settings import Settings

# The same core stands in a second module, built for wider registers, where there are such.
_module = importlib.import_module("graspforce._core_avx2") if _core.has_avx2() else _core
Solver: type[_core.Solver] = _module.Solver
NativeServo: type[_core.Servo] = _module.Servo

# Layouts for which a thread keeps its solver.
SOLVERS_KEPT = 16


class ServoBackend(Protocol):
    """What :class:`graspforce.Servo` stands on."""

    def step(
        self,
        f: object,
        W: object,
        J: object,
        tau_lo: object,
        tau_hi: object,
        tau_bias: object,
        c_max: object,
        c_min: object,
        engagement: object,
        A: object,
        b: object,
        alpha: object,
    ) -> TickOutcome | None:
        """Take changed fields and solve; None, with nothing changed, when they need checking."""
        ...  # fmt: skip

    def step_problem(self, packed: Array) -> Outcome:
        """Solve a validated problem."""
        ...

    def reset(self) -> None:
        """Forget the past optima."""
        ...

    @property
    def packed(self) -> Array:
        """A copy of the current problem's flat buffer."""
        ...


class ReferenceServo:
    """The paper's servo loop on the NumPy reference."""

    def __init__(self, problem: ForceProblem, settings: Settings) -> None:
        self._problem = problem
        self._settings = settings
        self._past: list[Array] = []

    def step(self, *_fields: object, **_names: object) -> TickOutcome | None:
        return None

    def step_problem(self, packed: Array) -> Outcome:
        problem = ForceProblem.from_packed(self._problem.layout, packed)
        self._problem = problem
        start = None
        if len(self._past) == 2:
            start = 2 * self._past[1] - self._past[0]
        elif self._past:
            start = self._past[0]
        outcome = reference.solve(problem, self._settings, start)
        self._past = [*self._past[-1:], np.array(outcome.c)] if outcome.status == 0 else []
        return outcome

    def reset(self) -> None:
        self._past = []

    @property
    def packed(self) -> Array:
        return np.array(self._problem.packed)


_cache = threading.local()


def _native_solver(layout: Layout) -> _core.Solver:
    """Return this thread's solver for a layout; set-up allocates, so the last ones are kept."""
    solvers: dict[Layout, _core.Solver] = _cache.__dict__.setdefault("solvers", {})
    solver = solvers.get(layout)
    if solver is None:
        if len(solvers) >= SOLVERS_KEPT:
            solvers.pop(next(iter(solvers)))
        solver = solvers[layout] = Solver(*layout)
    return solver


def solve(problem: ForceProblem, settings: Settings, start: Array | None) -> Outcome:
    """Solve from a cold start, or from ``start``, with the backend that the settings name."""
    if settings.backend == "reference":
        return reference.solve(problem, settings, start)
    solver = _native_solver(problem.layout)
    return solver.solve(problem.packed, settings.tol, settings.max_steps, start)


def make_servo(problem: ForceProblem, settings: Settings) -> ServoBackend:
    """Return the servo of the backend that the settings name."""
    if settings.backend == "reference":
        return ReferenceServo(problem, settings)
    return NativeServo(*problem.layout, problem.packed, settings.tol, settings.max_steps)
