"""Wrenches that cannot be had, beside Clarabel's projection, and wrenches on the edge.

Infeasible random grasps (``tests/clarabel_oracle.py``): the answer's force has to lie strictly
inside every limit, and the wrench that it lacks to be that of the projection of f onto what is
possible, torques by the grasp's size. Wrenches on an extreme ray of one of several feet's cones
have to be found to be on the edge. ``tests/test_nearest.py`` holds both by smaller samples.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from rich.progress import track
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.cli.process import as_command

sys.path.append(str(Path(__file__).parents[1] / "tests"))
import clarabel_oracle
import test_nearest as cases

LARGEST = 1e-6


def missing_parts(count: int, seed: int) -> tuple[Table, bool]:
    """Return how far the missing wrenches are from Clarabel's, and whether all are near enough."""
    rng, inside = np.random.default_rng(seed), 0
    off: dict[bool, list[float]] = {True: [], False: []}
    for _ in track(range(count), "missing parts"):
        while True:
            problem = clarabel_oracle.random_problem(rng)
            found = gf.solve(problem)
            if found.status is gf.Status.INFEASIBLE and found.nearest:
                break
        check = found.verify()
        inside += check.ok and check.friction_margin > 0 and check.limit_margin > 0
        status, lacks = clarabel_oracle.nearest_by_clarabel(problem)
        scales = problem.wrench_scales()
        size = np.linalg.norm(problem.f / scales)
        apart = float(np.linalg.norm(found.missing / scales - lacks) / size)
        off[status == "Solved"].append(apart)
    table = Table(title=f"{count} infeasible random grasps, seed {seed}", show_header=False)
    table.add_row("strictly inside every cone and limit, verified", str(inside))
    for reached, them in off.items():
        table.add_row(
            f"missing wrench off Clarabel's where that {'reaches' if reached else 'misses'} its "
            f"tolerance of 1e-12, relative to f: {len(them)}; median, p99, most",
            f"{np.median(them):.1e}, {np.percentile(them, 99):.1e}, {max(them):.1e}",
        )
    return table, inside == count and max(off[True]) <= LARGEST


def extreme_rays(count: int, seed: int) -> tuple[Table, bool]:
    """Return the verdicts on wrenches on extreme rays, and whether all are right."""
    rng, verdicts = np.random.default_rng(seed), Counter[str]()
    for _ in track(range(count), "extreme rays"):
        contacts = cases.feet(rng, int(rng.integers(3, 6)))
        f, _ = cases.on_a_ray(rng, contacts)
        found = gf.solve(gf.Grasp(contacts).problem(f, c_max=50))
        verdicts[found.status.name + (", verified" if found.verify().ok else "")] += 1
    table = Table(
        title=f"{count} wrenches on an extreme ray of one of 3 to 5 feet's cones, seed {seed}",
        show_header=False,
    )
    for verdict, times in verdicts.most_common():
        table.add_row(verdict, str(times))
    return table, verdicts["ON_EDGE, verified"] == count


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--save", type=writable, help="write the tables to this file")
    options = parser.parse_args()
    missing, near = missing_parts(options.count, options.seed)
    rays, right = extreme_rays(options.count, options.seed)
    show(missing, rays, save=options.save, width=100)
    return 0 if near and right else 1


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
