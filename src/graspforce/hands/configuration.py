"""A robot at one configuration: what moves it, within which limits, and what nothing controls."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from graspforce._engine import native
from graspforce._util.arrays import Array, as_tuple
from graspforce.contact import Contact
from graspforce.equations import undetermined
from graspforce.errors import InvalidInputError
from graspforce.hands.hand import Actuation
from graspforce.hands.limits import DriveLimit, JointRanges, as_tau_max, has_motor, limits
from graspforce.hands.stops import Stops
from graspforce.hands.transmission import RANK_TOLERANCE, Transmission


class HasLimit(Protocol):
    """A drive, whatever else its library has to remember of it."""

    @property
    def limit(self) -> DriveLimit:
        """Its name and the file's limits."""
        ...


class Configuration(Protocol):
    """A robot at one configuration."""

    @property
    def dof_names(self) -> tuple[str, ...]:
        """The joints of the degrees of freedom that ``transmission`` speaks of."""
        ...

    @property
    def transmission(self) -> Transmission:
        """How the drives move the joints there; columns in the order of the drives."""
        ...

    @property
    def ranges(self) -> JointRanges:
        """Joints whose torque is limited beside the drives' own limits."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of the posture, a sentence each."""
        ...

    def twist(self, link: str, point: Array | None) -> Array:
        """Return a link's velocity by each joint's, at ``point`` or at the link's own origin.

        Returns:
            shape (6, n_dofs): [linear; angular], axes of the hand's frame.
        """
        ...

    def position(self, link: str, at: Array | None = None) -> Array:
        """Return a link's origin, or the point ``at`` in its frame, (3,) [m], in the hand's."""
        ...

    def chain(self, link: str) -> Array:
        """Return where the joints are that move a link, and the link, from the base.

        Returns:
            shape (k, 3) [m], in the hand's frame.
        """
        ...

    def bias(self) -> Array:
        """Return what all joints must give at rest against gravity and springs, shape (n_dofs,)."""
        ...


D = TypeVar("D", bound=HasLimit)


class Motors(NamedTuple, Generic[D]):
    """The drives that have motors, and the limits that hold for them."""

    drives: tuple[D, ...]
    joint_names: tuple[str, ...]
    tau_lo: Array
    tau_hi: Array
    warnings: tuple[str, ...]
    """Limits that may be none of the motor's, a sentence each."""
    idle: tuple[str, ...]
    """Drives whose motors have no torque."""

    def actuation(
        self,
        transmission: Transmission,
        ranges: JointRanges,
        full: Array,
        bias: Array,
        notes: tuple[str, ...] = (),
    ) -> Actuation:
        """Return what the joints bring into the force problem.

        Args:
            transmission: how the drives move the joints.
            ranges: joints whose torque is limited beside the drives' own limits.
            full: Jacobian over all joints in the contact frames, shape (m, n_dofs).
            bias: what all joints must give besides, shape (n_dofs,).
            notes: what a user should know of the posture.
        """
        driven, free = transmission.driven, transmission.free
        rows, loads = np.zeros((0, len(full))), np.zeros(0)
        if free.shape[1]:
            loaded = loaded_motions(full, free)
            rows, loads = (full @ loaded).T, -loaded.T @ bias
        stopped = np.zeros(len(self.joint_names))
        for _, drive, side in transmission.beside:
            stopped[drive] = side
        J, tau_bias = full @ driven, driven.T @ bias
        A, b = np.zeros((0, len(full))), np.zeros(0)
        if transmission.bearing:
            pushing = (full @ transmission.stopped).T
            touched = pushing.any(axis=1)  # a stop that no contact loads is nobody's concern
            A, b = -pushing[touched], (transmission.stopped.T @ bias)[touched]
        if ranges.names:
            counted = ~_shifted(ranges, transmission)
            arms, lo, hi = ranges.arms[counted], ranges.lo[counted], ranges.hi[counted]
            A = np.vstack((A, arms @ J.T, -arms @ J.T))
            b = np.concatenate((b, hi - arms @ tau_bias, arms @ tau_bias - lo))
        return Actuation(
            self.joint_names, J, self.tau_lo, self.tau_hi, tau_bias,
            rows, loads, transmission.internal, A, b, stopped, notes,
        )  # fmt: skip


def choose_motors(
    drives: Sequence[D],
    tau_max: float | Mapping[str, float] | None,
    named: Sequence[str] | None = None,
) -> Motors[D]:
    """Choose those of the drives that have motors and settle their limits.

    Args:
        drives: the drives.
        tau_max: the user's limits.
        named: those that have motors, where the user says so.

    Raises:
        InvalidInputError: ``tau_max`` is wrong or names what is not there.
        ModelImportError: a drive without a limit.
    """
    given = as_tau_max(tau_max, [each.limit.name for each in drives])
    if named is None:
        kept = tuple(each for each in drives if has_motor(each.limit, given))
        idle = tuple(each.limit.name for each in drives if not has_motor(each.limit, given))
    else:
        kept, idle = tuple(each for each in drives if each.limit.name in named), ()
    allowed = limits([each.limit for each in kept], given)
    return Motors(
        kept, tuple(each.limit.name for each in kept), allowed.lo, allowed.hi, allowed.warnings,
        idle,
    )  # fmt: skip


def as_names(names: Sequence[str], argument: str, known: Iterable[str]) -> tuple[str, ...]:
    """Return the joints or tendons that an argument names.

    Raises:
        InvalidInputError: no list, or a name that is not there; the text lists those that are.
    """
    given, known = as_tuple(names, argument, str), tuple(dict.fromkeys(known))
    for name in given:
        if name not in known:
            raise InvalidInputError(
                f"{argument}: got {name!r}, expected some of {', '.join(known)}"
            )
    return given


def locking_rows(locked: Sequence[str], dof_names: Sequence[str]) -> Array:
    """Return couplings that hold joints still, shape (p, n_dofs).

    Args:
        locked: the joints.
        dof_names: the joint of each degree of freedom, n_dofs names.

    Raises:
        InvalidInputError: ``locked`` names what is no joint.
    """
    locked = as_names(locked, "locked", dof_names)
    return np.eye(len(dof_names))[[name in locked for name in dof_names]]


def stop_notes(stops: Stops, transmission: Transmission) -> list[str]:
    """Say which joints lean on their stops, a sentence for those of each kind."""
    kinds: dict[str, list[str]] = {}
    beside = {stop for stop, _, _ in transmission.beside}
    for i, name in enumerate(stops.names):
        kind = "and what it bears beside the motors is not counted"
        if i in transmission.bearing:
            kind = "which can push off what no motor moves, and not pull"
        elif i in beside:
            kind = "which bears what goes beyond the motor's limit there"
        kinds.setdefault(kind, []).append(name)
    return [f"at a stop, {kind}: {', '.join(names)}" for kind, names in kinds.items()]


def range_notes(ranges: JointRanges, transmission: Transmission) -> list[str]:
    """Say which joints' torques the file limits besides, a sentence for those of each kind."""
    shifted = _shifted(ranges, transmission).tolist()
    each = list(zip(ranges.names, ranges.lo.tolist(), ranges.hi.tolist(), shifted, strict=True))
    notes: list[str] = []
    counted = [f"{name!r} {lo:g} to {hi:g}" for name, lo, hi, left_out in each if not left_out]
    if counted:
        notes.append(
            f"what all motors together do at a joint is limited, too: {', '.join(counted)}"
        )
    left_out = [repr(name) for name, _, _, left_out in each if left_out]
    if left_out:
        notes.append(
            f"the file's limit of all motors together at {', '.join(left_out)} is not counted: "
            "motors that pull against each other load these joints, which is not determined"
        )
    return notes


def _shifted(ranges: JointRanges, transmission: Transmission) -> NDArray[np.bool_]:
    """Return at which of the joints internal forces of the motors make a torque, shape (p,).

    They make none at a joint that can move by itself.
    """
    shares = np.abs(ranges.arms) @ np.abs(transmission.internal.T)
    made = np.abs(ranges.arms @ transmission.internal.T)
    shifted: NDArray[np.bool_] = np.any(made > RANK_TOLERANCE * shares, axis=1)
    return shifted


def warnings_of(
    motors: Motors[D], transmission: Transmission, dof_names: Sequence[str]
) -> tuple[str, ...]:
    """Return what should not be believed silently, a sentence each."""
    return (*motors.warnings, *_uncontrolled(transmission, dof_names))


def notes_of(
    motors: Motors[D],
    transmission: Transmission,
    dof_names: Sequence[str],
    locked: Sequence[str],
    friction: Array,
) -> tuple[str, ...]:
    """Return what else there is to know, a sentence each.

    Args:
        motors: the motors.
        transmission: how they move the joints.
        dof_names: the joint of each degree of freedom, n_dofs names.
        locked: the joints that are held.
        friction: dry friction of the joints, shape (n_dofs,) [N·m; N for slides].
    """
    return (
        *idle_notes(motors.idle),
        *_coupling_notes(transmission, dof_names, motors.joint_names),
        *_internal_notes(transmission, motors.joint_names),
        *_lock_notes(locked),
        *_friction_notes(dof_names, friction),
    )


def idle_notes(idle: Sequence[str]) -> list[str]:
    """Say which motors the file gives no torque, one sentence for all."""
    if not idle:
        return []
    names, them = ", ".join(map(repr, idle)), "it" if len(idle) == 1 else "each"
    return [
        f"the file gives {names} no torque at all: taken as without a motor; tau_max gives {them} "
        "one"
    ]


def undetermined_notes(W: Array, passive_rows: Array, J: Array) -> list[str]:
    """Say how many components of c only the physics chooses, a sentence where there are any."""
    count, m = undetermined(np.vstack((W, passive_rows)), J), W.shape[1]
    if not count:
        return []
    return [
        f"{count} of {m} force components are undetermined: neither W c = f nor the torques fix "
        "them, so the motors cannot tell; they and the margins that they are in are as asked"
    ]


def full_jacobian(contacts: Sequence[Contact], twists: Iterable[Array]) -> Array:
    """Return the Jacobian over all joints in the contact frames, shape (m, n_dofs).

    Args:
        contacts: n contacts; FPC has the normal row, PCWF those of normal, x and y, SFC torsion
            besides.
        twists: for each, the velocity of its link at the contact point, shape (6, n_dofs).
    """
    pairs = zip(contacts, twists, strict=True)
    return np.vstack([contact.wrench_basis.T @ twist for contact, twist in pairs])


def loaded_motions(full: Array, free: Array) -> Array:
    """Return the free motions that contacts can load, shape (n_dofs, k): orthonormal columns.

    Args:
        full: Jacobian over all joints, shape (m, n_dofs).
        free: the motions that no drive takes part in, shape (n_dofs, at least k).
    """
    least = RANK_TOLERANCE * float(np.abs(full).max(initial=0.0))
    return free @ native.module.span(np.ascontiguousarray(full @ free), least).T


def _lock_notes(locked: Sequence[str]) -> list[str]:
    """Say which joints are held, in a sentence or none."""
    return [f"held whatever the contacts do to them: {', '.join(locked)}"] if locked else []


def _friction_notes(names: Sequence[str], sizes: Array) -> list[str]:
    """Say that dry friction in joints is not counted, in a sentence or none.

    Args:
        names: the joints, n of them.
        sizes: their dry friction, shape (n,) [N·m; N for slides and tendons].
    """
    rubbing = [
        f"{name} (up to {size:g})"
        for name, size in dict(zip(names, sizes.tolist(), strict=True)).items()
        if size > 0
    ]
    what = "friction in the joints helps to hold and is not counted [N·m; N for slides]"
    return [f"{what}: {', '.join(rubbing)}"] if rubbing else []


def _coupling_notes(
    transmission: Transmission, dof_names: Sequence[str], joint_names: Sequence[str]
) -> list[str]:
    """Say which joints a drive moves besides its own, a sentence each.

    Drives that are more than the motions have no motion of their own.
    """
    notes: list[str] = []
    redundant: NDArray[np.bool_] = (transmission.internal != 0).any(axis=0)
    for column, drive in enumerate(joint_names):
        if redundant[column]:
            continue
        ratios = transmission.driven[:, column]
        others = [
            f"{name!r} by {ratio:.4g}"
            for name, ratio in zip(dof_names, ratios.tolist(), strict=True)
            if ratio and name != drive
        ]
        if others:
            notes.append(f"{drive!r} also moves {', '.join(others)} per unit of its own motion")
    return notes


def _internal_notes(transmission: Transmission, joint_names: Sequence[str]) -> list[str]:
    """Say which motors are more than the motions that they move, a sentence for each set."""
    together = np.where(transmission.internal == 0, 0.0, 1.0)
    notes: list[str] = []
    for members in _connected(together.T @ together > 0):
        names = ", ".join(repr(joint_names[i]) for i in members)
        count = len(members) - int(together[:, members].any(axis=1).sum())
        motions = "1 motion" if count == 1 else f"{count} motions"
        notes.append(
            f"{names} are {len(members)} motors for {motions}: how they share a load is part of "
            f"the answer (motor_forces)"
        )
    return notes


def _connected(together: NDArray[np.bool_]) -> list[list[int]]:
    """Return the sets of indices that a symmetric relation connects; not those without any."""
    left = [i for i in range(len(together)) if together[i, i]]
    sets: list[list[int]] = []
    while left:
        group = {left[0]}
        while True:
            wider = {j for i in group for j in np.flatnonzero(together[i]).tolist()}
            if wider <= group:
                break
            group |= wider
        left = [i for i in left if i not in group]
        sets.append(sorted(group))
    return sets


def _uncontrolled(transmission: Transmission, dof_names: Sequence[str]) -> list[str]:
    """Say which motions no drive takes part in, one sentence for all sets of joints."""
    projector = transmission.free @ transmission.free.T
    sets: list[str] = []
    for members in _connected(np.abs(projector) > 1e-9):
        names = ", ".join(repr(dof_names[i]) for i in members)
        count = round(float(np.trace(projector[np.ix_(members, members)])))
        sets.append(
            names if count == len(members) else f"{count} of {len(members)} motions of {names}"
        )
    if not sets:
        return []
    return [
        f"no motor controls {'; '.join(sets)}: only contact forces that leave this unloaded can be "
        "held (passive_rows)"
    ]
