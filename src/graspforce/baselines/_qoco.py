"""QOCO, an interior-point method for quadratic objectives and second-order cones."""

from __future__ import annotations

from typing import Any

import numpy as np
import qoco  # pyright: ignore[reportMissingTypeStubs]

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.baselines._conic import ConicResult, Pattern, Program, diagonal

_STATUS = {"QOCO_SOLVED": Status.SOLVED, "QOCO_MAX_ITER": Status.MAX_STEPS}


class Workspace:
    """See :class:`graspforce.baselines._conic.Workspace`; equations and cones are set apart."""

    def __init__(self, program: Program, pattern: Pattern, tol: float, max_steps: int) -> None:
        k, shape = program.shape.zeros, program.shape
        self._zeros = k
        self._equations, self._others = Pattern(pattern.mask[:k]), Pattern(pattern.mask[k:])
        self._solver: Any = qoco.QOCO()
        self._solver.setup(
            shape.variables, len(program.b) - k, k,
            diagonal(program.P) if program.P.any() else None, program.q,
            self._equations.sparse(program.A[:k]), program.b[:k],
            self._others.sparse(program.A[k:]), program.b[k:],
            shape.nonnegative, len(shape.second_order),
            np.array(shape.second_order, dtype=np.int32),
            abstol=tol, reltol=tol, max_iters=max_steps, verbose=0,
        )  # fmt: skip

    def update(self, program: Program) -> None:
        """Take the numbers of the next program."""
        k = self._zeros
        self._solver.update_vector_data(program.q, program.b[:k], program.b[k:])
        self._solver.update_matrix_data(
            A=self._equations.values(program.A[:k]), G=self._others.values(program.A[k:])
        )

    def solve(self) -> ConicResult:
        """Solve the program."""
        result = self._solver.solve()
        status = _STATUS.get(result.status, Status.STALLED)
        z: Array = np.concatenate((result.y, result.z))
        return ConicResult(status, int(result.iters), np.array(result.x), z)
