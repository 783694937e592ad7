"""Contact forces tick after tick: the one stateful class of graspforce.

A servo loop asks for forces at 250 Hz to 1 kHz, and from one tick to the next the optimum moves
smoothly. A :class:`Servo` extrapolates its last two optima (Section III-C.5), takes a Newton
step that also restores W c = f, and judges it by a bound known beforehand; on most ticks that is
all. Where the extrapolated forces leave the limits it starts from the last optimum, and only
where that fails too from scratch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspforce import _engine
from graspforce._arrays import Array, require_instance
from graspforce.contact import ContactModel
from graspforce.errors import InvalidInputError
from graspforce.outcome import Status
from graspforce.problem import ForceProblem
from graspforce.settings import Settings
from graspforce.solution import Solution
from graspforce.solve import DEFAULT


class Servo:
    """Solves a stream of problems of one shape, each from the one before.

    Two ways to run it. :meth:`step` takes the arrays that have changed and returns a
    :class:`Solution`. :meth:`tick` solves from arrays that live in the Servo and are written in
    place, and returns the verdict alone; it takes the least time::

        servo.f[:] = f
        servo.J[:] = J
        if servo.tick() is gf.Status.SOLVED:
            tau = servo.J.T @ servo.c

    Contacts leave the grasp and come back through ``engagement``; that takes no new memory.

    A copy, by ``copy``, ``deepcopy`` or ``pickle``, has the same settings and arrays of its own
    with the same numbers. It has had no tick: its first one starts cold.

    Args:
        problem: the first tick's problem; its shape (contacts, joints, kinds of limits) stays.
        settings: tolerance, limits on steps and time, backend.

    Raises:
        InvalidInputError: an argument of the wrong kind.

    Attributes:
        tick: Solve the next tick from the arrays below as they stand; returns its
            :class:`Status`. Raises InvalidInputError where a number is not finite or out of its
            range; the Servo then answers the next good tick as if nothing had happened.
    """

    __slots__ = ("_backend", "_fields", "_layout", "_settings", "_step", "tick")

    tick: Callable[[], Status]

    def __init__(self, problem: ForceProblem, settings: Settings | None = None) -> None:
        require_instance(problem, "problem", ForceProblem)
        self._settings = DEFAULT if settings is None else settings
        require_instance(self._settings, "settings", Settings)
        self._layout = problem.layout
        self._backend = backend = _engine.make_servo(problem, self._settings, Solution)
        self._fields = self._layout.views(backend.numbers)
        self._step = backend.step
        self.tick = backend.tick

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
            solution = self._step(
                W, f, J, tau_lo, tau_hi, tau_bias, c_max, c_min, engagement, A, b, None, None, alpha
            )
            if solution is not None:
                return solution
        given: dict[str, Any] = {
            "f": f, "W": W, "J": J, "tau_lo": tau_lo, "tau_hi": tau_hi, "tau_bias": tau_bias,
            "c_max": c_max, "c_min": c_min, "engagement": engagement, "A": A, "b": b,
            "alpha": alpha, "models": models,
        }  # fmt: skip
        now = ForceProblem.from_packed(self._layout, self._backend.numbers.copy())
        return self._solve(now.replace(**{name: v for name, v in given.items() if v is not None}))

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

    # ---- the arrays that live in the Servo ----------------------------------------------------

    @property
    def f(self) -> Array:
        """Wanted wrench of the next tick, shape (k,) [N, N·m]; write to it in place."""
        return self._fields["f"]

    @property
    def W(self) -> Array:
        """Grasp map of the next tick, shape (k, m); write to it in place."""
        return self._fields["W"]

    @property
    def J(self) -> Array:
        """Hand Jacobian of the next tick, shape (m, n_joints); write to it in place."""
        return self._fields["J"]

    @property
    def tau_lo(self) -> Array:
        """Lower torque limits of the next tick, shape (n_joints,) [N·m]; write in place."""
        return self._fields["tau_lo"]

    @property
    def tau_hi(self) -> Array:
        """Upper torque limits of the next tick, shape (n_joints,) [N·m]; write in place."""
        return self._fields["tau_hi"]

    @property
    def tau_bias(self) -> Array:
        """Torques already taken in the next tick, shape (n_joints,) [N·m]; write in place."""
        return self._fields["tau_bias"]

    @property
    def c_max(self) -> Array:
        """Ceilings of the next tick, shape (n,) [N], empty without any; write in place."""
        return self._fields["c_max"]

    @property
    def c_min(self) -> Array:
        """Floors of the next tick, shape (n,) [N], empty without any; write in place."""
        return self._fields["c_min"]

    @property
    def engagement(self) -> Array:
        """Engagements of the next tick, shape (n,); write in place."""
        return self._fields["engagement"]

    @property
    def A(self) -> Array:
        """Further limits A c ≤ b of the next tick, shape (p, m); write in place."""
        return self._fields["A"]

    @property
    def b(self) -> Array:
        """Right-hand sides of A c ≤ b of the next tick, shape (p,); write in place."""
        return self._fields["b"]

    @property
    def alpha(self) -> Array:
        """Weight of the limits of the next tick, shape (); write ``servo.alpha[...] = 3``."""
        return self._fields["alpha"]

    # ---- what the last tick found -------------------------------------------------------------

    @property
    def c(self) -> Array:
        """Contact forces of the last tick, shape (m,); a view that the next tick overwrites."""
        return self._backend.c

    @property
    def nu(self) -> Array:
        """Multipliers of W c = f, shape (k,); a view that the next tick overwrites."""
        return self._backend.nu

    @property
    def solution(self) -> Solution:
        """The last tick's solution, a copy: verdict, steps, decrement, start, residuals.

        Raises:
            InvalidInputError: there has been no tick.
        """
        outcome = self._backend.last()
        if outcome is None:
            raise InvalidInputError("solution: asked for before the first tick")
        return Solution(outcome, self.problem)

    @property
    def problem(self) -> ForceProblem:
        """The problem of the last tick, or the one given at construction."""
        return ForceProblem.from_packed(self._layout, self._backend.packed)

    @property
    def settings(self) -> Settings:
        """The settings given at construction."""
        return self._settings

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle by what makes another: the last problem, the settings, the arrays."""
        return (type(self), (self.problem, self._settings), np.array(self._backend.numbers))

    def __setstate__(self, numbers: Array) -> None:
        self._backend.numbers[:] = numbers

    def __repr__(self) -> str:
        return f"Servo({self.problem!r}, {self._settings!r})"
