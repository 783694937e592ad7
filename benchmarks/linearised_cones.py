"""What linearised friction cones cost on real grasps: 193 of an Allegro hand on scanned objects.

Each grasp carries its object's weight in six directions, as when hand and object turn together.
The least-norm forces under the exact cones (``baselines.socp``) are set beside those under
pyramids of some facets (``baselines.qp``): inner pyramids lose grasps and squeeze harder, outer
ones leave the true cones. The data are those of ``../shared/data/allegro_ycb.npz``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.baselines import qp, socp
from graspforce.cli.process import as_command

DATA = Path(__file__).parents[1].parent / "shared" / "data" / "allegro_ycb.npz"
DIRECTIONS = np.vstack((np.eye(3), -np.eye(3)))
FACETS = (4, 8, 16, 64)
# An answer has left the true cones where a friction margin is below this part of the weight.
LEFT = -1e-3


def grasps(data: Path) -> Iterator[gf.ForceProblem]:
    """Every grasp with its weight in every direction."""
    with np.load(data) as file:
        given = {name: file[name] for name in ("W", "J", "f", "mu", "tau_limit")}
    limit = given["tau_limit"]
    for W, J, f, mu in zip(*(given[name] for name in ("W", "J", "f", "mu")), strict=True):
        for direction in DIRECTIONS:
            wrench = np.append(np.linalg.norm(f[:3]) * direction, np.zeros(3))
            yield gf.ForceProblem(W, wrench, gf.PCWF(mu), J=J, tau_lo=-limit, tau_hi=limit)


class Row(NamedTuple):
    """What pyramids of one number of facets do to feasible problems.

    Attributes:
        facets: of each cone.
        feasible: how many problems the exact cones can solve.
        lost: how many of them the inner pyramids cannot.
        norms: ‖c‖ under inner pyramids over ‖c‖ under the exact cones, of the others.
        left: how many answers of the outer pyramids are outside the true cones.
    """

    facets: int
    feasible: int
    lost: int
    norms: np.ndarray
    left: int


def judge(problems: Sequence[gf.ForceProblem], facets: Sequence[int] = FACETS) -> list[Row]:
    """Compare pyramids with the exact cones on problems, of which some may be infeasible."""
    exact = [socp.solve(problem, objective="norm") for problem in problems]
    solved = [answer for answer in exact if answer.status is gf.Status.SOLVED]
    rows = []
    for number in facets:
        norms, lost, left = [], 0, 0
        for answer in solved:
            inner = qp.solve(answer.problem, facets=number, cones="inner")
            outer = qp.solve(answer.problem, facets=number, cones="outer")
            if inner.status is gf.Status.SOLVED:
                norms.append(np.linalg.norm(inner.c) / np.linalg.norm(answer.c))
            else:
                lost += 1
            weight = np.abs(answer.problem.f).max()
            left += bool(outer.friction_margins.min() < LEFT * weight)
        rows.append(Row(number, len(solved), lost, np.array(norms), left))
    return rows


def table(rows: list[Row], problems: int) -> Table:
    result = Table(title=f"linearised cones on {problems} loads of 193 Allegro grasps, least norm")
    for heading in ("facets", "feasible, exact", "inner: not solved", "inner: ‖c‖, median",
                    "‖c‖², median", "outer: leaves the cones"):  # fmt: skip
        result.add_column(heading, justify="right")
    for row in rows:
        more = np.median(row.norms), np.median(row.norms**2)
        result.add_row(
            str(row.facets), str(row.feasible), str(row.lost),
            *(f"+{100 * (each - 1):.2g} %" for each in more), str(row.left),
        )  # fmt: skip
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    if not options.data.is_file():
        parser.error(f"there are no grasps at {options.data}; --data says where else")
    problems = list(grasps(options.data))
    show(table(judge(problems), len(problems)), save=options.save, width=110)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
