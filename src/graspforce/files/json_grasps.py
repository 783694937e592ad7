"""Grasps from JSON: parse strictly, check against the schema, build the problems.

Three layers, each with errors of its own: the text is strict JSON (Python's parser also takes NaN
and a key given twice); the document has the shape that ``grasp.schema.json`` describes; the numbers
make a :class:`ForceProblem`.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from functools import cache
from importlib import resources
from typing import Any, BinaryIO

from jsonschema import Draft202012Validator, ValidationError

from graspforce.contact import FPC, PCWF, SFC, Contact, ContactModel
from graspforce.errors import InvalidInputError, error_context
from graspforce.files.named import GraspFile, NamedProblem, default_name
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
    document = _parse(file.read())
    _check_shape(document)
    grasps: list[dict[str, Any]] = document.get("grasps", [document])
    problems: list[NamedProblem] = []
    for index, grasp in enumerate(grasps):
        name = grasp.get("name", default_name(stem, index, len(grasps)))
        with error_context(f"grasp {index} {name!r}"):
            problems.append(NamedProblem(name, _problem(grasp)))
    return GraspFile(problems, [])


@cache
def _schema_text() -> str:
    source = resources.files("graspforce.files").joinpath("grasp.schema.json")
    return source.read_text(encoding="utf-8")


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of an input file."""
    return json.loads(_schema_text())


# ---- the text ---------------------------------------------------------------------------------


class _Object(dict[str, Any]):
    """A JSON object that remembers a key given twice, where a dict keeps the last value."""

    def __init__(self, pairs: list[tuple[str, Any]]) -> None:
        super().__init__(pairs)
        self.repeated: str | None = None
        if len(self) < len(pairs):
            counts = Counter(key for key, _ in pairs)
            self.repeated = next(key for key, count in counts.items() if count > 1)


def _parse(data: bytes) -> Any:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInputError(
            f"byte {error.start}: got {data[error.start]:#04x}, expected UTF-8 text"
        ) from None
    if not text.strip():
        raise InvalidInputError("the file is empty, expected a JSON object")
    try:
        # All numbers become floats: every one is a quantity, and float() has no size limit.
        document = json.loads(text, object_pairs_hook=_Object, parse_int=float)
        _check_values(document, "$")
    except json.JSONDecodeError as error:
        raise InvalidInputError(
            f"line {error.lineno}, column {error.colno}: not JSON: {error.msg}"
        ) from None
    except RecursionError:
        raise InvalidInputError("nested too deeply for a file of grasps") from None
    return document


def _check_values(value: Any, path: str) -> None:
    """Refuse what json.loads lets pass: NaN, infinite and overflowing numbers, repeated keys."""
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidInputError(f"{path}: got {value}, expected a finite number")
    if isinstance(value, _Object):
        if value.repeated is not None:
            raise InvalidInputError(f"{path}: the key {_show(value.repeated)} is given twice")
        for key, item in value.items():
            _check_values(item, f"{path}.{key}")
    elif isinstance(value, list):
        for index, item in enumerate(value):  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]
            _check_values(item, f"{path}[{index}]")


# ---- the document -----------------------------------------------------------------------------


def _check_shape(document: Any) -> None:
    validator: Any = Draft202012Validator(schema())
    errors: list[ValidationError] = list(validator.iter_errors(document))
    if errors:
        # A mistyped key also leaves the intended key missing: report the mistyped one.
        unknown = (error for error in errors if error.validator == "additionalProperties")
        error = next(unknown, errors[0])
        raise InvalidInputError(f"{error.json_path}: {_explain(error)}")


def _explain(error: ValidationError) -> str:
    """Say what came and what was expected, for each keyword that the schema uses."""
    value: Any = error.instance
    rule: Any = error.validator_value
    here: dict[str, Any] = error.schema  # pyright: ignore[reportAssignmentType]
    got = f"got {_show(value)}, expected"
    match error.validator:
        case "additionalProperties":
            valid = list(here["properties"])
            unknown = next(key for key in value if key not in valid)
            several = [] if error.absolute_path or "grasps" in valid else ["grasps"]
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
    pull = entry.get("pull", 0.0)
    match entry["model"]:
        case "PCWF":
            return PCWF(entry["mu"], pull)
        case "SFC":
            return SFC(entry["mu"], entry["gamma"], pull)
        case _:
            return FPC(pull)
