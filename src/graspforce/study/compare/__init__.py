"""Every method on the same tasks with the same measures: ``graspforce compare``.

>>> from graspforce.study import compare
>>> found = compare.compare(["static"], methods=["wbf", "dikin"])
>>> [each.method for each in found.rows]
['wbf', 'dikin']

Times are of calls from Python, warm caches, on this machine: compare them within a run. Slow
methods run a part of the ticks, in pairs of neighbours, so that a jump between ticks can show.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from graspforce._util.claim import Claim
from graspforce.problem import ForceProblem
from graspforce.scenarios import NAMES as SCENARIOS
from graspforce.study.compare import flops
from graspforce.study.compare.measure import Measured, measure
from graspforce.study.compare.methods import NAMES, WBF, select
from graspforce.study.compare.tasks import Task, task

__all__ = ["NAMES", "SCENARIOS", "Comparison", "Measured", "Task", "compare", "task"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """What all methods did on all tasks.

    Attributes:
        tasks: in the order asked for.
        rows: one a task and method, task by task.
    """

    tasks: tuple[Task, ...]
    rows: tuple[Measured, ...]

    def of(self, task: str, method: str) -> Measured | None:
        """Return the row of a task and method that was run; None if there is none."""
        for row in self.rows:
            if (row.task, row.method) == (task, method) and row.missing is None:
                return row
        return None

    def claims(self) -> list[Claim]:
        """Set the figures of Section IV-B.3 beside what was measured on the dynamic task."""
        ours, theirs = (self.of("dynamic", name) for name in (WBF, "sdp"))
        if ours is None or theirs is None:
            return []
        problem = self._first("dynamic")
        dense, block = flops.wbf_dense(problem), flops.wbf(problem)
        step, iterations = flops.sdp(problem), float(theirs.iterations.mean())
        warm = ours.cold_us if ours.warm_us is None else ours.warm_us
        ratio = float(np.median(theirs.cold_us) / np.median(warm))
        counts = ours.iterations if ours.warm_iterations is None else ours.warm_iterations
        mine = float(counts.mean())
        return [
            Claim(
                paper="A Newton step of the WBF takes roughly 12 kflops, one a tick.",
                measured=(
                    f"{dense / 1e3:.1f} kflops for the dense step by formula, "
                    f"{block / 1e3:.1f} for the block step of this package; "
                    f"{mine:.2f} steps a tick."
                ),
                numbers={"dense step": dense, "block step": block, "steps a tick": mine},
                holds=bool(0.75 <= dense / flops.PAPER_WBF_STEP <= 4 / 3),
            ),
            Claim(
                paper="An iteration of an SDP solver takes roughly 24 kflops.",
                measured=f"{step / 1e3:.1f} kflops by the paper's rule.",
                numbers={"iteration": step},
                holds=bool(0.75 <= step / flops.PAPER_SDP_STEP <= 4 / 3),
            ),
            Claim(
                paper="An SDP solver takes 5 iterations.",
                measured=f"Clarabel takes {iterations:.1f} from scratch, to all its digits.",
                numbers={"iterations": iterations},
                holds=bool(iterations <= flops.PAPER_SDP_STEPS + 0.5),
            ),
            Claim(
                paper="A tick of the SDP takes over 120 kflops.",
                measured=(
                    f"{step * iterations / 1e3:.0f} kflops with those iterations; "
                    f"{step * flops.PAPER_SDP_STEPS / 1e3:.0f} with {flops.PAPER_SDP_STEPS}."
                ),
                numbers={"tick": step * iterations},
                holds=bool(step * iterations > flops.PAPER_SDP_SOLVE),
            ),
            Claim(
                paper="The WBF costs at least an order of magnitude less than an SDP solver.",
                measured=(
                    f"{step * iterations / (block * mine):.0f} times fewer operations by "
                    f"formula. {ratio:.0f} times less time a tick, both from Python; that of the "
                    "SDP is in good part NumPy's, which assembles its matrices: it says little "
                    "of the algorithms."
                ),
                numbers={
                    "flops, factor": step * iterations / (block * mine),
                    "time, factor": ratio,
                },
                holds=bool(step * iterations / (block * mine) >= flops.PAPER_FACTOR),
            ),
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return everything in JSON's types; forces and times in full."""
        return {
            "paper": {
                "wbf step [flop]": flops.PAPER_WBF_STEP,
                "sdp iteration [flop]": flops.PAPER_SDP_STEP,
                "sdp iterations": flops.PAPER_SDP_STEPS,
                "sdp solve [flop]": flops.PAPER_SDP_SOLVE,
                "factor": flops.PAPER_FACTOR,
            },
            "claims": [
                {"paper": claim.paper, "measured": claim.measured, "holds": claim.holds}
                for claim in self.claims()
            ],
            "tasks": [
                {
                    "task": each.name,
                    "problems": len(each.problems),
                    "time [s]": None if each.t is None else each.t.tolist(),
                }
                for each in self.tasks
            ],
            "rows": [_row(row) for row in self.rows],
        }

    def to_json(self, about: dict[str, Any] | None = None) -> str:
        """Return :meth:`as_dict` as JSON text, after what else there is to say about the run."""
        content = {**(about or {}), **self.as_dict()}
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def _first(self, name: str) -> ForceProblem:
        return next(each for each in self.tasks if each.name == name).problems[0]


def compare(
    tasks: Sequence[str | Path | Task] = SCENARIOS,
    methods: Sequence[str] | None = None,
    whole: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> Comparison:
    """Run the methods on the tasks.

    Args:
        tasks: names of scenarios, files of grasps, or problems of your own as a :class:`Task`.
        methods: names; default all. One whose package is not installed has a row that says so.
        whole: run the slow methods, too, on every problem of a task.
        progress: called with a task's name, how many methods are done, and how many there are.

    Raises:
        InvalidInputError: an unknown task, method or file.
    """
    selected = select(methods)
    todo = tuple(each if isinstance(each, Task) else task(each) for each in tasks)
    rows: list[Measured] = []
    for each in todo:
        for done, method in enumerate(selected, 1):
            rows.append(measure(method, each, whole))
            if progress is not None:
                progress(each.name, done, len(selected))
    return Comparison(todo, tuple(rows))


def _row(row: Measured) -> dict[str, Any]:
    """Return a row in JSON's types; a number that is not finite is null."""
    if row.missing is not None:
        return {"task": row.task, "method": row.method, "missing": row.missing}
    return {
        "task": row.task,
        "method": row.method,
        "problems": row.of,
        "ran": row.ran.tolist(),
        "cold [us]": row.cold_us.tolist(),
        "warm [us]": None if row.warm_us is None else row.warm_us.tolist(),
        "iterations": row.iterations.tolist(),
        "warm iterations": None if row.warm_iterations is None else row.warm_iterations.tolist(),
        "flops a step": row.step_flops,
        "flops a solve": row.solve_flops,
        "slip margin [N]": row.slip_margin,
        "torque margin [N m]": row.torque_margin,
        "largest normal [N]": row.largest_normal,
        "largest jump [N]": row.largest_jump,
        "normal forces [N]": None
        if row.normal_forces is None
        else [[x if math.isfinite(x) else None for x in each] for each in row.normal_forces],
        "statuses": row.statuses,
        "infeasible": row.infeasible,
        "unbounded": row.unbounded,
        "failures": row.failures,
    }
