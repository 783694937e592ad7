"""How close every method of ``graspforce.baselines`` comes to its own optimum.

The 50 random grasps are those of the tests: 3 to 6 contacts of all kinds with ceilings, floors,
removed contacts and further limits, beside the paper's own grasp. Each method's objective is set
beside the optimum that another solver finds: dikin and gradient_flow beside ``sdp``, both from a
feasible start, as the network; sdp beside SciPy's BFGS; minimum_norm beside LAPACK's least squares;
wbf_conic beside ``gf.solve``; the others beside Clarabel on cones and limits that the tests write
down again. Takes a minute: ``python benchmarks/convergence.py``.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce import scenarios
from graspforce.baselines import (
    compact_dual,
    dikin,
    gradient_flow,
    lp,
    minimum_norm,
    neural_network,
    qp,
    sdp,
    socp,
    wbf_conic,
)  # fmt: skip
from graspforce.cli.process import as_command

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from baseline_oracles import (
    effort_and_barrier,
    least_effort_and_barrier,
    lp_distance,
    random_problems,
)  # fmt: skip
from baseline_oracles import socp as oracle

SEED, GRASPS, BARRIER = 20101, 50, 0.1


class Compared(NamedTuple):
    """A method, and who else finds its optimum.

    Attributes:
        name: in the table.
        solve: the method.
        optimum: another solver's least objective and, where they are unique, forces.
        value: the objective of an answer.
        unit: of the objective.
    """

    name: str
    solve: Callable[[gf.ForceProblem], gf.Solution]
    optimum: Callable[[gf.ForceProblem], tuple[float, np.ndarray | None]]
    value: Callable[[gf.Solution], float]
    unit: str


class Row(NamedTuple):
    """What came out.

    Attributes:
        name: of the method.
        unit: of the objective.
        objective: largest distance to the optimum [unit].
        forces: largest distance of any force component [N, N·m]; None where not unique.
        steps: iterations of each solve.
        unsolved: how many problems ended without an answer.
    """

    name: str
    unit: str
    objective: float
    forces: float | None
    steps: np.ndarray
    unsolved: int


def problems(count: int = GRASPS) -> Iterator[gf.ForceProblem]:
    """The paper's grasp, and as many random ones."""
    yield scenarios.get("static").problem(0.0)
    yield from random_problems(np.random.default_rng(SEED), count)


def from_inside(method: Callable[..., gf.Solution]) -> Callable[[gf.ForceProblem], gf.Solution]:
    """Start a method at the forces of the WBF, which are strictly inside."""
    return lambda problem: method(problem, start=gf.solve(problem, check=True).c)


def barrier_value(solution: gf.Solution) -> float:
    return effort_and_barrier(solution.problem, solution.c, BARRIER)


def sdp_optimum(problem: gf.ForceProblem) -> tuple[float, np.ndarray]:
    found = sdp.solve(problem, barrier=BARRIER)
    return barrier_value(found), found.c


def facetted(objective: str, problem: gf.ForceProblem) -> tuple[float, np.ndarray]:
    return oracle(problem, objective, facets=8, inner=True)


def value_alone(optimum: Callable) -> Callable[[gf.ForceProblem], tuple[float, None]]:
    """Drop the forces where a whole face of them is optimal."""
    return lambda problem: (optimum(problem)[0], None)


def exact(objective: str) -> Callable[[gf.ForceProblem], tuple[float, np.ndarray]]:
    return lambda problem: oracle(problem, objective)


def wbf_optimum(problem: gf.ForceProblem) -> tuple[float, np.ndarray]:
    found = gf.solve(problem, check=True)
    return found.phi, found.c


def least_squares(problem: gf.ForceProblem) -> tuple[float, np.ndarray]:
    kept = np.repeat(problem.active, problem.layout.dims)
    c = np.zeros(problem.m)
    c[kept] = np.linalg.lstsq(problem.W[:, kept], problem.f, rcond=None)[0]
    return c @ c / 2, c


VALUES: dict[str, tuple[Callable[[gf.Solution], float], str]] = {
    "normals": (lambda s: float(s.normal_forces.sum()), "N"),
    "normal": (lambda s: float(s.normal_forces.max()), "N"),
    "norm": (lambda s: float(s.c @ s.c) / 2, "N²"),
    "distance": (lambda s: float(lp_distance(s, 8, "inner")), "N"),
    "wbf": (lambda s: s.phi, "of Phi"),
    "barrier": (barrier_value, "N"),
}


def methods() -> list[Compared]:
    """Every method, by every solver that is installed."""
    found = [
        Compared("dikin", from_inside(dikin.solve), sdp_optimum, *VALUES["barrier"]),
        Compared(
            "gradient_flow", from_inside(gradient_flow.solve), sdp_optimum, *VALUES["barrier"]
        ),
        Compared(
            "sdp", sdp.solve, partial(least_effort_and_barrier, barrier=BARRIER),
            *VALUES["barrier"],
        ),
        Compared("sdp, no barrier", partial(sdp.solve, barrier=0), value_alone(exact("normals")),
                 *VALUES["normals"]),
        Compared("neural_network", from_inside(neural_network.solve), exact("norm"),
                 *VALUES["norm"]),
    ]  # fmt: skip
    for solver in ("clarabel", "qoco", "scs", "ecos", "moreau"):
        if importlib.util.find_spec(solver) is None:
            continue
        for objective, optimum in (
            ("normal", value_alone(exact("normal"))), ("norm", exact("norm")),
        ):  # fmt: skip
            run = partial(socp.solve, solver=solver, objective=objective)
            found.append(Compared(f"socp, {objective}, {solver}", run, optimum, *VALUES[objective]))
    found += [
        Compared("compact_dual, 8 facets", compact_dual.solve,
                 value_alone(partial(facetted, "normals")), *VALUES["normals"]),
        Compared("lp, 8 facets, distance", lp.solve, value_alone(partial(facetted, "distance")),
                 *VALUES["distance"]),
        Compared("lp, 8 facets, normal", partial(lp.solve, objective="normal"),
                 value_alone(partial(facetted, "normal")), *VALUES["normal"]),
        Compared("qp, 8 facets", qp.solve, partial(facetted, "norm"), *VALUES["norm"]),
        Compared("minimum_norm", minimum_norm.solve, least_squares, *VALUES["norm"]),
        Compared("wbf_conic", wbf_conic.solve, wbf_optimum, *VALUES["wbf"]),
    ]  # fmt: skip
    return found


def judge(method: Compared, grasps: list[gf.ForceProblem]) -> Row:
    """Run a method on all grasps; one without an answer there counts as unsolved."""
    objective, forces, steps, unsolved = 0.0, None, [], 0
    for problem in grasps:
        solution = method.solve(problem)
        if solution.status is not gf.Status.SOLVED:
            unsolved += 1
            continue
        least, c = method.optimum(problem)
        objective = max(objective, abs(method.value(solution) - least))
        if c is not None:
            forces = max(forces or 0.0, float(np.abs(solution.c - c).max()))
        steps.append(solution.newton_steps)
    return Row(method.name, method.unit, objective, forces, np.array(steps), unsolved)


def table(rows: list[Row], count: int) -> Table:
    result = Table(title=f"distance to the optimum, the paper's grasp and {count} random ones")
    for heading in ("method", "objective", "forces [N]", "iterations, mean", "most", "unsolved"):
        result.add_column(heading, justify="left" if heading == "method" else "right")
    for row in rows:
        result.add_row(
            row.name, f"{row.objective:.0e} {row.unit}",
            "–" if row.forces is None else f"{row.forces:.0e}",
            f"{row.steps.mean():.0f}", f"{row.steps.max()}", str(row.unsolved),
        )  # fmt: skip
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--grasps", type=int, default=GRASPS, help="how many random ones")
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    grasps, rows = list(problems(options.grasps)), []
    with Console().status("solving") as status:
        for method in methods():
            status.update(method.name)
            rows.append(judge(method, grasps))
    show(table(rows, options.grasps), save=options.save, width=100)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
