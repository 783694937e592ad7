"""Grasps from NPZ: stacked arrays, one grasp an entry, point contacts with friction.

Meant for many grasps of one hand. W may come as it is or as points and normals. Data sets carry
more than the problems themselves, so keys that are not part of the format are left alone;
:func:`unused_keys` lists them.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.lib.npyio import NpzFile

from graspforce._engine.layout import FIELDS
from graspforce._util.arrays import Array, as_array, require
from graspforce.batch import BatchProblems
from graspforce.columns import ProblemColumns
from graspforce.contact import (
    LEAST_ACROSS,
    PCWF,
    UNIT_TOLERANCE,
    Contact,
    any_tangent,
    warn_of_slips,
)
from graspforce.errors import InvalidInputError, error_context
from graspforce.files.named import GraspFile, NamedProblems, default_name
from graspforce.grasp_map import stacked_maps
from graspforce.problem import ForceProblem

# Each may be a number for all, a number a grasp (B,), or a stack (B, n), (B, n_joints) or (B, m).
_PER_GRASP = (
    "mu",
    "tau_limit",
    *(name for name, field in FIELDS.items() if field.broadcast or not field.shape),
)
# Each must be a stack; the value is the shape of one entry, as an error text says it. Contacts are
# PCWF: there is no gamma.
_STACKS = {
    name: ", ".join(field.shape)
    for name, field in FIELDS.items()
    if name not in (*_PER_GRASP, "gamma")
}
# What the grasp maps are made of where the file has no W.
_GEOMETRY = ("points", "normals", "tangents", "origin")
# Either gives the names; the first that is there.
_NAMES = ("names", "object")
KEYS = (*_STACKS, *_PER_GRASP, *_GEOMETRY, *_NAMES)


def read_npz(file: BinaryIO, stem: str) -> GraspFile:
    """Return the grasps of an NPZ archive.

    Args:
        file: the archive.
        stem: what to call a grasp without a name.

    Raises:
        InvalidInputError: no archive, missing or ill-shaped arrays, or a problem that is
            refused; the text names the key or the grasp.
    """
    arrays, unused = _load(file)
    if "points" in arrays and "normals" not in arrays:
        raise InvalidInputError("normals: missing; expected normals (B, n, 3) beside points")
    for key in ("W", "f", "mu"):
        if key not in arrays and not (key == "W" and "points" in arrays):
            raise InvalidInputError(
                f"{key}: missing; expected at least W (B, k, m), or points and normals (B, n, 3), "
                "f (B, k) and mu"
            )
    if "tau_limit" in arrays and ("tau_lo" in arrays or "tau_hi" in arrays):
        raise InvalidInputError("tau_limit: given beside tau_lo or tau_hi, expected one or other")
    origin = arrays.pop("origin", np.zeros(3))
    if origin.shape != (3,):  # one for each grasp
        arrays["origin"] = origin
    count = _count(arrays)
    names = _names(arrays, stem, count)
    geometry = {key: arrays.pop(key) for key in _GEOMETRY if key in arrays}
    if "W" not in arrays:
        arrays["W"] = _grasp_maps({"origin": np.broadcast_to(origin, (count, 3))} | geometry, names)
    problems = _problems({key: arrays[key] for key in arrays if key not in _NAMES}, names)
    return GraspFile(NamedProblems(names, problems), unused)


def unused_keys(path: str | Path) -> list[str]:
    """Return the keys of an NPZ file that :func:`read` leaves alone; none for a JSON file.

    Raises:
        InvalidInputError: the file is no NPZ archive.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        return []
    try:
        with zipfile.ZipFile(path) as archive:
            keys = [name.removesuffix(".npy") for name in archive.namelist()]
    except (OSError, zipfile.BadZipFile) as error:
        raise InvalidInputError(f"{path}: cannot read the archive: {error}") from error
    return _left_alone(keys)


def _left_alone(keys: list[str]) -> list[str]:
    """Return those of an archive's keys that are not read."""
    read = set(KEYS).difference(_GEOMETRY if "W" in keys else ())
    return [key for key in keys if key not in read]


def _load(file: BinaryIO) -> tuple[dict[str, np.ndarray[Any, Any]], list[str]]:
    """Return the arrays of the format, and the keys of the others, which stay unread."""
    if not zipfile.is_zipfile(file):
        raise InvalidInputError("not an NPZ archive: empty, cut short, or of another kind")
    file.seek(0)
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    unused: list[str] = []
    key = "archive"
    try:
        with cast(NpzFile, np.load(file, allow_pickle=False)) as archive:
            unused = _left_alone(archive.files)
            for key in KEYS:
                if key in archive and key not in unused:
                    arrays[key] = np.asarray(archive[key])
    # A damaged archive fails in zipfile, zlib, struct or NumPy's header parser, each with an
    # exception of its own, none of which says where: no narrower list is complete.
    except Exception as error:
        raise InvalidInputError(f"{key}: cannot read the array: {error}") from error
    return arrays, unused


def _count(arrays: dict[str, np.ndarray[Any, Any]]) -> int:
    """Return the number of grasps, which every stack must have."""
    vectors = dict.fromkeys(_GEOMETRY, "n, 3") | {"origin": "3"}
    for key, entry in (_STACKS | vectors).items():
        if key in arrays and arrays[key].ndim != 1 + len(entry.split(",")):
            raise InvalidInputError(
                f"{key}: got shape {arrays[key].shape}, expected a stack (B, {entry})"
            )
    leading = "W" if "W" in arrays else "points"
    count = len(arrays[leading])
    if count == 0:
        shape = arrays[leading].shape
        raise InvalidInputError(f"{leading}: got shape {shape}, expected at least one grasp")
    for key, array in arrays.items():
        if array.ndim > 0 and len(array) != count:
            raise InvalidInputError(
                f"{key}: got {len(array)} entries, expected {count}, one for each grasp in "
                f"{leading}"
            )
    return count


def _names(arrays: dict[str, np.ndarray[Any, Any]], stem: str, count: int) -> list[str]:
    key = next((key for key in _NAMES if key in arrays), None)
    if key is None:
        return [default_name(stem, index, count) for index in range(count)]
    names = arrays[key]
    if names.ndim != 1 or names.dtype.kind not in "Uiu":
        raise InvalidInputError(
            f"{key}: got type {names.dtype.name} of shape {names.shape}, expected text or whole "
            f"numbers of shape ({count},)"
        )
    return [str(name) for name in names]


def _grasp_maps(geometry: dict[str, np.ndarray[Any, Any]], names: list[str]) -> Array:
    """Return W of each grasp's points and normals, shape (B, 6, 3 n)."""
    points = as_array(geometry["points"], "points", (len(names), "n", 3))
    normals = as_array(geometry["normals"], "normals", points.shape)
    tangents = any_tangent(normals)
    if "tangents" in geometry:
        tangents = as_array(geometry["tangents"], "tangents", points.shape)

    def contact(index: int, place: int) -> Contact:
        return Contact(
            points[index, place], normals[index, place], PCWF(1.0), tangents[index, place]
        )

    with np.errstate(invalid="ignore"):  # a tangent of zeros
        across = np.linalg.norm(np.cross(normals, tangents), axis=-1)
        across /= np.linalg.norm(tangents, axis=-1)
    unit = np.abs(np.linalg.norm(normals, axis=-1) - 1) <= UNIT_TOLERANCE
    for index, place in np.argwhere(~(unit & (across > LEAST_ACROSS))).tolist():
        with error_context(f"grasp {index} {names[index]!r}: contacts[{place}]"):
            contact(index, place)  # which raises
    # A slip of units or signs is one of the whole file.
    warn_of_slips([contact(0, place) for place in range(points.shape[1])])
    origin = as_array(geometry["origin"], "origin", (len(names), 3))
    return stacked_maps(origin[:, None], points, normals, tangents)


def _problems(arrays: dict[str, np.ndarray[Any, Any]], names: list[str]) -> ProblemColumns:
    """Return the problems of all grasps, whose numbers are those arrays."""

    def make(index: int) -> ForceProblem:
        own = {key: each if each.ndim == 0 else each[index] for key, each in arrays.items()}
        with error_context(f"grasp {index} {names[index]!r}"):
            return _problem(own)

    # Types, shapes and what came without what are those of all grasps.
    first = make(_first_that_pulls(arrays))
    given = dict(arrays)
    if "tau_limit" in given:
        limit = given.pop("tau_limit").astype(np.float64)
        given |= {"tau_lo": -limit, "tau_hi": limit}
    if not first.layout.pulls:
        given.pop("pull", None)
    rows = BatchProblems.like(first, given, len(names))
    flaw = rows.first_flaw()
    if flaw is not None:
        make(flaw[0])  # which raises, and says it of the array that the file has
    return ProblemColumns([(np.arange(len(names)), rows)])


def _first_that_pulls(arrays: dict[str, np.ndarray[Any, Any]]) -> int:
    """Return the index of the first grasp with a contact that pulls; 0 where there is none."""
    pull = arrays.get("pull", np.zeros(()))
    return int((pull > 0).reshape(len(pull), -1).any(axis=1).argmax()) if pull.ndim else 0


def _problem(own: dict[str, np.ndarray[Any, Any]]) -> ForceProblem:
    """Build one grasp's problem from its own entries of the stacks."""
    columns = own["W"].shape[1]
    if columns == 0 or columns % 3:
        raise InvalidInputError(
            f"W: got {columns} columns, expected 3 for each contact: normal, x, y"
        )
    mu = as_array(own.pop("mu"), "mu", (columns // 3,), broadcast=True)
    pull = as_array(own.pop("pull", 0.0), "pull", (columns // 3,), broadcast=True)
    arguments: dict[str, Any] = dict(own)
    limit = arguments.pop("tau_limit", None)
    if limit is not None:
        bound = as_array(limit, "tau_limit", np.shape(limit))
        require(np.ravel(bound > 0), "tau_limit", np.ravel(bound), "more than 0 N·m")
        arguments |= {"tau_lo": -bound, "tau_hi": bound}
    models = [PCWF(float(each), float(p)) for each, p in zip(mu, pull, strict=True)]
    return ForceProblem(models=models, **arguments)
