"""Motions of the object, and the wrench that a motion takes.

A motion is data: asked for a time, it returns position, yaw and their first two derivatives in
closed form. The paper moves its cube on a horizontal circle while it turns to and fro about the
vertical (Section IV-B), and holds it still at a pose (Section IV-A); :class:`Move`,
:class:`Sway` and :class:`Screw` are further ones, which begin at rest. :func:`wrench` turns a
motion into the f of W c = f: weight, inertia and angular acceleration.

Everything is in world axes, z up. Torques are about the centre of mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_array, as_number, as_positive
from graspforce.errors import InvalidInputError

GRAVITY = 9.81  # [m/s²]


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """How a body that turns about the vertical moves at one time; world axes.

    Attributes:
        position: of the centre of mass, shape (3,) [m].
        velocity: shape (3,) [m/s].
        acceleration: shape (3,) [m/s²].
        yaw: angle about z [rad].
        yaw_rate: [rad/s].
        yaw_acceleration: [rad/s²].
    """

    position: Array
    velocity: Array
    acceleration: Array
    yaw: float
    yaw_rate: float
    yaw_acceleration: float

    @property
    def rotation(self) -> Array:
        """R_world_object, shape (3, 3): v_world = R @ v_object."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    @property
    def angular_velocity(self) -> Array:
        """Shape (3,) [rad/s]."""
        return np.array([0.0, 0.0, self.yaw_rate])

    @property
    def angular_acceleration(self) -> Array:
        """Shape (3,) [rad/s²]."""
        return np.array([0.0, 0.0, self.yaw_acceleration])


@runtime_checkable
class Motion(Protocol):
    """A rigid motion with the vertical as its only axis of rotation."""

    def at(self, t: float) -> State:
        """Return the state at time t [s]."""
        ...


@dataclass(frozen=True, slots=True)
class Hold:
    """Standing still at a pose.

    Args:
        position: of the centre of mass, shape (3,) [m].
        yaw: angle about z [rad].
    """

    position: tuple[float, float, float]
    yaw: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _triple(self.position, "position"))
        object.__setattr__(self, "yaw", as_number(self.yaw, "yaw"))

    def at(self, t: float) -> State:
        """Return the state at time t [s]; always the same."""
        as_number(t, "t")
        return State(np.array(self.position), np.zeros(3), np.zeros(3), self.yaw, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Circle:
    """A horizontal circle, begun at +x of its centre, with yaw swinging as a sine.

    Position: centre + radius·(cos 2πt/period, sin 2πt/period, 0).
    Yaw: yaw_amplitude·sin(2π·yaw_frequency·t).

    Args:
        centre: shape (3,) [m].
        radius: of the circle [m].
        period: time of one turn [s].
        yaw_amplitude: of the sine, any sign [rad].
        yaw_frequency: of the sine [Hz].
    """

    centre: tuple[float, float, float]
    radius: float
    period: float
    yaw_amplitude: float = 0.0
    yaw_frequency: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", _triple(self.centre, "centre"))
        object.__setattr__(self, "radius", as_positive(self.radius, "radius", "m"))
        object.__setattr__(self, "period", as_positive(self.period, "period", "s"))
        object.__setattr__(self, "yaw_amplitude", as_number(self.yaw_amplitude, "yaw_amplitude"))
        object.__setattr__(
            self, "yaw_frequency", as_positive(self.yaw_frequency, "yaw_frequency", "Hz")
        )

    def at(self, t: float) -> State:
        """Return the state at time t [s]."""
        time = as_number(t, "t")
        turn = 2 * math.pi / self.period
        cos, sin = math.cos(turn * time), math.sin(turn * time)
        arm = self.radius * np.array([cos, sin, 0.0])
        along = self.radius * np.array([-sin, cos, 0.0])
        swing = 2 * math.pi * self.yaw_frequency
        yaw = self.yaw_amplitude * math.sin(swing * time)
        return State(
            position=np.array(self.centre) + arm,
            velocity=turn * along,
            acceleration=-(turn**2) * arm,
            yaw=yaw,
            yaw_rate=self.yaw_amplitude * swing * math.cos(swing * time),
            yaw_acceleration=-(swing**2) * yaw,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A straight line, and a turn about the vertical, from rest to rest.

    The acceleration is continuous.

    Args:
        start: shape (3,) [m].
        way: from there to the end, shape (3,) [m].
        begin: time at which the motion begins [s].
        duration: of the motion [s].
        yaw: of the whole turn [rad].
    """

    start: Array
    way: Array
    begin: float
    duration: float
    yaw: float = 0.0

    def __post_init__(self) -> None:
        _check(self, vectors=("start", "way"), numbers=("begin", "yaw"), positive=("duration",))

    def at(self, t: float) -> State:
        """Return the state at time t [s]."""
        s = min(max((as_number(t, "t") - self.begin) / self.duration, 0.0), 1.0)
        share = s**3 * (10 - 15 * s + 6 * s**2)
        rate = 30 * s**2 * (1 - s) ** 2 / self.duration
        curve = 60 * s * (1 - s) * (1 - 2 * s) / self.duration**2
        return State(
            self.start + share * self.way, rate * self.way, curve * self.way,
            share * self.yaw, rate * self.yaw, curve * self.yaw,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Sway:
    """A periodic motion between two poses, in position and yaw; from rest.

    Args:
        start: shape (3,) [m].
        way: from there to the other pose, shape (3,) [m]; y has twice the frequency.
        yaw: at the other pose [rad].
        begin: time at which the motion begins [s].
        period: of x, z and yaw [s].
    """

    start: Array
    way: Array
    yaw: float
    begin: float
    period: float

    def __post_init__(self) -> None:
        _check(self, vectors=("start", "way"), numbers=("yaw", "begin"), positive=("period",))

    def at(self, t: float) -> State:
        """Return the state at time t [s]."""
        time = max(as_number(t, "t") - self.begin, 0.0)
        w = 2 * math.pi / self.period * np.array([1.0, 2.0, 1.0, 1.0])
        far = np.append(self.way, self.yaw) / 2
        place = far * (1 - np.cos(w * time))
        rate = far * w * np.sin(w * time)
        curve = far * w**2 * np.cos(w * time) * (t >= self.begin)
        return State(
            self.start + place[:3], rate[:3], curve[:3],
            float(place[3]), float(rate[3]), float(curve[3]),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Screw:
    """A turn about the vertical that advances along it, from rest to rest.

    The rate rises to its constant value and falls again with continuous angular acceleration.

    Args:
        start: shape (3,) [m].
        angle: of the whole turn [rad].
        rate: of the turn between rise and fall [rad/s].
        ramp: how long rise and fall take, each [s].
        pitch: advance along z in a whole turn [m].
    """

    start: Array
    angle: float
    rate: float
    ramp: float
    pitch: float

    def __post_init__(self) -> None:
        _check(self, vectors=("start",), numbers=("pitch",), positive=("angle", "rate", "ramp"))

    @property
    def duration(self) -> float:
        """When it comes to rest [s]."""
        return self.angle / self.rate + self.ramp

    def at(self, t: float) -> State:
        """Return the state at time t [s]."""
        rise, fall = as_number(t, "t") / self.ramp, (t - self.angle / self.rate) / self.ramp
        yaw, rate, acceleration = (
            self.rate * size * (_rise(rise, order) - _rise(fall, order))
            for order, size in enumerate((self.ramp, 1.0, 1 / self.ramp))
        )
        advance = np.array([0.0, 0.0, self.pitch / (2 * math.pi)])
        return State(
            self.start + yaw * advance, rate * advance, acceleration * advance,
            yaw, rate, acceleration,
        )  # fmt: skip


def _rise(s: float, order: int) -> float:
    """Return the integral from 0 of the smooth step s³(10 − 15 s + 6 s²), or its derivatives."""
    x = min(max(s, 0.0), 1.0)
    match order:
        case 0:
            return x**4 * (2.5 - 3 * x + x**2) + max(s - 1, 0.0)
        case 1:
            return x**3 * (10 - 15 * x + 6 * x**2)
        case _:
            return 30 * x**2 * (1 - x) ** 2


def wrench(
    mass: float,
    inertia: ArrayLike,
    acceleration: ArrayLike = (0.0, 0.0, 0.0),
    angular_velocity: ArrayLike = (0.0, 0.0, 0.0),
    angular_acceleration: ArrayLike = (0.0, 0.0, 0.0),
    gravity: float = GRAVITY,
) -> Array:
    """Return the wrench that the fingers must exert for a motion, about the centre of mass.

    Args:
        mass: of the body [kg].
        inertia: about the centre of mass in world axes, shape (3, 3), symmetric and positive
            definite; or a scalar, the moment about a vertical principal axis, for bodies that
            turn about the vertical only [kg·m²].
        acceleration: of the centre of mass, shape (3,) [m/s²].
        angular_velocity: ω, shape (3,) [rad/s].
        angular_acceleration: dω/dt, shape (3,) [rad/s²].
        gravity: pulls along −z [m/s²]; 0 for none.

    Returns:
        f = [m (a + g e_z); I dω/dt + ω × I ω], shape (6,) [N, N·m], world axes.

    Raises:
        InvalidInputError: a wrong shape or sign, or a horizontal rotation with a scalar inertia.
    """
    m = as_positive(mass, "mass", "kg")
    a = as_array(acceleration, "acceleration", (3,))
    omega = as_array(angular_velocity, "angular_velocity", (3,))
    omega_dot = as_array(angular_acceleration, "angular_acceleration", (3,))
    tensor = as_array(inertia, "inertia", None)
    if tensor.ndim == 0:
        vertical = as_positive(float(tensor), "inertia", "kg·m²")
        if omega[:2].any() or omega_dot[:2].any():
            raise InvalidInputError(
                "inertia: got a scalar, expected shape (3, 3) for a rotation about other axes "
                "than the vertical"
            )
        torque = vertical * omega_dot
    else:
        tensor = as_array(tensor, "inertia", (3, 3))
        if not np.allclose(tensor, tensor.T, rtol=0, atol=1e-9 * np.abs(tensor).max()):
            raise InvalidInputError(f"inertia: got {tensor.tolist()}, expected it symmetric")
        least = float(np.linalg.eigvalsh(tensor)[0])
        if least <= 0:
            raise InvalidInputError(
                f"inertia: got a least principal moment of {least:g} kg·m², expected more than 0"
            )
        torque = tensor @ omega_dot + np.cross(omega, tensor @ omega)
    force = m * (a + np.array([0.0, 0.0, as_number(gravity, "gravity")]))
    return np.concatenate((force, torque))


def _check(
    motion: Any, vectors: tuple[str, ...], numbers: tuple[str, ...], positive: tuple[str, ...]
) -> None:
    """Put checked values in the place of a motion's arguments."""
    checked: dict[str, Any] = {
        **{name: as_array(getattr(motion, name), name, (3,)) for name in vectors},
        **{name: as_number(getattr(motion, name), name) for name in numbers},
        **{name: as_positive(getattr(motion, name), name) for name in positive},
    }
    for name, value in checked.items():
        object.__setattr__(motion, name, value)


def _triple(value: ArrayLike, name: str) -> tuple[float, float, float]:
    x, y, z = as_array(value, name, (3,)).tolist()
    return (x, y, z)
