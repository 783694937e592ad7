"""The same hand through every door: from_mjcf, from_urdf, from_mujoco and from_pinocchio.

Hands are written once, as joints and links, and put into the words of MJCF and of URDF. What
touches them is a free body of small balls, one beside each fingertip, so that any hand in any
posture is a grasp, in the simulator, too.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pytest

import graspforce as gf
from graspforce.hands import from_mjcf, from_urdf

mujoco = pytest.importorskip("mujoco")
pin = pytest.importorskip("pinocchio")

TIP, BALL, INTO = 0.006, 0.004, 1e-4  # radii, and how deep they touch [m]


class Joint(NamedTuple):
    """A joint, and the link behind it: a ball of some mass at ``at``, perhaps a fingertip there."""

    name: str
    parent: str  # the joint before, or "base"
    origin: tuple[float, float, float]
    axis: tuple[float, float, float] = (0, 1, 0)
    slides: bool = False
    effort: float = 1.0  # [N·m, N]; 0: no motor
    follows: tuple[str, float] | None = None  # a joint, and how much of its motion
    at: tuple[float, float, float] = (0, 0, 0.03)
    mass: float = 0.04
    tip: bool = False
    spring: str = ""  # attributes of MJCF, which URDF has no words for


@dataclass(frozen=True)
class Robot:
    """Joints, what only MJCF can say of them, and a posture of the joints that move by themselves.

    ``motors`` are MJCF's actuators, where they are not one for every effort.
    """

    joints: tuple[Joint, ...]
    q: dict[str, float]
    motors: str | None = None
    extra: str = ""

    @property
    def tips(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints if joint.tip)

    @property
    def in_urdf(self) -> bool:
        return self.motors is None and not any(joint.spring for joint in self.joints)

    def angle(self, joint: Joint) -> float:
        if joint.follows:
            return joint.follows[1] * self.q[joint.follows[0]]
        return self.q.get(joint.name, 0.0)


def text(numbers) -> str:
    return " ".join(f"{float(each)!r}" for each in numbers)


def mjcf(robot: Robot, world: str = "") -> str:
    def branch(parent: str) -> str:
        return "".join(
            f"""<body name="{j.name}" pos="{text(j.origin)}">
            <joint name="{j.name}" axis="{text(j.axis)}" type="{"slide" if j.slides else "hinge"}"
              {j.spring}/>
            <inertial pos="{text(j.at)}" mass="{j.mass}" diaginertia="1e-5 1e-5 1e-5"/>
            {f'<geom name="{j.name}" pos="{text(j.at)}" size="{TIP}"/>' if j.tip else ""}
            {branch(j.name)}</body>"""
            for j in robot.joints
            if j.parent == parent
        )

    motors = robot.motors
    if motors is None:
        motors = "".join(
            f'<motor joint="{j.name}" ctrlrange="-{j.effort} {j.effort}"/>'
            for j in robot.joints
            if j.effort and not j.follows
        )
    follow = "".join(
        f'<joint joint1="{j.name}" joint2="{j.follows[0]}" polycoef="0 {j.follows[1]} 0 0 0"/>'
        for j in robot.joints
        if j.follows
    )
    return f"""<mujoco><compiler angle="radian" autolimits="true"/>
      <option cone="elliptic" gravity="0 0 -9.81"/><default><geom condim="4"
      friction=".7 .004 .0001"/></default>
      <worldbody>{branch("base")}{world}</worldbody><equality>{follow}</equality>
      <actuator>{motors}</actuator>{robot.extra}</mujoco>"""


def urdf(robot: Robot) -> str:
    words = '<robot name="r"><link name="base"/>'
    for j in robot.joints:
        kind = "prismatic" if j.slides else "revolute"
        mimic = f'<mimic joint="{j.follows[0]}" multiplier="{j.follows[1]}"/>' if j.follows else ""
        words += f"""<link name="{j.name}"><inertial><origin xyz="{text(j.at)}"/>
          <mass value="{j.mass}"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0"
          iyz="0"/></inertial></link><joint name="{j.name}" type="{kind}">
          <parent link="{j.parent}"/><child link="{j.name}"/><origin xyz="{text(j.origin)}"/>
          <axis xyz="{text(j.axis)}"/>
          <limit effort="{j.effort}" velocity="1" lower="-3" upper="3"/>{mimic}</joint>"""
    return words + "</robot>"


def grasped(robot: Robot):
    """A simulation of the robot with a ball beside each tip, pushed by it towards their middle."""
    alone = mujoco.MjModel.from_xml_string(mjcf(robot))
    data = mujoco.MjData(alone)
    for joint in robot.joints:
        data.qpos[alone.joint(joint.name).qposadr[0]] = robot.angle(joint)
    mujoco.mj_kinematics(alone, data)
    tips = np.array([data.geom(name).xpos for name in robot.tips])
    inwards = tips.mean(axis=0) - tips
    inwards /= np.linalg.norm(inwards, axis=1)[:, None]
    balls = "".join(
        f'<geom size="{BALL}" mass=".01" pos="{text(place)}"/>'
        for place in tips + (TIP + BALL - INTO) * inwards
    )
    held = mjcf(robot, f'<body name="object"><freejoint/>{balls}</body>')
    model = mujoco.MjModel.from_xml_string(held)
    simulation = mujoco.MjData(model)
    simulation.qpos[: alone.nq] = data.qpos
    mujoco.mj_forward(model, simulation)
    return model, simulation


def finger(name, side, *, parent="base", origin=(0, 0, 0), **more):
    """Two joints that bend a fingertip towards the middle, from the left (1) or right (-1)."""
    x, y, z = origin
    return (
        Joint(f"{name}1", parent, (x - 0.05 * side, y, z), (0, 1, 0), **more),
        Joint(f"{name}2", f"{name}1", (0, 0.002, 0.05), (0.1, 1, 0), tip=True, **more),
    )


ARM = (
    Joint("arm1", "base", (0, 0, 0.1), (0, 0, 1), effort=30, mass=1.0, at=(0, 0, 0.1)),
    Joint("arm2", "arm1", (0, 0, 0.2), (0, 1, 0), effort=30, mass=0.8, at=(0, 0, 0.15)),
    Joint("arm3", "arm2", (0, 0, 0.3), (1, 0, 0), effort=30, mass=0.5, at=(0, 0, 0.05)),
)
ON_ARM = {"parent": "arm3", "origin": (0, 0, 0.1)}
JAW = {"slides": True, "tip": True, "at": (0, 0, 0.05)}
THIRD = {"f": (0.03, 0.0), "g": (-0.015, 0.026), "h": (-0.015, -0.026)}  # feet of three fingers
SHARED = {f"{name}{i}": 0.2 + 0.1 * i for name in "lr" for i in (1, 2)}


def three_fingers(coupled: bool, **more):
    """Fingers in a circle; the outer joint follows, or has a motor of its own."""
    for name, (x, y) in THIRD.items():
        axis = tuple(np.cross([0, 0, 1], [x, y, 0]) / -0.03)
        yield Joint(f"{name}1", "base", (2 * x, 2 * y, 0), axis, **more)
        follows = (f"{name}1", 1 / 3) if coupled else None
        yield Joint(f"{name}2", f"{name}1", (0, 0, 0.07), axis, follows=follows, tip=True, **more)


def two_tendons_a_joint(**more) -> Robot:
    """Three fingers whose joints are pulled both ways."""
    each = [(n, i) for n in THIRD for i in (1, 2)]
    return Robot(
        tuple(three_fingers(coupled=False, effort=0.0, **more)),
        CURLED,
        "".join(
            f'<motor name="{way} {n}{i}" tendon="{way}{n}{i}" ctrlrange="0 {force}"/>'
            for n, i in each
            for way, force in (("flex", 90), ("extend", 40))
        ),
        "<tendon>"
        + "".join(
            f'<fixed name="{way}{n}{i}"><joint joint="{n}{i}" coef="{arm}"/></fixed>'
            for n, i in each
            for way, arm in (("flex", 0.01), ("extend", -0.012))
        )
        + "</tendon>",
    )


CURLED = {f"{name}{i}": 0.3 for name in THIRD for i in (1, 2)}
ROBOTS = {
    "one joint": Robot(
        (
            Joint("jaw", "base", (0.03, 0, 0), tip=True),
            Joint("other", "base", (-0.03, 0, 0), follows=("jaw", -0.5), tip=True),
        ),
        {"jaw": -0.2},
    ),
    "jaws of two motors": Robot(
        (
            Joint("left", "base", (-0.02, 0, 0), (1, 0, 0), effort=20, **JAW),
            Joint("right", "base", (0.02, 0, 0.001), (-1, 0, 0), effort=25, **JAW),
        ),
        {"left": 0.004, "right": 0.003},
    ),
    "jaws of one motor": Robot(
        (
            Joint("left", "base", (-0.02, 0, 0), (1, 0, 0), effort=20, **JAW),
            Joint("right", "base", (0.02, 0, 0.001), (-1, 0, 0), follows=("left", 1.0), **JAW),
        ),
        {"left": 0.004},
    ),
    "coupled joints": Robot(tuple(three_fingers(coupled=True)), CURLED),
    "three fingers": Robot(tuple(three_fingers(coupled=False)), CURLED),
    "a hand on an arm": Robot(
        (*ARM, *finger("l", 1, **ON_ARM), *finger("r", -1, **ON_ARM)),
        {"arm1": 0.4, "arm2": 0.7, "arm3": -0.3, "l1": 0.4, "l2": 0.2, "r1": -0.3, "r2": -0.2},
    ),
    "two hands": Robot(
        tuple(
            joint
            for side, names in ((1, "ab"), (-1, "cd"))
            for joint in (
                Joint(f"arm{side}", "base", (-0.3 * side, 0, 0), (0, 1, 0), effort=20, mass=0.6),
                *finger(names[0], side, parent=f"arm{side}", origin=(0.2 * side, 0.03, 0.1)),
                *finger(names[1], side, parent=f"arm{side}", origin=(0.2 * side, -0.03, 0.1)),
            )
        ),
        {"arm1": 0.1, "arm-1": -0.2, "a1": 0.3, "b1": 0.2, "c1": -0.3, "d2": 0.2},
    ),
    "a joint without a motor": Robot(
        tuple(
            joint._replace(effort=0.0) if joint.name == "f2" else joint
            for joint in three_fingers(coupled=False)
        ),
        CURLED,
    ),
    "springs": Robot(
        tuple(three_fingers(coupled=False, spring='stiffness=".3" springref="-.4"')), CURLED
    ),
    "tendons": Robot(
        tuple(three_fingers(coupled=False, effort=0.0)),
        CURLED,
        "".join(f'<motor name="pull {n}" tendon="{n}" ctrlrange="0 60"/>' for n in THIRD),
        "<tendon>"
        + "".join(
            f'<fixed name="{n}"><joint joint="{n}1" coef=".035"/><joint joint="{n}2" coef=".008"/>'
            "</fixed>"
            for n in THIRD
        )
        + "</tendon>",
    ),
    "antagonists": two_tendons_a_joint(),
    "tendons over joints of little torque": two_tendons_a_joint(
        spring='actuatorfrcrange="-.09 .25"'
    ),
    "a soft fingertip on gears": Robot(
        tuple(three_fingers(coupled=False)),
        CURLED,
        "".join(
            f'<position joint="{n}{i}" gear="{2 + i}" kp="4" forcerange="-.2 .3"/>'
            for n in THIRD
            for i in (1, 2)
        ),
    ),
}


def doors(robot: Robot, folder) -> dict[str, gf.Grasp]:
    """The grasp as each door that knows the robot's words reads it."""
    model, data = grasped(robot)
    read = gf.Grasp.from_mujoco(model, data, "object")
    contacts, links, origin = read.contacts, read.links, read.origin
    assert sorted(links) == sorted(robot.tips)

    def through(hand) -> gf.Grasp:
        q = [next(robot.angle(j) for j in robot.joints if j.name == n) for n in hand.q_names]
        return gf.Grasp(contacts, hand.touching(links), q, origin)

    found = {"from_mujoco": read, "from_mjcf": through(from_mjcf(model, robot.tips))}
    if robot.in_urdf:
        path = folder / "robot.urdf"
        path.write_text(urdf(robot), encoding="utf-8")
        found["from_urdf"] = through(from_urdf(path, robot.tips))
        whole = pin.buildModelFromUrdf(str(path))
        q = [next(robot.angle(j) for j in robot.joints if j.name == n) for n in whole.names[1:]]
        found["from_pinocchio"] = gf.Grasp.from_pinocchio(
            whole, q, contacts, links, origin=origin, urdf=path
        )
    return found


@pytest.fixture(params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]


@pytest.fixture
def grasps(robot, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gf.GraspForceWarning)  # joints without a motor
        return doors(robot, tmp_path)


def by_name(grasp: gf.Grasp, values) -> np.ndarray:
    """Values of the joints, last axis, in the order of their names."""
    return np.asarray(values)[..., np.argsort(grasp.joint_names)]


def test_every_door_gives_the_same_problem(robot, grasps):
    first = grasps["from_mujoco"]
    assert len(grasps) == (4 if robot.in_urdf else 2)
    for name, grasp in grasps.items():
        assert sorted(grasp.joint_names) == sorted(first.joint_names), name
        for field in ("J", "tau_lo", "tau_hi", "tau_bias"):
            mine, theirs = (by_name(each, getattr(each, field)) for each in (grasp, first))
            np.testing.assert_allclose(mine, theirs, atol=1e-9, err_msg=f"{name}: {field}")
        assert len(grasp.passive_rows) == len(first.passive_rows), name
        # Of motions that nothing drives any basis will do.
        spans = [np.linalg.pinv(each.passive_rows) @ each.passive_rows for each in (grasp, first)]
        np.testing.assert_allclose(*spans, atol=1e-9, err_msg=name)
        assert grasp.internal.shape == first.internal.shape, name
        np.testing.assert_allclose(grasp.A, first.A, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(grasp.b, first.b, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("load", [0.3, 300.0], ids=["light", "heavy"])
def test_every_door_gives_the_same_verdict(grasps, load):
    answers = {
        name: gf.solve(grasp.problem(np.array([0.1, 0, 1, 0, 0, 0]) * load))
        for name, grasp in grasps.items()
    }
    first = answers["from_mujoco"]
    assert first.status is (gf.Status.SOLVED if load < 1 else gf.Status.INFEASIBLE)
    for name, answer in answers.items():
        assert answer.status is first.status, name
        np.testing.assert_allclose(answer.c, first.c, atol=1e-6 * (1 + np.abs(first.c).max()))
        if answer.tau.size:
            mine, theirs = (
                by_name(grasps[each], answers[each].tau) for each in (name, "from_mujoco")
            )
            np.testing.assert_allclose(mine, theirs, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("name", [name for name, robot in ROBOTS.items() if robot.motors is None])
def test_j_is_how_the_fingertips_move(name):
    """Against differences of positions; that of the other doors is the same."""
    robot = ROBOTS[name]
    model, data = grasped(robot)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gf.GraspForceWarning)
        grasp = gf.Grasp.from_mujoco(model, data, "object")
    starts = np.cumsum([0] + [each.dim for each in grasp.models])
    for j, joint in enumerate(grasp.joint_names):
        moved = []
        for step in (1e-6, -1e-6):
            state = mujoco.MjData(model)
            state.qpos[:] = data.qpos
            for each in robot.joints:
                scale = 1 if each.name == joint else 0
                if each.follows and each.follows[0] == joint:
                    scale = each.follows[1]
                state.qpos[model.joint(each.name).qposadr[0]] += scale * step
            mujoco.mj_kinematics(model, state)
            moved.append(
                [
                    state.body(link).xpos
                    + state.body(link).xmat.reshape(3, 3)
                    @ data.body(link).xmat.reshape(3, 3).T
                    @ (contact.point - data.body(link).xpos)
                    for link, contact in zip(grasp.links, grasp.contacts, strict=True)
                ]
            )
        speeds = (np.array(moved[0]) - moved[1]) / 2e-6
        for i, (contact, speed) in enumerate(zip(grasp.contacts, speeds, strict=True)):
            expected = contact.frame.T @ speed
            np.testing.assert_allclose(grasp.J[starts[i] : starts[i] + 3, j], expected, atol=1e-6)


def test_a_tendon_of_the_name_of_a_joint_is_not_that_joints_motor():
    """MuJoCo keeps names by kind: the only tendon at joint f1 may be called f1, too."""
    robot = ROBOTS["tendons"]
    joints = tuple(j._replace(spring='actuatorfrcrange="-.09 .25"') for j in robot.joints)
    plain = replace(robot, joints=joints)
    named = replace(
        plain,
        motors=plain.motors.replace('tendon="f"', 'tendon="f1"'),
        extra=plain.extra.replace('name="f"', 'name="f1"'),
    )
    with pytest.warns(gf.GraspForceWarning, match="no motor controls"):
        first, other = (gf.Grasp.from_mujoco(*grasped(each), "object") for each in (plain, named))
    assert "f1" in other.joint_names
    assert len(first.A) == 12  # both ends at six joints
    np.testing.assert_array_equal(other.A, first.A)


@pytest.mark.parametrize("limited", [True, False])
def test_what_tendons_do_at_a_joint_is_not_cut_off(limited):
    """MuJoCo says what comes of the motor forces: it cuts off what leaves actuatorfrcrange."""
    robot = ROBOTS["tendons over joints of little torque"]
    model, data = grasped(robot)
    if not limited:  # as if the file did not say so
        model.jnt_actfrclimited[:] = 0
    grasp = gf.Grasp.from_mujoco(model, data, "object")
    said = [note for note in grasp.notes if "all motors together" in note]
    assert len(said) == limited
    assert all("'f1' -0.09 to 0.25" in note for note in said)
    direction = np.array([0.1, 0, 1, 0, 0, 0])
    most = gf.payload.along(grasp.problem(np.zeros(6)), direction).lower
    answer = gf.solve(grasp.problem(0.99 * most * direction), check=True)
    assert answer.status is gf.Status.SOLVED
    model.jnt_actfrclimited[:6] = 1
    tendons = [grasp.joint_names.index(model.tendon(i).name) for i in range(model.ntendon)]
    data.ctrl[:] = answer.motor_forces[tendons]
    mujoco.mj_forward(model, data)
    arms = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        arms, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    cut_off = data.actuator_force @ arms - data.qfrc_actuator
    assert (np.abs(cut_off).max() < 1e-12) == limited
    if limited:  # and what it leaves is used
        reserve = np.minimum(0.25 - data.qfrc_actuator[:6], data.qfrc_actuator[:6] + 0.09)
        assert reserve.min() < 0.003
