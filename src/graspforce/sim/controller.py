"""The control law: from a pose error to joint torques, through the force distribution.

Every tick,

1. a PD law on the object's pose, with its weight and inertia, gives the wrench f;
2. the measured contact points give W and J;
3. the servo distributes f over the fingers: contact forces c;
4. tau = J.T c + what the fingers need for themselves: gravity and Coriolis torques, the torques
   that move their own inertia along with the object, and damping of joint motion that does not
   move the tip.

There is no position loop on a finger that holds. One that is off the object follows its path by
computed torque with a light PD law at the tip. While its engagement rises or falls, the two are
blended by it, so that nothing jumps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.contact import PCWF, Contact, any_tangent, cross
from graspforce.grasp_map import grasp_map
from graspforce.problem import ForceProblem
from graspforce.regrasp import is_removed, smooth
from graspforce.servo import Servo
from graspforce.sim.engine import mj
from graspforce.sim.minimum_norm import MinimumNorm
from graspforce.sim.scene import Pose, Scene, Touch
from graspforce.sim.trial import Step, Trial
from graspforce.solution import Solution
from graspforce.trajectory import State

# How deep inside the surface a returning finger aims [m]: it presses lightly, and so finds it.
PRESS = 5e-4

# A motion that turns faster than this has all of the friction against it [rad/s].
TURNING = 0.05

# The inertia felt at a fingertip is counted no higher than this [kg].
HEAVIEST = 1e3

# Half the interval over which a swing path is differentiated [s].
_H = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """What one control tick decided.

    Attributes:
        tau: joint torques, shape (n_joints,) [N·m].
        solution: of the force problem.
        contacts: where the forces act, world axes.
        engagement: shape (n,).
    """

    tau: Array
    solution: Solution
    contacts: tuple[Contact, ...]
    engagement: Array


class Controller:
    """The control law of a trial, tick after tick.

    It knows the trial as planned, mass and inertia as they are at the start, and what is measured.

    Args:
        trial: what is to be done.
        scene: whose hand it moves; only the hand's own state is read from it.
    """

    def __init__(self, trial: Trial, scene: Scene) -> None:
        self._trial, self._scene = trial, scene
        self._gains, self._schedule = trial.gains, trial.schedule
        R = scene.pose().rotation
        self._mass, self._inertia = scene.mass, R.T @ scene.inertia @ R
        self._q_start = scene.q.copy()
        # In the object's frame: where each finger touches or last did, and the roll of its frame.
        self._points = [grip.point for grip in trial.grips]
        self._normals = [grip.normal for grip in trial.grips]
        self._tangents = [any_tangent(grip.normal) for grip in trial.grips]
        self._servo: Servo | MinimumNorm | None = None
        self._c = np.zeros(3 * len(trial.fingers))

    def step(self, t: float, pose: Pose, touches: list[Touch | None]) -> Command:
        """Return the torques of the tick at time t [s] from what is measured."""
        target = self._trial.motion.at(t)
        acceleration, f = self._wrench(target, pose)
        engagement = self._engagement(t, touches)
        contacts = self._contacts(pose, touches, engagement)
        W = grasp_map(contacts, pose.position)
        J = self._scene.contact_jacobian(contacts)
        own = self._own_torques(t, pose, touches, acceleration, contacts, engagement)
        solution = self._distribute(f, W, J, own, engagement)
        if solution.status is Status.SOLVED:
            self._c = solution.c
        tau = J.T @ (self._c * np.repeat(~is_removed(engagement), 3)) + own
        return Command(tau, solution, contacts, engagement)

    # ---- 1  the wrench ---------------------------------------------------------------------

    def _wrench(self, target: State, pose: Pose) -> tuple[Array, Array]:
        """Return the wanted acceleration, linear and angular, and the wrench f for it."""
        gains = self._gains
        linear = (
            target.acceleration
            + gains.object_stiffness * (target.position - pose.position)
            + gains.object_damping * (target.velocity - pose.velocity)
        )
        angular = (
            target.angular_acceleration
            + gains.object_stiffness * rotation_vector(target.rotation @ pose.rotation.T)
            + gains.object_damping * (target.angular_velocity - pose.angular_velocity)
        )
        inertia = pose.rotation @ self._inertia @ pose.rotation.T
        omega = pose.angular_velocity
        force = self._mass * (linear - self._scene.model.opt.gravity)
        torque = inertia @ angular + cross(omega, inertia @ omega)
        turning = min(max(target.yaw_rate / TURNING, -1.0), 1.0)
        torque[2] += turning * self._trial.turning_friction
        return np.concatenate((linear, angular)), np.concatenate((force, torque))

    # ---- 2  the contacts -------------------------------------------------------------------

    def _engagement(self, t: float, touches: list[Touch | None]) -> Array:
        """Return the planned engagement; a finger on its way that touches nothing has none."""
        engagement = self._schedule(t)
        for i, touch in enumerate(touches):
            if touch is None and engagement[i] < 1:
                engagement[i] = 0.0
        return engagement

    def _contacts(
        self, pose: Pose, touches: list[Touch | None], engagement: Array
    ) -> tuple[Contact, ...]:
        """Return where the fingers touch; where one does not, where it last did."""
        R, model = pose.rotation, PCWF(self._trial.mu)
        contacts: list[Contact] = []
        for i, touch in enumerate(touches):
            if touch is not None:
                self._points[i] = R.T @ (touch.point - pose.position)
                self._normals[i] = R.T @ touch.normal
                if is_removed(engagement[i]):  # a new hold: the frame's roll is free again
                    self._tangents[i] = any_tangent(self._normals[i])
            point = pose.position + R @ self._points[i]
            contacts.append(Contact(point, R @ self._normals[i], model, R @ self._tangents[i]))
        return tuple(contacts)

    # ---- 3  the forces ---------------------------------------------------------------------

    def _distribute(self, f: Array, W: Array, J: Array, own: Array, engagement: Array) -> Solution:
        trial, grasp = self._trial, self._scene.grasp
        ceiling: dict[str, Any] = {} if trial.c_max is None else {"engagement": engagement}
        if self._servo is None:
            problem = ForceProblem(
                W, f, PCWF(trial.mu), J, grasp.tau_lo, grasp.tau_hi, own,
                c_max=trial.c_max, alpha=trial.alpha, **ceiling,
            )  # fmt: skip
            self._servo = (Servo if trial.method == "wbf" else MinimumNorm)(problem)
        return self._servo.step(f=f, W=W, J=J, tau_bias=own, **ceiling)

    # ---- 4  the fingers' own torques -------------------------------------------------------

    def _own_torques(
        self,
        t: float,
        pose: Pose,
        touches: list[Touch | None],
        acceleration: Array,
        contacts: tuple[Contact, ...],
        engagement: Array,
    ) -> Array:
        """Return what the joints need beside J.T c, shape (n_joints,) [N·m]."""
        scene = self._scene
        own = scene.grasp.tau_bias.copy()
        mass_matrix = scene.mass_matrix()
        for i, contact in enumerate(contacts):
            share = float(engagement[i])
            point, wanted = contact.point, np.zeros(3)
            if self._gains.feed_forward:
                wanted = share * _point_acceleration(acceleration, pose, point)
            if share > 0 and touches[i] is None:  # it has lost hold, and shall not rush back
                rush = scene.tip_velocity(i, point) - pose.point_velocity(point)
                wanted = wanted - share * self._gains.swing_damping * rush
            if share < 1:
                point, swing = self._swing(t, i)
                wanted = wanted + (1 - share) * swing
            M = mass_matrix[np.ix_(scene.dofs[i], scene.dofs[i])]
            own[scene.columns[i]] += self._finger_torques(
                i, M, point, wanted if wanted.any() else None
            )
        return own

    def _finger_torques(self, i: int, M: Array, point: Array, wanted: Array | None) -> Array:
        """Return the torques that move a finger's inertia, and calm its redundant joints.

        Args:
            i: the finger.
            M: its inertia, shape (k, k).
            point: of the tip, shape (3,).
            wanted: acceleration of that point relative to what the finger stands on, shape (3,)
                [m/s²]; None for no say in it.
        """
        scene, gains = self._scene, self._gains
        J = scene.side * scene.jacobian(i, point)
        J_over_M = np.linalg.solve(M, J.T).T
        # Λ, the inertia that is felt at the point; bounded where the finger is stretched out.
        felt = np.linalg.inv(J_over_M @ J.T + np.eye(3) / HEAVIEST)
        tau = np.zeros(len(M))
        if wanted is not None:
            tau += J.T @ (felt @ (wanted - scene.side * scene.drift(i, point)))
        if len(M) > 3:  # joint motion that leaves the point where it is
            columns = scene.columns[i]
            q_off, q_dot = scene.q[columns] - self._q_start[columns], scene.q_dot[columns]
            still = -M @ (gains.null_stiffness * q_off + gains.null_damping * q_dot)
            tau += still - J.T @ (felt @ (J_over_M @ still))
        return tau

    def _swing(self, t: float, finger: int) -> tuple[Array, Array]:
        """Return the tip's centre and its wanted acceleration, for a finger off the object."""
        gains, scene = self._gains, self._scene
        step = self._step_of(finger, t)
        centre, radius = scene.tip(finger)

        def path(time: float) -> Array:
            target = self._trial.motion.at(time)
            return target.position + target.rotation @ swing_point(step, time, radius)

        before, now, after = path(t - _H), path(t), path(t + _H)
        acceleration = (
            (after - 2 * now + before) / _H**2
            + gains.swing_stiffness * (now - centre)
            + gains.swing_damping
            * ((after - before) / (2 * _H) - scene.tip_velocity(finger, centre))
        )
        return centre, acceleration

    def _step_of(self, finger: int, t: float) -> Step:
        """Return the finger's step that is under way at time t [s]: the first not yet over."""
        steps = [step for step in self._trial.steps if step.release.finger == finger]
        return next(
            (step for step in steps if t < step.release.back + step.release.ramp), steps[-1]
        )


def swing_point(step: Step, t: float, radius: float) -> Array:
    """Return where a tip's centre is on its way off the object, in the object's frame, (3,) [m].

    Args:
        step: the way.
        t: [s]; before leaving and after coming back the tip presses on the surface.
        radius: of the tip [m].
    """
    release = step.release
    s = (t - release.leave) / (release.back - release.leave)
    along = float(smooth(s))
    normal = (1 - along) * step.start.normal + along * step.end.normal
    normal = normal / np.linalg.norm(normal)
    # A point on the surface at both ends; between them the chord, off which the tip is lifted.
    point = (1 - along) * step.start.point + along * step.end.point
    x = min(max(s, 0.0), 1.0)
    height = radius - PRESS + (step.lift + PRESS) * 64 * (x * (1 - x)) ** 3
    return point - height * normal


def rotation_vector(R: Array) -> Array:
    """Return axis times angle of a rotation matrix, shape (3,) [rad]."""
    quaternion, vector = np.zeros(4), np.zeros(3)
    mj.mju_mat2Quat(quaternion, R.ravel())
    mj.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def _point_acceleration(acceleration: Array, pose: Pose, point: Array) -> Array:
    """Return the acceleration of the object's material at a point, shape (3,) [m/s²]."""
    arm, omega = point - pose.position, pose.angular_velocity
    return acceleration[:3] + cross(acceleration[3:], arm) + cross(omega, cross(omega, arm))
