"""Moreau, an interior-point method for one problem or many at once; here one at a time."""

from __future__ import annotations

from typing import Any

import moreau  # pyright: ignore[reportMissingImports]
import numpy as np

from graspforce._engine.outcome import Status
from graspforce.baselines._conic import ConicResult, Pattern, Program

_STATUS = {"Solved": Status.SOLVED, "DualInfeasible": Status.UNBOUNDED,
           "MaxIterations": Status.MAX_STEPS}  # fmt: skip


class Workspace:
    """See :class:`graspforce.baselines._conic.Workspace`; entries are stored row by row."""

    def __init__(self, program: Program, pattern: Pattern, tol: float, max_steps: int) -> None:
        library: Any = moreau
        shape = program.shape
        squares = np.flatnonzero(program.P)
        self._by_row = Pattern(pattern.mask.T)
        self._squares = program.P[squares]
        precision = library.IPMSettings(tol_gap_abs=tol, tol_gap_rel=tol, tol_feas=tol)
        self._solver = library.CompiledSolver(
            n=shape.variables, m=len(program.b),
            P_row_offsets=np.concatenate(([0], np.cumsum(program.P != 0))),
            P_col_indices=squares,
            A_row_offsets=self._by_row.pointers, A_col_indices=self._by_row.indices,
            cones=library.Cones(
                num_zero_cones=shape.zeros, num_nonneg_cones=shape.nonnegative,
                so_cone_dims=list(shape.second_order),
            ),
            settings=library.Settings(
                solver="ipm", device="cpu", max_iter=max_steps, ipm_settings=precision
            ),
        )  # fmt: skip
        self.update(program)

    def update(self, program: Program) -> None:
        """Take the numbers of the next program."""
        values = self._by_row.values(np.ascontiguousarray(program.A.T))
        self._solver.setup(self._squares[None], values[None])
        self._vectors = program.q[None], program.b[None]

    def solve(self) -> ConicResult:
        """Solve the program."""
        result, info = self._solver.solve(*self._vectors), self._solver.info
        status = _STATUS.get(info.status[0].name, Status.STALLED)
        return ConicResult(
            status, int(info.iterations[0]), np.array(result.x[0]), np.array(result.z[0])
        )
