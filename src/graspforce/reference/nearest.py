"""The forces for the nearest wrench where a grasp cannot make the wanted one, in NumPy.

Both searches measure a missing wrench by :meth:`graspforce.ForceProblem.wrench_scales`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from graspforce import equations
from graspforce._util.arrays import Array
from graspforce.equations import backtrack, force_size, least_squares, strictly_inside
from graspforce.problem import ForceProblem
from graspforce.reference.phase_one import PhaseOne, find_inside

# The barriers may cost this share of the squared distance, or of the squared wrench.
NEAREST, NEAREST_FLOOR = 1e-11, 1e-16
# The share where rounding ends the search that still counts as found.
NEARLY = 1e-8
# Relative slack of forces that are well inside, where there is room for it.
WELL_INSIDE = 0.1
# Share of the way there that forces on the boundary are moved, and the largest for those on the
# edge.
INWARD, MOST_INWARD = 1e-11, 1e-7
# Share of the wrenches that add up to f to which they have to make it after that.
WRENCH_TOLERANCE = 1e-9
# Decrement with which a minimum counts as reached.
CENTERED = 0.1


class Nearest(NamedTuple):
    """Where the search ended.

    Attributes:
        c: the forces, the internal ones behind those of the contacts, shape (m + r,).
        steps: Newton steps taken.
        found: whether they are strictly inside every cone and limit, and no others inside make a
            wrench nearer to f.
    """

    c: Array
    steps: int
    found: bool = False


def project_wrench(problem: ForceProblem) -> Array:
    """Return the wrench nearest to f in the range of W, its soft rows as they are, shape (k,)."""
    exact, scales = problem.exact, problem.wrench_scales()
    W, f = problem.W[exact] / scales[exact, None], problem.f[exact] / scales[exact]
    projected = problem.f.copy()
    projected[exact] = scales[exact] * (W @ np.linalg.lstsq(W, f, rcond=1e-10)[0])
    return projected


def move_inward(problem: ForceProblem, edge: Array, max_steps: int) -> Nearest:
    """Move forces on the edge inside by more than rounding, where f does not suffer by it.

    Args:
        problem: every contact in the grasp.
        edge: the forces, shape (m + r,), which violate no limit by more than 1e-9 of its scale.
        max_steps: the most Newton steps.
    """
    first = _find_any(problem, max_steps)
    scales = problem.violation_scales()
    outside, inside = (
        float(equations.relative_violation(c, problem.barriers, scales)) for c in (edge, first.c)
    )
    outside = max(0.0, outside)
    if np.abs(edge).max() < np.finfo(float).eps * force_size(problem.barriers, problem.f):
        edge = np.zeros(len(edge))  # what is left of forces that shrink to nothing
    if inside >= 0:
        return Nearest(edge, first.steps)
    share = INWARD + 2 * outside / (outside - inside)
    c = edge + share * (first.c - edge)
    error = equations.relative_wrench_error(c, *problem.equalities)
    if share > MOST_INWARD or error > WRENCH_TOLERANCE:
        return Nearest(edge, first.steps)
    return Nearest(c, first.steps, found=True)


def _find_any(problem: ForceProblem, max_steps: int) -> PhaseOne:
    """Forces well inside every cone and limit, whatever wrench they make."""
    free = problem.replace(f_soft=np.ones(len(problem.f)))
    forces = problem.m + problem.layout.internals
    return find_inside(free, np.eye(forces), np.zeros(forces), max_steps, WELL_INSIDE)


def find_nearest(problem: ForceProblem, known: Array, max_steps: int) -> Nearest:
    """Minimise ½‖(W c − f)/scale‖² inside the cones and limits, by barriers that fade away.

    ½‖(W c − f)/scale‖² + t·Phi(c) is minimised for smaller and smaller t, each time from the last
    minimum; the rows of W c = f that are soft have no say.

    Args:
        problem: every contact in the grasp.
        known: forces to return where none strictly inside are found, shape (m + r,).
        max_steps: the most Newton steps.
    """
    exact, scales = problem.exact, problem.wrench_scales()
    W, f, scales = problem.equalities[0][exact], problem.f[exact], scales[exact]
    size = float(np.abs(f / scales).max(initial=0)) or float(force_size(problem.barriers, f))
    softness = scales * size
    first = _find_any(problem, max_steps)
    c, steps = first.c, first.steps
    if not strictly_inside(c, problem.barriers):
        return Nearest(known, steps)
    S, lack = W / softness[:, None], f / softness
    barriers = problem.barriers._replace(S=S, t=lack)
    terms = barriers.cones.weigh(np.full(problem.n, 2.0), 0).sum() + problem.alpha * len(barriers.b)
    origin, everywhere = np.zeros(len(c)), np.eye(len(c))
    share = 1.0
    while steps < max_steps:
        faded = barriers._replace(S=S / math.sqrt(share), t=lack / math.sqrt(share))
        # The Hessian G.T G itself holds squares that differ by more than double precision does.
        G, gradient = equations.factored_derivatives(c, faded)
        columns = np.linalg.norm(G, axis=0)
        d = -least_squares(G / columns, gradient) / columns
        steps += 1
        decrement = float(np.linalg.norm(G @ d))
        gamma = backtrack(c, d, -barriers.unit * decrement**2, origin, everywhere, faded)
        c = c + gamma * d
        if gamma == 0 or decrement < CENTERED:
            cost = float(np.square(barriers.lack(c)).sum()) / 2
            near = share * terms < max(NEAREST * cost, NEAREST_FLOOR)
            if near or gamma == 0:
                c = c + INWARD * (first.c - c)
                return Nearest(c, steps, found=near or share * terms < NEARLY * cost)
            share /= 10
    return Nearest(c, steps)
