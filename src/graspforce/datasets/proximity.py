"""Contacts where a data set stores none: the links of a hand that are near an object's mesh.

MuJoCo measures the distances. It takes each mesh for its convex hull, so an object's mesh is read
as the pieces that hang together, as convex decompositions are saved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.datasets.geometry import rotations
from graspforce.datasets.hand import IN_USE
from graspforce.errors import InvalidInputError, MissingExtraError, ModelImportError
from graspforce.hands.mujoco.model import mujoco_module


class Touch(NamedTuple):
    """A link that touches the object.

    Attributes:
        link: its body's name.
        point: on the object, shape (3,) [m].
        normal: into the object, shape (3,).
        distance: between link and object, negative inside [m].
    """

    link: str
    point: Array
    normal: Array
    distance: float


def read_mesh(path: str) -> list[Array]:
    """Return the vertices of the pieces of a mesh that hang together, each (V, 3).

    Raises:
        MissingExtraError: trimesh is not installed.
        InvalidInputError: the file cannot be read.
    """
    try:
        import trimesh  # pyright: ignore[reportMissingTypeStubs]
    except ModuleNotFoundError as error:
        raise MissingExtraError("finding contacts on meshes", "trimesh", "data") from error
    module: Any = trimesh
    try:
        mesh = module.load_mesh(path, process=True)
        vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    except Exception as error:  # of whatever format
        raise InvalidInputError(f"{path}: cannot read the mesh: {error}") from error
    if not len(faces):
        raise InvalidInputError(f"{path}: the mesh has no faces")
    labels = _connected(len(vertices), faces)
    return [vertices[labels == label] for label in np.unique(labels[faces])]


def _connected(count: int, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each vertex the lowest vertex that it hangs together with by faces."""
    labels = np.arange(count)
    while True:
        lower = labels.copy()
        np.minimum.at(lower, faces.ravel(), np.repeat(labels[faces].min(axis=1), 3))
        lower = lower[lower]
        if (lower == labels).all():
            return labels
        labels = lower


class Scene:
    """A hand and an object.

    Args:
        hand: an MJCF file.
        pieces: vertices of the object's convex pieces.

    Raises:
        ModelImportError: the file is none that MuJoCo reads, or a mesh of the hand is missing.
    """

    def __init__(self, hand: str, pieces: Sequence[Array]) -> None:
        self._mujoco = mj = mujoco_module()
        try:
            spec = mj.MjSpec.from_file(hand)
            held = spec.worldbody.add_body(name="graspforce object", mocap=True)
            for i, piece in enumerate(pieces):
                name = f"graspforce piece {i}"
                spec.add_mesh(name=name, uservert=np.ravel(piece).tolist())
                held.add_geom(type=mj.mjtGeom.mjGEOM_MESH, meshname=name)
            self._model = spec.compile()
        except ValueError as error:
            raise ModelImportError(f"{hand}: contacts cannot be found with it: {error}") from error
        self._data = mj.MjData(self._model)
        body = self._model.body("graspforce object").id
        self._object = np.flatnonzero(self._model.geom_bodyid == body).tolist()
        # The hand's collision geometry; a hand of pictures alone counts with these.
        of_hand = (self._model.geom_bodyid != body) & (self._model.geom_bodyid != 0)
        solid = (self._model.geom_contype | self._model.geom_conaffinity) != 0
        chosen = of_hand & solid if (of_hand & solid).any() else of_hand
        self._links = np.flatnonzero(chosen).tolist()

    def contacts(self, angles: Mapping[str, float], pose: Array, most: float) -> list[Touch]:
        """Return for each link that is near enough where it is nearest, in the object's axes.

        Args:
            angles: of the hand's joints, by name [rad].
            pose: of the hand in the object's axes, shape (7,): x, y, z, wxyz.
            most: how far a link may be from the object [m].
        """
        mj, model, data = self._mujoco, self._model, self._data
        turn = rotations(pose[3:])
        with IN_USE:
            data.qpos[:] = model.qpos0
            for name, angle in angles.items():
                data.joint(name).qpos = angle
            data.mocap_pos[0] = -turn.T @ pose[:3]
            data.mocap_quat[0] = pose[3:] * (1, -1, -1, -1)
            mj.mj_kinematics(model, data)
            nearest: dict[int, tuple[float, Array]] = {}
            ends = np.zeros(6)
            for geom in self._links:
                body = int(model.geom_bodyid[geom])
                for piece in self._object:
                    distance = mj.mj_geomDistance(model, data, geom, piece, most, ends)
                    if distance < min(most, nearest.get(body, (most,))[0]):
                        nearest[body] = float(distance), ends.copy()
        touches: list[Touch] = []
        for body, (distance, ends) in sorted(nearest.items()):
            along = _direction(ends, distance)
            if along is not None:
                point = turn @ ends[3:] + pose[:3]
                touches.append(Touch(str(model.body(body).name), point, turn @ along, distance))
        return touches


def _direction(ends: Array, distance: float) -> Array | None:
    """Return the unit vector from hand to object; the ends change places inside."""
    along = (ends[3:] - ends[:3]) * (1 if distance >= 0 else -1)
    length = float(np.linalg.norm(along))
    return along / length if length > 1e-9 else None
