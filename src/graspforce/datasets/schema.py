"""The columns of data sets, said once: what is read of a source, and what a target has.

A source's row is a grasp in one of two forms. *Matrices* are the fields of a ForceProblem, W first.
*Geometry* is contact points and normals, of which W is made.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable
from typing import NamedTuple

from graspforce._engine.layout import FIELDS
from graspforce.errors import InvalidInputError


class ColumnInfo(NamedTuple):
    """What is known of a column: its axes, what it is, and its unit."""

    shape: tuple[int | str, ...]
    doc: str
    unit: str = ""


def _of_field(name: str) -> ColumnInfo:
    field = FIELDS[name]
    doc, _, unit = field.doc.partition(" [")
    return ColumnInfo(field.shape, doc, unit.rstrip("]"))


# Columns of a source beside the fields of a ForceProblem. Numbers are in the axes of the contact
# points; ``object_pose`` tells how these axes stand in the world.
_FURTHER = {
    "points": ColumnInfo(("n", 3), "Contact points", "m"),
    "normals": ColumnInfo(("n", 3), "Unit normals into the object"),
    "tangents": ColumnInfo(("n", 3), "Directions of the contact frames' x"),
    "origin": ColumnInfo((3,), "Point that torques are about; with mass, the centre of mass", "m"),
    "mass": ColumnInfo((), "Mass of the object, in place of f: what is to be carried", "kg"),
    "gravity_direction": ColumnInfo((3,), "Where gravity pulls, in the world; default down z"),
    "object_pose": ColumnInfo((7,), "Object in the world: x, y, z, quaternion wxyz", "m, 1"),
    "tau_limit": ColumnInfo(("n_joints",), "Torque limits both ways, for tau_lo and tau_hi", "N·m"),
    "q": ColumnInfo(("n_q",), "Joint angles of the hand", "rad"),
    "hand_pose": ColumnInfo((7,), "Hand in the axes of the points: x, y, z, wxyz", "m, 1"),
}
_TEXTS = {
    "models": ColumnInfo(("n",), "FPC, PCWF or SFC, one for all contacts or a list"),
    "fingertips": ColumnInfo(("n",), "The hand's links that make the contacts"),
}
NUMBERS = {name: _of_field(name) for name in FIELDS} | _FURTHER
TEXTS = tuple(_TEXTS)
KNOWN = NUMBERS | _TEXTS

# Columns of a target, in their order; keys of the source come after ``row``.
RESULTS = {
    "file": ColumnInfo((), "Source file, relative to the source"),
    "row": ColumnInfo((), "Row in that file, from 0"),
    "gravity_index": ColumnInfo((), "Which of the directions of gravity, from 0"),
    "gravity": ColumnInfo((3,), "Direction of gravity, in the axes of the contacts"),
    "f": ColumnInfo(("k",), "Wrench that was asked for, where it is not in the source", "N, N·m"),
    "status": ColumnInfo((), "SOLVED, INFEASIBLE, …: see graspforce.Status"),
    "newton_steps": ColumnInfo((), "Newton steps taken"),
    "alpha": ColumnInfo((), "Weight of the limits"),
    "c": ColumnInfo(("m",), "Contact forces in the contact frames", "N, N·m"),
    "tau": ColumnInfo(("n_joints",), "Joint torques J.T c + tau_bias", "N·m"),
    "normal_forces": ColumnInfo(("n",), "Normal forces", "N"),
    "friction_margins": ColumnInfo(("n",), "Distances to slipping, mu n − |tangential|", "N"),
    "torque_margins": ColumnInfo(("n_joints",), "Distances of the torques to their limits", "N·m"),
    "wrench_error": ColumnInfo((), "Largest |W c − f|", "N, N·m"),
    "suboptimality": ColumnInfo((), "Certified bound on Phi(c) − Phi*; inf without one"),
    "violation": ColumnInfo((), "Least relative violation of the limits where INFEASIBLE"),
    "met": ColumnInfo((), "Whether every wish is met"),
    "least": ColumnInfo((), "Least possible largest normal force, with times_least", "N"),
}

# How alike an unknown column and a known one are where the one is probably meant to be the other;
# of short names one letter makes less alike.
_ALIKE, _SHORT_ALIKE, _SHORT = 0.85, 0.72, 5
# Names of keys that are no slips, however alike.
_KEYS = ("id", "name", "object", "object_id", "pose", "fingers")


def choose_keys(names: Iterable[str], wanted: Collection[str] | None) -> list[str]:
    """Return the columns that are carried through.

    Args:
        names: all columns of the source.
        wanted: those that the caller lists; None for all that are no part of the format.

    Raises:
        InvalidInputError: a listed one is not there, or is written anyway; one that is not listed
            looks like a slip.
    """
    there = list(dict.fromkeys(names))
    unknown = [name for name in there if name not in KNOWN]
    for name in wanted or ():
        if name not in there:
            near = _nearest(name, there)
            raise InvalidInputError(
                f"keys: the source has no column {name!r}; {_suggest(near)}it has "
                f"{', '.join(there)}"
            )
    keys = unknown if wanted is None else list(dict.fromkeys(wanted))
    for name in unknown:
        if name in (wanted or ()) or name in _KEYS:
            continue
        near = _slip_of(name)
        if near is not None:
            raise InvalidInputError(
                f"column {name!r}: not part of the format; {_suggest(near)}name it in keys to have "
                "it carried through"
            )
    for name in keys:
        if name in RESULTS:
            raise InvalidInputError(
                f"column {name!r}: the target has a column of this name of its own; rename it"
            )
    return keys


def require_column(name: str) -> None:
    """Raise unless a column is part of the format.

    Raises:
        InvalidInputError: it is not; the text names the nearest that is.
    """
    if name not in KNOWN:
        raise InvalidInputError(
            f"{name}: no column of the format; {_suggest(_nearest(name, KNOWN))}"
            f"expected one of {', '.join(KNOWN)}"
        )


def _slip_of(name: str) -> str | None:
    """Return the column that a name is probably meant to be."""
    if len(name) >= _SHORT:
        for known in KNOWN:
            if known.startswith(name.lower()):
                return known
    return _nearest(name, KNOWN, _ALIKE if len(name) > _SHORT else _SHORT_ALIKE)


def _nearest(name: str, known: Iterable[str], alike: float = 0.5) -> str | None:
    lower = {each.lower(): each for each in reversed(list(known))}
    lower |= {each: each for each in lower.values()}
    found = difflib.get_close_matches(name, lower, 1, alike)
    found = found or difflib.get_close_matches(name.lower(), lower, 1, alike)
    return lower[found[0]] if found else None


def _suggest(near: str | None) -> str:
    return "" if near is None else f"did you mean {near!r}? "
