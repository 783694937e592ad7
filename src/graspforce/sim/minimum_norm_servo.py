"""The force distribution with the smallest norm, as a second-order cone program.

The method compared with in :mod:`graspforce.sim`'s disturbance table: ½‖c‖² instead of barriers,
the same W, f, friction cones, torque limits and ceilings, solved by Clarabel. It has the
:class:`Servo`'s interface, so that the control loop around both is the same.
"""

from __future__ import annotations

from typing import Any

from graspforce.baselines import socp
from graspforce.problem import ForceProblem
from graspforce.solution import Solution


class MinimumNormServo:
    """Solves a stream of problems for their forces of smallest norm.

    Args:
        problem: the first tick's problem.

    Raises:
        MissingExtraError: clarabel or scipy is not installed.
    """

    def __init__(self, problem: ForceProblem) -> None:
        self._problem = problem
        self._prepared = socp.Prepared(problem, objective="norm")

    def step(self, **changes: Any) -> Solution:
        """Solve the next tick; arguments as for :meth:`graspforce.Servo.step`."""
        self._problem = self._problem.replace(**changes)
        return self._prepared.solve(self._problem)
