"""Problems and solutions with the name that their file gives them."""

from __future__ import annotations

from typing import NamedTuple

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


class GraspFile(NamedTuple):
    """What was read from a file of grasps.

    Attributes:
        grasps: at least one, in the file's order.
        unused_keys: keys of an NPZ file that are not part of the format; none of a JSON file.
    """

    grasps: list[NamedProblem]
    unused_keys: list[str]


def default_name(stem: str, index: int, count: int) -> str:
    """Return the name of a grasp that has none: its file's, with the index among several."""
    return stem if count == 1 else f"{stem}[{index}]"
