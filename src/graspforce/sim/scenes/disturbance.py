"""The paper's circle under disturbances, at several alpha and with a minimum-norm SOCP.

A firm grip (small alpha) keeps a margin of friction for what the model leaves out, at higher joint
torques. A minimum-norm SOCP puts contacts on the boundary of their cones, without margin; with a
smaller mu than the true one, the margin is the difference. The rate is the paper's, 250 ticks a
second, so that two ticks of delay are 8 ms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspforce.scenarios.paper import CIRCLE
from graspforce.sim.scenes import cube
from graspforce.sim.scenes.selection import select
from graspforce.sim.trial import Disturbance, Push, Trial

ALPHAS = (0.1, 1.0, 5.0, 100.0)

# The coefficient of friction that the controller assumes [-].
_MU = 0.5

_PUSHES = (
    Push((2.5, 0.0, 0.0), start=0.3, duration=0.1),
    Push((0.0, -2.5, 0.0), start=0.7, duration=0.1),
    Push((0.0, 0.0, -2.5), start=1.1, duration=0.1),
)  # fmt: skip

KINDS: dict[str, tuple[str, dict[str, Any]]] = {
    "none": ("nothing wrong", {}),
    "push": (
        "pushed with the cube's weight, for 0.1 s, thrice",
        {"disturbance": Disturbance(_PUSHES)},
    ),
    "payload": (
        "the payload doubles after 0.5 s",
        {"disturbance": Disturbance(payload=2.0, payload_time=0.5)},
    ),
    "friction": ("friction 0.35 instead of 0.5", {"true_mu": 0.35}),
    "noise": (
        "noise: 1 mm, 1°, 20 mm/s, 0.3 rad/s",
        {
            "disturbance": Disturbance(
                position_noise=1e-3, angle_noise=float(np.radians(1.0)), velocity_noise=0.02,
                rate_noise=0.3,
            )
        },
    ),
    "delay": ("two ticks (8 ms) of delay", {"disturbance": Disturbance(delay=2)}),
}  # fmt: skip


def disturbance(
    kind: str = "all", method: str = "all", *, rate: float = 250.0, duration: float = 2.0
) -> tuple[Trial, ...]:
    """Return the trials of one disturbance or all, with one grip or all.

    Args:
        kind: one of ``KINDS``, or "all".
        method: "alpha=0.1", "alpha=1", "alpha=5", "alpha=100", "minimum_norm",
            "minimum_norm_80" (which is told 80 % of the friction that the others count on), or
            "all".
        rate: control ticks a second [Hz].
        duration: [s].

    Raises:
        InvalidInputError: an unknown kind or method.
    """
    methods: dict[str, dict[str, Any]] = {f"alpha={alpha:g}": {"alpha": alpha} for alpha in ALPHAS}
    methods["minimum_norm"] = {"method": "minimum_norm"}
    methods["minimum_norm_80"] = {"method": "minimum_norm", "mu": 0.8 * _MU}
    return tuple(
        _trial(
            each, description, grip, options | methods[grip] | {"rate": rate, "duration": duration}
        )
        for each, (description, options) in select(kind, KINDS, "kind").items()
        for grip in select(method, methods, "method")
    )


def _trial(kind: str, description: str, grip: str, options: dict[str, Any]) -> Trial:
    true_mu = options.pop("true_mu", _MU)
    return cube.trial(f"{kind}, {grip}", description, CIRCLE, true_mu, **({"mu": _MU} | options))
