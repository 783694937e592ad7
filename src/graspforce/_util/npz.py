"""NPZ files, which NumPy reads."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

# Texts that are made into an array at a time: NumPy gives each the room of the longest.
_TEXTS_AT_ONCE = 4096


def write_npz(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays to an NPZ file, as :func:`numpy.savez` does.

    Not compressed: forces hardly become smaller, and it takes longer than to solve for them. NumPy
    copies what it writes, and before 2.2 leaves an open archive behind, which complains on stderr,
    where a file cannot take it all.

    Args:
        path: of the file.
        arrays: what to write, by name: of numbers or texts, or lists of texts.
    """
    with zipfile.ZipFile(path, "w") as archive:
        for name, values in arrays.items():
            dtype, shape = _kind_of(values)
            header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False}
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array_header_1_0(member, header | {"shape": shape})
                for part in _parts(values, dtype):
                    member.write(part.reshape(-1).view(np.uint8).data)


def _kind_of(values: Any) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """Return the type and the shape that values have as an array."""
    if isinstance(values, list):
        texts = cast("list[str]", values)
        return np.dtype(f"<U{max(map(len, texts), default=1) or 1}"), (len(texts),)
    array = np.asarray(values)
    return array.dtype, array.shape


def _parts(values: Any, dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    """Yield arrays of C order that hold the values, one behind the other."""
    if isinstance(values, list):
        texts = cast("list[str]", values)
        for first in range(0, len(texts), _TEXTS_AT_ONCE):
            yield np.array(texts[first : first + _TEXTS_AT_ONCE], dtype=dtype)
    else:
        yield np.asarray(values, order="C")
