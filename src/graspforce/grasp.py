"""A grasp: contacts, and the hand that makes them, turned into a force problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike

from graspforce import equations
from graspforce._util.arrays import Array, as_array, require_keywords
from graspforce.contact import (
    Contact,
    ContactModel,
    as_contacts,
    patch_weights,
    warn_of_slips,
)
from graspforce.errors import InvalidInputError
from graspforce.grasp_map import map_about
from graspforce.problem import ForceProblem, ProblemOptions

if TYPE_CHECKING:
    from graspforce.hands.hand import Actuation, Hand, ImportedGrasp


class Grasp:
    """W, J and torque limits of contacts and a hand.

    Args:
        contacts: n contacts, in one frame (the hand's, when there is a hand).
        hand: the hand that makes them; without one there are no torque limits.
        q: the hand's joint angles, shape (n_joints,) [rad].
        origin: the point about which the torque in f is taken, shape (3,) [m].

    Attributes:
        contacts: the contacts, a tuple.
        models: their models.
        origin: the point about which the torque in f is taken, shape (3,) [m].
        W: grasp map, shape (6, m).
        J: hand Jacobian in contact frames, shape (m, n_joints); None without a hand, and where no
            motor moves what touches.
        tau_lo: lower torque limits, shape (n_joints,) [N·m]; None without a hand.
        tau_hi: upper torque limits, likewise.
        tau_bias: what the joints must give besides, likewise: against gravity and springs, where
            the hand knows them (:class:`graspforce.hands.LoadedHand`), else 0.
        joint_names: the n_joints joints; empty without a hand.
        passive_rows: of an underactuated hand, the virtual work of c over the motions that no
            motor moves, shape (k, m); k = 0 for others.
        passive_loads: what that work has to be, shape (k,): 0 but for weight and springs.
        internal: forces of the motors that balance among themselves, shape (r, n_joints), where
            they are more than the motions that they move; r = 0 for other hands.
        links: what makes each contact, where that was read from a robot; otherwise empty.
        notes: remarks of the import from a robot.
        load: the f with which contacts on a robot carry it (``from_pinocchio(…, on="robot")``),
            shape (6,) [N, N·m]; else None.

    Raises:
        InvalidInputError: no contacts, a hand without q or the reverse, no hand, a wrong shape.

    Warns:
        GraspForceWarning: the contacts look like millimetres, or their normals as if they
            pointed out of the object.
    """

    def __init__(
        self,
        contacts: Sequence[Contact],
        hand: Hand | None = None,
        q: ArrayLike | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        if (hand is None) != (q is None):
            given, missing = ("q", "hand") if hand is None else ("hand", "q")
            raise InvalidInputError(f"{missing}: missing; {given} came without it")
        self._set_contacts(as_contacts(contacts), as_array(origin, "origin", (3,)))
        warn_of_slips(self.contacts)
        if hand is not None and q is not None:
            from graspforce.hands.hand import actuation
            from graspforce.hands.imported import ImportedHand

            self._set_actuation(actuation(hand, self.contacts, q))
            self.links = hand.made_by if isinstance(hand, ImportedHand) else ()

    def _set_contacts(self, contacts: tuple[Contact, ...], origin: Array) -> None:
        """Set checked contacts and origin, without a hand."""
        self.contacts, self.origin = contacts, origin
        self.W = map_about(origin, contacts)
        self.models: tuple[ContactModel, ...] = tuple(each.model for each in contacts)
        self.J: Array | None = None
        self.tau_lo: Array | None = None
        self.tau_hi: Array | None = None
        self.tau_bias: Array | None = None
        self.joint_names: tuple[str, ...] = ()
        self.passive_rows: Array = np.zeros((0, self.W.shape[1]))
        self.passive_loads: Array = np.zeros(0)
        self.internal: Array = np.zeros((0, 0))
        self.links: tuple[str, ...] = ()
        self.notes: tuple[str, ...] = ()
        self.load: Array | None = None

    def _set_actuation(self, actuation: Actuation) -> None:
        (
            self.joint_names, self.J, self.tau_lo, self.tau_hi, self.tau_bias,
            self.passive_rows, self.passive_loads, self.internal,
        ) = actuation  # fmt: skip
        if not self.joint_names:  # what touches has no motors, as mocap bodies
            self.J = self.tau_lo = self.tau_hi = self.tau_bias = None
            self.internal = np.zeros((0, 0))

    @property
    def cone_weight(self) -> Array:
        """Weights of the contacts' cones, shape (n,): those of one patch of a link share 1.

        See :func:`graspforce.contact.patch_weights`; all are 1 where ``links`` is empty.
        """
        if not self.links:
            return np.ones(len(self.contacts))
        return patch_weights(np.array([each.normal for each in self.contacts]), self.links)

    @property
    def undetermined(self) -> int:
        """How many components of c neither W c = f nor the torques determine.

        What the motors do is the same for all forces that differ in these alone: such forces are
        what was asked for, not what comes of it. The physics (stiffness, and how the
        hand closed) chooses among them.
        """
        J = np.zeros((self.W.shape[1], 0)) if self.J is None else self.J
        return equations.undetermined(np.vstack((self.W, self.passive_rows)), J)

    @classmethod
    def from_mujoco(
        cls,
        model: Any,
        data: Any,
        object_body: str | int,
        fingertips: Sequence[str] | None = None,
        tau_max: float | Mapping[str, float] | None = None,
    ) -> Grasp:
        """Read the grasp that a MuJoCo simulation is in.

        Every active contact of the object with something that is not itself loose becomes a
        contact: fingers, palm, table. Points, normals and J are in the world's axes, ``origin``
        is the object's centre of mass, and ``tau_bias`` is what gravity, Coriolis forces and
        springs take of the joints. Call it after ``mj_step`` or ``mj_forward``; it changes
        neither model nor data.

        Args:
            model: the ``mujoco.MjModel``.
            data: its ``mujoco.MjData``.
            object_body: name or number of the object's body.
            fingertips: bodies or sites that have to touch the object; by default any one.
            tau_max: torque limits in place of the model's, both ways unless the model's motor acts
                one way only: one number for all, or by name [N·m; N for slides and tendons]. A
                joint without a motor that it names gets one; where the model has no motors, one
                number makes motors of all hinges and slides that follow no other joint and are not
                the object's.

        Raises:
            MissingExtraError: MuJoCo is not installed.
            InvalidInputError: a name that is not there; an object that is fixed, or that
                nothing with a motor touches, nor a mocap body: the text says which fingers lack
                contact.
            ModelImportError: a joint or tendon with a motor but without a torque limit.
        """
        from graspforce.hands.mujoco.grasp import held_grasp

        return cls._imported(held_grasp(model, data, object_body, fingertips, tau_max))

    @classmethod
    def from_pinocchio(
        cls,
        model: Any,
        q: ArrayLike,
        contacts: Sequence[Contact],
        links: Sequence[str],
        v: ArrayLike | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
        tau_max: float | Mapping[str, float] | None = None,
        urdf: str | Path | None = None,
        on: Literal["object", "robot"] | None = None,
    ) -> Grasp:
        """Read a grasp from a Pinocchio model and a list of contacts.

        ``tau_bias`` is what gravity and Coriolis forces take of the joints.

        Args:
            model: a ``pinocchio.Model``; a floating base is taken as held, or see ``on``. Mimic
                joints are in it only if it was built with ``mimic=True``; otherwise ``urdf`` tells
                them.
            q: its configuration, shape (nq,).
            contacts: n contacts, in the model's world.
            links: the frame that makes each of them, by name; "universe" for what does not move.
            v: joint velocities, shape (nv,); default 0.
            origin: the point about which the torque in f is taken, shape (3,) [m].
            tau_max: torque limits in place of the model's, both ways: one number for all, or by
                name [N·m; N for prismatic joints].
            urdf: the URDF that the model is of, a path or its text, for its mimic joints.
            on: what W c = f is about: "object", which the links push; or "robot", which floats and
                stands on the contacts: their normals point into it, c is what the ground exerts on
                it, and ``load`` the f that carries it. By default the object, but the robot where
                it floats and stands on the contacts as they are given: normals up, below its
                centre of mass.

        Raises:
            MissingExtraError: Pinocchio is not installed.
            InvalidInputError: a wrong shape, a frame that is not there; ``on="robot"`` with a base
                that does not float.
            ModelImportError: no motor moves any of the links; a joint without a torque limit; two
                joints like the jaws of a gripper, without ``urdf`` or limits by name; no URDF.
        """
        from graspforce.hands.pinocchio.grasp import PinocchioGrasp

        read = PinocchioGrasp(model, q, contacts, links, v, origin, tau_max, urdf, on)
        grasp = cls._imported(read)
        grasp.load = read.load
        return grasp

    @classmethod
    def _imported(cls, read: ImportedGrasp) -> Grasp:
        grasp = cls.__new__(cls)
        grasp._set_contacts(read.contacts, read.origin)
        grasp._set_actuation(read.actuation)
        grasp.links, grasp.notes = read.links, read.notes
        return grasp

    def problem(self, f: ArrayLike, **options: Unpack[ProblemOptions]) -> ForceProblem:
        """Return the problem of giving the object the wrench f with this grasp.

        With an underactuated hand its W and f have ``passive_rows`` and ``passive_loads``
        below the wrench; ``f_soft`` is of the wrench alone, and these rows hold. Points of one
        patch share the weight of one contact: ``cone_weight=1`` counts each of them as one.

        Args:
            f: wrench that the fingers exert on the object, shape (6,) [N, N·m].
            **options: any further argument of :class:`ForceProblem`: alpha, c_max, tau_bias, …

        Raises:
            InvalidInputError: as :class:`ForceProblem`; or a name that is no such argument.
        """
        require_keywords(options, ProblemOptions.__annotations__, "Grasp.problem")
        hand: ProblemOptions = {
            "J": self.J, "tau_lo": self.tau_lo, "tau_hi": self.tau_hi, "tau_bias": self.tau_bias,
        }  # fmt: skip
        if len(self.internal):
            hand["internal"] = self.internal
        W, wanted = self.W, as_array(f, "f", (6,))
        if len(self.passive_rows):
            W = np.vstack((W, self.passive_rows))
            wanted = np.concatenate((wanted, self.passive_loads))
            f_soft = options.get("f_soft")
            if f_soft is not None:
                soft = as_array(f_soft, "f_soft", (6,), broadcast=True)
                options["f_soft"] = np.concatenate((soft, np.zeros(len(self.passive_loads))))
        weight = self.cone_weight
        if (weight != 1).any():
            options.setdefault("cone_weight", weight)
        return ForceProblem(W=W, f=wanted, models=self.models, **(hand | options))

    def __repr__(self) -> str:
        joints = 0 if self.J is None else self.J.shape[1]
        return f"Grasp({len(self.contacts)} contacts, {joints} joints)"
