"""Pseudo-inverse: the least-norm force that balances the wrench, without any other limit.

    minimise  ‖c‖²/2   with W c = f,   so c = W⁺ f

Eq. (17) with lam = 0. Friction cones, torque limits and ceilings are ignored; normal forces may be
negative. SOLVED means here only that W c = f holds with the least norm: the margins of the Solution
say how far the forces violate the rest. The status is never INFEASIBLE.
"""

from __future__ import annotations

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce.baselines._active import Active, run, solution_from_gradient
from graspforce.problem import ForceProblem
from graspforce.solution import Solution


def solve(problem: ForceProblem) -> Solution:
    """Return c = W⁺ f.

    Args:
        problem: what to solve; only W, f and which contacts are in the grasp have a part.

    Returns:
        The forces; ``newton_steps`` is 1, the one linear solve.
    """
    return run(problem, _solve)


def _solve(view: Active) -> Solution:
    c, _ = equations.particular_and_nullspace(view.W, view.problem.f)
    return solution_from_gradient(view, Status.SOLVED, 1, c, c)
