"""Linearly constrained gradient flow on the friction-cone matrix P: Buss, Faybusovich, Moore [5].

Minimises the SDP objective of [4] and [12],

    Σ normal forces − barrier · ln det P(c)   with W c = f,

by following the negative gradient of the matrix function within the affine space of all P that
are friction-cone matrices of forces with W c = f: dP/dt = −Π ∇_P, where Π projects orthogonally
in the entries of P. With P = P_0 + Σ_j x_j F_j in the null-space coordinates x of Eq. (17), that is
dx/dt = −G⁻¹ ∇_x with the constant matrix G_ij = tr(F_i F_j).

The WBF paper names the flow and says that the step size comes from a line search. Chosen here:
Euler steps with exact line search, from the start of ``_start``. The metric is independent of
the cones, so the flow is slow where a force is near its cone: hundreds to thousands of steps,
linear convergence. Every 20 steps the barrier's Hessian is formed for the stopping test.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array
from graspforce.baselines._descent import Direction, descend
from graspforce.baselines._lmi import Lmi, Point
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

STEPS_BETWEEN_DECREMENTS = 20


def solve(
    problem: ForceProblem,
    *,
    barrier: float = 0.1,
    tol: float = 1e-9,
    max_steps: int = 20_000,
    start: ArrayLike | None = None,
) -> Solution:
    """Minimise Σ normal forces − barrier·ln det P(c) with W c = f along the gradient flow.

    Args:
        problem: what to solve; its alpha has no part in this objective.
        barrier: weight of −ln det P, above 0 [N]: the more, the firmer. The less it is beside the
            wrench, the more steps it takes: below 1/100 of it ``max_steps`` may be too few.
        tol: bound on decrement²/2 of the objective / barrier at return.
        max_steps: the most steps after the start is found.
        start: contact forces to start from, shape (m,) [N, N·m]; W c = f need not hold. One
            outside the limits is ignored.

    Returns:
        The forces; ``newton_steps`` counts the steps, those to the start included.

    Raises:
        InvalidInputError: an option out of range, a start of the wrong shape.
    """
    return descend(
        problem,
        _projected_gradient,
        barrier=barrier,
        tol=tol,
        max_steps=max_steps,
        start=start,
        decrement_every=STEPS_BETWEEN_DECREMENTS,
    )


def _projected_gradient(lmi: Lmi) -> Direction:
    """Return the direction −G⁻¹ gradient, G the Gram matrix of P's coefficients."""
    inverse = np.linalg.inv(lmi.gram())

    def direction(point: Point, gradient: Array) -> Array:
        return -inverse @ gradient

    return direction
