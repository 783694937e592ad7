"""The contacts of an object in a MuJoCo simulation: places, frames, friction, forces."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from graspforce._engine import native
from graspforce._util.arrays import Array
from graspforce.contact import Contact, ContactModel, model_of
from graspforce.hands.mujoco.model import (
    adhesion_force,
    adhesions,
    loose_bodies,
    mujoco_module,
)

Indices: TypeAlias = NDArray[np.intp]


class Contacts(NamedTuple):
    """The object's n active contacts, as arrays."""

    places: Indices
    """In ``data.contact``."""
    geoms: Indices
    """shape (n, 2): what makes the contact, and the object's."""
    bodies: Indices
    """Theirs."""
    side: Array
    """1 where the object's geom is MuJoCo's second, −1 where it is the first."""
    points: Array
    """shape (n, 3) [m]."""
    axes: Array
    """shape (n, 3, 3): rows normal into the object, x, y."""
    dims: Indices
    """Components of each: 1 for FPC, 3 for PCWF, 4 for SFC."""
    mu: Array
    gamma: Array
    pull: Array
    """What adhesion holds each with, shape (n,) [N]."""
    left_out: Indices
    """Bodies that make contacts which are left out; −1 for a deformable one."""

    @property
    def models(self) -> tuple[ContactModel, ...]:
        """The contact models that lie within MuJoCo's cones."""
        arrays = (self.dims, self.mu, self.gamma, self.pull)
        numbers = zip(*(array.tolist() for array in arrays), strict=True)
        return tuple(model_of(*each) for each in numbers)

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts one by one."""
        return tuple(
            Contact(point, axes[0], model, axes[1])
            for point, axes, model in zip(self.points, self.axes, self.models, strict=True)
        )

    def forces(self, model: Any, data: Any) -> Array:
        """Return the physics' contact forces, shape (m,).

        MuJoCo's are of the contact alone: what adhesion pulls with is taken off.
        """
        mj = mujoco_module()
        c = np.zeros((len(self.places), 6))
        for force, place in zip(c, self.places.tolist(), strict=True):
            mj.mj_contactForce(model, data, place, force)
        # MuJoCo's is on the second geom. With the other sign its axes normal and y are turned
        # round, so that of its components only that along x changes its sign.
        c[:, 1] *= self.side
        c[:, 0] -= self.pull
        return c[:, :4][_components(self.dims)]


class ContactReader:
    """Finds the active contacts of an object with anything that is not loose itself."""

    def __init__(self, model: Any, inside: NDArray[np.bool_]) -> None:
        """Look up which geoms are the object's.

        Args:
            model: the model.
            inside: which bodies make up the object, shape (nbody,).
        """
        self._model = model
        # The last entry is for a deformable body's −1.
        self._of_object: NDArray[np.bool_] = np.append(inside[model.geom_bodyid], False)
        self._body_of_geom: Indices = np.append(model.geom_bodyid, 0)
        self._floating = loose_bodies(model, np.zeros((0, model.nv)))
        self._adhesions = adhesions(model)
        self._key: tuple[bytes, ...] | None = None

    def read(self, data: Any, moments: Array) -> Contacts:
        """Return the contacts that the data list.

        Args:
            data: the simulation's data.
            moments: the drives' motions by joint motion, shape (n_drives, nv).
        """
        seen = data.contact
        # Which they are and how they rub stays for many ticks.
        key = tuple(each.tobytes() for each in (seen.geom, seen.exclude, seen.dim, seen.friction))
        if key != self._key:
            self._last = self._look_at(seen, moments)
            # A body that floats may be a robot's in the next tick, as motors come to move it.
            floating = self._floating[self._last.bodies[:, 0]].any() or len(self._last.left_out)
            self._key = None if floating else key
        last = self._last
        # MuJoCo's normal points from the first geom to the second; x stays, and y follows.
        points, axes = native.module.contact_axes(seen.pos, seen.frame, last.places, last.side)
        pull = self._pulls(data)[last.places] if self._adhesions else last.pull
        return last._replace(points=points, axes=axes, pull=pull)

    def _look_at(self, seen: Any, moments: Array) -> Contacts:
        """Return which contacts are listed, without what moves: places, axes, pull."""
        geoms: Indices = seen.geom
        of_object = self._of_object[geoms]
        # Of the object and something else, and not left out by MuJoCo.
        places = np.flatnonzero((of_object[:, 0] != of_object[:, 1]) & (seen.exclude == 0))
        second = of_object[places, 1]
        geoms = np.where(second[:, None], geoms[places], geoms[places, ::-1])
        bodies = self._body_of_geom[geoms]
        left_out: NDArray[np.bool_] = geoms[:, 0] < 0
        if self._floating[bodies[:, 0]].any():  # else there is nothing loose at hand
            left_out |= loose_bodies(self._model, moments)[bodies[:, 0]]
        missing: Indices = np.zeros(0, dtype=np.intp)
        if left_out.any():
            missing = np.where(geoms[:, 0] < 0, -1, bodies[:, 0])[left_out]
            kept = ~left_out
            places, second, geoms, bodies = places[kept], second[kept], geoms[kept], bodies[kept]
        n = len(places)
        return Contacts(
            places, geoms, bodies, np.where(second, 1.0, -1.0), np.zeros((n, 3)),
            np.zeros((n, 3, 3)), *_friction(seen.dim[places], seen.friction[places]), np.zeros(n),
            missing,
        )  # fmt: skip

    def _pulls(self, data: Any) -> Array:
        """Return what adhesion holds each of ``data.contact`` with, shape (ncon,) [N].

        MuJoCo shares an adhesion's force evenly among all contacts of its body, those in the gap
        included, and of no deformable one.
        """
        seen = data.contact
        pulls = np.zeros(len(seen.dist))
        for motor, body in self._adhesions:
            of_body = self._body_of_geom[seen.geom] == body
            sharing = of_body.any(axis=1) & (seen.geom >= 0).all(axis=1) & (seen.exclude < 2)
            if sharing.any():
                force = adhesion_force(self._model, data, motor)
                pulls[sharing] += force / int(sharing.sum())
        return pulls


def _components(dims: Indices) -> NDArray[np.bool_]:
    """Return which of [normal, x, y, torsion] each contact has, shape (n, 4): the first ones."""
    return np.arange(4) < dims[:, None]


def _friction(dim: Array, friction: Array) -> tuple[Indices, Array, Array]:
    """Return components, mu and gamma of the contact models that lie within MuJoCo's cones.

    MuJoCo's least coefficient, which it puts in place of 0, is no friction. Of two tangential
    coefficients the smaller counts; rolling friction (dim 6) is not used.
    """
    least = float(mujoco_module().mjMINMU)
    mu, gamma = np.minimum(friction[:, 0], friction[:, 1]), friction[:, 2]
    dims = np.where((dim == 1) | (mu <= least), 1, np.where((dim == 3) | (gamma <= least), 3, 4))
    return dims, mu, gamma
