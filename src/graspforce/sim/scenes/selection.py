"""Selection of one entry by name, or of all."""

from __future__ import annotations

from typing import TypeVar

from graspforce.errors import InvalidInputError

T = TypeVar("T")


def select(name: str, known: dict[str, T], argument: str) -> dict[str, T]:
    """Return the entry of that name, or with "all" every one.

    Raises:
        InvalidInputError: an unknown name; the text lists the valid ones.
    """
    if name == "all":
        return known
    if name not in known:
        raise InvalidInputError(f"{argument}: got {name!r}, expected all, {', '.join(known)}")
    return {name: known[name]}
