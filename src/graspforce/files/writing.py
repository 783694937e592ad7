"""Write results: JSON for programs, CSV for spreadsheets, NPZ for arrays, with the same fields.

Each result is made a flat record first (texts, numbers and vectors by name); the three writers
differ only in how they lay a list of records down. A name may hold a lone surrogate, from JSON or
from a file name that is not UTF-8, for which UTF-8 has no bytes: JSON and CSV hold its escape
sequence, backslash, u and four digits, which JSON readers turn back.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from graspforce._arrays import Array
from graspforce._util.atomic import check_writable, replacing
from graspforce.errors import InvalidInputError
from graspforce.solution import Solution

_TEXTS = ("name", "status", "message")
_NUMBERS = (
    "alpha", "newton_steps", "phi", "suboptimality", "violation", "friction_residual",
    "torque_residual", "wrench_error",
)  # fmt: skip
_VECTORS = (
    "c", "tau", "normal_forces", "friction_margins", "torque_margins", "nu", "certificate_y",
    "certificate_z",
)  # fmt: skip


def write(path: str | Path, results: Sequence[tuple[str, Solution]]) -> None:
    """Write solutions with everything about them; an existing file is replaced as a whole.

    Args:
        path: a file that ends in .json, .npz or .csv.
        results: ``(name, solution)`` pairs, in the order in which they shall stand.

    Raises:
        InvalidInputError: another ending, or a place that :func:`check_output` refuses.
        OSError: the file cannot be written; what it held before is still there.
    """
    check_output(path)
    records = [_record(name, solution) for name, solution in results]
    with replacing(path) as temporary:
        _WRITERS[Path(path).suffix.lower()](temporary, records)


def check_output(path: str | Path, endings: Sequence[str] = (".json", ".npz", ".csv")) -> None:
    """Confirm, before any long work, that ``path`` is a place for results.

    Args:
        path: where results shall go.
        endings: of the file's name, those that will do.

    Raises:
        InvalidInputError: another ending; a directory, a socket or a block device; a file or
            folder that must not be written to, or a folder that is not there.
    """
    path = Path(path)
    if path.suffix.lower() not in endings:
        raise InvalidInputError(
            f"{path}: got a file name ending in {path.suffix!r}, expected one in "
            f"{' or '.join(endings)}"
        )
    check_writable(path)


def _record(name: str, solution: Solution) -> dict[str, Any]:
    certificate = solution.certificate
    y, z = (np.empty(0), np.empty(0)) if certificate is None else (certificate.y, certificate.z)
    record: dict[str, Any] = {
        "name": name,
        "status": solution.status.name,
        "message": solution.message,
        "alpha": solution.problem.alpha,
        "certificate_y": y,
        "certificate_z": z,
    }
    for field in (*_NUMBERS, *_VECTORS):
        if field not in record:
            record[field] = getattr(solution, field)
    return record


def _finite(number: float) -> float | int | None:
    """Return the number, or None for the infinities and NaN that JSON has no word for."""
    return number if math.isfinite(number) else None


def _write_json(path: Path, records: list[dict[str, Any]]) -> None:
    lines: list[str] = []  # one result a line: small, and easy to compare and to search
    for record in records:
        document = {field: record[field] for field in _TEXTS}
        document |= {field: _finite(record[field]) for field in _NUMBERS}
        vectors = {field: [_finite(x) for x in record[field].tolist()] for field in _VECTORS}
        y, z = vectors.pop("certificate_y"), vectors.pop("certificate_z")
        document |= vectors
        document["certificate"] = {"y": y, "z": z} if y else None
        lines.append(json.dumps(document, ensure_ascii=False, allow_nan=False))
    text = '{"results": [\n' + ",\n".join(lines) + "\n]}\n"
    path.write_text(text, encoding="utf-8", errors="backslashreplace")


def _write_csv(path: Path, records: list[dict[str, Any]]) -> None:
    sizes = {field: max((len(r[field]) for r in records), default=0) for field in _VECTORS}
    header = [*_TEXTS, *_NUMBERS]
    header += [f"{field}_{index}" for field in _VECTORS for index in range(sizes[field])]
    with path.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
        rows = csv.DictWriter(file, header, restval="")
        rows.writeheader()
        for record in records:
            row: dict[str, Any] = {field: record[field] for field in _TEXTS}
            row |= {field: _finite(record[field]) for field in _NUMBERS}
            for field in _VECTORS:
                values = record[field].tolist()
                row |= {f"{field}_{index}": _finite(x) for index, x in enumerate(values)}
            rows.writerow(row)


def _write_npz(path: Path, records: list[dict[str, Any]]) -> None:
    arrays: dict[str, Any] = {
        field: np.array([record[field] for record in records], dtype=np.str_) for field in _TEXTS
    }
    arrays |= {field: np.array([record[field] for record in records]) for field in _NUMBERS}
    for field in _VECTORS:
        vectors: list[Array] = [record[field] for record in records]
        lengths = np.array([len(vector) for vector in vectors], dtype=np.int64)
        stack = np.full((len(vectors), lengths.max(initial=0)), np.nan)
        for row, vector in zip(stack, vectors, strict=True):
            row[: len(vector)] = vector
        arrays |= {field: stack, f"{field}_length": lengths}
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


_WRITERS: dict[str, Callable[[Path, list[dict[str, Any]]], None]] = {
    ".json": _write_json,
    ".npz": _write_npz,
    ".csv": _write_csv,
}
