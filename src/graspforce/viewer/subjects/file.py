"""Grasps of a file as a subject. They are matrices: where the contacts are is read off W."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from graspforce import equations
from graspforce._util.arrays import Array
from graspforce.contact import UNIT_TOLERANCE, Contact
from graspforce.files import NamedProblem
from graspforce.problem import ForceProblem
from graspforce.viewer import colours, shapes
from graspforce.viewer.knobs import Knobs, turned_down
from graspforce.viewer.moment import Body, Moment, Pose
from graspforce.viewer.problems import turn_knobs

_UNKNOWN = 0.05  # size where contacts do not tell one [m]
_SIZED = 100  # grasps at most by which the size is told


class FileSubject:
    """The grasps of a file.

    Args:
        title: the file's name.
        grasps: at least one.
    """

    controls = frozenset({"push", "tilt", "heading", "list"})
    load_unit = "times"
    busy = False
    fingers: tuple[str, ...] = ()
    times: Array = np.zeros(0)

    def __init__(self, title: str, grasps: Sequence[NamedProblem]) -> None:
        self.title = title
        count = len(grasps)
        self.summary = f"{count} grasp{'s' if count > 1 else ''} from a file"
        self.items = tuple(each.name for each in grasps)
        self.problems = tuple(each.problem for each in grasps)
        self.knobs = Knobs(alpha=self.problems[0].alpha)
        # A file may have a hundred thousand; of one that is looked at the bodies stay the same.
        self._contacts = lru_cache(1024)(self._contacts_of)
        self._hull = lru_cache(1024)(self._hull_of)
        some = map(self._contacts, range(0, count, -(-count // _SIZED)))
        sizes = [_extent(each) for each in some if each is not None]
        self.size = float(np.median(sizes)) if sizes else _UNKNOWN
        self.centre: Array = np.zeros(3)

    def bodies(self, knobs: Knobs) -> tuple[Body, ...]:
        """Return the hull of a grasp's contacts."""
        return self._hull(self._place(knobs))

    def _place(self, knobs: Knobs) -> int:
        return min(knobs.item, len(self.problems) - 1)

    def _contacts_of(self, i: int) -> tuple[Contact, ...] | None:
        return contacts_of(self.problems[i])

    def _hull_of(self, i: int) -> tuple[Body, ...]:
        contacts = self._contacts(i)
        mesh = None
        if contacts is not None:
            mesh = shapes.hull(np.array([each.point for each in contacts]))
        return () if mesh is None else (Body(f"object {i}", "object", *mesh, colours.OBJECT, 0.35),)

    def alpha_of(self, item: int) -> float:
        """Return the alpha that the file gives a grasp."""
        return self.problems[item].alpha

    def work(self, seconds: float) -> None:
        """There is nothing to compute beforehand."""

    def moment(self, knobs: Knobs) -> Moment:
        """Return a grasp as the knobs have it.

        Raises:
            InvalidInputError: the knobs make no problem of it.
        """
        i = self._place(knobs)
        given, contacts = self.problems[i], self._contacts(i)
        f = given.f.copy()
        f[:6] *= knobs.load
        if len(f) >= 6 and knobs.tilt:
            R = turned_down(knobs.tilt, knobs.heading)
            f[:3], f[3:6] = R @ f[:3], R @ f[3:6]
        # A body in the plane has x, y and the torque about z.
        f[:6] -= knobs.applied[[0, 1, 5]] if len(f) == 3 else knobs.applied[: len(f)]
        has = given.layout.ceilings
        problem = turn_knobs(
            given.replace(f=f), knobs, given.engagement if has else np.ones(given.n),
            given.c_max if has else None, 10 * float(np.abs(given.f).max()) or 1.0,
        )  # fmt: skip
        note = ""
        if contacts is None:
            note = "W is no grasp map: its contacts have no places to draw."
        count = given.layout.joints
        return Moment(
            {f"object {i}": Pose(np.zeros(3))}, contacts or (), np.zeros(3), problem,
            tuple(f"finger {k + 1}" for k in range(given.n)),
            tuple(f"joint {k + 1}" for k in range(count)), np.full((count, 3), np.nan), note,
        )  # fmt: skip


def contacts_of(problem: ForceProblem) -> tuple[Contact, ...] | None:
    """Return the contacts whose grasp map is W; None where W is no grasp map.

    Three rows are those of a body in the plane, x, y and the torque about z. A contact's columns
    are [axes; r × axes] for its place r from the origin. A contact without friction may be anywhere
    on its normal; the place nearest to the origin is taken.
    """
    W = problem.W
    if len(W) == 3:
        W = np.zeros((6, problem.m))
        W[[0, 1, 5]] = problem.W
    if len(W) != 6:
        return None
    contacts: list[Contact] = []
    for block, model in zip(equations.split(W, problem.layout.dims), problem.models, strict=True):
        width = min(model.dim, 3)
        axes, moments = block[:3, :width], block[3:, :width]
        if np.abs(axes.T @ axes - np.eye(width)).max() > UNIT_TOLERANCE:
            return None
        # r × a = m for every axis a; with one axis the least r.
        rows = np.vstack([-_cross_matrix(axes[:, k]) for k in range(width)])
        point = np.linalg.lstsq(rows, moments.T.ravel(), rcond=None)[0]
        tangent = axes[:, 1] if width > 1 else None
        contacts.append(Contact(point, axes[:, 0], model, tangent))
    return tuple(contacts)


def _cross_matrix(a: Array) -> Array:
    """Return the matrix of a ×, shape (3, 3)."""
    x, y, z = a
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _extent(contacts: tuple[Contact, ...]) -> float:
    points = np.array([each.point for each in contacts])
    apart = float(np.linalg.norm(points[:, None] - points, axis=-1).max())
    return apart or 2 * float(np.linalg.norm(points, axis=1).max()) or _UNKNOWN
