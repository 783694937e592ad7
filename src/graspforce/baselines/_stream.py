"""A method by somebody else's solver, on one problem or on a stream of problems.

A solver has a workspace (factorisation pattern, memory, the last answer) that is worth keeping
in a control loop. :class:`Stream` keeps it: the constructor sets it up for the first problem,
and each ``solve`` passes new numbers where the problem is another one. The workspace is made anew
only where the shape of the program changes, as when a contact leaves the grasp. Each method has a
subclass ``Prepared``, and its ``solve(problem)`` is ``Prepared(problem).solve(problem)``.

What the solver claims is judged here, the same for all: W c = f to the last digits, a wrench out of
reach, a proof with every infeasibility.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.baselines._active import Active, empty_solution, make_solution, trivial_verdict
from graspforce.baselines._start import infeasible_or
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.solution.verification import WRENCH_TOLERANCE

# An answer whose wrench is further off than this, relative to the forces, is none.
LARGEST_CORRECTION = 1e-5


class Found(NamedTuple):
    """What a solver says.

    Attributes:
        status: SOLVED, UNBOUNDED, MAX_STEPS, or STALLED for any other end, a claim of
            infeasibility among them: that needs a proof.
        steps: its iterations.
        c: contact forces, shape (m,); only a guess unless SOLVED.
        nu: multipliers of W c = f, shape (k,), for the method's objective.
    """

    status: Status
    steps: int
    c: Array
    nu: Array


class Stream(ABC):
    """A method with its solver's workspace.

    Args:
        problem: the first problem of the stream.
    """

    def __init__(self, problem: ForceProblem) -> None:
        self._take(problem)

    def solve(self, problem: ForceProblem) -> Solution:
        """Solve the next problem; the one that this was made with is not passed again."""
        if problem is not self._problem:
            self._take(problem)
        view = self._view
        if view is None:
            return self._known
        with np.errstate(all="ignore"):
            try:
                return _judged(view, self._run(view, self._unit))
            except np.linalg.LinAlgError:
                return empty_solution(problem, Status.INVALID_NUMBERS)

    def _take(self, problem: ForceProblem) -> None:
        known = trivial_verdict(problem)
        # Last of all, so that a problem which failed to load is not taken for a loaded one.
        self._problem: ForceProblem | None = None
        self._view = Active.of(problem) if known is None else None
        if known is not None:
            self._known = known
        elif self._view is not None:
            # Solvers' tolerances are absolute, so forces are in units of the wrench's size.
            self._unit = float(np.abs(problem.f).max()) or 1.0
            self._load(self._view, self._unit)
        self._problem = problem

    @abstractmethod
    def _load(self, view: Active, unit: float) -> None:
        """Set the workspace up, or pass it the numbers of the next problem.

        Args:
            view: the problem.
            unit: of force in the solver's program [N].
        """

    @abstractmethod
    def _run(self, view: Active, unit: float) -> Found:
        """Run the solver on what was loaded; forces and multipliers are back in SI units."""


def _judged(view: Active, found: Found) -> Solution:
    """Return the answer that the solver's words are worth."""
    problem, c, status = view.problem, found.c, found.status
    if status is Status.SOLVED:
        error = equations.relative_wrench_error(c, view.W, problem.f)
        if WRENCH_TOLERANCE / 10 < error <= LARGEST_CORRECTION:
            # Solvers balance the wrench to their tolerance; the rest is a least-norm correction.
            c = c + equations.least_squares(view.W, problem.f - view.W @ c)
            error = equations.relative_wrench_error(c, view.W, problem.f)
        if error <= WRENCH_TOLERANCE:
            return make_solution(view, status, found.steps, c, found.nu)
        status = Status.STALLED
    if not equations.wrench_reachable(view.W, problem.f):
        return empty_solution(problem, Status.WRENCH_UNREACHABLE)
    if status is Status.UNBOUNDED:
        return empty_solution(problem, status)
    return infeasible_or(view, make_solution(view, status, found.steps, c, found.nu))
