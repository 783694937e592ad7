"""The contacts that a loop counts on: matched between ticks, of a fixed number, without jumps.

A simulator lists a contact only while two bodies overlap, and a tactile sensor is noisy: contacts
flicker, change their order, come and go. A Servo wants a problem of one layout whose numbers change
little. The book has a fixed number of slots for each link of the hand. What touches is matched to
the slots by link and place on the object; a slot whose contact is missing keeps its last place for
a while, and the engagement of a slot (Section III-C.3 of the paper) rises and falls by a ramp.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce._util.arrays import (
    Array,
    as_array,
    as_integer,
    as_positive,
    require,
    require_instance,
)
from graspforce.contact import UNIT_TOLERANCE, Contact, ContactModel, any_tangent, cross_rows
from graspforce.errors import InvalidInputError

_WORLD = np.eye(3)


class ContactBook:
    """Slots for contacts, n in all, each of one link.

    All is kept in the object's frame, so a contact stays where it is on an object that moves. The
    first update takes what touches as a grasp that holds: its slots are engaged at once.

    Args:
        slots: how many contacts each link may have at once; the links are strings, numbers, or
            whatever they are called in updates. Slots stand in this order.
        spare: further slots behind them for contacts that come late: of links without slots, or
            with more contacts than slots.
        ramp: how long an engagement takes from 0 to 1 or back [s]. With ceilings ``c_max`` and
            forces that may change by r newtons a second, a ramp of at least ``c_max / r`` leaves
            the Servo room.
        patience: how long a missing contact is believed to be there still [s].
        reach: how far a contact may have moved on the object between updates and be the same [m].

    Attributes:
        links: of each slot, n of them; None for a spare one that nothing has taken.
        points: where the contact is or last was, world axes, shape (n, 3) [m].
        frames: columns normal (into the object), x, y, as :attr:`graspforce.Contact.frame`, world
            axes, shape (n, 3, 3). A slot's x turns no more than its normal does, so forces of one
            tick mean the same in the next.
        engagement: 0 to 1, shape (n,).
        present: whether something touched at the last update, shape (n,).
        slots: the slot of each contact of the last update, −1 without one, shape (k,).
        without_slot: how many contacts of the last update found no slot free.

    Raises:
        InvalidInputError: no slots, a number of slots below 1, a time or length that is not
            positive.
    """

    def __init__(
        self,
        slots: Mapping[Hashable, int],
        *,
        spare: int = 0,
        ramp: float = 0.1,
        patience: float = 0.02,
        reach: float = 0.01,
    ) -> None:
        require_instance(slots, "slots", Mapping, "links and how many contacts each may have")
        if not slots:
            raise InvalidInputError("slots: got none, expected at least one link")
        counts = [as_integer(count, f"slots[{link!r}]", 1) for link, count in slots.items()]
        pairs = zip(slots, counts, strict=True)
        self._spare = as_integer(spare, "spare", 0)
        self._links: list[Hashable | None] = [link for link, count in pairs for _ in range(count)]
        self._own = len(self._links)
        self._links += [None] * self._spare
        self._ramp = as_positive(ramp, "ramp", "s")
        self._patience = as_positive(patience, "patience", "s")
        self._reach = as_positive(reach, "reach", "m")
        n = len(self._links)
        # In the object's frame. A slot that never had a contact has a frame all the same.
        self._points, self._frames = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))
        self._missing = np.full(n, np.inf)  # for how long [s]
        self._started = False
        self.points, self.frames = self._points.copy(), self._frames.copy()
        self.engagement = np.zeros(n)
        self.slots = np.zeros(0, dtype=np.intp)
        self.without_slot = 0

    @property
    def links(self) -> tuple[Hashable | None, ...]:
        """The link of each slot, n of them; None for a spare one that nothing has taken."""
        return tuple(self._links)

    @property
    def present(self) -> NDArray[np.bool_]:
        """Whether something touched at the last update, shape (n,)."""
        return self._missing == 0

    def contacts(self, model: ContactModel) -> tuple[Contact, ...]:
        """Return the slots as contacts, n of them, in the world's axes."""
        return tuple(
            Contact(point, frame[:, 0], model, frame[:, 1])
            for point, frame in zip(self.points, self.frames, strict=True)
        )

    def update(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        links: Sequence[Hashable],
        dt: float,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike = _WORLD,
    ) -> None:
        """Take what touches now.

        Args:
            points: k contacts, world axes, shape (k, 3) [m].
            normals: unit normals into the object, shape (k, 3).
            links: what makes each contact; contacts of links without slots are passed over, as
                long as there is no spare one.
            dt: since the last update [s].
            position: of the object, shape (3,) [m].
            rotation: of the object, its axes as columns, shape (3, 3).

        Raises:
            InvalidInputError: a wrong shape, numbers that are not finite, a dt that is not
                positive; the book is then as it was.
        """
        k = len(links)
        seen = as_array(points if k else np.zeros((0, 3)), "points", (k, 3))
        directions = as_array(normals if k else np.zeros((0, 3)), "normals", (k, 3))
        lengths = np.linalg.norm(directions, axis=1)
        require(np.abs(lengths - 1) <= UNIT_TOLERANCE, "normals", lengths, "vectors of length 1")
        directions = directions / lengths[:, None]
        step = as_positive(dt, "dt", "s")
        where = as_array(position, "position", (3,))
        R = as_array(rotation, "rotation", (3, 3))
        seen, directions = (seen - where) @ R, directions @ R

        matched = self.slots = self._match(seen, links)
        found = matched >= 0
        slots = matched[found]
        self._missing += step
        self._missing[slots] = 0.0
        self._points[slots] = seen[found]
        self._turn(slots, directions[found])
        self.points = where + self._points @ R.T
        self.frames = R @ self._frames
        change = step / self._ramp
        rising = self._missing <= self._patience
        if self._started:
            changed = self.engagement + np.where(rising, change, -change)
            self.engagement = changed.clip(0.0, 1.0)
        else:
            self.engagement, self._started = rising.astype(float), True

    def _match(self, seen: Array, links: Sequence[Hashable]) -> NDArray[np.intp]:
        """Return each contact's slot, −1 without one: nearest pairs first, then free slots."""
        matched: NDArray[np.intp] = np.full(len(seen), -1)
        used = (self.engagement > 0) | (self._missing <= self._patience)
        numbers = {link: number for number, link in enumerate(self._links)}
        of_slot = np.array([numbers[link] for link in self._links])
        of_contact = np.array([numbers.get(link, -1) for link in links], dtype=np.intp)
        off = seen[:, None] - self._points
        away = np.sqrt((off * off).sum(axis=2))
        near = (away <= self._reach) & used & (of_contact[:, None] == of_slot)
        contacts, slots = np.nonzero(near)
        taken: set[int] = set()
        for pair in np.argsort(away[near], kind="stable").tolist():
            i, slot = int(contacts[pair]), int(slots[pair])
            if matched[i] < 0 and slot not in taken:
                matched[i] = slot
                taken.add(slot)
        new = (matched < 0).nonzero()[0].tolist()
        if not new:
            self.without_slot = 0
            return matched
        # The others are new. A slot that still lets go is not taken over: its force would jump.
        free = np.flatnonzero(~used).tolist()
        for i in new:
            usable = (j for j in free if j >= self._own or self._links[j] == links[i])
            slot = next(usable, None)
            if slot is not None:
                free.remove(slot)
                matched[i], self._links[slot] = slot, links[i]
        left = [links[i] for i in new if matched[i] < 0]
        self.without_slot = sum(bool(self._spare) or link in self._links for link in left)
        return matched

    def _turn(self, slots: NDArray[np.intp], normals: Array) -> None:
        """Give slots normals; their x turn no more than that, unless the contacts are new."""
        x = self._frames[slots, :, 1]
        new = self.engagement[slots] == 0
        if new.any():
            x[new] = any_tangent(normals[new])
        x = _across(x, normals)
        along = (x * x).sum(axis=1) < 0.01  # where the normal has come to lie along it
        if along.any():
            x[along] = _across(any_tangent(normals[along]), normals[along])
        x /= np.sqrt((x * x).sum(axis=1))[:, None]
        axes = np.concatenate((normals, x, cross_rows(normals, x)), axis=1)
        self._frames[slots] = axes.reshape(-1, 3, 3).transpose(0, 2, 1)


def _across(vectors: Array, normals: Array) -> Array:
    return vectors - (vectors * normals).sum(axis=1)[:, None] * normals
