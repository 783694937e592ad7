"""A hand read from a robot file: fingers and links by name, whatever library read the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_array, as_tuple, came, require_instance
from graspforce.contact import Contact, as_contacts
from graspforce.errors import InvalidInputError, ModelImportError
from graspforce.hands.configuration import (
    Configuration,
    D,
    Motors,
    full_jacobian,
    idle_notes,
)
from graspforce.hands.hand import Actuation
from graspforce.hands.limits import DriveLimit


class Robot(Protocol):
    """The kinematics that a library has read from a file."""

    @property
    def q_names(self) -> tuple[str, ...]:
        """The joints whose angles make a configuration."""
        ...

    @property
    def links(self) -> tuple[str, ...]:
        """Names of everything that a contact can be on."""
        ...

    @property
    def limits(self) -> tuple[tuple[DriveLimit, str], ...]:
        """The file's limits of the drives, and which of its numbers they come from."""
        ...

    def configuration(self, q: Array) -> Configuration:
        """Return the robot at the joint angles q, shape (len(q_names),) [rad]."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ImportedHand:
    """A hand that :func:`from_mjcf` or :func:`from_urdf` has read.

    Attributes:
        joint_names: the n_joints drives, in the order of tau and the columns of J: a joint with
            a motor by its name, a tendon with a motor by the tendon's.
        q_names: the joints whose angles q holds, in its order. The same names as joint_names,
            unless a drive is a tendon or a joint has no motor. Mimic joints follow by themselves.
        tau_lo: lower limits of the drives, shape (n_joints,) [N·m; N for slides and tendons].
        tau_hi: upper limits, likewise.
        fingers: for each finger the drives that move its fingertip.
        fingertips: for each finger the link that is its fingertip.
        made_by: the link that makes each contact; see :meth:`touching`.
        notes: what the import found: limits that may be placeholders, motions that nothing
            controls, joints that follow others, motors that were left out.
        robot: the kinematics.
    """

    joint_names: tuple[str, ...]
    q_names: tuple[str, ...]
    tau_lo: Array
    tau_hi: Array
    fingers: Mapping[str, tuple[str, ...]]
    fingertips: Mapping[str, str]
    made_by: tuple[str, ...]
    notes: tuple[str, ...]
    robot: Robot

    def touching(self, names: Sequence[str]) -> ImportedHand:
        """Return the hand with its contacts made by the links ``names``, one name a contact.

        Without this the i-th contact is made by the i-th finger's fingertip.

        Args:
            names: fingers, or any other links: several contacts on a finger repeat its name, a
                contact with the palm has the palm's (nothing moves it: its rows of J are 0).

        Raises:
            InvalidInputError: neither a finger nor a link of the file.
        """
        return replace(self, made_by=tuple(map(self._link, as_tuple(names, "names", str))))

    def fingertip_positions(self, q: ArrayLike, pads: ArrayLike | None = None) -> Array:
        """Return where the fingertips are, shape (n_fingers, 3) [m].

        Args:
            q: angles of the joints ``q_names``, shape (len(q_names),) [rad, m].
            pads: where the links touch, in their own frames, shape (n_fingers, 3) [m]; by default
                their origins, which are often joints.

        Raises:
            InvalidInputError: another number of angles or pads.
        """
        configuration = self._configuration(q)
        links = self.fingertips.values()
        if pads is None:
            return np.array([configuration.position(link) for link in links])
        places = as_array(pads, "pads", (len(links), 3))
        return np.array(
            [configuration.position(link, at) for link, at in zip(links, places, strict=True)]
        )

    def jacobian(self, contacts: Sequence[Contact], q: ArrayLike) -> Array:
        """Return J, shape (m, n_joints), in the contact frames: tau = J.T @ c (Eq. 2).

        Args:
            contacts: one for each of ``made_by``, in the frame of the file's world (MJCF) or of
                its root link (URDF). Nothing here knows the shape of the links, so a contact
                that is not on the link that is to make it cannot be found out.
            q: angles of the joints ``q_names``, shape (len(q_names),) [rad, m].

        Raises:
            InvalidInputError: another number of contacts or angles.
        """
        return self.actuation(contacts, q).J

    def actuation(self, contacts: Sequence[Contact], q: ArrayLike) -> Actuation:
        """Return all that the hand brings into the force problem at the joint angles q.

        Where q leaves a closed linkage open, the joints without motors are moved until it is
        closed, or all of its joints; ``notes`` then say so. Joints at the ends of their ranges lean
        on stops: in place of an equation of ``passive_rows`` they have a row of ``A c ≤ b``.

        Args:
            contacts: as for :meth:`jacobian`.
            q: likewise.

        Raises:
            InvalidInputError: another number of contacts or angles; a linkage that no motion of
                its joints closes: the text says how far it stays open.
        """
        configuration = self._configuration(q)
        motors: Motors[Any] = Motors((), self.joint_names, self.tau_lo, self.tau_hi, (), ())
        return motors.actuation(
            configuration.transmission, configuration.ranges,
            self._full(contacts, configuration), configuration.bias(), configuration.notes,
        )  # fmt: skip

    def passive_rows(self, contacts: Sequence[Contact], q: ArrayLike) -> Array:
        """Return ``rows`` of the equations of the motions that no drive takes part in.

        ``rows @ c`` has to be :meth:`passive_loads`.

        Returns:
            shape (k, m): the virtual work of c over each such motion that c can load.
        """
        return self.actuation(contacts, q).passive_rows

    def passive_loads(self, contacts: Sequence[Contact], q: ArrayLike) -> Array:
        """Return what ``passive_rows @ c`` has to be, shape (k,): the work of weight and springs.

        Args:
            contacts: as for :meth:`jacobian`.
            q: likewise.

        Raises:
            InvalidInputError: another number of contacts or angles.
        """
        return self.actuation(contacts, q).passive_loads

    def tau_bias(self, q: ArrayLike) -> Array:
        """Return what the drives must give against weight and springs, shape (n_joints,) [N·m].

        Gravity is the file's option (MJCF), or 9.81 m/s² against the root link's z (URDF, which
        has no springs).

        Args:
            q: angles of the joints ``q_names``, shape (len(q_names),) [rad, m].

        Raises:
            InvalidInputError: another number of angles.
        """
        configuration = self._configuration(q)
        return configuration.transmission.driven.T @ configuration.bias()

    def internal(self, q: ArrayLike) -> Array:
        """Return the forces of the drives that balance among themselves, shape (r, n_joints).

        r is 0 but where the drives are more than the motions that they move.

        Args:
            q: angles of the joints ``q_names``, shape (len(q_names),) [rad, m].

        Raises:
            InvalidInputError: another number of angles.
        """
        return self._configuration(q).transmission.internal

    def _full(self, contacts: Sequence[Contact], configuration: Configuration) -> Array:
        contacts = as_contacts(contacts)
        if len(contacts) != len(self.made_by):
            raise InvalidInputError(
                f"contacts: got {len(contacts)}, expected {len(self.made_by)}, made by "
                f"{', '.join(self.made_by)}; hand.touching(…) names others"
            )
        twists = [
            configuration.twist(link, contact.point)
            for contact, link in zip(contacts, self.made_by, strict=True)
        ]
        return full_jacobian(contacts, twists)

    def _configuration(self, q: ArrayLike) -> Configuration:
        return self.robot.configuration(as_array(q, "q", (len(self.q_names),)))

    def _link(self, name: str) -> str:
        if name in self.fingertips:
            return self.fingertips[name]
        return as_link(name, "names", self.robot.links)


def as_link(name: str, argument: str, links: Sequence[str]) -> str:
    """Return a link's name, which has to be one of ``links``.

    Raises:
        InvalidInputError: it is not; the text lists those that there are.
    """
    require_instance(name, argument, str)
    if name not in links:
        raise InvalidInputError(
            f"{argument}: got {name!r}, which is none of the model's links; expected one of "
            f"{', '.join(links)}"
        )
    return name


def as_fingertips(
    fingertips: Sequence[str] | Mapping[str, str], links: Sequence[str]
) -> dict[str, str]:
    """Return each finger's fingertip; fingers without a name have their fingertip's.

    Raises:
        InvalidInputError: none, one twice, or one that is no link; the text lists the links.
    """
    several = isinstance(fingertips, Sequence | Mapping) and not isinstance(fingertips, str)  # pyright: ignore[reportUnnecessaryIsInstance]
    if not several or not fingertips:
        raise InvalidInputError(
            f"fingertips: got {came(fingertips)}, expected names of at least one link, as a list "
            "or a mapping from the fingers' names"
        )
    if not isinstance(fingertips, Mapping):
        fingertips = as_tuple(fingertips, "fingertips", str)
        twice = {name for name in fingertips if fingertips.count(name) > 1}
        if twice:
            raise InvalidInputError(
                f"fingertips: got {min(twice)!r} twice, expected each finger once; "
                f"hand.touching(…) says that a finger makes several contacts"
            )
        fingertips = {name: name for name in fingertips}
    return {finger: as_link(link, "fingertips", links) for finger, link in fingertips.items()}


def fingers_of(
    configuration: Configuration, motors: Motors[D], fingertips: Mapping[str, str]
) -> dict[str, tuple[str, ...]]:
    """Return the drives that move each finger's fingertip.

    Raises:
        ModelImportError: nothing moves one of them.
    """
    fingers: dict[str, tuple[str, ...]] = {}
    transmission = configuration.transmission
    driven, internal = np.abs(transmission.driven), np.abs(transmission.internal)
    for finger, link in fingertips.items():
        moves = np.abs(configuration.twist(link, None)) @ driven  # no cancelling: not by chance 0
        moves = moves + moves @ internal.T @ internal  # and those that work against them
        fingers[finger] = tuple(
            name for name, column in zip(motors.joint_names, moves.T, strict=True) if column.any()
        )
        if not fingers[finger]:
            reasons = (f"no motor moves {link!r}", *idle_notes(motors.idle))
            raise ModelImportError(f"finger {finger!r} has no actuated joint: {'; '.join(reasons)}")
    return fingers
