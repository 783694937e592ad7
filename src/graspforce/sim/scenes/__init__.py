"""The simulations that come with graspforce, one file a scene."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from graspforce.errors import InvalidInputError
from graspforce.sim.scenes import allegro, bulb, cube, disturbance, quadruped
from graspforce.sim.trial import Trial

__all__ = ["NAMES", "get"]

_FACTORIES: dict[str, Callable[..., Trial | tuple[Trial, ...]]] = {
    "hold": cube.hold,
    "circle": cube.circle,
    "regrasp": cube.regrasp,
    "allegro": allegro.allegro,
    "bulb": bulb.bulb,
    "disturbance": disturbance.disturbance,
    "quadruped": quadruped.quadruped,
}

NAMES: tuple[str, ...] = tuple(_FACTORIES)
"""The scenes that :func:`get` knows."""


def get(name: str, **overrides: Any) -> tuple[Trial, ...]:
    """Return the trials of a scene by name; most scenes are one trial.

    Args:
        name: one of ``NAMES``.
        **overrides: arguments of the function of that name: alpha, rate, duration, …

    Raises:
        InvalidInputError: an unknown name or override, or a wrong value; the text lists the
            valid ones.
        MissingExtraError: a package that the scene's robot comes with is not installed.
    """
    if name not in _FACTORIES:
        raise InvalidInputError(f"name: got {name!r}, expected one of {', '.join(NAMES)}")
    factory = _FACTORIES[name]
    valid = inspect.signature(factory).parameters
    for key, value in overrides.items():
        if key not in valid:
            raise InvalidInputError(
                f"{key}: not an option of scene {name!r}; expected one of {', '.join(valid)}"
            )
        example: object = valid[key].default
        if not isinstance(value, int | float if isinstance(example, float) else type(example)):
            raise InvalidInputError(f"{key}: got {value!r}, expected such as {example!r}")
    trials = factory(**overrides)
    return (trials,) if isinstance(trials, Trial) else trials
