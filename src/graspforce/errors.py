"""The exceptions of graspforce.

An exception says that the caller is wrong or that something is missing: which argument, what
came, what was expected. What the mathematics finds (a grasp that cannot carry the load, say)
is never an exception but a :class:`graspforce.Status` on the solution; for callers who ask for one
with ``check=True`` or ``Solution.raise_if_failed()`` there is :class:`graspforce.SolveError`. What
is legitimate but looks like a slip is a :class:`GraspForceWarning`.
"""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Generator
from contextlib import contextmanager


class GraspForceError(Exception):
    """Base of every exception that graspforce raises on purpose."""


class GraspForceWarning(UserWarning):
    """Something is legitimate but looks like a slip; the text says why. It changes no answer."""


def warn(*texts: str) -> None:
    """Warn of each text from the line of the user's code that called graspforce."""
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] == __package__:
        level, frame = level + 1, frame.f_back
    for text in texts:
        warnings.warn(text, GraspForceWarning, stacklevel=level)


class InvalidInputError(GraspForceError, ValueError):
    """An argument is wrong; the text names it, what came and what was expected."""


@contextmanager
def error_context(where: str) -> Generator[None]:
    """Put ``where`` in front of the text of an InvalidInputError raised inside."""
    try:
        yield
    except InvalidInputError as error:
        raise InvalidInputError(f"{where}: {error}") from error


class ModelImportError(GraspForceError):
    """A robot or scene file could not be read or understood."""


class MissingExtraError(GraspForceError, ImportError):
    """An optional package is not installed; the text gives the pip line.

    The line names the packages of the extra and not ``graspforce[extra]``, which pip finds only
    where graspforce is on an index.

    Args:
        purpose: what needs it.
        package: its name.
        extra: the extra of graspforce that brings it; None where no extra does.
    """

    def __init__(self, purpose: str, package: str, extra: str | None) -> None:
        wanted = _packages(extra) if extra else []
        line = " ".join(wanted or [package])
        super().__init__(f"{purpose} needs {package}, which is not installed: pip install {line}")
        self._given = (purpose, package, extra)

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str, str | None]]:
        """Pickle by what it was made from."""
        return (type(self), self._given)


class RenderError(GraspForceError):
    """Nothing can be drawn here; the text says what to install or to set."""


def _packages(extra: str) -> list[str]:
    """Return what pip has to install for an extra of graspforce, as written on its command line.

    Only what is missing is listed; all of it where everything seems to be there.
    """
    from importlib import metadata

    def installed(requirement: str) -> bool:
        try:
            return bool(metadata.version(re.split(r"[^\w.-]", requirement)[0]))
        except metadata.PackageNotFoundError:
            return False

    try:
        lines = metadata.requires("graspforce") or []
    except metadata.PackageNotFoundError:  # run from its source, not installed
        lines = []
    wanted, extras = list[str](), [extra]
    for each in extras:  # which grows by the extras that an extra consists of
        for line in lines:
            requirement, _, marker = line.replace(" ", "").partition(";")
            if not re.search(rf"extra==['\"]{each}['\"]", marker):
                continue
            if own := re.fullmatch(r"graspforce\[(.*)\]", requirement):
                extras += [name for name in own[1].split(",") if name not in extras]
            else:
                wanted.append(f"'{requirement}'")
    return [each for each in wanted if not installed(each.strip("'"))] or wanted
