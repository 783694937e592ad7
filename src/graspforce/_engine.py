"""The one place that imports the compiled core, and the choice between it and the reference."""

from __future__ import annotations

import functools
import importlib
import math
import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol, TypeVar, cast

import numpy as np

from graspforce import _core, reference
from graspforce._arrays import Array
from graspforce.errors import InvalidInputError
from graspforce.outcome import Outcome, Start, Status
from graspforce.problem import ForceProblem, Layout
from graspforce.settings import Settings

# The same core stands in further modules, built for wider and for more registers.
_sets = ("baseline", *_core.instruction_sets())
modules: tuple[str, ...] = (
    "graspforce._core",
    *(f"graspforce._core_{name}" for name in _sets[1:]),
)
"""Every compiled core that this processor runs, the best last."""


def _choose_core() -> str:
    """Return the module of the best core, or of the one that GRASPFORCE_CORE names.

    Raises:
        InvalidInputError: GRASPFORCE_CORE names no core, or one that this processor cannot run.
    """
    wanted = os.environ.get("GRASPFORCE_CORE") or _sets[-1]
    if wanted not in _sets:
        raise InvalidInputError(
            f"GRASPFORCE_CORE (environment variable): got {wanted!r}, expected one of the cores "
            f"that this processor runs: {', '.join(_sets)}"
        )
    return modules[_sets.index(wanted)]


module: Any = importlib.import_module(_choose_core())
NativeServo: type[_core.Servo] = module.Servo
_native_solve: Callable[..., Any] = module.solve

_T = TypeVar("_T")


class ServoBackend(Protocol):
    """What :class:`graspforce.Servo` stands on."""

    def tick(self) -> Status:
        """Solve from ``numbers`` as they stand."""
        ...

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
    ) -> Any:
        """Solve with changed fields, for a Solution; None, and nothing changed, to check them."""
        ...  # fmt: skip

    def step_problem(self, packed: Array) -> Outcome:
        """Solve a validated problem, whose numbers become ``numbers``."""
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
    def nu(self) -> Array:
        """The multipliers that the last tick found, overwritten by the next."""
        ...


def refuse(layout: Layout, packed: Array) -> None:
    """Raise the error of the constructor of ForceProblem for numbers that it would refuse.

    Raises:
        InvalidInputError: one of the numbers is not finite or out of its range.
    """
    ForceProblem.from_packed(layout, packed).replace()


class ReferenceServo:
    """The paper's servo loop on the NumPy reference."""

    def __init__(self, problem: ForceProblem, settings: Settings) -> None:
        self._settings = settings
        self._layout = problem.layout
        self._past: list[Array] = []
        self.numbers = np.array(problem.packed)
        self.packed = np.array(problem.packed)
        self.c = np.zeros(problem.m)
        self.nu = np.zeros(len(problem.f))
        self._last: Outcome | None = None

    def tick(self) -> Status:
        refuse(self._layout, np.array(self.numbers))
        return Status(self.step_problem(self.numbers).status)

    def step(self, *_fields: object, **_names: object) -> None:
        return None

    def step_problem(self, packed: Array) -> Outcome:
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
        return outcome

    def last(self) -> Outcome | None:
        return self._last

    def reset(self) -> None:
        self._past = []


def solve(
    problem: ForceProblem,
    settings: Settings,
    start: Array | None,
    solution: Callable[[Outcome, ForceProblem], _T],
) -> _T:
    """Solve from a cold start, or from ``start``; ``solution`` is the class of what comes back."""
    if settings.backend == "reference":
        return solution(reference.solve(problem, settings, start), problem)
    return _native_solve(
        solution, problem, problem.layout, problem.packed, start, *_limits(settings)
    )


def make_servo(problem: ForceProblem, settings: Settings, solution: type) -> ServoBackend:
    """Return the servo of the backend that the settings name; ``solution`` is what steps return."""
    if settings.backend == "reference":
        return ReferenceServo(problem, settings)
    layout = problem.layout
    servo = NativeServo(
        *layout,
        problem.packed,
        *_limits(settings),
        list(Status),
        functools.partial(refuse, layout),
        solution,
        layout,
    )
    return cast(ServoBackend, servo)  # its stub knows neither Status nor step


def _limits(settings: Settings) -> tuple[float, int, float]:
    budget_us = math.inf if settings.budget_us is None else settings.budget_us
    return settings.tol, settings.max_steps, budget_us
