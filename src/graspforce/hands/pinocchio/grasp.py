"""A grasp from a Pinocchio model and a list of contacts: Jacobian, bias torques, limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspforce._arrays import as_array, as_tuple
from graspforce.contact import Contact, as_contacts, warn_of_slips
from graspforce.errors import InvalidInputError, ModelImportError, warn
from graspforce.hands.configuration import actuate, full_jacobian
from graspforce.hands.hand import Reading
from graspforce.hands.imported import as_link
from graspforce.hands.pinocchio.model import (
    JointDrive,
    PinocchioConfiguration,
    frames_of,
    joint_drives,
    pinocchio_module,
    what_moves,
)


def read(
    model: Any,
    q: ArrayLike,
    contacts: Sequence[Contact],
    links: Sequence[str],
    v: ArrayLike | None,
    origin: ArrayLike,
    tau_max: float | Mapping[str, float] | None,
) -> Reading:
    """Return the grasp; see :meth:`graspforce.Grasp.from_pinocchio`.

    Raises:
        MissingExtraError: Pinocchio is not installed.
        InvalidInputError: a wrong shape, a frame that is not there.
        ModelImportError: no motor moves any of the links; a joint without a torque limit.
    """
    pin = pinocchio_module()
    if not isinstance(model, pin.Model):
        raise InvalidInputError(f"model: got a {type(model).__name__}, expected a pinocchio.Model")
    q = as_array(q, "q", (int(model.nq),))
    velocity = np.zeros(model.nv) if v is None else as_array(v, "v", (int(model.nv),))
    contacts = as_contacts(contacts)
    links = as_tuple(links, "links", str)
    if len(links) != len(contacts):
        raise InvalidInputError(
            f"links: got {links!r}, expected {len(contacts)} names, one a contact"
        )
    frames = tuple(frames_of(model))
    made_by = tuple(as_link(link, "links", frames) for link in links)
    couplings = np.zeros((0, int(model.nv)))  # a model's mimic joints are no dofs of their own

    dofs = what_moves(model, made_by, couplings)

    def configuration_with(drives: Sequence[JointDrive]) -> PinocchioConfiguration:
        return PinocchioConfiguration(model, q, dofs, drives, couplings)

    drives = [each for each in joint_drives(model) if each.dof in dofs]
    hand = actuate(configuration_with, drives, tau_max)
    if not hand.joint_names:
        raise ModelImportError(f"no motor moves any of the links {', '.join(made_by)}")
    twists = [
        hand.configuration.twist(link, contact.point)
        for contact, link in zip(contacts, made_by, strict=True)
    ]
    bias = np.array(pin.nonLinearEffects(model, model.createData(), q, velocity))
    warn_of_slips(contacts)
    warn(*hand.warnings)
    return Reading(
        contacts,
        made_by,
        as_array(origin, "origin", (3,)),
        hand.actuation(full_jacobian(contacts, twists), bias[dofs]),
        (*hand.warnings, *hand.notes),
    )
