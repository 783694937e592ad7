"""The control law for any hand: whatever touches the object holds it, with all motors there are.

Every tick,

1. :class:`graspforce.control.ObjectLaw`, of the object's pose, gives the wrench f;
2. what touches is matched to slots of a fixed number (:class:`graspforce.control.ContactBook`),
   and the reader (:class:`graspforce.hands.MujocoGrasp`) gives W and J at the slots' places;
3. the servo distributes f over the slots, whose forces change no faster than ``force_rate``;
4. the motors are sent what makes J.T c plus what the joints need for themselves
   (:class:`graspforce.hands.MujocoMotors`): gravity and Coriolis torques, and the torques that move
   the joints' own inertia so that every contact goes along with the object and the rest returns
   to its posture.

The last is one problem for hand and arm: of all joint accelerations that move the contacts as the
object's material moves there, the one nearest, in the metric of the inertia, to a PD law on the
posture. Fingers that can follow the object do, and the arm rests; jaws that cannot are carried by
the arm. A joint counts the heavier, the nearer it is to an end of its range, so that the arm takes
over before a finger is stopped. Joints that move nothing that touches are held by the posture law
alone.

W c = f may be missed by a hundredth of the weight: two points that cannot twist the object, or a
load beyond what the hand can hold, then leave the nearest there is. Where a tick has no answer all
the same, the last good torques stay.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np

from graspforce._engine import native
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_positive
from graspforce.answers import firmness
from graspforce.contact import ContactModel, model_of
from graspforce.control import ContactBook, ObjectLaw, ObjectState
from graspforce.errors import GraspForceWarning, InvalidInputError, ModelImportError
from graspforce.hands.hand import Actuation
from graspforce.hands.mujoco.contacts import Indices
from graspforce.hands.mujoco.grasp import MujocoGrasp
from graspforce.hands.mujoco.model import moved_by
from graspforce.hands.mujoco.motors import MujocoMotors
from graspforce.problem import ForceProblem
from graspforce.servo import Servo
from graspforce.sim.mujoco_import import mj
from graspforce.sim.trial import Gains
from graspforce.sim.world import object_inertia, object_pose
from graspforce.solution import Solution
from graspforce.trajectory import GRAVITY, Hold, Motion

# Without other wishes: the largest normal force is this many times the least possible one, and no
# contact pushes with more than so many times the object's weight.
TIMES_LEAST = 2.0
CEILING = 20.0
# By which share of the weight W c = f may be missed.
_SOFTNESS = 0.01
# How many times that share, of its torque about the object, the forces may miss what no motor
# controls, as joints of a tendon with springs: it gives way until it is in balance.
_GIVING_WAY = 30.0
# Upper bound on the effective mass at a contact: towards where hand and arm can hardly go [kg].
_MAX_INERTIA = 1e4
# In which share of its range a joint nears an end.
_NEAR_END = 0.15
# How many contacts a link has room for that is no ball: what touches of a face comes and goes.
_FACE_SLOTS = 4
# How many contacts there is room for that come late, of links that do not touch at the start.
_SPARE_SLOTS = 4


class Seen(NamedTuple):
    """The contacts that a tick sees, k of them."""

    points: Array
    """shape (k, 3) [m]."""
    normals: Array
    """Into the object, shape (k, 3)."""
    bodies: Indices
    """What makes each."""
    mu: Array
    gamma: Array


class HandCommand(NamedTuple):
    """What one control tick decided."""

    tau: Array
    """What the motors are to give, in the order of ``joint_names``, shape (n_joints,)."""
    f: Array
    """The wrench that the object was to get, about its centre of mass, shape (6,) [N, N·m]."""
    solution: Solution
    kept: bool
    """Whether the tick found no forces, not even for the nearest wrench; ``tau`` is older then."""
    without_slot: int
    """How many contacts came late and found no slot free: they are not counted on."""


class HandLoop:
    """Holds and moves an object in a MuJoCo simulation, with whatever hand touches it.

    Take the data with the object between the fingers (:func:`graspforce.sim.close`), and in every
    tick let it write the controls::

        loop = sim.HandLoop(model, data, "cube")
        while data.time < 2:
            mujoco.mj_step1(model, data)
            loop.step(data.time)
            mujoco.mj_step2(model, data)

    Args:
        model: the ``mujoco.MjModel``.
        data: its ``mujoco.MjData``, after ``mj_step1`` or ``mj_forward``, fingers in contact.
        body: the object's name.
        motion: of the object's centre of mass, and its turn about the vertical from how it is
            now; by default it stays.
        mu: the coefficient of friction to count on [-]; by default what the model says of each
            contact.
        alpha: weight of the linear limits; by default that of a grip with twice the least force.
        c_max: ceiling of every normal force [N]; by default 20 times the object's weight.
        gains: of the control law.
        rate: ticks a second; by default one each step of the simulation [Hz].
        tau_max: torque limits besides the model's: one number for all, or by name [N·m; N].

    Attributes:
        reader: the grasp as of the last tick.
        motors: what is sent to the model's actuators.
        book: the slots of the contacts.
        joint_names: the joints and tendons with motors, the order of tau.
        holding: which of them move what touches, shape (n_joints,).
        alpha: weight of the linear limits.
        tau_lo: torque limits as the joints are, shape (n_joints,) [N·m; N].
        tau_hi: likewise.

    Raises:
        InvalidInputError: nothing that a motor moves touches the object; ticks too long for the
            gains; a name that is not there.
        ModelImportError: an actuator of a kind, or without a limit, that no torque can be sent to.
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        body: str,
        motion: Motion | None = None,
        *,
        mu: float | None = None,
        alpha: float | None = None,
        c_max: float | None = None,
        gains: Gains | None = None,
        rate: float | None = None,
        tau_max: float | Mapping[str, float] | None = None,
    ) -> None:
        self._model, self._data = model, data
        self.motors = MujocoMotors(model, tau_max=tau_max)
        self.joint_names = self.motors.joint_names
        self.tau_lo, self.tau_hi = self.motors.limits(data)
        self.reader = quiet_reader(model, data, body, self.motors)
        self._gains = Gains() if gains is None else gains
        self._dt = 1 / (1 / model.opt.timestep if rate is None else as_positive(rate, "rate", "Hz"))
        self._gains.require_ticks(self._dt)
        self._body = int(model.body(body).id)
        pose = object_pose(model, data, self._body)
        where: Any = pose.position.tolist()
        self._motion: Motion = Hold(where) if motion is None else motion
        inertia = pose.rotation.T @ object_inertia(model, data, self._body) @ pose.rotation
        self._law = ObjectLaw(
            float(model.body_subtreemass[self._body]), inertia, turned=pose.rotation,
            stiffness=self._gains.object_stiffness, damping=self._gains.object_damping,
        )  # fmt: skip
        weight = self._law.mass * (float(np.linalg.norm(model.opt.gravity)) or GRAVITY)
        self._c_max = CEILING * weight if c_max is None else as_positive(c_max, "c_max", "N")
        self._mu = mu if mu is None else as_positive(mu, "mu", "")
        self._lengths = self.motors.lengths(data)
        kinds = mj.mjtIntegrator
        self._implicit = (int(kinds.mjINT_IMPLICIT), int(kinds.mjINT_IMPLICITFAST))
        self._mass_matrix = np.zeros((model.nv, model.nv))
        self._joints = self._robot_motion(model, data)
        seen = self.seen()
        if not len(seen.points):
            raise InvalidInputError(
                f"data: nothing touches {body!r}, expected fingers in contact: see sim.close"
            )
        self._looked_at: tuple[Hashable | None, ...] = ()  # links of the slots, and their bodies
        self._bodies: Indices = np.zeros(0, dtype=np.intp)
        self._columns: slice | Indices = slice(None)  # of the joints that hold
        self._open_book(seen, pose)
        arm = float(np.linalg.norm(seen.points - pose.position, axis=1).max())
        self._soft = softness(weight, arm)
        self.alpha = alpha
        self._servo: Servo | None = None
        self._shape: tuple[int, ...] = ()
        self._c: Array | None = None
        self._tau = self.first_torques()

    # ---- a tick --------------------------------------------------------------------------------

    def step(self, t: float) -> HandCommand:
        """Measure, decide and write the controls of the tick at time t [s].

        The data have to be as ``mj_step1`` or ``mj_forward`` leaves them.
        """
        self.read()
        command = self.decide(t, object_pose(self._model, self._data, self._body), self.seen())
        self.write(command.tau)
        return command

    def read(self) -> None:
        """Read the simulation as it stands."""
        self.reader.update(self._data)
        self.tau_lo, self.tau_hi = self.motors.limits(self._data)

    def seen(self) -> Seen:
        """Return the contacts that the simulation lists."""
        reader = self.reader
        return Seen(reader.points, reader.normals, reader.bodies, *reader.friction)

    def write(self, tau: Array, *, at_once: bool = False) -> None:
        """Send torques to the motors."""
        self.motors.send(self._data, tau, self._dt, at_once=at_once)

    def decide(self, t: float, pose: ObjectState, seen: Seen) -> HandCommand:
        """Return the torques of the tick at time t [s] from what is measured.

        Args:
            t: [s].
            pose: of the object.
            seen: what touches.
        """
        acceleration = self._law.acceleration(self._motion.at(t), pose)
        f = self._law.wrench(acceleration, pose, self._model.opt.gravity)
        self.book.update(
            seen.points, seen.normals, seen.bodies.tolist(), self._dt, pose.position, pose.rotation
        )
        self._look_at_links()
        self._count_on(seen)
        W, hand = self.reader.maps(self.book.points, self.book.axes, self._dims, self._bodies)
        bias = hand.tau_bias + self._own_torques(acceleration, pose, hand.J)
        solution = self._distribute(f, W, hand, bias)
        kept = solution.status is not Status.SOLVED and not solution.nearest
        if not kept:
            self._c = solution.c
            self._tau = self._motor_forces(hand, bias, solution)
        within = self._tau.clip(self.tau_lo, self.tau_hi)
        return HandCommand(within, f, solution, kept, self.book.without_slot)

    def target(self, t: float) -> tuple[Array, Array]:
        """Return where the object should be at time t [s], and how turned."""
        state = self._motion.at(t)
        return state.position, state.rotation @ self._law.turned

    @property
    def links(self) -> tuple[str, ...]:
        """The body that makes the contact of each slot; "" for a spare one not taken yet."""
        return tuple(
            "" if link is None else self._model.body(link).name for link in self.book.links
        )

    # ---- what it holds with --------------------------------------------------------------------

    def _open_book(self, seen: Seen, pose: ObjectState) -> None:
        """Make slots for what touches, and see which motors move it."""
        balls = (int(mj.mjtGeom.mjGEOM_SPHERE), int(mj.mjtGeom.mjGEOM_ELLIPSOID))
        faces = ~np.isin(self._model.geom_type[self.reader.geoms[:, 0]], balls)
        slots: dict[Hashable, int] = {}
        for body in dict.fromkeys(seen.bodies.tolist()):
            of_body = seen.bodies == body
            least = _FACE_SLOTS if faces[of_body].any() else 1
            slots[body] = max(int(of_body.sum()), least)
        # A force falls with its ceiling: the ramp leaves it the time that its rate needs.
        ramp = max(1.2 * self._c_max / self._gains.force_rate, self._dt)
        self.book = ContactBook(dict(slots), spare=_SPARE_SLOTS, ramp=ramp)
        dims = dict(zip(seen.bodies.tolist(), self.reader.dims.tolist(), strict=True))
        most = max(dims.values())
        self._dims = np.array([dims.get(link, most) for link in self.book.links])
        self._slot_mu, self._slot_gamma = np.ones(len(self._dims)), np.ones(len(self._dims))
        self._look_at_links()
        for body in slots:
            of_body = self._bodies == body
            self._slot_mu[of_body] = seen.mu[seen.bodies == body].min()
            self._slot_gamma[of_body] = max(seen.gamma[seen.bodies == body].min(), 1e-6)
        self.book.update(
            seen.points, seen.normals, seen.bodies.tolist(), self._dt, pose.position, pose.rotation
        )
        self._look_at_links()
        if not self.holding.any():
            touching = ", ".join(dict.fromkeys(filter(None, self.links)))
            raise InvalidInputError(
                f"data: got {touching} in contact with {self.reader.object_name!r}, expected "
                "something that a motor moves"
            )

    def _look_at_links(self) -> None:
        """See what makes the contacts of the slots now, and which motors move any of that."""
        if self.book.links == self._looked_at:
            return
        self._looked_at = self.book.links
        # What has not been taken is the world's, which nothing moves.
        links: Indices = np.array([link or 0 for link in self._looked_at], dtype=np.intp)
        self._bodies = links
        dofs, driven = self.reader.motion
        moved = self.reader.moved_by(links)[:, dofs].any(axis=0)
        self.holding = (driven[moved] != 0).any(axis=0)
        for row in self.reader.internal != 0:
            self.holding |= row & (row & self.holding).any()
        # Mostly all of them do, and views are then enough.
        self._columns = slice(None) if self.holding.all() else np.flatnonzero(self.holding)

    def _models(self) -> tuple[ContactModel, ...]:
        arrays = (self._dims, self._slot_mu, self._slot_gamma)
        return tuple(
            model_of(*each) for each in zip(*(array.tolist() for array in arrays), strict=True)
        )

    def _count_on(self, seen: Seen) -> None:
        """Take the friction of what touches, as far as none was given."""
        slots = self.book.slots
        found = slots >= 0
        if self._mu is None:
            self._slot_mu[slots[found]] = seen.mu[found]
        else:
            self._slot_mu[:] = self._mu
        self._slot_gamma[slots[found]] = np.maximum(seen.gamma[found], 1e-6)

    def first_torques(self) -> Array:
        """Return the torques that make the contact forces of the simulation as it stands."""
        given = self.reader.J.T @ self.reader.contact_forces(self._data)
        return np.clip(given + self.reader.tau_bias, self.tau_lo, self.tau_hi)

    # ---- the law -------------------------------------------------------------------------------

    def _own_torques(self, acceleration: Array, pose: ObjectState, J: Array) -> Array:
        """Return the torques that move the joints' own inertia, shape (n_joints,)."""
        gains, data, book = self._gains, self._data, self.book
        off = self.motors.lengths(data) - self._lengths
        posture = -gains.posture_stiffness * off - gains.posture_damping * self.motors.rates(data)
        wanted = np.zeros(len(J))
        if gains.feed_forward:
            wanted = self._joints.follow(
                book.points, book.axes, self._dims, self._bodies, pose.position,
                pose.angular_velocity, acceleration,
            )  # fmt: skip
        # A contact that lets go counts less and less.
        share = np.repeat(book.engagement, self._dims)
        inertia, metric = self._inertia_of_motors(*self.reader.motion)
        return inertia @ native.module.nearest_motion(
            metric, J, wanted, share, 1 / _MAX_INERTIA, posture
        )

    def _inertia_of_motors(self, dofs: Indices, driven: Array) -> tuple[Array, Array]:
        """Return the inertia that the motors move, and the metric, each (n_joints, n_joints).

        The metric is the inertia with joints the heavier, the nearer they are to an end of their
        range: the others go on in their place, and they come to rest before their stops.

        MuJoCo's implicit integrators take damping as of the end of a step, which is as if there
        were as much more inertia as it takes in a step. What the reader and the motors make up for
        is the damping as of its beginning.
        """
        model, data = self._model, self._data
        mj.mj_fullM(model, data, self._mass_matrix)
        if int(model.opt.integrator) in self._implicit:
            step, damping = float(model.opt.timestep), self.motors.damping(data)
        else:
            step, damping = 0.0, np.zeros(len(self.joint_names))
        return self._joints.inertia(dofs, driven, step, damping)

    def _robot_motion(self, model: Any, data: Any) -> Any:
        """Return the core's view of how joints and links move, whose arrays MuJoCo writes."""
        kinds, joints = mj.mjtJoint, model.dof_jntid
        simple = np.isin(model.jnt_type, (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)))
        ranged = (simple & (model.jnt_limited != 0))[joints]
        ends = np.where(ranged[:, None], model.jnt_range[joints], (-np.inf, np.inf))
        near: Array = np.ones(int(model.nv))
        near[ranged] = _NEAR_END * np.ptp(ends[ranged], axis=1)
        above = np.array([moved_by(model, each) for each in range(model.nbody)], dtype=float)
        return native.module.RobotMotion(
            self._mass_matrix, model.jnt_qposadr[joints].astype(np.intp), ends, near, above,
            model.body_rootid.astype(np.intp), model.dof_damping, data.qpos, data.qvel,
            data.subtree_com, data.cvel, data.cdof_dot,
        )  # fmt: skip

    def _distribute(self, f: Array, W: Array, hand: Actuation, bias: Array) -> Solution:
        """Solve the tick's force problem."""
        acting, soft, motions = self._columns, self._softness(self._soft), self.reader.motions
        if motions is not None:
            W, f, soft = motions.T @ W, motions.T @ f, np.abs(motions.T) @ soft
        if len(hand.passive_loads):
            W, f = np.concatenate((W, hand.passive_rows)), np.concatenate((f, hand.passive_loads))
            passive = np.full(len(hand.passive_loads), _GIVING_WAY * self._soft[-1])
            soft = np.concatenate((soft, passive))
        fields: dict[str, Any] = {
            "W": W, "f": f, "f_soft": soft, "J": hand.J[:, acting], "tau_bias": bias[acting],
            "tau_lo": self.tau_lo[acting], "tau_hi": self.tau_hi[acting],
            "engagement": self.book.engagement, "cone_weight": self.book.cone_weight,
            "alpha": self.alpha,
        }  # fmt: skip
        internal = hand.internal[:, acting]
        if len(internal):
            internal = internal[internal.any(axis=1)]
        if len(internal):
            fields["internal"] = internal
        if len(hand.b):
            fields["A"], fields["b"] = hand.A, hand.b
        if self._c is not None:
            fields["c_last"] = self._c
        shape = len(f), len(fields["tau_lo"]), len(internal), len(hand.b), self._c is None
        servo = self._servo
        if servo is None or shape != self._shape:
            self._shape = shape
            return self._make_servo(fields).step()
        for name, value in fields.items():
            getattr(servo, name)[...] = value
        servo.mu[:], servo.gamma[:] = self._slot_mu, self._slot_gamma
        servo.tick()
        return servo.solution

    def _motor_forces(self, hand: Actuation, bias: Array, solution: Solution) -> Array:
        """Return what each motor gives, those that act by the solution, shape (n_joints,).

        As ``solution.motor_forces``, of the tick's arrays: that makes a problem first, 20 µs.
        """
        tau, acting = bias.copy(), self._columns
        tau[acting] += solution.c @ hand.J[:, acting]
        if self._servo is not None and self._servo.internal.size:
            tau[acting] += solution.internal_forces @ self._servo.internal
        return tau

    def _softness(self, soft: Array) -> Array:
        """Return ``f_soft`` by which W c = f is missed as little whatever alpha is."""
        return soft / math.sqrt(max(self.alpha or 1.0, 1.0))

    def _make_servo(self, fields: dict[str, Any]) -> Servo:
        """Return a Servo of the layout that the fields have; settle alpha where it is open."""
        options = fields | {"alpha": 5.0 if self.alpha is None else self.alpha}
        if self._c is not None:
            options["dc_max"] = self._gains.force_rate * self._dt
        problem = ForceProblem(
            options.pop("W"), options.pop("f"), self._models(), c_max=self._c_max, **options
        )
        if self.alpha is None:
            self.alpha = self._firm(problem)
            rows = len(problem.f_soft) - len(self.reader.passive_loads)
            soft = np.append(self._softness(problem.f_soft[:rows]), problem.f_soft[rows:])
            problem = problem.replace(alpha=self.alpha, f_soft=soft)
        self._servo = Servo(problem)
        return self._servo

    def _firm(self, problem: ForceProblem) -> float:
        """Return alpha of a grip with ``TIMES_LEAST`` the least force.

        A load that may be missed has no least force, so that it is asked for as it is; but not
        what no motor controls, which gives way until it is in balance.
        """
        rows = 6 if self.reader.motions is None else self.reader.motions.shape[1]
        soft = np.append(np.zeros(rows), problem.f_soft[rows:])
        grip = firmness.choose(problem.replace(f_soft=soft), times_least=TIMES_LEAST)
        return grip.alpha if grip.solution.status is Status.SOLVED else 5.0


def softness(weight: float, arm: float) -> Array:
    """Return by how much W c = f may be missed, shape (6,) [N, N·m].

    Args:
        weight: of the object [N].
        arm: distance of the contacts from its centre [m].
    """
    return _SOFTNESS * weight * np.array([1.0, 1.0, 1.0, arm, arm, arm])


def quiet_reader(model: Any, data: Any, body: str, motors: MujocoMotors) -> MujocoGrasp:
    """Return a reader for all motors; its ``notes`` have what it would warn of.

    Raises:
        InvalidInputError: as :class:`MujocoGrasp`.
        ModelImportError: a motor without a limit.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GraspForceWarning)
        return MujocoGrasp(model, data, body, motors.joint_names, limits_of(motors, data))


def limits_of(motors: MujocoMotors, data: Any) -> dict[str, float]:
    """Return the limits that a reader needs besides those that it finds in the model."""
    lo, hi = motors.limits(data)
    most = np.maximum(np.abs(lo), np.abs(hi))
    for name, limit in zip(motors.joint_names, most.tolist(), strict=True):
        if limit == np.inf:
            raise ModelImportError(
                f"{name!r}: its motor has no limit, expected a forcerange, or a ctrlrange of a "
                "motor or servo; or give tau_max"
            )
    return dict(zip(motors.joint_names, most.tolist(), strict=True))
