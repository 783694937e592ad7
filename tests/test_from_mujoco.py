"""Grasps read from MuJoCo: against the simulator's own constraint forces and inverse dynamics."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from models import TIPS, paper_hand_xml

import graspforce as gf
from graspforce.hands import PaperHand, from_mjcf

mujoco = pytest.importorskip("mujoco")

FIRM = (
    'cone="elliptic" impratio="100" timestep=".001" noslip_iterations="3" integrator="implicitfast"'
)
PAD = 'solref=".004 1" solimp=".95 .99 .001" priority="1"'
CUBE = """<body name="cube" pos="0 0 .1"><freejoint/>
  <geom name="cube" type="box" size=".0375 .0375 .0375" mass=".25"/></body>"""
WEIGHT = np.array([0, 0, 0.25 * 9.81, 0, 0, 0])
ROBOT = slice(0, 12)


def scene(*, world=CUBE, tip=f'friction=".5 .005 .0001" {PAD}', options=FIRM, into=2e-4, **parts):
    """The paper's hand around its cube, the pads 0.2 mm into it: a model and its data."""
    model = mujoco.MjModel.from_xml_string(
        paper_hand_xml(world=world, tip=tip, options=options, **parts)
    )
    data = mujoco.MjData(model)
    reach = 0.0375 + 0.004 - into
    tips = [[reach, 0, 0.1], [0, reach, 0.11], [-reach, 0, 0.1], [0, -reach, 0.09]]
    names = [f"finger{i}_{each}" for i in (1, 2, 3, 4) for each in ("base", "pitch", "knee")]
    address = [model.joint(name).qposadr[0] for name in names]
    data.qpos[address] = PaperHand("radial").inverse_kinematics(tips)
    mujoco.mj_forward(model, data)
    return model, data


def measured(data, grasp, model, cube="cube"):
    """The simulator's contact forces in the grasp's contact frames, in its order."""
    c, index = [], 0
    body = model.body(cube).id
    for i in range(data.ncon):
        bodies = model.geom_bodyid[data.contact.geom[i]]
        if body not in bodies:
            continue
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, force)
        axes = data.contact.frame[i].reshape(3, 3)
        sign = 1 if bodies[1] == body else -1  # the force is on the second geom
        contact = grasp.contacts[index]
        parts = contact.frame.T @ (sign * axes.T @ force[:3])
        torsion = sign * (contact.normal @ (axes.T @ force[3:]))
        c.extend([*parts, torsion][: contact.model.dim])
        index += 1
    assert index == len(grasp.contacts)
    return np.array(c)


def wrench_on(model, data, body):
    """What the constraints make of forces and torques at a free body's centre of mass."""
    force = data.qfrc_constraint[model.body(body).dofadr[0] :][:6]
    turned = data.body(body).xmat.reshape(3, 3)
    return np.concatenate((force[:3], turned @ force[3:]))


# ---- the simulator's own forces ----------------------------------------------------------------


BALL = """<body name="cube" pos="0 0 .1"><freejoint/>
  <geom type="sphere" size=".0375" mass=".25"/></body>"""


@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("condim", [1, 3, 4])
def test_w_and_j_are_the_simulators(condim, first):
    """W c is what the contacts do to the object, −J.T c what they do to the joints."""
    tip = f'condim="{condim}" friction=".5 .01 .0001" {PAD}'
    model, data = scene(tip=tip, into=1e-3)
    if first:  # MuJoCo puts spheres before boxes: the normals then point out of the object
        text = paper_hand_xml(world=BALL, tip=tip, options=FIRM)
        for i in (1, 2, 3, 4):
            text = text.replace(
                f'"f{i}_pad" type="sphere" size=".004"',
                f'"f{i}_pad" type="box" size=".004 .004 .004" euler=".1 .2 .3"',
            )
        ready = data.qpos
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        data.qpos[:] = ready
    mujoco.mj_forward(model, data)
    assert first == bool(model.geom_bodyid[data.contact.geom[0, 0]] == model.body("cube").id)
    robot = ROBOT
    rng = np.random.default_rng(condim)
    data.qvel[:] = rng.normal(size=model.nv) * 0.03
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert grasp.links == ("f1_distal", "f2_distal", "f3_distal", "f4_distal")
    assert {type(each).__name__ for each in grasp.models} == {
        {1: "FPC", 3: "PCWF", 4: "SFC"}[condim]
    }
    c = measured(data, grasp, model)
    assert all(c[i] > 0.1 for i in np.cumsum([0, *(m.dim for m in grasp.models[:-1])]))
    np.testing.assert_allclose(grasp.W @ c, wrench_on(model, data, "cube"), atol=1e-9)
    np.testing.assert_allclose(-grasp.J.T @ c, data.qfrc_constraint[robot], atol=1e-9)
    # Strictly inside MuJoCo's cone is inside ours, and the reverse.
    for contact, start in zip(grasp.contacts, np.cumsum([0] + [condim] * 3), strict=True):
        if condim > 1:
            n, *t = c[start : start + condim]
            scaled = [*t[:2], *(0.5 / 0.01 * each for each in t[2:])]
            assert 0.5 * n - np.linalg.norm(scaled) >= -1e-6 * n
            assert contact.model.mu == 0.5


def test_it_is_the_imported_hands_jacobian():
    model, data = scene()
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    hand = from_mjcf(model, TIPS)
    np.testing.assert_allclose(grasp.J, hand.jacobian(grasp.contacts, data.qpos[:12]), atol=1e-14)
    assert grasp.joint_names == hand.joint_names
    np.testing.assert_array_equal(grasp.tau_hi, hand.tau_hi)


@pytest.mark.parametrize(
    ("joint", "gravity"),
    [
        ("", "0 0 -9.81"),
        ('stiffness=".1" springref=".4"', "0 0 0"),
        ('stiffness=".1"', "2 3 -9"),
        ('actuatorgravcomp="true"', "0 0 -9.81"),
    ],
)
def test_the_imported_hand_has_the_same_weight_and_springs(joint, gravity):
    options = f'{FIRM} gravity="{gravity}"'
    text = paper_hand_xml(world=CUBE, tip=PAD, options=options, joint=joint)
    text = text.replace('<body name="f1_distal"', '<body name="f1_distal" gravcomp=".5"')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[ROBOT] = scene()[1].qpos[ROBOT]
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    hand = from_mjcf(model, TIPS).touching(grasp.links)
    again = gf.Grasp(grasp.contacts, hand, data.qpos[ROBOT], origin=grasp.origin)
    assert np.abs(grasp.tau_bias).max() > 1e-3
    np.testing.assert_allclose(again.tau_bias, grasp.tau_bias, atol=1e-12)
    found = [gf.solve(each.problem(WEIGHT), check=True) for each in (grasp, again)]
    np.testing.assert_allclose(found[1].tau, found[0].tau, atol=1e-8)


@pytest.mark.parametrize(
    "joint",
    [
        "",
        'stiffness=".3" springref=".4"',
        'stiffness=".3" damping=".02 .5 .1"',
        'actuatorgravcomp="true"',
    ],
)
def test_the_bias_is_what_inverse_dynamics_asks_for(joint):
    text = paper_hand_xml(world=CUBE, tip=PAD, options=FIRM, joint=joint)
    text = text.replace('<body name="f1_distal"', '<body name="f1_distal" gravcomp=".5"')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[ROBOT] = scene()[1].qpos[ROBOT]
    rng = np.random.default_rng(1)
    data.qvel[:] = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    data.qacc[:] = 0
    mujoco.mj_inverse(model, data)
    wanted = data.qfrc_inverse + data.qfrc_constraint
    if "actuatorgravcomp" in joint:
        wanted = wanted - data.qfrc_gravcomp
        assert np.abs(data.qfrc_gravcomp[ROBOT]).max() > 1e-3
    np.testing.assert_allclose(grasp.tau_bias, wanted[ROBOT], atol=1e-12)
    assert np.abs(grasp.tau_bias).max() > 1e-3


def test_three_lines_hold_the_cube():
    model, data = scene()
    start = data.body("cube").xpos.copy()
    for _ in range(250):
        mujoco.mj_forward(model, data)
        grasp = gf.Grasp.from_mujoco(model, data, "cube")
        solution = gf.solve(grasp.problem(WEIGHT), check=True)
        data.ctrl[:] = solution.tau
        mujoco.mj_step(model, data)
    driven = [model.joint(model.actuator(i).trnid[0]).name for i in range(model.nu)]
    assert list(grasp.joint_names) == driven  # so that ctrl is in the order of tau
    # Nothing but the right forces keeps it there: no position is fed back.
    assert np.linalg.norm(data.body("cube").xpos - start) < 1e-4
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    np.testing.assert_allclose(measured(data, grasp, model), solution.c, atol=0.02)
    np.testing.assert_allclose(data.qfrc_actuator[ROBOT], solution.tau, atol=1e-12)


def test_nothing_is_changed():
    model, data = scene()
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    before = [np.copy(each) for each in (state, data.efc_J, data.cdof, data.qfrc_bias, data.xpos)]
    gf.Grasp.from_mujoco(model, data, "cube")
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    after = (state, data.efc_J, data.cdof, data.qfrc_bias, data.xpos)
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(new, old)


# ---- friction ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tip", "expected"),
    [
        ('condim="1" friction=".7 .01 .001"', gf.FPC()),
        ('condim="3" friction=".7 .01 .001"', gf.PCWF(0.7)),
        ('condim="3" friction="0 .01 .001"', gf.FPC()),
        ('condim="4" friction=".7 .01 .001"', gf.SFC(0.7, 0.01)),
        ('condim="4" friction=".7 0 .001"', gf.PCWF(0.7)),
        ('condim="6" friction=".7 .01 .001"', gf.SFC(0.7, 0.01)),
        ('condim="6" friction="0 .01 .001"', gf.FPC()),
    ],
)
def test_friction_of_the_geoms(tip, expected):
    model, data = scene(tip=f"{tip} {PAD}")
    assert gf.Grasp.from_mujoco(model, data, "cube").models == (expected,) * 4


def test_friction_of_a_pair_with_two_coefficients_is_the_smaller():
    pair = '<contact><pair geom1="f1_pad" geom2="cube" friction=".9 .4 .01 .001 .001"/></contact>'
    model, data = scene(extra=pair)
    models = dict(zip(*(lambda g: (g.links, g.models))(gf.Grasp.from_mujoco(model, data,
                  "cube")), strict=True))  # fmt: skip
    assert models["f1_distal"] == gf.PCWF(0.4)
    assert models["f2_distal"] == gf.PCWF(0.5)


def test_frictionless_contacts_alone_cannot_carry_the_cube():
    model, data = scene(tip=f'friction="0 0 0" {PAD}')
    problem = gf.Grasp.from_mujoco(model, data, "cube").problem(WEIGHT)
    assert gf.solve(problem).status in (gf.Status.INFEASIBLE, gf.Status.WRENCH_UNREACHABLE)


def test_pyramids_are_noted():
    model, data = scene(options='cone="pyramidal"')
    assert "pyramids lie inside" in gf.Grasp.from_mujoco(model, data, "cube").notes[-1]
    model, data = scene()
    assert gf.Grasp.from_mujoco(model, data, "cube").notes == ()


# ---- what touches ------------------------------------------------------------------------------


def test_the_palm_and_a_table_push_without_torque():
    """The cube sits on a stand: its contacts have rows of W, but none of J."""
    stand = """<body name="stand"><geom type="box" size=".02 .02 .0314" pos="0 0 .0312"
      friction=".3 .01 .001" priority="2"/></body>"""
    model, data = scene(world=CUBE + stand)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    on_stand = [link == "stand" for link in grasp.links]
    assert sum(on_stand) == 4
    assert len(on_stand) == 8
    J = grasp.J.reshape(8, 3, 12)
    assert not J[on_stand].any()
    assert all(block.any() for block in J[~np.array(on_stand)])
    c = measured(data, grasp, model)
    np.testing.assert_allclose(grasp.W @ c, wrench_on(model, data, "cube"), atol=1e-9)
    np.testing.assert_allclose(-grasp.J.T @ c, data.qfrc_constraint[ROBOT], atol=1e-9)
    # Light finger forces will do; the stand carries the weight.
    solution = gf.solve(grasp.problem(WEIGHT), check=True)
    assert solution.verify().ok
    assert all(solution.normal_forces[i] > 0 for i in range(8))


def test_a_loose_neighbour_is_left_out_with_a_warning():
    ball = """<body name="ball" pos="0 0 .1474"><freejoint/><geom size=".01" mass=".01"/></body>"""
    model, data = scene(world=CUBE + ball)
    assert data.ncon == 5
    with pytest.warns(UserWarning, match="contact with 'ball' is left out: that body is loose"):
        grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert len(grasp.contacts) == 4
    assert "ball" in grasp.notes[0]


def test_a_hand_on_a_mount_that_floats():
    text = paper_hand_xml(world=CUBE, tip=PAD, options=FIRM)
    text = text.replace('<body name="palm">', '<body name="palm"><freejoint/>')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    ready = scene()[1]
    data.qpos[7:] = ready.qpos
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    fixed = gf.Grasp.from_mujoco(*scene(), "cube")
    np.testing.assert_allclose(grasp.J, fixed.J, atol=1e-12)
    assert grasp.joint_names == fixed.joint_names


def test_contacts_within_the_margin_but_not_active_do_not_count():
    model, data = scene(tip=f'{PAD} gap=".01"')
    data.qpos[0:3] = PaperHand("radial").inverse_kinematics(
        [[0.0375 + 0.004 + 0.003, 0, 0.1], [0, 0.05, 0.1], [-0.05, 0, 0.1], [0, -0.05, 0.1]]
    )[:3]
    mujoco.mj_forward(model, data)
    assert data.ncon == 4
    assert gf.Grasp.from_mujoco(model, data, "cube").links == (
        "f2_distal", "f3_distal", "f4_distal"
    )  # fmt: skip


def test_the_torque_is_about_the_centre_of_mass():
    lump = '<geom mass=".5" size=".005" pos=".02 0 .01" contype="0" conaffinity="0"/></body>'
    model, data = scene(world=CUBE.replace("</body>", lump))
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    np.testing.assert_allclose(grasp.origin, [0.04 / 3, 0, 0.1 + 0.02 / 3], atol=1e-12)
    W = gf.grasp_map(grasp.contacts, data.body("cube").xipos)
    np.testing.assert_allclose(grasp.W, W, atol=1e-16)


def test_the_body_by_number():
    model, data = scene()
    by_name = gf.Grasp.from_mujoco(model, data, "cube")
    by_number = gf.Grasp.from_mujoco(model, data, model.body("cube").id)
    np.testing.assert_array_equal(by_name.W, by_number.W)


# ---- couplings ---------------------------------------------------------------------------------

GRIPPER = """<mujoco><compiler autolimits="true"/><option gravity="0 0 -9.81" {options}/><worldbody>
  <body name="cube"><freejoint/><geom type="box" size=".02 .02 .02" mass=".1"/></body>
  <body name="mount"><geom size=".01" pos="0 0 .1"/>
    <body name="left" pos="-.0248 0 .02">
      <joint name="left" type="{kind}" axis="{left}" pos="0 0 .05"/>
      <geom type="sphere" size=".005" pos="0 0 -.02" mass=".05" friction=".8 .005 .0001"/></body>
    <body name="right" pos=".0248 0 .02">
      <joint name="right" type="{kind}" axis="{right}" pos="0 0 .05"/>
      <geom type="sphere" size=".005" pos="0 0 -.02" mass=".05" friction=".8 .005 .0001"/>
      <geom size=".002" pos=".03 0 .02" mass=".02" contype="0" conaffinity="0"/></body>
  </body></worldbody>
  <tendon><fixed name="pull"><joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed>
  </tendon>
  <equality>{equality}</equality><actuator>{motors}</actuator></mujoco>"""


def gripper(equality, motors, kind="hinge", jacobian="auto"):
    axes = {"hinge": ("0 -1 0", "0 1 0"), "slide": ("1 0 0", "-1 0 0")}[kind]
    model = mujoco.MjModel.from_xml_string(
        GRIPPER.format(
            options=f'{FIRM} jacobian="{jacobian}"',
            kind=kind,
            left=axes[0],
            right=axes[1],
            equality=equality,
            motors=motors,
        )
    )
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(3).normal(size=model.nv) * 0.01
    mujoco.mj_forward(model, data)
    return model, data


MIMIC = '<joint joint1="right" joint2="left" polycoef="0 .8 0 0 0"/>'


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_a_mimic_finger_by_virtual_work(kind, jacobian):
    """The coupling's own forces do no work, so the motor's share is what contacts do to both."""
    model, data = gripper(MIMIC, '<motor joint="left" forcerange="-1 1"/>', kind, jacobian)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert grasp.joint_names == ("left",)
    assert grasp.links == ("left", "right")
    left, right = model.joint("left").dofadr[0], model.joint("right").dofadr[0]
    c = measured(data, grasp, model)
    constraint = data.qfrc_constraint  # contacts and coupling
    done = constraint[left] + 0.8 * constraint[right]
    np.testing.assert_allclose(-(grasp.J.T @ c), [done], atol=1e-9)
    assert abs(done) > 1e-3
    bias = data.qfrc_bias[left] + 0.8 * data.qfrc_bias[right]
    np.testing.assert_allclose(grasp.tau_bias, [bias], atol=1e-12)
    assert grasp.notes == ("'left' also moves 'right' by 0.8 per unit of its own motion",)
    assert len(grasp.passive_rows) == 0


def test_a_finger_that_only_follows_is_a_finger():
    model, data = gripper(MIMIC, '<motor joint="left" forcerange="-1 1"/>')
    data.qpos[model.jnt_qposadr[0]] += 0.003  # away from the left finger
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert grasp.links == ("right",)
    assert grasp.J.any()


def test_a_tendon_that_pulls_both_fingers():
    """One motor, two joints, nothing that couples them: the difference is nobody's to control."""
    model, data = gripper("", '<motor tendon="pull" forcerange="-15 15"/>')
    with pytest.warns(UserWarning, match="no motor controls 1 of 2 motions of 'left', 'right'"):
        grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert grasp.joint_names == ("pull",)
    c = measured(data, grasp, model)
    dofs = [model.joint(name).dofadr[0] for name in ("left", "right")]
    # dl = (dq1 + dq2)/2 is the motor's, dz = (dq1 − dq2)/√2 is not.
    done = data.qfrc_constraint[dofs]
    np.testing.assert_allclose(-grasp.J.T @ c, [done.sum()], atol=1e-9)
    rest = np.array([1, -1]) / 2**0.5
    work, load = grasp.passive_rows @ c, grasp.passive_loads
    sign = np.sign(work[0]) * np.sign(-(rest @ done))
    np.testing.assert_allclose(work, [-sign * (rest @ done)], atol=1e-9)
    np.testing.assert_allclose(load, [-sign * (rest @ data.qfrc_bias[dofs])], atol=1e-12)
    problem = grasp.problem([0, 0, 0.981, 0, 0, 0])
    assert problem.f.shape == (7,)
    assert problem.f[6] == load[0]


def test_what_a_passive_finger_is_made_to_bear():
    """A finger without a motor leans on the cube: the contact bears its weight, nothing else."""
    model, data = gripper("", '<motor joint="left" forcerange="-5 5"/>')
    with pytest.warns(UserWarning, match="no motor controls 'right'"):
        grasp = gf.Grasp.from_mujoco(model, data, "cube")
    c = np.linalg.lstsq(grasp.passive_rows, grasp.passive_loads, rcond=None)[0]
    # c pushes the cube; what the finger feels is −c, and it must balance the finger's weight.
    jacobian = np.zeros((3, model.nv))
    right = model.body("right").id
    mujoco.mj_jac(model, data, jacobian, None, grasp.contacts[1].point, right)
    dof = model.joint("right").dofadr[0]
    felt = jacobian[:, dof] @ -(grasp.contacts[1].frame @ c[3:])
    assert felt == pytest.approx(data.qfrc_bias[dof], abs=1e-12)
    assert abs(felt) > 1e-3


def test_a_passive_finger_that_touches_nothing_is_nobodys_concern():
    model, data = gripper("", '<motor joint="left" forcerange="-5 5"/>')
    data.qpos[model.joint("right").qposadr] = -0.1
    data.qvel[:] = 0
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert grasp.links == ("left",)
    assert grasp.passive_rows.shape == (0, 3)


# ---- a gripper as a user writes it: flat pads, a palm, an arm that lifts it ---------------------

PARALLEL = """<mujoco><option cone="elliptic" impratio="20"/><worldbody>
  <body name="hand" pos="0 0 .2"><joint name="lift" type="slide" axis="0 0 1"/>
    <geom name="palm" type="box" size=".06 .02 .01" mass=".3"/>
    <body name="left" pos="-.0305 0 -.05"><joint name="left" type="slide" axis="1 0 0"/>
      <geom type="box" size=".005 .01 .03" mass=".05"/></body>
    <body name="right" pos=".0305 0 -.05"><joint name="right" type="slide" axis="-1 0 0"/>
      <geom type="box" size=".005 .01 .03" mass=".05"/></body></body>
  <body name="box" pos="0 0 {height}"><freejoint/>
    <geom type="box" size=".0257 .02 .02" mass=".2"/></body></worldbody>
  <actuator><motor joint="lift" ctrlrange="-60 60"/><position joint="left" forcerange="-20 20"/>
    <motor joint="right" gear="10" ctrlrange="-2 2"/></actuator></mujoco>"""


def parallel_gripper(height):
    model = mujoco.MjModel.from_xml_string(PARALLEL.format(height=height))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize(("height", "made_by"), [(0.14, 2), (0.1701, 3)], ids=["pads", "palm"])
def test_flat_pads_and_a_palm_that_an_arm_lifts(height, made_by):
    model, data = parallel_gripper(height)
    grasp = gf.Grasp.from_mujoco(model, data, "box")
    assert grasp.joint_names == ("lift", "left", "right")
    assert len(set(grasp.links)) == made_by
    assert len(grasp.contacts) == 4 * made_by
    assert grasp.tau_hi.tolist() == [60, 20, 20]
    c = measured(data, grasp, model, "box")
    np.testing.assert_allclose(grasp.W @ c, wrench_on(model, data, "box"), atol=1e-9)
    joints = [model.joint(name).dofadr[0] for name in grasp.joint_names]
    np.testing.assert_allclose(-grasp.J.T @ c, data.qfrc_constraint[joints], atol=1e-9)


def test_its_torques_hold_the_box_whatever_the_motors_are():
    model, data = parallel_gripper(0.14)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    start = data.body("box").xpos.copy()
    for _ in range(300):
        grasp = gf.Grasp.from_mujoco(model, data, "box")
        solution = gf.solve(grasp.problem([0, 0, 0.2 * 9.81, 0, 0, 0]), check=True)
        for joint, torque in zip(grasp.joint_names, solution.tau, strict=True):
            data.qfrc_applied[model.joint(joint).dofadr] = torque
        mujoco.mj_step(model, data)
    # MuJoCo's default contacts give a little; a box that fell would be 1 m lower.
    assert np.abs(data.body("box").xpos - start).max() < 1e-3


# ---- limits ------------------------------------------------------------------------------------


def test_motors_without_limits_need_tau_max():
    motors = "".join(
        f'<position joint="finger{i}_{each}" kp="5"/>'
        for i in (1, 2, 3, 4)
        for each in ("base", "pitch", "knee")
    )
    model, data = scene(actuators=motors)
    with pytest.raises(gf.ModelImportError, match=r"no torque limit for finger1_base, .*tau_max"):
        gf.Grasp.from_mujoco(model, data, "cube")
    grasp = gf.Grasp.from_mujoco(model, data, "cube", tau_max=0.5)
    assert grasp.tau_hi.tolist() == [0.5] * 12
    assert gf.solve(grasp.problem(WEIGHT)).status is gf.Status.SOLVED


def test_implausible_limits_are_reported_from_the_callers_line():
    model, data = scene(joint='actuatorfrcrange="-50 50"', actuators="".join(
        f'<motor joint="finger{i}_{each}"/>' for i in (1, 2, 3, 4)
        for each in ("base", "pitch", "knee")))  # fmt: skip
    with pytest.warns(UserWarning, match="50 N·m for finger1_base") as caught:
        grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert caught[0].filename == __file__
    assert grasp.tau_hi.tolist() == [50.0] * 12
    assert "may be a placeholder" in grasp.notes[0]


# ---- bad input ---------------------------------------------------------------------------------


def refused(match, *arguments, **options):
    with pytest.raises(gf.InvalidInputError, match=match):
        gf.Grasp.from_mujoco(*arguments, **options)


def test_names_that_are_not_there():
    model, data = scene()
    refused(r"object_body: got 'ball', .* expected one of world, palm, .*, cube$", model, data,
            "ball")  # fmt: skip
    for bad in (99, -1, None, 1.5):
        refused(f"object_body: got {bad}, expected a body's name or its number, below 15", model,
                data, bad)  # fmt: skip
    refused("fingertips: got 'tip1', expected names", model, data, "cube", fingertips="tip1")
    refused(r"fingertips: got 'tip9', .*tip1, tip2", model, data, "cube", fingertips=["tip9"])
    refused(r"tau_max: got a limit for 'knee'", model, data, "cube", tau_max={"knee": 1})


def test_data_that_nothing_has_computed():
    model, _ = scene()
    refused("data: nothing is computed in it yet", model, mujoco.MjData(model), "cube")


def test_an_object_that_cannot_move():
    model, data = scene()
    refused("object_body: 'palm' is fixed to the world", model, data, "palm")


def test_an_object_that_nothing_touches_names_the_fingers():
    model, data = scene()
    data.qpos[12:15] = 1, 1, 1
    mujoco.mj_forward(model, data)
    refused(
        r"data: got nothing in contact with 'cube'.*: f1_distal, f2_distal, f3_distal, f4_distal$",
        model, data, "cube",
    )  # fmt: skip
    # Lying on a table it is touched, but by no finger.
    model, data = scene(world=CUBE + '<geom type="plane" size="1 1 .1" pos="0 0 -.5"/>')
    data.qpos[12:15] = 1, 1, -0.5 + 0.0374
    mujoco.mj_forward(model, data)
    assert data.ncon == 4
    refused(
        "data: got world in contact with 'cube' .*, expected something that a motor moves; fingers",
        model, data, "cube",
    )  # fmt: skip


# ---- hands without motors in the file, and fingers that nothing drives -------------------------


SLIDE = '<joint name="j{0}" type="slide" axis="{1} 0 0"/>'


def jaws(attributes="", joint=SLIDE, on_object="", extra=""):
    """Two jaws, 0.5 mm into a box of 4 cm: a model and its data."""
    both = "".join(
        f"""<body name="{name}" pos="{x} 0 .1" {attributes}>{joint.format(name, axis)}
          <geom type="box" size=".005 .01 .01" mass=".05"/></body>"""
        for name, x, axis in (("l", -0.0245, 1), ("r", 0.0245, -1))
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option {FIRM}/><worldbody>
      <body name="box" pos="0 0 .1"><freejoint/>
        <geom type="box" size=".02 .02 .03" mass=".2" friction=".7"/>{on_object}</body>{both}
      </worldbody>{extra}</mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


HELD = [0, 0, 0.2 * 9.81, 0, 0, 0]


def test_tau_max_makes_motors_where_the_file_has_none():
    model, data = jaws()
    for tau_max in (20.0, {"jl": 20.0, "jr": 20.0}):
        grasp = gf.Grasp.from_mujoco(model, data, "box", tau_max=tau_max)
        assert grasp.joint_names == ("jl", "jr")
        assert (grasp.tau_lo.tolist(), grasp.tau_hi.tolist()) == ([-20.0] * 2, [20.0] * 2)
        hand = from_mjcf(model, ["l", "r"], tau_max=tau_max).touching(grasp.links)
        np.testing.assert_allclose(grasp.J, hand.jacobian(grasp.contacts, [0, 0]), atol=1e-14)
        normals = np.abs(grasp.J[::3])  # each jaw's slide moves its points along their normals
        assert sorted(normals.tolist()) == [[0, 1]] * 4 + [[1, 0]] * 4
        gf.solve(grasp.problem(HELD), check=True)
    # A motor for one: the other jaw is a joint without, which may bear nothing.
    with pytest.warns(UserWarning, match="no motor controls 'jr'"):
        grasp = gf.Grasp.from_mujoco(model, data, "box", tau_max={"jl": 20.0})
    assert (grasp.joint_names, len(grasp.passive_rows)) == (("jl",), 1)
    with pytest.raises(
        gf.InvalidInputError, match=r"tau_max: got a limit for 'j', .*one of jl, jr$"
    ):
        from_mjcf(model, ["l", "r"], tau_max={"j": 1.0})


def test_one_number_makes_no_motors_of_followers_nor_beside_the_files():
    follow = '<equality><joint joint1="jr" joint2="jl"/></equality>'
    model, data = jaws(extra=follow)
    grasp = gf.Grasp.from_mujoco(model, data, "box", tau_max=20.0)
    assert grasp.joint_names == ("jl",)
    assert from_mjcf(model, ["l", "r"], tau_max=20.0).joint_names == ("jl",)
    gf.solve(grasp.problem(HELD), check=True)
    model, data = jaws(extra='<actuator><motor joint="jl"/></actuator>')
    with pytest.warns(UserWarning, match="no motor controls 'jr'"):
        grasp = gf.Grasp.from_mujoco(model, data, "box", tau_max=20.0)
    assert grasp.joint_names == ("jl",)
    grasp = gf.Grasp.from_mujoco(model, data, "box", tau_max={"jl": 20.0, "jr": 5.0})
    assert dict(zip(grasp.joint_names, grasp.tau_hi.tolist(), strict=True)) == {"jl": 20, "jr": 5}


def test_one_number_makes_no_motor_of_a_lid():
    geom = '<geom type="box" size=".02 .02 .03" mass=".01" friction=".7"/>'
    lid = f'<body name="lid"><joint name="hinge" axis="0 1 0"/>{geom}</body>'
    model, data = jaws(on_object=lid)  # the jaws hold both
    with pytest.warns(UserWarning, match="no motor controls 'hinge'"):
        grasp = gf.Grasp.from_mujoco(model, data, "box", tau_max=20.0)
    assert grasp.joint_names == ("jl", "jr")
    grasp = gf.Grasp.from_mujoco(model, data, "box", tau_max={"jl": 9, "jr": 9, "hinge": 1})
    assert set(grasp.joint_names) == {"jl", "jr", "hinge"}  # a robot on its feet is an object, too


def test_limits_for_fingers_that_are_elsewhere_wait_for_their_contact():
    model, data = jaws()
    data.joint("jr").qpos = -0.02
    mujoco.mj_forward(model, data)
    reader = gf.hands.MujocoGrasp(model, data, "box", tau_max={"jl": 20.0, "jr": 5.0})
    assert reader.joint_names == ("jl",)
    data.joint("jr").qpos = 0
    mujoco.mj_forward(model, data)
    reader.update(data)
    assert (reader.joint_names, reader.tau_hi.tolist()) == (("jl", "jr"), [20, 5])


def test_a_motor_of_tau_maxs_that_is_not_asked_for_holds_its_joint():
    model, data = jaws()
    limits = {"jl": 20.0, "jr": 5.0}
    reader = gf.hands.MujocoGrasp(model, data, "box", joints=["jl"], tau_max=limits)
    assert (reader.joint_names, len(reader.passive_rows)) == (("jl",), 0)


def test_what_touches_without_a_motor_is_said_to():
    model, data = jaws()
    with pytest.warns(UserWarning, match="no motor controls"):
        refused(
            "data: got l, r in contact with 'box' .*; tau_max gives motors to joints: jl, jr;",
            model, data, "box",
        )  # fmt: skip
    with pytest.raises(gf.InvalidInputError, match="nothing is computed in it yet"):
        gf.Grasp.from_mujoco(model, mujoco.MjData(model), "box", tau_max=20.0)


WELDED = "".join(
    f'<weld body1="{name}" body2="lead_{name}" relpose="0 0 0 1 0 0 0"/>' for name in "lr"
)
LEADS = "".join(
    f'<worldbody><body name="lead_{name}" pos="{x} 0 .1" mocap="true"/></worldbody>'
    for name, x in (("l", -0.0245), ("r", 0.0245))
)
MOCAP = {
    "mocap bodies": {"attributes": 'mocap="true"', "joint": ""},
    "bodies that mocap bodies lead": {
        "joint": "<freejoint/>",
        "extra": f"{LEADS}<equality>{WELDED}</equality>",
    },
}


@pytest.mark.parametrize("case", MOCAP)
def test_fingers_of_prescribed_motion_give_a_problem_without_joints(case):
    model, data = jaws(**MOCAP[case])
    grasp = gf.Grasp.from_mujoco(model, data, "box")
    assert set(grasp.links) == {"l", "r"}
    assert (grasp.J, grasp.tau_lo, grasp.tau_bias, grasp.joint_names) == (None, None, None, ())
    problem = grasp.problem(HELD, c_max=10.0)
    solution = gf.solve(problem, check=True)
    np.testing.assert_allclose(grasp.W @ solution.c, HELD, atol=1e-9)
    alike = gf.solve(grasp.problem(HELD, c_max=10.0, cone_weight=1))
    bare = gf.Grasp(grasp.contacts, origin=grasp.origin).problem(HELD, c_max=10.0)
    np.testing.assert_allclose(alike.c, gf.solve(bare).c, atol=1e-9)


# ---- motors that act one way -------------------------------------------------------------------


def pulled(gear="1", more="", tau_max=None):
    muscle = '<muscle joint="j{}" lengthrange="0 .1" gear="{}" {}/>'
    motors = "".join(muscle.format(name, gear, more) for name in "lr")
    model, data = jaws(extra=f"<actuator>{motors}</actuator>")
    return gf.Grasp.from_mujoco(model, data, "box", tau_max=tau_max)


def test_muscles_pull_only():
    grasp = pulled(more='force="30"')
    assert (grasp.tau_lo.tolist(), grasp.tau_hi.tolist()) == ([-30.0] * 2, [0.0] * 2)
    assert "muscle 'actuator 0' only pulls" in grasp.notes[0]
    assert gf.solve(grasp.problem(HELD)).status is gf.Status.INFEASIBLE  # they open the jaws
    assert pulled(more='force="30"', tau_max=20.0).tau_lo.tolist() == [-20.0] * 2
    assert pulled(more='force="30"', tau_max=20.0).tau_hi.tolist() == [0.0] * 2
    grasp = pulled("-2", 'force="30"')  # over a pulley, so that it closes them
    assert (grasp.tau_lo.tolist(), grasp.tau_hi.tolist()) == ([0.0] * 2, [60.0] * 2)
    gf.solve(grasp.problem(HELD), check=True)
    assert pulled(more='force="30" forcerange="-8 1"').tau_lo.tolist() == [-8.0] * 2


def test_a_muscles_peak_force_is_the_simulators():
    """Also where it follows from its scale and the mass that it moves."""
    grasp = pulled(more='scale="5"')
    motors = "".join(f'<muscle joint="j{n}" lengthrange="0 .1" scale="5"/>' for n in "lr")
    model = jaws(extra=f"<actuator>{motors}</actuator>")[0]
    lo, hi = model.actuator_lengthrange[0]
    lengths = np.linspace(lo - (hi - lo), hi + (hi - lo), 2001)
    gains = [
        mujoco.mju_muscleGain(x, 0, [lo, hi], model.actuator_acc0[0], model.actuator_gainprm[0, :9])
        for x in lengths
    ]
    assert grasp.tau_lo[0] == pytest.approx(min(gains), rel=1e-5)


def test_a_finger_that_has_to_touch_and_does_not():
    model, data = scene()
    data.qpos[[4, 10]] += 0.3  # two fingers lean outwards
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube", fingertips=["tip1", "f3_distal"])
    assert grasp.links == ("f1_distal", "f3_distal")
    assert grasp.notes == ("not in contact with 'cube': f2_distal, f4_distal",)
    refused(
        "data: tip2, tip4 not in contact with 'cube', expected all of the fingertips tip1, tip2,",
        model, data, "cube", fingertips=TIPS,
    )  # fmt: skip


def test_things_that_are_no_model_or_data():
    model, data = scene()
    refused("model: got a str, expected an mujoco.MjModel", "scene.xml", data, "cube")
    refused("data: got a MjModel, expected an mujoco.MjData", model, model, "cube")


def test_wrong_wrenches_are_refused_with_passive_joints_too():
    model, data = gripper("", '<motor joint="left" forcerange="-5 5"/>')
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        grasp = gf.Grasp.from_mujoco(model, data, "cube")
    with pytest.raises(gf.InvalidInputError, match=r"f: got shape \(7,\), expected shape \(6,\)"):
        grasp.problem(np.zeros(7))


def test_without_mujoco_the_error_names_the_pip_line(monkeypatch):
    model, data = scene()
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(gf.MissingExtraError, match=r"pip install 'mujoco[<>=]"):
        gf.Grasp.from_mujoco(model, data, "cube")
