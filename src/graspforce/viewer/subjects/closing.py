"""A hand in physics as it stands open around its object, before it has closed."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspforce.sim.closing import open_pose
from graspforce.sim.mujoco_import import mj
from graspforce.sim.scenes.own import held_body
from graspforce.viewer.moment import Look, Moment
from graspforce.viewer.subjects import mujoco_bodies

_UNKNOWN = 0.1  # size of an object that has no shape [m]


def open_hand(model: Any, body: str, title: str) -> Look:
    """Return how a hand stands that will close on an object.

    Args:
        model: a compiled ``mujoco.MjModel``.
        body: the object's name.
        title: of the page.

    Raises:
        InvalidInputError: there is no such body.
    """
    held = held_body(model, body)
    data = mj.MjData(model)
    data.qpos[:] = open_pose(model)
    mj.mj_kinematics(model, data)
    mj.mj_comPos(model, data)
    drawn = mujoco_bodies.bodies(model, held)
    poses, centre = mujoco_bodies.poses(data, drawn), data.subtree_com[held].copy()
    size = mujoco_bodies.smallest_extent(drawn.values(), poses)
    note = "The hand closes on the object; the forces come when it holds it."
    moment = Moment(poses, (), centre, None, (), (), np.zeros((0, 3)), note)
    return Look(
        title,
        "the hand closes on the object",
        tuple(drawn.values()),
        moment,
        centre,
        size if np.isfinite(size) else _UNKNOWN,
    )
