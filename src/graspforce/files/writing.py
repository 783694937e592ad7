"""Write results: JSON for programs, CSV for spreadsheets, NPZ for arrays, with the same fields.

The three writers differ only in how they lay the columns down. A name may hold a lone surrogate,
from JSON or from a file name that is not UTF-8, for which UTF-8 has no bytes: JSON and CSV hold its
escape sequence, backslash, u and four digits, which JSON readers turn back.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce._util.atomic import atomic_write, check_output
from graspforce._util.npz import write_npz
from graspforce.files.named import NamedSolutions
from graspforce.solution import Solution

_NUMBERS = (
    "alpha", "newton_steps", "phi", "suboptimality", "violation", "friction_residual",
    "torque_residual", "wrench_error", "nearest",
)  # fmt: skip
# Results of JSON that are written together.
_AT_ONCE = 4096
_text = json.JSONEncoder(ensure_ascii=False).encode
_VECTORS = (
    "c", "tau", "normal_forces", "friction_margins", "torque_margins", "nu", "missing",
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
    table = _Table(NamedSolutions.of(results))
    with atomic_write(path) as temporary:
        _WRITERS[Path(path).suffix.lower()](temporary, table)


class _Table:
    """What is written of B results: texts, numbers and vectors by name, B entries each."""

    def __init__(self, results: NamedSolutions) -> None:
        self.columns = columns = results.columns
        self.size = len(columns)
        words = [status.name for status in Status]
        self.texts: dict[str, list[str]] = {
            "name": results.names,
            "status": [words[status] for status in columns.status.tolist()],
            "message": columns.messages(),
        }
        self.numbers: dict[str, NDArray[Any]] = {
            name: columns.field(name) if name == "alpha" else getattr(columns, name)
            for name in _NUMBERS
        }
        self.proofs = columns.certificates()
        self.numbers["nearest"] = self.numbers["nearest"].astype(np.int64)

    def groups(self) -> list[tuple[NDArray[np.intp], dict[str, Array]]]:
        """Return which results have vectors of the same lengths, and these, a row each."""
        return [
            (indices, {name: getattr(batch, name) for name in _VECTORS})
            for indices, batch in self.columns.groups
        ]

    def certificate(self, row: int) -> str:
        """Return a result's certificate as JSON."""
        y, z = (part[row] for part in self.proofs)
        if not len(y):
            return "null"
        return f'{{"y": [{_in_json(y[None])[0]}], "z": [{_in_json(z[None])[0]}]}}'

    def vectors(self) -> dict[str, list[Array]]:
        """Return the vectors of every result, each of its own length."""
        vectors = {name: self.columns.rows(name) for name in _VECTORS}
        y, z = self.proofs
        return vectors | {"certificate_y": y, "certificate_z": z}

    def stacks(self) -> dict[str, tuple[Array, NDArray[np.int64]]]:
        """Return the vectors as stacks, in which short ones end in NaN, and their lengths."""
        columns = self.columns
        stacks: dict[str, tuple[Array, NDArray[np.int64]]] = {
            name: (getattr(columns, name), columns.lengths(name))
            if self.size
            else (np.empty((0, 0)), np.empty(0, dtype=np.int64))
            for name in _VECTORS
        }
        for part, rows in zip("yz", self.proofs, strict=True):
            stacks[f"certificate_{part}"] = filled_up(rows)
        return stacks

    def plain_numbers(self) -> dict[str, list[float | int | None]]:
        """Return the numbers as JSON and CSV hold them: None for infinities and NaN."""
        return {
            name: [_finite(number) for number in values.tolist()]
            for name, values in self.numbers.items()
        }


def filled_up(rows: Sequence[Array]) -> tuple[Array, NDArray[np.int64]]:
    """Return vectors of any lengths as one array, where short ones end in NaN, and the lengths."""
    lengths = np.array([len(row) for row in rows], dtype=np.int64)
    stack = np.full((len(rows), lengths.max(initial=0)), np.nan)
    for index in np.flatnonzero(lengths).tolist():
        stack[index, : lengths[index]] = rows[index]
    return stack, lengths


def _finite(number: float) -> float | int | None:
    """Return the number, or None for infinities and NaN, which JSON cannot hold."""
    return number if math.isfinite(number) else None


def _write_json(path: Path, table: _Table) -> None:
    # One result a line: small, and easy to compare and to search.
    lines = [""] * table.size
    for indices, vectors in table.groups():
        entries = [f'"{name}": %s' for name in (*table.texts, *table.numbers)]
        entries += [f'"{name}": [%s]' for name in vectors]
        line = "{" + ", ".join([*entries, '"certificate": %s']) + "}"
        for first in range(0, len(indices), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            at = indices[some]
            rows = at.tolist()
            columns = [[_text(texts[row]) for row in rows] for texts in table.texts.values()]
            columns += [_in_json(values[at]) for values in table.numbers.values()]
            columns += [_in_json(values[some]) for values in vectors.values()]
            columns.append([table.certificate(row) for row in rows])
            for row, values in zip(rows, zip(*columns, strict=True), strict=True):
                lines[row] = line % values
    with path.open("w", encoding="utf-8", errors="backslashreplace") as file:
        file.write('{"results": [\n' + ",\n".join(lines) + "\n]}\n")


def _in_json(values: NDArray[Any]) -> list[str]:
    """Return numbers, shape (B,), or the inside of lists of them, (B, n): null if not finite."""
    import msgspec.json  # which is no part of NumPy's formats

    text = msgspec.json.encode(values.tolist()).decode().replace(",", ", ")
    return text[1:-1].split(", ") if values.ndim == 1 else text[2:-2].split("], [")


def _write_csv(path: Path, table: _Table) -> None:
    columns: dict[str, Sequence[Any]] = {**table.texts, **table.plain_numbers()}
    for name, rows in table.vectors().items():
        whole = [[_finite(x) for x in row.tolist()] for row in rows]
        for index in range(max(map(len, whole), default=0)):
            columns[f"{name}_{index}"] = [row[index] if index < len(row) else "" for row in whole]
    with path.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _write_npz(path: Path, table: _Table) -> None:
    arrays: dict[str, Any] = {**table.texts, **table.numbers}
    for name, (stack, lengths) in table.stacks().items():
        arrays |= {name: stack, f"{name}_length": lengths}
    write_npz(path, arrays)


_WRITERS: dict[str, Callable[[Path, _Table], None]] = {
    ".json": _write_json,
    ".npz": _write_npz,
    ".csv": _write_csv,
}
