"""Read a file of grasps, whatever its format."""

from __future__ import annotations

from pathlib import Path

from graspforce.errors import InvalidInputError, error_context
from graspforce.files.json_grasps import read_json
from graspforce.files.named import GraspFile, NamedProblem
from graspforce.files.npz_grasps import read_npz

_READERS = {".json": read_json, ".npz": read_npz}


def read(path: str | Path) -> list[NamedProblem]:
    """Return the grasps of a file as validated problems, in the file's order.

    Args:
        path: a file that ends in .json (one grasp or several, any contacts) or .npz (stacked
            arrays, point contacts with friction).

    Returns:
        At least one ``(name, problem)``. A grasp without a name has its file's, followed by
        ``[index]`` when there are several.

    Raises:
        InvalidInputError: the file cannot be read, or something in it is wrong; the text names
            the file, the place, what came and what was expected.
    """
    return list(load(path).grasps)


def load(path: str | Path) -> GraspFile:
    """Return the grasps of a file, as :func:`read` does, and its keys that were left alone.

    Raises:
        InvalidInputError: as :func:`read`.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InvalidInputError(
            f"{path}: got a file name ending in {path.suffix!r}, expected one in .json or .npz"
        )
    try:
        with path.open("rb") as file, error_context(str(path)):
            return reader(file, path.stem)
    except OSError as error:
        raise InvalidInputError(
            f"{path}: cannot read the file: {error.strerror or error}"
        ) from error
