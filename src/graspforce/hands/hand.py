"""The protocol that every hand implements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from graspforce._arrays import Array
from graspforce.contact import Contact


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
            q: joint angles, shape (n_joints,) [rad].
        """
        ...
