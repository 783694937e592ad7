"""Contacts that can squeeze an object although no motor limits it.

Two contacts of one body, or of a table and a wall, can press against each other through the object
with any force: nothing gives way. So can links that lean on stops. Among contacts as a simulator
reports them that is an accident of the geometry, and a ceiling far above what the grasp is about
keeps it from deciding anything.

Such forces c make W c = 0 and J.T c = 0, do no work on passive motions and push off no stop:
all of that is rows @ c = 0. Internal forces of redundant motors add nothing: each is all that one
motor gives, and no stop opens that motor's limits. Whether any forces inside the friction cones
do, Wolfe's algorithm tells ("Finding the nearest point in a polytope", Mathematical Programming 11,
1976): it finds the point nearest to 0 among rows @ c for the c whose normal forces sum to 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.contact import Contact, cone_scalings, contact_starts
from graspforce.hands.hand import Actuation
from graspforce.hands.transmission import null_space

# The ceiling, in multiples of what the motors reach and f needs.
CEILING = 10.0
# How far a stop opens the limit of a motor, in multiples of the motor's range.
OPEN = 100.0
# What rows @ c may be for normal forces that sum to 1: forces a thousand times as large as what
# they bring about are no grip that anyone asks for.
_NOTHING = 1e-3


def squeezing_contacts(
    contacts: Sequence[Contact], W: Array, actuation: Actuation
) -> NDArray[np.bool_]:
    """Return which contacts may squeeze the object without a motor, shape (n,).

    Args:
        contacts: n contacts.
        W: of the force problem: passive motions' rows are in it, shape (k, m).
        actuation: of the hand.
    """
    found = np.zeros(len(contacts), dtype=bool)
    equal = np.vstack((W, actuation.J.T))
    if not null_space(equal).any():
        return found
    # A stop takes what pushes into it: A c + s = 0 with s of 0 or more.
    stops = len(actuation.b)
    rows = np.block([[equal, np.zeros((len(equal), stops))], [actuation.A, np.eye(stops)]])
    sizes = np.abs(rows[:, : W.shape[1]]).max(axis=1)  # forces, torques and work on one scale
    counted = sizes > 1e-9 * sizes.max()
    rows = rows[counted] / sizes[counted, None]
    while not found.all():
        shares = _cancelling(rows, contacts, ~found)
        if not shares.any():
            break
        found |= shares
    return found


def bearing_stops(contacts: Sequence[Contact], W: Array, actuation: Actuation) -> Array:
    """Return which torque limits stops open, shape (n_joints,): 1 for tau_hi, −1 for tau_lo.

    A stop bears what others press into it. It presses on nothing by itself, so where a limit that
    it opens would leave nothing to limit a squeeze, the motor's limit stays.

    Args:
        contacts: n contacts.
        W: of the force problem: passive motions' rows are in it, shape (k, m).
        actuation: of the hand.
    """
    sides = np.array(actuation.stopped)
    while sides.any():
        opened = sides != 0
        one_sided = -(actuation.J[:, opened] * sides[opened]).T
        without = actuation._replace(
            J=actuation.J[:, ~opened],
            A=np.vstack((actuation.A, one_sided)),
            b=np.append(actuation.b, np.zeros(len(one_sided))),
        )
        starts = contact_starts([each.model for each in contacts])
        dims = np.diff(starts)
        squeezing = np.repeat(squeezing_contacts(contacts, W, without), dims)
        closed = opened & actuation.J[squeezing].any(axis=0)
        if not closed.any():
            break
        sides[closed] = 0.0
    return sides


def _cancelling(
    rows: Array, contacts: Sequence[Contact], usable: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which contacts make some forces with ``rows @ c = 0``, shape (n,); none if none can.

    Args:
        rows: shape (d, m + s), for c and s numbers of 0 or more.
        contacts: n contacts.
        usable: which of them may.
    """
    n, dims = len(contacts), np.array([each.model.dim for each in contacts])
    own = np.arange(4) < dims[:, None]
    m = int(dims.sum())
    normals = (np.cumsum(dims) - dims)[:, None] == np.arange(m)
    scale = cone_scalings(*np.array([(each.model.mu, each.model.gamma) for each in contacts]).T)
    corners, images, weights = np.zeros((rows.shape[1], 0)), np.zeros((len(rows), 0)), np.zeros(0)
    nearest = np.zeros(len(rows))
    for _ in range(300):
        slope = rows.T @ nearest
        each = np.zeros((n, 4))
        each[own] = slope[:m]
        across = each[:, 1:] / scale[:, 1:]
        length = np.linalg.norm(across, axis=1)
        lowest = np.where(usable, each[:, 0] - scale[:, 0] * length, np.inf)
        best = int(np.argmin(np.append(lowest, slope[m:])))
        corner = np.zeros(len(slope))
        if best < n:  # a force on the cone's edge
            force = np.append(1.0, -scale[best, 0] * across[best] / scale[best, 1:])
            force[1:] /= length[best] or 1.0
            corner[:m] = np.where(np.arange(n)[:, None] == best, force, 0.0)[own]
        else:
            corner[m + best - n] = 1.0
        image = rows @ corner
        # All that is inside the cones is on one side of 0.
        if nearest @ image > _NOTHING * np.linalg.norm(nearest):
            return np.zeros(n, dtype=bool)
        corners, images = np.column_stack((corners, corner)), np.column_stack((images, image))
        weights = np.append(weights, 0.0 if len(weights) else 1.0)
        while True:  # to the nearest point of the flat through the corners, if it is among them
            toward = np.linalg.lstsq(images.T @ images + 1.0, np.ones(len(weights)), rcond=None)[0]
            toward /= toward.sum()
            falling = toward < 0
            if not falling.any():
                weights = toward
                break
            steps = np.full(len(weights), np.inf)
            steps[falling] = weights[falling] / (weights[falling] - toward[falling])
            first = int(np.argmin(steps))  # leaves, whatever rounding has left of its weight
            weights = weights + steps[first] * (toward - weights)
            kept = np.arange(len(weights)) != first
            corners, images = corners[:, kept], images[:, kept]
            weights = weights[kept].clip(0.0) / weights[kept].clip(0.0).sum()
        nearest = images @ weights
        if np.linalg.norm(nearest) < _NOTHING:
            break
    shares: NDArray[np.bool_] = normals @ (corners @ weights)[:m] > 1e-9
    return shares


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
    known = most[np.isfinite(most)]
    distance = np.mean([np.linalg.norm(each.point - origin) for each in contacts])
    force = np.linalg.norm(f[:3]) + np.linalg.norm(f[3:]) / max(float(distance), 1e-3)
    return CEILING * float((np.median(known) if known.size else 0.0) + force)
