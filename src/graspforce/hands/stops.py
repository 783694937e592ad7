"""Joints that lean on their stops: a stop pushes its joint back into the range, and only that."""

from __future__ import annotations

from collections.abc import Sequence
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
        rows = (self.rows * ~held.any(axis=0))[:, dofs]
        acting = rows.any(axis=1)
        names = tuple(np.array(self.names, dtype=object)[acting].tolist())
        return Stops(rows[acting], names)


def no_stops(n_dofs: int) -> Stops:
    """Return that nothing leans on a stop."""
    return Stops(np.zeros((0, n_dofs)), ())


def leaning(
    names: Sequence[str],
    rows: Array,
    positions: Array,
    ranges: Array,
    turns: NDArray[np.bool_],
) -> Stops:
    """Return the stops at which joints or tendons are.

    Args:
        names: theirs, n of them.
        rows: motion of each per joint motion, shape (n, n_dofs).
        positions: where each is, shape (n,) [rad, m].
        ranges: the ends of its range, shape (n, 2); infinite where there is none.
        turns: which are turns, shape (n,).
    """
    near = np.where(turns, _NEAR_TURN, _NEAR_SLIDE)
    low = positions <= ranges[:, 0] + near
    high = positions >= ranges[:, 1] - near
    which = np.concatenate((np.flatnonzero(low), np.flatnonzero(high)))
    return Stops(np.vstack((rows[low], -rows[high])), tuple(str(names[int(i)]) for i in which))
