"""How motors move joints: through mimic joints, tendons, linkages, or one to one.

A robot has motions dq of its joints, shape (n_dofs,). Couplings (a mimic joint, a closed linkage)
allow only those with ``couplings @ dq = 0``; a drive, that is a motor at a joint or on a tendon,
moves by ``drives @ dq``. Turned around, every allowed motion is

    dq = driven @ dl + free @ dz

with dl the drives' motions and dz motions that no drive takes part in. By virtual work, contact
forces whose joint torques would be Q = J_full.T @ c on a robot with a motor at every joint need
``driven.T @ Q`` of the drives, and can be held only if ``free.T @ Q`` is 0.

A joint that leans on a stop takes part as if the stop were a drive that only pushes: a motion off
the stop, ``stops @ dq``, is one more dl, whose force has to be 0 or more. That holds for stops that
bear what no drive does. One that acts on what one drive moves opens the drive's limit to its side.
Any other is left out, which asks for less than the hand could bear.

Where drives are more than the motions that they move (a flexor and an extensor, muscles, two motors
on one motion), those motions of theirs are not independent, and their forces are not determined:
besides ``driven.T @ Q`` they may have any ``internal.T @ v``, which does no work on any allowed
motion. Some of them, as many as are independent, carry Q in ``driven``; each of the others has
zeros there, and its force is one of v. No v loads a stop that bears what no drive does, and a stop
opens limits of drives that carry alone: so stops have no part of v.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._engine import native
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
    stopped: Array
    """Joint motion per motion off each stop that bears what no drive does, shape (n_dofs, s)."""
    bearing: tuple[int, ...]
    """Which of the stops these are."""
    beside: tuple[tuple[int, int, int], ...]
    """Stops that bear what one drive does: stop, drive, and 1 where it adds to the drive's torque,
    −1 where it takes from it.
    """


def transmission(drives: Array, couplings: Array, stops: Array | None = None) -> Transmission:
    """Return how the drives move the joints.

    Args:
        drives: motion of each drive per joint motion, shape (n_drives, n_dofs).
        couplings: the joint motions for which ``couplings @ dq`` is not 0 are impossible,
            shape (p, n_dofs).
        stops: joint motions away from the stops that joints lean on, shape (n_stops, n_dofs).
    """
    if stops is None or not len(stops):
        determined = _determined(drives, couplings)
        if determined is not None:
            return determined
    allowed = null_space(couplings)
    moved = drives @ allowed
    off = np.zeros((0, allowed.shape[1])) if stops is None else stops @ allowed
    carrying, bearing = _independent(moved), _bearing(off, moved)
    others, count = [i for i in range(len(drives)) if i not in carrying], len(carrying)
    inverse, left = _inverse(np.concatenate((moved[carrying], off[list(bearing)])))
    motions = _rounded(allowed @ inverse)
    driven = np.zeros(drives.shape[::-1])
    driven[:, carrying] = motions[:, :count]
    internal = np.zeros((len(others), len(drives)))
    if others:
        internal[:, carrying] = _rounded(-moved[others] @ inverse[:, :count])
        internal[np.arange(len(others)), others] = 1.0
    beside: list[tuple[int, int, int]] = []
    for i in range(len(off)):
        shares = _rounded(off[i] @ inverse)
        most = int(np.argmax(np.abs(shares))) if shares.any() else count
        if i not in bearing and np.count_nonzero(shares) == 1 and most < count:
            beside.append((i, carrying[most], int(np.sign(shares[most]))))
    return Transmission(
        driven, _rounded(allowed @ left), internal, motions[:, count:], bearing,
        tuple(beside),
    )  # fmt: skip


def _determined(drives: Array, couplings: Array) -> Transmission | None:
    """Return the transmission where drives and couplings fix every joint's motion, else None."""
    driven: Array | None = native.module.determined_motions(
        np.ascontiguousarray(drives, dtype=float), np.ascontiguousarray(couplings, dtype=float)
    )
    if driven is None:
        return None
    # Near where they do not, by drives of unit length, rank is for the singular values to tell.
    sizes = np.sqrt((drives * drives).sum(axis=1))
    if np.abs(driven * sizes).max(initial=0.0) > 1e3:
        return None
    none = np.zeros((len(driven), 0))
    return Transmission(driven, none, np.zeros((0, len(drives))), none, (), ())


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
    # Mostly all would be taken. Of unit rows, the least singular value's square is more than a
    # third of this determinant: the other squares' product is less than e, as their mean is.
    if np.linalg.det(left @ left.T) > 1e-9:
        return list(range(len(rows)))
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


def _bearing(rows: Array, of: Array) -> tuple[int, ...]:
    """Return which rows are independent of the rows ``of`` and of those chosen before them."""
    chosen: list[int] = []
    left = null_space(of) if len(rows) else of
    for i, row in enumerate(rows):
        beside = row @ left
        size = float(np.linalg.norm(beside))
        if size > 1e-6 * float(np.linalg.norm(row)):
            chosen.append(i)
            left = left @ null_space(beside[None])
    return tuple(chosen)


def independent_columns(matrix: Array) -> Array:
    """Return the matrix, or where its columns depend on each other a basis of what they span."""
    left, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
    rank = int((sizes > RANK_TOLERANCE * sizes.max(initial=0.0)).sum())
    return matrix if rank == matrix.shape[1] else left[:, :rank]


def null_space(rows: Array) -> Array:
    """Return an orthonormal basis of what the rows take to 0, shape (n, k)."""
    n = rows.shape[1]
    if not rows.any():
        return np.eye(n)
    _, sizes, right = np.linalg.svd(rows)
    return right[int((sizes > RANK_TOLERANCE * sizes[0]).sum()) :].T


def _inverse(rows: Array) -> tuple[Array, Array]:
    """Return the rows' pseudoinverse, shape (n, r), and what :func:`null_space` returns."""
    if not rows.any():
        return np.zeros(rows.shape[::-1]), np.eye(rows.shape[1])
    left, sizes, right = np.linalg.svd(rows)
    rank = int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    return (right[:rank].T / sizes[:rank]) @ left[:, :rank].T, right[rank:].T


def _rounded(matrix: Array) -> Array:
    """Set rounding to zero: fingers that share no joint must not seem to."""
    matrix[np.abs(matrix) <= 1e-12 * np.abs(matrix).max(initial=0.0)] = 0.0
    return matrix
