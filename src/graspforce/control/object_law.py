"""The wrench that brings an object to where it should be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from graspforce._engine import native
from graspforce._util.arrays import Array, as_array, as_not_negative, as_positive
from graspforce.contact import cross
from graspforce.errors import InvalidInputError
from graspforce.trajectory import GRAVITY, State

_Shapes: TypeAlias = tuple[tuple[str, tuple[int, ...]], ...]

_SHAPES: _Shapes = (
    ("position", (3,)), ("rotation", (3, 3)), ("velocity", (3,)), ("angular_velocity", (3,))
)  # fmt: skip
_OF_ACCELERATION: _Shapes = (
    ("turned", (3, 3)), *((f"target.{name}", shape) for name, shape in _SHAPES),
    ("target.acceleration", (3,)), ("target.angular_acceleration", (3,)),
    *((f"state.{name}", shape) for name, shape in _SHAPES),
)  # fmt: skip
_OF_WRENCH: _Shapes = (
    ("inertia", (3, 3)), ("acceleration", (6,)), ("state.rotation", (3, 3)),
    ("state.angular_velocity", (3,)), ("gravity", (3,)),
)  # fmt: skip


@dataclass(slots=True, eq=False)
class ObjectState:
    """Where a rigid object is and how it moves, as measured; world axes.

    Attributes:
        position: of its centre of mass, shape (3,) [m].
        rotation: R_world_object, shape (3, 3): v_world = R @ v_object.
        velocity: of its centre of mass, shape (3,) [m/s].
        angular_velocity: shape (3,) [rad/s].

    Raises:
        InvalidInputError: a wrong shape, or what is not numbers.
    """

    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array

    def __post_init__(self) -> None:
        for name, shape in _SHAPES:
            value = getattr(self, name)
            if type(value) is not np.ndarray or value.shape != shape:
                setattr(self, name, as_array(value, name, shape))

    def point_velocity(self, point: Array) -> Array:
        """Return the velocity of the object's material at ``point``, shape (3,) [m/s]."""
        return self.velocity + cross(self.angular_velocity, point - self.position)


class ObjectLaw:
    """A spring and a damper from a rigid object to its target, fed forward with its inertia.

    Errors e fall off as ë + damping ė + stiffness e = 0, whatever the object's mass, as far as the
    contacts give the wrench; with damping = 2 √stiffness as fast as without overshoot. A loop asks
    in every tick for the acceleration, and for the wrench that makes it::

        law = ObjectLaw(mass=0.2, inertia=np.diag([1e-4, 1e-4, 5e-5]))
        f = law.wrench(law.acceleration(motion.at(t), state), state)  # of servo.step(f=f, …)

    Args:
        mass: of the object [kg].
        inertia: about its centre of mass, object axes, shape (3, 3) [kg·m²].
        stiffness: of its pose [1/s²].
        damping: [1/s].
        turned: R_world_object where the target's rotation is the identity, shape (3, 3); the
            identity by default.

    Raises:
        InvalidInputError: a mass that is not positive, an inertia that is not that of a body,
            gains below 0, a ``turned`` that is no rotation.
    """

    def __init__(
        self,
        mass: float,
        inertia: ArrayLike,
        *,
        stiffness: float = 400.0,
        damping: float = 40.0,
        turned: ArrayLike | None = None,
    ) -> None:
        self.mass = as_positive(mass, "mass", "kg")
        self.inertia = as_array(inertia, "inertia", (3, 3))
        size = np.abs(self.inertia).max()
        if np.abs(self.inertia - self.inertia.T).max() > 1e-9 * size or (
            np.linalg.eigvalsh(self.inertia).min() <= 0
        ):
            raise InvalidInputError(
                f"inertia: got {self.inertia.tolist()}, expected a symmetric, positive definite "
                "matrix"
            )
        self.stiffness = as_not_negative(stiffness, "stiffness", "1/s²")
        self.damping = as_not_negative(damping, "damping", "1/s")
        self.turned = np.eye(3) if turned is None else as_array(turned, "turned", (3, 3))
        off = np.abs(self.turned @ self.turned.T - np.eye(3)).max()
        if off > 1e-6 or np.linalg.det(self.turned) < 0:
            raise InvalidInputError(
                f"turned: got {self.turned.tolist()}, expected a rotation matrix"
            )

    def acceleration(self, target: State, state: ObjectState) -> Array:
        """Return the wanted acceleration, linear and angular, shape (6,) [m/s², rad/s²].

        Args:
            target: where the object should be and how it should move, or what has its attributes.
            state: where it is.

        Raises:
            InvalidInputError: a wrong shape, numbers that are not finite.
        """
        given = (
            self.turned, target.position, target.rotation, target.velocity,
            target.angular_velocity, target.acceleration, target.angular_acceleration,
            state.position, state.rotation, state.velocity, state.angular_velocity,
        )  # fmt: skip
        gains = self.stiffness, self.damping
        return _finite(native.module.object_acceleration, gains, _OF_ACCELERATION, given)

    def wrench(
        self, acceleration: Array, state: ObjectState, gravity: ArrayLike = (0.0, 0.0, -GRAVITY)
    ) -> Array:
        """Return the wrench of the contacts that makes an acceleration, shape (6,) [N, N·m].

        It is the f of W c = f with W about the centre of mass, world axes: a force and a torque
        against weight and inertia. What else pushes on the object has to be taken off.

        Args:
            acceleration: linear and angular, shape (6,) [m/s², rad/s²].
            state: where the object is.
            gravity: shape (3,) [m/s²].

        Raises:
            InvalidInputError: numbers that are not finite.
        """
        given = self.inertia, acceleration, state.rotation, state.angular_velocity, gravity
        return _finite(native.module.object_wrench, (self.mass,), _OF_WRENCH, given)


def _finite(
    function: Callable[..., Array | None],
    numbers: tuple[float, ...],
    shapes: _Shapes,
    given: tuple[Any, ...],
) -> Array:
    """Return what a function of the core says, which takes plain arrays with finite numbers.

    Raises:
        InvalidInputError: a wrong shape, numbers that are not finite or come to no such.
    """
    found = function(*numbers, *given)
    if found is None:
        plain = [as_array(x, name, shape) for (name, shape), x in zip(shapes, given, strict=True)]
        found = function(*numbers, *plain)
    if found is None:
        names = ", ".join(name for name, _ in shapes)
        raise InvalidInputError(
            f"{names}: got numbers whose products leave double precision, expected others"
        )
    return found


def rotation_vector(R: Array) -> Array:
    """Return axis times angle of a rotation matrix, shape (3,) [rad]; of length up to π."""
    return native.module.rotation_vector(np.ascontiguousarray(R, dtype=float))
