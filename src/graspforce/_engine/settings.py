"""What a caller may choose about the solving itself, as opposed to the problem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from graspforce._util.arrays import as_integer, as_positive, require_choice
from graspforce.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Settings:
    """Stopping rule and backend of :func:`graspforce.solve` and :class:`graspforce.Servo`.

    Args:
        tol: certified bound on decrement²/2 at return, for Phi over its unit, so that every
            barrier term is standard self-concordant.
        max_steps: the most Newton steps of a solve or a tick, those of Phase 1 included; up to
            2³¹ − 1, what the native core counts to.
        budget_us: the longest that a solve or a tick of the native core may take [µs]; the step
            that is under way is finished, and one is always taken. None for no limit.
        backend: "native" for the C++ core, "reference" for the NumPy transcription of the paper.

    Raises:
        InvalidInputError: tol, max_steps or budget_us out of range, or an unknown backend.
    """

    tol: float = 1e-9
    max_steps: int = 200
    budget_us: float | None = None
    backend: Literal["native", "reference"] = "native"

    def __post_init__(self) -> None:
        tol = as_positive(self.tol, "tol")
        if tol >= 1:
            raise InvalidInputError(f"tol: got {tol}, expected less than 1")
        object.__setattr__(self, "tol", tol)
        object.__setattr__(self, "max_steps", as_integer(self.max_steps, "max_steps", 1))
        if self.budget_us is not None:
            budget_us = as_positive(self.budget_us, "budget_us", "µs")
            object.__setattr__(self, "budget_us", budget_us)
        require_choice(self.backend, "backend", ("native", "reference"))


DEFAULT = Settings()
