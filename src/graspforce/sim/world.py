"""A running MuJoCo simulation, as the controller and the log see it.

Contacts, J and bias torques are read by :class:`graspforce.hands.MujocoGrasp`. This module adds
what a control law needs besides: which contact belongs to which finger, velocities of fingertips
and object, the inertia of the joints. World axes throughout.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.contact import Contact, cross
from graspforce.control import ObjectState
from graspforce.errors import ModelImportError
from graspforce.hands.mujoco.grasp import MujocoGrasp
from graspforce.hands.mujoco.model import drives, is_plain_motor
from graspforce.hands.mujoco.object import HeldObject
from graspforce.sim.mujoco_import import mj
from graspforce.sim.trial import Finger, Trial

Indices: TypeAlias = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """A contact that the physics reports.

    Attributes:
        point: shape (3,) [m].
        normal: into the object, shape (3,).
    """

    point: Array
    normal: Array


class Physics:
    """A running simulation with an object in it.

    Attributes:
        model: the model, a copy.
        data: its state.
        body: the number of the object's body.
        inside: which bodies make up the object, shape (nbody,).
    """

    def __init__(self, model: Any, start: Array, body: str) -> None:
        """Copy the model and put it at a configuration.

        Args:
            model: a compiled ``mujoco.MjModel``.
            start: joint positions, shape (nq,).
            body: the object's name.

        Raises:
            ModelImportError: there is no such body.
        """
        self.model = copy.copy(model)
        self.data = mj.MjData(self.model)
        self.data.qpos[:] = start
        self.body = self._id("body", body)
        self.inside = HeldObject(self.model, self.body).inside
        self._velocity = np.zeros(6)

    def _id(self, kind: str, name: str) -> int:
        accessor = getattr(self.model, kind)
        try:
            return int(accessor(name).id)
        except KeyError as error:
            raise ModelImportError(f"{kind} {name!r}: not in the model; {error}") from error

    def pose(self) -> ObjectState:
        """Return pose and velocity of the object, or of the robot on its feet."""
        return object_pose(self.model, self.data, self.body)

    @property
    def mass(self) -> float:
        """Of the object, or of the whole robot on its feet [kg]."""
        return float(self.model.body_subtreemass[self.body])

    @property
    def inertia(self) -> Array:
        """About the centre of mass, world axes, shape (3, 3) [kg·m²]."""
        return object_inertia(self.model, self.data, self.body)

    def multiply_mass(self, factor: float) -> None:
        """Make the object heavier, its inertia with it."""
        self.model.body_mass[self.inside] *= factor
        self.model.body_inertia[self.inside] *= factor
        mj.mj_setConst(self.model, mj.MjData(self.model))

    def multiply_friction(self, factor: float) -> None:
        """Make everything rougher or smoother than the controller knows."""
        self.model.geom_friction[:, 0] *= factor
        self.model.pair_friction[:, :2] *= factor

    def push(self, wrench: Array) -> None:
        """Set the wrench on the object's centre of mass, shape (6,); it acts until the next call.

        A body with others hanging on it is pushed at its own centre of mass [N, N·m].
        """
        self.data.xfrc_applied[self.body] = wrench

    def failure(self) -> str:
        """Return why the state is invalid; empty when it is valid."""
        texts = {
            mj.mjtWarning.mjWARN_BADQPOS: "a joint position is not finite or beyond 1e10",
            mj.mjtWarning.mjWARN_BADQVEL: "a joint velocity is not finite or beyond 1e10",
            mj.mjtWarning.mjWARN_BADQACC: "an acceleration is not finite or beyond 1e10",
            mj.mjtWarning.mjWARN_CONTACTFULL: "MuJoCo's contact buffer is full",
            mj.mjtWarning.mjWARN_CNSTRFULL: "MuJoCo's constraint buffer is full",
        }
        warnings: Any = self.data.warning
        for kind, text in texts.items():
            if warnings[kind].number:
                return text
        return ""


def object_pose(model: Any, data: Any, body: int) -> ObjectState:
    """Return pose and velocity of a body with all that hangs on it."""
    velocity = np.zeros(6)
    mj.mj_subtreeVel(model, data)
    mj.mj_objectVelocity(model, data, mj.mjtObj.mjOBJ_XBODY, body, velocity, 0)
    return ObjectState(
        data.subtree_com[body].copy(), data.xmat[body].reshape(3, 3).copy(),
        data.subtree_linvel[body].copy(), velocity[:3],
    )  # fmt: skip


def object_inertia(model: Any, data: Any, body: int) -> Array:
    """Return its inertia about the centre of mass, world axes, shape (3, 3) [kg·m²]."""
    xx, yy, zz, xy, xz, yz = data.crb[body][:6]
    about_root = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # MuJoCo's is about the centre of mass of the body's whole tree.
    arm = data.subtree_com[body] - data.subtree_com[model.body_rootid[body]]
    along = arm @ arm * np.eye(3) - np.outer(arm, arm)
    return about_root - model.body_subtreemass[body] * along


class World(Physics):
    """The running physics of a trial, with the names of its fingers resolved to indices.

    Attributes:
        grasp: contacts, limits and bias torques in that state, joints in the trial's order.
        dofs: for each finger the indices of its degrees of freedom.
        columns: for each finger its joints' places in tau.
        tau_max: torque limit of every joint, shape (n_joints,) [N·m].
        forces: that fingers exerted on the object, or the ground on the feet, in the last physics
            step, world axes, shape (n, 3) [N].
        side: 1 where the fingers push on the object, −1 where the ground pushes on the feet: the
            sign between J and the motion of the contact relative to the finger's root.
    """

    def __init__(self, trial: Trial) -> None:
        super().__init__(trial.model, trial.start, trial.body)
        self.side = 1.0 if trial.ground is None else -1.0
        names = [name for finger in trial.fingers for name in finger.joints]
        joints = [self._id("joint", name) for name in names]
        self._dof: Indices = self.model.jnt_dofadr[joints].copy()
        self._qpos: Indices = self.model.jnt_qposadr[joints].copy()
        self._motors = [self._motor(joint) for joint in names]
        self._torque_of_control = np.array(
            [
                self.model.actuator_gainprm[motor, 0]
                * self.model.actuator_gear[self.model.actuator_outadr[motor], 0]
                for motor in self._motors
            ]
        )
        self.tau_max = self._limits(names)
        self.dofs: list[Indices] = []
        self.columns: list[slice] = []
        for finger in trial.fingers:
            start = self.columns[-1].stop if self.columns else 0
            self.columns.append(slice(start, start + len(finger.joints)))
            self.dofs.append(self._dof[self.columns[-1]])
        self.tips = [self._tip(finger) for finger in trial.fingers]
        partners = (
            np.flatnonzero(self.model.geom_bodyid == self.body)
            if trial.ground is None
            else [self._id("geom", trial.ground)]
        )
        self._partners = {int(each) for each in partners}
        self._finger_of = {tip: i for i, tip in enumerate(self.tips)}
        self._tip_bodies: list[int] = self.model.geom_bodyid[self.tips].tolist()
        self.forces = np.zeros((len(self.tips), 3))
        nv = self.model.nv
        self._jacobian, self._jacobian_dot = np.zeros((3, nv)), np.zeros((3, nv))
        self._mass_matrix = np.zeros((nv, nv))
        self._start_moving(trial)
        mj.mj_step1(self.model, self.data)
        self.grasp = MujocoGrasp(
            self.model, self.data, trial.body, names, dict(zip(names, self.tau_max, strict=True))
        )

    def _start_moving(self, trial: Trial) -> None:
        """Give a free object the velocity that its motion begins with, and the fingers theirs."""
        joint = self.model.body_jntadr[self.body]
        if trial.ground is not None or self.model.jnt_type[joint] != mj.mjtJoint.mjJNT_FREE:
            return
        mj.mj_kinematics(self.model, self.data)
        mj.mj_comPos(self.model, self.data)
        state = trial.target(0.0)
        R, omega = state.rotation, state.angular_velocity
        dof = self.model.jnt_dofadr[joint]
        self.data.qvel[dof : dof + 6] = *state.velocity, *(R.T @ omega)
        for i, grip in enumerate(trial.grips):
            arm = R @ grip.point
            velocity = state.velocity + cross(omega, arm)
            J = self.jacobian(i, state.position + arm)
            self.data.qvel[self.dofs[i]] = np.linalg.lstsq(J, velocity, rcond=None)[0]

    def _motor(self, name: str) -> int:
        """Return the actuator of a joint: the only one, and one that takes a torque."""
        joint = self._id("joint", name)
        model, kinds, types = self.model, mj.mjtTrn, mj.mjtJoint
        if model.jnt_type[joint] not in (int(types.mjJNT_HINGE), int(types.mjJNT_SLIDE)):
            raise ModelImportError(f"joint {name!r}: expected a hinge or a slide")
        at_joint = np.isin(
            model.actuator_trntype, (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT))
        )
        motors = np.flatnonzero(at_joint & (model.actuator_trnid[:, 0] == joint)).tolist()
        if len(motors) != 1 or not is_plain_motor(model, motors[0]):
            names = ", ".join(repr(model.actuator(motor).name) for motor in motors)
            raise ModelImportError(
                f"joint {name!r}: expected one <motor>, got {names or 'no actuator'}; the loop "
                "commands torques, which other actuators do not take"
            )
        return int(motors[0])

    def _limits(self, names: list[str]) -> Array:
        """Return the torque that every joint's motor gives both ways, shape (n_joints,)."""
        found = {drive.limit.name: drive.limit for drive in drives(self.model)[0]}
        limits = np.array([min(-found[name].lo, found[name].hi) for name in names])
        for name, limit in zip(names, limits, strict=True):
            if not 0 < limit < np.inf:
                raise ModelImportError(
                    f"joint {name!r}: its motor's limit is {limit:g} N·m, expected a finite one "
                    "above 0 both ways: give the motor a ctrlrange"
                )
        return limits

    def _tip(self, finger: Finger) -> int:
        tip = self._id("geom", finger.tip)
        if self.model.geom_type[tip] != mj.mjtGeom.mjGEOM_SPHERE:
            raise ModelImportError(f"geom {finger.tip!r}: expected a sphere as a fingertip")
        return tip

    # ---- the fingers -----------------------------------------------------------------------

    def touches(self) -> list[Touch | None]:
        """Return the contact of every finger; None without contact."""
        found: list[Touch | None] = [None] * len(self.tips)
        points, normals = self.grasp.points, self.grasp.normals
        for k, finger in self._contacts():
            found[finger] = Touch(points[k].copy(), normals[k].copy())
        return found

    def _contacts(self) -> Iterator[tuple[int, int]]:
        """Yield the contacts of fingertips: their indices among those of ``grasp``, the finger."""
        for k, (maker, own) in enumerate(self.grasp.geoms.tolist()):
            tip, partner = (maker, own) if self.side > 0 else (own, maker)
            if tip in self._finger_of and partner in self._partners:
                yield k, self._finger_of[tip]

    def contact_jacobian(self, contacts: Sequence[Contact]) -> Array:
        """Return J of contacts made by the fingers in their order, shape (m, n_joints)."""
        return self.grasp.jacobian(contacts, self._tip_bodies)

    def tip(self, finger: int) -> tuple[Array, float]:
        """Return a tip's centre, shape (3,), and its radius [m]."""
        geom = self.tips[finger]
        return self.data.geom_xpos[geom].copy(), float(self.model.geom_size[geom, 0])

    def clearance(self, finger: int) -> float:
        """Return a tip's distance to the object [m], 0 when touching, 0.1 from there on."""
        tip, near = self.tips[finger], 0.1
        for partner in self._partners:
            near = min(near, mj.mj_geomDistance(self.model, self.data, tip, partner, near, None))
        return max(0.0, float(near))

    def tip_velocity(self, finger: int, point: Array) -> Array:
        """Return the velocity of the fingertip's material at ``point``, shape (3,) [m/s]."""
        geom = self.tips[finger]
        mj.mj_objectVelocity(self.model, self.data, mj.mjtObj.mjOBJ_GEOM, geom, self._velocity, 0)
        return self._velocity[3:] + cross(self._velocity[:3], point - self.data.geom_xpos[geom])

    def jacobian(self, finger: int, point: Array) -> Array:
        """Return how a point of the fingertip moves with the finger's joints, (3, k) [m]."""
        body = self.model.geom_bodyid[self.tips[finger]]
        mj.mj_jac(self.model, self.data, self._jacobian, None, point, body)
        return self._jacobian[:, self.dofs[finger]].copy()

    def drift(self, finger: int, point: Array) -> Array:
        """Return dJ/dt q̇, the acceleration of that point at constant rates, (3,) [m/s²]."""
        body = self.model.geom_bodyid[self.tips[finger]]
        mj.mj_jacDot(self.model, self.data, self._jacobian_dot, None, point, body)
        dofs = self.dofs[finger]
        return self._jacobian_dot[:, dofs] @ self.data.qvel[dofs]

    def mass_matrix(self) -> Array:
        """Return the inertia of all degrees of freedom, shape (nv, nv); a view."""
        mj.mj_fullM(self.model, self.data, self._mass_matrix)
        return self._mass_matrix

    @property
    def q(self) -> Array:
        """Joint angles of all fingers, shape (n_joints,) [rad]."""
        return self.data.qpos[self._qpos]

    @property
    def q_dot(self) -> Array:
        """Joint rates of all fingers, shape (n_joints,) [rad/s]."""
        return self.data.qvel[self._dof]

    # ---- time ------------------------------------------------------------------------------

    def step(self, tau: Array) -> None:
        """Advance the physics by one step under joint torques, shape (n_joints,) [N·m]."""
        self.data.ctrl[self._motors] = tau / self._torque_of_control
        mj.mj_step2(self.model, self.data)
        if self.failure():
            return
        # Only between these two are the forces those of the contacts that the data list.
        forces = self.grasp.W[:3] * self.grasp.contact_forces(self.data)
        ends = np.cumsum(self.grasp.dims)
        self.forces[:] = 0.0
        for k, finger in self._contacts():
            self.forces[finger] += forces[:, ends[k] - self.grasp.dims[k] : ends[k]].sum(axis=1)
        mj.mj_step1(self.model, self.data)
        if not self.failure():
            self.grasp.update(self.data)
