"""The grasp map W: contact forces to the wrench on the object (Eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_array
from graspforce.contact import Contact, as_contacts, cross, dot, exact_lengths, warn_of_slips


def grasp_map(contacts: Sequence[Contact], origin: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Return the grasp map W of Eq. (1): W c = f.

    Args:
        contacts: n contacts, points and normals in one frame.
        origin: the point about which the torque in f is taken, in that frame, shape (3,) [m].

    Returns:
        W, shape (6, m): rows [force; torque] in the contacts' frame, columns contact-major,
        ``[n1, x1, y1, n2, …]``. A soft finger's torsion adds to the torque only.

    Raises:
        InvalidInputError: no contacts, or something that is none.

    Warns:
        GraspForceWarning: the contacts look like millimetres, or their normals as if they
            pointed out of the object.
    """
    given = as_contacts(contacts)
    about = as_array(origin, "origin", (3,))
    warn_of_slips(given)
    return map_about(about, given)


def map_about(origin: Array, contacts: Sequence[Contact]) -> Array:
    """Return the grasp map of contacts and an origin that were checked before."""
    columns: list[Array] = []
    for contact in contacts:
        force, torque = np.split(contact.wrench_basis, 2)
        columns.append(np.vstack((force, torque + cross(contact.point - origin, force))))
    return np.hstack(columns)


def stacked_maps(
    origins: Array,
    points: Array,
    normals: Array,
    tangents: Array,
    dims: Sequence[int] | None = None,
    exact: bool = False,
) -> Array:
    """Return the grasp maps of B grasps of n contacts, shape (B, 6, m).

    The frames are those of :class:`graspforce.Contact`, within rounding.

    Args:
        origins: shape (B, 1, 3) [m].
        points: shape (B, n, 3) [m].
        normals: shape (B, n, 3), unit vectors within rounding.
        tangents: shape (B, n, 3), any length, not along the normals.
        dims: components of each contact, n of them; by default 3, contacts with friction.
        exact: to the last bit what :func:`grasp_map` returns, in twice the time.
    """
    lengths = exact_lengths if exact else partial(np.linalg.norm, axis=-1)
    normals = normals / lengths(normals)[..., None]
    flat = tangents / lengths(tangents)[..., None]
    for _ in range(2):  # once more for what cancellation has left of the normal
        flat = flat - dot(flat.T, normals.T).T[..., None] * normals
    flat /= lengths(flat)[..., None]
    axes = np.stack((normals, flat, cross(normals.T, flat.T).T), axis=-2)
    torques = cross((points - origins)[:, :, None].T, axes.T).T + 0.0  # no −0
    wrenches = np.concatenate((axes, torques), axis=-1)
    if dims is not None:
        torsion = np.concatenate((np.zeros_like(normals), normals), axis=-1)[:, :, None]
        wrenches = np.concatenate((wrenches, torsion), axis=2)
        wrenches = wrenches[:, np.arange(4) < np.array(dims)[:, None]]
    return wrenches.reshape(len(points), -1, 6).swapaxes(1, 2)
