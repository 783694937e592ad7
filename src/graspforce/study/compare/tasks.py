"""What the methods are compared on: the ticks of a scenario, or the grasps of a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspforce import files, scenarios
from graspforce._util.arrays import Array
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem

# The cube at rest gives the same problem again and again.
STATIC_TICKS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Problems to be solved by every method.

    Attributes:
        name: of the scenario or the file.
        problems: T of them.
        t: when each tick is, shape (T,) [s]; None for the grasps of a file.
    """

    name: str
    problems: tuple[ForceProblem, ...]
    t: Array | None

    def subset(self, limit: int | None) -> NDArray[np.int64]:
        """Return the indices of all problems, or of ``limit`` of them, even over the whole.

        Of ticks they are pairs of neighbours, because a jump needs two, and beside those the
        pairs between which a contact leaves or returns.
        """
        total = len(self.problems)
        if limit is None or limit >= total:
            return np.arange(total)
        if self.t is None:
            return np.linspace(0, total - 1, limit).astype(np.int64)
        first = np.linspace(0, total - 2, max(1, limit // 2)).astype(np.int64)
        there = np.array([problem.active for problem in self.problems])
        changes = np.flatnonzero((np.diff(there.astype(int), axis=0) != 0).any(axis=1))
        first = np.concatenate((first, changes))
        return np.unique(np.concatenate((first, first + 1)))


def task(name: str | Path) -> Task:
    """Return the task of a scenario's name or a file of grasps.

    Raises:
        InvalidInputError: neither a scenario nor a file that can be read.
    """
    if str(name) in scenarios.NAMES:
        scenario = scenarios.get(str(name))
        ticks = scenario.times[: STATIC_TICKS if name == "static" else None]
        return Task(str(name), tuple(scenario.problem(float(t)) for t in ticks), ticks)
    path = Path(name)
    if not path.exists():
        raise InvalidInputError(
            f"task: got {str(name)!r}, expected a file of grasps or one of "
            f"{', '.join(scenarios.NAMES)}"
        )
    return Task(path.name, tuple(problem for _, problem in files.read(path)), None)
