"""Contact forces tick after tick: the one stateful class of graspforce.

A servo loop asks for forces at 250 Hz to 1 kHz, and from one tick to the next the optimum moves
smoothly. A :class:`Servo` extrapolates its last two optima (Section III-C.5), takes a Newton
step that also restores W c = f, and judges it by a bound known beforehand; on most ticks that is
all. Where the extrapolated forces leave the limits it starts from the last optimum, and only
where that fails too from scratch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from graspforce import _engine
from graspforce.contact import ContactModel
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.settings import Settings
from graspforce.solution import Solution
from graspforce.solve import DEFAULT


class Servo:
    """Solves a stream of problems of one shape, each from the one before.

    Args:
        problem: the first tick's problem; its shape (contacts, joints, kinds of limits) stays.
        settings: tolerance, step limit, backend.
    """

    def __init__(self, problem: ForceProblem, settings: Settings | None = None) -> None:
        self._settings = settings or DEFAULT
        self._layout = problem.layout
        self._backend = _engine.make_servo(problem, self._settings)

    def step(
        self,
        *,
        f: ArrayLike | None = None,
        W: ArrayLike | None = None,
        J: ArrayLike | None = None,
        tau_lo: ArrayLike | None = None,
        tau_hi: ArrayLike | None = None,
        tau_bias: ArrayLike | None = None,
        c_max: ArrayLike | None = None,
        c_min: ArrayLike | None = None,
        engagement: ArrayLike | None = None,
        A: ArrayLike | None = None,
        b: ArrayLike | None = None,
        alpha: float | None = None,
        models: ContactModel | Sequence[ContactModel] | None = None,
    ) -> Solution:
        """Solve the next tick; arguments as for :class:`ForceProblem`, only what changed.

        Returns:
            This tick's solution. An infeasible tick is a status, not an exception.

        Raises:
            InvalidInputError: an argument is wrong; the Servo is as it was before the call.
        """
        if models is None:
            # The native backend takes plain float64 arrays of the right shape and valid numbers
            # at once, and leaves everything else, unchanged, to the checks below.
            outcome = self._backend.step(
                f, W, J, tau_lo, tau_hi, tau_bias, c_max, c_min, engagement, A, b, alpha
            )
            if outcome is not None:
                return Solution(outcome, self._layout)
        given: dict[str, Any] = {
            "f": f, "W": W, "J": J, "tau_lo": tau_lo, "tau_hi": tau_hi, "tau_bias": tau_bias,
            "c_max": c_max, "c_min": c_min, "engagement": engagement, "A": A, "b": b,
            "alpha": alpha, "models": models,
        }  # fmt: skip
        return self._solve(
            self.problem.replace(**{name: v for name, v in given.items() if v is not None})
        )

    def _solve(self, problem: ForceProblem) -> Solution:
        if problem.layout != self._layout:
            raise InvalidInputError(
                f"step: got {problem!r}, expected the shape that the Servo was made with "
                f"({self.problem!r}); make a new Servo for another"
            )
        return Solution(self._backend.step_problem(problem.packed), problem)

    def reset(self) -> None:
        """Forget the past optima: the next tick starts cold."""
        self._backend.reset()

    @property
    def problem(self) -> ForceProblem:
        """The problem of the last tick, or the one given at construction."""
        return ForceProblem.from_packed(self._layout, self._backend.packed)

    @property
    def settings(self) -> Settings:
        """The settings given at construction."""
        return self._settings

    def __repr__(self) -> str:
        return f"Servo({self.problem!r}, {self._settings!r})"
