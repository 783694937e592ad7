"""Contacts that can squeeze an object although no motor limits it.

Two contacts of one body, or of a table and a wall, can press against each other through the object
with any force: nothing gives way. Among contacts as a simulator reports them that is an accident of
the geometry, and a ceiling far above what the grasp is about keeps it from deciding anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.contact import Contact, contact_starts
from graspforce.hands.hand import Actuation
from graspforce.hands.transmission import null_space

# The ceiling, in multiples of what the motors reach and f needs.
CEILING = 10.0


def squeezing_contacts(
    contacts: Sequence[Contact],
    links: Sequence[str],
    W: Array,
    motions: Array | None,
    actuation: Actuation,
) -> NDArray[np.bool_]:
    """Return which contacts may squeeze the object by themselves, shape (n,).

    Contacts of one body can when they make forces that cancel. They cannot when all their friction
    cones lie on one side of a plane, or where W tells their forces apart. A joint that carries the
    object bears what it has to, so there it takes forces that do work on nothing.

    Args:
        contacts: n contacts.
        links: the body that makes each.
        W: grasp map, shape (6, m).
        motions: the object's motions, shape (6, k); None where it moves freely.
        actuation: of the hand.
    """
    starts = contact_starts([each.model for each in contacts])
    columns = [slice(*pair) for pair in pairwise(starts)]
    rows = np.vstack((actuation.J.T, actuation.passive_rows))
    found = np.zeros(len(contacts), dtype=bool)
    if motions is not None:
        basis = null_space(np.vstack((motions.T @ W, rows)))
        return np.array([np.abs(basis[each]).max(initial=0.0) > 1e-9 for each in columns])
    bodies = [
        link if rows[:, each].any() else None for link, each in zip(links, columns, strict=True)
    ]  # None: all that does not move
    for body in dict.fromkeys(bodies):
        members = [i for i, each in enumerate(bodies) if each == body]
        map_ = np.hstack([W[:, columns[i]] for i in members])
        if np.linalg.matrix_rank(map_) == map_.shape[1]:
            continue
        normals = np.array([contacts[i].normal for i in members])
        frictions = np.array([_friction(contacts[i]) for i in members])
        middle = normals.sum(axis=0)
        inside = normals @ middle > np.linalg.norm(middle) * np.sin(np.arctan(frictions)) + 1e-9
        found[members] = not inside.all()
    return found


def _friction(contact: Contact) -> float:
    return contact.model.mu if contact.model.dim > 1 else 0.0


def ceiling(contacts: Sequence[Contact], origin: Array, f: Array, actuation: Actuation) -> float:
    """Return the normal force that is far above all that the grasp is about [N]; 0 for none.

    Args:
        contacts: n contacts.
        origin: the point about which the torque in f is taken, shape (3,).
        f: the wanted wrench, shape (6,).
        actuation: of the hand.
    """
    starts = contact_starts([each.model for each in contacts])[:-1]
    arms = np.abs(actuation.J[starts])
    ranges = np.broadcast_to(actuation.tau_hi - actuation.tau_lo, arms.shape)
    reach = np.divide(ranges, arms, out=np.full(arms.shape, np.inf), where=arms > 0)
    most = reach.min(axis=1, initial=np.inf)
    distance = np.mean([np.linalg.norm(each.point - origin) for each in contacts])
    force = np.linalg.norm(f[:3]) + np.linalg.norm(f[3:]) / max(float(distance), 1e-3)
    return CEILING * float(most[np.isfinite(most)].max(initial=0.0) + force)
