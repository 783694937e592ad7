"""Meshes of simple shapes, by trimesh, which viser brings along."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
import viser.transforms

from graspforce._util.arrays import Array
from graspforce.viewer.moment import Body, Pose, Role

Mesh = tuple[Array, np.ndarray[tuple[int, ...], np.dtype[np.int64]]]


def box(extents: Any) -> Mesh:
    """Return a box about the origin with edges of the given lengths [m]."""
    return _mesh(trimesh.creation.box(extents))


def ball(radius: float) -> Mesh:
    """Return a sphere about the origin [m]."""
    return _mesh(trimesh.creation.icosphere(3, radius))


def ellipsoid(radii: Array) -> Mesh:
    """Return an ellipsoid about the origin with the given half axes, shape (3,) [m]."""
    vertices, faces = ball(1.0)
    return vertices * radii, faces


def cylinder(radius: float, height: float) -> Mesh:
    """Return a cylinder about the origin, along z [m]."""
    return _mesh(trimesh.creation.cylinder(radius, height, sections=32))


def capsule(radius: float, length: float) -> Mesh:
    """Return a capsule about the origin, along z; ``length`` is between its ends' centres [m]."""
    made = trimesh.creation.capsule(length, radius, count=(16, 16))
    vertices, faces = _mesh(made)
    return vertices - (vertices.max(axis=0) + vertices.min(axis=0)) / 2, faces


def cone() -> Mesh:
    """Return a cone with its tip at the origin that opens along z to a radius of 1 at 1."""
    vertices, faces = _mesh(trimesh.creation.cone(1.0, 1.0, sections=32))
    return vertices * [1.0, -1.0, -1.0] + [0.0, 0.0, 1.0], faces


def hull(points: Array) -> Mesh | None:
    """Return the convex hull of points, shape (k, 3); None where they are all in one plane."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[-1] < 1e-6 * spread[0]:
        return None
    return _mesh(trimesh.convex.convex_hull(points))


def meets(body: Body, origin: Array, direction: Array) -> Array | None:
    """Return where a ray first meets a body, in the body's frame; None where it misses.

    Args:
        body: the body.
        origin: of the ray, in the body's frame, shape (3,) [m].
        direction: of the ray, shape (3,).
    """
    a, b, c = (body.vertices[body.faces[:, k]] for k in range(3))
    # Möller and Trumbore: the place (t, u, v) with origin + t direction = a + u (b − a) + v (c − a).
    columns = np.stack((np.broadcast_to(-direction, a.shape), b - a, c - a), axis=-1)
    regular = np.abs(np.linalg.det(columns)) > 1e-18
    t, u, v = np.linalg.solve(columns[regular], (origin - a[regular])[..., None])[..., 0].T
    hit = (t > 0) & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
    return origin + float(t[hit].min()) * direction if hit.any() else None


def link(name: str, role: Role, length: float, radius: float, colour: str) -> Body:
    """Return a finger's link: a capsule that begins at the origin and ends at z = length."""
    vertices, faces = capsule(radius, length)
    return Body(name, role, vertices + [0.0, 0.0, length / 2], faces, colour)


def along(start: Array, end: Array) -> Pose:
    """Return the pose of a link that begins and ends at the given points."""
    return Pose(start, frame(end - start))


def frame(direction: Array) -> Array:
    """Return a rotation whose z axis has the given direction, shape (3, 3)."""
    size = float(np.linalg.norm(direction))
    z = direction / size if size > 0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))


def quaternion(R: Array) -> Array:
    """Return the quaternion wxyz of a rotation matrix, or of several, shape (…, 4)."""
    return viser.transforms.SO3.from_matrix(R).wxyz


def _mesh(made: Any) -> Mesh:
    return np.array(made.vertices, dtype=float), np.array(made.faces, dtype=np.int64)
