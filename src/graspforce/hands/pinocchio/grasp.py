"""A grasp from a Pinocchio model and a list of contacts: Jacobian, bias torques, limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_array, as_tuple, came
from graspforce.contact import Contact, as_contacts, warn_of_slips
from graspforce.errors import InvalidInputError, ModelImportError, warn
from graspforce.grasp_map import map_about
from graspforce.hands.configuration import (
    as_names,
    choose_motors,
    full_jacobian,
    locking_rows,
    notes_of,
    undetermined_notes,
    warnings_of,
)
from graspforce.hands.hand import Actuation
from graspforce.hands.imported import as_link
from graspforce.hands.loops import HOPELESS, gap_notes, largest_gap, linkages, rows_of
from graspforce.hands.pinocchio.loops import as_loops, loop_couplings
from graspforce.hands.pinocchio.mimics import mimic_couplings, mimics_of
from graspforce.hands.pinocchio.model import (
    JointDrive,
    PinocchioConfiguration,
    dof_names,
    frames_of,
    joint_drives,
    pinocchio_module,
    turning,
    what_moves,
)


class PinocchioGrasp:
    """A grasp by links of a Pinocchio model, computed anew in every tick of a loop.

    What does not change is looked up once: the links and the joints that move them, motors and
    their limits. :meth:`update` computes what moves; the attributes are then those of a
    :class:`graspforce.Grasp` that is read with the same arguments.

    Args:
        model: a ``pinocchio.Model``; a floating base is taken as held, or see ``on``. Mimic joints
            are in it only if it was built with ``mimic=True``; otherwise ``urdf`` tells them.
        q: its configuration, shape (nq,).
        contacts: n contacts, in the model's world.
        links: the frame that makes each of them, by name; "universe" for what does not move.
        v: joint velocities, shape (nv,); default 0.
        origin: the point about which the torque in f is taken, shape (3,) [m].
        tau_max: torque limits in place of the model's, both ways: one number for all, or by name
            [N·m; N for prismatic joints].
        urdf: the URDF that the model is of, a path or its text, for its mimic joints.
        on: what W c = f is about: "object", which the links push; or "robot", which floats and
            stands on the contacts: their normals point into it, c is what the ground exerts on it.
            By default the object, but the robot where it floats and stands on the contacts as they
            are given: normals up, below its centre of mass.
        locked: joints that are held whatever the contacts do to them, as by brakes.
        motors: the joints that have motors; the others turn freely, but for those that are locked.
        loops: constraint models that close linkages (``pinocchio.PointAnchorConstraintModel``,
            ``FrameAnchorConstraintModel``, ``RigidConstraintModel``).

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
        passive_rows: virtual work of c over the motions that no motor moves, shape (k, m).
        passive_loads: what it has to be, shape (k,).
        internal: forces of the motors that balance among themselves, shape (r, n_joints).
        A: limits ``A c ≤ b`` of stops that joints lean on and that only push, shape (p, m).
        b: shape (p,).
        load: with ``on="robot"`` the f that holds it as it moves, against gravity and Coriolis
            forces, shape (6,) [N, N·m]; else None.
        notes: what a user should know, a sentence each.

    Raises:
        MissingExtraError: Pinocchio is not installed.
        InvalidInputError: a wrong shape, a frame that is not there, a closed linkage that is open.
        ModelImportError: no motor moves any of the links; a joint without a torque limit; two
            joints like the jaws of a gripper, without ``urdf`` or limits by name; no URDF.

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
    passive_rows: Array
    passive_loads: Array
    internal: Array
    A: Array
    b: Array
    load: Array | None
    actuation: Actuation
    motions: Array | None = None
    from_simulator = False

    def __init__(
        self,
        model: Any,
        q: ArrayLike,
        contacts: Sequence[Contact],
        links: Sequence[str],
        v: ArrayLike | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
        tau_max: float | Mapping[str, float] | None = None,
        urdf: str | Path | None = None,
        on: Literal["object", "robot"] | None = None,
        locked: Sequence[str] = (),
        motors: Sequence[str] | None = None,
        loops: Sequence[Any] = (),
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
        # The mimic joints that a model knows of are no degrees of freedom of their own.
        mimics = () if urdf is None else mimics_of(urdf)
        named = "urdf" if urdf is None else str(urdf)[:80]
        couplings = mimic_couplings(named, model, mimics, self.links)
        following = {each.joint for each in mimics}
        self._loops, self._turns = as_loops(loops, model), turning(model)
        tied = [np.atleast_2d(each.own.astype(float)) for each in self._loops]
        self._dofs = what_moves(model, self.links, np.vstack((couplings, *tied)))
        self._on_robot, said = _acted_on(on, model, start, as_contacts(contacts))
        held = locking_rows(locked, list(dof_names(model).values()))
        every = [each for each in joint_drives(model) if each.limit.name not in following]
        if motors is not None:
            as_names(motors, "motors", [each.limit.name for each in every])
        moving = [each for each in every if each.dof in self._dofs]
        if urdf is None:
            limited = tuple(tau_max) if isinstance(tau_max, Mapping) else ()
            _refuse_jaws_of_one_motor(model, moving, {*limited, *locked, *(motors or ())})
        drives = [each for each in moving if not held[:, each.dof].any()]
        self._motors = choose_motors(drives, tau_max, motors)
        if self._on_robot:  # what would be much for a finger is not for a leg
            self._motors = self._motors._replace(warnings=())
        if not self._motors.drives:
            raise ModelImportError(f"no motor moves any of the links {', '.join(self.links)}")
        self._configuration = PinocchioConfiguration(
            model, start, self._dofs, self._motors.drives, couplings, held, loops=self._closing
        )
        told = (self._motors, self._configuration.transmission, self._configuration.dof_names)
        warnings = (*warnings_of(*told), *said)
        friction = model.upperDryFrictionLimit[self._dofs]
        self._notes = (*warnings, *notes_of(*told, locked, friction))
        unsaid = urdf is None and motors is None and len(model.mimicking_joints) == 0
        if unsaid and len(drives) > 1:
            self._notes += (
                "every joint is taken to have a motor of its own; which ones mimic others this "
                "model may not tell, and urdf= does",
            )
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
        if self._on_robot:  # the velocity of what c acts on is the link's, not the other's
            full = -full
        every = np.array(pin.nonLinearEffects(model, self._data, q, velocity))
        bias = every[self._dofs]
        self.load = self._base_wrench(q, every[:6], about) if self._on_robot else None
        self.contacts, self.origin, self.W = given, about, map_about(about, given)
        self.actuation = self._motors.actuation(
            self._configuration.transmission, self._configuration.ranges, full, bias
        )
        self.joint_names, self.J = self.actuation.joint_names, self.actuation.J
        self.tau_lo, self.tau_hi = self.actuation.tau_lo, self.actuation.tau_hi
        self.tau_bias, self.internal = self.actuation.tau_bias, self.actuation.internal
        self.passive_rows, self.passive_loads = (
            self.actuation.passive_rows,
            self.actuation.passive_loads,
        )
        self.A, self.b = self.actuation.A, self.actuation.b

    def _closing(self, data: Any) -> Array:
        """Return the couplings of closed linkages, shape (p, nv)."""
        couplings = loop_couplings(self._loops, self._model, data)
        self._gap = largest_gap(linkages(couplings, self._turns))
        if self._gap.share > HOPELESS:
            raise InvalidInputError(
                f"q: leaves the closed linkage of {' and '.join(self._gap.between)} open by "
                f"{1000 * self._gap.metres:.3g} mm, expected angles at which it closes"
            )
        return rows_of(couplings, self._turns)[0]

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know, a sentence each."""
        return (
            *self._notes, *self._configuration.notes, *gap_notes(self._gap),
            *undetermined_notes(self.W, self.passive_rows, self.J),
        )  # fmt: skip

    def _base_wrench(self, q: Array, forces: Array, about: Array) -> Array:
        """Return the base's six forces, in its own axes, as a wrench about a point of the world."""
        pin = pinocchio_module()
        pin.forwardKinematics(self._model, self._data, q)
        wrench = self._data.oMi[1].act(pin.Force(forces))
        return np.concatenate(
            (wrench.linear, wrench.angular - np.cross(about, np.array(wrench.linear)))
        )


def _acted_on(
    on: object, model: Any, q: Array, contacts: Sequence[Contact]
) -> tuple[bool, tuple[str, ...]]:
    """Return whether the contacts act on the robot itself, and a warning where that was not said.

    Raises:
        InvalidInputError: neither of the two; on a robot whose base does not float.
    """
    if on not in (None, "object", "robot"):
        raise InvalidInputError(f"on: got {came(on)}, expected 'object', 'robot' or None")
    if on == "robot" and not _floats(model):
        raise InvalidInputError(
            "on: got 'robot', whose base does not float, expected a model with a "
            "pinocchio.JointModelFreeFlyer as its root"
        )
    if on is not None or not _stands(model, q, contacts):
        return on == "robot", ()
    return True, (
        "the base floats and stands on the contacts as their normals are: W, f and c are what "
        "acts on the robot; on='robot' says so, on='object' says that they push an object",
    )


def _floats(model: Any) -> bool:
    """Return whether the model's base is a free joint."""
    return int(model.njoints) > 1 and str(model.joints[1].shortname()) == "JointModelFreeFlyer"


def _stands(model: Any, q: Array, contacts: Sequence[Contact]) -> bool:
    """Return whether a floating robot stands on contacts with these normals.

    They point up, below its centre of mass, which is not far beside them: a robot that carries a
    box on its hands has its centre of mass elsewhere.
    """
    gravity = np.array(model.gravity.linear)
    if not _floats(model) or not gravity.any():
        return False
    up = -gravity / np.linalg.norm(gravity)
    points = np.array([each.point for each in contacts])
    arms = pinocchio_module().centerOfMass(model, model.createData(), q) - points
    heights = arms @ up
    beside = arms - heights[:, None] * up
    spread = np.linalg.norm(beside - beside.mean(axis=0), axis=1).max()
    return bool(
        all(each.normal @ up > 0.5 for each in contacts)
        and heights.min() > 0
        and np.linalg.norm(beside.mean(axis=0)) < spread + 0.25 * heights.mean()
    )


def _refuse_jaws_of_one_motor(model: Any, drives: Sequence[JointDrive], said: Set[str]) -> None:
    """Raise where two joints of one link are alike, as are the jaws of a gripper.

    That is, in kind and limits, without others beside them or beyond. One motor moves both in most
    grippers: the second mimics the first in the URDF, of which nothing is left in a model that
    Pinocchio has built without ``mimic=True``.

    Args:
        model: the ``pinocchio.Model``.
        drives: the joints that move the links.
        said: those of which the user says whether they have a motor.

    Raises:
        ModelImportError: there are such, and nothing says that each has a motor.
    """
    joints = {int(model.getJointId(each.limit.name)): each.limit for each in drives}
    siblings: dict[int, list[int]] = {}
    for joint in joints:
        siblings.setdefault(int(model.parents[joint]), []).append(joint)
    for pair in siblings.values():
        first, *others = (joints[joint] for joint in pair)
        if (
            len(others) == 1
            and first[1:] == others[0][1:]
            and not {first.name, others[0].name} <= said
            and not any(set(pair) & set(model.supports[each]) - {each} for each in joints)
        ):
            raise ModelImportError(
                f"joints {first.name!r} and {others[0].name!r} of one link have the same limits "
                "and nothing beyond them, as the jaws of a gripper that one motor moves, and this "
                "model does not tell: give urdf=, the file or its text, for its mimic joints; or "
                "both in motors, or tau_max by name, if each has a motor"
            )
