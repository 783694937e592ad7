"""Arrow columns as NumPy arrays: rows of one shape together, whatever lists they came as.

A column's row is a number, a list of numbers or a list of lists of one length. Rows of different
shapes are told apart by :func:`groups`; a row that has no shape (null, lists of different lengths)
has a negative size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce.datasets.arrow import pa, pc
from graspforce.errors import InvalidInputError

# Sizes of rows that have none.
NULL, UNEVEN = -1, -2


@dataclass(frozen=True)
class Ragged:
    """A column of B rows of numbers.

    Attributes:
        values: all numbers, row after row.
        starts: where each row starts in ``values``, shape (B,).
        sizes: how many numbers each has, shape (B,); NULL or UNEVEN where it has no shape.
        outer: lists in each row, shape (B,); 0 where it is one list or a number.
    """

    values: NDArray[Any]
    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]
    outer: NDArray[np.int64]

    @property
    def uniform(self) -> bool:
        """Whether all rows have one shape."""
        return bool((self.sizes == self.sizes[0]).all() and (self.outer == self.outer[0]).all())

    def take(self, rows: NDArray[np.int64] | None) -> NDArray[Any]:
        """Return some rows of one shape as (rows, size); None for all, without a copy."""
        size = int(self.sizes[0 if rows is None else rows[0]])
        if rows is None:
            return self.values.reshape(-1, size)
        return self.values[self.starts[rows, None] + np.arange(size)]


def is_numeric(kind: Any) -> bool:
    """Whether an Arrow type is a number, a list of numbers or a list of lists of them."""
    kind = _without_lists(_storage(kind), 2)
    return pa.types.is_integer(kind) or pa.types.is_floating(kind)


def is_text(kind: Any) -> bool:
    """Whether an Arrow type is a text or a list of texts."""
    kind = _without_lists(kind, 1)
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _storage(kind: Any) -> Any:
    """Return what an extension's values are stored as."""
    return kind.storage_type if isinstance(kind, pa.BaseExtensionType) else kind


def _without_lists(kind: Any, most: int) -> Any:
    for _ in range(most):
        if not _is_list(kind):
            break
        kind = kind.value_type
    return kind


def _is_list(kind: Any) -> bool:
    return (
        pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    )


def ragged(column: Any) -> Ragged:
    """Return an Arrow column of numbers or lists of them.

    Args:
        column: a ``pyarrow.ChunkedArray`` whose type :func:`is_numeric`.
    """
    if isinstance(column.type, pa.BaseExtensionType):  # a tensor, as its list
        column = pa.chunked_array([chunk.storage for chunk in column.chunks], _storage(column.type))
    array = column.combine_chunks()
    if isinstance(array, pa.ChunkedArray):
        array = pa.concat_arrays(array.chunks) if array.num_chunks else pa.array([], array.type)
    count, nulls = len(array), None
    if array.null_count:
        nulls = np.asarray(array.is_null())
    outer = np.zeros(count, dtype=np.int64)
    if not _is_list(array.type):
        values = _numbers(array)
        sizes = np.ones(count, dtype=np.int64)
        starts = np.arange(count)
    else:
        lengths, inner = _lengths(array), array.flatten()
        sizes = lengths
        if _is_list(inner.type):
            outer = lengths
            sizes = _sizes_of_rows(lengths, _lengths(inner))
            flat = _lengths(inner)
            inner = inner.flatten()
            ends = np.cumsum(flat)
            row_ends = np.cumsum(lengths)
            starts = np.append(0, ends)[row_ends - lengths]
        else:
            starts = np.cumsum(sizes) - sizes
        values = _numbers(inner)
    if nulls is not None:
        sizes = np.where(nulls, NULL, sizes)
    return Ragged(values, starts, sizes, outer)


def _lengths(array: Any) -> NDArray[np.int64]:
    lengths = pc.list_value_length(array)
    if lengths.null_count:
        lengths = pc.fill_null(lengths, 0)
    return np.asarray(lengths).astype(np.int64)


def _sizes_of_rows(lengths: NDArray[np.int64], inner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many numbers each row of lists has; UNEVEN where its lists differ."""
    if len(inner) == 0 or (inner == inner[0]).all():
        return lengths * (inner[0] if len(inner) else 0)
    totals = np.diff(np.append(0, np.cumsum(inner))[np.append(0, np.cumsum(lengths))])
    uneven = inner * np.repeat(lengths, lengths) != np.repeat(totals, lengths)
    rows = np.repeat(np.arange(len(lengths)), lengths)
    totals[np.unique(rows[uneven])] = UNEVEN
    return totals


def _numbers(array: Any) -> NDArray[Any]:
    """Return Arrow numbers; NaN for null."""
    return array.to_numpy(zero_copy_only=False)


def groups(
    columns: Mapping[str, Ragged], texts: Sequence[NDArray[Any]], count: int
) -> list[NDArray[np.int64] | None]:
    """Return the rows of each combination of shapes and texts; ``[None]`` where there is one."""
    if not count:
        return []
    codes = [np.unique(text, return_inverse=True)[1] for text in texts]
    differing = [code for code in codes if code.any()]
    for column in columns.values():
        if not column.uniform:
            differing += [column.sizes, column.outer]
    if not differing:
        return [None]
    _, group = np.unique(np.column_stack(differing), axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    cuts = np.flatnonzero(np.diff(group.ravel()[order])) + 1
    return list(np.split(order, cuts))


def texts_of(column: Any, name: str) -> NDArray[Any]:
    """Return an Arrow column of texts, or of lists of them joined by commas, as objects.

    Raises:
        InvalidInputError: it is neither.
    """
    if not is_text(column.type):
        raise InvalidInputError(f"{name}: got type {column.type}, expected texts")
    texts: list[Any] = column.to_pylist()
    joined = [each if isinstance(each, str) else ",".join(map(str, each or ())) for each in texts]
    return np.array(joined, dtype=object)


def as_lists(rows: NDArray[Any]) -> Any:
    """Return an array of shape (B, size) as an Arrow array of lists."""
    rows = np.ascontiguousarray(rows)
    starts = np.arange(len(rows) + 1, dtype=np.int32) * np.int32(rows.shape[1])
    return pa.ListArray.from_arrays(pa.array(starts), pa.array(rows.ravel()))
