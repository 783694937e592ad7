"""Second-order cone program with exact friction cones: the usual formulation today.

    minimise  the largest normal force ("normal"), or ‖c‖²/2 ("norm")
    with      W c = f, A c ≤ b, every c_i in its friction cone

The WBF paper's problem without its barriers: the wrench, the joint torques and the true cones are
the same, and the objective is least force. So the optimum lies on the boundary,
without margin against slip or overload, and with "normal" it is often a whole
face of forces, of which an interior-point method returns a middle one.

Clarabel, QOCO and SCS are called directly; ECOS (GPL) and Moreau where a user has installed them.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from graspforce._util.arrays import as_positive
from graspforce.baselines._active import Active, as_steps
from graspforce.baselines._conic import Conic, Program, Shape
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# Tolerances that each solver reaches on nearly all grasps, and the iterations that this takes.
_TOLERANCES = {"qoco": 1e-8}
_MAX_STEPS = {"scs": 20_000}

Solver: TypeAlias = Literal["clarabel", "qoco", "scs", "ecos", "moreau"]
Objective: TypeAlias = Literal["normal", "norm"]


class Prepared(Conic):
    """The program with its workspace kept from problem to problem; arguments as :func:`solve`."""

    def __init__(
        self,
        problem: ForceProblem,
        *,
        objective: Objective = "normal",
        solver: Solver = "clarabel",
        tol: float | None = None,
        max_steps: int | None = None,
    ) -> None:
        if objective not in ("normal", "norm"):
            raise InvalidInputError(f"objective: got {objective!r}, expected 'normal' or 'norm'")
        self._largest = objective == "normal"
        self.degree = 1 if self._largest else 2
        precision = _TOLERANCES.get(solver, 1e-9) if tol is None else as_positive(tol, "tol")
        most = _MAX_STEPS.get(solver, 200) if max_steps is None else as_steps(max_steps)
        super().__init__(problem, solver, precision, most)

    def program(self, view: Active, unit: float) -> Program:
        """Return the program in c, and with "normal" the largest normal force t after it."""
        m, k, v, n = len(view.W.T), len(view.W), len(view.b), len(view.models)
        dims = np.array([model.dim for model in view.models])
        starts = np.array(view.starts[:-1])
        frictionless = starts[dims == 1]  # c_i ≥ 0
        frictional = np.repeat(dims > 1, dims).nonzero()[0]
        ceilings = n if self._largest else 0
        nonnegative = v + ceilings + len(frictionless)
        N = m + (1 if ceilings else 0)

        A, b = (
            np.zeros((k + nonnegative + len(frictional), N)),
            np.zeros(k + nonnegative + len(frictional)),
        )
        A[:k, :m], b[:k] = view.W, view.problem.f / unit
        A[k : k + v, :m], b[k : k + v] = view.A, view.b / unit
        if ceilings:
            rows = k + v + np.arange(n)
            A[rows, starts], A[rows, m] = 1.0, -1.0
        A[k + v + ceilings + np.arange(len(frictionless)), frictionless] = -1.0
        A[k + nonnegative + np.arange(len(frictional)), frictional] = -view.cone_weights[frictional]

        P, q = np.zeros(N), np.zeros(N)
        if ceilings:
            q[m] = 1.0
        else:
            P[:] = 1.0
        cones = tuple(int(dim) for dim in dims[dims > 1])
        return Program(Shape(N, k, nonnegative, cones, 0), P, q, A, b)


def solve(
    problem: ForceProblem,
    *,
    objective: Objective = "normal",
    solver: Solver = "clarabel",
    tol: float | None = None,
    max_steps: int | None = None,
) -> Solution:
    """Minimise the largest normal force or ‖c‖²/2 under exact cones and all limits.

    Args:
        problem: what to solve; its alpha has no part in this objective.
        objective: "normal" for max_i c_norm,i, "norm" for ‖c‖²/2.
        solver: which package solves it.
        tol: the tolerance that the solver is asked for, absolute and relative, forces in units
            of the wrench's largest component; default 1e-9, of QOCO 1e-8.
        max_steps: the most iterations; default 200, of SCS 20 000.

    Returns:
        The forces, margins zero to the tolerance; ``newton_steps`` counts the solver's
        iterations, ``nu`` belongs to the objective.

    Raises:
        InvalidInputError: an option out of range.
        MissingExtraError: the solver or SciPy is not installed.
    """
    return Prepared(
        problem, objective=objective, solver=solver, tol=tol, max_steps=max_steps
    ).solve(problem)
