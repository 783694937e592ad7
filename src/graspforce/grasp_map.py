"""The grasp map W: contact forces to the wrench on the object (Eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from graspforce._arrays import Array, as_array
from graspforce.contact import FPC, SFC, Contact
from graspforce.errors import InvalidInputError


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
    """
    about = as_array(origin, "origin", (3,))
    if not contacts:
        raise InvalidInputError("contacts: got none, expected at least one")
    columns: list[Array] = []
    for index, contact in enumerate(contacts):
        if not isinstance(contact, Contact):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InvalidInputError(f"contacts[{index}]: got {contact!r}, expected a Contact")
        frame = contact.frame
        axes = frame[:, :1] if isinstance(contact.model, FPC) else frame
        arm = contact.point - about
        columns.append(np.vstack((axes, np.cross(arm, axes, axis=0))))
        if isinstance(contact.model, SFC):
            columns.append(np.vstack((np.zeros((3, 1)), frame[:, :1])))
    return np.hstack(columns)
