"""Floating-point operations of one step of each method, by formula.

The solvers whose iterations factorise sparse matrices (HiGHS, Clarabel with second-order and
exponential cones) have none here: what a step costs them is decided by pattern and fill. For
these ``benchmarks/instructions.py`` counts what the machine executes, as for all the others.

A multiplication and an addition are one each, a division or a square root one. Symmetry is used
where the code uses it. n contacts of d components, m = Σ d; v linear limits; k rows of W;
q = m − rank W null-space coordinates.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from graspforce.problem import ForceProblem

# The paper's own figures, Section IV-B.3, for its four fingers.
PAPER_WBF_STEP = 12e3
PAPER_SDP_STEP = 24e3
PAPER_SDP_STEPS = 5
PAPER_SDP_SOLVE = 120e3
PAPER_FACTOR = 10.0


def _sizes(problem: ForceProblem) -> tuple[list[int], int, int, int, int]:
    dims = [dim for dim, here in zip(problem.layout.dims, problem.active, strict=True) if here]
    kept = np.repeat(problem.active, problem.layout.dims)
    rank = int(np.linalg.matrix_rank(problem.W[:, kept])) if any(kept) else 0
    m, v = sum(dims), int(problem.counted_limits().sum())
    return dims, m, v, len(problem.f), m - rank


def wbf(problem: ForceProblem) -> float:
    """The block step of the native core, for contacts that share no joint.

    Per contact: the cone's gradient and Hessian (4 d²), each of its own limits (value and
    gradient 4 d, Hessian d (d + 1)), the factor of the d×d block (d³/3), its product with W.T
    (2 d² k), its share of the k×k matrix (d k (k + 1)), residual and back-substitution
    (4 d k + 4 d²); then one Cholesky factorisation (k³/3 + 2 k²). Limits are dealt evenly to the
    contacts, and the two limits of a joint share their row.
    """
    dims, _, v, k, _ = _sizes(problem)
    rows = v / 2 / max(1, len(dims))
    each = [
        8 * d * d + rows * (4 * d + d * (d + 1) + 4) + d**3 / 3
        + 2 * d * d * k + d * k * (k + 1) + 4 * d * k
        for d in dims
    ]  # fmt: skip
    return sum(each) + k**3 / 3 + 2 * k * k


def wbf_dense(problem: ForceProblem) -> float:
    """The paper's dense reduced step, Eq. (19) and (21), without use of symmetry.

    Slacks and gradient (4 v m), A.T diag(d)² A (v m + 2 v m²), cones (4 d² each), N.T H N
    (2 m² q + 2 m q²), N.T gradient (2 m q), elimination (2 q³/3 + 2 q²), back to c (2 m q).
    """
    dims, m, v, _, q = _sizes(problem)
    cones = sum(4 * d * d for d in dims)
    reduced = 2 * m * m * q + 2 * m * q * q + 4 * m * q
    return 5 * v * m + 2 * v * m * m + cones + reduced + 2 * q**3 / 3 + 2 * q * q


def sdp(problem: ForceProblem) -> float:
    """The paper's rule for an SDP solver: p⁶/4 for each matrix inequality of p rows.

    As the paper counts [12]: one inequality with p = d a contact, and two with p = k for the
    wrench and the torques. It calls this a fraction of an iteration.
    """
    dims, _, _, k, _ = _sizes(problem)
    return sum(d**6 / 4 for d in dims) + 2 * k**6 / 4


def dikin(problem: ForceProblem) -> float:
    """A Dikin step: the flow's step, and the metric.

    Per block of p rows (d of a contact, 1 a limit) P^(−1/2) F_j P^(−1/2) for q directions (4 p³
    each), then the QR factorisation of all of them (2 q² Σ p²) instead of the flow's product
    (2 q²).
    """
    dims, _, v, _, q = _sizes(problem)
    cubes, squares = sum(d**3 for d in dims) + v, sum(d * d for d in dims) + v
    return gradient_flow(problem) + 4 * q * cubes + 2 * q * q * squares - 2 * q * q


def gradient_flow(problem: ForceProblem) -> float:
    """A step of the flow with its line search.

    Per block of p rows: P (2 p² q), eigenvalues and vectors (9 p³), the inverse (2 p³), its
    products with the F_j (2 p² q), the step's matrix and its eigenvalues (2 p² q + 8 p³); the
    direction (2 q²); some ten Newton steps of the line search (5 operations an eigenvalue each).
    """
    dims, _, v, _, q = _sizes(problem)
    sizes = [*dims, *[1] * v]
    return sum(6 * p * p * q + 19 * p**3 + 50 * p for p in sizes) + 2 * q * q


def compact_dual(problem: ForceProblem) -> float:
    """A pivot with its lexicographic rule.

    One q×q factorisation (2 q³/3), its inverse (2 q³), three solves (6 q²), and the reduced costs
    of v limits and 8 facets a contact (2 q each).
    """
    dims, _, v, _, q = _sizes(problem)
    return 8 * q**3 / 3 + 6 * q * q + 2 * q * (v + 8 * len(dims))


def neural_network(problem: ForceProblem) -> float:
    """A step of the integrator: two evaluations and two solves, a factorisation every fifth step.

    N = m + 4 n + v + k neurons; an evaluation is two products with each of L, A and W
    (4 m (4 n + v + k)), a solve 2 N², a factorisation 2 N³/3.
    """
    dims, m, v, k, _ = _sizes(problem)
    neurons = m + 4 * len(dims) + v + k
    evaluation = 4 * m * (4 * len(dims) + v + k)
    return 2 * evaluation + 4 * neurons**2 + 2 * neurons**3 / 3 / 5


def minimum_norm(problem: ForceProblem) -> float:
    """The singular value decomposition with all vectors, W = U S V.T (4 m² k + 8 m k² + 9 k³)."""
    _, m, _, k, _ = _sizes(problem)
    return 4 * m * m * k + 8 * m * k * k + 9 * k**3


def qp(problem: ForceProblem) -> float:
    """A change of DAQP's active set, taken to be of m constraints.

    The factor's update and two triangular solves (3 m²), the forces from the multipliers (2 m²),
    and the slack of all v limits and 8 facets a contact (2 m each).
    """
    dims, m, v, _, _ = _sizes(problem)
    return 5 * m * m + 2 * m * (v + 8 * len(dims))


STEP: dict[str, Callable[[ForceProblem], float]] = {
    "wbf": wbf,
    "sdp": sdp,
    "dikin": dikin,
    "gradient_flow": gradient_flow,
    "compact_dual": compact_dual,
    "neural_network": neural_network,
    "minimum_norm": minimum_norm,
    "qp": qp,
}
"""The formula of every method that has one, by its name."""
