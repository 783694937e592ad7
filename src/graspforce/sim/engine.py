"""The one place where MuJoCo comes in; its bindings carry no usable types, so it is ``Any``."""

from __future__ import annotations

from typing import Any

from graspforce.errors import MissingExtraError


def _load() -> Any:
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError("simulation", "mujoco", "sim") from error
    return mujoco


mj: Any = _load()
"""The module ``mujoco``."""
