"""Torque limits of imported robots: from the file, or given by the user; never just believed.

A file's limit may be the motor's, or a number that its author put there because the format asks
for one (15 or 1000 N·m on a finger joint that gives 0.7). Nobody can tell from the file alone, so
implausible ones are reported and used, missing ones are refused, and what the user gives wins.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from graspforce._util.arrays import Array, as_positive
from graspforce.errors import InvalidInputError, ModelImportError

# From here on a limit is reported. No finger joint gives 10 N·m; a leg's does, and its user can
# say so with tau_max. A gripper's slide or a tendon may well pull with 100 N.
IMPLAUSIBLE_TORQUE = 10.0
IMPLAUSIBLE_FORCE = 1000.0


class DriveLimit(NamedTuple):
    """A drive and the file's limits; infinite where the file has none, 0 and 0 where no motor."""

    name: str
    unit: str
    lo: float
    hi: float
    moment_arm: float
    """The largest torque at a hinge per unit of the drive's own; 0 where there is no hinge."""


class JointRanges(NamedTuple):
    """Joints whose torque the file limits, whatever drives pull at them: tendons, say."""

    names: tuple[str, ...]
    arms: Array
    """Torque at each of the joints per force of each drive, shape (p, n_drives)."""
    lo: Array
    """shape (p,) [N·m; N for slides]."""
    hi: Array


def no_ranges(n_drives: int) -> JointRanges:
    """Return the ranges of no joints."""
    return JointRanges((), np.zeros((0, n_drives)), np.zeros(0), np.zeros(0))


class Limits(NamedTuple):
    """What holds for the drives."""

    lo: Array
    """shape (n_drives,) [N·m, N]."""
    hi: Array
    warnings: tuple[str, ...]
    """Limits that may be none of the motor's, a sentence each."""


def as_tau_max(
    tau_max: float | Mapping[str, float] | None, names: Sequence[str]
) -> dict[str, float]:
    """Return the limits that the user gives, by name; one number stands for all.

    Raises:
        InvalidInputError: a limit that is not positive, or for a name that is not there.
    """
    if tau_max is None:
        return {}
    if not isinstance(tau_max, Mapping):
        size = as_positive(tau_max, "tau_max", "N·m")
        return dict.fromkeys(names, size)
    unknown = [name for name in tau_max if name not in names]
    if unknown:
        raise InvalidInputError(
            f"tau_max: got a limit for {unknown[0]!r}, expected one of {', '.join(names)}"
        )
    return {name: as_positive(each, f"tau_max[{name!r}]") for name, each in tau_max.items()}


def has_motor(drive: DriveLimit, given: Mapping[str, float]) -> bool:
    """Return whether a drive can push at all, by the file or by what the user says."""
    return drive.name in given or drive.lo < drive.hi


def _user_range(drive: DriveLimit, size: float) -> tuple[float, float]:
    """Return the range of a drive that the user limits to ``size``."""
    is_motor = drive.lo < drive.hi
    lo = 0.0 if is_motor and drive.lo >= 0 else -size
    hi = 0.0 if is_motor and drive.hi <= 0 else size
    return lo, hi


def limits(drives: Sequence[DriveLimit], given: Mapping[str, float]) -> Limits:
    """Return the torque limits that hold: the user's, else the file's.

    The user's hold both ways, or one way where the file's motor acts one way only.

    Raises:
        ModelImportError: neither the file nor the user gives a limit.
    """
    missing = [
        each.name
        for each in drives
        if each.name not in given and not -np.inf < each.lo < each.hi < np.inf
    ]
    if missing:
        raise ModelImportError(
            f"the model has no torque limit for {', '.join(missing)}: give tau_max, one number "
            f"for all joints or a mapping from names [N·m]"
        )
    implausible: dict[str, list[str]] = {}
    for each in drives:
        size = max(-each.lo, each.hi)
        large = size * each.moment_arm >= IMPLAUSIBLE_TORQUE or (
            each.unit == "N" and size >= IMPLAUSIBLE_FORCE
        )
        if large and each.name not in given:
            implausible.setdefault(f"{size:g} {each.unit}", []).append(each.name)
    ranges = [
        _user_range(each, given[each.name]) if each.name in given else (each.lo, each.hi)
        for each in drives
    ]
    return Limits(
        np.array([lo for lo, _ in ranges]),
        np.array([hi for _, hi in ranges]),
        tuple(
            f"the file's limit of {size} for {', '.join(names)} may be a placeholder; give "
            f"tau_max if it is not the motor's"
            for size, names in implausible.items()
        ),
    )
