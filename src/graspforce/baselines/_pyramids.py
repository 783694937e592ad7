"""Friction cones as pyramids of flat facets, for the methods with linear constraints only.

An *inner* pyramid is inscribed in the true cone: its forces are in the cone, but between two edges
it leaves out 1 − cos(pi/facets) of the friction. An *outer* one is circumscribed: it contains the
cone, and its forces along the edges slip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral
from typing import Literal, TypeAlias

import numpy as np

from graspforce._util.arrays import Array
from graspforce.baselines._active import Active
from graspforce.contact import ContactModel
from graspforce.errors import InvalidInputError

Cones: TypeAlias = Literal["inner", "outer"]


@dataclass(frozen=True, slots=True)
class Pyramids:
    """The pyramids in place of the cones.

    Attributes:
        facets: of a cone with two tangents; a soft finger's has as many around and half of them
            more from pole to pole.
        inner: inscribed rather than circumscribed.
    """

    facets: int
    inner: bool

    @classmethod
    def of(cls, facets: int, cones: Cones) -> Pyramids:
        """Check a caller's options.

        Raises:
            InvalidInputError: ``facets`` is not even or below 4, ``cones`` is another word.
        """
        if not isinstance(facets, Integral) or facets < 4 or facets % 2:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InvalidInputError(
                f"facets: got {facets!r}, expected an even number of at least 4"
            )
        if cones not in ("inner", "outer"):
            raise InvalidInputError(f"cones: got {cones!r}, expected 'inner' or 'outer'")
        return cls(facets, cones == "inner")

    def rows(self, view: Active) -> Array:
        """Return the rows F of all cones, F c ≤ 0, contact by contact, shape (·, m)."""
        parts: list[Array] = []
        for model, (start, end) in zip(view.models, pairwise(view.starts), strict=True):
            own = facet_rows(model, self.facets, self.inner)
            part = np.zeros((len(own), len(view.W.T)))
            part[:, start:end] = own
            parts.append(part)
        return np.vstack(parts)


def facet_rows(model: ContactModel, facets: int, inner: bool) -> Array:
    """Return one contact's rows: u·t ≤ mu n for directions u all around, shape (·, dim).

    The regular polygon around a circle has its corners at 1/cos(pi/facets) radii, so that the
    one with cos(pi/facets)·mu is inside. A soft finger's ball takes such polygons of longitudes
    and of latitudes, and the cosine twice; its torsion counts as (mu/gamma)·torsion.
    """
    u, inside = _directions(model.dim - 1, facets)
    height = np.full((len(u), 1), -inside if inner else -1.0)
    return np.hstack((height, u)) * model.cone_scaling


def _directions(tangents: int, facets: int) -> tuple[Array, float]:
    """Return directions all around in the space of a contact's tangents, and what fits inside.

    Args:
        tangents: 0, 2 or 3.
        facets: around the circle.

    Returns:
        Unit vectors u, shape (·, tangents), and the largest r for which all t with u·t ≤ r have
        ‖t‖ ≤ 1.
    """
    if tangents == 0:
        return np.zeros((1, 0)), 1.0
    around = 2 * math.pi * np.arange(facets) / facets
    u = np.column_stack((np.cos(around), np.sin(around)))
    inside = math.cos(math.pi / facets)
    if tangents == 2:
        return u, inside
    latitude = math.pi * (2 * np.arange(facets // 2 + 1) / facets - 0.5)
    ball = np.kron(np.cos(latitude)[:, None], u)
    return np.column_stack((ball, np.repeat(np.sin(latitude), facets))), inside**2
