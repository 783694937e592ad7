"""Contact points, normals and masses of many grasps at once, made into grasp maps and wrenches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.contact import LEAST_ACROSS, UNIT_TOLERANCE
from graspforce.grasp_map import stacked_maps

# Components of a contact of each model.
DIMS = {"FPC": 1, "PCWF": 3, "SFC": 4}


def grasp_maps(
    kinds: Sequence[str], points: Array, normals: Array, tangents: Array, origins: Array
) -> Array:
    """Return W of B grasps of n contacts, shape (B, 6, m).

    Args:
        kinds: FPC, PCWF or SFC, n of them.
        points: shape (B, n, 3) [m].
        normals: unit normals into the object, shape (B, n, 3).
        tangents: shape (B, n, 3), of any length, not along the normals.
        origins: points that torques are about, shape (B, 3) [m].
    """
    dims = None if all(kind == "PCWF" for kind in kinds) else [DIMS[kind] for kind in kinds]
    return stacked_maps(origins[:, None], points, normals, tangents, dims)


def frame_flaws(normals: Array, tangents: Array) -> dict[int, str]:
    """Return the rows whose normals or tangents make no contact frame, and what is wrong."""
    with np.errstate(all="ignore"):
        lengths = np.linalg.norm(normals, axis=-1)
        across = np.linalg.norm(np.cross(normals, tangents), axis=-1)
        across /= np.linalg.norm(tangents, axis=-1)
    bad = ~(np.abs(lengths - 1) <= UNIT_TOLERANCE)
    flaws: dict[int, str] = {}
    for row, place in np.argwhere(bad | ~(across > LEAST_ACROSS)).tolist():
        if bad[row, place]:
            text = (
                f"normals[{place}]: got length {lengths[row, place]:g}, expected a unit vector "
                f"(within {UNIT_TOLERANCE:g})"
            )
        else:
            text = f"tangents[{place}]: expected a direction across the normal"
        flaws.setdefault(row, text)
    return flaws


def rotations(quaternions: Array) -> Array:
    """Return the rotation matrices of quaternions wxyz of any length, shape (…, 3, 3)."""
    w, x, y, z = np.moveaxis(quaternions / np.linalg.norm(quaternions, axis=-1)[..., None], -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_flaws(poses: Array, name: str) -> dict[int, str]:
    """Return the rows whose poses have no unit quaternion, and what is wrong."""
    lengths = np.linalg.norm(poses[..., 3:], axis=-1)
    bad: NDArray[np.bool_] = ~(np.abs(lengths - 1) <= 1e-3)
    return {
        row: f"{name}: got a quaternion of length {lengths[row]:g}, expected 1 (wxyz)"
        for row in np.flatnonzero(bad).tolist()
    }
