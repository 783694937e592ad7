"""Joints that lean on their stops: a stop pushes its joint back into the range, and only that."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array

# A joint this close to the end of its range, or beyond, is at the stop: MuJoCo's stops are soft,
# and a file's angles are rounded.
_NEAR_TURN = 1e-3  # [rad]
_NEAR_SLIDE = 1e-4  # of slides and tendons [m]


class Stops(NamedTuple):
    """The stops that joints or tendons lean on."""

    rows: Array
    """Motion off each stop per joint motion, shape (n_stops, n_dofs)."""
    names: tuple[str, ...]
    """Of the joints or tendons."""

    def on(self, dofs: NDArray[np.intp], held: Array) -> Stops:
        """Return those that act on ``dofs``, by these: not on what ``held`` keeps still.

        Args:
            dofs: degrees of freedom.
            held: couplings that lock joints, shape (p, n_dofs of the robot).
        """
        if not len(self.rows):
            return no_stops(len(dofs))
        rows = (self.rows * ~held.any(axis=0))[:, dofs]
        acting = rows.any(axis=1)
        names = tuple(np.array(self.names, dtype=object)[acting].tolist())
        return Stops(rows[acting], names)


def no_stops(n_dofs: int) -> Stops:
    """Return that nothing leans on a stop."""
    return Stops(np.zeros((0, n_dofs)), ())


class Ends(NamedTuple):
    """The ends of the ranges of n joints or tendons, as far as they can lean there."""

    low: Array
    """At or below this they are at the lower stop, shape (n,)."""
    high: Array

    def leaning(
        self, positions: Array, rows: Callable[[], Array], name: Callable[[int], str]
    ) -> Stops | None:
        """Return the stops that are leant on; None for none.

        Args:
            positions: where each is, shape (n,) [rad, m].
            rows: returns the motion of each per joint motion, shape (n, n_dofs).
            name: returns the name of one by its place.
        """
        low, high = positions <= self.low, positions >= self.high
        if not (low.any() or high.any()):
            return None
        which = np.concatenate((np.flatnonzero(low), np.flatnonzero(high)))
        moved = rows()
        return Stops(
            np.vstack((moved[low], -moved[high])), tuple(name(each) for each in which.tolist())
        )


def ends(ranges: Array, turns: NDArray[np.bool_]) -> Ends:
    """Return the ends of ranges.

    Args:
        ranges: lower and upper, shape (n, 2) [rad, m]; infinite where there is none.
        turns: which are turns, shape (n,); the others are slides or tendons.
    """
    near = np.where(turns, _NEAR_TURN, _NEAR_SLIDE)
    return Ends(ranges[:, 0] + near, ranges[:, 1] - near)
