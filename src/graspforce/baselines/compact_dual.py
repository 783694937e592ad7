"""Compact-dual linear program: Cheng and Orin [3].

    minimise  Σ normal forces   with W c = f, A c ≤ b and linearised friction cones

The equations are eliminated first: Gauss–Jordan elimination turns W c = f into a reduced echelon
form, in which the basic components of c follow from the others, x ∈ R^p with p = m − rank W (6 for
the paper's four fingers). What remains is min g·x with G x ≤ h, far more rows than unknowns, and
its dual, min h·y with G.T y = −g and y ≥ 0, has only p equations: a simplex step on it factorises
one p×p matrix, however many facets and limits there are. The simplex multipliers are x.

The WBF paper says of [3] only that it solves linear programs like that of [2] by a compact dual
method; the elimination by the echelon form and the dual are in the abstract of [3]. Chosen here:
the sum of normal forces as the objective, which is also the linear part of the SDP methods;
cones with ``facets`` facets inside the true cone, so that every answer holds on it, or around it;
two phases, in which the most negative reduced cost enters and the lexicographic rule decides which
variable leaves, because most of the dual's vertices are degenerate.

A linear program sits on a vertex: some margins are zero to rounding, and the forces jump when
the vertex changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.baselines._active import Active, as_steps, run, solution_from_gradient
from graspforce.baselines._pyramids import Cones, Pyramids
from graspforce.baselines._start import infeasible_or
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# A reduced cost, a pivot or an infeasibility below this is zero; rows have length 1.
ZERO = 1e-10


def solve(
    problem: ForceProblem,
    *,
    facets: int = 8,
    cones: Cones = "inner",
    max_steps: int = 1000,
) -> Solution:
    """Minimise Σ normal forces with W c = f, A c ≤ b and facetted cones by the compact dual.

    Args:
        problem: what to solve; its alpha has no part in this objective.
        facets: of a cone with two tangents, even, 4 or more (``_pyramids``).
        cones: "inner" for pyramids inscribed in the true cones, "outer" for circumscribed ones,
            whose answers leave the true cones.
        max_steps: the most pivots.

    Returns:
        The forces; ``newton_steps`` counts the pivots. Where the linear program has no solution
        the status is INFEASIBLE if the true cones have none either, with its proof, else STALLED:
        the facets are too few.

    Raises:
        InvalidInputError: an option out of range.
    """
    pyramids = Pyramids.of(facets, cones)
    most = as_steps(max_steps)
    return run(problem, lambda view: _solve(view, pyramids, most))


def _solve(view: Active, pyramids: Pyramids, max_steps: int) -> Solution:
    rows = np.vstack((view.A, pyramids.rows(view)))
    bounds = np.concatenate((view.b, np.zeros(len(rows) - len(view.b))))
    c_p, N = eliminate(view.W, view.problem.f)
    G, h, g = rows @ N, bounds - rows @ c_p, N.T @ view.normals
    # Rows that are zero on the null space are fixed by the wrench; the others get length 1.
    length = np.linalg.norm(G, axis=1)
    fixed = length <= ZERO * np.linalg.norm(rows, axis=1)
    open_rows = np.flatnonzero(~fixed)
    dual = simplex(
        G[open_rows].T / length[open_rows], h[open_rows] / length[open_rows], -g, max_steps
    )
    c = c_p + N @ dual.multipliers
    y = np.zeros(len(rows))
    y[open_rows[dual.basis]] = dual.values / length[open_rows[dual.basis]]
    slack = 1e-9 * (np.abs(bounds) + np.abs(rows) @ np.abs(c_p))
    unsettled = dual.status not in (Status.SOLVED, Status.MAX_STEPS)
    if unsettled or (h[fixed] < -slack[fixed]).any():
        return infeasible_or(
            view, solution_from_gradient(view, Status.STALLED, dual.pivots, c, np.zeros(len(c)))
        )
    return solution_from_gradient(view, dual.status, dual.pivots, c, view.normals + rows.T @ y)


def eliminate(W: Array, f: Array) -> tuple[Array, Array]:
    """Solve W c = f by Gauss–Jordan elimination with full pivoting.

    Args:
        W: any rank, shape (k, m).
        f: in its range, shape (k,).

    Returns:
        c_p, shape (m,), and N, shape (m, p), so that c_p + N x is every solution; x are the
        components of c that no pivot fell on.
    """
    length = np.linalg.norm(W, axis=1)
    length[length == 0] = 1.0
    T = np.column_stack((W, f)) / length[:, None]
    m = len(W.T)
    basic: list[int] = []
    for row in range(min(W.shape)):
        size = np.abs(T[row:, :m])
        pivot_row, column = divmod(int(size.argmax()), m)
        if size[pivot_row, column] <= ZERO:
            break
        T[[row, row + pivot_row]] = T[[row + pivot_row, row]]
        T[row] /= T[row, column]
        others = np.arange(len(T)) != row
        T[others] -= np.outer(T[others, column], T[row])
        basic.append(column)
    free = np.setdiff1d(np.arange(m), basic)
    c_p, N = np.zeros(m), np.zeros((m, len(free)))
    c_p[basic] = T[: len(basic), m]
    N[basic] = -T[: len(basic)][:, free]
    N[free, np.arange(len(free))] = 1.0
    return c_p, N


@dataclass(frozen=True, slots=True)
class SimplexResult:
    """Where the simplex method ended: a vertex, with its multipliers.

    Attributes:
        status: SOLVED, UNBOUNDED, INFEASIBLE or MAX_STEPS.
        basis: columns of A in the basis.
        values: of the variables in the basis.
        multipliers: pi with pi·A_j = h_j for the columns in the basis, shape (p,).
        pivots: taken in both phases.
    """

    status: Status
    basis: NDArray[np.int64]
    values: Array
    multipliers: Array
    pivots: int


def simplex(A: Array, h: Array, target: Array, max_steps: int) -> SimplexResult:
    """Minimise h·y with A y = target and y ≥ 0 by the revised simplex method, two phases.

    Args:
        A: shape (p, v), of full row rank, its columns of length 1.
        h: shape (v,).
        target: shape (p,).
        max_steps: the most pivots.
    """
    p, v = A.shape
    signs = np.where(target < 0, -1.0, 1.0)
    columns = np.hstack((A, np.diag(signs)))  # an artificial variable a row
    basis = np.arange(v, v + p, dtype=np.int64)
    pivots = 0
    for phase in (1, 2):
        costs = np.concatenate((np.zeros(v), np.ones(p)) if phase == 1 else (h, np.zeros(p)))
        while True:
            B = columns[:, basis]
            values = solve_square(B, target)
            multipliers = solve_square(B.T, costs[basis])
            reduced = costs[:v] - multipliers @ A
            entering = np.flatnonzero(reduced < -ZERO * (1 + np.abs(multipliers).max(initial=0.0)))
            if not len(entering):
                status = Status.SOLVED
                break
            if pivots == max_steps:
                status = Status.MAX_STEPS
                break
            j = int(entering[np.argmin(reduced[entering])])
            step = solve_square(B, columns[:, j])
            # In phase 2 an artificial variable, zero by then, may not grow either.
            blocking = np.flatnonzero(
                (step > ZERO) | ((basis >= v) & (np.abs(step) > ZERO) & (phase == 2))
            )
            if not len(blocking):
                status = Status.UNBOUNDED
                break
            order = np.column_stack((values, solve_square(B, columns[:, v:])))
            ratios = order[blocking] / np.abs(step[blocking])[:, None]
            basis[blocking[lexicographic_least(ratios)]] = j
            pivots += 1
        if status is not Status.SOLVED:
            break
        if phase == 1 and costs[basis] @ values > 1e-9 * (1 + np.abs(target).sum()):
            status = Status.INFEASIBLE
            break
    inside = basis < v
    return SimplexResult(status, basis[inside], values[inside], multipliers, pivots)


def solve_square(B: Array, right: Array) -> Array:
    """Return B⁻¹ right."""
    return np.asarray(np.linalg.solve(B, right), dtype=np.float64)


def lexicographic_least(rows: Array) -> int:
    """Return the index of the row that is least in its first entry; ties go to the next one."""
    left = np.arange(len(rows))
    for column in rows.T:
        if len(left) == 1:
            break
        left = left[column[left] <= column[left].min() + ZERO]
    return int(left[0])
