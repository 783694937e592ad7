"""All methods under one roof: the WBF of this package and every baseline."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from graspforce.baselines import METHODS
from graspforce.baselines._conic import SOLVERS
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.servo import Servo
from graspforce.solution import Solution
from graspforce.solve import solve

WBF = "wbf"
# A baseline with other options than its defaults, as a method of its own.
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "socp_norm": ("socp", {"objective": "norm"}),
    **{
        f"socp_norm_{solver}": ("socp", {"objective": "norm", "solver": solver})
        for solver in SOLVERS
        if solver != "clarabel"
    },
}
NAMES: tuple[str, ...] = (WBF, *sorted((*METHODS, *VARIANTS)))
"""Every method that there is, installed or not."""


# How many of a task's problems the slow methods solve, which bounds their time to a few seconds;
# the others solve all of them.
SLOW: dict[str, int] = {"dikin": 100, "sdp": 100, "neural_network": 10, "gradient_flow": 2}


@dataclass(frozen=True, slots=True)
class Method:
    """One method.

    Attributes:
        name: one of ``NAMES``.
        cold: solves a problem from scratch.
        warm: makes a function that solves a stream of problems, each from the one before or in
            the workspace kept from it; None for a method that cannot.
        max_problems: of a task, that it solves; None for all.
    """

    name: str
    cold: Callable[[ForceProblem], Solution]
    warm: Callable[[], Callable[[ForceProblem], Solution]] | None
    max_problems: int | None = None


def method(name: str) -> Method:
    """Return a method by name.

    Raises:
        InvalidInputError: an unknown name.
    """
    if name == WBF:
        return Method(WBF, solve, _ServoStream)
    if name not in NAMES:
        raise InvalidInputError(f"methods: got {name!r}, expected one of {', '.join(NAMES)}")
    base, options = VARIANTS.get(name, (name, {}))
    module = importlib.import_module(METHODS[base])
    cold, limit = partial(module.solve, **options), SLOW.get(name)
    if hasattr(module, "Prepared"):
        return Method(
            name, cold, lambda: _KeptWorkspace(partial(module.Prepared, **options)), limit
        )
    restarts = "start" in inspect.signature(module.solve).parameters
    return Method(name, cold, (lambda: _WarmStart(cold)) if restarts else None, limit)


def select(names: Sequence[str] | None) -> list[Method]:
    """Return the methods of these names, each once, or all.

    Raises:
        InvalidInputError: an unknown name.
    """
    return [method(name) for name in dict.fromkeys(NAMES if names is None else names)]


class _ServoStream:
    """A Servo that is made when the first problem comes."""

    def __init__(self) -> None:
        self._servo: Servo | None = None

    def __call__(self, problem: ForceProblem) -> Solution:
        if self._servo is None:
            self._servo = Servo(problem)
        return self._servo.step_to(problem)


class _KeptWorkspace:
    """A method whose solver keeps its workspace, made when the first problem comes."""

    def __init__(self, prepare: Callable[[ForceProblem], Any]) -> None:
        self._prepare = prepare
        self._prepared: Any = None

    def __call__(self, problem: ForceProblem) -> Solution:
        if self._prepared is None:
            self._prepared = self._prepare(problem)
        return self._prepared.solve(problem)


class _WarmStart:
    """A method that starts from the forces before."""

    def __init__(self, baseline: Callable[..., Solution]) -> None:
        self._baseline = baseline
        self._last: Solution | None = None

    def __call__(self, problem: ForceProblem) -> Solution:
        start = None if self._last is None else self._last.c
        self._last = self._baseline(problem, start=start)
        return self._last
