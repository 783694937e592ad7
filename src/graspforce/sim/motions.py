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
    """To a side and back, over and over, in position and yaw; from rest.

    Args:
        start: shape (3,) [m].
        way: from there to the far end, shape (3,) [m]; y is gone to and fro twice in a period.
        yaw: at the far end [rad].
        begin: when it sets off [s].
        period: [s].
    """

    start: Array
    way: Array
    yaw: float
    begin: float
    period: float

    def at(self, t: float) -> State:
        """Return the state at time t [s]."""
        time = max(t - self.begin, 0.0)
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
