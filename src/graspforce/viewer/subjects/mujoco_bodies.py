"""The geoms of a MuJoCo model as bodies, whatever their kind, and where they are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce.hands.mujoco.model import mujoco_module
from graspforce.viewer import colours, shapes
from graspforce.viewer.moment import Body, Pose
from graspforce.viewer.shapes import Mesh

# Collision shapes are in these groups by MuJoCo's own habit, and drawn where nothing else is.
_VISIBLE = 3
_GROUND = 0.6  # half width that is drawn of a plane [m]


def bodies(model: Any, object_body: int = -1) -> dict[int, Body]:
    """Return what is drawn of a model, by the number of the geom.

    Args:
        model: the ``mujoco.MjModel``.
        object_body: number of the body that is held; what hangs on it belongs to it.
    """
    kinds = mujoco_module().mjtGeom
    shown = [g for g in range(model.ngeom) if model.geom_group[g] < _VISIBLE]
    drawn: dict[int, Body] = {}
    for geom in shown or range(model.ngeom):
        mesh = _mesh(model, geom)
        if mesh is None:
            continue
        body = int(model.geom_bodyid[geom])
        plane = model.geom_type[geom] == int(kinds.mjGEOM_PLANE)
        held = object_body >= 0 and _hangs_on(model, body, object_body)
        role = "ground" if plane else "object" if held else "hand"
        name = f"{geom} {model.geom(geom).name or model.body(body).name}"
        colour = colours.OBJECT if held else _colour(model, geom)
        is_mesh = model.geom_type[geom] == int(kinds.mjGEOM_MESH)
        opacity = 0.35 if held or plane else 0.5 if is_mesh else 1.0
        drawn[geom] = Body(name, role, *mesh, colour, opacity)
    return drawn


def poses(data: Any, drawn: dict[int, Body]) -> dict[str, Pose]:
    """Return where they are, after ``mj_kinematics``."""
    return {
        body.name: Pose(data.geom_xpos[geom].copy(), data.geom_xmat[geom].reshape(3, 3).copy())
        for geom, body in drawn.items()
    }


def smallest_extent(drawn: Iterable[Body], poses: Mapping[str, Pose]) -> float:
    """Return how large the object is where it is smallest, along a world axis; inf without one."""
    places = [
        poses[body.name].position + body.vertices @ poses[body.name].rotation.T
        for body in drawn
        if body.role == "object"
    ]
    return float(np.ptp(np.vstack(places), axis=0).min()) if places else np.inf


def joint_points(model: Any, data: Any, names: tuple[str, ...]) -> Array:
    """Return where the joints of a model are, NaN for what is no joint, shape (k, 3) [m]."""
    mj = mujoco_module()
    found = [mj.mj_name2id(model, mj.mjtObj.mjOBJ_JOINT, name) for name in names]
    return np.array(
        [data.xanchor[i].copy() if i >= 0 else np.full(3, np.nan) for i in found]
    ).reshape(-1, 3)


def _hangs_on(model: Any, body: int, top: int) -> bool:
    while body > top:
        body = int(model.body_parentid[body])
    return body == top


def _colour(model: Any, geom: int) -> str:
    material = int(model.geom_matid[geom])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return colours.lightened("#" + "".join(f"{round(255 * float(each)):02x}" for each in rgba[:3]))


def _mesh(model: Any, geom: int) -> Mesh | None:
    """Return a geom's mesh in its own frame; None for kinds that have none."""
    kinds, size = mujoco_module().mjtGeom, model.geom_size[geom]
    x, y, _ = size.tolist()
    made: dict[int, Callable[[], Mesh]] = {
        int(kinds.mjGEOM_PLANE): lambda: shapes.box(
            [2 * (x or _GROUND), 2 * (y or _GROUND), 0.002]
        ),
        int(kinds.mjGEOM_SPHERE): lambda: shapes.ball(1.02 * x),  # a tip often lies on a mesh
        int(kinds.mjGEOM_CAPSULE): lambda: shapes.capsule(x, 2 * y),
        int(kinds.mjGEOM_ELLIPSOID): lambda: shapes.ellipsoid(size),
        int(kinds.mjGEOM_CYLINDER): lambda: shapes.cylinder(x, 2 * y),
        int(kinds.mjGEOM_BOX): lambda: shapes.box(2 * size),
        int(kinds.mjGEOM_MESH): lambda: _own_mesh(model, int(model.geom_dataid[geom])),
    }
    make = made.get(int(model.geom_type[geom]))
    return None if make is None else make()


def _own_mesh(model: Any, mesh: int) -> Mesh:
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    first, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return (
        np.array(model.mesh_vert[start : start + count], dtype=float),
        np.array(model.mesh_face[first : first + faces], dtype=np.int64),
    )
