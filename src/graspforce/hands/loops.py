"""Closed linkages: which joint motions leave them closed, and postures that close them.

A loop of links is closed by a constraint between two of them: a point of one stays at a point of
the other (``place``), and where they are welded, so does their orientation (``turn``). Robots'
loops never close exactly. A file's numbers are rounded, a simulation's constraints are soft, and
the axes of a plane linkage are parallel to a mrad or so. Taken by their word such constraints
would stop a linkage that turns: the gap's row against a motion out of the plane is small but not
zero. So what holds a linkage by less than :data:`PLAY` of what its other constraints do counts as
play in the bearings. To compare them, a joint's turn counts by the way it makes at the linkage's
size, in metres like a slide.

That a loop's constraints are about its own joints alone is the readers' part: joints that move both
links alike, above their common ancestor, have no part in it whatever the gap.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from graspforce._engine import native
from graspforce._util.arrays import Array
from graspforce.errors import InvalidInputError

Mask: TypeAlias = NDArray[np.bool_]

# Rotation axes of a linkage are parallel to about a mrad. A linkage within this of a singular
# posture moves as if it were there.
PLAY = 3e-3
# A gap moves every point of a linkage relative to the closed one's by about its own size, so the
# Jacobian's relative error is the gap over the linkage's size.
WORTH_SAYING = 1e-4
CLOSED = 1e-2
HOPELESS = 0.1
_KINDS = {"ratio": 0, "place": 1, "turn": 2}  # as the core numbers them
_LARGEST_TURN = 0.2  # of a joint in one step of closing a loop [rad]; of a slide, of the size
_MOST_OF_MOTORS = 0.05  # how far joints with motors may be off [rad, m]


class Coupling(NamedTuple):
    """An equality constraint between joints at one configuration."""

    kind: Literal["place", "turn", "ratio"]
    """``ratio`` is a mimic joint, and whatever else closes no loop."""
    rows: Array
    """Gradients by the joints' motions, shape (r, n_dofs)."""
    gap: Array
    """By how much it is missed, shape (r,) [m for a place]."""
    between: tuple[str, ...]
    """The links, of a loop."""


class Gap(NamedTuple):
    """The loop that is open most, relative to its size."""

    metres: float
    share: float
    """Of the linkage's size."""
    between: tuple[str, ...]


class Linkage(NamedTuple):
    """Couplings that share joints."""

    couplings: list[Coupling]
    size: float
    """The longest arm of a turning joint at a place that closes a loop [m]; 1 without one."""


def linkages(couplings: Sequence[Coupling], turns: Mask) -> list[Linkage]:
    """Return the couplings by linkage.

    Args:
        couplings: the couplings.
        turns: which degrees of freedom are turns, shape (n_dofs,); the others are slides.
    """
    joints: list[set[int]] = [set(each.rows.nonzero()[1].tolist()) for each in couplings]
    left = [i for i in range(len(couplings)) if joints[i]]
    found: list[Linkage] = []
    while left:
        members = [left.pop(0)]
        tied = joints[members[0]]
        while True:
            more = [i for i in left if joints[i] & tied]
            if not more:
                break
            members += more
            left = [i for i in left if i not in more]
            for i in more:
                tied = tied | joints[i]
        group = [couplings[i] for i in members]
        places = [each.rows[:, turns] for each in group if each.kind == "place"]
        arms = [np.abs(rows).max(initial=0.0) for rows in places]
        found.append(Linkage(group, float(max(arms, default=0.0)) or 1.0))
    return found


def rows_of(couplings: Sequence[Coupling], turns: Mask) -> tuple[Array, float]:
    """Return the gradients of couplings without what is play, and the largest gap's share.

    Args:
        couplings: the couplings.
        turns: which degrees of freedom are turns, shape (n_dofs,); the others are slides.

    Returns:
        shape (p, n_dofs), and the :attr:`Gap.share` of the loop that is open most.
    """
    if not couplings:
        return np.zeros((0, len(turns))), 0.0
    rows = np.ascontiguousarray(np.concatenate([each.rows for each in couplings]), dtype=float)
    gaps = np.concatenate([each.gap for each in couplings], dtype=float)
    return native.module.linkage_rows(
        turns, [_KINDS[each.kind] for each in couplings],
        [len(each.rows) for each in couplings], rows, gaps,
    )  # fmt: skip


def largest_gap(found: Sequence[Linkage]) -> Gap:
    """Return the loop that is open most relative to its size; a gap of 0 where there is none."""
    gaps = [Gap(0.0, 0.0, ())]
    for linkage in found:
        for each in linkage.couplings:
            if each.kind == "place":
                metres = math.hypot(*each.gap.tolist())
                gaps.append(Gap(metres, metres / linkage.size, each.between))
    return max(gaps, key=lambda gap: gap.share)


def gap_notes(gap: Gap) -> list[str]:
    """Say by how much a linkage is open where that shows in J, in a sentence or none."""
    if gap.share <= WORTH_SAYING:
        return []
    return [
        f"the closed linkage of {' and '.join(gap.between)} is open by {1000 * gap.metres:.3g} mm: "
        f"J is off by about {gap.share:.1%}"
    ]


def closed(
    q: Array,
    start: Array,
    read: Callable[[Array], Sequence[Coupling]],
    turns: Mask,
    driven: Mask,
    known: Mask,
    locked: Mask,
    names: Sequence[str],
) -> tuple[Array, list[str]]:
    """Return the posture with closed loops that q stands for, and a note where it is not q.

    What a user knows best are the motors' joints, so the others are moved first, and a motor's own
    joint a little at most. Where q has the others as the file has them, it most likely knows
    nothing of them: they are followed from the file's posture on, which leads to the linkage as it
    is assembled. From afar Newton's steps may end at another.

    Args:
        q: joint positions, shape (n_dofs,) [rad, m].
        start: those of the file.
        read: returns the couplings at joint positions.
        turns: which joints are turns, shape (n_dofs,).
        driven: which ones motors move.
        known: which of them have a motor of their own.
        locked: which ones never move.
        names: the joints.

    Raises:
        InvalidInputError: a loop stays open.
    """
    couplings = read(q)
    gap = left = largest_gap(linkages(couplings, turns))
    if gap.share < 1e-12:
        return q, []
    linked: Mask = rows_of(couplings, turns)[0].any(axis=0) & ~locked
    posture = q
    for moved in (linked & ~driven, linked):
        if (q == start)[moved].all():
            posture, steps = start, 1 + int(np.abs(q - start).max() / _LARGEST_TURN)
            for share in np.linspace(0, 1, steps + 1)[1:]:
                toward = np.where(moved, posture, start + share * (q - start))
                posture = _nearest_closed(toward, read, moved, turns)
        else:
            posture = _nearest_closed(q, read, moved, turns)
        left = largest_gap(linkages(read(posture), turns))
        if left.share <= CLOSED:
            break
    what = f"the closed linkage of {' and '.join(gap.between)} open by {1000 * gap.metres:.3g} mm"
    if left.share > CLOSED:
        raise InvalidInputError(
            f"q: leaves {what}, and its joints can close it to {1000 * left.metres:.3g} mm at "
            "best; expected angles at which it closes"
        )
    for joint in np.flatnonzero(known & (np.abs(posture - q) > _MOST_OF_MOTORS)).tolist():
        raise InvalidInputError(
            f"q: leaves {what}, which closes at {names[joint]} = {posture[joint]:.4g} and not at "
            f"{q[joint]:.4g}; expected angles at which it closes"
        )
    if gap.share - left.share < WORTH_SAYING:
        return posture, []
    changes = ", ".join(
        f"{name} by {change:.3g}"
        for name, change in zip(names, (posture - q).tolist(), strict=True)
        if abs(change) > 1e-6
    )
    return posture, [f"q leaves {what}: closed by moving {changes} [rad, m]"]


def _nearest_closed(
    q: Array, read: Callable[[Array], Sequence[Coupling]], moved: Mask, turns: Mask
) -> Array:
    """Return the posture near q at which the couplings hold best, by Gauss and Newton's steps."""
    for _ in range(100):
        step, most = np.zeros(len(q)), 0.0
        for linkage in linkages(read(q), turns):
            scale = _lengths(linkage, turns)
            rows, gap = _even(linkage, scale)
            ways = np.linalg.lstsq(rows[:, moved], -gap, rcond=PLAY)[0]
            step[moved] += ways / scale[moved]
            most = max(most, float(np.abs(ways).max(initial=0.0)) / linkage.size)
        q = q + step * min(1.0, _LARGEST_TURN / max(most, _LARGEST_TURN))
        if most < 1e-10:  # the next step would be its square
            break
    return q


def _even(linkage: Linkage, scale: Array) -> tuple[Array, Array]:
    """Return the rows by the joints' ways, each coupling's largest entry 1, and the gaps so."""
    rows, gaps = list[Array](), list[Array]()
    for each in linkage.couplings:
        by_way = each.rows / scale
        size = np.abs(by_way).max()
        rows.append(by_way / size)
        gaps.append(each.gap / size)
    return np.concatenate(rows), np.concatenate(gaps)


def _lengths(linkage: Linkage, turns: Mask) -> Array:
    """Return the way that each joint's motion stands for, shape (n_dofs,) [m per rad or m]."""
    return np.where(turns, linkage.size, 1.0)
