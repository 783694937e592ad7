"""A light bulb screwed into its socket, finger by finger (Section III-C.3).

The socket is above the paper's hand. One finger after the other leaves, returns and makes contact
again while the others keep turning. The bulb has all six degrees of freedom; its thread couples the
advance to the turn and resists it, and the fingers alone keep the bulb upright and centred.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce.hands.paper import PaperHand
from graspforce.regrasp import Release
from graspforce.sim import parts
from graspforce.sim.mujoco_import import mj
from graspforce.sim.trial import FingerSwing, Gains, Grip, Trial
from graspforce.trajectory import Screw

HAND = PaperHand("radial")
RADIUS = 0.03  # of the globe [m]
MASS = 0.05  # [kg]
PITCH = 0.00362  # of an E27 thread [m]
CENTRE = np.array([0.0, 0.0, 0.105])

# The order in which fingers swing: each is followed by the one opposite.
_ORDER = (0, 2, 1, 3)


def bulb(
    alpha: float = 5.0,
    *,
    turn: float = 370.0,
    rate_of_turn: float = 35.0,
    cycle: float = 1.6,
    thread_torque: float = 0.02,
    mu: float = 0.7,
    c_max: float = 10.0,
    lift: float = 0.01,
    rate: float = 250.0,
) -> Trial:
    """Screw a bulb in by a given angle, one finger stepping at a time.

    Args:
        alpha: weight of the linear limits against the friction cones.
        turn: how far the bulb is turned [°].
        rate_of_turn: [°/s].
        cycle: the time in which every finger swings once [s].
        thread_torque: with which the thread resists turning [N·m].
        mu: coefficient of friction between fingertip and glass [-].
        c_max: ceiling of every normal force [N].
        lift: how far a stepping fingertip goes away from the bulb [m].
        rate: control ticks a second [Hz].
    """
    motion = Screw(CENTRE, math.radians(turn), math.radians(rate_of_turn), ramp=0.4, pitch=PITCH)
    swings = _swings(motion, cycle, lift)
    grips = tuple(_first_grip(finger, swings) for finger in range(4))
    spec = parts.new_spec("bulb")
    fingers = parts.paper_hand(spec, HAND, mu)
    _add_bulb(spec, mu, thread_torque)
    parts.camera(spec, (0.36, -0.36, 0.20), (0.0, 0.0, 0.088), angle=27)
    model = spec.compile()
    start: Array = model.qpos0.copy()
    start[:12] = HAND.inverse_kinematics(
        [CENTRE + grip.point - parts.TIP_RADIUS * grip.normal for grip in grips]
    )
    return Trial(
        name="bulb",
        summary=f"a light bulb screwed in by {turn:g}°",
        model=model, start=start, fingers=fingers, grips=grips, motion=motion, steps=swings,
        mu=mu, alpha=alpha, c_max=c_max, rate=rate, duration=motion.duration + 0.3,
        turning_friction=thread_torque,
        gains=Gains(object_stiffness=2500.0, object_damping=100.0),
    )  # fmt: skip


def _swings(motion: Screw, cycle: float, lift: float) -> tuple[FingerSwing, ...]:
    """Return every swing of every finger until the bulb is in.

    A finger sweeps about its own direction from the palm's centre, as far to one side as to the
    other, and is away for an eighth of the cycle.
    """
    slot, swing = cycle / 4, cycle / 8
    ramp = 0.45 * (slot - swing)
    sweep = motion.rate * (cycle - swing)
    swings: list[FingerSwing] = []
    contact_angles: dict[int, float] = {}  # of each finger's contact, as an angle on the bulb
    number = 0
    while (leave := motion.ramp + number * slot + ramp) + swing + ramp < motion.duration:
        finger, back = _ORDER[number % 4], leave + swing
        home = finger * math.pi / 2
        start = contact_angles.get(finger, home + sweep / 2 - motion.at(leave).yaw)
        end = home - sweep / 2 - motion.at(back).yaw
        swings.append(
            FingerSwing(Release(finger, leave, back, ramp), _grip(start), _grip(end), lift)
        )
        contact_angles[finger] = end
        number += 1
    return tuple(swings)


def _first_grip(finger: int, swings: tuple[FingerSwing, ...]) -> Grip:
    """Return a finger's contact until its first swing; at its own direction when it has none."""
    starts = (swing.start for swing in swings if swing.release.finger == finger)
    return next(starts, _grip(finger * math.pi / 2))


def _grip(angle: float) -> Grip:
    """Return a grip on the globe's equator."""
    outward = np.array([math.cos(angle), math.sin(angle), 0.0])
    return Grip(RADIUS * outward, -outward)


def _add_bulb(spec: Any, mu: float, thread_torque: float) -> None:
    glass, brass, white = (0.95, 0.85, 0.45, 0.45), (0.72, 0.62, 0.36, 1.0), (0.8, 0.82, 0.85, 0.3)
    body = spec.worldbody.add_body(name="object", pos=CENTRE)
    slide, hinge = mj.mjtJoint.mjJNT_SLIDE, mj.mjtJoint.mjJNT_HINGE
    for name, axis in (("x", (1, 0, 0)), ("y", (0, 1, 0)), ("advance", (0, 0, 1))):
        body.add_joint(name=name, type=slide, axis=axis)
    body.add_joint(name="turn", type=hinge, axis=(0, 0, 1), frictionloss=thread_torque)
    for name, axis in (("tilt_x", (1, 0, 0)), ("tilt_y", (0, 1, 0))):
        body.add_joint(name=name, type=hinge, axis=axis)
    thread = spec.add_equality(
        type=mj.mjtEq.mjEQ_JOINT, objtype=mj.mjtObj.mjOBJ_JOINT, name1="advance", name2="turn",
        solref=(0.002, 1.0),
    )  # fmt: skip
    thread.data[:2] = (0.0, PITCH / (2 * math.pi))
    body.add_geom(
        name="globe", type=mj.mjtGeom.mjGEOM_SPHERE, size=(RADIUS, 0, 0), mass=MASS, rgba=glass,
        **parts.grip_surface(mu), **parts.contact_bits("object"),
    )  # fmt: skip
    # What no finger touches is a body of its own: only the held body is drawn translucent.
    base = body.add_body(name="base")
    cylinder = mj.mjtGeom.mjGEOM_CYLINDER
    for low, high, radius, rgba in ((0.02, 0.045, 0.018, glass), (0.045, 0.068, 0.013, brass)):
        base.add_geom(
            type=cylinder, fromto=(0, 0, low, 0, 0, high), size=(radius, 0, 0), mass=0, rgba=rgba,
            **parts.contact_bits("nothing"),
        )  # fmt: skip
    # A stripe that shows the rotation.
    base.add_geom(
        type=mj.mjtGeom.mjGEOM_CAPSULE, fromto=(0.0185, 0, 0.026, 0.0185, 0, 0.043),
        size=(0.0012, 0, 0), mass=0, rgba=parts.DARK, **parts.contact_bits("nothing"),
    )  # fmt: skip
    spec.worldbody.add_geom(
        type=cylinder, fromto=(0, 0, 0.16, 0, 0, 0.20), size=(0.02, 0, 0), rgba=white,
        **parts.contact_bits("nothing"),
    )  # fmt: skip
