"""Grasps from JSON: parse strictly, check against the schema, build the problems.

Three layers, each with errors of its own: the text is strict JSON (Python's parser also takes NaN
and a key given twice); the document has the shape that ``grasp.schema.json`` describes; the numbers
make a :class:`ForceProblem`.
"""

from __future__ import annotations

import gc
import json
import math
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib import resources
from typing import Any, BinaryIO, cast

from jsonschema_rs import Draft202012Validator, ValidationError

from graspforce.columns import ProblemColumns
from graspforce.contact import FPC, PCWF, SFC, Contact, ContactModel
from graspforce.errors import InvalidInputError, error_context
from graspforce.files.named import GraspFile, NamedProblems, default_name
from graspforce.grasp import Grasp
from graspforce.problem import ForceProblem, ProblemOptions

# Keys of a grasp that are arguments of ForceProblem as they stand.
_OPTIONS = tuple(ProblemOptions.__annotations__)
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
    document = _parse(data)
    _check_shape(document)
    grasps: list[dict[str, Any]] = document.get("grasps", [document])
    names: list[str] = []
    problems: list[ForceProblem] = []
    for index, grasp in enumerate(grasps):
        names.append(grasp.get("name", default_name(stem, index, len(grasps))))
        with error_context(f"grasp {index} {names[-1]!r}"):
            problems.append(_problem(grasp))
    return GraspFile(NamedProblems(names, ProblemColumns.of(problems)), [])


@cache
def _schema_text() -> str:
    source = resources.files("graspforce.files").joinpath("grasp.schema.json")
    return source.read_text(encoding="utf-8")


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of an input file."""
    return json.loads(_schema_text())


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
    validator = Draft202012Validator(schema())
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
