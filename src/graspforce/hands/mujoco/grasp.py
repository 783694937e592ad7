"""The grasp that a MuJoCo simulation is in: contacts, W, Jacobian, bias torques, limits.

Everything is read from where ``mj_step``, ``mj_step1`` or ``mj_forward`` has left it, hence all of
one moment. The object is a body with all that hangs on it, so that a robot that stands on its feet
is one too: J is the velocity of what makes a contact relative to the object, whichever of the two
the joints move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._engine import native
from graspforce._util.arrays import Array, as_tuple
from graspforce.contact import Contact, ContactModel, as_contacts, patch_weights
from graspforce.errors import InvalidInputError, warn
from graspforce.grasp_map import map_about
from graspforce.hands.configuration import (
    Motors,
    choose_motors,
    locking_rows,
    notes_of,
    range_notes,
    stop_notes,
    undetermined_notes,
    warnings_of,
)
from graspforce.hands.hand import Actuation
from graspforce.hands.imported import as_fingertips
from graspforce.hands.limits import JointRanges, as_tau_max, has_motor, no_ranges
from graspforce.hands.loops import HOPELESS, gap_notes, largest_gap, linkages, rows_of
from graspforce.hands.mujoco.contacts import ContactReader, Indices
from graspforce.hands.mujoco.model import (
    CouplingReader,
    Drive,
    DriveReader,
    StopReader,
    as_body,
    bias_forces,
    body_of,
    compensated_by_motors,
    dof_names,
    dofs_above,
    drives,
    every_dof,
    joint_ranges,
    joints_as_drives,
    links_of,
    mocap_bodies,
    mujoco_module,
    name_of,
    taking_part,
    turning,
)
from graspforce.hands.mujoco.object import HeldObject
from graspforce.hands.stops import Stops
from graspforce.hands.transmission import (
    Transmission,
    connected_dofs,
    transmission,
)


class _Moved(NamedTuple):
    """How joints move what makes the contacts, relative to the object."""

    bodies: Indices
    """shape (n, 2)."""
    acting: Array
    """1, 0 or −1, shape (n, nv)."""
    dofs: NDArray[np.bool_]
    """Which move any, shape (nv,)."""


class _Joints(NamedTuple):
    """The joints that move the contacts, and their motors."""

    key: tuple[bytes, ...]
    """All that they follow from: what moves what, however far."""
    dofs: Indices
    drives: list[int]
    """Those of the motors, among the model's."""
    holding: list[int]
    """The others, whose motors hold still."""
    motors: Motors[Drive]


class _Hand(NamedTuple):
    """The joints that move the contacts, and how the motors move these joints."""

    key: tuple[bytes, ...]
    """All that it was made from."""
    joints: _Joints
    moments: Array
    """Motion of each drive of the model by joint motion, shape (n_drives, nv)."""
    couplings: Array
    """Gradients of the active equalities between joints, shape (p, nv)."""
    stops: Stops
    transmission: Transmission
    ranges: JointRanges

    @property
    def dofs(self) -> Indices:
        """The degrees of freedom."""
        return self.joints.dofs

    @property
    def motors(self) -> Motors[Drive]:
        """The motors."""
        return self.joints.motors


class MujocoGrasp:
    """The grasp that a MuJoCo simulation is in, read anew in every tick of a loop.

    What does not change is looked up once: which bodies and geoms are the object's, which joints
    move which body, motors and their limits. :meth:`update` reads what moves; the attributes are
    then those of a :class:`graspforce.Grasp` that is read from the same data::

        reader = gf.hands.MujocoGrasp(model, data, "cube", joints=grasp.joint_names)
        reader.update(data)
        solution = servo.step(W=reader.W, J=reader.J, tau_bias=reader.tau_bias)

    Masses, gravity, friction, joint positions, equalities that are switched on or off: all that
    MuJoCo computes anew counts from the next update on. After a change of limits, gears or the
    tree of bodies make a new reader.

    Args:
        model: the ``mujoco.MjModel``.
        data: its ``mujoco.MjData``, after ``mj_step``, ``mj_step1`` or ``mj_forward``; it is read
            once, as by :meth:`update`.
        object_body: name or number of the object's body. What hangs on it belongs to it: with the
            trunk of a robot on its feet the ground's contacts carry the robot.
        joints: joints and tendons with motors, in the order of tau; the other motors are taken to
            hold their joints still. By default, those that move what touches, which change as
            contacts come and go.
        tau_max: torque limits in place of the model's, both ways unless the model's motor acts one
            way only: one number for all, or by name [N·m; N for slides and tendons]. A joint
            without a motor that it names gets one; where the model has no motors, one number
            makes motors of all hinges and slides that follow no other joint and are not the
            object's.
        locked: joints that are held whatever the contacts do to them, as by brakes.
        motors: the joints and tendons that have motors, in place of what the model says.

    Attributes:
        origin: the object's centre of mass, about which torques are taken, shape (3,) [m].
        W: grasp map, shape (6, m), world axes.
        J: hand Jacobian in contact frames, shape (m, n_joints).
        joint_names: the n_joints joints and tendons.
        tau_lo: lower torque limits, shape (n_joints,) [N·m; N for slides and tendons].
        tau_hi: upper torque limits, likewise.
        tau_bias: the torques at which the joints do not accelerate while nothing touches:
            gravity, Coriolis forces, and what springs, dampers and fluids do to the joints.
        passive_rows: virtual work of c over the motions that no motor moves, shape (k, m).
        passive_loads: what it has to be, shape (k,).
        internal: forces of the motors that balance among themselves, shape (r, n_joints), where
            they are more than the motions; it changes with the moment arms, as J does.
        A: limits ``A c ≤ b`` of the hand besides, shape (p, m): of stops that joints lean on and
            that only push, and of joints whose torque by all motors together the file limits.
        b: shape (p,).
        motions: the motions that the object's own joints leave it, shape (6, k), as
            [linear at ``origin``; angular]; None where it moves freely, or motors carry it.

    Raises:
        MissingExtraError: MuJoCo is not installed.
        InvalidInputError: a name that is not there; an object that is fixed; a closed linkage that
            is open; as :meth:`update`.
        ModelImportError: a joint or tendon with a motor but without a torque limit.

    Warns:
        GraspForceWarning: implausible limits, motions that no motor controls, contacts that are
            left out; later updates only note them.
    """

    origin: Array
    motions: Array | None
    from_simulator = True

    def __init__(
        self,
        model: Any,
        data: Any,
        object_body: str | int,
        joints: Sequence[str] | None = None,
        tau_max: float | Mapping[str, float] | None = None,
        locked: Sequence[str] = (),
        motors: Sequence[str] | None = None,
    ) -> None:
        mj = mujoco_module()
        if not isinstance(model, mj.MjModel):
            raise InvalidInputError(
                f"model: got a {type(model).__name__}, expected an mujoco.MjModel"
            )
        self._model = model
        self._object = HeldObject(model, object_body)
        inside = self._object.inside
        self._drives, self._motor_notes = drives(model)
        self._drives += joints_as_drives(model, self._drives, tau_max, motors, inside)
        if motors is not None:
            self._drives = [each for each in self._drives if each.limit.name in motors]
        self._motors, self._locked = motors, as_tuple(locked, "locked", str)
        self._held = locking_rows(self._locked, dof_names(model, every_dof(model)))
        self._stops, self._turns = StopReader(model), turning(model)
        self._any_range = bool(model.jnt_actfrclimited.any())
        self._couplings, self._moments = CouplingReader(model), DriveReader(model, self._drives)
        self._chosen = None if joints is None else _indices(joints, self._drives)
        self._given = as_tau_max(tau_max, [each.limit.name for each in self._drives])
        self._by_motor = compensated_by_motors(model)
        above = dofs_above(model)
        # How a body at a contact moves relative to the object, per joint rate: as it does, or if
        # it belongs to the object, as the object does relative to it.
        self._acting = above.astype(float)
        self._acting[inside] = -1.0 * (above[inside] & ~self._object.carrying)
        self._above = above
        self._reader = ContactReader(model, inside)
        self._hand: _Hand | None = None
        self._moved: _Moved | None = None
        self.update(data)
        warn(*self._warnings())

    def update(self, data: Any) -> None:
        """Read the grasp that the data are in.

        Args:
            data: ``mujoco.MjData`` of the model, after ``mj_step``, ``mj_step1`` or ``mj_forward``.

        Raises:
            InvalidInputError: data of another model, or in which nothing is computed yet, or in
                which a closed linkage is open by more than a tenth of its size.
            ModelImportError: another joint has come to take part, which has no torque limit.
        """
        model = self._model
        _require_data(data, model)
        moments = self._moments.read(data)
        tied = self._couplings.read(data)
        computed = data.xquat[self._object.top].any() and (moments.any() or not self._drives)
        if not computed:
            raise InvalidInputError(
                "data: nothing is computed in it yet, expected data after mj_step or mj_forward"
            )
        rows, open_by = rows_of(tied, self._turns)
        if open_by > HOPELESS:
            gap = largest_gap(linkages(tied, self._turns))
            raise InvalidInputError(
                f"data: the closed linkage of {' and '.join(gap.between)} is open by "
                f"{1000 * gap.metres:.3g} mm, expected it closed: step the simulation until it is, "
                "or let hands.from_mjcf close it"
            )
        contacts = self._reader.read(data, moments)
        moved = self._moved_at(contacts.bodies)
        coupled = np.concatenate((rows, self._held)) if len(rows) else self._held
        stops = self._stops.read(data)
        hand = self._hand_of(moved.dofs, moments, coupled, stops)
        self._contacts, self._hand, self._moved = contacts, hand, moved
        self._screws = self._object.screws(data, hand.dofs)
        self._bias = bias_forces(data, self._by_motor)[hand.dofs]
        self._tied = tied
        self._maps: tuple[Array, Actuation] | None = None
        self.origin = self._object.centre(data)
        self.motions = self._object.motions(data, moments, coupled)

    @property
    def W(self) -> Array:
        """Grasp map, shape (6, m), world axes."""
        return self._made[0]

    @property
    def actuation(self) -> Actuation:
        """What the joints bring into the force problem."""
        return self._made[1]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The n_joints joints and tendons."""
        return self._found.motors.joint_names

    @property
    def J(self) -> Array:
        """Hand Jacobian in contact frames, shape (m, n_joints)."""
        return self.actuation.J

    @property
    def tau_lo(self) -> Array:
        """Lower torque limits, shape (n_joints,)."""
        return self._found.motors.tau_lo

    @property
    def tau_hi(self) -> Array:
        """Upper torque limits, shape (n_joints,)."""
        return self._found.motors.tau_hi

    @property
    def tau_bias(self) -> Array:
        """The torques at which the joints do not accelerate, shape (n_joints,)."""
        return self.actuation.tau_bias

    @property
    def passive_rows(self) -> Array:
        """Virtual work of c over the motions that no motor moves, shape (k, m)."""
        return self.actuation.passive_rows

    @property
    def passive_loads(self) -> Array:
        """What it has to be, shape (k,)."""
        return self.actuation.passive_loads

    @property
    def internal(self) -> Array:
        """Forces of the motors that balance among themselves, shape (r, n_joints)."""
        return self._found.transmission.internal

    @property
    def A(self) -> Array:
        """Limits ``A c ≤ b`` of stops and of joints' torques by all motors, shape (p, m)."""
        return self.actuation.A

    @property
    def b(self) -> Array:
        """Their right-hand sides, shape (p,)."""
        return self.actuation.b

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The object's active contacts, in the order of ``data.contact``."""
        return self._contacts.contacts

    @property
    def models(self) -> tuple[ContactModel, ...]:
        """The contacts' models: the cone that lies within MuJoCo's."""
        return self._contacts.models

    @property
    def links(self) -> tuple[str, ...]:
        """The body that makes each contact; the object's own where only that is moved by joints."""
        body = mujoco_module().mjtObj.mjOBJ_BODY
        maker, own = self._contacts.bodies[:, 0], self._contacts.bodies[:, 1]
        moved: NDArray[np.bool_] = np.any(self._acting != 0, axis=1)
        only_own = moved[own] & ~moved[maker]
        made_by: Indices = np.where(only_own, own, maker)
        return tuple(name_of(self._model, body, each) for each in made_by.tolist())

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader found that a user should know, a sentence each."""
        mj = mujoco_module()
        hand = self._found
        notes = [
            *self._warnings(),
            *notes_of(
                hand.motors,
                hand.transmission,
                dof_names(self._model, hand.dofs),
                self._locked,
                self._model.dof_frictionloss[hand.dofs],
            ),
            *self._motor_notes,
            *stop_notes(hand.stops, hand.transmission),
            *range_notes(hand.ranges, hand.transmission),
            *self._object.notes(hand.moments, self.motions),
        ]
        notes += gap_notes(largest_gap(linkages(self._tied, self._turns)))
        absent = self.fingers_without_contact()
        if absent:
            notes.append(f"not in contact with {self.object_name!r}: {', '.join(absent)}")
        if int(self._model.opt.cone) == int(mj.mjtCone.mjCONE_PYRAMIDAL):
            notes.append(
                "the simulation's friction pyramids lie inside the exact cones of the grasp"
            )
        W = self.W if self.motions is None else self.motions.T @ self.W
        return (*notes, *undetermined_notes(W, self.passive_rows, self.J))

    @property
    def object_name(self) -> str:
        """The name of the object's body."""
        return self._object.name

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Which bodies make up the object, shape (nbody,)."""
        return self._object.inside

    @property
    def pull(self) -> Array:
        """What adhesion holds each contact with as it is controlled now, shape (n,) [N]."""
        return self._contacts.pull

    @property
    def geoms(self) -> Indices:
        """The geoms at each contact: what makes it, and the object's, shape (n, 2)."""
        return self._contacts.geoms

    @property
    def bodies(self) -> Indices:
        """The number of the body that makes each contact, shape (n,)."""
        return self._contacts.bodies[:, 0]

    @property
    def dims(self) -> Indices:
        """How many components of c each contact has, shape (n,)."""
        return self._contacts.dims

    @property
    def points(self) -> Array:
        """The contacts' points, shape (n, 3) [m]."""
        return self._contacts.points

    @property
    def normals(self) -> Array:
        """The contacts' unit normals into the object, shape (n, 3)."""
        return self._contacts.axes[:, 0].copy()

    @property
    def cone_weight(self) -> Array:
        """Weights of the cones, shape (n,): points of one patch share 1, as in a Grasp."""
        return patch_weights(self.normals, self.links)

    def jacobian(self, contacts: Sequence[Contact], links: Sequence[str | int]) -> Array:
        """Return J of contacts that do not come from MuJoCo: measured or planned ones.

        Args:
            contacts: n contacts, in the world's axes.
            links: for each the body that makes it, or of the object the body that it is on, by
                name or number.

        Returns:
            shape (m, n_joints), in the contact frames.

        Raises:
            InvalidInputError: something that is no contact, another number of links, a name that
                is not there; a link of other joints than those that move what touches, where
                these were not given.
        """
        given, hand = as_contacts(contacts), self._found
        if len(links) != len(given):
            raise InvalidInputError(
                f"links: got {len(links)}, expected {len(given)}, one a contact"
            )
        bodies = [as_body(self._model, link, "links") for link in links]
        if self._chosen is None:
            elsewhere = np.delete(self._acting[bodies], hand.dofs, axis=1).any(axis=1)
            for link in np.array(links)[elsewhere].tolist():
                raise InvalidInputError(
                    f"links: {link!r} is moved by other joints than those that move what touches; "
                    "expected a MujocoGrasp with joints=…"
                )
        full = map_about(self.origin, given).T @ self._screws.T
        dims = [contact.model.dim for contact in given]
        full *= np.repeat(self._acting[bodies][:, hand.dofs], dims, axis=0)
        return full @ hand.transmission.driven

    def maps(
        self, points: Array, axes: Array, dims: Indices, bodies: Indices
    ) -> tuple[Array, Actuation]:
        """Return W, and what the joints bring in, of contacts as arrays.

        Args:
            points: n of them, world axes, shape (n, 3) [m].
            axes: rows normal, x, y, world axes, shape (n, 3, 3).
            dims: components of each, 1, 3 or 4, shape (n,).
            bodies: the number of the body that makes each, shape (n,).

        Returns:
            W, shape (6, m), and J, bias torques, passive rows and stops. Nothing is checked.
        """
        return self._maps_of(points, axes, dims, self._acting[bodies])

    @property
    def friction(self) -> tuple[Array, Array]:
        """The contacts' coefficients mu and gamma, each shape (n,)."""
        return self._contacts.mu, self._contacts.gamma

    def moved_by(self, bodies: Indices) -> NDArray[np.bool_]:
        """Return which degrees of freedom move each of the bodies, shape (k, nv)."""
        return self._acting[bodies] != 0

    @property
    def motion(self) -> tuple[Indices, Array]:
        """Joints and how the motors move them: k degrees of freedom, and shape (k, n_joints)."""
        hand = self._found
        return hand.dofs, hand.transmission.driven

    def contact_forces(self, data: Any) -> Array:
        """Return the contact forces of the physics, shape (m,): what came of the forces asked for.

        Args:
            data: as last read by :meth:`update`; where that was after ``mj_step1``, then stepped
                by ``mj_step2``, which computes the forces.
        """
        return self._contacts.forces(self._model, data)

    def forces_world(self, data: Any) -> Array:
        """Return them as forces on the object in the world's axes, shape (n, 3) [N]."""
        ends = np.cumsum(self.dims)
        forces = self.W[:3] * self.contact_forces(data)
        return (
            np.add.reduceat(forces, ends - self.dims, axis=1).T if len(ends) else np.zeros((0, 3))
        )

    def joints_without_motor(self) -> tuple[str, ...]:
        """Return the joints that move what touches where no motor moves any of them."""
        return () if self.joint_names else dof_names(self._model, self._found.dofs)

    def fingers_without_contact(self) -> list[str]:
        """Return the last bodies of chains that motors move, as far as they lack contact."""
        model, hand = self._model, self._found
        driven = np.zeros(model.nv, dtype=bool)
        driven[connected_dofs(np.any(hand.moments != 0, axis=0), hand.couplings)] = True
        fingers = (self._above & driven).any(axis=1) & ~self._touching()
        fingers[model.body_parentid] = False
        # The links of a closed linkage are one finger.
        for each in self._tied:
            linkage = (self._above & each.rows.any(axis=0)).any(axis=1)
            if each.kind == "place" and (linkage & self._touching()).any():
                fingers &= ~linkage
        body = mujoco_module().mjtObj.mjOBJ_BODY
        return [name_of(model, body, each) for each in np.flatnonzero(fingers).tolist()]

    def touched_by_mocap(self) -> bool:
        """Return whether a mocap body, whose motion is prescribed, makes a contact."""
        prescribed: NDArray[np.bool_] = mocap_bodies(self._model)[self._contacts.bodies[:, 0]]
        return bool(prescribed.any())

    def require_contact(self, fingertips: Sequence[str]) -> None:
        """Raise unless each of the fingertips, bodies or sites, touches the object.

        Raises:
            InvalidInputError: one does not, or is not there.
        """
        touching = self._touching()
        tips = as_fingertips(fingertips, links_of(self._model))
        absent = [tip for tip in tips if not touching[body_of(self._model, tip)]]
        if absent:
            raise InvalidInputError(
                f"data: {', '.join(absent)} not in contact with {self.object_name!r}, expected all "
                f"of the fingertips {', '.join(tips)} to be"
            )

    # ---- what update is made of ----------------------------------------------------------------

    @property
    def _found(self) -> _Hand:
        assert self._hand is not None  # the constructor updates
        return self._hand

    @property
    def _made(self) -> tuple[Array, Actuation]:
        """W and what the joints bring in, made when first asked for: a loop asks for its slots'."""
        if self._maps is None:
            seen, moved = self._contacts, self._moved_at(self._contacts.bodies)
            self._maps = self._maps_of(seen.points, seen.axes, seen.dims, moved.acting)
        return self._maps

    def _maps_of(
        self, points: Array, axes: Array, dims: Indices, moved: Array
    ) -> tuple[Array, Actuation]:
        """Return what :meth:`maps` does, of contacts that the joints move as ``moved``, (n, nv)."""
        hand = self._found
        W, full = native.module.contact_maps(
            points, axes, dims, self.origin, self._screws, moved, hand.dofs
        )
        return W, hand.motors.actuation(hand.transmission, hand.ranges, full, self._bias)

    def _touching(self) -> NDArray[np.bool_]:
        """Return which bodies, with all that is fixed to them, are at a contact, shape (nbody,)."""
        weld = self._model.body_weldid
        touching = np.zeros(self._model.nbody, dtype=bool)
        touching[weld[self._contacts.bodies]] = True
        return touching[weld]

    def _warnings(self) -> tuple[str, ...]:
        hand, body = self._found, mujoco_module().mjtObj.mjOBJ_BODY
        return (
            *(
                "a contact with a deformable body is left out"
                if each < 0
                else f"the contact with {name_of(self._model, body, each)!r} is left out: that "
                "body is loose itself"
                for each in dict.fromkeys(self._contacts.left_out.tolist())
            ),
            *warnings_of(hand.motors, hand.transmission, dof_names(self._model, hand.dofs)),
        )

    def _moved_at(self, bodies: Indices) -> _Moved:
        """Return how joints move the contacts of ``bodies``; the last ones' if these are they."""
        if self._moved is not None and self._moved.bodies is bodies:
            return self._moved
        acting = self._acting[bodies].sum(axis=1)
        return _Moved(bodies, acting, np.any(acting != 0, axis=0))

    def _hand_of(
        self, moving: NDArray[np.bool_], moments: Array, couplings: Array, stops: Stops
    ) -> _Hand:
        """Return the hand that moves the degrees of freedom ``moving``; the last one if it does.

        Whatever it is made from is compared bit by bit, so that a hand whose moment arms change
        is made anew, and one with a motor a joint stays.
        """
        key = tuple(each.tobytes() for each in (moving, moments, couplings, stops.rows))
        if self._hand is not None and key == self._hand.key:
            return self._hand
        joints = self._joints_of(moving, moments, couplings)
        leaned, dofs = stops.on(joints.dofs, self._held), joints.dofs
        coupled = np.concatenate((couplings, moments[joints.holding]))
        rows = moments[joints.drives]
        moved = transmission(rows[:, dofs], coupled[:, dofs], leaned.rows)
        ranges = no_ranges(len(rows))
        if self._any_range:
            loose = dofs[~self._held[:, dofs].any(axis=0)]
            ranges = joint_ranges(self._model, joints.motors.drives, rows, loose)
        return _Hand(key, joints, moments, couplings, leaned, moved, ranges)

    def _joints_of(self, moving: NDArray[np.bool_], moments: Array, couplings: Array) -> _Joints:
        """Return the joints that move what ``moving`` do; the last ones where all is as then."""
        key = tuple(each.tobytes() for each in (moving, moments != 0, couplings != 0))
        if self._hand is not None and key == self._hand.joints.key:
            return self._hand.joints
        chosen, holding = self._chosen, list[int]()
        if chosen is not None:
            moving = moving | np.any(moments[chosen] != 0, axis=0)
            holding = [
                i
                for i, drive in enumerate(self._drives)
                if i not in chosen and has_motor(drive.limit, self._given)
            ]
        dofs = connected_dofs(moving, np.vstack((moments, couplings)))
        if chosen is None:
            chosen = taking_part(moments * ~self._held.any(axis=0), dofs)
        acting = [self._drives[i] for i in chosen]
        names = {each.limit.name for each in acting}
        given = {name: size for name, size in self._given.items() if name in names}
        motors = choose_motors(acting, given, self._motors)
        drives = [self._drives.index(each) for each in motors.drives]
        return _Joints(key, dofs, drives, holding, motors)


def held_grasp(
    model: Any,
    data: Any,
    object_body: str | int,
    fingertips: Sequence[str] | None,
    tau_max: float | Mapping[str, float] | None,
    locked: Sequence[str],
    motors: Sequence[str] | None,
) -> MujocoGrasp:
    """Return the grasp of an object that fingers hold; see :meth:`graspforce.Grasp.from_mujoco`.

    Raises:
        InvalidInputError: as :class:`MujocoGrasp`; no finger touches, or not all ``fingertips``.
    """
    grasp = MujocoGrasp(model, data, object_body, tau_max=tau_max, locked=locked, motors=motors)
    if fingertips is not None:
        grasp.require_contact(fingertips)
    if not grasp.joint_names and not grasp.touched_by_mocap():
        touching = ", ".join(dict.fromkeys(grasp.links)) or "nothing"
        without = grasp.joints_without_motor()
        way_out = f"; tau_max gives motors to joints: {', '.join(without)}" if without else ""
        absent = ", ".join(grasp.fingers_without_contact()) or "none, as no motor moves any body"
        raise InvalidInputError(
            f"data: got {touching} in contact with {grasp.object_name!r} (read after mj_step or "
            f"mj_forward), expected something that a motor moves{way_out}; fingers without "
            f"contact: {absent}"
        )
    return grasp


def _indices(joints: Sequence[str], candidates: Sequence[Drive]) -> list[int]:
    """Return which of the drives have the names ``joints``, in their order."""
    joints = as_tuple(joints, "joints", str)
    names = [drive.limit.name for drive in candidates]
    for name in joints:
        if name not in names or joints.count(name) > 1:
            problem = "twice" if name in names else "which has no motor"
            raise InvalidInputError(
                f"joints: got {name!r}{' ' if name in names else ', '}{problem}, expected each "
                f"once of {', '.join(names)}"
            )
    return [names.index(name) for name in joints]


def _require_data(data: Any, model: Any) -> None:
    """Raise unless ``data`` belongs to ``model`` or to a copy of it."""
    if not isinstance(data, mujoco_module().MjData):
        raise InvalidInputError(f"data: got a {type(data).__name__}, expected an mujoco.MjData")
    if data.signature != model.signature:
        raise InvalidInputError("data: of another model than ``model``, expected data of this one")
