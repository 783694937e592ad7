"""The closed loop: measure, compute torques, step the physics, log."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.columns import Columns
from graspforce.control.object_law import ObjectState, rotation_vector
from graspforce.sim.controller import Command, Controller
from graspforce.sim.hand_loop import HandCommand, HandLoop, Seen
from graspforce.sim.log import Ending, Log
from graspforce.sim.mujoco_import import mj, silenced_warnings
from graspforce.sim.trial import Trial
from graspforce.sim.world import Physics, Touch, World
from graspforce.solution import Solution

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
    side = closed(trial)
    world, disturbance = side.world, side.disturbance
    log = Log.blank(trial.ticks, trial.model.nq, side.contacts, side.tau_max)
    slip = np.zeros(side.contacts)
    pose = world.pose()
    solutions: list[Solution] = []
    ending, message = Ending.COMPLETED, ""
    first_failure = ""  # the first tick that was not solved, often the cause
    for tick in range(trial.ticks):
        t = tick / trial.rate
        target = side.target(t)
        _write_pose(log, tick, t, *target, pose, world)
        command = side.decide(t, pose)
        solutions.append(command.solution)
        if command.solution.status is not Status.SOLVED and not first_failure:
            first_failure = (
                f"; tick {tick} was the first that was not solved: {command.solution.message}"
            )
        side.write(log, tick)
        log.f[tick] = command.f
        log.tau[tick], log.kept[tick], log.slip[tick] = command.tau, command.kept, slip
        log.without_slot[tick] = command.without_slot
        tau = disturbance.delayed(command.tau)
        for _ in range(trial.substeps):
            disturbance.apply(world.data.time)
            side.step(tau)
            if world.failure():
                break
            pose = world.pose()
            slip = (slip + side.slip_increments(pose)) * (log.engagement[tick] > 0)
        log.force[tick] = side.forces
        log.normal_force[tick] = np.einsum("ij,ij->i", side.forces, log.normal[tick])
        if progress is not None:
            progress(tick)
        lost = side.lost(log.engagement[tick])
        ending, cause = _ending(world, log.position_error[tick], log.rotation_error[tick], lost)
        if ending is not Ending.COMPLETED:
            message = f"at tick {tick} ({t:.3f} s) {cause}{first_failure}"
            break
    columns = Columns(solutions)
    log.c, log.newton_steps, log.status = columns.c, columns.newton_steps, columns.status
    log.tau_max = side.tau_max
    return log.ended(len(columns), ending, message)


def closed(trial: Trial) -> NamedFingers | AnyHand:
    """Return a trial's physics with its controller around it, at the start."""
    return NamedFingers(trial) if trial.fingers else AnyHand(trial)


class NamedFingers:
    """A trial whose fingers are named and make a contact each."""

    free = True  # the wrench's six rows are those of the force problem

    def __init__(self, trial: Trial) -> None:
        self._trial = trial
        self.world = World(trial)
        self.disturbance = _DisturbanceModel(trial, self.world)
        self._controller = Controller(trial, self.world)
        self._touches = self.world.touches()
        self.contacts, self.tau_max = len(trial.fingers), self.world.tau_max
        self.fingers = tuple(f"finger {i + 1}" for i in range(self.contacts))
        self.joints = tuple(name for finger in trial.fingers for name in finger.joints)

    def plan(self, trial: Trial) -> None:
        """Go on with other wishes for the same hand and object, from what is measured."""
        self._trial = trial
        self._controller = Controller(trial, self.world)

    @property
    def alpha(self) -> float:
        """Weight of the linear limits."""
        return 5.0 if self._trial.alpha is None else self._trial.alpha

    @property
    def decided(self) -> tuple[Array, Array]:
        """Where the forces of the last tick act, shape (n, 3) [m], and frames, shape (n, 3, 3)."""
        contacts = self._decided.contacts
        return np.array([c.point for c in contacts]), np.array([c.frame for c in contacts])

    @property
    def forces(self) -> Array:
        """Contact forces of the last physics step, world axes, shape (n, 3) [N]."""
        return self.world.forces

    def target(self, t: float) -> tuple[Array, Array]:
        """Return where the object should be, and how turned."""
        state = self._trial.target(t)
        return state.position, state.rotation

    def decide(self, t: float, pose: ObjectState) -> Command:
        """Return what the controller decides from the measurements."""
        touches = self.disturbance.touches(self._touches)
        self._decided = self._controller.step(t, self.disturbance.pose(pose), touches)
        return self._decided

    def step(self, tau: Array) -> None:
        """Advance the physics by a step."""
        self.world.step(tau)
        if not self.world.failure():
            self._touches = self.world.touches()

    def slip_increments(self, pose: ObjectState) -> Array:
        """Return the slip of every fingertip on the object in one physics step, shape (n,) [m]."""
        return _slip_increments(self.world, pose, self._touches)

    def write(self, log: Log, tick: int) -> None:
        """Log the contacts of the tick that was decided last."""
        log.engagement[tick] = self._decided.engagement
        contacts = self._decided.contacts
        for i, (touch, contact) in enumerate(zip(self._touches, contacts, strict=True)):
            log.point[tick, i] = contact.point
            log.normal[tick, i] = contact.normal
            log.clearance[tick, i] = 0.0 if touch is not None else self.world.clearance(i)

    def lost(self, engagement: Array) -> list[str]:
        """Return the fingertips that should touch and do not."""
        return [
            finger.tip
            for finger, touch, share in zip(
                self._trial.fingers, self._touches, engagement, strict=True
            )
            if touch is None and share > 0
        ]


class AnyHand:
    """A trial in which whatever touches holds the object."""

    def __init__(self, trial: Trial) -> None:
        self.world = Physics(trial.model, trial.start, trial.body)
        model, data = self.world.model, self.world.data
        mj.mj_forward(model, data)
        self.loop = HandLoop(
            model, data, trial.body, trial.motion, mu=trial.mu, alpha=trial.alpha,
            c_max=trial.c_max, gains=trial.gains, rate=trial.rate,
        )  # fmt: skip
        self.loop.write(self.loop.first_torques(), at_once=True)
        self.disturbance = _DisturbanceModel(trial, self.world)
        self.contacts = len(self.loop.links)
        self.forces = np.zeros((self.contacts, 3))
        mj.mj_step1(model, data)
        self.loop.read()

    def plan(self, trial: Trial) -> None:
        """Go on with another alpha, which is all that can change while it holds."""
        self.loop.alpha = trial.alpha

    @property
    def alpha(self) -> float | None:
        """Weight of the linear limits; None before the first tick where the trial has none."""
        return self.loop.alpha

    @property
    def decided(self) -> tuple[Array, Array]:
        """As of named fingers; slots without contact, too."""
        return self.loop.book.points, self.loop.book.frames

    @property
    def fingers(self) -> tuple[str, ...]:
        """What makes each contact, numbered where it makes several."""
        count: Counter[str] = Counter()
        names: list[str] = []
        for link in self.loop.links:
            name = link or "spare"
            count[name] += 1
            names.append(f"{name} ({count[name]})" if self.loop.links.count(link) > 1 else name)
        return tuple(names)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints and tendons of the force problem, those that move what touches."""
        loop = self.loop
        return tuple(n for n, acts in zip(loop.joint_names, loop.holding, strict=True) if acts)

    @property
    def free(self) -> bool:
        """Whether the object moves freely, and not on joints of its own."""
        return self.loop.reader.motions is None

    @property
    def tau_max(self) -> Array:
        """The larger torque limit of every motor, as the joints are, shape (n_joints,)."""
        return np.maximum(np.abs(self.loop.tau_lo), np.abs(self.loop.tau_hi))

    def target(self, t: float) -> tuple[Array, Array]:
        """Return where the object should be, and how turned."""
        return self.loop.target(t)

    def decide(self, t: float, pose: ObjectState) -> HandCommand:
        """Return what the loop decides from the measurements."""
        seen = self.disturbance.seen(self.loop.seen())
        return self.loop.decide(t, self.disturbance.pose(pose), seen)

    def step(self, tau: Array) -> None:
        """Advance the physics by a step."""
        model, data, loop = self.world.model, self.world.data, self.loop
        loop.write(tau)
        mj.mj_step2(model, data)
        if self.world.failure():
            return
        # Only between these two are the forces those of the contacts that the data list.
        each = loop.reader.forces_world(data)
        self.forces[:] = 0.0
        slots, seen = loop.book.slots, loop.reader.points
        if len(slots) == len(seen):
            found = slots >= 0
            np.add.at(self.forces, slots[found], each[found])
        mj.mj_step1(model, data)
        if not self.world.failure():
            loop.read()

    def slip_increments(self, pose: ObjectState) -> Array:
        """Return how far what touches slid on the object in one physics step, shape (n,) [m]."""
        book, data = self.loop.book, self.world.data
        points, normals = book.points, book.frames[:, :, 0]
        bodies = np.array([link or 0 for link in book.links], dtype=np.intp)
        root = self.world.model.body_rootid[bodies]
        about, linear = data.cvel[bodies, :3], data.cvel[bodies, 3:]
        velocity = linear + np.cross(about, points - data.subtree_com[root])
        velocity -= pose.velocity + np.cross(pose.angular_velocity, points - pose.position)
        along = velocity - np.einsum("ij,ij->i", velocity, normals)[:, None] * normals
        return np.linalg.norm(along, axis=1) * book.present * self.world.model.opt.timestep

    def write(self, log: Log, tick: int) -> None:
        """Log the contacts of the tick that was decided last."""
        book = self.loop.book
        log.engagement[tick] = book.engagement
        log.point[tick], log.normal[tick] = book.points, book.frames[:, :, 0]

    def lost(self, engagement: Array) -> list[str]:
        """Return the links that should touch and do not."""
        del engagement
        touching = set(self.loop.seen().bodies.tolist())
        names = dict(zip(self.loop.book.links, self.loop.links, strict=True))
        return [name for body, name in names.items() if name and body not in touching]


def _ending(
    world: Physics, position_error: float, rotation_error: float, lost: list[str]
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

    def __init__(self, trial: Trial, world: Physics) -> None:
        self._disturbance, self._world = trial.disturbance, world
        self._random = np.random.default_rng(trial.disturbance.seed)
        self._gravity = np.array(world.model.opt.gravity)
        self._friction = 1.0
        self.set_friction(trial.disturbance.friction)
        self._delayed_torques: deque[Array] = deque()
        self._payload_applied = False

    def apply(self, t: float) -> None:
        """Apply the forces and the payload of time t [s]."""
        disturbance = self._disturbance
        if disturbance.payload != 1 and not self._payload_applied and t >= disturbance.payload_time:
            self._world.multiply_mass(disturbance.payload)
            self._payload_applied = True
        if any(disturbance.shake):
            phase = 2 * np.pi * disturbance.shake_frequency * t
            sway = np.sin(phase) * np.array(disturbance.shake)
            self._world.model.opt.gravity[:] = self._gravity - sway
        if disturbance.pushes:
            wrench = np.zeros(6)
            for push in disturbance.pushes:
                s = (t - push.start) / push.duration
                if 0 <= s <= 1:
                    wrench[:3] += np.sin(np.pi * s) * np.array(push.force)
            self._world.push(wrench)

    def set_friction(self, factor: float) -> None:
        """Let the physics have so many times the friction that the controller knows of."""
        if factor != self._friction:
            self._world.multiply_friction(factor / self._friction)
            self._friction = factor

    def _noise(self, deviation: float, *shape: int) -> Array:
        return self._random.normal(0.0, deviation, shape) if deviation else np.zeros(shape)

    def pose(self, pose: ObjectState) -> ObjectState:
        """Return the pose with the sensors' noise."""
        disturbance = self._disturbance
        return ObjectState(
            pose.position + self._noise(disturbance.position_noise, 3),
            _rotated(pose.rotation, self._noise(disturbance.angle_noise, 3)),
            pose.velocity + self._noise(disturbance.velocity_noise, 3),
            pose.angular_velocity + self._noise(disturbance.rate_noise, 3),
        )

    def touches(self, touches: list[Touch | None]) -> list[Touch | None]:
        """Return the contacts of named fingers with the sensors' noise."""
        deviation = self._disturbance.position_noise
        return [
            touch and Touch(touch.point + self._noise(deviation, 3), touch.normal)
            for touch in touches
        ]

    def seen(self, seen: Seen) -> Seen:
        """Return contacts as the sensors see them, with the friction that the loop knows."""
        disturbance = self._disturbance
        there = np.ones(len(seen.points), dtype=bool)
        if disturbance.dropout:
            there = self._random.random(len(there)) >= disturbance.dropout
        points = seen.points + self._noise(disturbance.position_noise, *seen.points.shape)
        return Seen(
            points[there], seen.normals[there], seen.bodies[there],
            seen.mu[there] / self._friction, seen.gamma[there],
        )  # fmt: skip

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


def _slip_increments(world: World, pose: ObjectState, touches: list[Touch | None]) -> Array:
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


def _write_pose(
    log: Log,
    tick: int,
    t: float,
    position: Array,
    rotation: Array,
    pose: ObjectState,
    world: Physics,
) -> None:
    """Log where the object is and should be."""
    log.t[tick] = t
    log.qpos[tick] = world.data.qpos
    log.position[tick] = pose.position
    mj.mju_mat2Quat(log.quaternion[tick], pose.rotation.ravel())
    log.target_position[tick] = position
    log.position_error[tick] = np.linalg.norm(pose.position - position)
    log.rotation_error[tick] = np.linalg.norm(rotation_vector(rotation @ pose.rotation.T))
    yaw = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
    log.yaw[tick] = np.unwrap([log.yaw[tick - 1], yaw])[1] if tick else yaw
