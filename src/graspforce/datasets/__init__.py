"""Data sets of grasps: files of millions of rows in, Parquet out (extra ``data``).

:func:`solve_dataset` reads Parquet, NPZ, HDF5 or JSON Lines part by part, solves each part as
:func:`graspforce.solve_batch` does, and writes each as one Parquet file, on the cores of this
machine or on a Ray cluster. What it writes does not depend on the number of threads, the engine, or
on how often it was killed and begun again. ``docs/datasets.md`` describes every column.
"""

from __future__ import annotations

from graspforce.errors import MissingExtraError

try:
    import pyarrow  # noqa: F401  # pyright: ignore
except ModuleNotFoundError as error:
    raise MissingExtraError("graspforce.datasets", "pyarrow", "data") from error

from graspforce.datasets.run import solve_dataset
from graspforce.datasets.target import Counts, Summary, UnfinishedError

__all__ = ["Counts", "Summary", "UnfinishedError", "solve_dataset"]
