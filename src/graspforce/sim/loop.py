"""The closed loop: measure, compute torques, step the physics, log."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.sim.controller import Command, Controller, rotation_vector
from graspforce.sim.log import Ending, Log
from graspforce.sim.mujoco_import import mj, silenced_warnings
from graspforce.sim.trial import Trial
from graspforce.sim.world import Pose, Touch, World
from graspforce.solution import Solution
from graspforce.solution.columns import Columns
from graspforce.trajectory import State

# Beyond this distance from its target, or angle, the object counts as dropped.
DROPPED_DISTANCE = 0.05  # [m]
DROPPED_ROTATION = np.radians(45.0)  # [rad]


def run(trial: Trial, progress: Callable[[int], None] | None = None) -> Log:
    """Run a trial to its end, or to where the object drops or the physics diverges.

    Args:
        trial: what to simulate.
        progress: called with the index of every tick when it is done.

    Returns:
        The log up to the end; ``ending`` and ``message`` give the cause.
    """
    with silenced_warnings():
        return _run(trial, progress)


def _run(trial: Trial, progress: Callable[[int], None] | None) -> Log:
    world = World(trial)
    controller = Controller(trial, world)
    disturbance = _DisturbanceModel(trial, world)
    log = Log.blank(trial.ticks, trial.model.nq, len(trial.fingers), world.tau_max)
    slip = np.zeros(len(trial.fingers))
    pose, touches = world.pose(), world.touches()
    solutions: list[Solution] = []
    ending, message = Ending.COMPLETED, ""
    first_failure = ""  # the first tick that was not solved, often the cause
    for tick in range(trial.ticks):
        t = tick / trial.rate
        command = controller.step(t, *disturbance.measured(pose, touches))
        solutions.append(command.solution)
        if command.solution.status is not Status.SOLVED and not first_failure:
            first_failure = (
                f"; tick {tick} was the first that was not solved: {command.solution.message}"
            )
        tau = disturbance.delayed(command.tau)
        _write(log, tick, t, trial.motion.at(t), pose, touches, command, slip, world)
        for _ in range(trial.substeps):
            disturbance.apply(world.data.time)
            world.step(tau)
            if world.failure():
                break
            pose, touches = world.pose(), world.touches()
            slip = (slip + _slip_increments(world, pose, touches)) * (command.engagement > 0)
        log.force[tick] = world.forces
        log.normal_force[tick] = np.einsum("ij,ij->i", world.forces, log.normal[tick])
        if progress is not None:
            progress(tick)
        lost = [
            finger.tip
            for finger, touch, share in zip(trial.fingers, touches, command.engagement, strict=True)
            if touch is None and share > 0
        ]
        ending, cause = _ending(world, log.position_error[tick], log.rotation_error[tick], lost)
        if ending is not Ending.COMPLETED:
            message = f"at tick {tick} ({t:.3f} s) {cause}{first_failure}"
            break
    columns = Columns(solutions)
    log.c, log.newton_steps, log.status = columns.c, columns.newton_steps, columns.status
    return log.ended(len(columns), ending, message)


def _ending(
    world: World, position_error: float, rotation_error: float, lost: list[str]
) -> tuple[Ending, str]:
    """Return whether and why the run ends; ``lost`` are the fingertips that should touch."""
    failure = world.failure()
    if failure:
        return Ending.DIVERGED, failure
    if position_error > DROPPED_DISTANCE:
        cause = f"the object was {1e3 * position_error:.0f} mm off its target"
    elif rotation_error > DROPPED_ROTATION:
        cause = f"the object was turned {np.degrees(rotation_error):.0f}° off its target"
    else:
        return Ending.COMPLETED, ""
    return Ending.DROPPED, cause + (f", not in contact: {', '.join(lost)}" if lost else "")


class _DisturbanceModel:
    """The trial's disturbance: forces on the object, noise of the sensors, delay of the torques."""

    def __init__(self, trial: Trial, world: World) -> None:
        self._disturbance, self._world = trial.disturbance, world
        self._random = np.random.default_rng(trial.disturbance.seed)
        self._delayed_torques: deque[Array] = deque()
        self._payload_applied = False

    def apply(self, t: float) -> None:
        """Apply the forces and the payload of time t [s]."""
        disturbance = self._disturbance
        if disturbance.payload != 1 and not self._payload_applied and t >= disturbance.payload_time:
            self._world.multiply_mass(disturbance.payload)
            self._payload_applied = True
        if disturbance.pushes:
            force = np.zeros(3)
            for push in disturbance.pushes:
                s = (t - push.start) / push.duration
                if 0 <= s <= 1:
                    force += np.sin(np.pi * s) * np.array(push.force)
            self._world.push(force)

    def measured(self, pose: Pose, touches: list[Touch | None]) -> tuple[Pose, list[Touch | None]]:
        """Return pose and contacts with the sensors' noise."""
        disturbance = self._disturbance

        def noise(deviation: float) -> Array:
            return self._random.normal(0.0, deviation, 3) if deviation else np.zeros(3)

        noisy = Pose(
            pose.position + noise(disturbance.position_noise),
            _rotated(pose.rotation, noise(disturbance.angle_noise)),
            pose.velocity + noise(disturbance.velocity_noise),
            pose.angular_velocity + noise(disturbance.rate_noise),
        )
        return noisy, [
            touch and Touch(touch.point + noise(disturbance.position_noise), touch.normal)
            for touch in touches
        ]

    def delayed(self, tau: Array) -> Array:
        """Return the torques of ``delay`` ticks ago; at the start the first ones."""
        self._delayed_torques.append(tau)
        if len(self._delayed_torques) > self._disturbance.delay + 1:
            self._delayed_torques.popleft()
        return self._delayed_torques[0]


def _rotated(R: Array, vector: Array) -> Array:
    """Return R turned by a rotation vector in world axes [rad]."""
    quaternion, turn = np.zeros(4), np.zeros(9)
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return R
    mj.mju_axisAngle2Quat(quaternion, vector / angle, angle)
    mj.mju_quat2Mat(turn, quaternion)
    return turn.reshape(3, 3) @ R


def _slip_increments(world: World, pose: Pose, touches: list[Touch | None]) -> Array:
    """Return the slip of every fingertip on the object in one physics step, shape (n,) [m].

    Slip is the tangential velocity between tip and object at the contact, times the step; rolling
    is no slip.
    """
    slip = np.zeros(len(touches))
    for i, touch in enumerate(touches):
        if touch is not None:
            partner = pose.point_velocity(touch.point) if world.side > 0 else 0.0
            velocity = world.tip_velocity(i, touch.point) - partner
            velocity = velocity - (velocity @ touch.normal) * touch.normal
            slip[i] = np.linalg.norm(velocity) * world.model.opt.timestep
    return slip


def _write(
    log: Log,
    tick: int,
    t: float,
    target: State,
    pose: Pose,
    touches: list[Touch | None],
    command: Command,
    slip: Array,
    world: World,
) -> None:
    log.t[tick] = t
    log.qpos[tick] = world.data.qpos
    log.position[tick] = pose.position
    mj.mju_mat2Quat(log.quaternion[tick], pose.rotation.ravel())
    log.target_position[tick] = target.position
    log.position_error[tick] = np.linalg.norm(pose.position - target.position)
    log.rotation_error[tick] = np.linalg.norm(rotation_vector(target.rotation @ pose.rotation.T))
    yaw = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
    log.yaw[tick] = np.unwrap([log.yaw[tick - 1], yaw])[1] if tick else yaw
    log.engagement[tick] = command.engagement
    for i, (touch, contact) in enumerate(zip(touches, command.contacts, strict=True)):
        log.point[tick, i] = contact.point
        log.normal[tick, i] = contact.normal
        log.clearance[tick, i] = 0.0 if touch is not None else world.clearance(i)
    log.tau[tick] = command.tau
    log.slip[tick] = slip
