"""The state of a page's knobs: their ranges, their check, and their form in a link."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, cast
from urllib.parse import parse_qsl, urlencode

import numpy as np
import viser.transforms

from graspforce._util.arrays import Array, came
from graspforce.errors import InvalidInputError

Triple = tuple[float, float, float]

# What tells the firmness: alpha itself, or a wish of graspforce.firmness.choose.
FIRMNESS = ("alpha", "largest_normal", "times_least", "slip_reserve", "torque_reserve")

SHAPES = ("sphere", "box", "cylinder")


class Range(NamedTuple):
    """What a knob takes."""

    low: float
    high: float
    unit: str = ""


# A factor goes as far as a remedy may; below a thousandth nothing is left to see.
_FACTOR = Range(0.01, 20.0, "times")
RANGES: dict[str, Range] = {
    "alpha": Range(1e-2, 1e6),
    "wish": Range(0.0, 1e4),
    "friction": _FACTOR,
    "torque": _FACTOR,
    "ceiling": Range(0.0, 1e4, "N"),
    "load": Range(0.0, 1e3),
    "push": Range(-1e3, 1e3, "N"),
    "twist": Range(-1e2, 1e2, "N·m"),
    "tilt": Range(0.0, 180.0, "°"),
    "heading": Range(-180.0, 180.0, "°"),
    "move": Range(-1.0, 1.0, "m"),
    "turn": Range(-math.pi, math.pi, "rad"),
    "engagement": Range(0.0, 1.0),
    "time": Range(0.0, 1e6, "s"),
    "item": Range(0, 1e9),
    "size": Range(1e-3, 1.0, "m"),
}


class Pick(NamedTuple):
    """A contact that was chosen on an object's surface, in the object's frame."""

    finger: int
    point: Triple
    normal: Triple
    """Into the object."""


@dataclass(frozen=True, slots=True)
class Knobs:
    """Where every knob of a page stands.

    Args:
        firmness: what tells how firm the grip is, one of ``FIRMNESS``.
        alpha: weight of the limits, where alpha tells it.
        wish: the wish, where that tells it.
        friction: factor on all coefficients of friction.
        torque: factor on all torque limits.
        ceiling: of every normal force [N]; 0 leaves the ceilings that the grasp has.
        load: the payload's mass [kg], or the factor on the load of a grasp without a mass.
        push: force on the object beside its weight, at its centre, world axes [N].
        twist: torque on the object, world axes [N·m].
        tilt: how far gravity is turned away from straight down [°].
        heading: about z, from x, the direction to which it is tilted [°].
        move: how far the object is moved from where it belongs, world axes [m].
        turn: how it is turned, a rotation vector in world axes [rad].
        engagement: of every contact; those beyond its end are 1.
        time: of what is moving [s].
        item: the number of a grasp in a file.
        other: a further method whose forces are shown beside; empty for none.
        shape: of the object that an imported hand holds, one of ``SHAPES``.
        size: its diameter or longest edge [m].
        picks: the contacts on it.

    Raises:
        InvalidInputError: a value of the wrong kind or out of its range.
    """

    firmness: str = "alpha"
    alpha: float = 5.0
    wish: float = 2.0
    friction: float = 1.0
    torque: float = 1.0
    ceiling: float = 0.0
    load: float = 1.0
    push: Triple = (0.0, 0.0, 0.0)
    twist: Triple = (0.0, 0.0, 0.0)
    tilt: float = 0.0
    heading: float = 0.0
    move: Triple = (0.0, 0.0, 0.0)
    turn: Triple = (0.0, 0.0, 0.0)
    engagement: tuple[float, ...] = ()
    time: float = 0.0
    item: int = 0
    other: str = ""
    shape: str = "sphere"
    size: float = 0.05
    picks: tuple[Pick, ...] = ()

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            object.__setattr__(self, field.name, _checked(field.name, value, field.default))

    def changed(self, **changes: Any) -> Knobs:
        """Return the knobs with some of them turned.

        Raises:
            InvalidInputError: a value out of its range.
        """
        return dataclasses.replace(self, **changes)

    @property
    def gravity(self) -> Array:
        """The direction of gravity, shape (3,)."""
        return turned_down(self.tilt, self.heading) @ np.array([0.0, 0.0, -1.0])

    @property
    def applied(self) -> Array:
        """What acts on the object beside its weight, [push; twist], shape (6,) [N, N·m]."""
        return np.array([*self.push, *self.twist])

    def engagements(self, n: int) -> Array:
        """Return the engagement of n contacts."""
        given = self.engagement[:n]
        return np.array([*given, *[1.0] * (n - len(given))])

    # ---- as a link ---------------------------------------------------------------------------

    def to_query(self, base: Knobs) -> str:
        """Return what differs from ``base``, as the query of a link."""
        pairs = {
            field.name: value if isinstance(value, str) else json.dumps(value)
            for field in dataclasses.fields(self)
            if (value := getattr(self, field.name)) != getattr(base, field.name)
        }
        return urlencode(pairs)

    def from_query(self, query: str) -> Knobs:
        """Return the knobs with what a link's query changes.

        Raises:
            InvalidInputError: a knob that there is not, or a value that it does not take.
        """
        return self.from_texts(dict(parse_qsl(query)))

    def from_texts(self, texts: Mapping[str, str]) -> Knobs:
        """Return the knobs with values that are given as text, numbers and lists as in JSON.

        Raises:
            InvalidInputError: a knob that there is not, or a value that it does not take.
        """
        known = {field.name: field.default for field in dataclasses.fields(self)}
        changes: dict[str, Any] = {}
        for name, text in texts.items():
            if name not in known:
                raise InvalidInputError(
                    f"knob: got {name!r}, expected one of {', '.join(sorted(known))}"
                )
            try:
                changes[name] = text if isinstance(known[name], str) else json.loads(text)
            except ValueError:
                raise InvalidInputError(f"{name}: got {text!r}, expected a number") from None
        return self.changed(**changes)


def turned_down(tilt: float, heading: float) -> Array:
    """Return the rotation that tilts straight down towards a heading [°], shape (3, 3)."""
    a, b = math.radians(tilt), math.radians(heading)
    return rotation((-a * math.sin(b + math.pi), a * math.cos(b + math.pi), 0.0))


def direction_angles(direction: Array) -> tuple[float, float]:
    """Return tilt and heading [°] of a direction, as ``Knobs`` has them."""
    x, y, z = direction / np.linalg.norm(direction)
    return math.degrees(math.acos(min(max(-z, -1.0), 1.0))), math.degrees(math.atan2(y, x))


def rotation(vector: Triple) -> Array:
    """Return the rotation matrix of a rotation vector [rad], shape (3, 3)."""
    return np.array(viser.transforms.SO3.exp(np.array(vector)).as_matrix(), dtype=float)


def _checked(name: str, value: Any, default: Any) -> Any:
    """Return a knob's value in its own type."""
    if name == "picks":
        return _picks(value)
    if isinstance(default, str):
        choices = {"firmness": FIRMNESS, "shape": SHAPES}.get(name, (value,))
        if not isinstance(value, str) or value not in choices:
            expected = ", ".join(map(str, choices)) if name != "other" else "a method's name"
            raise InvalidInputError(f"{name}: got {came(value)}, expected {expected}")
        return value
    if isinstance(default, tuple):
        length = len(cast("tuple[Any, ...]", default))
        given = _items(value)
        if given is None or (length and len(given) != length):
            count = f"{length} numbers" if length else "numbers"
            raise InvalidInputError(f"{name}: got {came(value)}, expected {count}")
        return tuple(_number(name, each) for each in given)
    number = _number(name, value)
    return round(number) if isinstance(default, int) else number


def _items(value: Any) -> list[Any] | None:
    """Return the items of a list or tuple; None for anything else."""
    return list(value) if isinstance(value, list | tuple) else None  # pyright: ignore[reportUnknownArgumentType]


def _number(name: str, value: Any) -> float:
    low, high, unit = RANGES[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InvalidInputError(
            f"{name}: got {came(value)}, expected {low:g} to {high:g} {unit}".rstrip()
        )
    return float(value)


def _picks(value: Any) -> tuple[Pick, ...]:
    try:
        picks = tuple(Pick(int(i), _triple(p), _triple(n)) for i, p, n in value)
    except (TypeError, ValueError):
        picks = None
    if picks is None or any(
        each.finger < 0 or not np.isclose(math.hypot(*each.normal), 1.0) for each in picks
    ):
        raise InvalidInputError(
            f"picks: got {came(value)}, expected [finger, point, unit normal] each"
        )
    return picks


def _triple(value: Any) -> Triple:
    x, y, z = map(float, value)
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError
    return (x, y, z)
