"""The import of MuJoCo in ``sim``, as ``Any``: its bindings have no usable types."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from graspforce.errors import ModelImportError, RenderError
from graspforce.hands.mujoco.model import mujoco_module


def no_opengl_error(setting: str, cause: object) -> RenderError:
    """Return the error for a MuJoCo that finds no OpenGL.

    Args:
        setting: of the environment variable MUJOCO_GL.
        cause: the error that it raised.
    """
    return RenderError(
        f"rendering: MUJOCO_GL={setting or '(not set)'} gives no OpenGL context ({cause}); "
        "without a screen set MUJOCO_GL=egl and install libegl1 and libgl1-mesa-dri, or set "
        "MUJOCO_GL=osmesa and install libosmesa6 (Debian's names); simulation without pictures "
        "needs none: MUJOCO_GL=disable"
    )


try:
    mj: Any = mujoco_module("simulation", "sim")
    """The module ``mujoco``."""
except ModelImportError as error:
    raise no_opengl_error(os.environ.get("MUJOCO_GL", ""), error.__cause__) from error


def _ignore_warning(warning: str) -> None:
    """Serve as MuJoCo's handler of warnings."""


@contextmanager
def silenced_warnings() -> Generator[None]:
    """Keep MuJoCo's warnings off stderr and out of the file MUJOCO_LOG.TXT.

    They are counted in the simulation's data, where :meth:`World.failure` reads them.
    """
    before = mj.get_mju_user_warning()
    mj.set_mju_user_warning(_ignore_warning)
    try:
        yield
    finally:
        mj.set_mju_user_warning(before)
