"""What the paper says of a figure, beside what was measured here."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Claim:
    """One row of the table "the paper says | measured here".

    Attributes:
        paper: the paper's statement, in our words.
        measured: what came out here, in words and numbers.
        numbers: the numbers that ``measured`` rests on, by name; units in the names.
        holds: whether the measurement bears the statement out; None where the two cannot be
            compared, as times on different machines.
    """

    paper: str
    measured: str
    numbers: dict[str, float]
    holds: bool | None
