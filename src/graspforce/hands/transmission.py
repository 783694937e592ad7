"""How motors move joints: through mimic joints, tendons, linkages, or one to one.

A robot has motions dq of its joints, shape (n_dofs,). Couplings (a mimic joint, a closed linkage)
allow only those with ``couplings @ dq = 0``; a drive, that is a motor at a joint or on a tendon,
moves by ``drives @ dq``. Turned around, every allowed motion is

    dq = driven @ dl + free @ dz

with dl the drives' motions and dz motions that no drive takes part in. By virtual work, contact
forces whose joint torques would be Q = J_full.T @ c on a robot with a motor at every joint need
``driven.T @ Q`` of the drives, and can be held only if ``free.T @ Q`` is 0.
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


def transmission(drives: Array, couplings: Array) -> Transmission:
    """Return how the drives move the joints.

    Args:
        drives: motion of each drive per joint motion, shape (n_drives, n_dofs).
        couplings: the joint motions for which ``couplings @ dq`` is not 0 are impossible,
            shape (p, n_dofs).

    Drives that act on the same motion share its load, each in proportion to its moment arm.
    """
    allowed = _null_space(couplings)
    moved = drives @ allowed
    return Transmission(
        _rounded(allowed @ np.linalg.pinv(moved, rcond=RANK_TOLERANCE)),
        _rounded(allowed @ _null_space(moved)),
    )


def connected_dofs(moving: NDArray[np.bool_], rows: Array) -> NDArray[np.intp]:
    """Return the degrees of freedom in ``moving`` and all that ``rows`` couple them to."""
    while True:
        wider = moving | rows[rows[:, moving].any(axis=1)].astype(bool).any(axis=0)
        if (wider == moving).all():
            return np.flatnonzero(moving)
        moving = wider


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
