"""Write the paper's regrasp as a task for the C++ controller: a cube in motion, a finger away.

python examples/cpp/write_task.py > task.txt
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

import graspforce as gf

TICKS = 500


def problems() -> Iterator[gf.ForceProblem]:
    """The problem of every tick of Section IV-B.2."""
    scenario = gf.scenarios.get("regrasp")
    for k in range(TICKS):
        yield scenario.problem(k / scenario.rate)


def lines() -> Iterator[str]:
    """The task, line by line: a field is written when it has changed."""
    before: dict[str, np.ndarray] = {}
    for problem in problems():
        layout = problem.layout
        if not before:
            sizes = (layout.wrench_rows, layout.joints, layout.inequalities)
            sizes += (int(layout.ceilings), int(layout.floors), len(layout.dims), *layout.dims)
            yield f"layout {' '.join(map(str, sizes))}"
        for name, value in layout.views(problem.packed).items():
            if name not in before or not np.array_equal(before[name], value):
                yield f"{name} {' '.join(map(repr, value.ravel().tolist()))}"
                before[name] = value
        yield "tick"


if __name__ == "__main__":
    sys.stdout.writelines(line + "\n" for line in lines())
