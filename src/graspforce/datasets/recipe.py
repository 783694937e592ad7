"""What is to be done with every row: wishes, directions of gravity, values for all rows.

A :class:`Recipe` is checked once, stands in the target's manifest, and goes to the workers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from graspforce._util.arrays import Array, as_array, as_number, require_choice
from graspforce.answers.wishes import Wishes
from graspforce.contact import FPC, PCWF, SFC
from graspforce.datasets.schema import NUMBERS, require_column
from graspforce.errors import InvalidInputError

SPHERES = ("sphere", "sphere20")
MODELS = ("FPC", "PCWF", "SFC")

# g, with which a mass becomes a weight [m/s²]; that of MuJoCo's default and of most simulators.
GRAVITY = 9.81


@dataclass(frozen=True)
class Recipe:
    """What is to be done with every row; see :func:`graspforce.datasets.solve_dataset`."""

    keys: tuple[str, ...] = ()
    values: dict[str, Any] = field(default_factory=dict[str, Any])
    gravity: str | None = None
    largest_normal: float | None = None
    times_least: float | None = None
    slip_reserve: float | None = None
    torque_reserve: float | None = None
    sensitivities: tuple[str, ...] = ()
    hand: str | None = None
    fingertips: tuple[str, ...] = ()
    tau_max: float | None = None
    tol: float = 1e-9
    max_steps: int = 200

    @property
    def wishes(self) -> Wishes:
        """The hard wishes."""
        return Wishes(self.largest_normal, self.slip_reserve, self.torque_reserve)

    @property
    def wished(self) -> bool:
        """Whether there is any wish."""
        return self.times_least is not None or bool(self.wishes.given)

    @property
    def directions(self) -> Array | None:
        """The directions of gravity, shape (d, 3), in the axes of the contacts; None for one."""
        return None if self.gravity is None else sphere(self.gravity)

    def check(self) -> None:
        """Raise where something cannot be asked for, whatever the rows are.

        Raises:
            InvalidInputError: a wish out of range, an unknown word.
        """
        if self.gravity is not None:
            require_choice(self.gravity, "gravity", SPHERES)
        _ = self.wishes
        if self.times_least is not None:
            times = as_number(self.times_least, "times_least")
            if times <= 1:
                raise InvalidInputError(
                    f"times_least: got {times:g}, expected more than 1, the least possible force"
                )
        for name in self.sensitivities:
            if name not in ("W", "f", "J", "mu", "alpha", "c_max", "tau_lo", "tau_hi"):
                raise InvalidInputError(
                    f"sensitivities: got {name!r}, expected W, f, J, mu, alpha, c_max, tau_lo or "
                    "tau_hi"
                )
        if self.fingertips and self.hand is None:
            raise InvalidInputError("hand: missing; fingertips came without it")


def as_values(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return columns with one value for all rows, as plain lists and numbers.

    Raises:
        InvalidInputError: no column of the format, or not numbers.
    """
    values: dict[str, Any] = {}
    for name, value in given.items():
        require_column(name)
        if value is None:
            continue
        if name in NUMBERS:
            values[name] = as_array(value, name, None, finite=False).tolist()
        else:
            values[name] = model_names(value) if name == "models" else list(value)
    return values


def model_names(models: Any) -> str | list[str]:
    """Return contact models by name: FPC, PCWF, SFC, from texts, models or classes.

    Raises:
        InvalidInputError: something else.
    """
    if isinstance(models, list | tuple):
        return [str(model_names(each)) for each in cast("list[Any]", models)]
    name = models
    for kind in (FPC, PCWF, SFC):
        if models is kind or isinstance(models, kind):
            name = kind.__name__
    require_choice(name, "models", MODELS)
    return str(name)


def sphere(name: str) -> Array:
    """Return directions of gravity that are spread evenly, shape (6 or 20, 3).

    ``sphere``: both ways along the three axes, as most data sets of grasps are judged;
    ``sphere20``: the corners of a regular dodecahedron.
    """
    if name == "sphere":
        return np.repeat(np.eye(3), 2, axis=0) * np.array([1.0, -1.0] * 3)[:, None]
    golden = (1 + 5**0.5) / 2
    corners = [[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)]
    for a in (1 / golden, -1 / golden):
        for b in (golden, -golden):
            corners += [[0, a, b], [a, b, 0], [b, 0, a]]
    return np.array(corners, dtype=float) / 3**0.5
