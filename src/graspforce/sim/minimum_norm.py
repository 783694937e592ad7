"""The force distribution with the smallest norm, as a second-order cone program.

The rival in :mod:`graspforce.sim`'s disturbance table: ½‖c‖² instead of barriers, the same W, f,
friction cones, torque limits and ceilings, solved by Clarabel. It has the :class:`Servo`'s
interface, so that the control loop around both is the same.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from graspforce._arrays import Array
from graspforce.errors import MissingExtraError
from graspforce.outcome import PlainOutcome, Status
from graspforce.problem import ForceProblem
from graspforce.solution import Solution


class MinimumNorm:
    """Solves a stream of problems for their forces of smallest norm, each from scratch.

    Args:
        problem: the first tick's problem; point contacts with friction only.

    Raises:
        MissingExtraError: clarabel or scipy is not installed.
    """

    def __init__(self, problem: ForceProblem) -> None:
        try:
            self._clarabel: Any = importlib.import_module("clarabel")
            self._sparse: Any = importlib.import_module("scipy.sparse")
        except ImportError as error:
            raise MissingExtraError("the minimum-norm SOCP", "clarabel", "sim") from error
        self._problem = problem
        self._settings = self._clarabel.DefaultSettings()
        self._settings.verbose = False

    def step(self, **changes: Any) -> Solution:
        """Solve the next tick; arguments as for :meth:`graspforce.Servo.step`."""
        self._problem = problem = self._problem.replace(**changes)
        A, b = problem.linear_limits()
        cones = np.zeros((problem.m, problem.m))  # mu n ≥ ‖t‖ as −(mu n, t) + s = 0, s in the cone
        cones[np.arange(problem.m), np.arange(problem.m)] = -1.0
        cones[problem.starts[:-1], problem.starts[:-1]] = -problem.mu
        off = np.eye(problem.m)[~np.repeat(problem.active, problem.layout.dims)]
        rows = np.vstack((problem.W, off, A, cones))
        right = np.concatenate((problem.f, np.zeros(len(off)), b, np.zeros(problem.m)))
        kinds = [
            self._clarabel.ZeroConeT(len(problem.f) + len(off)),
            self._clarabel.NonnegativeConeT(len(b)),
            *(self._clarabel.SecondOrderConeT(dim) for dim in problem.layout.dims),
        ]
        found = self._clarabel.DefaultSolver(
            self._sparse.csc_matrix(np.eye(problem.m)), np.zeros(problem.m),
            self._sparse.csc_matrix(rows), right, kinds, self._settings,
        ).solve()  # fmt: skip
        return Solution(self._outcome(found), problem)

    def _outcome(self, found: Any) -> PlainOutcome:
        status = {
            self._clarabel.SolverStatus.Solved: Status.SOLVED,
            self._clarabel.SolverStatus.PrimalInfeasible: Status.INFEASIBLE,
        }.get(found.status, Status.STALLED)
        c: Array = np.array(found.x)
        return PlainOutcome(status, found.iterations, c, np.zeros(len(self._problem.f)))
