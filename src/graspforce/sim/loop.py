"""The closed loop: measure, decide, let the physics go on, write down."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.sim.controller import Command, Controller, rotation_vector
from graspforce.sim.engine import mj, quiet
from graspforce.sim.log import Ending, Log
from graspforce.sim.scene import Pose, Scene, Touch
from graspforce.sim.trial import Trial
from graspforce.solution import Solution
from graspforce.solution.columns import Columns
from graspforce.trajectory import State

# Farther from its target than this, or turned off it by more, the object counts as dropped.
DROPPED = 0.05  # [m]
TURNED = np.radians(45.0)


def run(trial: Trial, progress: Callable[[int], None] | None = None) -> Log:
    """Run a trial to its end, or to where the object drops or the physics diverges.

    Args:
        trial: what to simulate.
        progress: called with the index of every tick when it is done.

    Returns:
        The log up to the end; ``ending`` and ``message`` say how it came.
    """
    with quiet():
        return _run(trial, progress)


def _run(trial: Trial, progress: Callable[[int], None] | None) -> Log:
    scene = Scene(trial)
    controller = Controller(trial, scene)
    world = _World(trial, scene)
    log = Log.blank(trial.ticks, trial.model.nq, len(trial.fingers), scene.tau_max)
    slip = np.zeros(len(trial.fingers))
    pose, touches = scene.pose(), scene.touches()
    solutions: list[Solution] = []
    ending, message = Ending.COMPLETED, ""
    refusal = ""  # the first tick without forces, and why: often what began it
    for tick in range(trial.ticks):
        t = tick / trial.rate
        command = controller.step(t, *world.measured(pose, touches))
        solutions.append(command.solution)
        if command.solution.status is not Status.SOLVED and not refusal:
            refusal = f"; tick {tick} was the first without forces: {command.solution.message}"
        tau = world.delayed(command.tau)
        _write(log, tick, t, trial.motion.at(t), pose, touches, command, slip, scene)
        for _ in range(trial.substeps):
            world.disturb(scene.data.time)
            scene.step(tau)
            if scene.trouble():
                break
            pose, touches = scene.pose(), scene.touches()
            slip = (slip + _slid(scene, pose, touches)) * (command.engagement > 0)
        log.force[tick] = scene.forces
        log.normal_force[tick] = np.einsum("ij,ij->i", scene.forces, log.normal[tick])
        if progress is not None:
            progress(tick)
        lost = [
            finger.tip
            for finger, touch, share in zip(trial.fingers, touches, command.engagement, strict=True)
            if touch is None and share > 0
        ]
        ending, cause = _end(scene, log.position_error[tick], log.rotation_error[tick], lost)
        if ending is not Ending.COMPLETED:
            message = f"at tick {tick} ({t:.3f} s) {cause}{refusal}"
            break
    columns = Columns(solutions)
    log.c, log.newton_steps, log.status = columns.c, columns.newton_steps, columns.status
    return log.ended(len(columns), ending, message)


def _end(
    scene: Scene, position_error: float, rotation_error: float, lost: list[str]
) -> tuple[Ending, str]:
    """Return whether it is over, and why; ``lost`` are the fingertips that should touch."""
    trouble = scene.trouble()
    if trouble:
        return Ending.DIVERGED, trouble
    if position_error > DROPPED:
        cause = f"the object was {1e3 * position_error:.0f} mm off its target"
    elif rotation_error > TURNED:
        cause = f"the object was turned {np.degrees(rotation_error):.0f}° off its target"
    else:
        return Ending.COMPLETED, ""
    return Ending.DROPPED, cause + (f", not in contact: {', '.join(lost)}" if lost else "")


class _World:
    """The trial's disturbance: what acts on the object, and what lies between it and the law."""

    def __init__(self, trial: Trial, scene: Scene) -> None:
        self._disturbance, self._scene = trial.disturbance, scene
        self._random = np.random.default_rng(trial.disturbance.seed)
        self._queue: deque[Array] = deque()
        self._loaded = False

    def disturb(self, t: float) -> None:
        """Apply the forces and the payload of time t [s]."""
        disturbance = self._disturbance
        if disturbance.payload != 1 and not self._loaded and t >= disturbance.payload_time:
            self._scene.multiply_mass(disturbance.payload)
            self._loaded = True
        if disturbance.pushes:
            force = np.zeros(3)
            for push in disturbance.pushes:
                s = (t - push.start) / push.duration
                if 0 <= s <= 1:
                    force += np.sin(np.pi * s) * np.array(push.force)
            self._scene.push(force)

    def measured(self, pose: Pose, touches: list[Touch | None]) -> tuple[Pose, list[Touch | None]]:
        """Return pose and contacts with the sensors' noise."""
        given = self._disturbance

        def noise(deviation: float) -> Array:
            return self._random.normal(0.0, deviation, 3) if deviation else np.zeros(3)

        noisy = Pose(
            pose.position + noise(given.position_noise),
            _turned(pose.rotation, noise(given.angle_noise)),
            pose.velocity + noise(given.velocity_noise),
            pose.angular_velocity + noise(given.rate_noise),
        )
        return noisy, [
            touch and Touch(touch.point + noise(given.position_noise), touch.normal)
            for touch in touches
        ]

    def delayed(self, tau: Array) -> Array:
        """Return the torques of ``delay`` ticks ago; at the start the first ones."""
        self._queue.append(tau)
        if len(self._queue) > self._disturbance.delay + 1:
            self._queue.popleft()
        return self._queue[0]


def _turned(R: Array, vector: Array) -> Array:
    """Return R turned by a rotation vector in world axes [rad]."""
    quaternion, turn = np.zeros(4), np.zeros(9)
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return R
    mj.mju_axisAngle2Quat(quaternion, vector / angle, angle)
    mj.mju_quat2Mat(turn, quaternion)
    return turn.reshape(3, 3) @ R


def _slid(scene: Scene, pose: Pose, touches: list[Touch | None]) -> Array:
    """Return how far every fingertip slipped on the object in a physics step, shape (n,) [m].

    Slipping is the tangential velocity between tip and object at the contact; rolling is none.
    """
    way = np.zeros(len(touches))
    for i, touch in enumerate(touches):
        if touch is not None:
            partner = pose.point_velocity(touch.point) if scene.side > 0 else 0.0
            velocity = scene.tip_velocity(i, touch.point) - partner
            velocity = velocity - (velocity @ touch.normal) * touch.normal
            way[i] = np.linalg.norm(velocity) * scene.model.opt.timestep
    return way


def _write(
    log: Log,
    tick: int,
    t: float,
    target: State,
    pose: Pose,
    touches: list[Touch | None],
    command: Command,
    slip: Array,
    scene: Scene,
) -> None:
    log.t[tick] = t
    log.qpos[tick] = scene.data.qpos
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
        log.clearance[tick, i] = 0.0 if touch is not None else scene.clearance(i)
    log.tau[tick] = command.tau
    log.slip[tick] = slip
