"""The contacts that a loop counts on: matched between ticks, of a fixed number, without jumps.

A simulator lists a contact only while two bodies overlap, and a tactile sensor is noisy: contacts
flicker, change their order, come and go. A Servo wants a problem of one layout whose numbers change
little. The book has a fixed number of slots for each link of the hand. What touches is matched to
the slots by link and place on the object; a slot whose contact is missing keeps its last place for
a while, and the engagement of a slot (Section III-C.3 of the paper) rises and falls by a ramp.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce._engine import native
from graspforce._util.arrays import (
    Array,
    as_array,
    as_integer,
    as_positive,
    require,
    require_instance,
)
from graspforce.contact import UNIT_TOLERANCE, Contact, ContactModel
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
        self._spare = as_integer(spare, "spare", 0)
        self._core: Any = native.module.ContactBook(
            counts, self._spare, as_positive(ramp, "ramp", "s"),
            as_positive(patience, "patience", "s"), as_positive(reach, "reach", "m"),
        )  # fmt: skip
        # The core knows links by number.
        self._numbers = {link: number for number, link in enumerate(slots)}
        self._named: tuple[Hashable, ...] = tuple(slots)
        self._of_slots: list[int] = []
        self._look_at_links()

    @property
    def links(self) -> tuple[Hashable | None, ...]:
        """The link of each slot, n of them; None for a spare one that nothing has taken."""
        return self._links

    @property
    def points(self) -> Array:
        """Where the contacts are or last were, world axes, shape (n, 3) [m]."""
        return self._core.points

    @property
    def axes(self) -> Array:
        """The same as rows, shape (n, 3, 3)."""
        return self._core.axes

    @property
    def frames(self) -> Array:
        """Columns normal (into the object), x, y, as :attr:`graspforce.Contact.frame`, (n, 3, 3).

        World axes. A slot's x turns no more than its normal does, so forces of one tick mean the
        same in the next.
        """
        return self._core.axes.transpose(0, 2, 1)

    @property
    def engagement(self) -> Array:
        """From 0 to 1, shape (n,)."""
        return self._core.engagement

    @property
    def cone_weight(self) -> Array:
        """The cones' weights: contacts of one patch share 1 as far as they are engaged, (n,)."""
        return self._core.cone_weights

    @property
    def present(self) -> NDArray[np.bool_]:
        """Whether something touched at the last update, shape (n,)."""
        return self._core.present

    @property
    def slots(self) -> NDArray[np.intp]:
        """The slot of each contact of the last update, −1 without one, shape (k,)."""
        return self._core.slots

    @property
    def without_slot(self) -> int:
        """How many contacts of the last update found no slot free."""
        return self._core.without_slot

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
        numbers = [self._number(link) for link in links]
        # The core takes plain arrays with valid numbers, and leaves everything else to the checks.
        if not self._core.update(points, normals, numbers, dt, position, rotation):
            k = len(links)
            seen = as_array(points if k else np.zeros((0, 3)), "points", (k, 3))
            directions = as_array(normals if k else np.zeros((0, 3)), "normals", (k, 3))
            lengths = np.linalg.norm(directions, axis=1)
            unit: NDArray[np.bool_] = np.abs(lengths - 1) <= UNIT_TOLERANCE
            require(unit, "normals", lengths, "vectors of length 1")
            self._core.update(
                seen, directions / lengths[:, None], numbers, as_positive(dt, "dt", "s"),
                as_array(position, "position", (3,)), as_array(rotation, "rotation", (3, 3)),
            )  # fmt: skip
        self._look_at_links()

    def _number(self, link: Hashable) -> int:
        """Return what the core knows a link by; the same for all that never get a slot."""
        number = self._numbers.get(link)
        if number is not None:
            return number
        if not self._spare:
            return -2
        self._named += (link,)
        return self._numbers.setdefault(link, len(self._numbers))

    def _look_at_links(self) -> None:
        """See which links have the slots."""
        numbers = self._core.links
        if numbers != self._of_slots:
            self._of_slots = numbers
            self._links = tuple(None if i < 0 else self._named[i] for i in numbers)
