"""A grasp from a Pinocchio model and a list of contacts: Jacobian, bias torques, limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_array, as_tuple
from graspforce.contact import Contact, as_contacts, warn_of_slips
from graspforce.errors import InvalidInputError, ModelImportError, warn
from graspforce.grasp_map import map_about
from graspforce.hands.configuration import choose_motors, full_jacobian, notes_of, warnings_of
from graspforce.hands.hand import Actuation
from graspforce.hands.imported import as_link
from graspforce.hands.pinocchio.model import (
    PinocchioConfiguration,
    frames_of,
    joint_drives,
    pinocchio_module,
    what_moves,
)


class PinocchioGrasp:
    """A grasp by links of a Pinocchio model, computed anew in every tick of a loop.

    What does not change is looked up once: the links and the joints that move them, motors and
    their limits. :meth:`update` computes what moves; the attributes are then those of a
    :class:`graspforce.Grasp` that is read with the same arguments.

    Args:
        model: a ``pinocchio.Model``; a floating base is taken as held. Mimic joints are in it only
            if it was built with ``mimic=True``; otherwise each has a motor of its own.
        q: its configuration, shape (nq,).
        contacts: n contacts, in the model's world.
        links: the frame that makes each of them, by name; "universe" for what does not move.
        v: joint velocities, shape (nv,); default 0.
        origin: the point about which the torque in f is taken, shape (3,) [m].
        tau_max: torque limits in place of the model's, both ways: one number for all, or by name
            [N·m; N for prismatic joints].

    Attributes:
        contacts: the contacts, a tuple.
        links: the frame that makes each of them.
        origin: the point about which the torque in f is taken, shape (3,) [m].
        W: grasp map, shape (6, m).
        J: hand Jacobian in contact frames, shape (m, n_joints).
        joint_names: the n_joints joints that move the links.
        tau_lo: lower torque limits, shape (n_joints,) [N·m; N for prismatic joints].
        tau_hi: upper torque limits, likewise.
        tau_bias: the torques at which the joints do not accelerate while nothing touches: gravity
            and Coriolis forces. Pinocchio's dynamics have no springs and no damping.
        notes: what a user should know, a sentence each.

    Raises:
        MissingExtraError: Pinocchio is not installed.
        InvalidInputError: a wrong shape, a frame that is not there.
        ModelImportError: no motor moves any of the links; a joint without a torque limit.

    Warns:
        GraspForceWarning: implausible limits, motions that no motor controls, contacts that look
            like a slip of units or signs; later updates do not look again.
    """

    contacts: tuple[Contact, ...]
    origin: Array
    W: Array
    joint_names: tuple[str, ...]
    J: Array
    tau_lo: Array
    tau_hi: Array
    tau_bias: Array
    internal: Array
    actuation: Actuation

    def __init__(
        self,
        model: Any,
        q: ArrayLike,
        contacts: Sequence[Contact],
        links: Sequence[str],
        v: ArrayLike | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
        tau_max: float | Mapping[str, float] | None = None,
    ) -> None:
        pin = pinocchio_module()
        if not isinstance(model, pin.Model):
            raise InvalidInputError(
                f"model: got a {type(model).__name__}, expected a pinocchio.Model"
            )
        self._model, self._data = model, model.createData()
        start = as_array(q, "q", (int(model.nq),))
        given = as_tuple(links, "links", str)
        if len(given) != len(as_contacts(contacts)):
            raise InvalidInputError(
                f"links: got {given!r}, expected {len(contacts)} names, one a contact"
            )
        frames = tuple(frames_of(model))
        self.links = tuple(as_link(link, "links", frames) for link in given)
        couplings = np.zeros((0, int(model.nv)))  # a model's mimic joints are no dofs of their own
        self._dofs = what_moves(model, self.links, couplings)
        self._motors = choose_motors(
            [each for each in joint_drives(model) if each.dof in self._dofs], tau_max
        )
        if not self._motors.drives:
            raise ModelImportError(f"no motor moves any of the links {', '.join(self.links)}")
        self._configuration = PinocchioConfiguration(
            model, start, self._dofs, self._motors.drives, couplings
        )
        told = (self._motors, self._configuration.transmission, self._configuration.dof_names)
        warnings = warnings_of(*told)
        self.notes = (*warnings, *notes_of(*told))
        self.update(q, contacts, v, origin)
        warn_of_slips(self.contacts)
        warn(*warnings)

    def update(
        self,
        q: ArrayLike,
        contacts: Sequence[Contact],
        v: ArrayLike | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Compute the grasp at a configuration.

        Args:
            q: configuration, shape (nq,).
            contacts: n contacts, made by ``links``, in the model's world.
            v: joint velocities, shape (nv,); default 0.
            origin: the point about which the torque in f is taken, shape (3,) [m].

        Raises:
            InvalidInputError: a wrong shape, another number of contacts.
        """
        pin, model = pinocchio_module(), self._model
        q = as_array(q, "q", (int(model.nq),))
        velocity = np.zeros(model.nv) if v is None else as_array(v, "v", (int(model.nv),))
        given = as_contacts(contacts)
        if len(given) != len(self.links):
            raise InvalidInputError(
                f"contacts: got {len(given)}, expected {len(self.links)}, made by "
                f"{', '.join(self.links)}"
            )
        about = as_array(origin, "origin", (3,))
        self._configuration.update(q)
        full = full_jacobian(
            given,
            [
                self._configuration.twist(link, contact.point)
                for contact, link in zip(given, self.links, strict=True)
            ],
        )
        bias = np.array(pin.nonLinearEffects(model, self._data, q, velocity))[self._dofs]
        self.contacts, self.origin, self.W = given, about, map_about(about, given)
        self.actuation = self._motors.actuation(self._configuration.transmission, full, bias)
        self.joint_names, self.J, self.tau_lo, self.tau_hi, self.tau_bias, *_ = self.actuation
        self.internal = self.actuation.internal
