"""What the methods are compared on: the ticks of a scenario, or the grasps of a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspforce import files, scenarios
from graspforce._arrays import Array
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
        t: when each tick is, shape (T,) [s]; None for a file, whose grasps follow in no time.
    """

    name: str
    problems: tuple[ForceProblem, ...]
    t: Array | None

    def some(self, share: float) -> NDArray[np.int64]:
        """Return the indices of about this share of the problems.

        Of ticks, pairs of neighbours, even over the time: a jump needs two.
        """
        total = len(self.problems)
        if share >= 1:
            return np.arange(total)
        if self.t is None:
            return np.unique(np.linspace(0, total - 1, max(1, int(share * total))).astype(int))
        pairs = max(1, int(share * total / 2))
        first = np.linspace(0, max(0, total - 2), pairs).astype(int)
        return np.unique(np.minimum(np.concatenate((first, first + 1)), total - 1))


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
