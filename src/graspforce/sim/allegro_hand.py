"""The Allegro hand, from the URDF that the package ``example-robot-data`` installs.

The file is read from the installed package, not copied. What MuJoCo's reader rejects is changed in
memory: package paths, and second ``<inertial>`` elements. So are the file's placeholders: effort
limits of 15 N·m, and joint damping and friction in whole N·m. The motors here have ±0.7 N·m, as the
real hand's, and the joints neither damping nor friction.
"""

from __future__ import annotations

import importlib.metadata
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path
from typing import Any

from graspforce.errors import MissingExtraError, ModelImportError
from graspforce.sim import parts
from graspforce.sim.mujoco_import import mj
from graspforce.sim.trial import Finger

TORQUE = 0.7  # [N·m]
TIP_RADIUS = 0.012  # as in the file [m]

# Index, middle, ring, thumb: numbers of their first joints. Each has four.
_FIRST_JOINTS = (0, 4, 8, 12)

_FILE = "allegro_right_hand.urdf"


def allegro_hand(name: str, mu: float) -> tuple[Any, tuple[Finger, ...]]:
    """Return a model with the hand's palm at the origin, as an ``MjSpec``, and its fingers.

    The fingers point along z, their flexed tips and the thumb along x.

    Args:
        name: of the model.
        mu: coefficient of friction of the fingertips [-].

    Raises:
        MissingExtraError: example-robot-data is not installed.
        ModelImportError: it is, but without the hand.
    """
    spec = mj.MjSpec.from_string(_urdf())
    parts.apply_settings(spec, name)
    fingers: list[Finger] = []
    for first in _FIRST_JOINTS:
        names = tuple(f"joint_{number}.0" for number in range(first, first + 4))
        for joint in names:
            spec.joint(joint).damping = (0.0, 0.0, 0.0)
            spec.joint(joint).frictionloss = 0.0
            parts.motor(spec, joint, TORQUE)
        tip = f"tip_{first + 3}"
        spec.body(f"link_{first + 3}.0_tip").add_geom(
            name=tip, type=mj.mjtGeom.mjGEOM_SPHERE, size=(TIP_RADIUS, 0, 0), mass=0,
            rgba=parts.TIP, **parts.grip_surface(mu), **parts.contact_bits("robot"),
        )  # fmt: skip
        fingers.append(Finger(names, tip))
    return spec, tuple(fingers)


def _urdf() -> str:
    """Return the hand's URDF as MuJoCo takes it: no collision shapes, meshes by absolute path."""
    path = _path()
    try:
        robot = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise ModelImportError(f"{path}: not a readable URDF ({error})") from error
    for link in robot.iter("link"):
        for extra in (*link.findall("inertial")[1:], *link.findall("collision")):
            link.remove(extra)
    share = next(folder for folder in path.parents if folder.name == "share")
    for mesh in robot.iter("mesh"):
        mesh.set("filename", mesh.get("filename", "").replace("package://", f"{share}/"))
    compiler = {
        "balanceinertia": "true", "strippath": "false", "fusestatic": "false",
        "autolimits": "true", "discardvisual": "false",
    }  # fmt: skip
    ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler", compiler)
    return ElementTree.tostring(robot, encoding="unicode")


@cache  # a scene of many trials asks for each, and a list of installed files takes a while
def _path() -> Path:
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError as error:
        raise MissingExtraError("the Allegro hand", "example-robot-data", "sim") from error
    for file in files:
        if file.name == _FILE:
            return Path(str(file.locate()))
    raise ModelImportError(f"{_FILE}: not among the files of the installed example-robot-data")
