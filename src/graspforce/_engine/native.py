"""The one place that imports the compiled core, and the choice among its builds."""

from __future__ import annotations

import importlib
import os
from typing import Any

from graspforce import _core
from graspforce.errors import InvalidInputError

# The same core stands in further modules, built for wider and for more registers.
_sets = ("baseline", *_core.instruction_sets())
modules: tuple[str, ...] = (
    "graspforce._core",
    *(f"graspforce._core_{name}" for name in _sets[1:]),
)
"""Every compiled core that this processor runs, the best last."""


def _choose_core() -> str:
    """Return the module of the best core, or of the one that GRASPFORCE_CORE names.

    Raises:
        InvalidInputError: GRASPFORCE_CORE names no core, or one that this processor cannot run.
    """
    wanted = os.environ.get("GRASPFORCE_CORE") or _sets[-1]
    if wanted not in _sets:
        raise InvalidInputError(
            f"GRASPFORCE_CORE (environment variable): got {wanted!r}, expected one of the cores "
            f"that this processor runs: {', '.join(_sets)}"
        )
    return modules[_sets.index(wanted)]


SolutionBase = _core.SolutionBase
"""What the core, whichever build, makes its solutions of."""

module: Any = importlib.import_module(_choose_core())
"""The compiled core in use."""

# A number that keeps others from making a problem: the field, the indices of the entry, what came,
# what was expected.
Flaw = tuple[str, tuple[int, ...], float, str]


def describe(flaw: Flaw) -> str:
    """Return a flaw in words."""
    name, indices, got, expected = flaw
    place = f"[{', '.join(map(str, indices))}]" if indices else ""
    return f"{name}{place}: got {got:g}, expected {expected}"


def refuse(flaw: Flaw) -> None:
    """Raise the error that a flaw found by the core calls for.

    Raises:
        InvalidInputError: always.
    """
    raise InvalidInputError(describe(flaw))
