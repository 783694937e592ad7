"""Fingers that release and regrasp (Section III-C.3): which can, how fast, and on which schedule.

The ceiling of a finger's normal force is engagement·c_max (Eq. 20). A schedule takes the
engagement from 1 to 0 before the finger leaves and back to 1 after it returned. At or below
``REMOVAL_THRESHOLD`` the contact is removed from the problem. Whether a finger can leave at all,
how low its engagement can go and how fast is what :func:`can_leave`, :func:`lowest_engagement`,
:func:`next_to_lift`, :func:`shortest_ramp` and :func:`payload_during_lift` answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import (
    Array,
    as_array,
    as_integer,
    as_number,
    as_positive,
    as_tuple,
    require_choice,
)
from graspforce.answers.regrasp import (
    Departure,
    Lift,
    Ramp,
    can_leave,
    lowest_engagement,
    next_to_lift,
    payload_during_lift,
    shortest_ramp,
)
from graspforce.errors import InvalidInputError
from graspforce.problem import REMOVAL_THRESHOLD

__all__ = [
    "REMOVAL_THRESHOLD",
    "Departure",
    "Lift",
    "Ramp",
    "Release",
    "Schedule",
    "can_leave",
    "is_removed",
    "linear",
    "lowest_engagement",
    "next_to_lift",
    "payload_during_lift",
    "shortest_ramp",
    "smooth",
]


def is_removed(engagement: ArrayLike) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Tell which contacts count as out of the grasp, same shape as ``engagement``."""
    return as_array(engagement, "engagement", None) <= REMOVAL_THRESHOLD


def linear(s: ArrayLike) -> Array:
    """Rise from 0 at s = 0 to 1 at s = 1 in a straight line, as in the paper; flat outside."""
    return np.clip(as_array(s, "s", None), 0.0, 1.0)


def smooth(s: ArrayLike) -> Array:
    """Rise from 0 at s = 0 to 1 at s = 1 with continuous second derivative; flat outside.

    The quintic s³ (10 − 15 s + 6 s²): its first and second derivatives vanish at both ends.
    """
    x = linear(s)
    return x**3 * (10 - 15 * x + 6 * x**2)


@dataclass(frozen=True, slots=True)
class Release:
    """One finger's absence: engagement 0 between ``leave`` and ``back``.

    Args:
        finger: index of the contact.
        leave: when it has released [s]; its engagement falls during ``ramp`` before that.
        back: when it touches again [s]; its engagement rises during ``ramp`` after that.
        ramp: length of each transition [s].
    """

    finger: int
    leave: float
    back: float
    ramp: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "finger", as_integer(self.finger, "Release.finger", 0))
        object.__setattr__(self, "ramp", as_positive(self.ramp, "Release.ramp", "s"))
        for name in ("leave", "back"):
            time = float(as_array(getattr(self, name), f"Release.{name}", (), finite=False))
            if math.isnan(time):  # infinity: never
                raise InvalidInputError(f"Release.{name}: got {time}, expected a time in s")
            object.__setattr__(self, name, time)
        if self.leave > self.back:
            raise InvalidInputError(
                f"Release.back: got {self.back} s, expected leave = {self.leave} s or later"
            )


@dataclass(frozen=True, slots=True)
class Schedule:
    """The engagement of every contact over time.

    Args:
        contacts: n, the number of contacts.
        releases: which finger is away when; one finger may appear several times.
        shape: "linear" as in the paper, or "smooth" (C²).
    """

    contacts: int
    releases: Sequence[Release] = ()
    shape: Literal["linear", "smooth"] = "linear"

    def __post_init__(self) -> None:
        object.__setattr__(self, "contacts", as_integer(self.contacts, "contacts", 1))
        object.__setattr__(self, "releases", as_tuple(self.releases, "releases", Release))
        for release in self.releases:
            if release.finger >= self.contacts:
                raise InvalidInputError(
                    f"Release.finger: got {release.finger}, expected less than {self.contacts}, "
                    "the number of contacts"
                )
        require_choice(self.shape, "shape", ("linear", "smooth"))

    def __call__(self, t: float) -> Array:
        """Return the engagement of every contact at time t [s], shape (n,)."""
        time = as_number(t, "t")
        rise = smooth if self.shape == "smooth" else linear
        engagement = np.ones(self.contacts)
        for release in self.releases:
            s = max(release.leave - time, time - release.back, 0.0) / release.ramp
            engagement[release.finger] = min(engagement[release.finger], rise(min(s, 1.0)))
        return engagement
