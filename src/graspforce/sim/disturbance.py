"""What goes wrong on purpose, without a word to the controller."""

from __future__ import annotations

from dataclasses import dataclass

from graspforce.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Push:
    """A force on the object's centre of mass for a while, half a sine in time.

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

    def __post_init__(self) -> None:
        if self.payload <= 0:
            raise InvalidInputError(f"payload: got {self.payload}, expected more than 0")
        if self.delay < 0:
            raise InvalidInputError(f"delay: got {self.delay}, expected 0 ticks or more")
