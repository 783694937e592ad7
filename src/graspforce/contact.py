"""Contacts: contact models, and where a fingertip touches.

A contact model says which components of force a contact transmits and which cone they stay in
(Section II of the paper):

=========  ==========================  =============================================
FPC        normal                      n > 0
PCWF       normal, x, y                mu n > ‖(x, y)‖                    (Eq. 3)
SFC        normal, x, y, torsion       mu n > ‖(x, y, (mu/gamma) torsion)‖
=========  ==========================  =============================================

Any of them may pull: a vacuum, adhesion or a magnet holds with ``pull`` [N] what it touches, and
then n + pull stands in the place of n. The cone is shifted along the normal: the contact bears
n > −pull, and its friction is that of the preload n + pull.

The contact frame's normal points INTO the object; x and y are tangents, right-handed with it
(x × y = normal).

A model is its number of components ``dim``, its coefficients ``mu`` and ``gamma`` and ``pull``; no
other code branches on its class. c_i are the first ``dim`` of (normal force, x, y, torsion), and
scaled by the first ``dim`` of (mu, 1, 1, mu/gamma) they make every cone the same Lorentz cone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import (
    Array,
    as_array,
    as_integer,
    as_not_negative,
    as_positive,
    as_tuple,
    hash_bytes,
    require_instance,
)
from graspforce.errors import InvalidInputError, warn

# A normal this close to unit length is normalised; others are refused.
UNIT_TOLERANCE = 1e-6

# Below this share of its length across the normal, a tangent is one along it.
LEAST_ACROSS = 1e-9

# Above these, contacts' distance [m] and gamma [m] are probably in millimetres.
LARGEST_SPAN = 5.0
LARGEST_GAMMA = 1.0

# Between these angles of their normals [rad], contacts cease to be of one patch.
PATCH_ANGLES = (math.radians(10), math.radians(30))


class _Model:
    """Base of the contact models, which set ``dim``, ``mu``, ``gamma`` and ``pull``."""

    __slots__ = ()
    dim: ClassVar[int]

    @property
    def cone_scaling(self) -> Array:
        """Scales, shape (dim,): with s = cone_scaling·c_i the cone is s_0 > ‖(s_1, …)‖ [N]."""
        model = cast("ContactModel", self)
        return cone_scalings(np.array(model.mu), np.array(model.gamma))[: self.dim]


@dataclass(frozen=True, slots=True)
class FPC(_Model):
    """Frictionless point contact: pushes along the normal only; c_i = [n].

    Args:
        pull: what it can pull with, 0 or more [N].
    """

    pull: float = 0.0
    dim: ClassVar[int] = 1
    mu: ClassVar[float] = 1.0  # the cone of PCWF without tangents
    gamma: ClassVar[float] = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "pull", as_not_negative(self.pull, "FPC.pull", "N"))


@dataclass(frozen=True, slots=True)
class PCWF(_Model):
    """Point contact with friction; c_i = [n, x, y].

    Args:
        mu: coefficient of friction [-].
        pull: what it can pull with, 0 or more [N].
    """

    mu: float
    pull: float = 0.0
    dim: ClassVar[int] = 3
    gamma: ClassVar[float] = 1.0  # there is no torsion

    def __post_init__(self) -> None:
        object.__setattr__(self, "mu", as_positive(self.mu, "PCWF.mu"))
        object.__setattr__(self, "pull", as_not_negative(self.pull, "PCWF.pull", "N"))


@dataclass(frozen=True, slots=True)
class SFC(_Model):
    """Soft-finger contact with an elliptic cone; c_i = [n, x, y, torsion].

    Args:
        mu: coefficient of friction [-].
        gamma: coefficient of torsional friction [m]: a pure torsion may reach gamma·n [N·m].
        pull: what it can pull with, 0 or more [N].
    """

    mu: float
    gamma: float
    pull: float = 0.0
    dim: ClassVar[int] = 4

    def __post_init__(self) -> None:
        object.__setattr__(self, "mu", as_positive(self.mu, "SFC.mu"))
        object.__setattr__(self, "gamma", as_positive(self.gamma, "SFC.gamma", "m"))
        object.__setattr__(self, "pull", as_not_negative(self.pull, "SFC.pull", "N"))


ContactModel: TypeAlias = FPC | PCWF | SFC
_MODELS = "FPC(), PCWF(mu) or SFC(mu, gamma)"


def cone_scalings(mu: Array, gamma: Array) -> Array:
    """Return the scales (mu, 1, 1, mu/gamma) of normal force, x, y and torsion, shape (…, 4).

    Args:
        mu: coefficients of friction, shape (…,) [-].
        gamma: coefficients of torsional friction, shape (…,) [m].
    """
    one = np.ones(mu.shape)
    return np.stack((mu, one, one, mu / gamma), axis=-1)


def model_of(dim: int, mu: float, gamma: float, pull: float = 0.0) -> ContactModel:
    """Return the model with ``dim`` components and these coefficients."""
    if dim == FPC.dim:
        return FPC(pull)
    return PCWF(mu, pull) if dim == PCWF.dim else SFC(mu, gamma, pull)


def suction_cup(
    point: ArrayLike,
    normal: ArrayLike,
    radius: float,
    force: float,
    mu: float,
    points: int = 8,
) -> list[Contact]:
    """Return the contacts of a round vacuum cup, or of a magnet's round face.

    The vacuum pulls with ``force`` at the cup's centre, and the rim pushes where it touches: points
    of it with friction, spread evenly, each with its share of the force as ``pull``. What the cup
    bears follows from their cones: a pull up to ``force``; shear by friction of the preload, up to
    mu·(n + force); torsion up to radius times that; and before the rim lifts off on one side, a
    peel torque up to radius·(n + force), times cos(π/points) across the polygon's sides. These are
    the limits of the ring contact of Mahler, Matl, Liu, Li, Gealy and Goldberg, "Dex-Net 3.0", ICRA
    2018, but for the peel torque, which they take from the cup's elasticity: of a cup that peels at
    less, give the radius that its peel torque over the vacuum's force makes.

    Args:
        point: centre of the rim, shape (3,) [m].
        normal: unit normal into the object, shape (3,).
        radius: of the rim [m].
        force: of the vacuum, its pressure times the rim's area [N]; or what a magnet holds.
        mu: coefficient of friction of the rim [-].
        points: how many stand for the rim, 3 or more.

    Raises:
        InvalidInputError: a number out of its range, a wrong shape.
    """
    centre, unit = as_array(point, "point", (3,)), _unit(as_array(normal, "normal", (3,)))
    radius, force = as_positive(radius, "radius", "m"), as_positive(force, "force", "N")
    count = as_integer(points, "points", 3)
    model = PCWF(mu, force / count)
    across = Contact(centre, unit, model).frame[:, 1:]
    turns = 2 * np.pi * np.arange(count) / count
    arms = radius * np.column_stack((np.cos(turns), np.sin(turns))) @ across.T
    return [Contact(centre + arm, unit, model) for arm in arms]


def as_models(models: ContactModel | Sequence[ContactModel]) -> tuple[ContactModel, ...]:
    """Return the contact models as a tuple of at least one.

    Raises:
        InvalidInputError: empty, or something in it is no contact model.
    """
    if isinstance(models, FPC | PCWF | SFC):
        return (models,)
    require_instance(models, "models", Sequence, f"{_MODELS} or a list of them")
    given = tuple(models)
    if not given:
        raise InvalidInputError("models: got no contacts, expected at least one")
    for index, model in enumerate(given):
        require_instance(model, f"models[{index}]", ContactModel, _MODELS)
    return given


def models_for(models: ContactModel | Sequence[ContactModel], m: int) -> tuple[ContactModel, ...]:
    """Return the model of each contact of a W of m columns; one alone stands for all contacts.

    Raises:
        InvalidInputError: as :func:`as_models`, or models of other than m components.
    """
    each = as_models(models)
    if len(each) == 1:
        each = each * max(1, m // each[0].dim)
    total = sum(model.dim for model in each)
    if total != m:
        raise InvalidInputError(
            f"W: got {m} columns, expected {total}, the components of the {len(each)} contact "
            "models"
        )
    return each


def as_contacts(contacts: Sequence[Contact]) -> tuple[Contact, ...]:
    """Return the contacts as a tuple of at least one.

    Raises:
        InvalidInputError: none, or something that is no contact.
    """
    given = as_tuple(contacts, "contacts", Contact)
    if not given:
        raise InvalidInputError("contacts: got none, expected at least one")
    return given


def warn_of_slips(contacts: Sequence[Contact]) -> None:
    """Warn, at the user's line, of contacts that are probably an input error, as :func:`slips`."""
    points = np.array([[contact.point for contact in contacts]])
    normals = np.array([[contact.normal for contact in contacts]])
    gamma = np.array([[contact.model.gamma for contact in contacts]])
    warn(*(text for _, text in slips(points, normals, gamma, [c.model.dim for c in contacts])))


def slips(
    points: Array, normals: Array, gamma: Array, dims: Sequence[int]
) -> list[tuple[int, str]]:
    """Return what is probably an input error in B grasps of n contacts: of which grasp, and what.

    Millimetres: the contacts spread over more than ``LARGEST_SPAN`` along an axis, or a soft
    finger's gamma is above ``LARGEST_GAMMA``. Normals out of the object: each points away from
    the contacts' centre, more than about 6° beyond square to it, and together they do not point
    one way, as those under the feet of a robot do. Frictionless contacts alone may be cables.

    Args:
        points: shape (B, n, 3) [m].
        normals: unit vectors, shape (B, n, 3).
        gamma: coefficients of torsional friction, shape (B, n) [m].
        dims: components of each contact, n of them.
    """
    spans = np.ptp(points, axis=1).max(axis=1)
    gammas = gamma.max(axis=1)
    arms = points - points.mean(axis=1, keepdims=True)
    away = (normals * arms).sum(axis=-1) > 0.1 * np.linalg.norm(arms, axis=-1)
    one_way = np.linalg.norm(normals.mean(axis=1), axis=-1) > 0.8
    outward = away.all(axis=1) & ~one_way & (max(dims) > 1)
    found: list[tuple[int, str]] = []
    odd = (spans > LARGEST_SPAN) | (gammas > LARGEST_GAMMA) | outward
    for row in np.flatnonzero(odd).tolist():
        if spans[row] > LARGEST_SPAN:
            found.append((row, (
                f"contacts: their points are {spans[row]:.4g} m apart; if these are millimetres, "
                "divide them by 1000"
            )))  # fmt: skip
        if gammas[row] > LARGEST_GAMMA:
            found.append((row, (
                f"contacts: gamma is {gammas[row]:.4g} m; if these are millimetres, divide them by "
                "1000"
            )))  # fmt: skip
        if outward[row]:
            found.append((row, (
                "contacts: every normal points away from the contacts' centre; normals point INTO "
                "the object, so turn them round unless the fingers grip from inside"
            )))  # fmt: skip
    return found


def exact_lengths(vectors: Array) -> Array:
    """Return the lengths of vectors, shape (…, 3), as :func:`math.hypot` rounds them."""
    each = map(math.hypot, *vectors.reshape(-1, 3).T.tolist())
    return np.fromiter(each, np.float64, vectors.size // 3).reshape(vectors.shape[:-1])


def dot(a: Array, b: Array) -> Array:
    """Return a·b along the first axis, on every processor rounded alike for one and for many."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Array, b: Array) -> Array:
    """Return a × b along the first axis; ten times as fast as NumPy's general one."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def patch_weights(normals: Array, links: Sequence[object]) -> Array:
    """Return the weights of the cones with which contacts of one patch share 1, shape (n,).

    How many points stand for one patch is a matter of the simulator's collision geometry. Contacts
    are of one patch as far as the same link makes them and their normals agree: wholly up to
    ``PATCH_ANGLES[0]`` apart, not at all from ``PATCH_ANGLES[1]`` on, and in between in
    proportion, so that no weight jumps. A contact's weight is 1 over the contacts that it shares a
    patch with, itself among them.

    Args:
        normals: unit normals, shape (n, 3).
        links: what makes each contact, n names or numbers.
    """
    numbers = {link: number for number, link in enumerate(links)}
    of_link = np.array([numbers[link] for link in links])
    together = (of_link[:, None] == of_link).astype(float)
    near, far = math.cos(PATCH_ANGLES[0]), math.cos(PATCH_ANGLES[1])
    together *= ((normals @ normals.T - far) / (near - far)).clip(0.0, 1.0)
    return 1 / together.sum(axis=1)


def contact_starts(models: Sequence[ContactModel]) -> list[int]:
    """Return where each contact's components start in c; entry n is m, the length of c."""
    starts = [0]
    for model in models:
        starts.append(starts[-1] + model.dim)
    return starts


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """One contact between a finger and the object.

    Args:
        point: where, in the object's coordinates or the world's, shape (3,) [m].
        normal: unit normal INTO the object, shape (3,); within 1e-6 of unit length.
        model: FPC, PCWF or SFC.
        tangent: the direction of the frame's x, shape (3,), any length, projected onto the
            tangent plane. It fixes only the frame's roll. Default: a tangent chosen from the
            normal alone.

    Raises:
        InvalidInputError: a wrong shape, NaN, a normal of another length, a tangent along it.
    """

    point: Array
    normal: Array
    model: ContactModel
    tangent: Array

    def __init__(
        self,
        point: ArrayLike,
        normal: ArrayLike,
        model: ContactModel,
        tangent: ArrayLike | None = None,
    ) -> None:
        unit = _unit(as_array(normal, "normal", (3,)))
        along = any_tangent(unit) if tangent is None else as_array(tangent, "tangent", (3,))
        size = math.hypot(*along)
        flat = along / size if size else along
        for _ in range(2):  # the second pass removes what cancellation left along the normal
            flat = flat - dot(flat, unit) * unit
        length = math.hypot(*flat)
        if length <= LEAST_ACROSS:
            raise InvalidInputError(
                f"tangent: got {along.tolist()}, expected a direction across the normal "
                f"{unit.tolist()}"
            )
        flat = flat / length
        require_instance(model, "model", ContactModel, _MODELS)
        self._set(as_array(point, "point", (3,)), unit, model, flat)

    def _set(self, point: Array, normal: Array, model: ContactModel, tangent: Array) -> None:
        for name, array in (("point", point), ("normal", normal), ("tangent", tangent)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "model", model)

    def __reduce__(self) -> tuple[Any, ...]:
        return (_restore, (self.point, self.normal, self.model, self.tangent))

    @property
    def frame(self) -> Array:
        """The axes of the contact frame as columns [normal, x, y], shape (3, 3)."""
        return np.column_stack((self.normal, self.tangent, cross(self.normal, self.tangent)))

    @property
    def wrench_basis(self) -> Array:
        """Wrench about the contact point of each component of c_i, shape (6, dim).

        Rows [force; torque] in the axes in which the normal was given. So ``wrench_basis @ c_i`` is
        what the contact exerts, and ``wrench_basis.T @ twist`` the velocity of a link there in the
        contact's components. The columns are the first ``dim`` of force along normal, x, y and
        torque about the normal.
        """
        frame, basis = self.frame, np.zeros((6, 6))
        basis[:3, :3] = basis[3:, 3:] = frame
        return basis[:, : self.model.dim]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Contact):
            return NotImplemented
        return self.model == other.model and all(
            np.array_equal(a, b)
            for a, b in (
                (self.point, other.point),
                (self.normal, other.normal),
                (self.tangent, other.tangent),
            )
        )

    def __hash__(self) -> int:
        return hash((self.model, hash_bytes(self.point), hash_bytes(self.normal)))


def _restore(point: Array, normal: Array, model: ContactModel, tangent: Array) -> Contact:
    contact = Contact.__new__(Contact)
    contact._set(point, normal, model, tangent)  # pyright: ignore[reportPrivateUsage]
    return contact


def _unit(normal: Array) -> Array:
    length = math.hypot(*normal)
    if abs(length - 1) > UNIT_TOLERANCE:
        raise InvalidInputError(
            f"normal: got {normal.tolist()} of length {length:g}, expected a unit vector "
            f"(within {UNIT_TOLERANCE:g})"
        )
    return normal / length


def any_tangent(normal: Array) -> Array:
    """Return the coordinate axis farthest from each normal, shape (…, 3), to be projected."""
    return np.eye(3)[np.argmin(np.abs(normal), axis=-1)]
