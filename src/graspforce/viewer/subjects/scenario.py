"""The paper's scenarios as subjects: hand and cube from their dimensions, every tick a problem."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from graspforce._util.arrays import Array
from graspforce.contact import Contact
from graspforce.grasp import Grasp
from graspforce.scenarios import Scenario
from graspforce.trajectory import GRAVITY, wrench
from graspforce.viewer import colours, shapes
from graspforce.viewer.knobs import Knobs, Triple, rotation
from graspforce.viewer.moment import Body, Moment, Pose
from graspforce.viewer.problems import turn_knobs

_PALM, _BASE, _LINK, _TIP = 0.006, 0.0070, 0.0044, 0.0038  # thicknesses that are drawn [m]
# Of a normal force where the scenario has no ceiling and a finger is to leave, as in the paper [N].
CEILING = 20.0


class ScenarioSubject:
    """A scenario of the paper.

    Args:
        scenario: what is shown.
    """

    items: tuple[str, ...] = ()
    load_unit = "kg"
    busy = False
    fingers = tuple(f"finger {i + 1}" for i in range(4))
    controls = frozenset({"push", "tilt", "heading", "move", "turn"})

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self.title, self.summary = scenario.name, scenario.summary
        self.times: Array = scenario.times
        cube, hand = scenario.cube, scenario.hand
        self.size = cube.side
        self.knobs = Knobs(alpha=scenario.alpha, load=cube.mass)
        self.centre: Array = scenario.state(0.0).position * [1.0, 1.0, 0.8]
        palm = 2 * (hand.half_width + _BASE)
        bodies = [
            Body("cube", "object", *shapes.box([cube.side] * 3), colours.OBJECT, 0.35),
            Body("palm", "hand", *shapes.box([palm, palm, _PALM]), colours.PALM),
        ]
        for i in range(4):
            bodies += [
                Body(f"base {i + 1}", "hand", *shapes.ball(_BASE), colours.JOINT),
                shapes.link(f"proximal {i + 1}", "hand", hand.link, _LINK, colours.LINK),
                shapes.link(f"distal {i + 1}", "hand", hand.link, _TIP, colours.LINK),
            ]
        self._bodies = tuple(bodies)
        # Most knobs leave the geometry as it is.
        self._placed = lru_cache(1024)(self._place)

    def bodies(self, knobs: Knobs) -> tuple[Body, ...]:
        """Return hand and cube."""
        return self._bodies

    def alpha_of(self, item: int) -> float:
        """Return the alpha of the only grasp."""
        return self.knobs.alpha

    def work(self, seconds: float) -> None:
        """There is nothing to compute beforehand."""

    def moment(self, knobs: Knobs) -> Moment:
        """Return the grasp as the knobs have it.

        Raises:
            InvalidInputError: the cube is out of a finger's reach.
        """
        scenario, t = self._scenario, min(knobs.time, float(self.times[-1]))
        grasp, poses, joints = self._placed(t, knobs.move, knobs.turn)
        state, cube, mass = scenario.state(t), scenario.cube, knobs.load
        f = np.zeros(6)
        if mass > 0:
            f = wrench(
                mass,
                mass / cube.mass * cube.inertia,
                state.acceleration - GRAVITY * knobs.gravity,
                state.angular_velocity,
                state.angular_acceleration,
                gravity=0.0,
            )
        f -= knobs.applied
        problem = turn_knobs(
            grasp.problem(f), knobs, scenario.engagement(t), scenario.c_max, CEILING
        )
        names = scenario.hand.joint_names
        return Moment(poses, grasp.contacts, grasp.origin, problem, self.fingers, names, joints)

    def _place(self, t: float, move: Triple, turn: Triple) -> tuple[Grasp, dict[str, Pose], Array]:
        """Return the grasp at a time, where the bodies are, and where the joints are."""
        scenario = self._scenario
        state = scenario.state(t)
        position, R = state.position + np.array(move), rotation(turn) @ state.rotation
        contacts = tuple(
            Contact(position + R @ c.point, R @ c.normal, c.model, R @ c.tangent)
            for c in scenario.contacts
        )
        q = scenario.hand.inverse_kinematics([contact.point for contact in contacts])
        points = scenario.hand.joint_positions(q)
        poses = {
            "cube": Pose(position, R),
            "palm": Pose(np.array([0.0, 0.0, -_BASE - _PALM / 2])),
        }
        for i, (base, knee, tip) in enumerate(points, 1):
            poses |= {
                f"base {i}": Pose(base),
                f"proximal {i}": shapes.along(base, knee),
                f"distal {i}": shapes.along(knee, tip),
            }
        # The first two joints of a finger are both at its base: the second is drawn a little above.
        lift = np.array([0.0, 0.0, 2.2 * _BASE])
        joints = np.array([each for base, knee, _ in points for each in (base, base + lift, knee)])
        return Grasp(contacts, scenario.hand, q, position), poses, joints
