"""The control law: from a pose error to joint torques, through the force distribution.

Every tick,

1. :class:`graspforce.control.ObjectLaw`, of the object's pose, gives the wrench f;
2. the measured contact points give W and J;
3. the servo distributes f over the fingers: contact forces c;
4. tau = J.T c + what the fingers need for themselves: gravity and Coriolis torques, the torques
   that move their own inertia along with the object, and damping of joint motion that does not
   move the tip.

There is no position loop on a finger that holds. One that is off the object follows its path by
computed torque with a PD law at the tip. While its engagement rises or falls, the two are blended
by it, so that the torques are continuous.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.contact import PCWF, Contact, any_tangent, cross
from graspforce.control import ObjectLaw, ObjectState
from graspforce.grasp_map import grasp_map
from graspforce.problem import ForceProblem
from graspforce.regrasp import is_removed, smooth
from graspforce.servo import Servo
from graspforce.sim.minimum_norm_servo import MinimumNormServo
from graspforce.sim.trial import FingerSwing, Trial
from graspforce.sim.world import Touch, World
from graspforce.solution import Solution

# How deep inside the surface a returning finger aims [m]: it makes contact with a small force.
PRESS_DEPTH = 5e-4

# Yaw rate from which on all of ``turning_friction`` is compensated [rad/s].
FULL_FRICTION_RATE = 0.05

# Upper bound on the effective mass at a fingertip [kg].
MAX_TIP_INERTIA = 1e3

# Half the interval of the finite differences of a swing path [s].
_HALF_INTERVAL = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """What one control tick decided.

    Attributes:
        tau: joint torques, shape (n_joints,) [N·m].
        f: the wrench that the object was to get, about its centre of mass, shape (6,) [N, N·m].
        solution: of the force problem.
        contacts: where the forces act, world axes.
        engagement: shape (n,).
        kept: whether no forces inside the limits were found, not even for the nearest wrench, and
            ``tau`` is that of the last tick that had some.
    """

    tau: Array
    f: Array
    solution: Solution
    contacts: tuple[Contact, ...]
    engagement: Array
    kept: bool
    without_slot: int = 0  # its contacts are its fingers', which all have one


class Controller:
    """The control law of a trial, tick after tick.

    It uses the trial as planned, mass and inertia at the start, and the measurements; the
    disturbance is unknown to it.

    Args:
        trial: what is to be done.
        world: whose hand it moves; only the hand's own state is read from it.
    """

    def __init__(self, trial: Trial, world: World) -> None:
        self._trial, self._world = trial, world
        self._gains, self._schedule = trial.gains, trial.schedule
        R = world.pose().rotation
        self._law = ObjectLaw(
            world.mass, R.T @ world.inertia @ R, stiffness=trial.gains.object_stiffness,
            damping=trial.gains.object_damping,
        )  # fmt: skip
        self._q_start = world.q.copy()
        # In the object's frame: where each finger touches or last did, and the roll of its frame.
        self._points = [grip.point for grip in trial.grips]
        self._normals = [grip.normal for grip in trial.grips]
        self._tangents = [any_tangent(grip.normal) for grip in trial.grips]
        self._servo: Servo | MinimumNormServo | None = None
        self._tau: Array | None = None

    def step(self, t: float, pose: ObjectState, touches: list[Touch | None]) -> Command:
        """Return the torques of the tick at time t [s] from what is measured."""
        target = self._trial.target(t)
        acceleration = self._law.acceleration(target, pose)
        f = self._law.wrench(acceleration, pose, self._world.model.opt.gravity)
        direction = min(max(target.yaw_rate / FULL_FRICTION_RATE, -1.0), 1.0)
        f[5] += direction * self._trial.turning_friction
        engagement = self._engagement(t, touches)
        contacts = self._contacts(pose, touches, engagement)
        W = grasp_map(contacts, pose.position)
        J = self._world.contact_jacobian(contacts)
        bias = self._bias_torques(t, pose, touches, acceleration, contacts, engagement)
        solution = self._distribute(f, W, J, bias, engagement)
        kept = solution.status is not Status.SOLVED and not solution.nearest
        if not kept:
            self._tau = J.T @ (solution.c * np.repeat(~is_removed(engagement), 3)) + bias
        elif self._tau is None:  # no forces ever: what the joints need for themselves
            grasp = self._world.grasp
            self._tau = np.clip(bias, grasp.tau_lo, grasp.tau_hi)
        return Command(self._tau, f, solution, contacts, engagement, kept)

    # ---- 2  the contacts -------------------------------------------------------------------

    def _engagement(self, t: float, touches: list[Touch | None]) -> Array:
        """Return the planned engagement; 0 for a returning finger without contact."""
        engagement = self._schedule(t)
        for i, touch in enumerate(touches):
            if touch is None and engagement[i] < 1:
                engagement[i] = 0.0
        return engagement

    def _contacts(
        self, pose: ObjectState, touches: list[Touch | None], engagement: Array
    ) -> tuple[Contact, ...]:
        """Return where the fingers touch; where one does not, where it last did."""
        R, model = pose.rotation, PCWF(self._trial.assumed_mu)
        contacts: list[Contact] = []
        for i, touch in enumerate(touches):
            if touch is not None:
                self._points[i] = R.T @ (touch.point - pose.position)
                self._normals[i] = R.T @ touch.normal
                if is_removed(engagement[i]):  # a new contact: its frame's roll is chosen anew
                    self._tangents[i] = any_tangent(self._normals[i])
            point = pose.position + R @ self._points[i]
            contacts.append(Contact(point, R @ self._normals[i], model, R @ self._tangents[i]))
        return tuple(contacts)

    # ---- 3  the forces ---------------------------------------------------------------------

    def _distribute(self, f: Array, W: Array, J: Array, bias: Array, engagement: Array) -> Solution:
        trial, grasp = self._trial, self._world.grasp
        changes: dict[str, Any] = {} if trial.c_max is None else {"engagement": engagement}
        if self._servo is None:
            problem = ForceProblem(
                W, f, PCWF(trial.assumed_mu), J, grasp.tau_lo, grasp.tau_hi, bias,
                c_max=trial.c_max, alpha=5.0 if trial.alpha is None else trial.alpha, **changes,
            )  # fmt: skip
            self._servo = (Servo if trial.method == "wbf" else MinimumNormServo)(problem)
        return self._servo.step(f=f, W=W, J=J, tau_bias=bias, **changes)

    # ---- 4  the fingers' own torques -------------------------------------------------------

    def _bias_torques(
        self,
        t: float,
        pose: ObjectState,
        touches: list[Touch | None],
        acceleration: Array,
        contacts: tuple[Contact, ...],
        engagement: Array,
    ) -> Array:
        """Return what the joints need beside J.T c, shape (n_joints,) [N·m]."""
        world = self._world
        bias = world.grasp.tau_bias.copy()
        mass_matrix = world.mass_matrix()
        for i, contact in enumerate(contacts):
            weight = float(engagement[i])
            point, wanted = contact.point, np.zeros(3)
            if self._gains.feed_forward:
                wanted = weight * point_acceleration(acceleration, pose, point)
            if weight > 0 and touches[i] is None:  # contact lost: damp the way back to the object
                relative_velocity = world.tip_velocity(i, point) - pose.point_velocity(point)
                wanted = wanted - weight * self._gains.swing_damping * relative_velocity
            if weight < 1:
                point, swing_acceleration = self._swing(t, i)
                wanted = wanted + (1 - weight) * swing_acceleration
            M = mass_matrix[np.ix_(world.dofs[i], world.dofs[i])]
            bias[world.columns[i]] += self._finger_torques(
                i, M, point, wanted if wanted.any() else None
            )
        return bias

    def _finger_torques(self, i: int, M: Array, point: Array, wanted: Array | None) -> Array:
        """Return the torques that move a finger's inertia, and damp its redundant joints.

        Args:
            i: the finger.
            M: its inertia, shape (k, k).
            point: of the tip, shape (3,).
            wanted: acceleration of that point relative to what the finger stands on, shape (3,)
                [m/s²]; None leaves it uncontrolled.
        """
        world, gains = self._world, self._gains
        J = world.side * world.jacobian(i, point)
        J_over_M = np.linalg.solve(M, J.T).T
        # Λ, the operational-space inertia at the point; bounded at a singular configuration.
        tip_inertia = np.linalg.inv(J_over_M @ J.T + np.eye(3) / MAX_TIP_INERTIA)
        tau = np.zeros(len(M))
        if wanted is not None:
            tau += J.T @ (tip_inertia @ (wanted - world.side * world.drift(i, point)))
        if len(M) > 3:  # joint motion that leaves the point where it is
            columns = world.columns[i]
            q_error, q_dot = world.q[columns] - self._q_start[columns], world.q_dot[columns]
            null_torque = -M @ (gains.null_stiffness * q_error + gains.null_damping * q_dot)
            tau += null_torque - J.T @ (tip_inertia @ (J_over_M @ null_torque))
        return tau

    def _swing(self, t: float, finger: int) -> tuple[Array, Array]:
        """Return the tip's centre and its wanted acceleration, for a finger off the object."""
        gains, world = self._gains, self._world
        swing = self._swing_of(finger, t)
        centre, radius = world.tip(finger)

        def path(time: float) -> Array:
            target = self._trial.target(time)
            return target.position + target.rotation @ swing_point(swing, time, radius)

        before, now, after = path(t - _HALF_INTERVAL), path(t), path(t + _HALF_INTERVAL)
        acceleration = (
            (after - 2 * now + before) / _HALF_INTERVAL**2
            + gains.swing_stiffness * (now - centre)
            + gains.swing_damping
            * ((after - before) / (2 * _HALF_INTERVAL) - world.tip_velocity(finger, centre))
        )
        return centre, acceleration

    def _swing_of(self, finger: int, t: float) -> FingerSwing:
        """Return the finger's swing that is under way at time t [s]: the first not yet over."""
        swings = [swing for swing in self._trial.steps if swing.release.finger == finger]
        return next(
            (swing for swing in swings if t < swing.release.back + swing.release.ramp), swings[-1]
        )


def swing_point(swing: FingerSwing, t: float, radius: float) -> Array:
    """Return where a tip's centre is on its way off the object, in the object's frame, (3,) [m].

    Args:
        swing: the finger's way off the object and back.
        t: [s]; before leaving and after coming back the tip presses on the surface.
        radius: of the tip [m].
    """
    release = swing.release
    s = (t - release.leave) / (release.back - release.leave)
    along = float(smooth(s))
    normal = (1 - along) * swing.start.normal + along * swing.end.normal
    normal = normal / np.linalg.norm(normal)
    # A point on the surface at both ends; between them the chord, off which the tip is lifted.
    point = (1 - along) * swing.start.point + along * swing.end.point
    x = min(max(s, 0.0), 1.0)
    height = radius - PRESS_DEPTH + (swing.lift + PRESS_DEPTH) * 64 * (x * (1 - x)) ** 3
    return point - height * normal


def point_acceleration(acceleration: Array, pose: ObjectState, point: Array) -> Array:
    """Return the acceleration of the object's material at a point, shape (3,) [m/s²]."""
    arm, omega = point - pose.position, pose.angular_velocity
    return acceleration[:3] + cross(acceleration[3:], arm) + cross(omega, cross(omega, arm))
