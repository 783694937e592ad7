"""Solve one force distribution problem."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from graspforce._engine import dispatch
from graspforce._engine.settings import DEFAULT, Settings
from graspforce._util.arrays import require_instance
from graspforce.problem import ForceProblem
from graspforce.solution import Solution


def solve(
    problem: ForceProblem,
    settings: Settings | None = None,
    start: ArrayLike | None = None,
    check: bool = False,
) -> Solution:
    """Find the contact forces that minimise Phi_soc + alpha·Phi_lin with W c = f, Eq. (16).

    Args:
        problem: what to solve.
        settings: tolerance, step limit, backend.
        start: contact forces to start from, shape (m,) [N, N·m]; W c = f need not hold.
            One outside the limits is ignored.
        check: raise unless SOLVED.

    Returns:
        The forces with their verdict; look at ``status`` before using ``c``.

    Raises:
        InvalidInputError: an argument of the wrong kind, a start of the wrong shape.
        InfeasibleGraspError, NotConvergedError: with ``check``, when not SOLVED.
    """
    # The class alone is compared first: the whole check takes as long as a Newton step.
    if problem.__class__ is not ForceProblem:
        require_instance(problem, "problem", ForceProblem)
    if settings is None:
        settings = DEFAULT
    elif settings.__class__ is not Settings:
        require_instance(settings, "settings", Settings)
    solution = dispatch.solve(problem, settings, start, Solution)
    if check is not False:
        require_instance(check, "check", bool | np.bool_, "True or False")
        if check:
            solution.raise_if_failed()
    return solution
