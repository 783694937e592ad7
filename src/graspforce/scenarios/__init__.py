"""Scenarios as data: object, hand, contacts, motion, schedule → a stream of force problems.

>>> from graspforce import scenarios
>>> scenario = scenarios.get("dynamic", duration=0.02)
>>> log = scenarios.run(scenario)
>>> log.normal_forces.shape
(5, 4)

The paper's own (Section IV) are ``static``, ``dynamic`` and ``regrasp``. Anything else is a
:class:`Scenario` of your own, or one of these changed with ``dataclasses.replace``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, Literal, Unpack, overload

from graspforce._util.arrays import came, require_keywords
from graspforce.errors import InvalidInputError
from graspforce.scenarios.log import Log, run
from graspforce.scenarios.paper import (
    RegraspOptions,
    ScenarioOptions,
    dynamic,
    regrasp,
    static,
)
from graspforce.scenarios.scenario import Cube, Scenario
from graspforce.scenarios.sweep import AlphaSweep, sweep_alpha

__all__ = [
    "NAMES",
    "AlphaSweep",
    "Cube",
    "Log",
    "Scenario",
    "dynamic",
    "get",
    "regrasp",
    "run",
    "static",
    "sweep_alpha",
]

_FACTORIES: dict[str, Callable[..., Scenario]] = {
    "static": static,
    "dynamic": dynamic,
    "regrasp": regrasp,
}

NAMES: tuple[str, ...] = tuple(_FACTORIES)
"""The scenarios that :func:`get` knows."""


@overload
def get(name: Literal["regrasp"], **overrides: Unpack[RegraspOptions]) -> Scenario: ...
@overload
def get(name: str, **overrides: Unpack[ScenarioOptions]) -> Scenario: ...
def get(name: object, **overrides: Any) -> Scenario:
    """Return a scenario by name.

    Args:
        name: one of ``NAMES``.
        **overrides: arguments of the function of that name: alpha, rate, duration, …

    Raises:
        InvalidInputError: an unknown name or override; the text lists the valid ones.
    """
    if not isinstance(name, str) or name not in _FACTORIES:
        raise InvalidInputError(f"name: got {came(name)}, expected one of {', '.join(NAMES)}")
    factory = _FACTORIES[name]
    require_keywords(overrides, inspect.signature(factory).parameters, f"scenario {name!r}")
    return factory(**overrides)
