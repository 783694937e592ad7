"""Building blocks of the scenes' models, as ``mujoco.MjSpec``.

All contact settings are here: MuJoCo's defaults are too soft for a grasp, and let an object creep
out of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce.hands.paper import PaperHand
from graspforce.sim.mujoco_import import mj
from graspforce.sim.trial import Finger

TIP_RADIUS = 0.004  # of the paper's hand [m]

# Contact bits: robots touch objects and the floor, never themselves.
_ROBOT, _OBJECT = 1, 2

_LINK_RADIUS = 0.0035  # [m]
_LINK_MASS = 0.02  # [kg]
_TIP_MASS = 0.002  # [kg]

GREY, DARK, TIP = (0.62, 0.66, 0.70, 1.0), (0.27, 0.31, 0.36, 1.0), (0.13, 0.15, 0.18, 1.0)
WOOD = (0.87, 0.68, 0.42, 1.0)


def new_spec(name: str, gravity: Sequence[float] = (0.0, 0.0, -9.81)) -> Any:
    """Return a model without bodies, with light and the contact solver's settings."""
    spec = mj.MjSpec()
    apply_settings(spec, name)
    spec.option.gravity = gravity
    return spec


def apply_settings(spec: Any, name: str) -> None:
    """Set a model's light, background and contact solver."""
    spec.modelname = name
    option = spec.option
    option.timestep = 0.001
    option.integrator = mj.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mj.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 100
    option.noslip_iterations = 3
    # MuJoCo 4.0.0's Newton solver errs with sparse Jacobians, which save no time at this size.
    option.jacobian = mj.mjtJacobian.mjJAC_DENSE
    # Divergence has to be reported, not reset to the first pose.
    option.disableflags |= int(mj.mjtDisableBit.mjDSBL_AUTORESET)
    spec.visual.headlight.ambient = (0.45, 0.45, 0.45)
    spec.visual.headlight.diffuse = (0.5, 0.5, 0.5)
    spec.visual.headlight.specular = (0.1, 0.1, 0.1)
    spec.visual.quality.shadowsize = 2048
    spec.add_texture(
        name="sky", type=mj.mjtTexture.mjTEXTURE_SKYBOX, builtin=mj.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=(1, 1, 1), rgb2=(1, 1, 1), width=64, height=64,
    )  # fmt: skip
    spec.worldbody.add_light(pos=(0.2, -0.3, 0.8), dir=(-0.2, 0.3, -0.8), castshadow=True,
                             diffuse=(0.35, 0.35, 0.35), specular=(0.1, 0.1, 0.1))  # fmt: skip


def grip_surface(mu: float) -> dict[str, Any]:
    """Return the settings of a geom that grips or is gripped: stiff, with friction mu."""
    return {
        "friction": (mu, 0.0, 0.0),
        "condim": 3,
        "solref": (0.002, 1.0),
        "solimp": (0.95, 0.99, 0.001, 0.5, 2.0),
    }


def contact_bits(kind: str) -> dict[str, int]:
    """Return the contact bits of a "robot" or an "object"; any other kind has no contacts."""
    bits = {"robot": (_ROBOT, _OBJECT), "object": (_OBJECT, _ROBOT)}.get(kind, (0, 0))
    return {"contype": bits[0], "conaffinity": bits[1]}


def motor(spec: Any, joint: str, limit: float) -> None:
    """Add a torque motor of the joint's name, limited to ±limit [N·m]."""
    actuator = spec.add_actuator(
        name=joint, target=joint, trntype=mj.mjtTrn.mjTRN_JOINT, ctrllimited=True
    )
    actuator.ctrlrange = (-limit, limit)


def paper_hand(spec: Any, hand: PaperHand, mu: float) -> tuple[Finger, ...]:
    """Add the paper's hand, built of primitives from its dimensions; return its fingers.

    The palm is the plane z = 0. The paper's links are massless; these weigh 20 g each, so that
    the mass matrix is regular.
    """
    world = spec.worldbody
    half = hand.half_width
    world.add_geom(
        name="palm", type=mj.mjtGeom.mjGEOM_BOX, size=(half, half, 0.005), pos=(0, 0, -0.007),
        rgba=GREY, **contact_bits("robot"),
    )  # fmt: skip
    up = np.array([0.0, 0.0, 1.0])
    fingers: list[Finger] = []
    for i, base in enumerate(hand.bases):
        radial = base / half
        bend = np.cross(up, radial)
        first_axis = up if hand.base_axis == "palm_normal" else radial
        names = hand.joint_names[3 * i : 3 * i + 3]
        proximal = world.add_body(name=f"finger{i + 1}_proximal", pos=base)
        _hinge(proximal, names[0], first_axis)
        _hinge(proximal, names[1], bend)
        _link(proximal, hand.link)
        distal = proximal.add_body(name=f"finger{i + 1}_distal", pos=(0, 0, hand.link))
        _hinge(distal, names[2], bend)
        _link(distal, hand.link)
        distal.add_geom(
            name=f"tip{i + 1}", type=mj.mjtGeom.mjGEOM_SPHERE, size=(TIP_RADIUS, 0, 0),
            pos=(0, 0, hand.link), mass=_TIP_MASS, rgba=TIP, **grip_surface(mu),
            **contact_bits("robot"),
        )  # fmt: skip
        for name in names:
            motor(spec, name, hand.tau_max)
        fingers.append(Finger(names, f"tip{i + 1}"))
    return tuple(fingers)


def _hinge(body: Any, name: str, axis: Array) -> None:
    body.add_joint(name=name, type=mj.mjtJoint.mjJNT_HINGE, axis=axis)


def _link(body: Any, length: float) -> None:
    body.add_geom(
        type=mj.mjtGeom.mjGEOM_CAPSULE, fromto=(0, 0, 0, 0, 0, length), size=(_LINK_RADIUS, 0, 0),
        mass=_LINK_MASS, rgba=GREY, **contact_bits("nothing"),
    )  # fmt: skip


def camera(
    spec: Any, position: Sequence[float], target: Sequence[float], angle: float = 24.0
) -> None:
    """Add the camera that stills and videos look through, with its vertical angle of view [°]."""
    forward = np.subtract(target, position)
    right = np.cross(forward, (0, 0, 1))
    view = spec.worldbody.add_camera(name="view", pos=position, fovy=angle)
    view.alt.type = mj.mjtOrientation.mjORIENTATION_XYAXES
    view.alt.xyaxes = np.concatenate((right, np.cross(right, forward)))
