"""Problems and solutions with the name that their file gives them."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import NamedTuple

from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution


class NamedProblem(NamedTuple):
    """A force problem and what its file calls it; names need not be unique."""

    name: str
    problem: ForceProblem


class NamedSolution(NamedTuple):
    """A solution and the name of the grasp that it belongs to."""

    name: str
    solution: Solution


def default_name(stem: str, index: int, count: int) -> str:
    """Return the name of a grasp that has none: its file's, with the index among several."""
    return stem if count == 1 else f"{stem}[{index}]"


@contextmanager
def place(where: str) -> Generator[None]:
    """Put ``where`` in front of the text of an InvalidInputError raised inside."""
    try:
        yield
    except InvalidInputError as error:
        raise InvalidInputError(f"{where}: {error}") from error
