"""A grasp: contacts, and the hand that makes them, turned into a force problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from graspforce._arrays import Array, as_array
from graspforce.contact import Contact, ContactModel, as_contacts
from graspforce.errors import InvalidInputError
from graspforce.grasp_map import grasp_map
from graspforce.problem import ForceProblem

if TYPE_CHECKING:
    from graspforce.hands.hand import Hand


class Grasp:
    """Geometry in, W, J and limits out.

    Args:
        contacts: n contacts, in one frame (the hand's, when there is a hand).
        hand: the hand that makes them; without one there are no torque limits.
        q: the hand's joint angles, shape (n_joints,) [rad].
        origin: the point about which the torque in f is taken, shape (3,) [m].

    Attributes:
        contacts: the contacts, a tuple.
        models: their models.
        W: grasp map, shape (6, m).
        J: hand Jacobian in contact frames, shape (m, n_joints); None without a hand.
        tau_lo: lower torque limits, shape (n_joints,) [N·m]; None without a hand.
        tau_hi: upper torque limits, likewise.

    Raises:
        InvalidInputError: no contacts, a hand without q or the reverse, a wrong shape.
    """

    def __init__(
        self,
        contacts: Sequence[Contact],
        hand: Hand | None = None,
        q: ArrayLike | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        if (hand is None) != (q is None):
            given, missing = ("q", "hand") if hand is None else ("hand", "q")
            raise InvalidInputError(f"{missing}: missing; {given} came without it")
        self.contacts = as_contacts(contacts)
        self.W = grasp_map(self.contacts, origin)
        self.models: tuple[ContactModel, ...] = tuple(each.model for each in self.contacts)
        self.J: Array | None = None
        self.tau_lo: Array | None = None
        self.tau_hi: Array | None = None
        if hand is not None and q is not None:
            self.J = hand.jacobian(self.contacts, as_array(q, "q", (len(hand.joint_names),)))
            self.tau_lo, self.tau_hi = hand.tau_lo, hand.tau_hi

    def problem(self, f: ArrayLike, **options: Any) -> ForceProblem:
        """Return the problem of giving the object the wrench f with this grasp.

        Args:
            f: wrench that the fingers exert on the object, shape (6,) [N, N·m].
            **options: any further argument of :class:`ForceProblem`: alpha, c_max, tau_bias, …
        """
        hand: dict[str, Any] = {"J": self.J, "tau_lo": self.tau_lo, "tau_hi": self.tau_hi}
        return ForceProblem(W=self.W, f=f, models=self.models, **(hand | options))

    def __repr__(self) -> str:
        joints = 0 if self.J is None else self.J.shape[1]
        return f"Grasp({len(self.contacts)} contacts, {joints} joints)"
