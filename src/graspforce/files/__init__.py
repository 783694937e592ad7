"""Files: grasps in, results out.

:func:`read` turns a JSON or NPZ file into named force problems, :func:`write` puts their
solutions into a JSON, NPZ or CSV file. ``docs/file_formats.md`` describes every key; the JSON
Schema of the input is part of the package (:func:`schema`).

>>> from graspforce import files, solve
>>> grasps = files.read("examples/nose_cone.json")
>>> results = [files.NamedSolution(name, solve(problem)) for name, problem in grasps]
>>> files.write("nose_cone.csv", results)

A file with anything wrong in it is refused as a whole, by an InvalidInputError that names the
file, the place in it, what came and what was expected. Nothing is ever unpickled.
"""

from __future__ import annotations

import warnings
from typing import Any

from graspforce._util.atomic import atomic_write, check_output
from graspforce.files.json_grasps import schema
from graspforce.files.named import (
    GraspFile,
    NamedProblem,
    NamedProblems,
    NamedSolution,
    NamedSolutions,
)
from graspforce.files.npz_grasps import unused_keys
from graspforce.files.reading import load, read
from graspforce.files.writing import write

__all__ = [
    "GraspFile",
    "NamedProblem",
    "NamedProblems",
    "NamedSolution",
    "NamedSolutions",
    "atomic_write",
    "check_output",
    "load",
    "read",
    "schema",
    "unused_keys",
    "write",
]


def __getattr__(name: str) -> Any:
    if name == "replacing":
        warnings.warn(
            "graspforce.files.replacing is now graspforce.files.atomic_write",
            DeprecationWarning,
            stacklevel=2,
        )
        return atomic_write
    raise AttributeError(f"module 'graspforce.files' has no attribute {name!r}")
