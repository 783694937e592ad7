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

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

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


def rows_of(couplings: Sequence[Coupling], turns: Mask) -> Array:
    """Return the gradients of couplings, shape (p, n_dofs), without what is play.

    Args:
        couplings: the couplings.
        turns: which degrees of freedom are turns, shape (n_dofs,); the others are slides.
    """
    rows = [np.zeros((0, len(turns)))]
    for group in _linkages(couplings):
        if all(each.kind == "ratio" for each in group):
            rows += [each.rows for each in group]
            continue
        scale = _lengths(group, turns)
        even = np.vstack([_even(each, scale)[0] for each in group])
        own = even.any(axis=0)  # rounding would tie other joints to the loop
        _, sizes, right = np.linalg.svd(even[:, own], full_matrices=False)
        kept = np.zeros((int((sizes > PLAY * sizes[0]).sum()), len(turns)))
        kept[:, own] = right[: len(kept)] * scale[own]
        rows.append(kept / np.linalg.norm(kept, axis=1, keepdims=True))
    return np.vstack(rows)


def largest_gap(couplings: Sequence[Coupling], turns: Mask) -> Gap:
    """Return the loop that is open most relative to its size; a gap of 0 where there is none."""
    gaps = [Gap(0.0, 0.0, ())]
    for group in _linkages(couplings):
        size = _size(group, turns)
        for each in group:
            if each.kind == "place":
                metres = float(np.linalg.norm(each.gap))
                gaps.append(Gap(metres, metres / size, each.between))
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
    gap = left = largest_gap(couplings, turns)
    if gap.share < 1e-12:
        return q, []
    linked: Mask = rows_of(couplings, turns).any(axis=0) & ~locked
    posture = q
    for moved in (linked & ~driven, linked):
        if (q == start)[moved].all():
            posture, steps = start, 1 + int(np.abs(q - start).max() / _LARGEST_TURN)
            for share in np.linspace(0, 1, steps + 1)[1:]:
                toward = np.where(moved, posture, start + share * (q - start))
                posture = _nearest_closed(toward, read, moved, turns)
        else:
            posture = _nearest_closed(q, read, moved, turns)
        left = largest_gap(read(posture), turns)
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
        for group in _linkages(read(q)):
            scale = _lengths(group, turns)
            rows, gap = (
                np.concatenate(parts)
                for parts in zip(*(_even(each, scale) for each in group), strict=True)
            )
            ways = np.linalg.lstsq(rows[:, moved], -gap, rcond=PLAY)[0]
            step[moved] += ways / scale[moved]
            most = max(most, float(np.abs(ways).max(initial=0.0)) / _size(group, turns))
        q = q + step * min(1.0, _LARGEST_TURN / max(most, _LARGEST_TURN))
        if most < 1e-10:  # the next step would be its square
            break
    return q


def _even(coupling: Coupling, scale: Array) -> tuple[Array, Array]:
    """Return a coupling's rows by the joints' ways, the largest entry 1, and the gap with them."""
    rows = coupling.rows / scale
    size = np.abs(rows).max(initial=0.0) or 1.0
    return rows / size, coupling.gap / size


def _lengths(group: Sequence[Coupling], turns: Mask) -> Array:
    """Return the way that each joint's motion stands for, shape (n_dofs,) [m per rad or m]."""
    return np.where(turns, _size(group, turns), 1.0)


def _size(group: Sequence[Coupling], turns: Mask) -> float:
    """Return the longest arm of a turning joint at a place that closes a loop [m]; else 1."""
    arms = [np.abs(each.rows[:, turns]).max(initial=0.0) for each in group if each.kind == "place"]
    return float(max(arms, default=0.0)) or 1.0


def _linkages(couplings: Sequence[Coupling]) -> list[list[Coupling]]:
    """Return the couplings by linkage: those that share joints together."""
    left = [each for each in couplings if each.rows.any()]
    groups: list[list[Coupling]] = []
    while left:
        group = [left.pop(0)]
        joints = group[0].rows.any(axis=0)
        while True:
            more = [each for each in left if each.rows[:, joints].any()]
            if not more:
                break
            group += more
            left = [each for each in left if not any(each is other for other in more)]
            for each in more:
                joints = joints | each.rows.any(axis=0)
        groups.append(group)
    return groups
