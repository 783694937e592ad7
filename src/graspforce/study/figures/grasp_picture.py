"""A picture of the paper's grasp: hand, cube, friction cones and contact forces (cf. Fig. 3).

Everything is made of facets in one collection, because matplotlib orders by depth within a
collection only. Forces are drawn as the fingers exert them, with the arrow's head at the contact;
the friction cone opens around the arrow, mirrored out of the object, so that both are in sight.
"""

# matplotlib does not annotate its **kwargs, nor its 3-D toolkit at all.
# pyright: reportUnknownMemberType=false, reportMissingTypeStubs=false

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from graspforce._util import plot
from graspforce._util.arrays import Array
from graspforce.errors import InvalidInputError
from graspforce.scenarios import Scenario
from graspforce.solve import solve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "The paper's grasp: the cube at rest in the hand, forces of least Phi"

_SCALE = 0.014  # length of an arrow [m/N]
_CONE = 0.034  # height of a drawn friction cone [m]
_LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])
_BASE, _KNEE, _TIP = 0.0070, 0.0060, 0.0034  # radii of the balls for joints and tips [m]
_SIDES = 24


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What the picture shows; world axes, the palm is the plane z = 0.

    Attributes:
        joints: base, knee and tip of every finger, shape (4, 3, 3) [m]: [finger, point, xyz].
        corners: of the cube, shape (8, 3) [m], in the order of the bits x, y, z.
        points: of the contacts, shape (4, 3) [m].
        normals: into the cube, shape (4, 3).
        forces: that the fingers exert on the cube, shape (4, 3) [N].
        mu: coefficients of friction, shape (4,).
        palm: half the palm's width [m].
    """

    joints: Array
    corners: Array
    points: Array
    normals: Array
    forces: Array
    mu: Array
    palm: float


def data(scenario: Scenario, t: float = 0.0) -> Data:
    """Return the picture's arrays: a scenario's grasp at time t [s], its forces solved.

    Raises:
        InvalidInputError: a contact is no point contact with friction, whose cone is drawn.
        InfeasibleGraspError: no force holds the grasp.
    """
    state = scenario.state(t)
    contacts = scenario.contacts_at(t)
    others = {type(each.model).__name__ for each in contacts if each.model.dim != 3}
    if others:
        raise InvalidInputError(
            f"scenario: got contacts of model {', '.join(sorted(others))}, expected PCWF alone"
        )
    c = solve(scenario.problem(t), check=True).c.reshape(4, 3)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return Data(
        joints=scenario.hand.joint_positions(scenario.joint_angles(t)),
        corners=state.position + scenario.cube.side / 2 * signs @ state.rotation.T,
        points=np.array([contact.point for contact in contacts]),
        normals=np.array([contact.normal for contact in contacts]),
        forces=np.array([each.frame @ force for each, force in zip(contacts, c, strict=True)]),
        mu=np.array([each.model.mu for each in contacts]),
        palm=scenario.hand.half_width,
    )


@dataclass(slots=True)
class _Facets:
    """Quadrilaterals, each list item shape (k, 4, 3) [m], and their colours, shape (k, 4)."""

    quads: list[Array] = field(default_factory=list[Array])
    colours: list[Array] = field(default_factory=list[Array])

    def add(self, grid: Array, colour: str, opacity: float = 1.0) -> None:
        """Add a surface through a grid of points, shape (rows, columns, 3), lit from the side."""
        near, far = grid[:-1], grid[1:]
        corners = (near[:, :-1], near[:, 1:], far[:, 1:], far[:, :-1])
        quads = np.stack(corners, axis=2).reshape(-1, 4, 3)
        # By the diagonals, because a cone's quads have an edge of no length at its tip.
        normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        light = 0.72 + 0.28 * np.abs(normals @ _LIGHT)
        rgb = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        self.quads.append(quads)
        self.colours.append(np.column_stack((np.outer(light, rgb), np.full(len(quads), opacity))))

    def tube(
        self, ends: tuple[Array, Array], radii: tuple[float, float], colour: str = "#8d99a8",
        opacity: float = 1.0, pieces: int = 6,
    ) -> None:  # fmt: skip
        """Add a cylinder, or a cone where the radii differ, cut into pieces along its axis."""
        start, end = ends
        ring = _ring(end - start)
        share = np.linspace(0, 1, pieces + 1)[:, None, None]
        radius = radii[0] + share * (radii[1] - radii[0])
        self.add(start + share * (end - start) + radius * ring, colour, opacity)

    def ball(self, centre: Array, radius: float, colour: str) -> None:
        """Add a sphere."""
        up = np.array([0.0, 0.0, 1.0])
        latitude = np.linspace(-np.pi / 2, np.pi / 2, 11)[:, None, None]
        shape = np.cos(latitude) * _ring(up) + np.sin(latitude) * up
        self.add(centre + radius * shape, colour)

    def plate(self, corners: Array, cells: int, colour: str, opacity: float = 1.0) -> None:
        """Add a parallelogram, three corners of which are given, cut into cells² pieces."""
        origin, u, v = corners[0], corners[1] - corners[0], corners[2] - corners[0]
        share = np.linspace(0, 1, cells + 1)
        self.add(origin + share[:, None, None] * u + share[:, None] * v, colour, opacity)


def _ring(axis: Array) -> Array:
    """Return points of the unit circle about an axis, closed, shape (_SIDES + 1, 3)."""
    axis = axis / np.linalg.norm(axis)
    u = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    u /= np.linalg.norm(u)
    angle = np.linspace(0, 2 * np.pi, _SIDES + 1)
    return np.outer(np.cos(angle), u) + np.outer(np.sin(angle), np.cross(axis, u))


def _facets(shown: Data) -> _Facets:
    facets = _Facets()
    p = shown.palm + _BASE
    facets.plate(np.array([[-p, -p, -_BASE], [p, -p, -_BASE], [-p, p, -_BASE]]), 10, "#d5dae1")
    corners = shown.corners
    for face in ((0, 1, 2), (4, 5, 6), (0, 1, 4), (2, 3, 6), (0, 2, 4), (1, 3, 5)):
        facets.plate(corners[list(face)], 8, "#f2c14e", 0.24)
    for i, j in itertools.combinations(range(8), 2):
        if (i ^ j).bit_count() == 1:
            facets.tube((corners[i], corners[j]), (0.0005, 0.0005), "#a9822b", pieces=12)
    for finger, colour in enumerate(plot.FINGERS):
        base, knee, tip = shown.joints[finger]
        for centre, radius in ((base, _BASE), (knee, _KNEE), (tip, _TIP)):
            facets.ball(centre, radius, "#4d5966")
        # Links begin where the balls end, because facets that cross cannot be put in order.
        first, second = (each / np.linalg.norm(each) for each in (knee - base, tip - knee))
        facets.tube((base + _BASE * first, knee - _KNEE * first), (0.0046, 0.0040))
        facets.tube((knee + _KNEE * second, tip - _TIP * second), (0.0040, 0.0026))
        contact, inward = shown.points[finger], shown.normals[finger]
        outside = contact - _CONE * inward
        cone = (0.0, _CONE * float(shown.mu[finger]))
        facets.tube((contact, outside), cone, colour, 0.16, pieces=3)
        force = shown.forces[finger]
        if not force.any():
            continue  # the finger is out of the grasp
        arrow = _SCALE * force
        neck = contact - 0.014 * force / np.linalg.norm(force)
        facets.tube((contact - arrow, neck), (0.0016, 0.0016), colour)
        facets.tube((neck, contact), (0.0046, 0.0), colour, pieces=2)
    return facets


def draw(shown: Data) -> Figure:
    """Draw the picture."""
    figure = plot.new_figure(height=4.8, width=6.4)
    figure.set_layout_engine("none")  # the axes are invisible: let them fill the figure
    from matplotlib.patheffects import withStroke
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d", computed_zorder=False)
    facets = _facets(shown)
    quads, colours = np.concatenate(facets.quads), np.concatenate(facets.colours)
    # Opaque neighbours overlap by a hairline, so that no background shines through.
    edges = np.column_stack((colours[:, :3], colours[:, 3] == 1))
    axes.add_collection3d(
        Poly3DCollection(
            list(quads), facecolors=colours, edgecolors=edges, linewidths=0.4, clip_on=False
        )
    )
    for finger, colour in enumerate(plot.FINGERS):
        size = float(np.linalg.norm(shown.forces[finger]))
        if size == 0:
            continue
        tail = shown.points[finger] - (_SCALE + 0.016 / size) * shown.forces[finger]
        axes.text(
            *tail, f"{size:.1f} N", color=colour, weight="bold", ha="center", va="center",
            path_effects=[withStroke(linewidth=3, foreground="white")], zorder=10,
        )  # fmt: skip
    axes.set_proj_type("persp", focal_length=0.9)
    axes.view_init(elev=27, azim=-127)
    low, high = quads.min(axis=(0, 1)), quads.max(axis=(0, 1))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.4)
    axes.set_axis_off()
    return figure
