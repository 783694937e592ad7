"""A scenario: object, hand, contacts, motion and schedule, and the problems they make in time.

Everything is expressed in world axes, which are the hand's: the palm is the plane z = 0. W and f
are about the cube's centre of mass. The contacts are fixed to the cube, and their frames turn
with it, so that c stays comparable from tick to tick: only then does a force that follows the
object look constant, and extrapolation is worth most.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from graspforce._util.arrays import Array, as_positive, require_instance
from graspforce.contact import Contact, ContactModel, as_contacts
from graspforce.errors import InvalidInputError
from graspforce.grasp import Grasp
from graspforce.hands.paper import PaperHand
from graspforce.problem import ForceProblem
from graspforce.regrasp import Schedule
from graspforce.trajectory import Motion, State, wrench


@dataclass(frozen=True, slots=True)
class Cube:
    """A cube of uniform density; its frame sits at its centre, axes along its edges.

    Args:
        mass: of the cube [kg].
        side: length of an edge [m].
    """

    mass: float
    side: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", as_positive(self.mass, "mass", "kg"))
        object.__setattr__(self, "side", as_positive(self.side, "side", "m"))

    @property
    def inertia(self) -> Array:
        """About the centre of mass, shape (3, 3), the same in all axes [kg·m²]."""
        return self.mass * self.side**2 / 6 * np.eye(3)

    def side_contacts(self, model: ContactModel) -> tuple[Contact, ...]:
        """Return contacts at the centres of the vertical sides +x, +y, −x, −y.

        The frames' x points up.
        """
        outward = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
        return tuple(
            Contact(
                point=self.side / 2 * np.array(side),
                normal=-np.array(side),
                model=model,
                tangent=(0.0, 0.0, 1.0),
            )
            for side in outward
        )


@dataclass(frozen=True, slots=True)
class Scenario:
    """What happens, as data; asked for a time it returns that tick's problem.

    Args:
        name: short, a word.
        summary: one line for people.
        cube: the object.
        hand: finger i makes contact i.
        contacts: on the cube, in its frame, four.
        motion: of the cube's centre, in the world.
        alpha: weight of the linear limits, Eq. (16).
        c_max: ceiling of every normal force [N], Eq. (20); None for torque limits alone.
        schedule: the contacts' engagement; needs c_max, the ceiling that it scales.
        rate: ticks a second [Hz].
        duration: of the scenario [s].

    Raises:
        InvalidInputError: an argument of the wrong kind, a number out of range, a schedule
            without c_max or for another number of contacts, less than one tick.
    """

    name: str
    summary: str
    cube: Cube
    hand: PaperHand
    contacts: tuple[Contact, ...]
    motion: Motion
    alpha: float = 5.0
    c_max: float | None = None
    schedule: Schedule | None = None
    rate: float = 250.0
    duration: float = 2.0

    def __post_init__(self) -> None:
        for name, kind in (("name", str), ("summary", str), ("cube", Cube), ("hand", PaperHand)):
            require_instance(getattr(self, name), name, kind)
        require_instance(self.motion, "motion", Motion, "a Motion: at(t)")
        object.__setattr__(self, "contacts", as_contacts(self.contacts))
        if len(self.contacts) != 4:
            raise InvalidInputError(
                f"contacts: got {len(self.contacts)}, expected 4, the i-th made by finger i"
            )
        for name, unit in (("alpha", ""), ("rate", "Hz"), ("duration", "s")):
            object.__setattr__(self, name, as_positive(getattr(self, name), name, unit))
        if self.c_max is not None:
            object.__setattr__(self, "c_max", as_positive(self.c_max, "c_max", "N"))
        if self.schedule is not None:
            require_instance(self.schedule, "schedule", Schedule)
            if self.c_max is None:
                raise InvalidInputError("c_max: missing; schedule came without it")
            if self.schedule.contacts != len(self.contacts):
                raise InvalidInputError(
                    f"schedule: got one for {self.schedule.contacts} contacts, "
                    f"expected {len(self.contacts)}"
                )
        if round(self.duration * self.rate) < 1:
            raise InvalidInputError(
                f"duration: got {self.duration} s, expected at least one tick of {1 / self.rate} s"
            )

    @property
    def times(self) -> Array:
        """When the ticks are, shape (T,): 0, 1/rate, … up to but without ``duration`` [s]."""
        return np.arange(round(self.duration * self.rate)) / self.rate

    def state(self, t: float) -> State:
        """Return how the cube moves at time t [s]."""
        return self.motion.at(t)

    def contacts_at(self, t: float) -> tuple[Contact, ...]:
        """Return the contacts at time t [s], in the world."""
        state = self.state(t)
        R, position = state.rotation, state.position
        return tuple(
            Contact(
                point=position + R @ contact.point,
                normal=R @ contact.normal,
                model=contact.model,
                tangent=R @ contact.tangent,
            )
            for contact in self.contacts
        )

    def joint_angles(self, t: float) -> Array:
        """Return the hand's joint angles at time t [s], shape (12,) [rad]."""
        return self._joint_angles(self.contacts_at(t))

    def grasp(self, t: float) -> Grasp:
        """Return the grasp at time t [s]: W about the cube's centre, J, torque limits."""
        contacts = self.contacts_at(t)
        return Grasp(contacts, self.hand, self._joint_angles(contacts), self.state(t).position)

    def wrench(self, t: float) -> Array:
        """Return the wrench f that the motion takes at time t [s], shape (6,) [N, N·m]."""
        state = self.state(t)
        return wrench(
            self.cube.mass,
            self.cube.inertia,
            state.acceleration,
            state.angular_velocity,
            state.angular_acceleration,
        )

    def engagement(self, t: float) -> Array:
        """Return the engagement of every contact at time t [s], shape (n,)."""
        return np.ones(len(self.contacts)) if self.schedule is None else self.schedule(t)

    def problem(self, t: float) -> ForceProblem:
        """Return the force problem at time t [s].

        Raises:
            InvalidInputError: a contact is out of its finger's reach then.
        """
        ceilings = (
            {} if self.c_max is None else {"c_max": self.c_max, "engagement": self.engagement(t)}
        )
        return self.grasp(t).problem(self.wrench(t), alpha=self.alpha, **ceilings)

    def problems(self) -> Iterator[ForceProblem]:
        """Yield the problem of every tick, in order."""
        return (self.problem(t) for t in self.times)

    def _joint_angles(self, contacts: tuple[Contact, ...]) -> Array:
        return self.hand.inverse_kinematics([contact.point for contact in contacts])
