"""What a page shows: bodies that never change their shape, and one moment of a grasp.

A :class:`Subject` is where both come from: a scenario of the paper, a scene in physics, a file of
grasps, a hand. All that a page does beyond that is the same for every subject.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np

from graspforce._util.arrays import Array
from graspforce.contact import Contact
from graspforce.problem import ForceProblem
from graspforce.viewer.knobs import Knobs

Role = Literal["object", "hand", "ground"]


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A rigid mesh.

    Attributes:
        name: unique in its subject.
        role: what it is: contacts are picked on an object, and it is translucent.
        vertices: in the body's frame, shape (v, 3) [m].
        faces: shape (f, 3).
        colour: as ``#rrggbb``.
        opacity: 0 to 1; meshes of hands let forces and joints through.
    """

    name: str
    role: Role
    vertices: Array
    faces: np.ndarray[tuple[int, ...], np.dtype[np.int64]]
    colour: str
    opacity: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where a body is, in the world.

    Attributes:
        position: shape (3,) [m].
        rotation: R_world_body, shape (3, 3).
    """

    position: Array
    rotation: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A grasp at one moment, in world axes.

    Attributes:
        poses: of the bodies, by name; those that are not named are not shown.
        contacts: of the problem, in its order.
        origin: the point about which torques are taken, shape (3,) [m].
        problem: its force problem; None where there is none, for the reason in ``note``.
        fingers: names of the contacts.
        joints: names of the joints.
        joint_points: where the joints are, shape (n_joints, 3) [m]; NaN where nobody knows.
        note: a sentence that the page says besides; empty for none.
        simulated: forces that the physics has in place of those that are asked for, world axes,
            shape (n, 3) [N]; None but for a simulation.
    """

    poses: Mapping[str, Pose]
    contacts: tuple[Contact, ...]
    origin: Array
    problem: ForceProblem | None
    fingers: tuple[str, ...]
    joints: tuple[str, ...]
    joint_points: Array
    note: str = ""
    simulated: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What a page shows while its subject is being made: a drawing and a sentence.

    Attributes:
        title: a few words.
        summary: what is being done, a few words.
        bodies: what is drawn.
        moment: where they are; its note is the sentence.
        centre: where the camera looks, shape (3,) [m].
        size: of what will be held [m].
        failed: whether there will be no subject, for the reason in the note.
        knobs: which there are none of yet.
    """

    title: str
    summary: str
    bodies: tuple[Body, ...]
    moment: Moment
    centre: Array
    size: float
    failed: bool = False
    knobs: Knobs = field(default_factory=Knobs)

    def failing(self, why: str) -> Look:
        """Return the same drawing with the reason for which there will be no subject."""
        return replace(self, moment=replace(self.moment, note=why), failed=True)


class Subject(Protocol):
    """What a page is about."""

    @property
    def title(self) -> str:
        """A few words."""
        ...

    @property
    def summary(self) -> str:
        """A sentence."""
        ...

    @property
    def knobs(self) -> Knobs:
        """Where the knobs stand at first."""
        ...

    @property
    def controls(self) -> frozenset[str]:
        """The knobs beyond those of every force problem that act on this subject."""
        ...

    @property
    def fingers(self) -> tuple[str, ...]:
        """Names of the hand's fingers; empty where there is no hand."""
        ...

    @property
    def load_unit(self) -> str:
        """Of ``knobs.load``: "kg" for a payload's mass, "times" for a factor on a given load."""
        ...

    @property
    def busy(self) -> bool:
        """Whether there is something to compute of which a moment may be the result."""
        ...

    def work(self, seconds: float) -> None:
        """Go on with that for about some time."""
        ...

    def bodies(self, knobs: Knobs) -> tuple[Body, ...]:
        """Return what is drawn: the same bodies as long as they have not changed."""
        ...

    @property
    def centre(self) -> Array:
        """Where the camera looks, shape (3,) [m]."""
        ...

    @property
    def size(self) -> float:
        """Of what is held, by which arrows and cones are drawn [m]."""
        ...

    @property
    def times(self) -> Array:
        """The ticks of what moves, shape (T,) [s]; empty where nothing does."""
        ...

    @property
    def items(self) -> tuple[str, ...]:
        """Names of the grasps, or trials, among which ``knobs.item`` chooses; empty for one."""
        ...

    def alpha_of(self, item: int) -> float:
        """Return the alpha that one of them has by itself."""
        ...

    def moment(self, knobs: Knobs) -> Moment:
        """Return the grasp as the knobs have it.

        Raises:
            InvalidInputError: the knobs ask for what cannot be, as an object out of reach.
        """
        ...
