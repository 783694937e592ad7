"""Objects that are no free bodies: doors, drawers, lids; and what stands in a corner."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import graspforce as gf
from graspforce.hands import MujocoGrasp

HEAD = """<mujoco><compiler angle="radian" autolimits="true"/>
  <option cone="elliptic" impratio="100" noslip_iterations="5" timestep=".001"
    integrator="implicitfast"/>
  <default><geom friction="1" solref=".004 1"/>
    <joint damping=".02" armature=".001" solreflimit=".002 1"/></default>"""


def pusher(name, pos, axis):
    """A ball on a slide with a motor."""
    return f"""<body name="{name}" pos="{pos}"><joint name="{name}" type="slide" axis="{axis}"/>
      <geom size=".01" mass=".1"/></body>"""


def settled(world, ctrl, steps=4000):
    motors = "".join(f'<motor joint="{name}" ctrlrange="-30 30"/>' for name in ctrl)
    model = mujoco.MjModel.from_xml_string(
        f"{HEAD}<worldbody>{world}</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    data.ctrl[:] = list(ctrl.values())
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return model, data


def read(model, data, name):
    """Return the grasp and the physics' forces, whose torques are the motors'."""
    grasp, reader = gf.Grasp.from_mujoco(model, data, name), MujocoGrasp(model, data, name)
    c = reader.contact_forces(data)
    by_motor = [data.qfrc_actuator[model.joint(each).dofadr[0]] for each in grasp.joint_names]
    np.testing.assert_allclose(grasp.J.T @ c + grasp.tau_bias, by_motor, atol=1e-3)
    assert grasp.notes == (*reader.notes, *grasp.notes[len(reader.notes) :])
    return grasp, c


RAIL = '<joint name="rail" type="slide" axis="1 0 0" stiffness="300" damping="30"/>'
HINGE = '<joint name="hinge" axis="0 0 1" pos=".03 -.2 0" stiffness="5"/>'
BALL = '<joint name="pivot" type="ball" stiffness="5" damping=".1"/>'
ON_JOINTS = {
    "a drawer": (
        f'<body name="it" pos="0 0 .1">{RAIL}<geom type="box" size=".05 .1 .05" mass="2"/></body>'
        + pusher("p", "-.0605 .03 .12", "1 0 0"),
        {"p": 5.0}, "rail", 1,
    ),
    "a door, its hinge beside it": (
        f'<body name="it" pos="0 0 .3">{HINGE}<geom type="box" size=".01 .2 .3" mass="3"/></body>'
        + pusher("p", "-.0205 .1 .3", "1 0 0") + pusher("q", "-.0205 -.1 .4", "1 0 0"),
        {"p": 5.0, "q": 3.0}, "hinge", 1,
    ),
    "a door that slides and turns": (
        f'<body pos="0 0 .3">{RAIL}<geom size=".01" pos=".03 0 1" mass=".2"/>'
        f'<body name="it">{HINGE}<geom type="box" size=".01 .2 .3" mass="3"/></body></body>'
        + pusher("p", "-.0205 .1 .3", "1 0 0") + pusher("q", "-.0205 -.1 .4", "1 0 0"),
        {"p": 5.0, "q": 3.0}, "rail, hinge", 2,
    ),
    "a lid on a ball joint": (
        f'<body name="it" pos="0 0 .3">{BALL}<geom type="box" pos=".1 0 0" size=".1 .05 .01" '
        'mass=".3"/></body>' + pusher("p", ".15 .01 .2795", "0 0 1")
        + pusher("q", ".1 -.02 .2795", "0 0 1") + pusher("r", ".1 .0605 .3", "0 -1 0"),
        {"p": 2.5, "q": 2.5, "r": 1.0}, "pivot", 3,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ON_JOINTS)
def test_only_what_works_along_its_joints_is_asked_for(case):
    world, ctrl, joints, count = ON_JOINTS[case]
    model, data = settled(world, ctrl)
    grasp, c = read(model, data, "it")
    (note,) = [each for each in grasp.notes if each.startswith("'it' moves by")]
    assert f"'it' moves by {joints} alone: of f only what works along these motions" in note
    # What the contacts do at the object's joints is what springs and gravity need there.
    dofs = [model.joint(name).dofadr[0] + i for name in joints.split(", ")
            for i in range(3 if name == "pivot" else 1)]  # fmt: skip
    np.testing.assert_allclose(grasp.motions.T @ grasp.W @ c, data.qfrc_constraint[dofs], atol=1e-9)
    wrench = grasp.W @ c
    problem = grasp.problem(wrench)
    assert problem.W.shape == (count, grasp.W.shape[1])
    # What the object's joints bear tells nothing of the contacts.
    told = np.vstack((grasp.motions.T @ grasp.W, grasp.passive_rows, grasp.J.T))
    assert grasp.undetermined == len(grasp.J) - np.linalg.matrix_rank(told, 1e-9)
    assert any(each.startswith(f"{grasp.undetermined} of ") for each in grasp.notes)
    solution = gf.solve(problem, check=True)
    done = grasp.motions.T @ (grasp.W @ solution.c - wrench)
    np.testing.assert_allclose(done, 0, atol=1e-7)
    assert solution.verify().ok


def test_what_joints_bear_is_missed_at_no_cost():
    """With f_soft the misses across the rail cost nothing; along it they cost what they do."""
    world, ctrl, _, _ = ON_JOINTS["a drawer"]
    grasp, _ = read(*settled(world, ctrl), "it")
    soft = np.array([0.2, 0.1, 0.3, 0.01, 0.02, 0.03])
    wrench = [4.0, 100.0, -50.0, 3.0, 2.0, 1.0]
    solution = gf.solve(grasp.problem(wrench, f_soft=soft), check=True)
    alone = gf.ForceProblem(grasp.W[:1], [4.0], grasp.models, grasp.J, grasp.tau_lo, grasp.tau_hi,
                            grasp.tau_bias, f_soft=0.2)  # fmt: skip
    np.testing.assert_allclose(solution.c, gf.solve(alone, check=True).c, rtol=1e-6)
    hard = gf.solve(grasp.problem(wrench, f_soft=0.0), check=True)
    assert grasp.W[0] @ hard.c == pytest.approx(4.0)


def test_two_motions_with_a_soft_wrench_are_those_of_the_bearings():
    """The least of ½ ‖(W c + bearing − f)/f_soft‖² over what the bearings may bear."""
    world, ctrl, _, _ = ON_JOINTS["a door that slides and turns"]
    grasp, _ = read(*settled(world, ctrl), "it")
    soft = np.array([0.2, 0.1, 0.3, 0.01, 0.02, 0.03])
    wrench = np.array([4.0, 1.0, -5.0, 0.3, 0.2, 1.0])
    problem = grasp.problem(wrench, f_soft=soft)
    bearing = np.linalg.svd(grasp.motions.T)[2][2:].T  # wrenches without work on the two motions
    rng = np.random.default_rng(3)
    for c in rng.standard_normal((5, grasp.W.shape[1])):
        miss = (grasp.W @ c - wrench) / soft
        left = miss - (bearing.T / soft).T @ np.linalg.lstsq((bearing.T / soft).T, miss)[0]
        own = (problem.W @ c - problem.f) / problem.f_soft
        assert own @ own == pytest.approx(left @ left, rel=1e-9)


def test_an_object_that_motors_carry_is_asked_for_all():
    world, ctrl, _, _ = ON_JOINTS["a drawer"]
    model, data = settled(world, ctrl | {"rail": 0.0})
    grasp = gf.Grasp.from_mujoco(model, data, "it")
    assert grasp.motions is None
    assert grasp.problem(np.zeros(6)).W.shape == (6, 3)


def test_a_lid_that_floats_with_its_box_says_whom_to_hold():
    model, data = settled(BOX.format(range="0 2") + pusher("p", ".03 0 .1145", "0 0 -1"), {"p": 3})
    grasp = gf.Grasp.from_mujoco(model, data, "lid")
    assert grasp.motions is None
    (note,) = [each for each in grasp.notes if "hangs by" in each]
    assert "'lid' hangs by hinge on 'box', which floats" in note
    assert "object_body='box'" in note


# ---- what moves on the object ------------------------------------------------------------------

BOX = """<geom name="table" type="plane" size="1 1 .1"/>
  <body name="box" pos="0 0 .0499"><freejoint/>
  <geom type="box" size=".05 .05 .04" pos="0 0 -.01" mass=".5"/>
  <body name="lid" pos="-.05 0 .04"><joint name="hinge" axis="0 -1 0" range="{range}"/>
    <geom type="box" pos=".05 0 .006" size=".05 .05 .004" mass=".1"/></body></body>"""
WEIGHT = [0, 0, 0.6 * 9.81, 0, 0, 0]


def test_a_shut_lid_bears_what_is_pressed_on_it():
    """Its stop takes it: without, the lid's contact may only carry the lid's weight."""
    press = pusher("p", ".03 0 .1145", "0 0 -1")
    model, data = settled(BOX.format(range="0 2") + press, {"p": 3.0})
    grasp, c = read(model, data, "box")
    assert "at a stop, which can push off what no motor moves, and not pull: hinge" in grasp.notes
    assert "f has to hold what moves on 'box' too: lid (0.1 kg, by hinge)" in grasp.notes
    assert len(grasp.passive_rows) == 0
    stop = data.qfrc_constraint[model.joint("hinge").dofadr[0]]
    hinge = grasp.b - grasp.A @ c
    assert hinge[0] > 0.1
    # The constraint's force at the hinge is the stop's less what presses on the lid.
    pressing = grasp.A @ c
    np.testing.assert_allclose(stop, hinge + pressing, atol=1e-6)
    np.testing.assert_allclose(grasp.W @ c, WEIGHT, atol=1e-6)
    assert gf.solve(grasp.problem(WEIGHT)).status is gf.Status.SOLVED


def test_a_loose_lid_may_only_be_given_what_it_weighs():
    press = pusher("p", ".03 0 .1098", "0 0 -1")
    model, data = settled(BOX.format(range="-3 3") + press, {"p": 3.0}, steps=1)
    with pytest.warns(UserWarning, match="no motor controls 'hinge'"):
        grasp = gf.Grasp.from_mujoco(model, data, "box")
    assert len(grasp.passive_rows) == 1
    assert "f has to hold what moves on 'box' too: lid (0.1 kg, by hinge)" in grasp.notes
    # Pressed from above, the lid would turn through the box's rim: nothing bears that.
    assert gf.solve(grasp.problem(WEIGHT)).status is gf.Status.INFEASIBLE


# ---- contacts with the world -------------------------------------------------------------------

CUBE = """<body name="cube" pos="0 0 .03"><freejoint/>
  <geom type="box" size=".03 .03 .03" mass=".3"/></body>"""
TABLE = '<geom name="table" type="plane" size="1 1 .1"/>'


def test_pressed_on_a_table():
    press = pusher("p", ".005 0 .0705", "0 0 -1")
    grasp, c = read(*settled(CUBE + TABLE + press, {"p": 4.0}), "cube")
    np.testing.assert_allclose(grasp.W @ c, [0, 0, 0.3 * 9.81, 0, 0, 0], atol=1e-6)
    (note,) = grasp.notes
    assert note.startswith("8 of 15 force components are undetermined")
    problem = grasp.problem([0, 0, 0.3 * 9.81, 0, 0, 0])
    assert problem.A.shape == (0, 15)  # the table alone cannot squeeze
    solution = gf.solve(problem, check=True)
    assert (solution.normal_forces > 0).all()


WEDGES = {
    "a groove": (
        '<geom type="box" size=".1 .1 .01" pos="-.06 0 .05" euler="0 .9 0" friction="1.5"/>'
        '<geom type="box" size=".1 .1 .01" pos=".06 0 .05" euler="0 -.9 0" friction="1.5"/>'
        '<body name="cube" pos="0 0 .12"><freejoint/><geom size=".04" mass=".3"/></body>'
        + pusher("p", "0 0 .21", "0 0 -1"), {"p": 4.0}, "world",
    ),
    "between two walls": (
        CUBE + TABLE
        + '<geom type="box" size=".01 .2 .2" pos=".0399 0 .2"/>'
        + '<geom type="box" size=".01 .2 .2" pos="-.0399 0 .2"/>'
        + pusher("p", "0 0 .0699", "0 0 -1"), {"p": 4.0}, "world",
    ),
    "a fork": (
        CUBE + '<body name="fork" pos="0 0 .03"><joint name="p" type="slide" axis="0 0 1"/>'
        '<geom type="box" size=".01 .02 .02" pos=".0399 0 0" mass=".1"/>'
        '<geom type="box" size=".01 .02 .02" pos="-.0399 0 0" mass=".1"/></body>',
        {"p": 4.9}, "fork",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WEDGES)
def test_what_squeezes_without_a_motor_has_a_ceiling(case):
    world, ctrl, who = WEDGES[case]
    model, data = settled(world, ctrl, steps=1500 if case == "a groove" else 1)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    (note,) = [each for each in grasp.notes if each.startswith("no motor limits how hard")]
    assert who in note
    wrench = np.array([0, 0, 0.3 * 9.81, 0, 0, 0])
    solution = gf.solve(grasp.problem(wrench), check=True)
    assert solution.verify().ok
    assert solution.normal_forces.max() < 1e3
    # A ceiling of the user's takes its place, and his own inequalities stay.
    problem = grasp.problem(wrench, c_max=300.0)
    assert problem.A.shape[0] == 0
    row = np.zeros((1, grasp.W.shape[1]))
    row[0, 0] = 1.0
    more = grasp.problem(wrench, A=row, b=[7.0])
    np.testing.assert_array_equal(more.A[0], row[0])
    assert more.b[0] == 7.0
    assert len(more.A) > 1
    with pytest.raises(gf.InvalidInputError, match="b: missing"):
        grasp.problem(wrench, A=row)


def test_a_gripper_whose_links_share_the_load_has_no_ceiling():
    """Flat pads: motors cannot tell their corners apart, yet they limit every squeeze."""
    jaws = "".join(
        f"""<body pos="{0.0499 * s} 0 .03"><joint name="jaw{s}" type="slide" axis="{-s} 0 0"/>
          <geom type="box" size=".02 .02 .02" mass=".1"/></body>"""
        for s in (1, -1)
    )
    model, data = settled(CUBE + jaws, {"jaw1": 5.0, "jaw-1": 5.0}, steps=1)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert len(grasp.contacts) == 8
    assert grasp.problem([0, 0, 3, 0, 0, 0]).A.shape[0] == 0
    (note,) = grasp.notes
    assert note.startswith("17 of 24 force components are undetermined")


def test_two_hands_on_a_bar():
    def hand(name, x):
        jaws = "".join(
            f"""<body pos="{x} {0.0505 * s} .1"><joint name="{name}{s}" type="slide"
              axis="0 {-s} 0"/><geom size=".01" mass=".05"/></body>"""
            for s in (1, -1)
        )
        return f"""<body><joint name="{name}" type="slide" axis="0 0 1"/>
          <geom size=".01" pos="{x} 0 .3" mass=".1"/>{jaws}</body>"""

    bar = """<body name="bar" pos="0 0 .1"><freejoint/>
      <geom type="box" size=".2 .04 .02" mass="1"/></body>"""
    lift = 0.5 * (1 + 4 * 0.05 + 2 * 0.1) * 9.81
    ctrl = dict.fromkeys(("l1", "l-1", "r1", "r-1"), 20.0) | {"l": lift, "r": lift}
    grasp, c = read(*settled(hand("l", -0.15) + hand("r", 0.15) + bar, ctrl, steps=1500), "bar")
    weight = [0, 0, 9.81, 0, 0, 0]
    np.testing.assert_allclose(grasp.W @ c, weight, atol=1e-4)
    solution = gf.solve(grasp.problem(weight), check=True)
    lifting = [grasp.joint_names.index(name) for name in "lr"]
    np.testing.assert_allclose(solution.tau[lifting], lift, rtol=1e-3)
