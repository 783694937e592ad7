"""Inverse kinematics of fingertips by damped least squares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce.errors import InvalidInputError
from graspforce.sim.mujoco_import import mj
from graspforce.sim.trial import Finger
from graspforce.sim.world import Indices

_TOLERANCE = 1e-9  # [m]
_MAX_ITERATIONS = 200
_DAMPING = 1e-6  # [m²]
_MAX_STEP = 0.2  # of a joint [rad]


def reach(model: Any, start: Array, fingers: Sequence[Finger], targets: Sequence[Array]) -> Array:
    """Return joint positions with the centres of the fingertips at ``targets``.

    Args:
        model: compiled ``mujoco.MjModel``.
        start: joint positions to begin with, shape (nq,); what is not a finger's stays.
        fingers: n of them.
        targets: n points in the world, shape (3,) each [m].

    Raises:
        InvalidInputError: a finger cannot reach its target within its joints' ranges.
    """
    data = mj.MjData(model)
    data.qpos[:] = start
    jacobian = np.zeros((3, model.nv))
    for finger, target in zip(fingers, targets, strict=True):
        joints = [model.joint(name).id for name in finger.joints]
        dofs: Indices = model.jnt_dofadr[joints]
        qpos: Indices = model.jnt_qposadr[joints]
        limited = model.jnt_limited[joints].astype(bool)
        lo = np.where(limited, model.jnt_range[joints, 0], -np.inf)
        hi = np.where(limited, model.jnt_range[joints, 1], np.inf)
        tip = model.geom(finger.tip).id
        error: Array = np.full(3, np.inf)
        for _ in range(_MAX_ITERATIONS):
            mj.mj_kinematics(model, data)
            mj.mj_comPos(model, data)
            error = target - data.geom_xpos[tip]
            if np.abs(error).max() < _TOLERANCE:
                break
            mj.mj_jac(model, data, jacobian, None, data.geom_xpos[tip], model.geom_bodyid[tip])
            J: Array = jacobian[:, dofs]
            step = J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(3), error)
            data.qpos[qpos] += np.clip(step, -_MAX_STEP, _MAX_STEP)
            data.qpos[qpos] = np.clip(data.qpos[qpos], lo, hi)
        else:
            raise InvalidInputError(
                f"targets: {finger.tip} stays {np.linalg.norm(error):.4g} m off "
                f"{np.asarray(target).tolist()}"
            )
    return data.qpos.copy()
