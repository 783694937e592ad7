"""An Allegro hand that holds and moves a sphere, a box and a cylinder, under five gravities.

Three fingertips lie on top of the object, the thumb's below it. The object is held, moved by 1 cm,
and held again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce.sim import parts
from graspforce.sim.allegro_hand import TIP_RADIUS, allegro_hand
from graspforce.sim.mujoco_import import mj
from graspforce.sim.reach import reach
from graspforce.sim.scenes.selection import select
from graspforce.sim.trial import Grip, Trial
from graspforce.trajectory import Move

CENTRE = np.array([0.085, -0.008, 0.0165])
MASS = 0.15  # of every object [kg]

GRAVITIES: dict[str, tuple[str, tuple[float, float, float]]] = {
    "fingers_up": ("fingers up", (0.0, 0.0, -9.81)),
    "fingers_down": ("fingers down", (0.0, 0.0, 9.81)),
    "palm_up": ("palm up", (-9.81, 0.0, 0.0)),
    "palm_down": ("palm down", (9.81, 0.0, 0.0)),
    "sideways": ("little finger down", (0.0, 9.81, 0.0)),
}

# The start of the inverse kinematics [rad].
_GUESS = np.array([*([-0.1, 0.55, 0.8, 0.75] * 3), 1.1, 1.0, 0.9, 0.95])


def allegro(
    shape: str = "all",
    gravity: str = "all",
    *,
    alpha: float = 5.0,
    mu: float = 0.8,
    way: float = 0.01,
    rate: float = 250.0,
) -> tuple[Trial, ...]:
    """Return the trials of one object or all, under gravity from one direction or all.

    Args:
        shape: "sphere", "box", "cylinder" or "all".
        gravity: one of ``GRAVITIES`` or "all".
        alpha: weight of the torque limits against the friction cones.
        mu: coefficient of friction [-].
        way: how far the object is moved, to the fingers' side [m].
        rate: control ticks a second [Hz].

    Raises:
        InvalidInputError: an unknown shape or gravity.
    """
    return tuple(
        _trial(each, description, direction, alpha, mu, way, rate)
        for each in select(shape, dict.fromkeys(("sphere", "box", "cylinder")), "shape")
        for description, direction in select(gravity, GRAVITIES, "gravity").values()
    )


def _trial(
    shape: str, description: str, gravity: tuple[float, float, float],
    alpha: float, mu: float, way: float, rate: float,
) -> Trial:  # fmt: skip
    spec, fingers = allegro_hand(f"allegro {shape}", mu)
    spec.option.gravity = gravity
    body = spec.worldbody.add_body(name="object", pos=CENTRE)
    body.add_freejoint(name="object")
    body.add_geom(
        name=shape, mass=MASS, rgba=parts.WOOD, **_geometry(shape), **parts.grip_surface(mu),
        **parts.contact_bits("object"),
    )  # fmt: skip
    parts.camera(spec, (0.45, 0.27, 0.2), (0.05, -0.005, 0.015))
    model = spec.compile()
    grips = _sphere_grips() if shape == "sphere" else _flat_grips()
    start: Array = model.qpos0.copy()
    start[:16] = _GUESS
    targets = [CENTRE + grip.point - TIP_RADIUS * grip.normal for grip in grips]
    return Trial(
        name=f"{shape}, {description}",
        summary="an Allegro hand holds an object and moves it by 1 cm",
        model=model, start=reach(model, start, fingers, targets), fingers=fingers, grips=grips,
        motion=Move(CENTRE, np.array([0.0, way, 0.0]), begin=0.3, duration=0.7),
        mu=mu, alpha=alpha, rate=rate, duration=1.3,
    )  # fmt: skip


def _geometry(shape: str) -> dict[str, Any]:
    """Return the MuJoCo geom of a shape; the box and the cylinder lie along y."""
    types = mj.mjtGeom
    return {
        "sphere": {"type": types.mjGEOM_SPHERE, "size": (0.034, 0, 0)},
        "box": {"type": types.mjGEOM_BOX, "size": (0.03, 0.05, 0.03)},
        "cylinder": {
            "type": types.mjGEOM_CYLINDER, "size": (0.03, 0, 0),
            "fromto": (0, -0.05, 0, 0, 0.05, 0),
        },
    }[shape]  # fmt: skip


def _flat_grips() -> tuple[Grip, ...]:
    """Return three grips in a row on top and one below."""
    down = np.array([0.0, 0.0, -1.0])
    above = tuple(Grip(np.array([0.0, y, 0.03]), down) for y in (0.0365, 0.0, -0.0365))
    return (*above, Grip(np.array([0.0, -0.002, -0.03]), -down))


def _sphere_grips() -> tuple[Grip, ...]:
    """Return three grips on an arc over the top and one below."""
    angles = (0.75, 0.0, -0.75, math.pi)
    outward = [np.array([0.0, math.sin(angle), math.cos(angle)]) for angle in angles]
    return tuple(Grip(0.034 * each, -each) for each in outward)
