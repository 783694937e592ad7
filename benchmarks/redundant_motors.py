"""Hands of more motors than motions: the verdict beside Clarabel's, which has every motor's force.

Random hands (``tests/redundant_hands.py``): antagonists, one tendon more than joints, muscles over
any joints, a motor at each joint and a tendon over them, coupled joints with two motors, a third of
the contacts pulling. Each is read from MJCF by ``hands.from_mjcf``. Clarabel seeks the largest
margin to all limits with the forces of all motors and couplings as unknowns. Both have to come to
the same verdict, and every verdict of graspforce has to pass ``Solution.verify``.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from rich.progress import track
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.cli.process import as_command

sys.path.append(str(Path(__file__).parents[1] / "tests"))
import redundant_hands

WANTED = {"holds": gf.Status.SOLVED, "cannot": gf.Status.INFEASIBLE}


def judge(seed: int, index: int) -> tuple[str, gf.Solution, int]:
    """Return Clarabel's word on a random hand, graspforce's answer, and the internal forces."""
    case = redundant_hands.random_case(np.random.default_rng([seed, index]))
    margin = redundant_hands.margin(case)
    word = (
        "on the edge"
        if abs(margin) <= redundant_hands.EDGE
        else "holds"
        if margin > 0
        else "cannot"
    )
    return word, gf.solve(case.grasp.problem(case.f)), len(case.grasp.internal)


def compare(seed: int, count: int) -> tuple[Table, list[str]]:
    """Return the table of verdicts over ``count`` hands, and what differs."""
    found: Counter[tuple[str, str]] = Counter()
    differing: list[str] = []
    redundant = 0
    for index in track(range(count), "hands"):
        word, solution, internals = judge(seed, index)
        redundant += internals > 0
        found[word, solution.status.name] += 1
        if not solution.verify().ok:
            differing.append(f"hand {index}: {solution.status} is not verified")
        if solution.status is not WANTED.get(word, solution.status):
            differing.append(f"hand {index}: {solution.status}, and Clarabel says that it {word}")
    table = Table(title=f"{count} random hands, {redundant} with more motors than motions")
    for heading in ("Clarabel", "graspforce", "hands"):
        table.add_column(heading)
    for (word, status), times in sorted(found.items()):
        table.add_row(word, status, str(times))
    return table, differing


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gf.GraspForceWarning)
        table, differing = compare(options.seed, options.count)
    show(
        table, *(differing or ["no verdict differs, all are verified"]), save=options.save, width=80
    )
    return 1 if differing else 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
