"""Which joints of a URDF follow others: Pinocchio's models do not tell, or not of all."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from graspforce._util.arrays import Array
from graspforce.errors import ModelImportError
from graspforce.hands.pinocchio.model import dof_names, what_moves


class Mimic(NamedTuple):
    """A joint whose angle is ``multiplier`` times its leader's, plus ``offset``."""

    joint: str
    leader: str
    multiplier: float
    offset: float


def mimics_of(urdf: str | Path) -> tuple[Mimic, ...]:
    """Return the mimic joints of a URDF.

    Pinocchio's own reading of them is not used: it refuses joints that follow one which comes
    later in its order, and continuous ones.

    Args:
        urdf: a path, or the text itself.

    Raises:
        ModelImportError: the file is missing, or it is no URDF.
    """
    robot, named = _parsed(urdf)
    found: list[Mimic] = []
    for joint in robot.iter("joint"):
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        name = joint.get("name", "")
        try:
            multiplier = float(mimic.get("multiplier", "1"))
            offset = float(mimic.get("offset", "0"))
        except ValueError as error:
            raise ModelImportError(f"{named}: mimic of joint {name!r}: {error}") from error
        found.append(Mimic(name, mimic.get("joint", ""), multiplier, offset))
    return tuple(found)


def joints_of(urdf: str | Path) -> list[tuple[str, str]]:
    """Return the child and the parent of every joint of a URDF, a path or its text.

    Raises:
        ModelImportError: the file is missing, or it is no URDF.
    """
    robot, _ = _parsed(urdf)
    ends = [(joint.find("child"), joint.find("parent")) for joint in robot.iter("joint")]
    return [
        (child.get("link", ""), parent.get("link", ""))
        for child, parent in ends
        if child is not None and parent is not None
    ]


def _parsed(urdf: str | Path) -> tuple[ElementTree.Element, str]:
    """Return a URDF's root, and what to call it in errors."""
    is_text = isinstance(urdf, str) and urdf.lstrip().startswith("<")
    named = "urdf" if is_text else str(urdf)
    try:
        robot = ElementTree.fromstring(str(urdf)) if is_text else ElementTree.parse(urdf).getroot()
    except OSError as error:
        raise ModelImportError(f"{named}: cannot read the file: {error.strerror}") from error
    except ElementTree.ParseError as error:
        raise ModelImportError(f"{named}: not a URDF: {error}") from error
    if robot.tag != "robot":
        raise ModelImportError(f"{named}: got <{robot.tag}>, expected a URDF's <robot>")
    return robot, named


def mimic_couplings(
    source: str | Path, model: Any, mimics: Sequence[Mimic], links: Sequence[str]
) -> Array:
    """Return one row a mimic joint: its rate less what its leader makes it, shape (p, nv).

    Args:
        source: where the mimic joints stand, for the error's text.
        model: the ``pinocchio.Model``.
        mimics: the mimic joints.
        links: the links whose joints count.

    Raises:
        ModelImportError: a joint that moves a link mimics one that is not there.
    """
    dofs = {name: dof for dof, name in dof_names(model).items()}
    moving = what_moves(model, links, np.zeros((0, model.nv)))
    rows = np.zeros((len(mimics), model.nv))
    for row, each in zip(rows, mimics, strict=True):
        if each.joint not in dofs:
            continue
        row[dofs[each.joint]] = 1.0
        if each.leader in dofs:
            row[dofs[each.leader]] -= each.multiplier
        elif dofs[each.joint] in moving:
            raise ModelImportError(
                f"{source}: joint {each.joint!r} mimics {each.leader!r}, which is not there; "
                f"expected one of {', '.join(dofs)}"
            )
    return rows
