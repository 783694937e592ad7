"""Motions beside those of the paper: from one place to another, to and fro, and a screw's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from graspforce._arrays import Array
from graspforce.trajectory import State


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """From rest to rest in a straight line, with continuous acceleration.

    Args:
        start: shape (3,) [m].
        way: shape (3,) [m].
        begin: when it sets off [s].
        duration: [s].
    """

    start: Array
    way: Array
    begin: float
    duration: float

    def at(self, t: float) -> State:
        """Return the state at time t [s]."""
        s = min(max((t - self.begin) / self.duration, 0.0), 1.0)
        return State(
            self.start + s**3 * (10 - 15 * s + 6 * s**2) * self.way,
            30 * s**2 * (1 - s) ** 2 / self.duration * self.way,
            60 * s * (1 - s) * (1 - 2 * s) / self.duration**2 * self.way,
            0.0, 0.0, 0.0,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Sway:
    """To and fro about a place, in position and yaw, from rest.

    Args:
        centre: shape (3,) [m].
        amplitude: shape (3,) [m].
        yaw_amplitude: [rad].
        period: [s].
    """

    centre: Array
    amplitude: Array
    yaw_amplitude: float
    period: float

    def at(self, t: float) -> State:
        """Return the state at time t [s]: the way there and back is (1 − cos)/2, squared in z."""
        w = 2 * math.pi / self.period
        wave = np.array([math.sin(w * t), math.sin(2 * w * t), (1 - math.cos(w * t)) / 2])
        rate = np.array([w * math.cos(w * t), 2 * w * math.cos(2 * w * t), w * math.sin(w * t) / 2])
        curve = np.array(
            [-(w**2) * math.sin(w * t), -4 * w**2 * math.sin(2 * w * t), w**2 * math.cos(w * t) / 2]
        )
        yaw = self.yaw_amplitude
        return State(
            self.centre + wave * self.amplitude, rate * self.amplitude, curve * self.amplitude,
            yaw * float(wave[0]), yaw * float(rate[0]), yaw * float(curve[0]),
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

    @property
    def duration(self) -> float:
        """When it comes to rest [s]."""
        return self.angle / self.rate + self.ramp

    def at(self, t: float) -> State:
        """Return the state at time t [s]."""
        rise, fall = t / self.ramp, (t - self.angle / self.rate) / self.ramp
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
