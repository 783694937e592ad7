"""A hand from a MuJoCo or URDF file as a subject, with an object on which contacts are picked.

Its fingers reach for their contacts by themselves: joint angles are what brings the fingertips
there, from the middle of the joints' ranges.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce._util.native_stderr import native_stderr
from graspforce.contact import PCWF, Contact
from graspforce.errors import GraspForceWarning
from graspforce.grasp import Grasp
from graspforce.hands.mujoco.hand import MujocoRobot
from graspforce.hands.overview import read_hand
from graspforce.hands.pinocchio.model import pinocchio_module
from graspforce.trajectory import GRAVITY
from graspforce.viewer import colours, shapes
from graspforce.viewer.knobs import Knobs, Pick, rotation
from graspforce.viewer.moment import Body, Moment, Pose
from graspforce.viewer.problems import turn_knobs

_MU, _SLIM = 0.5, 1.5  # friction at first; a cylinder's height by its diameter
_MASS = 0.1  # of the object at first [kg]
_CEILING = 20.0  # of a contact that is to leave [N]
_STEPS, _STEP, _DAMPING = 25, 1e-5, 1e-3  # of the fingers' reach
_APART = 0.01  # a fingertip farther from its contact than this is said [m]


class HandSubject:
    """An imported hand.

    Args:
        path: an MJCF file or a URDF.
        fingertips: links; by default the last ones of the chains that motors move.
        tau_max: limit of every motor in place of the file's [N·m, N].

    Raises:
        ModelImportError, InvalidInputError, MissingExtraError: as the readers of hands.
    """

    items: tuple[str, ...] = ()
    load_unit = "kg"
    times: Array = np.zeros(0)
    controls = frozenset({"push", "tilt", "heading", "move", "turn", "picks"})
    busy = False

    def __init__(
        self, path: str | Path, fingertips: Sequence[str] = (), tau_max: float | None = None
    ) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", GraspForceWarning)  # they are among the notes
            self._hand = hand = read_hand(path, fingertips, tau_max)
        self.title = Path(path).name
        self.fingers = tuple(hand.fingertips)
        self.summary = f"{len(self.fingers)} fingers, {len(hand.joint_names)} motors"
        self.notes = hand.notes
        self._lo, self._hi = _ranges(hand.robot, hand.q_names)
        middle = np.zeros(len(self._lo))
        ends = np.isfinite(self._lo)
        middle[ends] = (self._lo[ends] + self._hi[ends]) / 2
        self._middle = middle
        self._drawing = _drawing(hand, path)
        tips = hand.fingertip_positions(middle)
        self.centre: Array = tips.mean(axis=0)
        spread = float(np.linalg.norm(tips - self.centre, axis=1).mean())
        self.size = float(f"{min(max(1.2 * spread, 0.01), 0.5):.1g}")
        self.knobs = Knobs(load=_MASS, size=self.size)
        # What the last knobs gave, for any page: bodies keep their identity, fingers their reach.
        self._object = lru_cache(16)(_object)
        self._reached = lru_cache(16)(self._reach)

    def bodies(self, knobs: Knobs) -> tuple[Body, ...]:
        """Return hand and object."""
        return (*self._drawing.bodies, self._object(knobs.shape, knobs.size))

    def alpha_of(self, item: int) -> float:
        """Return the alpha of the only grasp."""
        return self.knobs.alpha

    def work(self, seconds: float) -> None:
        """There is nothing to compute beforehand."""

    def moment(self, knobs: Knobs) -> Moment:
        """Return the grasp as the knobs have it.

        Raises:
            InvalidInputError: the picks name fingers that there are not; a closed linkage stays
                open.
        """
        body = self._object(knobs.shape, knobs.size)
        R, position = rotation(knobs.turn), self.centre + np.array(knobs.move)
        picks = [each for each in knobs.picks if each.finger < len(self.fingers)]
        contacts = tuple(
            Contact(position + R @ each.point, R @ each.normal, PCWF(_MU)) for each in picks
        )
        links = tuple(self._hand.fingertips[self.fingers[each.finger]] for each in picks)
        q = self._reached(links, tuple(tuple(each.point.tolist()) for each in contacts))
        configuration = self._hand.robot.configuration(q)
        poses = {body.name: Pose(position, R), **self._drawing.poses(configuration)}
        if not contacts:
            note = (
                "No contacts yet: click on the object where a finger shall touch it, or let all "
                "fingers touch it by the button."
            )
            return Moment(poses, (), position, None, (), (), np.zeros((0, 3)), note)
        grasp = Grasp(contacts, self._hand.touching(links), q, position)
        f = np.zeros(6)
        f[:3] = -knobs.load * GRAVITY * knobs.gravity
        f -= knobs.applied
        n = len(contacts)
        problem = turn_knobs(grasp.problem(f), knobs, np.ones(n), None, _CEILING)
        return Moment(
            poses, contacts, position, problem, tuple(self.fingers[each.finger] for each in picks),
            grasp.joint_names, self._drawing.joint_points(configuration, grasp.joint_names),
            self._apart(configuration, links, contacts),
        )  # fmt: skip

    def pick(self, knobs: Knobs, origin: Array, direction: Array, finger: int | None) -> Knobs:
        """Return the knobs with a contact where a ray meets the object; as they are if it misses.

        Args:
            knobs: as they stand.
            origin: of the ray, world axes, shape (3,) [m].
            direction: shape (3,).
            finger: which touches there; None for the nearest that touches nothing yet.
        """
        R, position = rotation(knobs.turn), self.centre + np.array(knobs.move)
        body = self._object(knobs.shape, knobs.size)
        point = shapes.meets(body, R.T @ (origin - position), R.T @ direction)
        if point is None:
            return knobs
        if finger is None:
            free = [
                i
                for i in range(len(self.fingers))
                if i not in {each.finger for each in knobs.picks}
            ]
            if not free:
                return knobs
            tips = self._hand.fingertip_positions(self._middle)[free]
            finger = free[int(np.argmin(np.linalg.norm(tips - position - R @ point, axis=1)))]
        pick = Pick(finger, _triple(point), _triple(_normal(knobs, point)))
        others = tuple(each for each in knobs.picks if each.finger != finger)
        return knobs.changed(picks=(*others, pick))

    def touch_all(self, knobs: Knobs) -> Knobs:
        """Return the knobs with a contact of every finger on its way to the object's centre."""
        knobs = knobs.changed(picks=())
        position = self.centre + np.array(knobs.move)
        for i, tip in enumerate(self._hand.fingertip_positions(self._middle)):
            far = position + 10 * (tip - position)
            knobs = self.pick(knobs, far, position - far, i)
        return knobs

    def _reach(self, links: tuple[str, ...], points: tuple[tuple[float, ...], ...]) -> Array:
        """Return joint angles with the links' origins at the points (Gauss and Newton)."""
        q = self._middle
        if not links:
            return q
        targets = np.array(points).ravel()

        def places(q: Array) -> Array:
            configuration = self._hand.robot.configuration(q)
            return np.concatenate([configuration.position(link) for link in links])

        now = places(q)
        for _ in range(_STEPS):
            off = targets - now
            if np.abs(off).max() < 1e-4:
                break
            columns = [(places(q + _STEP * e) - now) / _STEP for e in np.eye(len(q))]
            J = np.array(columns).T
            step = J.T @ np.linalg.solve(J @ J.T + _DAMPING**2 * np.eye(len(J)), off)
            step *= min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
            moved = np.clip(q + step, self._lo, self._hi)
            then = places(moved)
            if np.linalg.norm(targets - then) > 0.999 * np.linalg.norm(off):
                break
            q, now = moved, then
        return q

    def _apart(
        self, configuration: Any, links: tuple[str, ...], contacts: tuple[Contact, ...]
    ) -> str:
        far = [
            f"{link} ({1e3 * distance:.0f} mm)"
            for link, contact in zip(links, contacts, strict=True)
            if (distance := float(np.linalg.norm(configuration.position(link) - contact.point)))
            > _APART
        ]
        return f"Out of reach of their contacts: the origins of {', '.join(far)}." if far else ""


def _object(shape: str, size: float) -> Body:
    match shape:
        case "sphere":
            mesh = shapes.ball(size / 2)
        case "box":
            mesh = shapes.box([size] * 3)
        case _:
            mesh = shapes.cylinder(size / 2, _SLIM * size)
    return Body("object", "object", *mesh, colours.OBJECT, 0.5)


def _normal(knobs: Knobs, point: Array) -> Array:
    """Return the normal into the object at a point on its surface."""
    if knobs.shape == "sphere":
        outward = point
    elif knobs.shape == "cylinder" and abs(point[2]) < 0.4999 * _SLIM * knobs.size:
        outward = point * [1.0, 1.0, 0.0]
    else:
        axis = int(np.argmax(np.abs(point))) if knobs.shape == "box" else 2
        outward = np.eye(3)[axis] * point[axis]
    return -outward / np.linalg.norm(outward)


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = np.round(vector, 9).tolist()
    return (x, y, z)


def _ranges(robot: Any, names: tuple[str, ...]) -> tuple[Array, Array]:
    """Return the ends of the joints' ranges, infinite where there are none."""
    lo, hi = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for i, name in enumerate(names):
        if isinstance(robot, MujocoRobot):
            joint: Any = robot.model.joint(name)
            if robot.model.jnt_limited[joint.id]:
                lo[i], hi[i] = robot.model.jnt_range[joint.id]
        else:
            at: int = robot.model.joints[robot.model.getJointId(name)].idx_q
            ends: tuple[float, float] = (
                robot.model.lowerPositionLimit[at],
                robot.model.upperPositionLimit[at],
            )
            if max(abs(each) for each in ends) < 1e3 and ends[0] < ends[1]:
                lo[i], hi[i] = ends
    return lo, hi


def _drawing(hand: Any, path: str | Path) -> Any:
    if isinstance(hand.robot, MujocoRobot):
        return _MujocoDrawing(hand.robot)
    return _UrdfDrawing(hand, path)


class _MujocoDrawing:
    """The geoms of an MJCF file."""

    def __init__(self, robot: MujocoRobot) -> None:
        from graspforce.viewer.subjects import mujoco_bodies

        self._bodies = mujoco_bodies
        self._drawn = mujoco_bodies.bodies(robot.model)
        self._model = robot.model
        self.bodies = tuple(self._drawn.values())

    def poses(self, configuration: Any) -> dict[str, Pose]:
        return self._bodies.poses(configuration.data, self._drawn)

    def joint_points(self, configuration: Any, names: tuple[str, ...]) -> Array:
        return self._bodies.joint_points(self._model, configuration.data, names)


class _UrdfDrawing:
    """The visual meshes of a URDF; where it has none that can be read, links between joints."""

    def __init__(self, hand: Any, path: str | Path) -> None:
        self._hand = hand
        self._visuals = _visuals(hand.robot.model, Path(path))
        self._radius = 0.0
        made = [body for body, _ in self._visuals]
        if not made:
            configuration = hand.robot.configuration(np.zeros(len(hand.q_names)))
            for finger, tip in hand.fingertips.items():
                chain = configuration.chain(tip)
                lengths = np.linalg.norm(np.diff(chain, axis=0), axis=1)
                radius = 0.08 * float(lengths.sum())
                made += [
                    shapes.link(f"{finger} {k}", "hand", float(length), radius, colours.LINK)
                    for k, length in enumerate(lengths)
                ]
        self.bodies = tuple(made)

    def poses(self, configuration: Any) -> dict[str, Pose]:
        if self._visuals:
            found: dict[str, Pose] = {}
            for body, (joint, placement) in self._visuals:
                at = configuration.data.oMi[joint] * placement
                found[body.name] = Pose(np.array(at.translation), np.array(at.rotation))
            return found
        return {
            f"{finger} {k}": shapes.along(start, end)
            for finger, tip in self._hand.fingertips.items()
            for k, (start, end) in enumerate(_pairs(configuration.chain(tip)))
        }

    def joint_points(self, configuration: Any, names: tuple[str, ...]) -> Array:
        model = self._hand.robot.model
        return np.array(
            [
                np.array(configuration.data.oMi[model.getJointId(name)].translation)
                if model.existJointName(name)
                else np.full(3, np.nan)
                for name in names
            ]
        ).reshape(-1, 3)


def _pairs(chain: Array) -> list[tuple[Array, Array]]:
    return list(pairwise(chain))


def _visuals(model: Any, path: Path) -> list[tuple[Body, tuple[int, Any]]]:
    """Return the visual shapes of a URDF, each with its joint and its place there."""
    pin = pinocchio_module()
    folders = [str(each) for each in path.resolve().parents]
    try:
        with native_stderr():
            geometry = pin.buildGeomFromUrdf(
                model, str(path), pin.GeometryType.VISUAL, None, folders
            )
    except (ValueError, RuntimeError):  # meshes that are not there
        return []
    found: list[tuple[Body, tuple[int, Any]]] = []
    for each in geometry.geometryObjects:
        mesh: Any = each.geometry
        if not hasattr(mesh, "tri_indices"):  # a box, a sphere, a cylinder
            return []
        corners = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
        faces = np.array([[each[k] for k in range(3)] for each in corners], np.int64)
        r, g, b = (round(255 * float(c)) for c in each.meshColor[:3])
        colour = colours.lightened(f"#{r:02x}{g:02x}{b:02x}")
        vertices = np.array(mesh.vertices(), dtype=float)
        body = Body(each.name, "hand", vertices, faces, colour, 0.5)
        found.append((body, (each.parentJoint, each.placement)))
    return found
