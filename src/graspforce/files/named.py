"""Problems and solutions with the name that their file gives them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, overload

from graspforce.columns import Columns, ProblemColumns
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


class NamedProblems(Sequence[NamedProblem]):
    """The grasps of a file, in its order; problems of one layout stand in arrays.

    Attributes:
        names: theirs.
        problems: what they are.
    """

    def __init__(self, names: Sequence[str], problems: ProblemColumns) -> None:
        self.names, self.problems = list(names), problems

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[NamedProblem]:
        return map(NamedProblem, self.names, self.problems)

    @overload
    def __getitem__(self, index: int) -> NamedProblem: ...
    @overload
    def __getitem__(self, index: slice) -> list[NamedProblem]: ...
    def __getitem__(self, index: int | slice) -> NamedProblem | list[NamedProblem]:
        if isinstance(index, slice):
            return list(map(NamedProblem, self.names[index], self.problems[index]))
        return NamedProblem(self.names[index], self.problems[index])


class NamedSolutions(Sequence[NamedSolution]):
    """Results in the order of a file, whose numbers stand in arrays.

    Attributes:
        names: of the grasps.
        columns: their solutions.
    """

    def __init__(self, names: Sequence[str], columns: Columns) -> None:
        self.names, self.columns = list(names), columns

    @classmethod
    def of(cls, results: Sequence[tuple[str, Solution]]) -> NamedSolutions:
        """Put results into arrays that do not stand in them already."""
        if isinstance(results, NamedSolutions):
            return results
        return cls([name for name, _ in results], Columns(each for _, each in results))

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, index: int) -> NamedSolution: ...
    @overload
    def __getitem__(self, index: slice) -> list[NamedSolution]: ...
    def __getitem__(self, index: int | slice) -> NamedSolution | list[NamedSolution]:
        if isinstance(index, slice):
            return list(map(NamedSolution, self.names[index], self.columns[index]))
        return NamedSolution(self.names[index], self.columns[index])


class GraspFile(NamedTuple):
    """What was read from a file of grasps.

    Attributes:
        grasps: at least one, in the file's order.
        unused_keys: keys of an NPZ file that are not part of the format; none of a JSON file.
    """

    grasps: NamedProblems
    unused_keys: list[str]


def default_name(stem: str, index: int, count: int) -> str:
    """Return the name of a grasp that has none: its file's, with the index among several."""
    return stem if count == 1 else f"{stem}[{index}]"
