"""The one place where MuJoCo comes in; its bindings carry no usable types, so it is ``Any``."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from graspforce.hands.mujoco.model import mujoco_module

mj: Any = mujoco_module("simulation", "sim")
"""The module ``mujoco``."""


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
