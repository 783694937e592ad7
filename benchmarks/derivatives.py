"""Are the derivatives of answers those of the solver? Every field, against two oracles.

Random problems of 2 to 64 contacts of all models, with joints that several contacts feel, ceilings,
floors and inequalities; the same with contacts that pull and weights of cones, with internal forces
of motors, with a soft wrench and rate limits; and grasps of a real hand. By some entries of every
field, `jvp` is compared with what the optimum's equations say in extended precision
(``exact_derivatives.py``), and with differences of the solver of the fourth order, of the step that
agrees best with the next larger one; `jvp` and `vjp`, of random changes of all fields, by their
inner product.

``make derivatives`` compares 200 problems of each kind, half an hour, and fails where an
entry is off by more than 1e-6. With a looser tolerance the derivatives are as exact as the forces
that they are taken at, and the differences rough: what their forces are off by they divide by the
step.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from exact_derivatives import ExactDerivatives
from rich.progress import track
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.batch import BatchProblems, solve_rows
from graspforce.cli.process import as_command
from graspforce.contact import model_of
from graspforce.scenarios.random import geometry

# Derivatives, and differences, are as exact as the forces that they are taken at.
TIGHT = gf.Settings(tol=1e-24)
QUANTITIES = ("c", "internal_forces", "tau", "phi", "friction_margins", "torque_margins")
# Changes below so much of those in proportion to a field's are not told from rounding.
FLOOR = 1e-4
MOST = 1e-6

# ---- problems ------------------------------------------------------------------------------------


def rich_problem(seed: int) -> gf.ForceProblem:
    """Soft and hard fingers, shared joints, ceilings, floors, inequalities and torque bias."""
    rng = np.random.default_rng(seed)
    while True:
        problem, load = geometry(rng)
        problem = problem.replace(f=problem.f + 0.3 * load)
        if problem.active.all() and gf.solve(problem, TIGHT).status is gf.Status.SOLVED:
            return problem


def with_pulls_and_weights(seed: int) -> gf.ForceProblem:
    """A rich problem of which some contacts pull, and whose cones have weights."""
    rng = np.random.default_rng(seed)
    while True:
        problem = rich_problem(seed)
        pulls = rng.uniform(0.1, 2, problem.n) * (rng.random(problem.n) < 0.7)
        pulls[0] = 1.0
        pulling = [
            model_of(model.dim, model.mu, model.gamma, pull)
            for model, pull in zip(problem.models, pulls.tolist(), strict=True)
        ]
        problem = problem.replace(models=pulling, cone_weight=rng.uniform(0.3, 2, problem.n))
        if gf.solve(problem, TIGHT).status is gf.Status.SOLVED:
            return problem


def with_internal_forces(seed: int) -> gf.ForceProblem:
    """A problem whose motors pull together, on odd seeds with pulls and weights too."""
    rng = np.random.default_rng(seed)
    problem = with_pulls_and_weights(seed) if seed % 2 else rich_problem(seed)
    while not problem.layout.joints:
        seed += 1000
        problem = rich_problem(seed)
    count = int(rng.integers(1, min(3, problem.layout.joints) + 1))
    internal = rng.normal(size=(count, problem.layout.joints))
    internal *= rng.random(internal.shape) < 0.7
    internal[np.arange(count), np.arange(count)] = 1.0
    return problem.replace(internal=internal * np.abs(problem.J).max())


def soft_with_rate_limits(seed: int) -> gf.ForceProblem:
    """A rich problem some of whose wrench may be missed, near the forces of a tick before."""
    rng = np.random.default_rng(seed)
    problem = rich_problem(seed)
    last = gf.solve(problem).c
    return problem.replace(
        f_soft=rng.uniform(0.01, 0.2, 6) * (rng.random(6) < 0.5),
        c_last=last * rng.uniform(0.98, 1.02, problem.m),
        dc_max=rng.uniform(0.2, 1, problem.m) * (0.1 + np.abs(last)),
    )


# ---- differences ---------------------------------------------------------------------------------


def entries(
    problem: gf.ForceProblem, name: str, rng: np.random.Generator, most: int = 3
) -> Iterator[np.ndarray]:
    """Directions along which a field may change: single entries, at most so many."""
    value = np.asarray(getattr(problem, name))
    for index in rng.permutation(value.size)[:most]:
        direction = np.zeros(value.size)
        direction[index] = 1.0
        direction = direction.reshape(value.shape)
        now = (value * direction).sum()
        if name == "engagement" and now == 1:
            continue  # no room above
        if name in ("J", "A") and not now:
            continue  # would tie contacts together
        if name in ("c_min", "pull", "f_soft") and not now:
            continue  # no room below
        if name in ("mu", "gamma") and problem.layout.dims[int(direction.argmax())] == 1:
            continue
        yield direction


def size_of(problem: gf.ForceProblem, name: str) -> float:
    """What a field's numbers are large or small beside."""
    if name.startswith("tau"):
        return float((problem.tau_hi - problem.tau_lo).min())
    return max(float(np.abs(getattr(problem, name)).max()), 1e-2)


def differentiable(problem: gf.ForceProblem) -> list[str]:
    """Fields by which the problem has derivatives; of f and W with dependent rows only some."""
    full_rank = np.linalg.matrix_rank(problem.W) == len(problem.W)
    names = []
    for name, slot in problem.layout.slots.items():
        given = slot.start < slot.stop and (name != "engagement" or problem.layout.ceilings)
        if not given or (name in ("f", "W") and not full_rank):
            continue
        if name not in ("mu", "gamma") or set(problem.layout.dims) != {1}:
            names.append(name)
    return names


def differences(
    problem: gf.ForceProblem, name: str, direction: np.ndarray, settings: gf.Settings = TIGHT
) -> list[np.ndarray]:
    """The change of every quantity: of the step that agrees best with the next larger one.

    A step that is right for Phi may be too small for c, whose changes are then all rounding. Such
    may agree by chance, so that no step counts as better than rounding lets it be.
    """
    steps = size_of(problem, name) * 10.0 ** -(np.arange(3, 15) / 2)
    places = np.multiply.outer(steps, [1.0, -1.0, 2.0, -2.0])
    slot = problem.layout.slots[name]
    packed = np.tile(problem.packed, (places.size, 1))
    packed[:, slot.start : slot.stop] += np.multiply.outer(places.ravel(), direction.ravel())
    batch = solve_rows(BatchProblems.stacked(packed, problem.layout), settings=settings, threads=1)
    usable = batch.solved.reshape(places.shape).all(axis=1)
    found = []
    for quantity in QUANTITIES:
        values = np.asarray(getattr(batch, quantity)).reshape(*places.shape, -1)[usable]
        h = steps[usable, None]
        near, far = ((values[:, i] - values[:, i + 1]) / ((i + 2) * h) for i in (0, 2))
        by_step = (4 * near - far) / 3
        moves = np.abs(np.diff(by_step, axis=0)).max(axis=1, initial=0)
        rounding = np.finfo(float).eps * np.abs(values).max(initial=0) / h[1:, 0]
        found.append(by_step[1 + int((moves + rounding).argmin())])
    return found


def error_of(
    found: Sequence[np.ndarray], expected: Sequence[np.ndarray], beside: Sequence[float]
) -> float:
    """The largest error of any quantity, by its largest change and what that stands beside."""
    return max(
        float(np.abs(np.ravel(a) - b).max(initial=0) / (np.abs(b).max(initial=0) + scale))
        for a, b, scale in zip(found, expected, beside, strict=True)
    )


class Errors(NamedTuple):
    """Of the derivatives by one entry of a field."""

    field: str
    exact: float
    differences: float


def errors(
    problem: gf.ForceProblem,
    rng: np.random.Generator,
    most: int = 3,
    settings: gf.Settings = TIGHT,
) -> Iterator[Errors]:
    """Yield the errors of the derivatives by some entries of each field."""
    answer = gf.solve(problem, settings)
    derivatives, exact = gf.sensitivity(answer), ExactDerivatives(answer)
    sizes = [1 + np.abs(getattr(answer, each)).max(initial=0) for each in QUANTITIES]
    # A torque in the middle between its limits has no nearer one: its margin has a kink there.
    apart = np.abs(problem.tau_hi + problem.tau_lo - 2 * answer.tau)
    middle = apart < 1e-6 * (problem.tau_hi - problem.tau_lo)
    for name in differentiable(problem):
        for direction in entries(problem, name, rng, most):
            beside = [FLOOR * size / size_of(problem, name) for size in sizes]
            # What the cones bear is c and the pull; where c itself hardly changes, they both do.
            shares = {"pull": problem.engagement, "engagement": problem.pull}.get(name, [])
            pull = float(np.abs(shares * direction).max(initial=0)) if len(shares) else 0.0
            beside = [each + pull for each in beside]
            given = derivatives.jvp(of=QUANTITIES, **{name: direction})
            found = []
            for expected in (
                exact.change(name, direction, QUANTITIES),
                differences(problem, name, direction, settings),
            ):
                margins = np.where(middle, expected[-1], given[-1])
                found.append(error_of([*given[:-1], margins], expected, beside))
            yield Errors(name, *found)


def adjoint_error(problem: gf.ForceProblem, rng: np.random.Generator) -> float:
    """How far the inner products by `jvp` and by `vjp` are apart, by the sum of their terms."""
    derivatives = gf.sensitivity(gf.solve(problem, TIGHT))
    slots = problem.layout.slots
    changes = {name: rng.normal(size=slots[name].shape) for name in differentiable(problem)}
    forward = derivatives.jvp(of=QUANTITIES, **changes)
    weights = [rng.normal(size=np.shape(each)) for each in forward]
    back = derivatives.vjp(**dict(zip(QUANTITIES, weights, strict=True)))
    left = [float(np.sum(w * each)) for w, each in zip(weights, forward, strict=True)]
    right = [float(np.sum(back[name] * change)) for name, change in changes.items()]
    return abs(sum(left) - sum(right)) / (sum(map(abs, left)) + sum(map(abs, right)))


# ---- the sweep -----------------------------------------------------------------------------------

KINDS: dict[str, Callable[[int], gf.ForceProblem]] = {
    "all models, shared joints": rich_problem,
    "pulls, weights of cones": with_pulls_and_weights,
    "internal forces": with_internal_forces,
    "soft wrench, rate limits": soft_with_rate_limits,
}


def measure(
    problems: dict[str, list[gf.ForceProblem]], most: int, settings: gf.Settings
) -> tuple[Table, float]:
    """Return the table of a sweep, and its largest error."""
    by_field: dict[str, list[Errors]] = defaultdict(list)
    adjoint, of_kind, number = 0.0, defaultdict(list), 0
    for kind, each in problems.items():
        for problem in track(each, kind):
            rng = np.random.default_rng(number)
            number += 1
            for found in errors(problem, rng, most, settings):
                by_field[found.field].append(found)
                of_kind[kind].append(found)
            adjoint = max(adjoint, adjoint_error(problem, rng))
    table = Table(title=f"errors of derivatives, tol {settings.tol:g}")
    for heading in (
        "by", "entries", "error: median", "99 of 100", "largest", "off differences: 99", "largest"
    ):  # fmt: skip
        table.add_column(heading, justify="right" if heading != "by" else "left")
    worst = 0.0
    for name, each in by_field.items():
        exact, off = [e.exact for e in each], [e.differences for e in each]
        worst = max(worst, *exact, *off)
        row = (*np.quantile(exact, (0.5, 0.99, 1)), *np.quantile(off, (0.99, 1)))
        table.add_row(name, f"{len(each):,}", *(f"{value:.1e}" for value in row))
    table.add_section()
    for kind, each in of_kind.items():
        exact, off = max(e.exact for e in each), max(e.differences for e in each)
        words = f"{kind}: {len(problems[kind])} problems"
        table.add_row(words, f"{len(each):,}", "", "", f"{exact:.1e}", "", f"{off:.1e}")
    table.add_row("jvp and vjp, inner product", f"{number:,}", "", "", f"{adjoint:.1e}")
    return table, worst


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--problems", type=int, default=200, help="of each kind")
    parser.add_argument("--entries", type=int, default=3, help="of each field")
    parser.add_argument("--tol", type=float, nargs="+", default=[TIGHT.tol], help="of the solver")
    parser.add_argument("--grasps", type=Path, help="a file of grasps of a real hand")
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    problems = {
        kind: [make(seed) for seed in track(range(options.problems), f"made: {kind}")]
        for kind, make in KINDS.items()
    }
    if options.grasps is not None:
        each = [grasp.problem for grasp in gf.files.read(options.grasps)]
        problems["a real hand"] = [p for p in each if gf.solve(p).status is gf.Status.SOLVED]
    settings = [gf.Settings(tol=tol) for tol in options.tol]
    found = [measure(problems, options.entries, each) for each in settings]
    show(*(table for table, _ in found), save=options.save, width=116)
    return int(found[0][1] > MOST)


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
