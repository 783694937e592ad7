"""The reader of MuJoCo that is built once: against itself made anew, MuJoCo and differences."""

from __future__ import annotations

import numpy as np
import pytest
from models import paper_hand_xml
from test_from_mujoco import CUBE, FIRM, PAD, ROBOT, WEIGHT, gripper, measured, scene, wrench_on

import graspforce as gf
from graspforce import sim
from graspforce.hands import MujocoGrasp

mujoco = pytest.importorskip("mujoco")

JOINTS = tuple(f"finger{i}_{each}" for i in (1, 2, 3, 4) for each in ("base", "pitch", "knee"))
ARRAYS = ("origin", "W", "J", "tau_lo", "tau_hi", "tau_bias", "passive_rows", "passive_loads")


def assert_same(reader, other):
    """All that two readers say is the same, bit for bit."""
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(reader, name), getattr(other, name), err_msg=name)
    for name in ("joint_names", "contacts", "models", "links", "notes"):
        assert getattr(reader, name) == getattr(other, name), name


def moved(model, data, rng, size):
    """The data after a small move of everything, with new velocities."""
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv) * size, 1.0)
    data.qvel[:] = rng.normal(size=model.nv) * 0.1
    mujoco.mj_forward(model, data)


# ---- as if made anew ---------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::graspforce.GraspForceWarning")
@pytest.mark.parametrize("joints", [None, JOINTS[::-1]], ids=["what touches", "given"])
def test_after_many_updates_it_reads_as_one_made_anew(joints):
    """Contacts come and go between the updates, on boxes for tips one to four a finger."""
    stand = '<body name="stand"><geom type="box" size=".02 .02 .0314" pos="0 0 .0312"/></body>'
    text = paper_hand_xml(world=CUBE + stand, tip=f'condim="4" {PAD}', options=FIRM)
    text = text.replace('type="sphere" size=".004" pos', 'type="box" size=".004 .004 .004" pos')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    start = scene()[1].qpos.copy()
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    reader = MujocoGrasp(model, data, "cube", joints)
    rng = np.random.default_rng(5)
    seen = set()
    for _ in range(60):
        data.qpos[:] = start
        moved(model, data, rng, rng.choice([3e-4, 2e-3, 2e-2]))
        reader.update(data)
        assert_same(reader, MujocoGrasp(model, data, "cube", joints))
        np.testing.assert_allclose(
            reader.W @ measured(data, reader, model), wrench_on(model, data, "cube"), atol=1e-9
        )
        seen.add(reader.links)
        if joints:
            assert reader.joint_names == joints
    assert {len(links) for links in seen} >= {1, 4, 8, 12}
    assert len(seen) > 20


SPATIAL = """<mujoco><compiler autolimits="true"/><option {options}/><worldbody>
  <site name="anchor" pos="-.02 0 .08"/>
  <body name="cube"><freejoint/><geom type="box" size=".02 .02 .02" mass=".1"/></body>
  <body name="left" pos="-.0248 0 .06"><joint name="left" axis="0 -1 0"/>
    <geom type="sphere" size=".005" pos="0 0 -.06" mass=".05"/><site name="on" pos=".01 0 -.02"/>
  </body>
  <body name="right" pos=".0248 0 .06"><joint name="right" axis="0 -1 0"/>
    <geom type="sphere" size=".005" pos="0 0 -.06" mass=".05"/></body></worldbody>
  <tendon><spatial name="pull"><site site="anchor"/><site site="on"/></spatial></tendon>
  <actuator><motor tendon="pull" forcerange="-10 0"/><motor joint="right" forcerange="-1 1"/>
  </actuator></mujoco>"""


def spatial_tendon():
    model = mujoco.MjModel.from_xml_string(SPATIAL.format(options=FIRM))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


MIMIC = '<joint joint1="right" joint2="left" polycoef="0 .8 3 0 0"/>'
LEFT = '<motor joint="left" forcerange="-1 1"/>'


@pytest.mark.filterwarnings("ignore::graspforce.GraspForceWarning")
@pytest.mark.parametrize(
    "made",
    [
        spatial_tendon,
        lambda: gripper(MIMIC, LEFT),
        lambda: gripper(MIMIC, LEFT, jacobian="sparse"),
        lambda: gripper("", '<motor tendon="pull" forcerange="-15 15"/>'),
    ],
    ids=["spatial tendon", "mimic", "mimic, sparse", "fixed tendon"],
)
def test_moment_arms_and_couplings_that_change_are_read_anew(made):
    model, data = made()
    start = data.qpos.copy()
    reader = MujocoGrasp(model, data, "cube")
    rng = np.random.default_rng(6)
    told = set()
    for _ in range(20):
        data.qpos[:] = start
        moved(model, data, rng, 1e-3)
        reader.update(data)
        assert_same(reader, MujocoGrasp(model, data, "cube"))
        told.add(tuple(np.round(reader.tau_bias, 9)))
    assert len(told) == 20


def test_an_equality_that_is_switched_off_holds_no_longer():
    model, data = gripper(MIMIC, LEFT)
    reader = MujocoGrasp(model, data, "cube")
    assert reader.J[3:].any()  # the right finger follows
    data.eq_active[0] = 0
    mujoco.mj_forward(model, data)
    reader.update(data)
    assert not reader.J[3:].any()
    assert len(reader.passive_rows) == 1
    assert "no motor controls 'right'" in reader.notes[0]
    data.eq_active[0] = 1
    mujoco.mj_forward(model, data)
    reader.update(data)
    assert reader.J[3:].any()
    assert not len(reader.passive_rows)


def test_a_contact_that_comes_to_lie_within_its_gap_carries_nothing():
    """MuJoCo goes on listing it, between the same geoms, and leaves it out of the constraints."""
    model, data = scene()
    reader = MujocoGrasp(model, data, "cube")
    geom = int(data.contact.geom[0].min())  # a finger's
    for margin, gap, count in ((-0.01, 0.02, 3), (0, 0, 4), (-0.01, 0.02, 3)):
        model.geom_margin[geom], model.geom_gap[geom] = margin, gap
        mujoco.mj_forward(model, data)
        assert len(data.contact.geom) == 4
        reader.update(data)
        assert len(reader.contacts) == count
        assert_same(reader, MujocoGrasp(model, data, "cube"))


def test_masses_gravity_friction_and_damping_may_change_between_updates():
    lump = '<geom name="lump" size=".005" pos=".02 0 0" contype="0" conaffinity="0" mass=".25"/>'
    world = CUBE.replace("</body>", f"{lump}</body>")
    model, data = scene(joint='damping=".01"', world=world)
    data.qvel[ROBOT] = 0.1
    mujoco.mj_forward(model, data)
    reader = MujocoGrasp(model, data, "cube")
    before = reader.tau_bias.copy(), reader.models, reader.origin.copy()
    model.body_mass[:] *= 2
    model.body_ipos[model.body("cube").id] *= 2
    model.opt.gravity[:] = 1, 2, 3
    model.geom_friction[:, 0] = 0.9
    model.dof_damping[:] = 0.05
    mujoco.mj_setConst(model, mujoco.MjData(model))
    mujoco.mj_forward(model, data)
    reader.update(data)
    assert_same(reader, MujocoGrasp(model, data, "cube"))
    assert np.abs(reader.tau_bias - before[0]).min() > 1e-4
    assert before[1] == (gf.PCWF(0.5),) * 4
    assert reader.models == (gf.PCWF(0.9),) * 4
    np.testing.assert_allclose(reader.origin - before[2], [0.01, 0, 0], atol=1e-12)
    data.qacc[:] = 0
    mujoco.mj_inverse(model, data)
    np.testing.assert_allclose(
        reader.tau_bias, (data.qfrc_inverse + data.qfrc_constraint)[ROBOT], atol=1e-12
    )


def test_what_was_read_stays_when_the_data_go_on():
    model, data = scene()
    reader = MujocoGrasp(model, data, "cube")
    kept = MujocoGrasp(model, data, "cube")
    moved(model, data, np.random.default_rng(7), 1e-2)
    assert_same(reader, kept)  # both hold the moment that they read
    names = (*ARRAYS, "points", "normals")
    before = {name: getattr(reader, name).copy() for name in names}
    fresh = MujocoGrasp(model, data, "cube")
    for name in names:
        np.testing.assert_array_equal(getattr(reader, name), before[name])
    assert not np.array_equal(fresh.origin, reader.origin)


# ---- J against the motion itself ---------------------------------------------------------------


def moves_by_differences(model, data, body, relative_to, contact, dof, step=1e-6):
    """How a body's material point at a contact moves in the contact frame, per joint rate.

    Positions alone: the point goes along with its body, seen from the frame of another body.
    """

    def placed(sign):
        at = mujoco.MjData(model)
        at.qpos[:] = data.qpos
        rate = np.zeros(model.nv)
        rate[dof] = sign * step
        mujoco.mj_integratePos(model, at.qpos, rate, 1.0)
        mujoco.mj_kinematics(model, at)
        (p, R), (p_0, R_0) = (
            (at.xpos[each], at.xmat[each].reshape(3, 3)) for each in (body, relative_to)
        )
        return R_0.T @ (p - p_0), R_0.T @ R  # in the other body's frame

    R_0 = data.xmat[relative_to].reshape(3, 3)
    R = data.xmat[body].reshape(3, 3)
    local = R.T @ (contact.point - data.xpos[body])

    def seen(sign):
        position, turned = placed(sign)
        turn = R_0 @ turned @ R.T
        return R_0 @ (position + turned @ local), np.array([turn[2, 1], turn[0, 2], turn[1, 0]])

    linear, angular = ((b - a) / (2 * step) for a, b in zip(seen(-1), seen(1), strict=True))
    return np.append(contact.frame.T @ linear, contact.normal @ angular)[: contact.model.dim]


def test_j_by_finite_differences_of_positions():
    model, data = scene(tip=f'condim="4" friction=".5 .01 .0001" {PAD}')
    moved(model, data, np.random.default_rng(3), 1e-4)
    reader = MujocoGrasp(model, data, "cube", JOINTS)
    assert len(reader.contacts) == 4
    J = [
        np.concatenate(
            [
                moves_by_differences(model, data, model.body(link).id, 0, contact, dof)
                for contact, link in zip(reader.contacts, reader.links, strict=True)
            ]
        )
        for dof in range(12)
    ]
    np.testing.assert_allclose(reader.J, np.transpose(J), atol=1e-9)


def test_contacts_of_ones_own_have_the_same_j():
    model, data = scene()
    reader = MujocoGrasp(model, data, "cube", JOINTS)
    np.testing.assert_allclose(reader.jacobian(reader.contacts, reader.links), reader.J, atol=1e-15)
    swapped = reader.jacobian(reader.contacts[::-1], [model.body(n).id for n in reader.links[::-1]])
    np.testing.assert_allclose(swapped.reshape(4, 3, 12)[::-1], reader.J.reshape(4, 3, 12),
                               atol=1e-15)  # fmt: skip
    soft = [gf.Contact(c.point, c.normal, gf.SFC(0.5, 0.01), c.tangent) for c in reader.contacts]
    J = reader.jacobian(soft, reader.links).reshape(4, 4, 12)
    np.testing.assert_allclose(J[:, :3], reader.J.reshape(4, 3, 12), atol=1e-15)
    assert np.abs(J[:, 3]).max() > 0.1


# ---- what the physics gives --------------------------------------------------------------------


@pytest.mark.parametrize("tip", ['type="sphere" size=".004"', 'type="box" size=".004 .004 .004"'])
@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_contact_forces_are_those_of_the_physics(condim, tip):
    """Spheres before boxes and boxes before boxes: the object's geom is the first or the second."""
    text = paper_hand_xml(
        world=CUBE.replace('type="box" size=".0375 .0375 .0375"', 'type="sphere" size=".0375"')
        if "box" in tip else CUBE,
        tip=f'condim="{condim}" friction=".5 .01 .0001" {PAD}', options=FIRM,
    ).replace('type="sphere" size=".004" pos', f"{tip} pos")  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = scene(into=1e-3)[1].qpos
    data.qvel[:] = np.random.default_rng(condim).normal(size=model.nv) * 0.03
    mujoco.mj_step1(model, data)
    reader = MujocoGrasp(model, data, "cube")
    mujoco.mj_step2(model, data)
    c = reader.contact_forces(data)
    assert np.abs(c).min() > 0
    np.testing.assert_allclose(c, measured(data, reader, model), atol=1e-12)


def test_a_loop_with_a_servo_holds_the_cube_and_gets_what_it_asks_for():
    model, data = scene(joint='damping=".02"')
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    reader = MujocoGrasp(model, data, "cube", grasp.joint_names)
    servo = gf.Servo(grasp.problem(WEIGHT))
    start = data.body("cube").xpos.copy()
    for _ in range(250):
        mujoco.mj_step1(model, data)
        reader.update(data)
        solution = servo.step(W=reader.W, J=reader.J, tau_bias=reader.tau_bias)
        assert solution.status is gf.Status.SOLVED
        data.ctrl[:] = solution.tau
        mujoco.mj_step2(model, data)
    np.testing.assert_allclose(reader.contact_forces(data), solution.c, atol=0.02)
    assert np.linalg.norm(data.body("cube").xpos - start) < 1e-4


@pytest.mark.parametrize("name", ["circle", "regrasp"])
def test_damped_joints_carry_the_cube_as_well_as_others(name):
    """Damping is balanced: without that the cube is 10 mm off, with all else the same."""
    (trial,) = sim.get(name)
    trial.model.dof_damping[:12] = 0.03
    log = sim.run(trial)
    assert log.held
    assert 1e3 * log.position_error.max() < 0.5


# ---- a robot on its feet -----------------------------------------------------------------------


@pytest.fixture
def standing():
    (trial,) = sim.get("quadruped")
    data = mujoco.MjData(trial.model)
    data.qpos[:] = trial.start
    data.qpos[2] -= 2e-4
    data.qvel[:] = np.random.default_rng(4).normal(size=18) * 0.01
    mujoco.mj_forward(trial.model, data)
    return trial.model, data


def test_a_robot_on_its_feet_is_an_object_that_the_ground_carries(standing):
    """The physics' own forces: on the whole robot, and on every joint of its legs."""
    model, data = standing
    grasp = gf.Grasp.from_mujoco(model, data, "trunk", tau_max=30.0)
    assert sorted(grasp.links) == ["FL_shank", "FR_shank", "RL_shank", "RR_shank"]
    assert all(contact.normal[2] == pytest.approx(1) for contact in grasp.contacts)
    reader = MujocoGrasp(model, data, "trunk", tau_max=30.0)
    c = reader.contact_forces(data)
    assert c.reshape(4, 3)[:, 0].min() > 1
    legs = [model.joint(name).dofadr[0] for name in grasp.joint_names]
    np.testing.assert_allclose(-grasp.J.T @ c, data.qfrc_constraint[legs], atol=1e-9)
    np.testing.assert_allclose((grasp.W @ c)[:3], data.qfrc_constraint[:3], atol=1e-9)
    np.testing.assert_allclose(grasp.origin, data.subtree_com[model.body("trunk").id], atol=0)


def test_its_torques_stand_still_by_inverse_dynamics(standing):
    model, data = standing
    data.qvel[:] = 0
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "trunk", tau_max=30.0)
    weight = model.body_subtreemass[model.body("trunk").id] * 9.81
    solution = gf.solve(grasp.problem([0, 0, weight, 0, 0, 0]), check=True)
    legs = [model.joint(name).dofadr[0] for name in grasp.joint_names]
    bodies = [model.body(link).id for link in grasp.links]
    applied = np.zeros(model.nv)
    applied[legs] = solution.tau
    for contact, body, c in zip(grasp.contacts, bodies, solution.c.reshape(4, 3), strict=True):
        mujoco.mj_applyFT(model, data, contact.frame @ c, np.zeros(3), contact.point, body, applied)
    np.testing.assert_allclose(applied, data.qfrc_bias, atol=1e-8)


def test_j_of_legs_by_finite_differences(standing):
    model, data = standing
    reader = MujocoGrasp(model, data, "trunk", tau_max=30.0)
    legs = [int(model.joint(name).dofadr[0]) for name in reader.joint_names]
    trunk = model.body("trunk").id
    J = [
        np.concatenate(
            [
                # The ground moves against the foot as the foot moves against the ground.
                -moves_by_differences(model, data, model.body(link).id, trunk, contact, dof)
                for contact, link in zip(reader.contacts, reader.links, strict=True)
            ]
        )
        for dof in legs
    ]
    np.testing.assert_allclose(reader.J, np.transpose(J), atol=1e-9)
    np.testing.assert_allclose(reader.jacobian(reader.contacts, reader.links), reader.J, atol=1e-15)


def test_what_moves_on_an_object_belongs_to_it():
    """A box with a loose lid: the contact on the lid must do no work on the hinge but its load."""
    lid = """<body name="cube" pos="0 0 .1"><freejoint/>
      <geom type="box" size=".02 .02 .02" mass=".2"/>
      <body name="side" pos="0 .03 0"><joint name="hinge" axis="1 0 0" pos="0 -.01 0"/>
        <geom type="box" size=".0375 .0075 .0375" mass=".05"/></body></body>"""
    model, data = scene(world=lid)
    with pytest.warns(UserWarning, match="no motor controls 'hinge'"):
        grasp = MujocoGrasp(model, data, "cube")
    assert grasp.links.count("f2_distal") == 1
    total = 0.25 * data.subtree_com[model.body("cube").id]
    parts = 0.2 * data.body("cube").xipos + 0.05 * data.body("side").xipos
    np.testing.assert_allclose(total, parts, atol=1e-12)
    np.testing.assert_allclose(grasp.origin, parts / 0.25, atol=1e-12)
    c = grasp.contact_forces(data)
    hinge = model.joint("hinge").dofadr[0]
    sign = np.sign(grasp.passive_rows @ c) * np.sign(-data.qfrc_constraint[hinge])
    np.testing.assert_allclose(grasp.passive_rows @ c, sign * -data.qfrc_constraint[hinge],
                               atol=1e-9)  # fmt: skip
    np.testing.assert_allclose(grasp.passive_loads, sign * -data.qfrc_bias[hinge], atol=1e-12)


def test_joints_that_carry_the_object_are_not_the_hands():
    """A cube on a rail: what its own joint bears is left to the wrench that is asked for."""
    rail = CUBE.replace("<freejoint/>", '<joint name="rail" type="slide" axis="0 0 1"/>')
    free, on_rail = scene(), scene(world=rail)
    grasp = gf.Grasp.from_mujoco(*on_rail, "cube")
    expected = gf.Grasp.from_mujoco(*free, "cube")
    np.testing.assert_allclose(grasp.J, expected.J, atol=1e-15)
    assert grasp.passive_rows.shape == (0, 12)
    (note,) = grasp.notes
    assert note.startswith("'cube' moves by rail alone: of f only what works along these motions")


# ---- which joints ------------------------------------------------------------------------------

ARM = """<body name="palm"><joint name="lift" type="slide" axis="0 0 1"/><joint name="turn"
  axis="0 0 1"/>"""


def hand_on_an_arm():
    motors = "".join(f'<motor joint="{each}" ctrlrange="-.5 .5"/>' for each in JOINTS)
    arm = '<position joint="lift" kp="500"/><position joint="turn" kp="50"/>'
    text = paper_hand_xml(world=CUBE, tip=PAD, options=FIRM, actuators=arm + motors)
    model = mujoco.MjModel.from_xml_string(text.replace('<body name="palm">', ARM))
    data = mujoco.MjData(model)
    data.qpos[2:] = scene()[1].qpos
    mujoco.mj_forward(model, data)
    return model, data


def test_joints_that_are_not_asked_for_are_held_by_others():
    model, data = hand_on_an_arm()
    with pytest.raises(gf.ModelImportError, match="no torque limit for lift, turn"):
        MujocoGrasp(model, data, "cube")
    wanted = (*JOINTS[6:], *JOINTS[:3])
    reader = MujocoGrasp(model, data, "cube", wanted)  # no limit of the arm's is needed
    whole = MujocoGrasp(model, data, "cube", tau_max=0.5)
    assert reader.joint_names == wanted
    assert whole.joint_names == ("lift", "turn", *JOINTS)
    places = [whole.joint_names.index(name) for name in wanted]
    np.testing.assert_allclose(reader.J, whole.J[:, places], atol=1e-14)
    np.testing.assert_allclose(reader.tau_bias, whole.tau_bias[places], atol=1e-14)
    assert len(reader.passive_rows) == 0
    assert reader.notes == ()


def test_a_motor_without_torque_holds_nothing():
    text = paper_hand_xml(world=CUBE, tip=PAD, options=FIRM)
    text = text.replace('"finger1_knee" axis', '"finger1_knee" actuatorfrcrange="-1e-9 0" axis')
    text = text.replace('"finger1_knee" ctrllimited="true" ctrlrange="-.5 .5"',
                        '"finger1_knee" ctrllimited="true" ctrlrange="0 .5"')  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = scene()[1].qpos
    mujoco.mj_forward(model, data)
    wanted = tuple(each for each in JOINTS if each != JOINTS[2])
    with pytest.warns(UserWarning, match="no motor controls 'finger1_knee'"):
        reader = MujocoGrasp(model, data, "cube", wanted)
    assert reader.joint_names == wanted
    assert len(reader.passive_rows) == 1


def test_joints_that_touch_nothing_stay_in_the_columns():
    model, data = scene()
    reader = MujocoGrasp(model, data, "cube", JOINTS)
    data.qpos[[1, 4, 7, 10]] += 0.3  # all fingers lean outwards
    mujoco.mj_forward(model, data)
    reader.update(data)
    assert reader.contacts == ()
    assert reader.W.shape == (6, 0)
    assert reader.J.shape == (0, 12)
    assert reader.joint_names == JOINTS
    np.testing.assert_allclose(reader.tau_bias, data.qfrc_bias[ROBOT], atol=1e-15)
    assert reader.notes == (
        "not in contact with 'cube': f1_distal, f2_distal, f3_distal, f4_distal",
    )


# ---- bad input ---------------------------------------------------------------------------------


def refused(match, function, *arguments, **options):
    with pytest.raises(gf.InvalidInputError, match=match):
        function(*arguments, **options)


def test_wrong_arguments_are_named():
    model, data = scene()
    refused("model: got a str, expected an mujoco.MjModel", MujocoGrasp, "hand.xml", data, "cube")
    refused("object_body: got 'ball', which is none", MujocoGrasp, model, data, "ball")
    refused(
        r"joints: got 'knee', which has no motor, expected each once of finger1_base, finger1",
        MujocoGrasp, model, data, "cube", ["knee"],
    )  # fmt: skip
    refused("joints: got 'finger1_base' twice", MujocoGrasp, model, data, "cube", [JOINTS[0]] * 2)
    refused("joints: got 'finger1_base', expected a list of str", MujocoGrasp, model, data, "cube",
            JOINTS[0])  # fmt: skip
    reader = MujocoGrasp(model, data, "cube")
    refused("links: got 3, expected 4, one a contact", reader.jacobian, reader.contacts,
            reader.links[:3])  # fmt: skip
    refused("links: got 'tip', which is none of", reader.jacobian, reader.contacts[:1], ["tip"])
    refused("links: got 99, expected a body's name or its number, below 15", reader.jacobian,
            reader.contacts[:1], [99])  # fmt: skip
    refused("contacts: got none", reader.jacobian, [], [])
    contact = reader.contacts[1]
    data.qpos[4] += 0.3  # finger 2 leans outwards
    mujoco.mj_forward(model, data)
    reader.update(data)
    refused("links: 'f2_distal' is moved by other joints than", reader.jacobian, [contact],
            ["f2_distal"])  # fmt: skip
    J = MujocoGrasp(model, data, "cube", JOINTS).jacobian([contact], ["f2_distal"])
    assert J[:, 3:6].any()


def test_an_update_that_is_refused_changes_nothing():
    model, data = scene()
    reader = MujocoGrasp(model, data, "cube", JOINTS)
    other = gripper("", LEFT)[1]
    for wrong, match in (
        (model, "data: got a MjModel, expected an mujoco.MjData"),
        (other, "data: of another model"),
        (mujoco.MjData(model), "data: nothing is computed in it yet"),
    ):
        refused(match, reader.update, wrong)
    assert_same(reader, MujocoGrasp(model, data, "cube", JOINTS))
    copied = mujoco.MjData(model)
    copied.qpos[:] = data.qpos
    copied.qpos[12] += 1e-4
    mujoco.mj_forward(model, copied)
    reader.update(copied)  # any data of the model will do
    assert reader.origin[0] == pytest.approx(1e-4)
