"""Solve one force distribution problem."""

from __future__ import annotations

from numpy.typing import ArrayLike

from graspforce import _engine
from graspforce._arrays import as_array
from graspforce.problem import ForceProblem
from graspforce.settings import Settings
from graspforce.solution import Solution

DEFAULT = Settings()


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
        InvalidInputError: a start of the wrong shape.
        InfeasibleGraspError, NotConvergedError: with ``check``, when not SOLVED.
    """
    settings = settings or DEFAULT
    guess = None if start is None else as_array(start, "start", (problem.m,))
    solution = _engine.solve(problem, settings, guess, Solution)
    if check:
        solution.raise_if_failed()
    return solution
