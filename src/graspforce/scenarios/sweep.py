"""One grasp over a range of alpha: from a firm grip to a light one (Section IV-A, Fig. 4, 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array, as_array, require, require_instance
from graspforce.columns import Columns
from graspforce.scenarios.paper import static
from graspforce.scenarios.scenario import Scenario
from graspforce.solve import solve


@dataclass(frozen=True, slots=True, eq=False)
class AlphaSweep:
    """The optimal grasps of A values of alpha.

    Attributes:
        alpha: shape (A,).
        c: contact forces in the contact frames, shape (A, m) [N, N·m].
        tau: joint torques, shape (A, n_joints) [N·m].
        normal_forces: shape (A, n) [N].
        friction_residual: r_f of Eq. (22), shape (A,) [N²].
        torque_residual: r_tau, shape (A,) [N·m].
        max_torque: the largest joint torque's size, shape (A,) [N·m].
        newton_steps: from a cold start, shape (A,).
        status: values of :class:`graspforce.Status`, shape (A,).
    """

    alpha: Array
    c: Array
    tau: Array
    normal_forces: Array
    friction_residual: Array
    torque_residual: Array
    max_torque: Array
    newton_steps: NDArray[np.int64]
    status: NDArray[np.int64]


def sweep_alpha(
    alphas: ArrayLike | None = None,
    scenario: Scenario | None = None,
    settings: Settings | None = None,
) -> AlphaSweep:
    """Solve the first tick of a scenario for many values of alpha, each from a cold start.

    Args:
        alphas: shape (A,); default 41 values from 0.01 to 100, even in the logarithm.
        scenario: default :func:`graspforce.scenarios.static`.
        settings: of the solves.

    Raises:
        InvalidInputError: an argument of the wrong kind, an alpha that is not positive.
    """
    given = as_array(np.logspace(-2, 2, 41) if alphas is None else alphas, "alphas", ("A",))
    require(given > 0, "alphas", given, "more than 0")
    scenario = static() if scenario is None else scenario
    require_instance(scenario, "scenario", Scenario)
    problem = scenario.problem(0.0)
    columns = Columns(solve(problem.replace(alpha=float(alpha)), settings) for alpha in given)
    return AlphaSweep(
        alpha=given,
        c=columns.c,
        tau=columns.tau,
        normal_forces=columns.normal_forces,
        friction_residual=columns.friction_residual,
        torque_residual=columns.torque_residual,
        max_torque=columns.max_torque,
        newton_steps=columns.newton_steps,
        status=columns.status,
    )
