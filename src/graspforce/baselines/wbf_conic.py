"""The WBF objective by a general conic solver: Eq. (16) with exponential cones.

    minimise  −2 Σ_i u_i − alpha Σ_j v_j     with W c = f
    with      mu n_i ≥ ‖(t_i, r_i)‖,  u_i ≤ ln r_i,  v_j ≤ ln(b_j − a_j·c)

At the best r_i, r_i² = mu² n_i² − ‖t_i‖², so that 2 u_i is the logarithm of Eq. (9), and v_j that
of Eq. (6): the same minimiser as :func:`graspforce.solve`, by independent code. Each
logarithm is an exponential cone, (u, 1, r) or (v, 1, b − a·c). Clarabel solves it.
"""

from __future__ import annotations

import numpy as np

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_positive
from graspforce.baselines._active import Active, as_steps
from graspforce.baselines._conic import Conic, Pattern, Program, Shape
from graspforce.baselines._stream import SolverResult
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# Phi / min(1, alpha) of an answer is at most this much above its minimum.
SUBOPTIMALITY = 1e-6


class Prepared(Conic):
    """The program with its workspace kept from problem to problem; arguments as :func:`solve`."""

    def __init__(self, problem: ForceProblem, *, tol: float = 1e-9, max_steps: int = 200) -> None:
        super().__init__(problem, "clarabel", as_positive(tol, "tol"), as_steps(max_steps))

    def program(self, view: Active, unit: float) -> Program:
        """Return the program in c, r, u and v, one of r and u a contact, of v a limit."""
        m, k, v, n = len(view.W.T), len(view.W), len(view.b), len(view.models)
        r, u = m + np.arange(n), m + n + np.arange(n)
        N, starts = m + 2 * n + v, view.starts
        sizes = [model.dim + 1 for model in view.models]
        tops = k + np.cumsum([0, *sizes])  # a cone's rows: its contact's forces, then r
        first = int(tops[-1])
        A, b = np.zeros((first + 3 * (n + v), N)), np.zeros(first + 3 * (n + v))
        A[:k, :m], b[:k] = view.W, view.problem.f / unit
        own = np.delete(np.arange(k, first), tops[1:] - 1 - k)
        A[own, np.arange(starts[-1])] = -view.cone_weights
        A[tops[1:] - 1, r] = -1.0
        A[first::3, m + n :] = -np.eye(n + v)
        b[first + 1 :: 3] = 1.0
        A[first + 2 : first + 3 * n : 3, m : m + n] = -np.eye(n)
        A[first + 3 * n + 2 :: 3, :m] = view.A
        b[first + 3 * n + 2 :: 3] = view.b / unit
        # Φ / max(1, alpha), so that the multipliers stay near 1.
        self._scale = max(1.0, view.problem.alpha)
        q = np.zeros(N)
        q[u], q[m + 2 * n :] = -2.0 / self._scale, -view.problem.alpha / self._scale
        return Program(Shape(N, k, 0, tuple(sizes), n + v), np.zeros(N), q, A, b)

    def _run(self, view: Active, unit: float) -> SolverResult:
        result = super()._run(view, unit)
        runaway = np.abs(result.c).max() > equations.RUNAWAY * unit
        if (runaway or result.status is Status.STALLED) and self._unbounded(view):
            result = result._replace(status=Status.UNBOUNDED)
        elif result.status is Status.STALLED and _near_optimal(view, result.c):
            result = result._replace(status=Status.SOLVED)
        return result._replace(nu=result.nu * self._scale)

    def _unbounded(self, view: Active) -> bool:
        """Whether some grip c ≠ 0 with W c = 0 and A c ≤ 0 in the cones may grow without bound.

        Then so does every logarithm along it; Clarabel follows such a direction without reporting
        it, as the slope of a logarithm vanishes. The maximum of Σ n_i ≤ 1 over
        such grips is 0 or 1.
        """
        own, normals = self.program(view, 1.0), view.normals
        m, k, v, cones = len(normals), len(view.W), len(view.b), own.shape.second_order
        A = np.vstack((view.W, view.A, normals, own.A[k : k + sum(cones), :m]))
        b = np.zeros(len(A))
        b[k + v] = 1.0
        program = Program(Shape(m, k, v + 1, cones, 0), np.zeros(m), -normals, A, b)
        grip = self._workspace_type(program, Pattern(A != 0), self._tol, self._max_steps).solve()
        return grip.status is Status.SOLVED and float(normals @ grip.x) > 0.5


def _near_optimal(view: Active, c: Array) -> bool:
    """Whether Phi is within ``SUBOPTIMALITY`` of its minimum.

    Clarabel often stops a digit or two short of its tolerance with exponential cones.
    """
    decrement, _ = equations.decrement_and_error(c, view.W, view.inner.barriers)
    return decrement**2 / 2 <= SUBOPTIMALITY


def solve(problem: ForceProblem, *, tol: float = 1e-9, max_steps: int = 200) -> Solution:
    """Minimise Phi of Eq. (16) by Clarabel.

    Args:
        problem: what to solve.
        tol: the tolerance that Clarabel is asked for.
        max_steps: the most iterations.

    Raises:
        InvalidInputError: an option out of range.
        MissingExtraError: Clarabel or SciPy is not installed.
    """
    return Prepared(problem, tol=tol, max_steps=max_steps).solve(problem)
