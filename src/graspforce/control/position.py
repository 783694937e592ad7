"""Torques through motors that take positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce._util.arrays import Array, as_array, require


class PositionCommand(NamedTuple):
    """What to send to position servos, and what comes of it.

    Attributes:
        q: commanded positions, shape (n,) [rad; m for slides].
        tau: the torques that these make, shape (n,) [N·m; N].
        saturated: where they are not the wanted ones, shape (n,).
    """

    q: Array
    tau: Array
    saturated: NDArray[np.bool_]


def position_command(
    tau: ArrayLike,
    q: ArrayLike,
    stiffness: ArrayLike,
    *,
    damping: ArrayLike = 0.0,
    q_dot: ArrayLike = 0.0,
    q_min: ArrayLike = -np.inf,
    q_max: ArrayLike = np.inf,
    tau_max: ArrayLike = np.inf,
) -> PositionCommand:
    """Return the positions to command so that position servos make wanted torques.

    A servo makes ``stiffness·(command − q) − damping·q_dot``, as far as its torque limit lets it;
    the command is where that is ``tau``. The stiffness is the servo's own: where it is wrong by a
    tenth the torques are, too. Every argument but ``q`` may be one number for all n servos.

    Args:
        tau: wanted torques, without what the servo's own damping takes, shape (n,) [N·m; N].
        q: where the joints are, shape (n,) [rad; m].
        stiffness: of the servos, above 0, shape (n,) [N·m/rad; N/m].
        damping: of the servos, shape (n,) [N·m·s/rad; N·s/m].
        q_dot: joint velocities, shape (n,) [rad/s; m/s].
        q_min: least command that the servo takes, shape (n,) [rad; m].
        q_max: largest command, above ``q_min``, shape (n,) [rad; m].
        tau_max: largest torque of the servo, above 0, shape (n,) [N·m; N].

    Raises:
        InvalidInputError: a wrong shape, numbers that are not finite (limits may be infinite), a
            stiffness or torque limit that is not positive, limits the wrong way round.
    """
    now = as_array(q, "q", ("n",))

    def of_all(values: ArrayLike, name: str) -> Array:
        return as_array(values, name, now.shape, broadcast=True)

    def limit(values: ArrayLike, name: str) -> Array:
        given = as_array(values, name, now.shape, broadcast=True, finite=False)
        require(~np.isnan(given), name, given, "a number")
        return given

    wanted, k, d = of_all(tau, "tau"), of_all(stiffness, "stiffness"), of_all(damping, "damping")
    low, high, most = limit(q_min, "q_min"), limit(q_max, "q_max"), limit(tau_max, "tau_max")
    rates = of_all(q_dot, "q_dot")
    require(k > 0, "stiffness", k, "more than 0")
    require(most > 0, "tau_max", most, "more than 0")
    require(low < high, "q_min", low, "less than q_max")
    command = np.clip(now + (np.clip(wanted, -most, most) + d * rates) / k, low, high)
    made = np.clip(k * (command - now) - d * rates, -most, most)
    rounding = 1e-9 * (np.abs(wanted) + k * np.abs(now)) + 1e-12
    return PositionCommand(command, made, np.abs(made - wanted) > rounding)
