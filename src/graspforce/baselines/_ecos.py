"""ECOS, an interior-point method under the GPL: for comparison where a user has installed it."""

from __future__ import annotations

from typing import Any

import ecos  # pyright: ignore[reportMissingImports]
import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.baselines._conic import ConicResult, Pattern, Program

_STATUS = {0: Status.SOLVED, 2: Status.UNBOUNDED, -1: Status.MAX_STEPS}


class Workspace:
    """See :class:`graspforce.baselines._conic.Workspace`; nothing can be kept.

    The objective is linear, so a quadratic one becomes a variable t with a second-order cone:
    ‖(√(2 P) x, t − 1)‖ ≤ t + 1 is ½ x.T P x ≤ t.
    """

    def __init__(self, program: Program, pattern: Pattern, tol: float, max_steps: int) -> None:
        shape = program.shape
        self._squares = np.flatnonzero(program.P)
        sizes = list(shape.second_order)
        if len(self._squares):
            sizes.append(len(self._squares) + 2)
        self._cones = {"l": shape.nonnegative, "q": sizes}
        self._settings = {"abstol": tol, "reltol": tol, "feastol": tol, "max_iters": max_steps,
                          "verbose": False}  # fmt: skip
        self.update(program)

    def update(self, program: Program) -> None:
        """Take the numbers of the next program."""
        k, squares = program.shape.zeros, self._squares
        c, A, G, h = program.q, program.A[:k], program.A[k:], program.b[k:]
        if len(squares):
            n = len(c)
            cone = np.zeros((len(squares) + 2, n + 1))
            cone[[0, -1], n] = -1.0
            cone[1 + np.arange(len(squares)), squares] = -np.sqrt(2 * program.P[squares])
            c = np.append(c, 1.0)
            A = np.pad(A, ((0, 0), (0, 1)))
            G = np.vstack((np.pad(G, ((0, 0), (0, 1))), cone))
            h = np.concatenate((h, [1.0], np.zeros(len(squares)), [-1.0]))
        self._size = program.shape.variables, len(program.b)
        self._data = c, _columns(G), h, self._cones, _columns(A), program.b[:k]

    def solve(self) -> ConicResult:
        """Solve the program."""
        library: Any = ecos
        result = library.solve(*self._data, **self._settings)
        n, rows = self._size
        status = _STATUS.get(result["info"]["exitFlag"], Status.STALLED)
        z = np.concatenate((result["y"], result["z"]))[:rows]
        return ConicResult(status, int(result["info"]["iter"]), np.array(result["x"])[:n], z)


def _columns(A: Array) -> Any:
    from scipy.sparse import csc_matrix  # pyright: ignore[reportMissingTypeStubs]

    return csc_matrix(A)
