"""The hand of a data set, read once in each process that solves rows."""

from __future__ import annotations

import threading
from functools import lru_cache
from pathlib import Path
from typing import Any

from graspforce.errors import InvalidInputError
from graspforce.hands.imported import ImportedHand
from graspforce.hands.mujoco import hand as mjcf
from graspforce.hands.mujoco.hand import from_mjcf
from graspforce.hands.pinocchio import hand as urdf
from graspforce.hands.pinocchio.hand import from_urdf

# Held by the thread that computes with a hand, whose model is in one state at a time.
IN_USE = threading.Lock()


@lru_cache(maxsize=256)
def hand_of(path: str, links: tuple[str, ...] | None, tau_max: float | None) -> ImportedHand:
    """Return the hand in a file, with its contacts made by ``links``.

    All joints that motors move are its own, whatever touches. The links have no weight: how the
    hand stands in the world is no part of a data set.

    Args:
        path: an MJCF or URDF file.
        links: a link for each contact; None for a hand without contacts.
        tau_max: torque limit of all motors in place of the file's [N·m].

    Raises:
        InvalidInputError: no link, or one that is not there.
        ModelImportError: the file is missing or no model.
    """
    if links is not None:
        if not all(links):
            raise InvalidInputError(
                "fingertips: missing; expected the link that makes each contact, beside a hand"
            )
        return hand_of(path, None, tau_max).touching(links)
    if Path(path).suffix.lower() == ".urdf":
        hand = from_urdf(path, urdf.default_fingertips(path), tau_max)
        robot: Any = hand.robot
        robot.model.gravity.setZero()
    else:
        hand = from_mjcf(path, mjcf.default_fingertips(path, tau_max), tau_max)
        robot = hand.robot
        robot.model.opt.gravity[:] = 0
    return hand
