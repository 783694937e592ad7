"""The choice between the compiled core and the NumPy reference, behind one interface."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from graspforce import reference
from graspforce._engine import native
from graspforce._engine.outcome import Outcome, Start, Status
from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array, as_array
from graspforce.problem import ForceProblem

NativeServo: Any = native.module.Servo
_solve: Callable[..., Any] = native.module.solve

_T = TypeVar("_T")


class ServoBackend(Protocol):
    """What :class:`graspforce.Servo` stands on."""

    def tick(self) -> Status:
        """Solve from ``numbers`` as they stand."""
        ...

    def step(self, changes: Mapping[str, Any]) -> Any:
        """Solve with changed fields.

        Returns:
            A Solution; None, and nothing changed, where the arrays need a closer look.
        """
        ...

    def step_problem(self, packed: Array, problem: ForceProblem) -> Any:
        """Solve a validated problem, given with its buffer, which becomes ``numbers``.

        Returns:
            A Solution.
        """
        ...

    def last(self) -> Outcome | None:
        """Return what the last tick found, None before the first."""
        ...

    def reset(self) -> None:
        """Forget the past optima."""
        ...

    @property
    def numbers(self) -> Array:
        """The flat buffer that the next tick is made from; write to it."""
        ...

    @property
    def packed(self) -> Array:
        """A copy of the last tick's flat buffer."""
        ...

    @property
    def c(self) -> Array:
        """The forces that the last tick found, overwritten by the next."""
        ...

    @property
    def internal_forces(self) -> Array:
        """The internal forces that the last tick found, overwritten by the next."""
        ...

    @property
    def nu(self) -> Array:
        """The multipliers that the last tick found, overwritten by the next."""
        ...


class ReferenceServo:
    """The paper's servo loop on the NumPy reference."""

    def __init__(self, problem: ForceProblem, settings: Settings, solution: type) -> None:
        self._settings, self._solution = settings, solution
        self._layout = problem.layout
        self._past: list[Array] = []
        self.numbers = np.array(problem.packed)
        self.packed = np.array(problem.packed)
        self.c = np.zeros(problem.m)
        self.internal_forces = np.zeros(problem.layout.internals)
        self.nu = np.zeros(len(problem.f))
        self._last: Outcome | None = None

    def tick(self) -> Status:
        flaw = native.module.find_flaw(self._layout, self.numbers)
        if flaw is not None:
            native.refuse(flaw)
        return Status(self._solve(self.numbers).status)

    def step(self, changes: Mapping[str, Any]) -> None:
        return None

    def step_problem(self, packed: Array, problem: ForceProblem) -> Any:
        return self._solution(self._solve(packed), problem)

    def _solve(self, packed: Array) -> Outcome:
        self.numbers[:] = packed
        self.packed = np.array(packed)
        problem = ForceProblem.from_packed(self._layout, np.array(packed))
        start = None
        if len(self._past) == 2:
            start = 2 * self._past[1] - self._past[0]
        elif self._past:
            start = self._past[0]
        outcome = reference.solve(problem, self._settings, start)
        if outcome.start == Start.GIVEN:
            kind = Start.EXTRAPOLATED if len(self._past) == 2 else Start.HELD
            outcome = replace(outcome, start=kind)
        self._last = outcome
        self._past = [*self._past[-1:], np.array(outcome.c)] if outcome.status == 0 else []
        self.c[:], self.nu[:] = outcome.c, outcome.nu
        self.internal_forces[:] = outcome.internal_forces
        if (outcome.status == Status.SOLVED or outcome.nearest) and self._layout.rate_limits:
            self._layout.views(self.numbers)["c_last"][:] = outcome.c
        return outcome

    def last(self) -> Outcome | None:
        return self._last

    def reset(self) -> None:
        self._past = []


def solve(
    problem: ForceProblem,
    settings: Settings,
    start: ArrayLike | None,
    solution: Callable[[Outcome, ForceProblem], _T],
) -> _T:
    """Solve from a cold start, or from ``start``; ``solution`` is the class of what comes back.

    Raises:
        InvalidInputError: a start of the wrong shape, or one with other than finite numbers.
    """
    if settings.backend == "reference":
        guess = None if start is None else as_array(start, "start", (problem.m,))
        return solution(reference.solve(problem, settings, guess), problem)
    budget_us = math.inf if settings.budget_us is None else settings.budget_us
    found = _solve(
        solution, problem, problem.layout, problem.packed, start, settings.tol, settings.max_steps,
        budget_us,
    )  # fmt: skip
    if found is None:  # a start that is no plain array
        assert start is not None
        return solve(problem, settings, as_array(start, "start", (problem.m,)), solution)
    return found


def make_servo(problem: ForceProblem, settings: Settings, solution: type) -> ServoBackend:
    """Return the servo of the backend that the settings name; ``solution`` is what steps return."""
    if settings.backend == "reference":
        return ReferenceServo(problem, settings, solution)
    return NativeServo(
        problem.layout, problem.packed, *_limits(settings), list(Status), native.refuse, solution
    )


def _limits(settings: Settings) -> tuple[float, int, float]:
    budget_us = math.inf if settings.budget_us is None else settings.budget_us
    return settings.tol, settings.max_steps, budget_us
