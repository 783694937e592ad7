"""Published data sets of grasps, as their projects save them: poses in, geometry rows out.

Both are NumPy files with pickled dictionaries. Nothing but arrays and plain containers is
unpickled: no other class is looked up.

``dexgraspnet`` (Wang et al., ICRA 2023): a file an object, named by its code, with a list of
``{"qpos": {joint: angle, "WRJTx": …, "WRJRx": …}, "scale": …}``. The wrist's position and its Euler
angles (about fixed x, y, z) place the hand in the object's axes, in which the object's mesh is
``scale`` times its file. Contacts are not stored: they are found between the links of the hand and
the mesh.

``bodex`` (Chen et al., ICRA 2025): a file an object in a scene, with a dictionary of arrays over
its grasps: ``robot_pose`` (1, B, 3, 7 + joints): pre-grasp, grasp and squeeze, ``joint_names``,
``contact_point`` (1, B, n, 3) and ``contact_frame`` (1, B, n, 3, 3), whose first column is the
normal into the object; all in the axes of the world.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.datasets.arrow import pa
from graspforce.datasets.hand import hand_of
from graspforce.datasets.proximity import Scene, read_mesh
from graspforce.datasets.sources import Chunk, Hints, npy_header
from graspforce.errors import InvalidInputError

_NUMBERS = pa.list_(pa.float64())
_POINTS = pa.list_(_NUMBERS)
# What the grasps of a file come to; ``contacts_from`` says how the contacts are known.
_COLUMNS: dict[str, Any] = {
    "points": _POINTS,
    "normals": _POINTS,
    "q": _NUMBERS,
    "hand_pose": _NUMBERS,
    "fingertips": pa.list_(pa.string()),
    "object_code": pa.string(),
    "scale": pa.float64(),
    "contacts_from": pa.string(),
    "contact_distances": _NUMBERS,
}

# Columns that a target has of each row, so that its forces can be placed.
WHERE = ("points", "normals", "fingertips")


class _Rows:
    """Grasps of a file, each made into a geometry row when it is read."""

    def __init__(self, count: int, names: Sequence[str]) -> None:
        self.rows = count
        self.schema: Any = pa.schema([pa.field(name, _COLUMNS[name]) for name in names])

    def row(self, index: int) -> dict[str, Any]:
        """Return a row's columns.

        Raises:
            InvalidInputError: it makes none.
        """
        raise NotImplementedError

    def read(self, start: int, stop: int, columns: Sequence[str]) -> Chunk:
        """See :class:`graspforce.datasets.sources.Reader`."""
        rows: list[int] = []
        found: list[dict[str, Any]] = []
        rejects: list[tuple[int, str]] = []
        for index in range(start, stop):
            try:
                found.append(self.row(index))
            except InvalidInputError as error:
                rejects.append((index, str(error)))
            else:
                rows.append(index)
        arrays = {
            name: pa.array([each[name] for each in found], self.schema.field(name).type)
            for name in columns
        }
        return Chunk(pa.table(arrays), np.array(rows, dtype=np.int64), rejects)

    def close(self) -> None:
        """See :class:`graspforce.datasets.sources.Reader`."""


class DexGraspNetRows(_Rows):
    """A file of DexGraspNet; see the module."""

    def __init__(self, path: Path, hints: Hints) -> None:
        for name, value in (("hand", hints.hand), ("meshes", hints.meshes)):
            if value is None:
                raise InvalidInputError(f"{name}: missing; contacts are not stored in this layout")
        self._hints, self._code = hints, path.stem
        self._grasps = [_dictionary(each) for each in np.ravel(_unpickled(path)).tolist()]
        names = (
            "points", "normals", "q", "hand_pose", "fingertips", "object_code", "scale",
            "contacts_from", "contact_distances",
        )  # fmt: skip
        super().__init__(len(self._grasps), names)

    def row(self, index: int) -> dict[str, Any]:
        """See the base class."""
        grasp, hints = self._grasps[index], self._hints
        angles = _dictionary(grasp.get("qpos"))
        scale = float(_number(grasp, "scale"))
        place = np.array([_number(angles, f"WRJT{axis}") for axis in "xyz"])
        pose = np.concatenate((place, _quaternion(*(_number(angles, f"WRJR{a}") for a in "xyz"))))
        names = hand_of(hints.hand or "", None, hints.tau_max).q_names
        q = _ordered(names, angles)
        scene = _scene(hints.hand or "", _mesh_path(hints.meshes or "", self._code), scale)
        found = scene.contacts(dict(zip(names, q, strict=True)), pose, hints.contact_distance)
        if not found:
            raise InvalidInputError(
                f"no link of the hand is within {1000 * hints.contact_distance:g} mm of the object"
            )
        return {
            "points": [each.point for each in found],
            "normals": [each.normal for each in found],
            "q": q, "hand_pose": pose, "fingertips": [each.link for each in found],
            "object_code": self._code, "scale": scale,
            "contacts_from": f"hand model and object mesh, within {hints.contact_distance:g} m",
            "contact_distances": [each.distance for each in found],
        }  # fmt: skip


class BodexRows(_Rows):
    """A file of BODex; see the module."""

    def __init__(self, path: Path, hints: Hints) -> None:
        content = _dictionary(_unpickled(path).item())
        for name in ("robot_pose", "contact_point", "contact_frame"):
            if name not in content:
                raise InvalidInputError(f"{name}: missing; it has {', '.join(content)}")
        self._hints = hints
        self._poses = np.asarray(content["robot_pose"], dtype=float)
        self._points = np.asarray(content["contact_point"], dtype=float)
        self._frames = np.asarray(content["contact_frame"], dtype=float)
        for name, array, axes in (
            ("robot_pose", self._poses, 4), ("contact_point", self._points, 4),
            ("contact_frame", self._frames, 5),
        ):  # fmt: skip
            if array.ndim != axes or len(array) != 1:
                raise InvalidInputError(
                    f"{name}: got shape {array.shape}, expected {axes} axes, the first of length 1"
                )
        self._names = [str(name) for name in content.get("joint_names", ())]
        names: list[Any] = np.ravel(content.get("manip_name", path.stem)).tolist()
        self._code = str(names[0])
        self._origin, self._scale = _placed(content.get("world_cfg"), self._code)
        columns = ["points", "normals", "object_code", "scale", "contacts_from"]
        columns += ["q", "hand_pose"] if hints.hand else []
        super().__init__(self._points.shape[1], columns)
        self.schema = self.schema.append(pa.field("origin", _NUMBERS))

    def row(self, index: int) -> dict[str, Any]:
        """See the base class."""
        pose, frames = self._poses[0, index, 1], self._frames[0, index]
        row: dict[str, Any] = {
            "points": list(self._points[0, index]), "normals": list(frames[:, :, 0]),
            "origin": self._origin, "object_code": self._code, "scale": self._scale,
            "contacts_from": "stored",
        }  # fmt: skip
        if self._hints.hand is not None:
            names = hand_of(self._hints.hand, None, self._hints.tau_max).q_names
            angles = dict(zip(self._names, pose[7:].tolist(), strict=False))
            row |= {"q": _ordered(names, angles), "hand_pose": pose[:7]}
        return row


LAYOUTS: dict[str, Callable[[Path, Hints], Any]] = {
    "bodex": BodexRows,
    "dexgraspnet": DexGraspNetRows,
}


# ---- what is in the files ----------------------------------------------------------------------


class _ArraysOnly(pickle.Unpickler):
    """Unpickles arrays, numbers, texts and containers; looks up nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """Return what a pickle names, where it is needed for arrays."""
        parts = module.split(".")
        of_numpy = parts[0] == "numpy" and name in (
            "_reconstruct", "ndarray", "dtype", "scalar", "_frombuffer",
        )  # fmt: skip
        if of_numpy or (module, name) == ("_codecs", "encode"):
            return super().find_class(module, name)
        raise InvalidInputError(f"it asks for {module}.{name}; only arrays are unpickled")


def _unpickled(path: Path) -> NDArray[Any]:
    with path.open("rb") as file:
        shape, _, kind = npy_header(cast("BinaryIO", file))
        if not kind.hasobject:
            raise InvalidInputError(f"got an array of type {kind}, expected pickled dictionaries")
        try:
            content = _ArraysOnly(file).load()
        except InvalidInputError:
            raise
        except Exception as error:  # whatever a damaged pickle raises
            raise InvalidInputError(f"cannot read the pickle: {error}") from error
    return np.asarray(content, dtype=object).reshape(shape)


def _dictionary(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InvalidInputError(f"got type {type(value).__name__}, expected a dictionary")
    return cast("dict[str, Any]", value)


def _number(values: Mapping[str, Any], name: str) -> float:
    try:
        return float(values[name])
    except KeyError:
        raise InvalidInputError(f"{name}: missing; there is {', '.join(values)}") from None
    except (TypeError, ValueError):
        raise InvalidInputError(f"{name}: expected a number") from None


def _ordered(names: Sequence[str], angles: Mapping[str, Any]) -> list[float]:
    """Return the angles in the order of a hand's joints; prefixes as ``robot0:`` do not count."""
    plain = {name.rpartition(":")[2]: value for name, value in angles.items()}
    missing = [name for name in names if name.rpartition(":")[2] not in plain]
    if missing:
        raise InvalidInputError(
            f"qpos: no angle of the hand's joints {', '.join(missing)}; it has {', '.join(plain)}"
        )
    return [_number(plain, name.rpartition(":")[2]) for name in names]


def _quaternion(x: float, y: float, z: float) -> Array:
    """Return wxyz of turns about the fixed axes x, then y, then z [rad]."""
    (a, b, c), (p, q, r) = np.cos([x / 2, y / 2, z / 2]), np.sin([x / 2, y / 2, z / 2])
    return np.array(
        [
            a * b * c + p * q * r,
            p * b * c - a * q * r,
            a * q * c + p * b * r,
            a * b * r - p * q * c,
        ]
    )


def _placed(world: Any, name: str) -> tuple[Array, float]:
    """Return where BODex's world has an object, and its scale; the origin where it is not told."""
    try:
        found: Any = world[0]["mesh"][name]
        return np.array(found["pose"][:3], dtype=float), float(np.ravel(found["scale"])[0])
    except (KeyError, IndexError, TypeError):
        return np.zeros(3), 1.0


# ---- contacts ----------------------------------------------------------------------------------


def _mesh_path(folder: str, code: str) -> str:
    """Return an object's mesh, where DexGraspNet has it or by its name."""
    places = [Path(folder, code, "coacd", "decomposed.obj"), Path(folder, code, "decomposed.obj")]
    places += [Path(folder, f"{code}{ending}") for ending in (".obj", ".stl", ".ply")]
    for place in places:
        if place.is_file():
            return str(place)
    raise InvalidInputError(
        f"meshes: {folder} has no {code}/coacd/decomposed.obj and no {code}.obj"
    )


@lru_cache(maxsize=16)
def _scene(hand: str, mesh: str, scale: float) -> Scene:
    return Scene(hand, [scale * piece for piece in read_mesh(mesh)])
