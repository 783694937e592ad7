"""What every compiled core must do alike: decide hard grasps, and find the least violation.

Two tables, a row for each core that this processor runs:

- *hard ends*: grasps whose forces are planted strictly inside every limit, at the ends of what can
  be asked: slacks of 1e-4 to 1e4 times the forces, friction of .01 to 5, contacts beside one
  another, engagements down to 1e-6, alpha from 1e-4 to 1e6, forces of 1 µN to 1 kN. All can be
  held; what is not SOLVED is undecided, or wrong where it is INFEASIBLE, and every answer has to
  pass ``Solution.verify``.
- *infeasible*: infeasible grasps beside Clarabel's optima of the same cone programs: the least
  ``violation`` that a solution states, and the nearest wrench that its forces make. Where Clarabel
  itself is only "AlmostSolved" the wrench may be off, but must not be further from f than its.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from rich.progress import track
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce import _engine
from graspforce.scenarios.random import random_contacts, random_jacobian, random_models, unit

sys.path.append(str(Path(__file__).parents[1] / "tests"))
import clarabel_oracle

Solve = Callable[[gf.ForceProblem], gf.Solution]


def core_solve(module: str) -> Solve:
    """Return ``graspforce.solve`` with default settings on one of ``_engine.modules``."""
    native, settings = importlib.import_module(module).solve, gf.Settings()
    limits = (settings.tol, settings.max_steps, float("inf"))
    return lambda problem: native(
        gf.Solution, problem, problem.layout, problem.packed, None, *limits
    )


# ---- hard ends ---------------------------------------------------------------------------------


def planted(seed: int, index: int) -> gf.ForceProblem:
    """A grasp at the hard ends whose wrench is that of forces strictly inside every limit."""
    rng = np.random.default_rng([seed, index])
    n = int(rng.integers(1, rng.choice([4, 8, 16, 33]) + 1))
    models = random_models(rng, n, hard=True)
    W = gf.grasp_map(random_contacts(rng, models, hard=True))
    dims = np.array([model.dim for model in models])
    normals = np.concatenate(([0], np.cumsum(dims)[:-1]))
    c = np.concatenate([_force(rng, model) for model in models])
    scale = 10 ** rng.uniform(-6, 3)

    def slack(count: int) -> np.ndarray:
        return 10 ** rng.uniform(-4, 4, count)

    limits: dict[str, np.ndarray] = {}
    fields: dict[str, np.ndarray] = {}
    hand = rng.random() < 0.85
    if not hand or rng.random() < 0.4:
        engagement = np.ones(n)
        if rng.random() < 0.5:
            engagement = np.where(rng.random(n) < 0.6, 1.0, 10 ** rng.uniform(-5.9, 0, n))
        c = c * np.repeat(engagement, dims)
        fields["engagement"] = engagement
        limits["c_max"] = c[normals] / engagement * (1 + slack(n))
        if rng.random() < 0.3:
            limits["c_min"] = c[normals] / engagement * rng.uniform(0, 0.999, n)
    if hand:
        fields["J"] = random_jacobian(rng, dims)
        tau = fields["J"].T @ c
        size = np.abs(tau) + 0.1 * np.abs(tau).max()
        bias = rng.normal(size=len(tau)) * size * (rng.random() < 0.3)
        limits |= {
            "tau_bias": bias,
            "tau_lo": tau - size * slack(len(tau)) + bias,
            "tau_hi": tau + size * slack(len(tau)) + bias,
        }
    if rng.random() < 0.2:
        A = rng.normal(size=(2, len(c))) * (rng.random((2, len(c))) < 0.5)
        fields["A"] = A
        limits["b"] = A @ c + (np.abs(A) @ np.abs(c) + 1e-3) * slack(2)
    fields |= {name: scale * limit for name, limit in limits.items()}
    alpha = 10 ** rng.uniform(-4, 6)
    return gf.ForceProblem(W, W @ c * scale, models, alpha=alpha, **fields)


def _force(rng: np.random.Generator, model: gf.contact.ContactModel) -> np.ndarray:
    """A contact's force, inside its cone by 1e-4 of its friction or more."""
    normal = np.exp(rng.normal(0, 1.5))
    share = 1 - 10 ** rng.uniform(-4, 0)
    if isinstance(model, gf.FPC):
        return np.array([normal])
    most = [model.mu, model.mu, getattr(model, "gamma", 0)][: model.dim - 1]
    return np.append(normal, normal * share * unit(rng.normal(size=model.dim - 1)) * most)


def hard_ends(seed: int, count: int) -> Table:
    """Solve planted grasps on every core."""
    table = Table(title=f"hard ends: {count:,} grasps with planted forces, seed {seed}")
    for heading in ("core", "solved", "undecided", "wrong", "steps p50", "p99", "most"):
        table.add_column(heading, justify="left" if heading == "core" else "right")
    found: dict[str, list[tuple[gf.Status, int, bool]]] = {m: [] for m in _engine.modules}
    for index in track(range(count), "hard ends", transient=True):
        problem = planted(seed, index)
        for module, verdicts in found.items():
            solution = core_solve(module)(problem)
            verdicts.append((solution.status, solution.newton_steps, solution.verify().ok))
    for module, verdicts in found.items():
        solved = sum(status is gf.Status.SOLVED for status, _, _ in verdicts)
        wrong = sum(
            status in (gf.Status.INFEASIBLE, gf.Status.WRENCH_UNREACHABLE) or not ok
            for status, _, ok in verdicts
        )
        steps = np.percentile([steps for _, steps, _ in verdicts], [50, 99, 100])
        table.add_row(
            module, *map(str, (solved, count - solved, wrong)), *(f"{step:.0f}" for step in steps)
        )
    return table


# ---- infeasible --------------------------------------------------------------------------------


def infeasible(seed: int, count: int) -> Iterator[tuple[gf.ForceProblem, float]]:
    """Random infeasible grasps with their least violation by Clarabel."""
    rng = np.random.default_rng(seed)
    while count > 0:
        problem = clarabel_oracle.random_problem(rng)
        least = clarabel_oracle.least_violation(problem)
        if least > 1e-6:  # Clarabel is good to 1e-10
            yield problem, least
            count -= 1


def least_and_nearest(seed: int, count: int) -> Table:
    """Compare violations and nearest wrenches of every core with Clarabel's."""
    table = Table(title=f"{count:,} infeasible grasps, seed {seed}; wrenches relative to f")
    headings = ("core", "proved", "violation off", "held", "wrench off", "further", "steps mean")
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "core" else "right")
    found: dict[str, list[tuple[float, ...]]] = {m: [] for m in _engine.modules}
    for problem, least in track(infeasible(seed, count), "infeasible", total=count, transient=True):
        status, lacks = clarabel_oracle.nearest_by_clarabel(problem)
        scales = clarabel_oracle.scales_by_hand(problem)
        size = np.linalg.norm(problem.f / scales)
        for module, rows in found.items():
            solution = core_solve(module)(problem)
            ours = solution.missing / scales
            off = np.linalg.norm(ours - lacks) / size if status == "Solved" else 0.0
            held = solution.nearest
            rows.append(
                (
                    solution.status is gf.Status.INFEASIBLE and solution.verify().ok,
                    abs(solution.violation / least - 1),
                    held,
                    off if held else 0.0,
                    (np.linalg.norm(ours) - np.linalg.norm(lacks)) / size if held else 0.0,
                    solution.newton_steps,
                )
            )
    for module, rows in found.items():
        proved, stated, held, off, further, steps = np.array(rows).T
        table.add_row(
            module,
            f"{proved.sum():,.0f}",
            f"{stated.max():.1e}",
            f"{held.sum():,.0f}",
            f"{off.max():.1e}",
            f"{further.max():.1e}",
            f"{steps.mean():.1f}",
        )
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--grasps", type=int, default=10_000, help="at the hard ends")
    parser.add_argument("--infeasible", type=int, default=2_000)
    parser.add_argument("--save", type=writable, help="write the tables to this file")
    options = parser.parse_args()
    tables = [
        hard_ends(options.seed, options.grasps),
        least_and_nearest(options.seed, options.infeasible),
    ]
    show(*tables, save=options.save, width=100)


if __name__ == "__main__":
    main()
