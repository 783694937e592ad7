"""Clarabel, an interior-point method for all cones used here."""

from __future__ import annotations

from typing import Any

import clarabel  # pyright: ignore[reportMissingTypeStubs]
import numpy as np

from graspforce._engine.outcome import Status
from graspforce.baselines._conic import ConicResult, Pattern, Program, diagonal

_STATUS = {"Solved": Status.SOLVED, "DualInfeasible": Status.UNBOUNDED,
           "MaxIterations": Status.MAX_STEPS}  # fmt: skip


class Workspace:
    """See :class:`graspforce.baselines._conic.Workspace`."""

    def __init__(self, program: Program, pattern: Pattern, tol: float, max_steps: int) -> None:
        library: Any = clarabel
        settings = library.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.max_iter = max_steps
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tol
        settings.presolve_enable = False  # data of a presolved program cannot be updated
        shape = program.shape
        cones = [library.ZeroConeT(shape.zeros), library.NonnegativeConeT(shape.nonnegative)]
        cones += [library.SecondOrderConeT(size) for size in shape.second_order]
        cones += [library.ExponentialConeT()] * shape.exponential
        self._pattern = pattern
        self._solver = library.DefaultSolver(
            diagonal(program.P), program.q, pattern.sparse(program.A), program.b, cones,
            settings,
        )  # fmt: skip

    def update(self, program: Program) -> None:
        """Take the numbers of the next program."""
        self._solver.update(q=program.q, A=self._pattern.values(program.A), b=program.b)

    def solve(self) -> ConicResult:
        """Solve the program."""
        result = self._solver.solve()
        status = _STATUS.get(str(result.status), Status.STALLED)
        return ConicResult(status, int(result.iterations), np.array(result.x), np.array(result.z))
