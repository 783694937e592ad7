"""The one place that imports the compiled core, and the choice between it and the reference."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from graspforce import reference
from graspforce._arrays import Array
from graspforce.outcome import Outcome
from graspforce.problem import ForceProblem
from graspforce.settings import Settings


class ServoBackend(Protocol):
    """What :class:`graspforce.Servo` stands on."""

    def step(self, *fields: object) -> Outcome | None:
        """Take changed fields and solve; None, with nothing changed, when they need checking."""
        ...

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

    def step(self, *fields: object) -> Outcome | None:
        return None

    def step_problem(self, packed: Array) -> Outcome:
        problem = ForceProblem.from_packed(self._problem.layout, self._problem.models, packed)
        self._problem = problem
        start = None
        if len(self._past) == 2:
            start = 2 * self._past[1] - self._past[0]
        elif self._past:
            start = self._past[0]
        outcome = reference.solve(problem, self._settings, start)
        self._past = [*self._past[-1:], outcome.c] if outcome.status == 0 else []
        return outcome

    def reset(self) -> None:
        self._past = []

    @property
    def packed(self) -> Array:
        return np.array(self._problem.packed)


def solve(problem: ForceProblem, settings: Settings, start: Array | None) -> Outcome:
    """Solve from a cold start, or from ``start``, with the backend that the settings name."""
    return reference.solve(problem, settings, start)


def make_servo(problem: ForceProblem, settings: Settings) -> ServoBackend:
    """Return the servo of the backend that the settings name."""
    return ReferenceServo(problem, settings)
