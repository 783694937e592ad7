"""The one place where MuJoCo comes in; its bindings carry no usable types, so it is ``Any``."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from graspforce.errors import ModelImportError, RenderError
from graspforce.hands.mujoco.model import mujoco_module


def no_opengl(setting: str, cause: object) -> RenderError:
    """Return what is said where MuJoCo finds no OpenGL.

    Args:
        setting: of the environment variable MUJOCO_GL.
        cause: the error that came of it.
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
    raise no_opengl(os.environ.get("MUJOCO_GL", ""), error.__cause__) from error


def _say_nothing(warning: str) -> None:
    """Serve as MuJoCo's handler of warnings."""


@contextmanager
def quiet() -> Generator[None]:
    """Keep MuJoCo's warnings off stderr and out of the file MUJOCO_LOG.TXT.

    They are counted in the simulation's data, where :meth:`Scene.trouble` reads them.
    """
    before = mj.get_mju_user_warning()
    mj.set_mju_user_warning(_say_nothing)
    try:
        yield
    finally:
        mj.set_mju_user_warning(before)
