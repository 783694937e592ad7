"""NPZ files, which NumPy reads."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


def write_npz(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays to an NPZ file, as :func:`numpy.savez` does.

    Not compressed: forces hardly become smaller, and it takes longer than to solve for them. NumPy
    copies what it writes, and before 2.2 leaves an open archive behind, which complains on stderr,
    where a file cannot take it all.

    Args:
        path: of the file.
        arrays: what to write, by name; of numbers or texts.
    """
    with zipfile.ZipFile(path, "w") as archive:
        for name, values in arrays.items():
            array = np.asarray(values, order="C")
            header = np.lib.format.header_data_from_array_1_0(array)
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array_header_1_0(member, header)
                member.write(array.reshape(-1).view(np.uint8).data)
