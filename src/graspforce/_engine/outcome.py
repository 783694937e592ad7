"""What a backend hands back: the verdict and the raw numbers behind it."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from graspforce._util.arrays import Array


class _Named(enum.IntEnum):
    """An IntEnum that prints as its name, as what a user looks for."""

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        """Format the name, or the number where ``spec`` ends in the type code of one."""
        return format(int(self) if spec.endswith(tuple("bcdeEfFgGnoxX%")) else self.name, spec)


class Status(_Named):
    """What the mathematics found."""

    SOLVED = 0  #: strictly inside every limit, W c = f, suboptimality certified
    INFEASIBLE = 1  #: no force satisfies everything, as a certificate proves; see Solution.c
    WRENCH_UNREACHABLE = 2  #: f is outside the range of W: no contact force makes it; likewise
    UNBOUNDED = 3  #: nothing limits the grip, so Phi has no minimum
    MAX_STEPS = 4  #: the limit on steps or time came first; the force is the best one known
    STALLED = 5  #: rounding stopped the progress; the force is the best one known
    INVALID_NUMBERS = 6  #: the data overflow in double precision
    ON_EDGE = 7  #: f is on the edge of what can be held: no force strictly inside makes it


class Start(_Named):
    """Where the Newton steps that led to an answer set out from."""

    COLD = 0  #: pure pushes, or Phase 1
    HELD = 1  #: the last optimum
    EXTRAPOLATED = 2  #: the last two optima
    GIVEN = 3  #: forces that the caller gave


class Outcome(Protocol):
    """The result of one solve, as the native core and the reference both return it."""

    @property
    def status(self) -> int:
        """The verdict, a value of :class:`Status`."""
        ...

    @property
    def newton_steps(self) -> int:
        """Newton steps taken, those of Phase 1 included."""
        ...

    @property
    def c(self) -> Array:
        """Contact forces, shape (m,)."""
        ...

    @property
    def internal_forces(self) -> Array:
        """Internal forces of the motors, shape (r,)."""
        ...

    @property
    def nu(self) -> Array:
        """Multipliers of W c = f, shape (k,)."""
        ...

    @property
    def decrement(self) -> float:
        """Certified bound on the Newton decrement at c, for Phi over its unit."""
        ...

    @property
    def violation(self) -> float:
        """Least relative violation that Phase 1 reached; 0 when it did not have to."""
        ...

    @property
    def nearest(self) -> bool:
        """Whether c, not SOLVED, is inside the limits and makes the wrench nearest to f."""
        ...

    @property
    def start(self) -> int:
        """Where the steps set out from, a value of :class:`Start`."""
        ...

    @property
    def elapsed_us(self) -> float:
        """Time taken [µs] where the settings limit it, else 0."""
        ...

    @property
    def y(self) -> Array | None:
        """Wrench direction of the certificate of infeasibility, shape (k,)."""
        ...

    @property
    def z(self) -> Array | None:
        """Its multipliers for all linear limits, the uncounted ones zero."""
        ...


class TickOutcome(Outcome, Protocol):
    """An outcome that carries a snapshot of its problem."""

    @property
    def packed(self) -> Array:
        """The problem's flat buffer as it was when solved."""
        ...


@dataclass(frozen=True, slots=True)
class PlainOutcome:
    """An :class:`Outcome` of plain Python data: the reference's, and what pickles."""

    status: int
    newton_steps: int
    c: Array
    nu: Array
    decrement: float = float("inf")
    violation: float = 0.0
    y: Array | None = None
    z: Array | None = None
    start: int = Start.COLD
    elapsed_us: float = 0.0
    internal_forces: Array = field(default_factory=lambda: np.zeros(0))
    nearest: bool = False
