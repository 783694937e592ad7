"""Dikin-type recursion on the friction-cone matrix P: Buss, Faybusovich and Moore [6].

Minimises the SDP objective of [4] and [12],

    Σ normal forces − barrier · ln det P(c)   with W c = f,

the linear part for little effort, the barrier against slip and overload (``_lmi`` says what P
is). Each step goes along the steepest descent in the metric of Dikin's ellipsoid around P, which
shrinks near every cone and limit. As the Hessian of the barrier is that metric, the
direction is Newton's and the end is quadratic.

The WBF paper says that the algorithm is of Dikin's type, needs a feasible start (here after [9],
see ``_start``) and finds its step size by a line search. Chosen here: the null-space coordinates of
Eq. (17), and an exact line search, whose one-dimensional function is known from the eigenvalues of
the step in P's metric.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from graspforce.baselines._descent import descend
from graspforce.baselines._lmi import dikin_direction
from graspforce.problem import ForceProblem
from graspforce.solution import Solution


def solve(
    problem: ForceProblem,
    *,
    barrier: float = 0.1,
    tol: float = 1e-9,
    max_steps: int = 200,
    start: ArrayLike | None = None,
) -> Solution:
    """Minimise Σ normal forces − barrier·ln det P(c) with W c = f by Dikin steps.

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
        lambda lmi: dikin_direction,
        barrier=barrier,
        tol=tol,
        max_steps=max_steps,
        start=start,
        decrement_every=1,
    )
