"""The paper's hand and cube in physics: hold, circle, regrasp (Section IV).

The base joints turn about the fingers' radial axes. With the other reading, the palm's normal,
the fingertips pass within millimetres of the first axis, and tracking suffers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce.contact import PCWF
from graspforce.hands.paper import PaperHand
from graspforce.regrasp import Release
from graspforce.scenarios.paper import AT_REST, CIRCLE, CUBE
from graspforce.sim import parts
from graspforce.sim.mujoco_import import mj
from graspforce.sim.trial import FingerSwing, Gains, Grip, Trial
from graspforce.trajectory import Motion

HAND = PaperHand("radial")


def hold(
    alpha: float = 5.0,
    *,
    mu: float = 0.5,
    rate: float = 500.0,
    duration: float = 2.0,
) -> Trial:
    """Hold the cube at rest, off the palm's centre and turned by 0.1 rad (Section IV-A).

    Args:
        alpha: weight of the torque limits against the friction cones.
        mu: coefficient of friction [-].
        rate: control ticks a second [Hz].
        duration: [s].
    """
    return trial("hold", "the paper's cube held at rest", AT_REST, mu, alpha=alpha, rate=rate,
                 duration=duration)  # fmt: skip


def circle(
    alpha: float = 5.0,
    *,
    feed_forward: bool = True,
    mu: float = 0.5,
    rate: float = 500.0,
    duration: float = 2.0,
) -> Trial:
    """Carry the cube round the paper's circle while it turns to and fro (Section IV-B.1).

    Args:
        alpha: weight of the torque limits against the friction cones.
        feed_forward: whether the torques that move the fingers' own inertia are added.
        mu: coefficient of friction [-].
        rate: control ticks a second [Hz].
        duration: [s].
    """
    return trial(
        "circle", "the paper's cube carried round a circle", CIRCLE, mu, alpha=alpha, rate=rate,
        duration=duration, gains=Gains(feed_forward=feed_forward),
    )  # fmt: skip


def regrasp(
    alpha: float = 5.0,
    *,
    c_max: float = 20.0,
    lift: float = 0.012,
    mu: float = 0.5,
    rate: float = 500.0,
    duration: float = 2.0,
) -> Trial:
    """Carry the cube round the circle, finger 1 lifted from 0.5 to 1.5 s (Section IV-B.2).

    Args:
        alpha: weight of the linear limits against the friction cones.
        c_max: the loose upper bound on normal forces of Eq. (20) [N].
        lift: how far the tip of finger 1 goes away from the cube [m].
        mu: coefficient of friction [-].
        rate: control ticks a second [Hz].
        duration: [s].
    """
    grip = grips()[0]
    swing = FingerSwing(Release(finger=0, leave=0.5, back=1.5, ramp=0.25), grip, grip, lift)
    return trial(
        "regrasp", "the paper's circle, finger 1 away for a second", CIRCLE, mu, alpha=alpha,
        rate=rate, duration=duration, c_max=c_max, steps=(swing,),
    )  # fmt: skip


def grips() -> tuple[Grip, ...]:
    """Return the centres of the cube's vertical sides."""
    return tuple(Grip(each.point, each.normal) for each in CUBE.side_contacts(PCWF(1.0)))


def trial(name: str, summary: str, motion: Motion, true_mu: float, **options: Any) -> Trial:
    """Return a trial with the paper's hand and cube.

    Args:
        name: of the trial.
        summary: of the trial.
        motion: of the cube.
        true_mu: the true coefficient of friction [-]; the controller's is the option of that name.
        **options: further arguments of :class:`Trial`.
    """
    spec = parts.new_spec("cube")
    fingers = parts.paper_hand(spec, HAND, true_mu)
    state = motion.at(0.0)
    body = spec.worldbody.add_body(name="object", pos=state.position)
    body.quat = (np.cos(state.yaw / 2), 0, 0, np.sin(state.yaw / 2))
    body.add_freejoint(name="object")
    half = CUBE.side / 2
    body.add_geom(
        name="cube", type=mj.mjtGeom.mjGEOM_BOX, size=(half, half, half), mass=CUBE.mass,
        rgba=parts.WOOD, **parts.grip_surface(true_mu), **parts.contact_bits("object"),
    )  # fmt: skip
    parts.camera(spec, (0.2, -0.48, 0.24), (0.02, 0.01, 0.065))
    model = spec.compile()
    tips = [
        state.position + state.rotation @ (grip.point - parts.TIP_RADIUS * grip.normal)
        for grip in grips()
    ]
    start: Array = model.qpos0.copy()
    start[:12] = HAND.inverse_kinematics(tips)
    options.setdefault("mu", true_mu)
    return Trial(
        name=name, summary=summary, model=model, start=start, fingers=fingers, grips=grips(),
        motion=motion, **options,
    )  # fmt: skip
