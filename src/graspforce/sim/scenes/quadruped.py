"""A robot on four feet that stands and sways, by the same force distribution as a hand.

The ground pushes on the feet as fingers push on an object, and the trunk is what they carry. The
friction cones and the torque limits are the same; only the joints are on the other side, which
turns the sign of J.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce.sim import parts
from graspforce.sim.mujoco_import import mj
from graspforce.sim.reach import reach
from graspforce.sim.trial import Finger, Grip, Trial
from graspforce.trajectory import Sway

_HIPS = ((0.19, 0.10), (0.19, -0.10), (-0.19, 0.10), (-0.19, -0.10))  # x, y on the trunk [m]
_OUT = 0.04  # from the hip's first axis to the leg's plane [m]
_LINK = 0.20  # of thigh and shank [m]
_HEIGHT = 0.30  # of the hips above the ground [m]
_FOOT = 0.02  # radius [m]
_TORQUE = 30.0  # limit of every joint [N·m]


def quadruped(
    alpha: float = 5.0,
    *,
    sway: float = 0.05,
    dip: float = 0.04,
    mu: float = 0.6,
    rate: float = 500.0,
    duration: float = 2.5,
) -> Trial:
    """Stand on four feet for half a second, then sway in all directions and yaw.

    Args:
        alpha: weight of the torque limits against the friction cones.
        sway: how far the robot goes forward, and half of it sideways [m].
        dip: how far it goes down [m].
        mu: coefficient of friction of the feet on the ground [-].
        rate: control ticks a second [Hz].
        duration: [s].
    """
    spec = parts.new_spec("quadruped")
    legs = _add_robot(spec, mu)
    parts.camera(spec, (1.05, -1.0, 0.55), (0.0, 0.0, 0.17), angle=30)
    model = spec.compile()
    start: Array = model.qpos0.copy()
    start[7:] = np.tile((0.0, 0.7, -1.4), 4)
    side = [np.sign(y) for _, y in _HIPS]
    feet = [np.array([x, y + s * _OUT, _FOOT]) for (x, y), s in zip(_HIPS, side, strict=True)]
    start = reach(model, start, legs, feet)
    data = mj.MjData(model)
    data.qpos[:] = start
    mj.mj_forward(model, data)
    centre: Array = data.subtree_com[model.body("trunk").id].copy()
    up = np.array([0.0, 0.0, 1.0])
    return Trial(
        name="quadruped",
        summary="a robot stands on four feet and sways",
        model=model, start=start, fingers=legs, body="trunk", ground="ground",
        grips=tuple(Grip(foot - (0.0, 0.0, _FOOT) - centre, up) for foot in feet),
        motion=Sway(centre, np.array([sway, sway / 2, -dip]), yaw=0.15, begin=0.5, period=2.0),
        mu=mu, alpha=alpha, rate=rate, duration=duration,
    )  # fmt: skip


def _add_robot(spec: Any, mu: float) -> tuple[Finger, ...]:
    types, joints = mj.mjtGeom, mj.mjtJoint
    nothing = parts.contact_bits("nothing")
    spec.worldbody.add_geom(
        name="ground", type=types.mjGEOM_PLANE, size=(2, 2, 0.1), rgba=(0.93, 0.94, 0.95, 1.0),
        **parts.grip_surface(mu), **parts.contact_bits("object"),
    )  # fmt: skip
    trunk = spec.worldbody.add_body(name="trunk", pos=(0, 0, _HEIGHT))
    trunk.add_freejoint(name="trunk")
    trunk.add_geom(
        type=types.mjGEOM_BOX, size=(0.23, 0.08, 0.045), mass=8.0, rgba=parts.GREY, **nothing
    )
    legs: list[Finger] = []
    for name, (x, y) in zip(("FL", "FR", "RL", "RR"), _HIPS, strict=True):
        side = float(np.sign(y))
        hip = trunk.add_body(name=f"{name}_hip", pos=(x, y, 0))
        hip.add_joint(name=f"{name}_abduction", type=joints.mjJNT_HINGE, axis=(1, 0, 0))
        hip.add_geom(
            type=types.mjGEOM_SPHERE, size=(0.035, 0, 0), mass=0.3, rgba=parts.DARK, **nothing
        )
        thigh = hip.add_body(name=f"{name}_thigh", pos=(0, side * _OUT, 0))
        thigh.add_joint(name=f"{name}_hip", type=joints.mjJNT_HINGE, axis=(0, 1, 0))
        _limb(thigh, 0.02, 0.3)
        shank = thigh.add_body(name=f"{name}_shank", pos=(0, 0, -_LINK))
        shank.add_joint(name=f"{name}_knee", type=joints.mjJNT_HINGE, axis=(0, 1, 0))
        _limb(shank, 0.014, 0.15)
        shank.add_geom(
            name=f"{name}_foot", type=types.mjGEOM_SPHERE, size=(_FOOT, 0, 0), pos=(0, 0, -_LINK),
            mass=0.05, rgba=parts.TIP, **parts.grip_surface(mu), **parts.contact_bits("robot"),
        )  # fmt: skip
        names = tuple(f"{name}_{joint}" for joint in ("abduction", "hip", "knee"))
        for joint in names:
            parts.motor(spec, joint, _TORQUE)
        legs.append(Finger(names, f"{name}_foot"))
    return tuple(legs)


def _limb(body: Any, radius: float, mass: float) -> None:
    body.add_geom(
        type=mj.mjtGeom.mjGEOM_CAPSULE, fromto=(0, 0, 0, 0, 0, -_LINK), size=(radius, 0, 0),
        mass=mass, rgba=parts.GREY, **parts.contact_bits("nothing"),
    )  # fmt: skip
