"""Grasps from JSON: parse strictly, check against the schema, build the problems.

Three layers, each with errors of its own: the text is strict JSON (Python's parser also takes NaN
and a key given twice); the document has the shape that ``grasp.schema.json`` describes; the numbers
make a :class:`ForceProblem`.

All of this is done twice. First with all grasps of a kind at once, by a parser and with checks that
are quick, but can only tell that a file is in order. Where they cannot, it is read with care, value
by value, to say what is wrong, and where.
"""

from __future__ import annotations

import gc
import json
import math
from codecs import BOM_UTF8
from collections import Counter, defaultdict
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib import resources
from itertools import chain
from typing import Any, BinaryIO, cast

import numpy as np
from jsonschema_rs import Draft202012Validator, ValidationError
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.batch import BatchProblems
from graspforce.columns import ProblemColumns
from graspforce.contact import (
    FPC,
    PCWF,
    SFC,
    UNIT_TOLERANCE,
    Contact,
    ContactModel,
    any_tangent,
    cross,
    exact_lengths,
    slips,
)
from graspforce.errors import InvalidInputError, error_context, warn
from graspforce.files.named import GraspFile, NamedProblems, default_name
from graspforce.grasp import Grasp
from graspforce.grasp_map import stacked_maps
from graspforce.problem import ForceProblem, ProblemOptions

# Keys of a grasp that are arguments of ForceProblem as they stand.
_OPTIONS = tuple(ProblemOptions.__annotations__)
_FIELDS = ("W", "f", *_OPTIONS)
# Keys whose values are texts.
_TEXTS = ("$schema", "comment", "name")
# What contacts have where a file does not say it.
_COEFFICIENTS = {"mu": 1.0, "gamma": 1.0, "pull": 0.0}
_NO_TANGENT = (math.nan, math.nan, math.nan)
_ORIGIN = (0.0, 0.0, 0.0)
# A tangent with less of it across the normal is looked at by itself.
_SURELY_ACROSS = 1e-6
_TYPE_WORDS = {"array": "an array", "object": "an object"}


def read_json(file: BinaryIO, stem: str) -> GraspFile:
    """Return the grasps of a JSON document.

    Args:
        file: the document, UTF-8.
        stem: what to call a grasp without a name.

    Raises:
        InvalidInputError: no JSON, not of the schema, or a problem that is refused; the text
            names the place.
    """
    with _uncollected():
        return _read(file.read(), stem)


@contextmanager
def _uncollected() -> Generator[None]:
    """Let no garbage be looked for: a large document is millions of lists, none of it garbage."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _read(data: bytes, stem: str) -> GraspFile:
    grasps = _quickly_parsed(data)
    problems = None if grasps is None else _stacked(grasps)
    if grasps is None or problems is None:
        document = _parse(data)
        _check_shape(document)
        grasps = cast("list[dict[str, Any]]", document.get("grasps", [document]))
        problems = _one_by_one(grasps, stem)
    return GraspFile(NamedProblems(_names(grasps, stem), problems), [])


def _names(grasps: Sequence[dict[str, Any]], stem: str) -> list[str]:
    count = len(grasps)
    return [each.get("name", default_name(stem, i, count)) for i, each in enumerate(grasps)]


@cache
def _schema_text() -> str:
    source = resources.files("graspforce.files").joinpath("grasp.schema.json")
    return source.read_text(encoding="utf-8")


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of an input file."""
    return json.loads(_schema_text())


@cache
def _validator() -> Draft202012Validator:
    return Draft202012Validator(schema())


# ---- all at once ------------------------------------------------------------------------------


def _quickly_parsed(data: bytes) -> list[dict[str, Any]] | None:
    """Return the grasps of a document that is in order but for their numbers; else None."""
    import msgspec.json  # which a file that is no JSON need not wait for

    try:
        document: Any = msgspec.json.decode(data.removeprefix(BOM_UTF8))
        if not _validator().is_valid(document):
            return None
    except (ValueError, RecursionError):  # also of numbers beyond float64; NaN is no JSON
        return None
    several = "grasps" in document
    grasps: list[dict[str, Any]] = document["grasps"] if several else [document]
    parts = [part for grasp in grasps for part in grasp.get("contacts") or grasp["models"]]
    objects = [document] * several + grasps
    texts = sum(map(len, objects)) + sum(key in each for each in objects for key in _TEXTS)
    texts += sum(map(len, parts)) + len(parts)  # of which each has the name of a model
    # Of a key that is given twice the text has two, and the document one.
    return grasps if texts == _texts(data) else None


def _texts(data: bytes) -> int:
    """Return how many texts a JSON document has, keys included."""
    quotes = data.count(b'"')
    if b"\\" in data:
        quotes -= data.replace(rb"\\", b"").count(rb"\"")
    return quotes // 2


def _stacked(grasps: Sequence[dict[str, Any]]) -> ProblemColumns | None:
    """Return the problems of all grasps; None where something in one of them is wrong."""
    kinds: defaultdict[tuple[Any, ...], list[int]] = defaultdict(list)
    for index, grasp in enumerate(grasps):
        kinds[_kind(grasp)].append(index)
    groups: list[tuple[NDArray[np.intp], BatchProblems]] = []
    found: list[tuple[int, str]] = []
    for indices in kinds.values():
        try:
            rows, odd = _rows([grasps[i] for i in indices])
        except (ValueError, OverflowError):  # also of rows of unlike lengths, and 400 digits
            return None
        if rows.first_flaw() is not None:
            return None
        groups.append((np.array(indices), rows))
        found += [(indices[row], text) for row, text in odd]
    for _, text in sorted(found, key=lambda each: each[0]):
        warn(text)
    return ProblemColumns(groups)


def _kind(grasp: dict[str, Any]) -> tuple[Any, ...]:
    """Return what grasps have in common whose numbers can stand in the same arrays."""
    parts = grasp.get("contacts") or grasp["models"]
    return (
        *[(key, _shape(grasp[key])) for key in _FIELDS if key in grasp],
        *[part["model"] for part in parts],
        any(part.get("pull", 0) > 0 for part in parts),
    )


def _shape(value: Any) -> tuple[int, ...]:
    """Return the shape that a number, a list or a list of lists has if it is a regular one."""
    if not isinstance(value, list):
        return ()
    rows = cast("list[Any]", value)
    if not rows or not isinstance(rows[0], list):
        return (len(rows),)
    return (len(rows), len(cast("list[Any]", rows[0])))


def _rows(grasps: Sequence[dict[str, Any]]) -> tuple[BatchProblems, list[tuple[int, str]]]:
    """Return the problems of grasps of one kind, and what looks like a slip in them.

    Raises:
        ValueError, OverflowError: something is wrong in one of them, which the text does not tell.
    """
    by_W = "W" in grasps[0]
    parts = [grasp["models" if by_W else "contacts"] for grasp in grasps]
    models = [_model(part) for part in parts[0]]
    fields = {key: _stack([each[key] for each in grasps]) for key in _FIELDS if key in grasps[0]}
    for name, default in _COEFFICIENTS.items():
        fields[name] = _stack([[part.get(name, default) for part in each] for each in parts])
    odd: list[tuple[int, str]] = []
    if not by_W:
        with np.errstate(all="ignore"):
            fields["W"], odd = _maps(grasps, parts, fields["gamma"], [each.dim for each in models])
    arguments: dict[str, Any] = {key: value[0] for key, value in fields.items()}
    first = ForceProblem(
        models=models, **{key: arguments[key] for key in arguments if key not in _COEFFICIENTS}
    )
    if not first.layout.pulls:
        del fields["pull"]
    return BatchProblems.like(first, fields, len(grasps)), odd


def _maps(
    grasps: Sequence[dict[str, Any]],
    contacts: Sequence[Sequence[dict[str, Any]]],
    gamma: Array,
    dims: Sequence[int],
) -> tuple[Array, list[tuple[int, str]]]:
    """Return W of contacts of one kind, to the last bit that of :class:`Grasp`, and slips.

    Raises:
        InvalidInputError: a frame is none, or so hardly one that it has to be looked at by itself.
    """
    points = _stack([[part["point"] for part in each] for each in contacts])
    normals = _stack([[part["normal"] for part in each] for each in contacts])
    given = _stack([[part.get("tangent", _NO_TANGENT) for part in each] for each in contacts])
    origins = _stack([each.get("origin", _ORIGIN) for each in grasps])[:, None]
    lengths = exact_lengths(normals)
    units = normals / lengths[..., None]
    tangents = np.where(np.isnan(given), any_tangent(units), given)
    across = np.linalg.norm(cross(units.T, tangents.T).T, axis=-1)
    regular = across > _SURELY_ACROSS * np.abs(tangents).max(axis=-1)
    if not (regular & (np.abs(lengths - 1) <= UNIT_TOLERANCE)).all():
        raise InvalidInputError("contacts: not all have a frame")
    maps = stacked_maps(origins, points, normals, tangents, dims, exact=True)
    return maps, slips(points, units, gamma, dims)


def _stack(numbers: list[Any]) -> Array:
    """Return numbers, lists or lists of lists as an array, in half the time that NumPy takes.

    Raises:
        ValueError: they are not alike in their lengths.
    """
    shape = [len(numbers)]
    while numbers and isinstance(numbers[0], list | tuple):
        (width,) = set(map(len, numbers))
        shape.append(width)
        numbers = list(chain.from_iterable(numbers))
    return np.fromiter(numbers, np.float64, len(numbers)).reshape(shape)


# ---- the text ---------------------------------------------------------------------------------


def _parse(data: bytes) -> Any:
    """Return a document of which every number is finite, and every key of an object given once."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInputError(
            f"byte {error.start}: got {data[error.start]:#04x}, expected UTF-8 text"
        ) from None
    if not text.strip():
        raise InvalidInputError("the file is empty, expected a JSON object")
    repeated: list[tuple[dict[str, Any], str]] = []

    def read_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        entries = dict(pairs)
        if len(entries) < len(pairs):
            counts = Counter(key for key, _ in pairs)
            repeated.append((entries, next(key for key, count in counts.items() if count > 1)))
        return entries

    try:
        # All numbers become floats: every one is a quantity, and float() has no size limit.
        document = json.loads(text, object_pairs_hook=read_object, parse_int=float)
        if repeated or not _all_finite(document):
            _refuse_values(document, "$", repeated)
    except json.JSONDecodeError as error:
        raise InvalidInputError(
            f"line {error.lineno}, column {error.colno}: not JSON: {error.msg}"
        ) from None
    except RecursionError:
        raise InvalidInputError("nested too deeply for a file of grasps") from None
    return document


def _all_finite(value: Any) -> bool:
    """Whether there are no NaN, infinite and overflowing numbers, which json.loads lets pass."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, list):
        entries = cast("list[Any]", value)
        try:
            return math.isfinite(math.fsum(entries))  # NaN and infinity stay what they are
        except (TypeError, OverflowError, ValueError):
            return all(map(_all_finite, entries))
    if isinstance(value, dict):
        return all(map(_all_finite, cast("dict[str, Any]", value).values()))
    return True


def _refuse_values(value: Any, path: str, repeated: Sequence[tuple[dict[str, Any], str]]) -> None:
    """Say where the first number that is not finite, or key that is given twice, stands."""
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidInputError(f"{path}: got {value}, expected a finite number")
    if isinstance(value, dict):
        entries = cast("dict[str, Any]", value)
        for owner, key in repeated:
            if owner is entries:
                raise InvalidInputError(f"{path}: the key {_show(key)} is given twice")
        for key, item in entries.items():
            _refuse_values(item, f"{path}.{key}", repeated)
    elif isinstance(value, list):
        for index, item in enumerate(cast("list[Any]", value)):
            _refuse_values(item, f"{path}[{index}]", repeated)


# ---- the document -----------------------------------------------------------------------------


def _check_shape(document: Any) -> None:
    validator = _validator()
    if validator.is_valid(document):
        return
    errors = list(validator.iter_errors(document))
    # A mistyped key also leaves the intended key missing: report the mistyped one.
    unknown = (error for error in errors if error.schema_path[-1] == "additionalProperties")
    error = next(unknown, errors[0])
    place = "".join(
        f"[{each}]" if isinstance(each, int) else f".{each}" for each in error.instance_path
    )
    raise InvalidInputError(f"${place}: {_explain(error)}")


def _explain(error: ValidationError) -> str:
    """Say what came and what was expected, for each keyword that the schema uses."""
    value: Any = error.instance
    keyword = error.schema_path[-1]
    here: Any = schema()
    for each in error.schema_path[:-1]:
        here = here[each]
    rule = here[keyword]
    got = f"got {_show(value)}, expected"
    match keyword:
        case "additionalProperties":
            valid = list(here["properties"])
            unknown = next(key for key in value if key not in valid)
            several = [] if error.instance_path or "grasps" in valid else ["grasps"]
            return f"unknown key {_show(unknown)}; expected one of {', '.join(valid + several)}"
        case "required":
            return f"missing key {_show(next(key for key in rule if key not in value))}"
        case "type":
            types = [rule] if isinstance(rule, str) else rule
            return f"{got} {' or '.join(_TYPE_WORDS.get(kind, f'a {kind}') for kind in types)}"
        case "enum":
            return f"{got} one of {', '.join(map(_show, rule))}"
        case "exclusiveMinimum":
            return f"{got} more than {rule}"
        case "minimum":
            return f"{got} {rule} or more"
        case "maximum":
            return f"{got} {rule} or less"
        case "minItems" | "maxItems":
            exact = here.get("minItems") == here.get("maxItems")
            return f"{got} {rule}{'' if exact else ' or more'}"
        case "not":
            return here["description"]
        case _:
            return error.message


def _show(value: Any) -> str:
    """Return a value as JSON writes it, arrays and objects by their size."""
    if isinstance(value, list):
        return f"{len(value)} entries"  # pyright: ignore[reportUnknownArgumentType]
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, float):
        return f"{value:g}"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}…"


# ---- the problems -----------------------------------------------------------------------------


def _one_by_one(grasps: Sequence[dict[str, Any]], stem: str) -> ProblemColumns:
    problems: list[ForceProblem] = []
    for index, (name, grasp) in enumerate(zip(_names(grasps, stem), grasps, strict=True)):
        with error_context(f"grasp {index} {name!r}"):
            problems.append(_problem(grasp))
    return ProblemColumns.of(problems)


def _problem(grasp: dict[str, Any]) -> ForceProblem:
    options = {key: grasp[key] for key in _OPTIONS if key in grasp}
    if "W" in grasp:
        models = [_model(entry) for entry in grasp["models"]]
        return ForceProblem(W=grasp["W"], f=grasp["f"], models=models, **options)
    contacts: list[Contact] = []
    for index, entry in enumerate(grasp["contacts"]):
        with error_context(f"contacts[{index}]"):
            contacts.append(
                Contact(entry["point"], entry["normal"], _model(entry), entry.get("tangent"))
            )
    return Grasp(contacts, origin=grasp.get("origin", (0.0, 0.0, 0.0))).problem(
        grasp["f"], **options
    )


def _model(entry: dict[str, Any]) -> ContactModel:
    return _make_model(entry["model"], entry.get("mu"), entry.get("gamma"), entry.get("pull", 0.0))


@lru_cache(maxsize=1024)
def _make_model(kind: str, mu: Any, gamma: Any, pull: float) -> ContactModel:
    """Return a model; most contacts of a file have the same few."""
    match kind:
        case "PCWF":
            return PCWF(mu, pull)
        case "SFC":
            return SFC(mu, gamma, pull)
        case _:
            return FPC(pull)
