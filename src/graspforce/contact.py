"""Contacts: what a fingertip can push with, and where it touches.

A contact model says which components of force a contact transmits and which cone they stay in
(Section II of the paper):

=========  ==========================  =============================================
FPC        normal                      n > 0
PCWF       normal, x, y                mu n > ‖(x, y)‖                    (Eq. 3)
SFC        normal, x, y, torsion       mu n > ‖(x, y, (mu/gamma) torsion)‖
=========  ==========================  =============================================

The contact frame's normal points INTO the object; x and y are tangents, right-handed with it
(x × y = normal).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from graspforce._arrays import Array, as_array, as_positive
from graspforce.errors import InvalidInputError

# A normal this close to unit length is taken as meant to be one and is normalised.
UNIT_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class FPC:
    """Frictionless point contact: pushes along the normal only; c_i = [n]."""

    dim: ClassVar[int] = 1


@dataclass(frozen=True, slots=True)
class PCWF:
    """Point contact with friction; c_i = [n, x, y].

    Args:
        mu: coefficient of friction [-].
    """

    mu: float
    dim: ClassVar[int] = 3

    def __post_init__(self) -> None:
        object.__setattr__(self, "mu", as_positive(self.mu, "PCWF.mu"))


@dataclass(frozen=True, slots=True)
class SFC:
    """Soft-finger contact with an elliptic cone; c_i = [n, x, y, torsion].

    Args:
        mu: coefficient of friction [-].
        gamma: coefficient of torsional friction [m]: a pure torsion may reach gamma·n [N·m].
    """

    mu: float
    gamma: float
    dim: ClassVar[int] = 4

    def __post_init__(self) -> None:
        object.__setattr__(self, "mu", as_positive(self.mu, "SFC.mu"))
        object.__setattr__(self, "gamma", as_positive(self.gamma, "SFC.gamma", "m"))


ContactModel: TypeAlias = FPC | PCWF | SFC


def as_models(models: ContactModel | Sequence[ContactModel]) -> tuple[ContactModel, ...]:
    """Return the contact models as a tuple of at least one.

    Raises:
        InvalidInputError: empty, or something in it is no contact model.
    """
    if isinstance(models, FPC | PCWF | SFC):
        return (models,)
    given = cast("tuple[object, ...]", tuple(models))
    if not given:
        raise InvalidInputError("models: got no contacts, expected at least one")
    for index, model in enumerate(given):
        if not isinstance(model, FPC | PCWF | SFC):
            raise InvalidInputError(
                f"models[{index}]: got {model!r}, expected FPC(), PCWF(mu) or SFC(mu, gamma)"
            )
    return cast("tuple[ContactModel, ...]", given)


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
            tangent plane. It only fixes the frame's roll. Default: a tangent chosen from the
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
        along = _any_tangent(unit) if tangent is None else as_array(tangent, "tangent", (3,))
        flat = along - (along @ unit) * unit
        length = float(np.linalg.norm(flat))
        if length <= 1e-9 * max(1.0, float(np.linalg.norm(along))) or length == 0:
            raise InvalidInputError(
                f"tangent: got {along.tolist()}, expected a direction across the normal "
                f"{unit.tolist()}"
            )
        flat /= length
        flat.flags.writeable = False
        object.__setattr__(self, "point", as_array(point, "point", (3,)))
        object.__setattr__(self, "normal", unit)
        object.__setattr__(self, "model", as_models(model)[0])
        object.__setattr__(self, "tangent", flat)

    @property
    def frame(self) -> Array:
        """The axes of the contact frame as columns [normal, x, y], shape (3, 3)."""
        return np.column_stack((self.normal, self.tangent, np.cross(self.normal, self.tangent)))

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
        return hash((self.model, self.point.tobytes(), self.normal.tobytes()))


def _unit(normal: Array) -> Array:
    length = float(np.linalg.norm(normal))
    if abs(length - 1) > UNIT_TOLERANCE:
        raise InvalidInputError(
            f"normal: got {normal.tolist()} of length {length:g}, expected a unit vector "
            f"(within {UNIT_TOLERANCE:g})"
        )
    unit = normal / length
    unit.flags.writeable = False
    return unit


def _any_tangent(normal: Array) -> Array:
    """Return the coordinate axis farthest from the normal, for the caller to project."""
    return np.eye(3)[int(np.argmin(np.abs(normal)))]
