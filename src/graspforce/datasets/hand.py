"""The hand of a data set, read once in each process that solves rows."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from graspforce.errors import InvalidInputError
from graspforce.hands.imported import ImportedHand
from graspforce.hands.mujoco.hand import from_mjcf
from graspforce.hands.mujoco.model import mujoco_module
from graspforce.hands.pinocchio.hand import from_urdf


@lru_cache(maxsize=64)
def hand_of(path: str, links: tuple[str, ...], tau_max: float | None) -> ImportedHand:
    """Return the hand in a file, with its contacts made by ``links``.

    Gravity does not pull on the links of a hand from an MJCF file: how the hand stands in the world
    is no part of a data set.

    Raises:
        InvalidInputError: no link, or one that is not there.
        ModelImportError: the file is missing or no model.
    """
    if not links or not all(links):
        raise InvalidInputError(
            "fingertips: missing; expected the link that makes each contact, beside a hand"
        )
    tips = tuple(dict.fromkeys(links))
    if Path(path).suffix.lower() == ".urdf":
        return from_urdf(path, tips, tau_max).touching(links)
    model: Any = mujoco_module().MjModel.from_xml_path(path)
    model.opt.gravity[:] = 0
    return from_mjcf(model, tips, tau_max).touching(links)
