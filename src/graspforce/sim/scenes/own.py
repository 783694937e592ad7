"""A user's own scene as trials: a hand that closes on an object, holds, moves and is disturbed.

Nothing is named but the object. Where nothing holds it at the start, the hand closes on it first.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from graspforce._util.arrays import Array, as_array
from graspforce.errors import InvalidInputError, ModelImportError
from graspforce.sim.closing import close
from graspforce.sim.mujoco_import import mj
from graspforce.sim.scenes.selection import select
from graspforce.sim.trial import Disturbance, Push, Trial
from graspforce.trajectory import GRAVITY, Move

_NOISE = Disturbance(
    position_noise=1e-3, angle_noise=math.radians(1.0), velocity_noise=0.02, rate_noise=0.3
)


def disturbances(weight: float, rate: float) -> dict[str, tuple[str, Disturbance]]:
    """Return the disturbances of a study, in words and as data.

    Args:
        weight: of the object [N].
        rate: control ticks a second [Hz].
    """
    ticks = max(round(0.008 * rate), 1)
    late = f"{ticks} ticks ({1e3 * ticks / rate:.0f} ms) of delay"
    directions = ((weight, 0.0, 0.0), (0.0, -weight, 0.0), (0.0, 0.0, -weight))
    pushes = tuple(
        Push(force, start, 0.1) for force, start in zip(directions, (0.2, 0.4, 0.6), strict=True)
    )
    return {
        "none": ("nothing wrong", Disturbance()),
        "push": ("pushed with its weight, for 0.1 s, thrice", Disturbance(pushes)),
        "payload": (
            "the payload grows by half after 0.3 s", Disturbance(payload=1.5, payload_time=0.3),
        ),
        "friction": ("friction lower by 30 %", Disturbance(friction=0.7)),
        "noise": ("noise: 1 mm, 1°, 20 mm/s, 0.3 rad/s", _NOISE),
        "delay": (late, Disturbance(delay=ticks)),
        "dropout": ("a tenth of the contacts is not seen, at random", Disturbance(dropout=0.1)),
    }  # fmt: skip


def load(path: str | Path) -> Any:
    """Return the compiled model of an MJCF or URDF file.

    Raises:
        ModelImportError: there is no such file, or MuJoCo does not take it.
    """
    if not Path(path).is_file():
        raise ModelImportError(f"{path}: there is no such file")
    try:
        return mj.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ModelImportError(f"{path}: not a model that MuJoCo reads: {error}") from error


def held_body(model: Any, body: str) -> int:
    """Return the number of the body that is held, by its name.

    Raises:
        InvalidInputError: there is none of that name; the text lists those that there are.
    """
    number = int(mj.mj_name2id(model, mj.mjtObj.mjOBJ_BODY, body))
    if number < 0:
        known = [model.body(i).name for i in range(1, model.nbody)]
        raise InvalidInputError(
            f"object: got {body!r}, expected a body of the model: {', '.join(filter(None, known))}"
        )
    return number


def own(
    model: Any,
    body: str,
    *,
    start: Array | None = None,
    move: Sequence[float] = (0.0, 0.0, 0.0),
    turn: float = 0.0,
    shake: float = 0.0,
    disturbance: str = "none",
    alpha: float | None = None,
    mu: float | None = None,
    rate: float = 500.0,
    duration: float = 2.0,
    name: str = "",
) -> tuple[Trial, ...]:
    """Return trials that hold and move an object with whatever hand is near it.

    Args:
        model: a compiled ``mujoco.MjModel``.
        body: the object's name.
        start: joint positions, shape (nq,); by default the model's first keyframe, or qpos0.
        move: how far the object goes, x, y, z [m].
        turn: how far it turns about the vertical [°].
        shake: by how many g the ground shakes at 2 Hz, sideways.
        disturbance: one of "none", "push", "payload", "friction", "noise", "delay", "dropout", or
            "all".
        alpha: weight of the linear limits; by default that of a grip with twice the least force.
        mu: the coefficient of friction to count on; by default what the model says [-].
        rate: control ticks a second [Hz].
        duration: [s].
        name: of the trials.

    Raises:
        InvalidInputError: a name or value that does not fit; a hand that does not get hold of the
            object, with what is missing.
        ModelImportError: an actuator that no torque can be sent to.
    """
    number = held_body(model, body)
    closed = close(model, body, start)
    data = mj.MjData(model)
    data.qpos[:] = closed
    mj.mj_forward(model, data)
    centre = np.array(data.subtree_com[number])
    weight = float(model.body_subtreemass[number]) * GRAVITY
    way = as_array(move, "move", (3,))
    motion = None
    if way.any() or turn:
        motion = Move(centre, way, 0.1, max(0.6 * duration, 1e-3), math.radians(turn))
    doing = " and ".join(
        words
        for words, said in (
            (f"moved by {1e3 * float(np.linalg.norm(way)):.0f} mm", way.any()),
            (f"turned by {turn:g}°", turn != 0),
            (f"shaken at {shake:g} g", shake != 0),
        )
        if said
    )
    return tuple(
        Trial(
            name=f"{name or body}{'' if kind == 'none' else f', {kind}'}",
            summary=f"{body} held{f', {doing}' if doing else ''}",
            model=model, start=closed, body=body, motion=motion, mu=mu, alpha=alpha, rate=rate,
            duration=duration, disturbance=_shaken(each, shake),
        )
        for kind, (_, each) in select(
            disturbance, disturbances(weight, rate), "disturbance"
        ).items()
    )  # fmt: skip


def _shaken(disturbance: Disturbance, shake: float) -> Disturbance:
    if not shake:
        return disturbance
    return dataclasses.replace(disturbance, shake=(shake * GRAVITY, 0.0, 0.0))
