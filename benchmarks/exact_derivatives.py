"""Derivatives of answers in extended precision, from the equations alone.

The optimum solves ``∇Phi(c) + W.T nu = 0`` and ``W c = f``. The NumPy equations of the package take
complex numbers of extended precision: Newton's method brings the forces to some 1e-18, complex
steps change what is solved by the derivative of a field, and refinement the solution of the linear
equations. Nothing of the core, and no difference, takes part; where long doubles are doubles
(Windows, Arm's macOS) all this is no more exact than what it judges.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import graspforce as gf
from graspforce import equations
from graspforce.solution.rows import ProblemRows

STEP = 1e-40  # of complex steps: its square is nothing beside 1 in extended precision
_ROUNDS = 6


class ExactDerivatives:
    """The optimum of a problem all of whose contacts are in the grasp, and how it changes.

    Args:
        answer: of the problem, to some digits.
    """

    def __init__(self, answer: gf.Solution) -> None:
        problem = answer.problem
        self.layout = problem.layout
        self._packed = problem.packed.astype(np.clongdouble)
        self._exact = problem.exact
        c = np.concatenate((answer.c, answer.internal_forces)).astype(np.longdouble)
        rows = self._rows(c, self._packed)
        gradient = equations.derivatives(rows.loaded, rows.barriers)[0][0].real
        W = rows.equalities[0][0, self._exact].real.astype(float)
        nu = np.linalg.lstsq(W.T, -gradient.astype(float), rcond=None)[0]
        self._at = np.concatenate((c, nu))
        for _ in range(_ROUNDS):
            matrix, residual = self._equations(self._at, self._packed)
            self._at = self._at - _solver(matrix.real)(residual.real)
        self._matrix = self._equations(self._at, self._packed)[0].real
        self._solve = _solver(self._matrix)

    def change(self, name: str, direction: np.ndarray, quantities: tuple[str, ...]) -> list:
        """Return the derivatives of quantities as a field changes along a direction."""
        slot = self.layout.slots[name]
        packed = self._packed.copy()
        packed[slot.start : slot.stop] += 1j * STEP * direction.ravel()
        right = -self._equations(self._at, packed)[1].imag / STEP
        x = np.zeros_like(right)
        for _ in range(_ROUNDS):
            x = x + self._solve(right - self._matrix @ x)
        count = len(x) - self._exact.sum()
        rows = self._rows(self._at[:count] + 1j * STEP * x[:count], packed)
        cones, m = rows.cones, rows.c.shape[1]
        s = cones.scaling * equations.by_contact(rows.loaded[:, :m], self.layout.dims)
        found = {
            "c": rows.c, "internal_forces": rows.forces[:, m:],
            "friction_margins": s[..., 0] - np.sqrt((s[..., 1:] ** 2).sum(axis=-1)),
        }  # fmt: skip
        return [
            (found[each] if each in found else getattr(rows, each)()).imag.ravel() / STEP
            for each in quantities
        ]

    def _rows(self, c: np.ndarray, packed: np.ndarray) -> ProblemRows:
        data = {name: view[None] for name, view in self.layout.views(packed).items()}
        return ProblemRows(self.layout, c[None], data)

    def _equations(self, at: np.ndarray, packed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrix and the residual of the optimum's equations."""
        count = len(at) - self._exact.sum()
        c, nu = at[:count], at[count:]
        rows = self._rows(c, packed)
        gradient, hessian = (each[0] for each in equations.derivatives(rows.loaded, rows.barriers))
        W, f = (each[0, self._exact] for each in rows.equalities)
        none = np.zeros((len(W), len(W)))
        matrix = np.block([[hessian, W.T], [W, none]])
        return matrix, np.concatenate((gradient + W.T @ nu, W @ rows.loaded[0] - f))


def _solver(matrix: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return what solves equations to doubles' precision, which refinement makes better.

    Rows and columns are scaled to the Hessian's diagonal; of dependent rows of W, and of forces
    that nothing tells apart, the least solution is taken.
    """
    diagonal = np.diag(matrix)
    scale = np.ones(len(matrix), matrix.dtype)
    scale[diagonal > 0] = 1 / np.sqrt(diagonal[diagonal > 0])
    sizes = np.sqrt(((matrix * scale) ** 2).sum(axis=1))
    without = (diagonal == 0) & (sizes > 0)
    scale[without] = 1 / sizes[without]
    inverse = np.linalg.pinv((scale[:, None] * matrix * scale).astype(float), rcond=1e-15)
    return lambda right: scale * (inverse @ (scale * right))
