"""Contact forces tick after tick, warm-started: the one stateful class of graspforce.

A servo loop asks for forces at 250 Hz to 1 kHz, and from one tick to the next the optimum moves
smoothly. A :class:`Servo` extrapolates its last two optima (Section III-C.5), takes a Newton
step that also restores W c = f, and accepts it by an a-priori bound; most ticks end there. Where
the extrapolated forces leave the limits it starts from the last optimum, and where that fails, too,
it starts cold.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Unpack

import numpy as np

from graspforce._engine import dispatch
from graspforce._engine.layout import FIELDS
from graspforce._engine.outcome import Status
from graspforce._engine.settings import DEFAULT, Settings
from graspforce._util.arrays import Array, require_instance, require_keywords
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem, ProblemArguments
from graspforce.solution import Solution


class Servo:
    """Solves a stream of problems of one shape, each from the one before.

    Two ways to run it. :meth:`step` takes the arrays that have changed and returns a
    :class:`Solution`. :meth:`tick` solves from arrays that live in the Servo and are written in
    place, and returns the verdict alone; it takes the least time::

        servo.f[:] = f
        servo.J[:] = J
        if servo.tick() is gf.Status.SOLVED or servo.solution.nearest:
            tau = servo.J.T @ servo.c

    Contacts leave the grasp and come back through ``engagement``, without new memory.

    A copy, by ``copy``, ``deepcopy`` or ``pickle``, has the same settings and arrays of its own
    with the same numbers. It has had no tick: its first one starts cold.

    Args:
        problem: the first tick's problem; its shape (contacts, joints, kinds of limits) stays.
        settings: tolerance, limits on steps and time, backend.

    Raises:
        InvalidInputError: an argument of the wrong kind.

    Attributes:
        W, f, J, internal, tau_lo, tau_hi, tau_bias, c_max, c_min, engagement, pull, f_soft,
            cone_weight, c_last, dc_max, A, b, mu, gamma, alpha: the next tick's fields of a
            :class:`ForceProblem`, arrays that live in the Servo and are written in place
            (``servo.alpha[...] = 3``); empty where the first problem had none. With rate limits,
            ``c_last`` is overwritten by the forces of every tick that is SOLVED or ``nearest``.
    """

    __slots__ = {
        "_backend": None,
        "_fields": None,
        "_layout": None,
        "_settings": None,
        "_step": None,
        "tick": """Solve the next tick from the fields as they stand, in the least time.

        Returns:
            The tick's :class:`Status`; the forces are in ``servo.c``.

        Raises:
            InvalidInputError: a number is not finite or out of its range; the Servo then answers
                the next valid tick as if this one had not been made.
        """,
    }

    tick: Callable[[], Status]
    W: Array
    f: Array
    J: Array
    internal: Array
    tau_lo: Array
    tau_hi: Array
    tau_bias: Array
    c_max: Array
    c_min: Array
    engagement: Array
    pull: Array
    f_soft: Array
    c_last: Array
    dc_max: Array
    A: Array
    b: Array
    mu: Array
    gamma: Array
    cone_weight: Array
    alpha: Array

    def __init__(self, problem: ForceProblem, settings: Settings | None = None) -> None:
        require_instance(problem, "problem", ForceProblem)
        self._settings = DEFAULT if settings is None else settings
        require_instance(self._settings, "settings", Settings)
        self._layout = problem.layout
        self._backend = backend = dispatch.make_servo(problem, self._settings, Solution)
        self._fields = self._layout.views(backend.numbers)
        self._step = backend.step
        self.tick = backend.tick

    def step(self, **changes: Unpack[ProblemArguments]) -> Solution:
        """Solve the next tick from what has changed: ``servo.step(f=f, W=W, J=J)``.

        Args:
            **changes: arguments of :class:`ForceProblem`, only those that changed; None stands
                for no change. float64 arrays of the right shape are taken at once.

        Returns:
            This tick's solution. An infeasible tick is a status, not an exception.

        Raises:
            InvalidInputError: an argument is wrong; the Servo is as it was before the call.
        """
        # The native backend takes plain arrays with valid numbers, and leaves
        # everything else to the checks below.
        solution = self._step(changes)
        if solution is not None:
            return solution
        require_keywords(changes, ProblemArguments.__annotations__, "Servo.step")
        given: dict[str, Any] = {name: v for name, v in changes.items() if v is not None}
        now = ForceProblem.from_packed(self._layout, self._backend.numbers.copy())
        return self._solve(now.replace(**given), "step")

    def step_to(self, problem: ForceProblem) -> Solution:
        """Solve the next tick from a whole problem of the same layout.

        Args:
            problem: all fields of the tick, which become the Servo's.

        Returns:
            This tick's solution.

        Raises:
            InvalidInputError: no problem, or one of other contacts, joints or kinds of limits.
        """
        require_instance(problem, "problem", ForceProblem)
        return self._solve(problem, "problem")

    def _solve(self, problem: ForceProblem, argument: str) -> Solution:
        if problem.layout != self._layout:
            raise InvalidInputError(
                f"{argument}: got {problem!r}, expected the shape that the Servo was made with "
                f"({self.problem!r}); make a new Servo for another"
            )
        return self._backend.step_problem(problem.packed, problem)

    def reset(self) -> None:
        """Discard the past optima: the next tick starts cold."""
        self._backend.reset()

    # ---- results of the last tick -------------------------------------------------------------

    @property
    def c(self) -> Array:
        """Contact forces of the last tick, shape (m,); a view that the next tick overwrites."""
        return self._backend.c

    @property
    def internal_forces(self) -> Array:
        """Internal forces v of the motors, shape (r,), likewise: tau has ``internal.T @ v``."""
        return self._backend.internal_forces

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
        """Copy and pickle by the last problem, the settings and the arrays."""
        return (type(self), (self.problem, self._settings), np.array(self._backend.numbers))

    def __setstate__(self, numbers: Array) -> None:
        self._backend.numbers[:] = numbers

    def __repr__(self) -> str:
        return f"Servo({self.problem!r}, {self._settings!r})"


def _field(name: str) -> property:
    def view(servo: Servo) -> Array:
        return servo._fields[name]  # pyright: ignore[reportPrivateUsage]

    shape = f"({', '.join(FIELDS[name].shape)}{',' * (len(FIELDS[name].shape) == 1)})"
    return property(
        view, doc=f"{FIELDS[name].doc} of the next tick, shape {shape}; write in place."
    )


for _name in FIELDS:
    setattr(Servo, _name, _field(_name))
