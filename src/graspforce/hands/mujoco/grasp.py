"""The grasp that a MuJoCo simulation is in: contacts, Jacobian, bias torques, limits.

Everything is read from where ``mj_step`` or ``mj_forward`` has left it, hence all of one moment.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from graspforce._arrays import Array, came
from graspforce.contact import FPC, PCWF, SFC, Contact, ContactModel
from graspforce.errors import InvalidInputError, warn
from graspforce.hands.configuration import actuate, full_jacobian
from graspforce.hands.hand import Reading
from graspforce.hands.imported import as_fingertips, as_link
from graspforce.hands.mujoco.model import (
    Drive,
    MujocoConfiguration,
    body_of,
    coupling_rows,
    dofs_above,
    drive_rows,
    drives,
    is_loose,
    links_of,
    mujoco_module,
    name_of,
    what_moves,
)
from graspforce.hands.transmission import connected_dofs


def read(
    model: Any,
    data: Any,
    object_body: str | int,
    fingertips: Sequence[str] | None,
    tau_max: float | Mapping[str, float] | None,
) -> Reading:
    """Return the grasp; see :meth:`graspforce.Grasp.from_mujoco`.

    Raises:
        MissingExtraError: MuJoCo is not installed.
        InvalidInputError: a name that is not there; an object that is fixed or not held.
        ModelImportError: a drive without a torque limit.
    """
    mj = mujoco_module()
    for given, kind, argument in ((model, mj.MjModel, "model"), (data, mj.MjData, "data")):
        if not isinstance(given, kind):
            raise InvalidInputError(
                f"{argument}: got a {type(given).__name__}, expected an mujoco.{kind.__name__}"
            )
    held = _object(model, object_body)
    candidates, motor_notes = drives(model)
    moments = drive_rows(model, data, candidates)
    if candidates and not moments.any():
        raise InvalidInputError(
            "data: nothing is computed in it yet, expected data after mj_step or mj_forward"
        )
    contacts, bodies, contact_notes = _contacts(model, data, held, moments)
    name = name_of(model, mj.mjtObj.mjOBJ_BODY, held)
    if fingertips is not None:
        _require(model, name, bodies, fingertips)
    absent = _absent(model, data, bodies, moments)
    if not bodies:
        raise _not_held(name, absent)
    moved = what_moves(model, data, bodies, candidates)

    def configuration_with(drives: Sequence[Drive]) -> MujocoConfiguration:
        return MujocoConfiguration(model, data, moved.dofs, drives)

    hand = actuate(configuration_with, moved.drives, tau_max)
    if not hand.joint_names:
        raise _not_held(name, absent)
    twists = [
        hand.configuration.body_twist(body, contact.point)
        for contact, body in zip(contacts, bodies, strict=True)
    ]
    warnings = (*contact_notes, *hand.warnings)
    notes = [*hand.notes, *motor_notes]
    if absent:
        notes.append(f"not in contact with {name!r}: {', '.join(absent)}")
    if int(model.opt.cone) == int(mj.mjtCone.mjCONE_PYRAMIDAL):
        notes.append("the simulation's friction pyramids lie inside the exact cones of the grasp")
    warn(*warnings)
    return Reading(
        tuple(contacts),
        tuple(name_of(model, mj.mjtObj.mjOBJ_BODY, body) for body in bodies),
        np.array(data.xipos[held]),
        hand.actuation(full_jacobian(contacts, twists), _bias(model, data)[moved.dofs]),
        (*warnings, *notes),
    )


def _object(model: Any, object_body: object) -> int:
    """Return the number of the object's body, which has to be able to move."""
    mj = mujoco_module()
    if isinstance(object_body, str):
        names = [mj.mj_id2name(model, mj.mjtObj.mjOBJ_BODY, i) for i in range(model.nbody)]
        as_link(object_body, "object_body", [name for name in names if name])
        body = names.index(object_body)
    else:
        try:
            body = operator.index(object_body)  # pyright: ignore[reportArgumentType]
        except TypeError:
            body = -1
        if not 0 <= body < model.nbody:
            raise InvalidInputError(
                f"object_body: got {came(object_body)}, expected a body's name or its number, "
                f"below {model.nbody}"
            )
    if not model.body_weldid[body]:
        raise InvalidInputError(
            f"object_body: {object_body!r} is fixed to the world, expected a body that can move"
        )
    return body


def _contacts(
    model: Any, data: Any, held: int, moments: Array
) -> tuple[list[Contact], list[int], list[str]]:
    """Return the object's active contacts, the body that makes each, and what was left out."""
    mj = mujoco_module()
    seen = data.contact
    geoms = np.array(seen.geom)
    rigid = model.body_weldid[model.geom_bodyid[geoms]] == model.body_weldid[held]
    rigid &= geoms >= 0  # −1 is a deformable body
    contacts: list[Contact] = []
    bodies: list[int] = []
    notes: list[str] = []
    for i in np.flatnonzero((rigid.sum(axis=1) == 1) & (np.array(seen.exclude) == 0)):
        second = bool(rigid[i, 1])
        other = int(geoms[i, 0 if second else 1])
        if other < 0:
            notes.append("a contact with a deformable body is left out")
            continue
        body = int(model.geom_bodyid[other])
        if is_loose(model, body, moments):
            name = name_of(model, mj.mjtObj.mjOBJ_BODY, body)
            notes.append(f"the contact with {name!r} is left out: that body is loose itself")
            continue
        # MuJoCo's normal points from the first geom to the second.
        frame = np.array(seen.frame[i]).reshape(3, 3)
        model_of_contact = _friction(int(seen.dim[i]), seen.friction[i])
        normal = frame[0] if second else -frame[0]
        contacts.append(Contact(seen.pos[i], normal, model_of_contact, frame[1]))
        bodies.append(body)
    return contacts, bodies, list(dict.fromkeys(notes))


def _friction(dim: int, friction: Array) -> ContactModel:
    """Return the contact model that lies within MuJoCo's cone.

    MuJoCo's least coefficient, which it puts in place of 0, is no friction. Of two tangential
    coefficients the smaller counts; rolling friction (dim 6) is not used.
    """
    least = float(mujoco_module().mjMINMU)
    mu, gamma = float(min(friction[:2])), float(friction[2])
    if dim == 1 or mu <= least:
        return FPC()
    if dim == 3 or gamma <= least:
        return PCWF(mu)
    return SFC(mu, gamma)


def _bias(model: Any, data: Any) -> Array:
    """Return what the joints must give before they push, shape (nv,).

    Gravity and Coriolis forces less what springs, fluid and gravity compensation contribute.
    Joint damping is not fed forward: it is there to damp.
    """
    passive = data.qfrc_passive - data.qfrc_damper
    by_motor = data.qfrc_gravcomp * model.jnt_actgravcomp[model.dof_jntid]
    return np.array(data.qfrc_bias - passive - by_motor)


def _require(model: Any, name: str, bodies: Sequence[int], fingertips: Sequence[str]) -> None:
    """Raise unless each of the fingertips touches the object."""
    touching = {int(model.body_weldid[body]) for body in bodies}
    tips = {tip: body_of(model, tip) for tip in as_fingertips(fingertips, links_of(model))}
    absent = [tip for tip, body in tips.items() if int(model.body_weldid[body]) not in touching]
    if absent:
        raise InvalidInputError(
            f"data: {', '.join(absent)} not in contact with {name!r}, expected all of the "
            f"fingertips {', '.join(tips)} to be"
        )


def _absent(model: Any, data: Any, bodies: Sequence[int], moments: Array) -> list[str]:
    """Return the last bodies of the fingers, as far as they are not among ``bodies``."""
    driven = np.zeros(model.nv, dtype=bool)
    driven[np.nonzero(moments)[1]] = True
    driven[connected_dofs(driven, coupling_rows(model, data))] = True
    touching = {int(model.body_weldid[body]) for body in bodies}
    inner = set(model.body_parentid.tolist())
    return [
        name_of(model, mujoco_module().mjtObj.mjOBJ_BODY, body)
        for body in range(1, model.nbody)
        if body not in inner
        and int(model.body_weldid[body]) not in touching
        and (dofs_above(model, body) & driven).any()
    ]


def _not_held(name: str, absent: Sequence[str]) -> InvalidInputError:
    return InvalidInputError(
        f"data: no finger is in contact with {name!r} (read after mj_step or mj_forward); fingers "
        f"without contact: {', '.join(absent) or 'none, as no motor moves any body'}"
    )
