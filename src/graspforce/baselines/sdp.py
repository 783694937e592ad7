"""Semidefinite program with the friction-cone matrix P: Buss, Hashimoto and Moore [4], [12].

    minimise  Σ normal forces − barrier · ln det P(c)   with W c = f, P(c) ⪰ 0

The WBF paper says of [4] that its objective is a linear sum of the contact wrenches plus a
barrier that grows without bound as P turns singular, and that the weight between them trades
effort against slip; Han, Trinkle and Li [12] cast it as linear matrix inequalities. Left open, and
chosen here: the linear sum is that of the normal forces, in newtons; the barrier is −ln det, which
gradient flow and Dikin recursion share; P holds the torque limits and every other linear limit
beside the friction cones (``_lmi``). Without barrier this is the SDP form of a second-order cone
program, and its optimum lies on the boundary.

Clarabel solves it with semidefinite cones: P(c) ⪰ 0 itself without barrier. With barrier, for each
block, a lower triangular L with ⎡P, L; L.T, diag L⎤ ⪰ 0, which makes Σ ln L_ii at most ln det P and
equal to it at the best L; the logarithms are exponential cones.

Schlegl et al. [11] release and regrip fingers by this SDP: engagement and c_max of the problem
are ceilings in P, and a removed contact has no block in it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_number
from graspforce.baselines._active import Active, as_steps, run, solution_from_gradient
from graspforce.baselines._conic import Pattern, diagonal
from graspforce.baselines._lmi import Lmi, dikin_direction, half_square_decrement, line_search
from graspforce.baselines._start import infeasible_or
from graspforce.errors import InvalidInputError, MissingExtraError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# Clarabel's tolerances: the full one, and the reduced one of AlmostSolved.
PRECISION, REDUCED_PRECISION = 1e-10, 1e-8
# The objective / barrier of an answer with barrier is at most this much above its minimum.
SUBOPTIMALITY = 1e-6
# A suboptimality up to which Newton steps refine Clarabel's answer, and the most of them.
REFINABLE, MAX_REFINEMENTS = 1.0, 4


def solve(
    problem: ForceProblem,
    *,
    barrier: float = 0.1,
    objective: Literal["normals", "norm"] = "normals",
    max_steps: int = 200,
) -> Solution:
    """Minimise effort − barrier·ln det P(c) with W c = f and P(c) ⪰ 0 by Clarabel.

    Args:
        problem: what to solve; its alpha has no part in this objective.
        barrier: weight of −ln det P, 0 or more [N, or N² with "norm"]: the more, the firmer.
            Below some 1e-7 of the wrench Clarabel cannot tell it from none, and the status is
            STALLED.
        objective: the effort, "normals" for Σ normal forces or "norm" for ‖c‖²/2.
        max_steps: the most iterations of Clarabel.

    Returns:
        The forces; ``newton_steps`` counts Clarabel's iterations, and the last Newton steps where
        it ended short of the precision. INFEASIBLE comes with a
        certificate that ``_start`` found, checked in NumPy.

    Raises:
        InvalidInputError: an option out of range.
        MissingExtraError: Clarabel or SciPy is not installed.
    """
    weight = as_number(barrier, "barrier")
    if weight < 0:
        raise InvalidInputError(f"barrier: got {weight:g}, expected 0 or more")
    if objective not in ("normals", "norm"):
        raise InvalidInputError(f"objective: got {objective!r}, expected 'normals' or 'norm'")
    most = as_steps(max_steps)
    clarabel, linalg = _libraries()

    def method(view: Active) -> Solution:
        return _solve(view, weight, objective, most, clarabel, linalg)

    return run(problem, method)


def _libraries() -> tuple[Any, Any]:
    """Import Clarabel and SciPy's linear algebra, both of which come without types."""
    try:
        import clarabel  # pyright: ignore[reportMissingImports, reportMissingTypeStubs]
    except ImportError:
        raise MissingExtraError("the semidefinite program", "clarabel", "baselines") from None
    try:
        from scipy import linalg  # pyright: ignore[reportMissingImports, reportMissingTypeStubs]
    except ImportError:
        raise MissingExtraError("the semidefinite program", "scipy", "baselines") from None
    return clarabel, linalg


@dataclass(frozen=True, slots=True)
class _Part:
    """One block of P in Clarabel's terms: s = constant + of_x x + of_own own lies in its cones.

    Attributes:
        of_x: shape (rows, q).
        of_own: the columns of the variables that only this block has, shape (rows, own).
        constant: shape (rows,).
        cones: Clarabel's, in the order of the rows.
        log_det_weights: of the own variables, whose weighted sum is ln det of the block, shape
            (own,).
    """

    of_x: Array
    of_own: Array
    constant: Array
    cones: list[Any]
    log_det_weights: Array


def _positive(F0: Array, F: Array, clarabel: Any) -> _Part:
    """F0 + Σ_j x_j F_j ⪰ 0, shapes (p, p) and (q, p, p)."""
    constant = _entries(F0)
    cones = [clarabel.PSDTriangleConeT(len(F0))]
    return _Part(_entries(F).T, np.zeros((len(constant), 0)), constant, cones, np.zeros(0))


def _log_det(F0: Array, F: Array, clarabel: Any) -> _Part:
    """As :func:`_positive`, with further variables whose last p sum up to ln det."""
    p = len(F0)
    if p == 1:
        diagonal_of_x, diagonal_of_own, diagonal = F[:, 0], np.zeros((1, 0)), F0[0]
        matrix = _Part(np.zeros((0, len(F))), np.zeros((0, 0)), np.zeros(0), [], np.zeros(0))
    else:
        # The own variables are the entries of L, row by row.
        i, j = np.tril_indices(p)
        own = np.zeros((len(i), 2 * p, 2 * p))
        entry = np.arange(len(i))
        own[entry, i, p + j] = own[entry, p + j, i] = 1.0
        on_diagonal = np.flatnonzero(i == j)
        own[on_diagonal, p + np.arange(p), p + np.arange(p)] = 1.0
        matrix = _positive(_corner(F0), _corner(F), clarabel)
        matrix = replace(matrix, of_own=_entries(own).T)
        diagonal_of_x, diagonal = np.zeros((len(F), p)), np.zeros(p)
        diagonal_of_own = np.eye(len(i))[on_diagonal]
    # t_k ≤ ln of the diagonal's entry k: (t_k, 1, entry) in the exponential cone.
    rows, known = 3 * p, diagonal_of_own.shape[1]
    of_x, of_own = np.zeros((rows, len(F))), np.zeros((rows, known + p))
    of_x[2::3], of_own[2::3, :known], of_own[0::3, known:] = (
        diagonal_of_x.T, diagonal_of_own, np.eye(p),
    )  # fmt: skip
    constant = np.column_stack((np.zeros(p), np.ones(p), diagonal)).ravel()
    return _Part(
        np.vstack((matrix.of_x, of_x)),
        np.vstack((np.pad(matrix.of_own, ((0, 0), (0, p))), of_own)),
        np.concatenate((matrix.constant, constant)),
        matrix.cones + [clarabel.ExponentialConeT()] * p,
        np.repeat([0.0, 1.0], [known, p]),
    )


def _corner(F: Array) -> Array:
    """Put matrices (…, p, p) into the upper left corner of zeros (…, 2p, 2p)."""
    p = F.shape[-1]
    return np.pad(F, [(0, 0)] * (F.ndim - 2) + [(0, p), (0, p)])


def _entries(M: Array) -> Array:
    """Return Clarabel's vector of symmetric matrices, (…, p, p) to (…, p(p+1)/2).

    The upper triangle column by column, off-diagonal entries times √2.
    """
    i, j = np.tril_indices(M.shape[-1])
    return M[..., i, j] * np.where(i == j, 1.0, np.sqrt(2))


def _matrices(entries: Array, p: int) -> Array:
    """Undo :func:`_entries`, shapes (…, p(p+1)/2) to (…, p, p)."""
    i, j = np.tril_indices(p)
    M = np.zeros((*entries.shape[:-1], p, p))
    M[..., i, j] = M[..., j, i] = entries / np.where(i == j, 1.0, np.sqrt(2))
    return M


def _unit(view: Active, barrier: float) -> float:
    """Return the size that the forces will have [N]; Clarabel's tolerances are absolute.

    They balance the wrench and seek the barrier's size, as far as the limits let them.
    """
    wanted = max(float(np.abs(view.problem.f).max()), barrier) or 1.0
    _, cones = view.inner.violation_scales()
    return min(wanted, float(cones.max())) or wanted


def _solve(
    view: Active, weight: float, objective: str, max_steps: int, clarabel: Any, linalg: Any
) -> Solution:
    normals = objective == "normals"
    unit = _unit(view, weight if normals else weight**0.5)
    weight /= unit if normals else unit**2
    c_p, N = equations.particular_and_nullspace(view.W, view.problem.f / unit)
    in_c = Lmi.of(replace(view, b=view.b / unit))
    in_x = in_c.substitute(c_p, N)
    block = _log_det if weight else _positive
    parts = [
        block(F0, F, clarabel)
        for of_size in in_x.blocks
        for F0, F in zip(of_size.F0, of_size.F.swapaxes(0, 1), strict=True)
    ]
    of_own = linalg.block_diag(*[part.of_own for part in parts])
    A = -np.hstack((np.vstack([part.of_x for part in parts]), of_own))
    own = of_own.shape[1]
    linear = view.normals if normals else c_p
    objective_scale = max(1.0, weight)
    q = (
        np.concatenate((N.T @ linear, *[-weight * part.log_det_weights for part in parts]))
        / objective_scale
    )
    square = 0.0 if normals else 1 / objective_scale
    P = np.repeat([square, 0.0], [len(N.T), own])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.max_iter = max_steps
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = PRECISION
    settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = REDUCED_PRECISION
    settings.reduced_tol_feas = REDUCED_PRECISION
    # The blocks are too small to gain by it, and Clarabel 0.11 panics on some of them.
    settings.chordal_decomposition_enable = False
    constant = np.concatenate([part.constant for part in parts])
    cones = [cone for part in parts for cone in part.cones]
    result = clarabel.DefaultSolver(
        diagonal(P), q, Pattern(A != 0).sparse(A), constant, cones, settings
    ).solve()

    status_text = str(result.status)
    steps = int(result.iterations)
    x = np.array(result.x)[: len(N.T)]
    if status_text == "PrimalInfeasible":
        return infeasible_or(
            view,
            solution_from_gradient(view, Status.STALLED, steps, unit * c_p, np.zeros(len(c_p))),
        )
    failed = Status.MAX_STEPS if status_text == "MaxIterations" else Status.STALLED
    solved = status_text in ("Solved", "AlmostSolved")
    if weight:
        # The barrier's Hessian is at hand, so optimality is checked at the forces: Clarabel's
        # exponential cones sometimes stop short of the tolerance, which a Newton step or two of
        # the same objective correct.
        for _ in range(MAX_REFINEMENTS + 1):
            point = in_x.at(x)
            slope = N.T @ (view.normals if normals else c_p + N @ x) / weight + point.gradient
            suboptimality = half_square_decrement(point, slope) if point.inside else np.inf
            solved = bool(suboptimality <= SUBOPTIMALITY)
            if solved or suboptimality > REFINABLE or not normals:
                break
            d = dikin_direction(point, slope)
            fall = float(view.normals @ (N @ d)) / weight
            x = x + line_search(point.spectrum(d), fall, 1.0) * d
            steps += 1
    c = c_p + N @ x
    effort = view.normals if normals else c
    if weight:
        gradient = effort + weight * in_c.at(c).gradient
    else:
        gradient = effort - _cone_forces(in_c, np.array(result.z))
    c, gradient = unit * c, gradient if normals else unit * gradient
    if solved:
        return solution_from_gradient(view, Status.SOLVED, steps, c, gradient)
    return infeasible_or(view, solution_from_gradient(view, failed, steps, c, gradient))


def _cone_forces(in_c: Lmi, duals: Array) -> Array:
    """Return tr(Z F_k) for every force component, shape (m,), from Clarabel's dual vector."""
    total = np.zeros(len(in_c.blocks[0].F))
    for part in in_c.blocks:
        g, p = part.F0.shape[:2]
        of_size, duals = np.split(duals, [g * p * (p + 1) // 2])
        Z = _matrices(of_size.reshape(g, -1), p)
        total += np.einsum("abc,jacb->j", Z, part.F)
    return total
