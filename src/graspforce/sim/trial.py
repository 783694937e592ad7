"""A closed-loop simulation as data: robot, grips, motion, swings, gains, disturbance.

A :class:`Trial` holds everything that :func:`graspforce.sim.run` needs, and runs nothing itself.
Hands and legs are treated alike. A hand's fingers push on a free object, and the object's pose
is controlled. A robot's feet push on the ground, the ground pushes back, and the trunk is the
"object" that the contact forces carry.

A trial names fingers and where they grip, as one needs that plans regrasps; or it names none, and
whatever touches the object holds it, with all motors of the model
(:mod:`graspforce.sim.hand_loop`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np

from graspforce._util.arrays import Array, as_array, as_positive
from graspforce.contact import FPC, Contact
from graspforce.errors import InvalidInputError
from graspforce.regrasp import Release, Schedule
from graspforce.sim.mujoco_import import mj
from graspforce.trajectory import Motion, State

Method: TypeAlias = Literal["wbf", "minimum_norm"]


@dataclass(frozen=True, slots=True)
class Finger:
    """A finger or a leg, by the names in the model.

    Args:
        joints: its hinges and slides, each with one <motor> that has a limit.
        tip: the geom that touches, a sphere.

    A hand with other motors or tips is held without naming its fingers.
    """

    joints: tuple[str, ...]
    tip: str


@dataclass(frozen=True, slots=True, eq=False)
class Grip:
    """Where a finger touches.

    Args:
        point: on the object's surface, in the object's frame, from its centre of mass, shape
            (3,) [m].
        normal: unit normal into the object there, shape (3,).

    Raises:
        InvalidInputError: a wrong shape, or a normal of another length.
    """

    point: Array
    normal: Array

    def __post_init__(self) -> None:
        contact = Contact(self.point, self.normal, FPC())  # which checks both
        object.__setattr__(self, "point", contact.point)
        object.__setattr__(self, "normal", contact.normal)


@dataclass(frozen=True, slots=True)
class FingerSwing:
    """One finger's way off the object and back to it.

    Args:
        release: which finger, when it leaves, when it touches again, and the ramps.
        start: where it leaves the object.
        end: where it comes back.
        lift: how far the tip moves away from the surface halfway [m].
    """

    release: Release
    start: Grip
    end: Grip
    lift: float


@dataclass(frozen=True, slots=True)
class Gains:
    """The control law's gains. All act on accelerations, so none depends on a mass.

    Args:
        object_stiffness: of the object's pose [1/s²].
        object_damping: [1/s].
        swing_stiffness: of a fingertip off the object [1/s²].
        swing_damping: [1/s].
        null_stiffness: of a finger's redundant motion about its joint angles at the start [1/s²].
        null_damping: [1/s].
        feed_forward: whether the torques that move the fingers' own inertia are added.
        posture_stiffness: of joints that do not move what touches, and of a hand without named
            fingers also of motions that leave its contacts still [1/s²].
        posture_damping: [1/s].
        force_rate: how fast a contact force may change in a hand without named fingers [N/s].
    """

    object_stiffness: float = 400.0
    object_damping: float = 40.0
    swing_stiffness: float = 3600.0
    swing_damping: float = 120.0
    null_stiffness: float = 0.0
    null_damping: float = 40.0
    feed_forward: bool = True
    posture_stiffness: float = 100.0
    posture_damping: float = 20.0
    force_rate: float = 500.0

    def require_ticks(self, dt: float) -> None:
        """Raise unless the law on the object settles with a tick every dt [s].

        The error x of an object that is accelerated by −k x − d ẋ, held for a tick, settles for
        k dt / 2 < d < 2 / dt. Half of either is left for delays and for what the contacts give.

        Raises:
            InvalidInputError: ticks are too far apart.
        """
        k, d = self.object_stiffness, self.object_damping
        least = max(d, k / d if d > 0 else np.inf if k > 0 else 0.0)
        if 1 / dt < least:
            raise InvalidInputError(
                f"rate: got {1 / dt:g} Hz, expected {least:g} Hz or more with an object stiffness "
                f"of {k:g} 1/s² and a damping of {d:g} 1/s: with longer ticks the object swings up"
            )


@dataclass(frozen=True, slots=True)
class Push:
    """A force on the object's centre of mass, half a sine in time.

    Args:
        force: at its peak, world axes, x, y, z [N].
        start: [s].
        duration: [s].
    """

    force: tuple[float, float, float]
    start: float
    duration: float


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Everything that the controller's model leaves out; the default is nothing.

    Args:
        pushes: forces on the object.
        payload: factor on the object's mass and inertia from ``payload_time`` on.
        payload_time: [s].
        position_noise: standard deviation of every coordinate of the object's measured position
            and of the measured contact points [m].
        angle_noise: of the measured orientation, about every axis [rad].
        velocity_noise: of the measured velocity [m/s].
        rate_noise: of the measured angular velocity [rad/s].
        delay: control ticks between measuring and the torques that follow from it.
        seed: of the noise.
        friction: factor on the friction that the controller counts on.
        dropout: the share of contacts that a tick does not see, at random.
        shake: acceleration with which the ground shakes, a sine in time, x, y, z at its peak; in
            the axes of the ground gravity sways by as much, and the controller feels it
            [m/s²].
        shake_frequency: [Hz].
    """

    pushes: tuple[Push, ...] = ()
    payload: float = 1.0
    payload_time: float = 0.0
    position_noise: float = 0.0
    angle_noise: float = 0.0
    velocity_noise: float = 0.0
    rate_noise: float = 0.0
    delay: int = 0
    seed: int = 0
    friction: float = 1.0
    dropout: float = 0.0
    shake: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shake_frequency: float = 2.0

    def __post_init__(self) -> None:
        as_positive(self.friction, "friction", "")
        if not 0 <= self.dropout < 1:
            raise InvalidInputError(f"dropout: got {self.dropout}, expected 0 to less than 1")
        if self.payload <= 0:
            raise InvalidInputError(f"payload: got {self.payload}, expected more than 0")
        if self.delay < 0:
            raise InvalidInputError(f"delay: got {self.delay}, expected 0 ticks or more")


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A closed-loop simulation, ready to run.

    Args:
        name: short, a word or two.
        summary: one line.
        model: a compiled ``mujoco.MjModel``; a run works on a copy.
        start: joint positions at time 0, shape (nq,), the object between the fingers: see
            :func:`graspforce.sim.close`.
        fingers: n of them; finger i makes contact i. None: whatever touches holds, by all motors.
        grips: where they touch at time 0, in the object's frame.
        motion: wanted motion of the object's centre of mass, and its yaw. Without it the object
            stays where it is. Without named fingers the yaw is from how the object is turned at
            the start.
        steps: the fingers' swings, when they leave and come back.
        body: the object, or the trunk of a robot on feet.
        ground: the geom that the feet stand on; None for a hand that holds ``body``.
        mu: the coefficient of friction that the controller assumes [-]; by default what the model
            says of each contact, and 0.5 for named fingers.
        alpha: weight of the linear limits, Eq. (16); by default that of a grip with twice the
            least force, and 5 for named fingers.
        c_max: ceiling of every normal force [N]; required with steps. By default none, and
            without named fingers 20 times the object's weight.
        turning_friction: torque that resists the object's yaw, such as a thread's [N·m]; the
            controller compensates it while the motion turns.
        method: what distributes the forces, the WBF servo or a minimum-norm SOCP.
        gains: of the control law.
        disturbance: what the controller's model leaves out.
        rate: control ticks a second [Hz]; the physics' step has to fit in a whole number of times.
        duration: [s].

    Raises:
        InvalidInputError: no MjModel, a number out of range, a joint in two fingers, more or fewer
            grips than fingers, steps without c_max, fingers without a motion, ticks too long for
            the stiffness of the law.
    """

    name: str
    summary: str
    model: Any
    start: Array
    fingers: tuple[Finger, ...] = ()
    grips: tuple[Grip, ...] = ()
    motion: Motion | None = None
    steps: tuple[FingerSwing, ...] = ()
    body: str = "object"
    ground: str | None = None
    mu: float | None = None
    alpha: float | None = None
    c_max: float | None = None
    turning_friction: float = 0.0
    method: Method = "wbf"
    gains: Gains = field(default_factory=Gains)
    disturbance: Disturbance = field(default_factory=Disturbance)
    rate: float = 500.0
    duration: float = 2.0

    def __post_init__(self) -> None:
        if not isinstance(self.model, mj.MjModel):
            raise InvalidInputError(
                f"model: got a {type(self.model).__name__}, expected an mujoco.MjModel"
            )
        object.__setattr__(self, "start", as_array(self.start, "start", (self.model.nq,)))
        joints = [name for finger in self.fingers for name in finger.joints]
        twice = [name for name in joints if joints.count(name) > 1]
        if twice or (self.fingers and not joints):
            raise InvalidInputError(
                f"fingers: got {f'{twice[0]!r} twice' if twice else 'no joints'}, expected joints "
                "that move one finger each"
            )
        if self.fingers:
            if self.motion is None:
                raise InvalidInputError("motion: missing; fingers came without it")
        elif self.steps or self.ground is not None:
            raise InvalidInputError(
                f"fingers: got none, expected them with {'steps' if self.steps else 'a ground'}"
            )
        for name, unit in (
            ("mu", ""), ("alpha", ""), ("c_max", "N"), ("rate", "Hz"), ("duration", "s"),
        ):  # fmt: skip
            if getattr(self, name) is not None:
                object.__setattr__(self, name, as_positive(getattr(self, name), name, unit))
        if self.method not in ("wbf", "minimum_norm"):
            raise InvalidInputError(f"method: got {self.method!r}, expected wbf or minimum_norm")
        if len(self.grips) != len(self.fingers):
            raise InvalidInputError(
                f"grips: got {len(self.grips)}, expected {len(self.fingers)}, one a finger"
            )
        if self.steps and self.c_max is None:
            raise InvalidInputError("c_max: missing; steps came without it")
        ratio = 1 / (self.rate * self.model.opt.timestep)
        if abs(ratio - round(ratio)) > 1e-9 or round(ratio) < 1:
            raise InvalidInputError(
                f"rate: got {self.rate:g} Hz, expected {1 / self.model.opt.timestep:g} Hz, "
                "the rate of the physics, or a whole fraction of it"
            )
        self.gains.require_ticks(1 / self.rate)
        if self.ticks < 1:
            raise InvalidInputError(
                f"duration: got {self.duration} s, expected at least one tick of {1 / self.rate} s"
            )

    @property
    def ticks(self) -> int:
        """T, the number of control ticks."""
        return round(self.duration * self.rate)

    @property
    def assumed_mu(self) -> float:
        """The coefficient of friction that the controller of named fingers assumes [-]."""
        return 0.5 if self.mu is None else self.mu

    def target(self, t: float) -> State:
        """Return where the motion of a trial with fingers should be at time t [s]."""
        assert self.motion is not None  # __post_init__
        return self.motion.at(t)

    @property
    def substeps(self) -> int:
        """Physics steps in a control tick."""
        return round(1 / (self.rate * self.model.opt.timestep))

    @property
    def schedule(self) -> Schedule:
        """The engagement of every contact over time."""
        return Schedule(len(self.fingers), tuple(step.release for step in self.steps), "smooth")
