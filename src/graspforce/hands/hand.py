"""The protocols that hands implement, and what a hand brings into the force problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_array, as_tuple, require_instance
from graspforce.contact import Contact, contact_starts
from graspforce.errors import InvalidInputError


@runtime_checkable
class Hand(Protocol):
    """A hand: joints with torque limits, and the Jacobian of any contacts it makes."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n_joints joints, in the order of q, tau and the columns of J."""
        ...

    @property
    def tau_lo(self) -> Array:
        """Lower joint torque limits, shape (n_joints,) [N·m]."""
        ...

    @property
    def tau_hi(self) -> Array:
        """Upper joint torque limits, shape (n_joints,) [N·m]."""
        ...

    def jacobian(self, contacts: Sequence[Contact], q: ArrayLike) -> Array:
        """Return J, shape (m, n_joints), in the contact frames: tau = J.T @ c (Eq. 2).

        Args:
            contacts: n contacts in the hand's frame; which finger makes which contact is the
                hand's to say.
            q: joint angles, shape (n_joints,) [rad]; an :class:`UnderactuatedHand` asks for
                more.
        """
        ...


@runtime_checkable
class UnderactuatedHand(Hand, Protocol):
    """A hand that can move without a motor moving; the contacts must not load such motions."""

    @property
    def q_names(self) -> tuple[str, ...]:
        """The joints whose angles q holds, in its order: more than have motors of their own."""
        ...

    def passive_rows(self, contacts: Sequence[Contact], q: ArrayLike) -> Array:
        """Return the k equations ``rows @ c = 0`` of the motions that no motor moves.

        Each is the virtual work of c over one such motion: a joint that turns freely stays where
        it is only while the contacts do no work on it.

        Returns:
            shape (k, m), k ≥ 0, of full row rank.
        """
        ...


@runtime_checkable
class LoadedHand(UnderactuatedHand, Protocol):
    """A hand that knows what gravity and springs ask of its joints."""

    def tau_bias(self, q: ArrayLike) -> Array:
        """Return what the joints must give besides at rest, shape (n_joints,) [N·m]."""
        ...

    def passive_loads(self, contacts: Sequence[Contact], q: ArrayLike) -> Array:
        """Return what ``passive_rows @ c`` has to be, shape (k,)."""
        ...


@runtime_checkable
class RedundantHand(Hand, Protocol):
    """A hand of more motors than motions, by whose forces its joints, J and limits are."""

    def internal(self, q: ArrayLike) -> Array:
        """Return the forces of the motors that balance among themselves, shape (r, n_joints).

        ``tau = J.T c + internal.T v + tau_bias`` for any v; see :class:`graspforce.ForceProblem`.
        """
        ...


class Actuation(NamedTuple):
    """What the joints of a hand at one configuration bring into the force problem."""

    joint_names: tuple[str, ...]
    J: Array
    """shape (m, n_joints): tau = J.T @ c (Eq. 2)."""
    tau_lo: Array
    tau_hi: Array
    tau_bias: Array
    """What the joints must give besides, shape (n_joints,) [N·m]."""
    passive_rows: Array
    """Virtual work of c over the motions that no motor moves, shape (k, m)."""
    passive_loads: Array
    """What it has to be, shape (k,): ``passive_rows @ c = passive_loads``."""
    internal: Array
    """Forces of the motors that balance among themselves, shape (r, n_joints)."""
    A: Array
    """Further limits ``A c ≤ b`` of the hand, shape (p, m): stops that joints lean on only push;
    what all motors do together at a joint has a limit of its own."""
    b: Array
    """shape (p,)."""
    stopped: Array
    """Which limits stops open, shape (n_joints,): 1 for tau_hi, −1 for tau_lo, 0 for none."""
    notes: tuple[str, ...]
    """What a user should know of the posture, a sentence each."""


@runtime_checkable
class ActuatedHand(UnderactuatedHand, Protocol):
    """A hand that says by itself all that it brings into the force problem."""

    def actuation(self, contacts: Sequence[Contact], q: ArrayLike) -> Actuation:
        """Return what the hand at the joint angles q brings into the force problem."""
        ...


class ImportedGrasp(Protocol):
    """A grasp as read from a robot, in the axes of its world."""

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts."""
        ...

    @property
    def links(self) -> tuple[str, ...]:
        """What makes each contact."""
        ...

    @property
    def origin(self) -> Array:
        """The point about which torques are taken, shape (3,) [m]."""
        ...

    @property
    def W(self) -> Array:
        """Grasp map, shape (6, m)."""
        ...

    @property
    def actuation(self) -> Actuation:
        """What the joints bring into the force problem."""
        ...

    @property
    def motions(self) -> Array | None:
        """The object's possible motions, shape (6, k); None where it moves freely."""
        ...

    @property
    def from_simulator(self) -> bool:
        """Whether contacts are as physics has them, not chosen."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know, a sentence each."""
        ...


def actuation(hand: Hand, contacts: Sequence[Contact], q: ArrayLike) -> Actuation:
    """Return what a hand brings into the force problem.

    Gravity and springs count for a :class:`LoadedHand` alone.

    Raises:
        InvalidInputError: no hand; q has not as many angles as the hand asks for; the hand's
            Jacobian or limits have wrong shapes.
    """
    require_instance(
        hand, "hand", Hand, "a Hand: joint_names, tau_lo, tau_hi and jacobian(contacts, q)"
    )
    if isinstance(hand, ActuatedHand):
        return hand.actuation(contacts, q)
    underactuated = isinstance(hand, UnderactuatedHand)
    joints = as_tuple(hand.joint_names, "hand.joint_names", str)
    names = as_tuple(hand.q_names, "hand.q_names", str) if underactuated else joints
    q = as_array(q, "q", (len(names),))
    m = contact_starts([contact.model for contact in contacts])[-1]
    J = as_array(hand.jacobian(contacts, q), "hand.jacobian", (m, len(joints)))
    tau_lo, tau_hi = (
        as_array(getattr(hand, name), f"hand.{name}", (len(joints),), broadcast=True)
        for name in ("tau_lo", "tau_hi")
    )
    passive = hand.passive_rows(contacts, q) if underactuated else np.zeros((0, m))
    if isinstance(hand, LoadedHand):
        bias, loads = hand.tau_bias(q), hand.passive_loads(contacts, q)
    else:
        bias, loads = np.zeros(len(joints)), np.zeros(len(passive))
    internal = np.zeros((0, len(joints)))
    if isinstance(hand, RedundantHand):
        internal = as_array(hand.internal(q), "hand.internal", None)
        if internal.ndim != 2 or internal.shape[1] != len(joints):
            raise InvalidInputError(
                f"hand.internal: got shape {internal.shape}, expected (r, {len(joints)})"
            )
    return Actuation(
        joints, J, tau_lo, tau_hi, bias, passive, loads, internal, np.zeros((0, m)), np.zeros(0),
        np.zeros(len(joints)), (),
    )  # fmt: skip
