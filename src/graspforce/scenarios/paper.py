"""The simulations of Section IV: a grasp at rest, a moving cube, a finger that lets go.

The first joints turn about the palm's normal, as the paper says, and every knee bends to the
outer side of the palm, away from the cube. As the fingertips lean to one side of their bases with
the cube, "outer" is the outward branch for two fingers and the inward one for the other two. On
the circle the last links of fingers 1 and 3, drawn as lines, still cut up to 5 mm into the cube's
edges where the yaw is large; ``hand=PaperHand("radial")`` keeps all links clear of it.

The circle's centre is printed "[.025 0.05] m", without its third number; (.025, .05, .1) is taken,
the height of the grasp at rest, with which the figures come out.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal, TypedDict

from graspforce.contact import PCWF
from graspforce.hands.paper import PaperHand
from graspforce.regrasp import Release, Schedule
from graspforce.scenarios.scenario import Cube, Scenario
from graspforce.trajectory import Circle, Hold

CUBE = Cube(mass=0.25, side=0.075)
AT_REST = Hold(position=(0.025, -0.05, 0.1), yaw=0.1)
CIRCLE = Circle(
    centre=(0.025, 0.05, 0.1),
    radius=0.025,
    period=2.0,
    yaw_amplitude=math.pi / 8,
    yaw_frequency=1.0,
)
HAND_AT_REST = PaperHand("palm_normal", elbow=("outward", "inward", "inward", "outward"))
HAND_ON_CIRCLE = PaperHand("palm_normal", elbow=("outward", "outward", "inward", "inward"))


class ScenarioOptions(TypedDict, total=False):
    """The arguments of :func:`static` and :func:`dynamic`, as keywords."""

    alpha: float
    hand: PaperHand
    mu: float
    rate: float
    duration: float


class RegraspOptions(ScenarioOptions, total=False):
    """The arguments of :func:`regrasp`, as keywords."""

    c_max: float
    shape: Literal["linear", "smooth"]


def static(
    alpha: float = 5.0,
    *,
    hand: PaperHand = HAND_AT_REST,
    mu: float = 0.5,
    rate: float = 250.0,
    duration: float = 2.0,
) -> Scenario:
    """Hold the cube at rest, off the palm's centre and turned by 0.1 rad (Section IV-A).

    Args:
        alpha: weight of the torque limits against the friction cones.
        hand: the hand; the paper's by default.
        mu: coefficient of friction [-].
        rate: ticks a second [Hz].
        duration: of the scenario [s].
    """
    return Scenario(
        name="static",
        summary="the cube held at rest (Section IV-A)",
        cube=CUBE,
        hand=hand,
        contacts=CUBE.side_contacts(PCWF(mu)),
        motion=AT_REST,
        alpha=alpha,
        rate=rate,
        duration=duration,
    )


def dynamic(
    alpha: float = 5.0,
    *,
    hand: PaperHand = HAND_ON_CIRCLE,
    mu: float = 0.5,
    rate: float = 250.0,
    duration: float = 2.0,
) -> Scenario:
    """Carry the cube once round a circle in 2 s while it turns to and fro (Section IV-B.1).

    Torque limits alone bound the grip; arguments as for :func:`static`.
    """
    return Scenario(
        name="dynamic",
        summary="the cube carried round a circle with four fingers (Section IV-B.1)",
        cube=CUBE,
        hand=hand,
        contacts=CUBE.side_contacts(PCWF(mu)),
        motion=CIRCLE,
        alpha=alpha,
        rate=rate,
        duration=duration,
    )


def regrasp(
    c_max: float = 20.0,
    shape: Literal["linear", "smooth"] = "linear",
    *,
    alpha: float = 5.0,
    hand: PaperHand = HAND_ON_CIRCLE,
    mu: float = 0.5,
    rate: float = 250.0,
    duration: float = 2.0,
) -> Scenario:
    """Carry the cube as in :func:`dynamic`, finger 1 away from 0.5 to 1.5 s (Section IV-B.2).

    Args:
        c_max: the loose upper bound on normal forces of Eq. (20) [N].
        shape: how the engagement falls and rises during its ramps of 0.25 s: "linear" as in the
            paper, or "smooth".
        alpha: weight of the linear limits against the friction cones.
        hand: the hand; the paper's by default.
        mu: coefficient of friction [-].
        rate: ticks a second [Hz].
        duration: of the scenario [s].
    """
    away = Release(finger=0, leave=0.5, back=1.5, ramp=0.25)
    return replace(
        dynamic(alpha, hand=hand, mu=mu, rate=rate, duration=duration),
        name="regrasp",
        summary="the cube carried round a circle, finger 1 away for a second (Section IV-B.2)",
        c_max=c_max,
        schedule=Schedule(contacts=4, releases=(away,), shape=shape),
    )
