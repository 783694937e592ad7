"""Closed linkages of a Pinocchio model: the constraints that come beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array, as_tuple
from graspforce.errors import InvalidInputError
from graspforce.hands.loops import Coupling
from graspforce.hands.pinocchio.model import pinocchio_module


class Loop(NamedTuple):
    """A point of one joint's body that stays at a point of another's, perhaps turned as that is."""

    joints: tuple[int, int]
    places: tuple[Any, Any]
    """Where the point is on each body, as ``pinocchio.SE3``."""
    turned: bool
    own: NDArray[np.bool_]
    """Which degrees of freedom move one of both and not the other, shape (nv,)."""
    between: tuple[str, str]


def as_loops(loops: Sequence[Any], model: Any) -> tuple[Loop, ...]:
    """Return what constraint models say.

    Args:
        loops: ``pinocchio.PointAnchorConstraintModel``, ``FrameAnchorConstraintModel`` or
            ``RigidConstraintModel`` of the model.
        model: the ``pinocchio.Model``.

    Raises:
        InvalidInputError: something else, or a constraint of another model's joints.
    """
    pin = pinocchio_module()
    point, frame = pin.PointAnchorConstraintModel, pin.FrameAnchorConstraintModel
    rigid = pin.RigidConstraintModel
    found: list[Loop] = []
    for i, given in enumerate(as_tuple(loops, "loops", object)):
        each: Any = given
        if not isinstance(each, point | frame | rigid):
            raise InvalidInputError(
                f"loops[{i}]: got a {type(each).__name__}, expected a pinocchio."
                "PointAnchorConstraintModel, FrameAnchorConstraintModel or RigidConstraintModel"
            )
        joints = int(each.joint1_id), int(each.joint2_id)
        if max(joints) >= model.njoints:
            raise InvalidInputError(
                f"loops[{i}]: got joint {max(joints)}, expected one of the model's "
                f"{model.njoints}: of another model"
            )
        turned = isinstance(each, frame) or (
            isinstance(each, rigid) and each.type == pin.ContactType.CONTACT_6D
        )
        first, second = (_moving(model, joint) for joint in joints)
        names = str(model.names[joints[0]]), str(model.names[joints[1]])
        places = each.joint1_placement.copy(), each.joint2_placement.copy()
        found.append(Loop(joints, places, turned, first ^ second, names))
    return tuple(found)


def loop_couplings(loops: Sequence[Loop], model: Any, data: Any) -> list[Coupling]:
    """Return the loops' constraints at the configuration of ``data``, rows of shape (r, nv).

    Args:
        loops: the loops.
        model: the ``pinocchio.Model``.
        data: its data, after ``computeJointJacobians``.
    """
    pin = pinocchio_module()
    found: list[Coupling] = []
    for loop in loops:
        frames = [data.oMi[j] * place for j, place in zip(loop.joints, loop.places, strict=True)]
        ways: list[Array] = []
        turns: list[Array] = []
        for joint, frame in zip(loop.joints, frames, strict=True):
            motion = np.zeros((6, model.nv))
            if joint:
                motion = np.array(pin.getJointJacobian(model, data, joint, pin.WORLD))
            motion = motion.reshape(6, model.nv) * loop.own
            at = np.array(frame.translation)
            ways.append(motion[:3] + np.cross(motion[3:], at, axis=0))
            turns.append(motion[3:])
        gap = np.array(frames[0].translation - frames[1].translation)
        found.append(Coupling("place", ways[0] - ways[1], gap, loop.between))
        if loop.turned:
            off = np.array(pin.log3(frames[0].rotation @ frames[1].rotation.T))
            found.append(Coupling("turn", turns[0] - turns[1], off, loop.between))
    return found


def _moving(model: Any, joint: int) -> NDArray[np.bool_]:
    """Return which degrees of freedom move a joint's body, shape (nv,)."""
    moving = np.zeros(model.nv, dtype=bool)
    for above in model.supports[joint]:
        first = int(model.idx_vs[above])
        moving[first : first + int(model.nvs[above])] = bool(above)
    return moving
