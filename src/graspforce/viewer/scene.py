"""The 3-D scene of a page: bodies, contact frames, cones, forces, joints.

Everything is made once and then moved: a change sends what has changed and nothing else. Contacts
are drawn in batches, one node for all cones and one for all arrows, so that a page with many
contacts costs as few messages as one with four.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from viser import SceneApi

from graspforce._util.arrays import Array
from graspforce.answers.diagnosis import Binding
from graspforce.viewer import colours, shapes
from graspforce.viewer.moment import Body, Look, Moment, Pose, Subject
from graspforce.viewer.problems import Answer

# Sizes as shares of the object's [-].
_CONE, _JOINT, _FRAME, _LABEL, _PATCH, _CROWDED = 0.5, 0.1, 0.11, 0.12, 0.3, 0.6
_ARROW, _LONGEST = 0.75, 2.0  # of the longest arrow, at first and at most
_SHAFT, _HEAD, _HEAD_LENGTH = 0.02, 0.05, 0.13
# From where the camera looks at first, and how far off, in radii of what there is to see.
_VIEW = np.array([-0.56, -0.73, 0.39])
_DISTANCE = 2.0
_TIGHT = 0.65  # as much of a picture has to be free, in either way, for what there is to see
_FARTHEST = 2.5  # what is that many times the object's size away, as an arm, is not aimed at
_CONE_OPACITY = 0.45


def dress(api: SceneApi) -> None:
    """Set the light of a server's scene, under which colours stay what they are."""
    api.world_axes.visible = False
    api.configure_default_lights(False)
    api.configure_environment_map(None)
    api.add_light_ambient("/light/ambient", intensity=1.7)
    for i, (place, strength) in enumerate((((2, -3, 5), 1.5), ((-4, -1, 1), 0.7))):
        api.add_light_directional(f"/light/{i}", intensity=strength, position=place)


def aim(camera: Any, subject: Subject | Look, covered: float = 0.0, aspect: float = 1.0) -> None:
    """Let a server's initial camera, or a client's, look at a subject.

    Args:
        camera: which.
        subject: what it looks at, in the middle of what is free.
        covered: the share of the picture's height that a panel covers, from below.
        aspect: the picture's width by its height.
    """
    if isinstance(subject, Look):
        bodies, moment = subject.bodies, subject.moment
    else:
        bodies, moment = subject.bodies(subject.knobs), subject.moment(subject.knobs)
    radius = 1.6 * subject.size
    for body in bodies:
        pose = moment.poses.get(body.name)
        if pose is not None and body.role != "ground":
            places = pose.position + body.vertices @ pose.rotation.T - subject.centre
            radius = max(radius, float(np.linalg.norm(places, axis=1).max()))
    radius = min(radius, _FARTHEST * subject.size)
    radius *= max(1.0, _TIGHT / min(aspect, 1 - covered))
    # Seen from a little above, up in the picture is nearly up in the world.
    lower = [0.0, 0.0, covered * _DISTANCE * radius * math.tan(camera.fov / 2)]
    camera.position = tuple(subject.centre - lower + _DISTANCE * radius * _VIEW)
    camera.look_at = tuple(subject.centre - lower)
    camera.near, camera.far = subject.size / 50, subject.size * 500


@contextlib.contextmanager
def quiet() -> Generator[None]:
    """Keep what viser prints when a server begins and ends off the terminal."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield


class Scene:
    """A subject in a viser scene.

    Args:
        api: of a client, or of a server whose scene is to be saved.
        subject: what is drawn.
        on_click: called with the ray of a click on the object, origin and direction in world axes.
        on_pull: called while the object is dragged with the wrench that this stands for, at its
            centre, world axes, shape (6,) [N, N·m], and whether it is over. With Shift the force
            acts where the object was taken hold of.

    Attributes:
        metres_per_newton: length of the arrows.
    """

    def __init__(
        self,
        api: SceneApi,
        subject: Subject | Look,
        on_click: Callable[[Array, Array], None] | None = None,
        on_pull: Callable[[Array, bool], None] | None = None,
    ) -> None:
        # viser types its arrays as float32, and takes others.
        self._api: Any = api
        self._subject = subject
        self._on_click, self._on_pull = on_click, on_pull
        self._bodies: dict[str, Any] = {}
        self._shown_bodies: tuple[Body, ...] = ()
        self._shown_poses: Mapping[str, Pose] | None = None
        self._contacts: _Contacts | None = None
        self._joints: Any = None
        self._wanted = _WrenchArrows(api, "wanted", colours.WANTED, subject.size)
        self._applied = _WrenchArrows(api, "applied", colours.PUSH, subject.size)
        self._origin = np.zeros(3)
        self.metres_per_newton = self._first_scale = 0.0
        low = min(float(subject.centre[2]) - 1.5 * subject.size, 0.0)
        api.add_grid(
            "/grid", width=8 * subject.size, height=8 * subject.size, plane="xy",
            cell_size=subject.size / 2, section_size=2 * subject.size,
            cell_color=(236, 239, 242), section_color=(220, 224, 229),
            position=(float(subject.centre[0]), float(subject.centre[1]), low - 0.002),
        )  # fmt: skip

    def show(
        self,
        bodies: tuple[Body, ...],
        moment: Moment,
        answer: Answer | None,
        other: Array | None = None,
        binding: Sequence[Binding] = (),
        applied: Array | None = None,
    ) -> None:
        """Draw a moment.

        Args:
            bodies: the subject's.
            moment: the grasp.
            answer: its forces; None where there is no problem. Without a solution cones and
                joints are grey, but for what binds.
            other: forces of another method, world axes, shape (n, 3) [N].
            binding: limits to paint red.
            applied: what acts on the object beside its weight, shape (6,) [N, N·m].
        """
        contacts = {each.index for each in binding if each.kind in ("friction", "ceiling", "floor")}
        joints = {each.index for each in binding if each.kind == "torque"}
        self._show_bodies(bodies, moment)
        n = len(moment.contacts)
        if self._contacts is not None and self._contacts.n != n:
            self._contacts.remove()
            self._contacts = None
        if self._contacts is None and n:
            self._contacts = _Contacts(self._api, n, self._subject.size)
        forces = np.zeros((n, 3))
        if answer is not None and n:
            forces = contact_forces(moment, answer.solution.c)
            sizes = np.linalg.norm([*forces, _wanted(answer)[:3]], axis=1)
            self._scale(float(sizes.max()))
        if self._contacts is not None:
            self._contacts.show(moment, answer, forces, other, self.metres_per_newton, contacts)
        self._show_joints(moment, answer, joints)
        self._origin = moment.origin
        taken = np.zeros((0, 3)) if self._contacts is None else self._contacts.labelled
        self._wanted.show(moment.origin, _wanted(answer), self.metres_per_newton, taken)
        if applied is not None:
            self._applied.show(moment.origin, applied, self.metres_per_newton, taken)

    def _scale(self, largest: float) -> None:
        """Set the arrows' scale by the first forces; shorter where they would leave the view."""
        if largest > 0:
            size = self._subject.size
            if not self._first_scale:
                self._first_scale = _ARROW * size / largest
            self.metres_per_newton = min(self._first_scale, _LONGEST * size / largest)

    # ---- bodies ------------------------------------------------------------------------------

    def _show_bodies(self, bodies: tuple[Body, ...], moment: Moment) -> None:
        shown = self._shown_bodies
        if bodies != shown:  # a subject whose object changes its shape
            for name in {body.name for body in self._shown_bodies} - {b.name for b in bodies}:
                self._bodies.pop(name).remove()
            kept = {id(body) for body in self._shown_bodies}
            for body in bodies:
                if id(body) not in kept:
                    self._bodies[body.name] = self._add(body)
            self._shown_bodies = bodies
        if moment.poses is self._shown_poses and bodies == shown:
            return
        self._shown_poses = moment.poses
        for body in bodies:
            handle, pose = self._bodies[body.name], moment.poses.get(body.name)
            handle.visible = pose is not None
            if pose is not None:
                handle.position = pose.position
                handle.wxyz = shapes.quaternion(pose.rotation)

    def _add(self, body: Body) -> Any:
        handle = self._api.add_mesh_simple(
            f"/bodies/{body.role}/{body.name}".replace(" ", "_"), body.vertices, body.faces,
            color=colours.rgb(body.colour), flat_shading=len(body.vertices) < 100,
            opacity=body.opacity if body.opacity < 1 else None, side="double", cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip
        if body.role == "object":
            self._listen(handle)
        return handle

    def _listen(self, handle: Any) -> None:
        click, pull = self._on_click, self._on_pull
        if click is not None:

            @handle.on_click
            async def _(event: Any) -> None:
                click(np.array(event.ray_origin), np.array(event.ray_direction))

        if pull is not None:

            async def dragged(event: Any) -> None:
                if not self.metres_per_newton:
                    return
                way = np.subtract(event.end_position, event.start_position)
                wrench = np.append(way / self.metres_per_newton, np.zeros(3))
                if event.modifier == "shift":
                    wrench[3:] = np.cross(event.start_position - self._origin, wrench[:3])
                pull(wrench, event.phase == "end")

            handle.on_drag(dragged)
            handle.on_drag("left", modifier="shift")(dragged)

    # ---- joints ------------------------------------------------------------------------------

    def _show_joints(self, moment: Moment, answer: Answer | None, blamed: set[int]) -> None:
        known: NDArray[np.bool_] = np.all(np.isfinite(moment.joint_points), axis=1)
        points: Array = moment.joint_points[known]
        if answer is not None and answer.solved:
            colour = colours.of_share(answer.torque_use)[known]
        else:
            colour = _blamed(len(known), blamed)[known]
        if self._joints is not None and len(self._joints.batched_positions) != len(points):
            self._joints.remove()
            self._joints = None
        if not len(points):
            return
        if self._joints is None:
            vertices, faces = shapes.ball(_JOINT * self._subject.size)
            self._joints = self._api.add_batched_meshes_simple(
                "/joints", vertices, faces, np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1)),
                points, batched_colors=colour, lod="off", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            return
        self._joints.batched_positions = points
        self._joints.batched_colors = colour


class _WrenchArrows:
    """A wrench at a point: an arrow for the force, a thin one for the torque, and a label.

    The torque's arrow is as long as that of the force that has it at an arm of the object's size.
    """

    def __init__(self, api: Any, name: str, colour: str, size: float) -> None:
        self._size, self._name = size, name
        nothing = np.zeros((1, 2, 3))
        self._force, self._torque = (
            api.add_arrows(
                f"/{name}/{kind}", nothing, colours.rgb(colour), visible=False, **_radii(width)
            )
            for kind, width in (("force", size), ("torque", 0.6 * size))
        )
        self._label = api.add_label(f"/{name}/label", "", anchor="bottom-center", visible=False)

    def show(self, origin: Array, wrench: Array, scale: float, taken: Array) -> None:
        """Draw it.

        Args:
            origin: shape (3,) [m].
            wrench: [force; torque], shape (6,) [N, N·m].
            scale: [m/N].
            taken: where other labels are, shape (k, 3) [m].
        """
        force, torque = wrench[:3], wrench[3:] / self._size
        sizes = np.linalg.norm([force, torque], axis=1)
        # What is below a fiftieth of the other would be a dot.
        shown: list[bool] = [bool(each > 0.02 * sizes.max()) for each in sizes]
        longer = max((force, torque), key=lambda each: float(each @ each))
        self._force.visible, self._torque.visible = shown
        self._label.visible = any(shown)
        if not any(shown):
            return
        self._force.points = _arrows(origin[None], scale * force[None])
        self._torque.points = _arrows(origin[None], scale * torque[None])
        parts = (f"{sizes[0]:.2f} N", f"{self._size * sizes[1]:.3f} N·m")
        said = ", ".join(part for part, there in zip(parts, shown, strict=True) if there)
        self._label.text = f"{self._name} {said}"
        end = origin + scale * longer
        free = np.linalg.norm(taken - end, axis=1).min(initial=np.inf) > _CROWDED * self._size
        self._label.position = end if free else origin
        self._label.anchor = "bottom-center" if free else "top-center"


class _Contacts:
    """The drawing of a fixed number of contacts.

    Attributes:
        labelled: where there are labels now, shape (k, 3) [m].
    """

    def __init__(self, api: Any, n: int, size: float) -> None:
        self.n, self._size = n, size
        self.labelled: Array = np.zeros((0, 3))
        vertices, faces = shapes.cone()
        still = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        self._cones = api.add_batched_meshes_simple(
            "/cones", vertices, faces, still, np.zeros((n, 3)), batched_scales=np.ones((n, 3)),
            batched_colors=np.zeros((n, 3), np.uint8), opacity=_CONE_OPACITY, side="double",
            lod="off", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self._frames = api.add_batched_axes(
            "/contact_frames", still, np.zeros((n, 3)), axes_length=_FRAME * size,
            axes_radius=0.006 * size,
        )  # fmt: skip
        self._arrows = api.add_arrows(
            "/forces", np.zeros((n, 2, 3)), np.zeros((n, 3), np.uint8), **_radii(size)
        )
        self._others = api.add_arrows(
            "/other_forces", np.zeros((n, 2, 3)), colours.rgb(colours.OTHER),
            visible=False, **_radii(0.8 * size),
        )  # fmt: skip
        self._labels = [
            api.add_label(f"/force_labels/{i}", "", anchor="center-center") for i in range(n)
        ]

    def remove(self) -> None:
        for each in (self._cones, self._frames, self._arrows, self._others, *self._labels):
            each.remove()

    def show(
        self,
        moment: Moment,
        answer: Answer | None,
        forces: Array,
        other: Array | None,
        scale: float,
        blamed: set[int],
    ) -> None:
        points = np.array([each.point for each in moment.contacts])
        frames = np.array([each.frame for each in moment.contacts])
        normals = frames[:, :, 0]
        mu = np.array([each.model.mu for each in moment.contacts])
        rubs = np.array([each.model.dim > 1 for each in moment.contacts])
        here = np.ones(self.n)
        colour = _blamed(self.n, blamed)
        if answer is not None:
            mu, here = answer.problem.mu, answer.problem.active.astype(float)
            if answer.solved:
                colour = colours.of_share(answer.cone_use)
        wide = np.where(rubs, mu, 0.04)
        height = _CONE * self._size * here
        # Mirrored out of the object, around the arrow, so that both are in sight.
        # About its axis a cone looks the same: the contact frame, with the normal turned outwards
        # and in the place of z, does for it.
        self._cones.batched_wxyzs = shapes.quaternion(
            np.stack((frames[:, :, 2], frames[:, :, 1], -normals), axis=-1)
        )
        self._cones.batched_positions = points
        self._cones.batched_scales = np.column_stack((wide * height, wide * height, height)) + 1e-9
        self._cones.batched_colors = colour
        self._frames.batched_positions = points
        self._frames.batched_wxyzs = shapes.quaternion(frames)
        self._arrows.points = _arrows(points, scale * forces, at_head=True)
        self._arrows.colors = np.array(
            list(map(colours.rgb, colours.of_fingers(moment.fingers))), np.uint8
        )
        self._others.visible = other is not None
        if other is not None:
            self._others.points = _arrows(points, scale * other, at_head=True)
        # A finger has one label, with the force of all its contacts, at the one with the largest.
        # Of fingers that are close together the one that presses more has it.
        sizes = np.linalg.norm(forces, axis=1)
        names = list(map(colours.finger_of, moment.fingers))
        same = np.array([[a == b for b in names] for a in names])
        totals = np.linalg.norm(same @ forces, axis=1)
        near = same | (np.linalg.norm(points[:, None] - points, axis=2) < _PATCH * self._size)
        order = np.lexsort((-np.arange(self.n), sizes, totals)).argsort()
        behind = near & (order[None] > order[:, None]) & (here > 0)[None]
        for i, label in enumerate(self._labels):
            label.visible = bool(here[i]) and not behind[i].any()
            label.text = f"{names[i]}: {totals[i]:.2f} N"
            away = -normals[i] if sizes[i] == 0 else -forces[i] / sizes[i]
            label.position = points[i] + (scale * sizes[i] + _LABEL * self._size) * away
        self.labelled = np.array([each.position for each in self._labels if each.visible]).reshape(
            -1, 3
        )


def contact_forces(moment: Moment, c: Array) -> Array:
    """Return forces that are given in the contact frames, in world axes, shape (n, 3) [N]."""
    forces, start = np.zeros((len(moment.contacts), 3)), 0
    for i, contact in enumerate(moment.contacts):
        dim = contact.model.dim
        own = c[start : start + min(dim, 3)]
        forces[i] = contact.frame[:, : len(own)] @ own
        start += dim
    return forces


def _wanted(answer: Answer | None) -> Array:
    """Return the wrench that is asked for, shape (6,); three rows are x, y, the torque about z."""
    wrench, f = np.zeros(6), np.zeros(0) if answer is None else answer.problem.f
    places = [0, 1, 5] if len(f) == 3 else np.arange(min(len(f), 6))
    wrench[places] = f[: len(places)]
    return wrench


def _blamed(count: int, blamed: set[int]) -> Any:
    """Return grey for all but those that bind, which are red, shape (count, 3)."""
    names = [colours.RED if i in blamed else colours.GREY for i in range(count)]
    return np.array([colours.rgb(each) for each in names], np.uint8).reshape(-1, 3)


def _arrows(points: Array, vectors: Array, at_head: bool = False) -> Array:
    """Return the ends of arrows that begin, or end, at points, shape (n, 2, 3)."""
    ends = (points - vectors, points) if at_head else (points, points + vectors)
    return np.stack(ends, axis=1)


def _radii(size: float) -> dict[str, float]:
    return {
        "shaft_radius": _SHAFT * size,
        "head_radius": _HEAD * size,
        "head_length": _HEAD_LENGTH * size,
    }
