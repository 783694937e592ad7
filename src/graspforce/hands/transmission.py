"""How motors move joints: through mimic joints, tendons, linkages, or one to one.

A robot has motions dq of its joints, shape (n_dofs,). Couplings (a mimic joint, a closed linkage)
allow only those with ``couplings @ dq = 0``; a drive, that is a motor at a joint or on a tendon,
moves by ``drives @ dq``. Turned around, every allowed motion is

    dq = driven @ dl + free @ dz

with dl the drives' motions and dz motions that no drive takes part in. By virtual work, contact
forces whose joint torques would be Q = J_full.T @ c on a robot with a motor at every joint need
``driven.T @ Q`` of the drives, and can be held only if ``free.T @ Q`` is 0.

Where drives are more than the motions that they move (a flexor and an extensor, muscles, two motors
on one motion), those motions of theirs are not independent, and their forces are not determined:
besides ``driven.T @ Q`` they may have any ``internal.T @ v``, which does no work on any allowed
motion. Some of them, as many as are independent, carry Q in ``driven``; each of the others has
zeros there, and its force is one of v.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array

# Singular values below this share of the largest are rounding, not a motion.
RANK_TOLERANCE = 1e-8


class Transmission(NamedTuple):
    """The joints' motions by drive, and those without any."""

    driven: Array
    """Joint motion per motion of each drive, shape (n_dofs, n_drives)."""
    free: Array
    """An orthonormal basis of the motions that no drive takes part in, shape (n_dofs, k)."""
    internal: Array
    """Forces of the drives that balance among themselves, shape (r, n_drives): a row has 1 for one
    drive that ``driven`` leaves out, and what others that it does not must give against it."""


def transmission(drives: Array, couplings: Array) -> Transmission:
    """Return how the drives move the joints.

    Args:
        drives: motion of each drive per joint motion, shape (n_drives, n_dofs).
        couplings: the joint motions for which ``couplings @ dq`` is not 0 are impossible,
            shape (p, n_dofs).
    """
    allowed = _null_space(couplings)
    moved = drives @ allowed
    carrying = _independent(moved)
    others = np.setdiff1d(np.arange(len(drives)), carrying)
    inverse = np.linalg.pinv(moved[carrying], rcond=RANK_TOLERANCE)
    driven = np.zeros(drives.shape[::-1])
    driven[:, carrying] = allowed @ inverse
    internal = np.zeros((len(others), len(drives)))
    internal[:, carrying] = _rounded(-moved[others] @ inverse)
    internal[np.arange(len(others)), others] = 1.0
    return Transmission(_rounded(driven), _rounded(allowed @ _null_space(moved)), internal)


def connected_dofs(moving: NDArray[np.bool_], rows: Array) -> NDArray[np.intp]:
    """Return the degrees of freedom in ``moving`` and all that ``rows`` couple them to."""
    while True:
        wider = moving | rows[rows[:, moving].any(axis=1)].astype(bool).any(axis=0)
        if (wider == moving).all():
            return np.flatnonzero(moving)
        moving = wider


def _independent(rows: Array) -> list[int]:
    """Return which rows make a basis of them all, in their order; well conditioned, earlier first.

    Of the rows at unit length, what those taken already leave of each is looked at, and the first
    that keeps half of the most is taken: a small change of the rows seldom changes which.
    """
    sizes = np.linalg.norm(rows, axis=1)
    left = rows / np.where(sizes > RANK_TOLERANCE * sizes.max(initial=0.0), sizes, np.inf)[:, None]
    taken: list[int] = []
    while True:
        lengths = np.linalg.norm(left, axis=1)
        most = lengths.max(initial=0.0)
        if most <= RANK_TOLERANCE:
            return sorted(taken)
        first = int(np.argmax(lengths >= most / 2))
        taken.append(first)
        along = left[first] / lengths[first]
        for _ in range(2):  # once more for what cancellation leaves
            left = left - np.outer(left @ along, along)
        left[first] = 0.0


def _null_space(rows: Array) -> Array:
    n = rows.shape[1]
    if not rows.any():
        return np.eye(n)
    _, sizes, right = np.linalg.svd(rows)
    return right[int((sizes > RANK_TOLERANCE * sizes[0]).sum()) :].T


def _rounded(matrix: Array) -> Array:
    """Set rounding to zero: fingers that share no joint must not seem to."""
    matrix[np.abs(matrix) <= 1e-12 * np.abs(matrix).max(initial=0.0)] = 0.0
    return matrix
