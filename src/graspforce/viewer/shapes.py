"""Meshes of simple shapes. All but the box are turned from a profile about z."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
import viser.transforms

from graspforce._util.arrays import Array
from graspforce.contact import any_tangent, cross
from graspforce.viewer.moment import Body, Pose, Role

Mesh = tuple[Array, np.ndarray[tuple[int, ...], np.dtype[np.int64]]]

_SIDES, _RINGS = 32, 12


def box(extents: Any) -> Mesh:
    """Return a box about the origin with edges of the given lengths [m]."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in corners for face in ((a, b, c), (a, c, d))]
    return signs * np.array(extents) / 2, np.array(faces, np.int64)


def ball(radius: float) -> Mesh:
    """Return a sphere about the origin [m]."""
    return capsule(radius, 0.0)


def ellipsoid(radii: Array) -> Mesh:
    """Return an ellipsoid about the origin with the given half axes, shape (3,) [m]."""
    vertices, faces = ball(1.0)
    return vertices * radii, faces


def cylinder(radius: float, height: float) -> Mesh:
    """Return a cylinder about the origin, along z [m]."""
    z = height / 2
    return _turned([(0.0, -z), (radius, -z), (radius, z), (0.0, z)])


def capsule(radius: float, length: float) -> Mesh:
    """Return a capsule about the origin, along z; ``length`` is between its ends' centres [m]."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, 2 * _RINGS)
    ends = np.sign(angles) * length / 2
    return _turned([*zip(radius * np.cos(angles), radius * np.sin(angles) + ends, strict=True)])


def cone() -> Mesh:
    """Return a cone with its tip at the origin that opens along z to a radius of 1 at 1."""
    return _turned([(0.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def _turned(profile: Any) -> Mesh:
    """Return the surface that a profile of (radius, z) makes about z, from below."""
    radius, z = np.array(profile, dtype=float).T
    angle = 2 * math.pi * np.arange(_SIDES) / _SIDES
    x, y = np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))
    vertices = np.stack((x, y, np.broadcast_to(z[:, None], x.shape)), axis=-1).reshape(-1, 3)
    ring, side = np.meshgrid(np.arange(len(radius) - 1), np.arange(_SIDES), indexing="ij")
    a, b = ring * _SIDES + side, ring * _SIDES + (side + 1) % _SIDES
    quads = np.stack((a, b, b + _SIDES, a + _SIDES), axis=-1).reshape(-1, 4)
    return vertices, np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def hull(points: Array) -> Mesh | None:
    """Return the convex hull of points, shape (k, 3); None where they are all in one plane."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[-1] < 1e-6 * spread[0]:
        return None
    spatial: Any = importlib.import_module("scipy.spatial")  # takes a while
    return points, np.array(spatial.ConvexHull(points).simplices, np.int64)


def meets(body: Body, origin: Array, direction: Array) -> Array | None:
    """Return where a ray first meets a body, in the body's frame; None where it misses.

    Args:
        body: the body.
        origin: of the ray, in the body's frame, shape (3,) [m].
        direction: of the ray, shape (3,).
    """
    a, b, c = (body.vertices[body.faces[:, k]] for k in range(3))
    # Möller and Trumbore: (t, u, v) with origin + t direction = a + u (b − a) + v (c − a).
    columns = np.stack((np.broadcast_to(-direction, a.shape), b - a, c - a), axis=-1)
    regular = np.abs(np.linalg.det(columns)) > 1e-18
    t, u, v = np.linalg.solve(columns[regular], (origin - a[regular])[..., None])[..., 0].T
    hit = (t > 0) & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
    return origin + float(t[hit].min()) * direction if hit.any() else None


def link(name: str, role: Role, length: float, radius: float, colour: str) -> Body:
    """Return a finger's link: a capsule that begins at the origin and ends at z = length."""
    vertices, faces = capsule(radius, length)
    return Body(name, role, vertices + np.array([0.0, 0.0, length / 2]), faces, colour)


def along(start: Array, end: Array) -> Pose:
    """Return the pose of a link that begins and ends at the given points."""
    return Pose(start, frame(end - start))


def frame(direction: Array) -> Array:
    """Return a rotation whose z axis has the given direction, shape (3, 3)."""
    size = float(np.linalg.norm(direction))
    z = direction / size if size > 0 else np.array([0.0, 0.0, 1.0])
    x = cross(any_tangent(z), z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, cross(z, x), z))


def quaternion(R: Array) -> Array:
    """Return the quaternion wxyz of a rotation matrix, or of several, shape (…, 4)."""
    return np.array(viser.transforms.SO3.from_matrix(R).wxyz, dtype=float)
