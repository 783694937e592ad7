"""Quadratic program with linearised cones: the least norm by an active-set solver.

    minimise  ‖c‖²/2   with W c = f, A c ≤ b and pyramids F c ≤ 0 for the friction cones

The usual choice where a control loop has a QP solver already. DAQP, a dual active-set method for
small dense programs, solves it and starts from the active set before.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspforce._engine.outcome import Status
from graspforce.baselines._active import Active, as_steps
from graspforce.baselines._pyramids import Cones, Pyramids
from graspforce.baselines._stream import SolverResult, Stream
from graspforce.errors import MissingExtraError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# DAQP's names for its constraints and ends.
INEQUALITY, EQUATION = 0, 5
SOLVED, MAX_STEPS = 1, -4
TOLERANCE = 1e-10


class Prepared(Stream):
    """The program with DAQP's workspace kept; arguments as :func:`solve`."""

    def __init__(
        self,
        problem: ForceProblem,
        *,
        facets: int = 8,
        cones: Cones = "inner",
        max_steps: int = 10_000,
    ) -> None:
        self._pyramids = Pyramids.of(facets, cones)
        self._max_steps = as_steps(max_steps)
        self._library = _daqp()
        self._sizes, self._ready = (0, 0, 0), False
        super().__init__(problem)

    def _load(self, view: Active, unit: float) -> None:
        k, m = view.W.shape
        facets = self._pyramids.rows(view)
        A = np.vstack((view.W, view.A, facets))
        upper = np.concatenate((view.problem.f, view.b, np.zeros(len(facets)))) / unit
        lower = np.full(len(upper), -np.inf)
        lower[:k] = upper[:k]
        sizes = (k, *A.shape)
        if sizes == self._sizes and self._ready:
            self._ready = self._solver.update(A=A, bupper=upper, blower=lower) >= 0
            return
        self._sizes = sizes
        sense = np.full(len(A), INEQUALITY, dtype=np.int32)
        sense[:k] = EQUATION
        self._solver = self._library.Model()
        self._solver.settings = {"iter_limit": self._max_steps, "primal_tol": TOLERANCE}
        # Setup fails where the equations contradict one another.
        self._ready = self._solver.setup(np.eye(m), np.zeros(m), A, upper, lower, sense)[0] >= 0

    def _run(self, view: Active, unit: float) -> SolverResult:
        k, m = view.W.shape
        if not self._ready:
            return SolverResult(Status.STALLED, 0, np.zeros(m), np.zeros(k))
        x, _, flag, info = self._solver.solve()
        status = {SOLVED: Status.SOLVED, MAX_STEPS: Status.MAX_STEPS}.get(flag, Status.STALLED)
        return SolverResult(status, int(info["iterations"]), unit * x, -unit * info["lam"][:k])


def solve(
    problem: ForceProblem,
    *,
    facets: int = 8,
    cones: Cones = "inner",
    max_steps: int = 10_000,
) -> Solution:
    """Minimise ‖c‖²/2 with W c = f, A c ≤ b and facetted cones by DAQP.

    Args:
        problem: what to solve; its alpha has no part in this objective.
        facets: of a cone with two tangents, even, 4 or more (``_pyramids``).
        cones: "inner" for pyramids inscribed in the true cones, "outer" for circumscribed ones,
            whose answers leave the true cones.
        max_steps: the most changes of the active set.

    Returns:
        The forces; ``newton_steps`` counts the changes of the active set. Where the program has no
        answer the status is INFEASIBLE if the true cones have none either, with its proof, else
        STALLED: the facets are too few.

    Raises:
        InvalidInputError: an option out of range.
        MissingExtraError: DAQP is not installed.
    """
    return Prepared(problem, facets=facets, cones=cones, max_steps=max_steps).solve(problem)


def _daqp() -> Any:
    """Import DAQP, which comes without types."""
    try:
        import daqp  # pyright: ignore[reportMissingImports, reportMissingTypeStubs]
    except ImportError:
        raise MissingExtraError("the quadratic program", "daqp", "baselines") from None
    return daqp
