"""A method by a foreign solver, on one problem or on a stream of problems.

A solver has a workspace (factorisation pattern, memory, the last answer) that saves time in a
control loop. :class:`Stream` keeps it: the constructor sets it up for the first problem,
and each ``solve`` passes new numbers where the problem is another one. The workspace is made anew
only where the shape of the program changes, as when a contact leaves the grasp. Each method has a
subclass ``Prepared``, and its ``solve(problem)`` is ``Prepared(problem).solve(problem)``.

The solver's status is checked here, the same for all: W c = f to 1e-10, a wrench out of range, a
certificate with every infeasibility.
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

# A relative wrench error above this is not corrected: the solver has failed.
LARGEST_CORRECTION = 1e-5


class SolverResult(NamedTuple):
    """A solver's result, before it is checked.

    Attributes:
        status: SOLVED, UNBOUNDED, MAX_STEPS, or STALLED for any other end, also for
            infeasibility, which is reported only with a certificate.
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
        self._load_problem(problem)

    def solve(self, problem: ForceProblem) -> Solution:
        """Solve the next problem; the one that this was made with is not passed again."""
        if problem is not self._problem:
            self._load_problem(problem)
        view = self._view
        if view is None:
            return self._trivial
        with np.errstate(all="ignore"):
            try:
                return _checked_solution(view, self._run(view, self._unit))
            except np.linalg.LinAlgError:
                return empty_solution(problem, Status.INVALID_NUMBERS)

    def _load_problem(self, problem: ForceProblem) -> None:
        trivial = trivial_verdict(problem)
        # Set last, so that a problem that failed to load does not count as loaded.
        self._problem: ForceProblem | None = None
        self._view = Active.of(problem) if trivial is None else None
        if trivial is not None:
            self._trivial = trivial
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
    def _run(self, view: Active, unit: float) -> SolverResult:
        """Run the solver on what was loaded; forces and multipliers are back in SI units."""


def _checked_solution(view: Active, result: SolverResult) -> Solution:
    """Return the solver's result as far as it passes the checks."""
    problem, c, status = view.problem, result.c, result.status
    if status is Status.SOLVED:
        error = equations.relative_wrench_error(c, view.W, problem.f)
        if WRENCH_TOLERANCE / 10 < error <= LARGEST_CORRECTION:
            # Solvers balance the wrench to their tolerance; the rest is a least-norm correction.
            c = c + equations.least_squares(view.W, problem.f - view.W @ c)
            error = equations.relative_wrench_error(c, view.W, problem.f)
        if error <= WRENCH_TOLERANCE:
            return make_solution(view, status, result.steps, c, result.nu)
        status = Status.STALLED
    if not equations.wrench_reachable(view.W, problem.f):
        return empty_solution(problem, Status.WRENCH_UNREACHABLE)
    if status is Status.UNBOUNDED:
        return empty_solution(problem, status)
    return infeasible_or(view, make_solution(view, status, result.steps, c, result.nu))
