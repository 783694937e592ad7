"""A grasp: contacts, and the hand that makes them, turned into a force problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce import equations
from graspforce._util.arrays import Array, as_array, require_keywords
from graspforce.contact import (
    Contact,
    ContactModel,
    as_contacts,
    contact_starts,
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
        A: limits ``A c ≤ b`` that the hand sets besides, shape (p, m): stops that joints without
            motors lean on push only; what all motors do together at a joint has a limit of its own.
        b: shape (p,).
        motions: the motions that an object on joints has, shape (6, k), as [linear at ``origin``;
            angular]; None for one that moves freely.
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
        given, about = as_contacts(contacts), as_array(origin, "origin", (3,))
        self._set_contacts(given, about, map_about(about, given))
        warn_of_slips(self.contacts)
        if hand is not None and q is not None:
            from graspforce.hands.hand import actuation
            from graspforce.hands.imported import ImportedHand

            self._set_actuation(actuation(hand, self.contacts, q))
            self.links = hand.made_by if isinstance(hand, ImportedHand) else ()

    def _set_contacts(self, contacts: tuple[Contact, ...], origin: Array, W: Array) -> None:
        """Set checked contacts, origin and their grasp map, without a hand."""
        self.contacts, self.origin, self.W = contacts, origin, W
        self.models: tuple[ContactModel, ...] = tuple(each.model for each in contacts)
        self.J: Array | None = None
        self.tau_lo: Array | None = None
        self.tau_hi: Array | None = None
        self.tau_bias: Array | None = None
        self.joint_names: tuple[str, ...] = ()
        self.passive_rows: Array = np.zeros((0, self.W.shape[1]))
        self.passive_loads: Array = np.zeros(0)
        self.internal: Array = np.zeros((0, 0))
        self.A: Array = np.zeros((0, self.W.shape[1]))
        self.b: Array = np.zeros(0)
        self.motions: Array | None = None
        # Which contacts may squeeze without a motor, and by what to tell how hard they may.
        self._squeezing: tuple[NDArray[np.bool_], Actuation] | None = None
        self.links: tuple[str, ...] = ()
        self.notes: tuple[str, ...] = ()
        self.load: Array | None = None

    def _set_actuation(self, actuation: Actuation) -> None:
        self.joint_names, self.J = actuation.joint_names, actuation.J
        self.tau_lo, self.tau_hi = actuation.tau_lo, actuation.tau_hi
        self.tau_bias, self.internal = actuation.tau_bias, actuation.internal
        self.passive_rows, self.passive_loads = actuation.passive_rows, actuation.passive_loads
        self.A, self.b = actuation.A, actuation.b
        self.notes = actuation.notes
        if actuation.stopped.any():
            self._open_limits(actuation)
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
        W, _, _ = self._equations(np.zeros(6), None)
        return equations.undetermined(W, J)

    def _open_limits(self, actuation: Actuation) -> None:
        """Let the stops of joints with motors bear what goes beyond the motors' limits."""
        from graspforce.hands.squeezing import OPEN, bearing_stops

        W, _, _ = self._equations(np.zeros(6), None)
        sides = bearing_stops(self.contacts, W, actuation)
        more = OPEN * (actuation.tau_hi - actuation.tau_lo)
        self.tau_lo = actuation.tau_lo - more * (sides < 0)
        self.tau_hi = actuation.tau_hi + more * (sides > 0)
        closed = (actuation.stopped != 0) & (sides == 0)
        if closed.any():
            names = ", ".join(np.array(actuation.joint_names)[closed].tolist())
            self.notes += (
                f"the motors' limits hold at the stops of {names}: nothing else limits the grip",
            )

    @classmethod
    def from_mujoco(
        cls,
        model: Any,
        data: Any,
        object_body: str | int,
        fingertips: Sequence[str] | None = None,
        tau_max: float | Mapping[str, float] | None = None,
        locked: Sequence[str] = (),
        motors: Sequence[str] | None = None,
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
            locked: joints that are held whatever the contacts do to them, as by brakes.
            motors: the joints and tendons that have motors, in place of what the model says.

        Raises:
            MissingExtraError: MuJoCo is not installed.
            InvalidInputError: a name that is not there; an object that is fixed, or that
                nothing with a motor touches, nor a mocap body: the text says which fingers lack
                contact.
            ModelImportError: a joint or tendon with a motor but without a torque limit.
        """
        from graspforce.hands.mujoco.grasp import held_grasp

        return cls._imported(
            held_grasp(model, data, object_body, fingertips, tau_max, locked, motors)
        )

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
        locked: Sequence[str] = (),
        motors: Sequence[str] | None = None,
        loops: Sequence[Any] = (),
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
            locked: joints that are held whatever the contacts do to them, as by brakes.
            motors: the joints that have motors; the others turn freely, but for those that are
                locked.
            loops: constraint models that close linkages (``pinocchio.PointAnchorConstraintModel``,
                ``FrameAnchorConstraintModel``, ``RigidConstraintModel``).

        Raises:
            MissingExtraError: Pinocchio is not installed.
            InvalidInputError: a wrong shape, a frame that is not there; ``on="robot"`` with a base
                that does not float; a closed linkage that q leaves open by more than a tenth of its
                size.
            ModelImportError: no motor moves any of the links; a joint without a torque limit; two
                joints like the jaws of a gripper, without ``urdf`` or limits by name; no URDF.
        """
        from graspforce.hands.pinocchio.grasp import PinocchioGrasp

        read = PinocchioGrasp(
            model, q, contacts, links, v, origin, tau_max, urdf, on, locked, motors, loops
        )
        grasp = cls._imported(read)
        grasp.load = read.load
        return grasp

    @classmethod
    def _imported(cls, read: ImportedGrasp) -> Grasp:
        grasp = cls.__new__(cls)
        grasp._set_contacts(read.contacts, read.origin, read.W)
        grasp.motions = read.motions
        grasp._set_actuation(read.actuation)
        grasp.links, grasp.notes = read.links, (*read.notes, *grasp.notes)
        if read.from_simulator and grasp.contacts:
            from graspforce.hands.squeezing import CEILING, squeezing_contacts

            W, _, _ = grasp._equations(np.zeros(6), None)
            squeezing = squeezing_contacts(grasp.contacts, W, read.actuation)
            if squeezing.any():
                grasp._squeezing = (squeezing, read.actuation)
                who = dict.fromkeys(np.array(grasp.links)[squeezing].tolist())
                grasp.notes += (
                    f"no motor limits how hard contacts of {', '.join(who)} squeeze: without c_max "
                    f"their normal forces are kept below {CEILING:g} times what the motors reach "
                    "and f needs",
                )
        return grasp

    def problem(self, f: ArrayLike, **options: Unpack[ProblemOptions]) -> ForceProblem:
        """Return the problem of giving the object the wrench f with this grasp.

        With an underactuated hand its W and f have ``passive_rows`` and ``passive_loads``
        below the wrench; ``f_soft`` is of the wrench alone, and these rows hold. Of an object on
        joints the wrench's rows are ``motions.T @ W`` and ``motions.T @ f``. Points of one patch
        share the weight of one contact: ``cone_weight=1`` counts each of them as one.

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
        weight = self.cone_weight
        if (weight != 1).any():
            hand["cone_weight"] = weight
        wanted = as_array(f, "f", (6,))
        A, b = self._further_limits(wanted, options)
        W, wanted, soft = self._equations(wanted, options.get("f_soft"))
        own: ProblemOptions = {"f_soft": soft, "A": A, "b": b}
        return ForceProblem(W=W, f=wanted, models=self.models, **(hand | options | own))

    def _equations(self, f: Array, f_soft: ArrayLike | None) -> tuple[Array, Array, Array | None]:
        """Return W, f and f_soft of all that has to hold: the wrench, and the passive rows."""
        W, motions = self.W, self.motions
        soft = None if f_soft is None else as_array(f_soft, "f_soft", (6,), broadcast=True)
        if motions is not None:
            if soft is not None:
                # What the joints bear costs nothing. Of ½ ‖(W c − f)/f_soft‖² remains the same
                # with motions.T @ diag(f_soft²) @ motions, whose axes take the motions' place.
                squares, axes = np.linalg.eigh((motions.T * soft**2) @ motions)
                motions, soft = motions @ axes, np.sqrt(squares.clip(0.0))
            W, f = motions.T @ W, motions.T @ f
        if soft is not None:
            soft = np.append(soft, np.zeros(len(self.passive_loads)))
        return (
            np.vstack((W, self.passive_rows)), np.append(f, self.passive_loads), soft
        )  # fmt: skip

    def _further_limits(
        self, f: Array, options: ProblemOptions
    ) -> tuple[ArrayLike | None, ArrayLike | None]:
        """Return A and b: the user's, the stops', and ceilings of contacts that squeeze freely."""
        A, b = self.A, self.b
        if self._squeezing is not None and options.get("c_max") is None:
            from graspforce.hands.squeezing import ceiling

            squeezing, actuation = self._squeezing
            most = ceiling(self.contacts, self.origin, f, actuation)
            normals = np.eye(self.W.shape[1])[contact_starts(self.models)[:-1]]
            if most > 0:
                A = np.vstack((A, normals[squeezing]))
                b = np.append(b, np.full(int(squeezing.sum()), most))
        user_A, user_b = options.get("A"), options.get("b")
        if user_A is None and user_b is None:
            return (A, b) if len(A) else (None, None)
        if user_A is None or user_b is None:
            return user_A, user_b  # which ForceProblem refuses
        more = as_array(user_A, "A", ("p", self.W.shape[1]), finite=False)
        limits = as_array(user_b, "b", (len(more),), finite=False)
        return np.vstack((more, A)), np.append(limits, b)

    def __repr__(self) -> str:
        joints = 0 if self.J is None else self.J.shape[1]
        return f"Grasp({len(self.contacts)} contacts, {joints} joints)"
