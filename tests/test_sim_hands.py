"""Hands of any kind in physics: closing, holding, moving, what goes wrong, and their motors."""

import dataclasses
import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

import graspforce as gf
from graspforce import cli, sim
from graspforce.sim.world import object_inertia

mujoco = pytest.importorskip("mujoco")

SOLID = 'solref=".002 1" solimp=".95 .99 .001" friction=".8 .01 .0001" condim="4"'


def jaws(motors, joints="", more="", option="", box="0 0 .1"):
    """Two pads on slides with a box between them."""
    pads = "".join(
        f"""<body name="{name}" pos="{x} 0 .1"><joint name="{name}" type="slide" axis="{-s} 0 0"
          {joints}/><geom type="box" size=".005 .015 .015" mass=".1"/></body>"""
        for name, x, s in (("left", -0.03, -1), ("right", 0.03, 1))
    )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option cone="elliptic" impratio="100" noslip_iterations="3" timestep=".001"
            integrator="implicitfast" {option}/><default><geom {SOLID}/></default>
          <worldbody>{pads}<body name="box" pos="{box}"><freejoint/>
            <geom type="box" size=".02 .02 .02" mass=".2"/></body></worldbody>{more}
          <actuator>{motors}</actuator></mujoco>"""
    )


BOTH = "".join(f'<motor name="m{n}" joint="{n}" ctrlrange="-20 20"/>' for n in ("left", "right"))


# ---- the hands ---------------------------------------------------------------------------------

MOVE, TURN = [0.0, 0.0, 0.02], 20.0


@pytest.fixture(scope="module", params=sim.HANDS)
def moved(request):
    """A hand that closes on 0.2 kg, holds it, moves it by 2 cm, turns it by 20° and holds it."""
    model = sim.hand_model(request.param)
    (trial,) = sim.own(model, "object", move=MOVE, turn=TURN, duration=1.2)
    return trial, sim.run(trial)


def test_sim_hands_hold_and_move_whatever_their_motors_and_tips_are(moved):
    _, log = moved
    assert log.verdict == "held"
    assert 1e3 * log.position_error.max() <= 0.5
    assert np.degrees(log.rotation_error.max()) <= 0.5
    assert 1e3 * log.slip.max() <= 0.5
    assert log.torque_use <= 1
    assert not log.kept.any()
    gone = np.linalg.norm(log.position[-1] - log.position[0])
    assert gone == pytest.approx(0.02, abs=1e-3)
    weight = np.array([0, 0, 0.2 * 9.81])
    assert_allclose(log.force[-100:].sum(axis=1).mean(axis=0), weight, atol=0.05)
    turned = np.degrees(log.yaw[-1] - log.yaw[0])
    assert turned == pytest.approx(TURN, abs=1)


@pytest.mark.parametrize(("move", "turn"), [(-0.02, -20.0), (0.0, 20.0)])
def test_sim_hands_tendons_follow_whatever_the_way(move, turn):
    """Two joints of a finger on one tendon, which no motor moves apart."""
    (trial,) = sim.own(
        sim.hand_model("shadow"), "object", move=[0, 0, move], turn=turn, duration=0.8
    )
    log = sim.run(trial)
    assert log.verdict == "held"
    assert 1e3 * log.position_error.max() <= 0.5
    assert 1e3 * log.slip.max() <= 0.5


def test_hand_loop_stops_no_finger_at_an_end():
    """The fingers would bend beyond their range as the hand is moved up: the arm goes on alone."""
    model = sim.hand_model("shadow")
    (trial,) = sim.own(model, "object", move=MOVE, duration=0.8)
    bends = [model.joint(f"{finger}J3") for finger in ("FF", "MF", "RF", "LF")]
    data = mujoco.MjData(model)
    data.qpos[:] = trial.start
    mujoco.mj_forward(model, data)
    loop = sim.HandLoop(model, data, "object", trial.motion)
    angles = np.empty((800, len(bends)))
    for tick in angles:
        mujoco.mj_step1(model, data)
        loop.step(data.time)
        mujoco.mj_step2(model, data)
        tick[:] = [data.qpos[joint.qposadr[0]] for joint in bends]
    most = bends[0].range[1]
    assert angles[0].max() < most - 0.05
    assert angles[0].max() < angles.max() < most
    assert_allclose(data.subtree_com[model.body("object").id], loop.target(0.8)[0], atol=1e-4)


@pytest.mark.parametrize("name", ["shadow", "two_hands"])
def test_hand_loop_knows_the_change_of_the_jacobian(name):
    """Against MuJoCo's own, at points of all bodies: of arms, fingers and the floating object."""
    model, rng = sim.hand_model(name), np.random.default_rng(3)
    data = mujoco.MjData(model)
    data.qpos[:] = sim.close(model, "object")
    mujoco.mj_forward(model, data)
    loop = sim.HandLoop(model, data, "object")
    data.qvel[:] = rng.standard_normal(model.nv)
    mujoco.mj_forward(model, data)
    bodies = np.arange(model.nbody)
    points = data.xpos + 0.05 * rng.standard_normal((model.nbody, 3))
    still = np.zeros(3)
    for i in range(3):  # the torsion's axis is the first
        axes = np.tile(np.roll(np.eye(3), -i, axis=0), (model.nbody, 1, 1))
        dims = np.full(model.nbody, 4)
        found = loop._joints.follow(points, axes, dims, bodies, still, still, np.zeros(6))
        for body, point in enumerate(points):
            change = np.zeros((6, model.nv))
            mujoco.mj_jacDot(model, data, change[:3], change[3:], point, body)
            expected = change @ data.qvel
            wanted = [*-np.roll(expected[:3], -i), -expected[3 + i]]
            assert_allclose(found[4 * body : 4 * body + 4], wanted, atol=1e-10)
        assert np.abs(found).max() > 0.1


def test_sim_hands_change_their_forces_no_faster_than_they_may(moved):
    trial, log = moved
    assert np.abs(np.diff(log.c[1:], axis=0)).max() <= trial.gains.force_rate / trial.rate + 1e-9


def torque_bound(trial):
    """How much each torque may change in a tick by the forces' rate alone, shape (n_joints,)."""
    data = mujoco.MjData(trial.model)
    data.qpos[:] = trial.start
    mujoco.mj_forward(trial.model, data)
    loop = sim.HandLoop(trial.model, data, "object")
    return np.abs(loop.reader.J).sum(axis=0) * trial.gains.force_rate / trial.rate


@pytest.mark.parametrize("name", ["panda", "leap", "shadow"])
def test_sim_hands_flicker_changes_torques_within_a_bound(name):
    (trial,) = sim.own(sim.hand_model(name), "object", disturbance="dropout", duration=0.5)
    assert trial.disturbance.dropout == 0.1
    log = sim.run(trial)
    steps = np.abs(np.diff(log.tau, axis=0)).max(axis=0)
    # What moves the joints' own inertia is of the object's motion, and next to nothing at rest.
    assert (steps <= torque_bound(trial) + 1e-3).all()
    assert (log.tau_max > 10 * steps).all()


@pytest.mark.parametrize("name", ["panda", "allegro"])
def test_sim_hands_contacts_that_flicker_move_nothing(name):
    model = sim.hand_model(name)
    (trial,) = sim.own(model, "object", disturbance="dropout", duration=0.5)
    log = sim.run(trial)
    assert log.verdict == "held"
    assert 1e3 * log.position_error.max() <= 0.1
    assert np.abs(np.diff(log.c[1:], axis=0)).max() <= trial.gains.force_rate / trial.rate
    calm = sim.run(dataclasses.replace(trial, disturbance=sim.Disturbance()))
    # A place that is a tick old, of an object that rests, is as good as a new one.
    assert np.abs(np.diff(log.tau, axis=0)).max() <= np.abs(np.diff(calm.tau, axis=0)).max() + 0.02


@pytest.mark.parametrize("name", ["panda", "leap", "two_hands"])
def test_sim_hands_hold_while_the_ground_shakes_at_1_g(name):
    (trial,) = sim.own(sim.hand_model(name), "object", shake=1.0, duration=0.6)
    log = sim.run(trial)
    assert log.verdict == "held"
    assert 1e3 * log.position_error.max() <= 0.5
    assert 1e3 * log.slip.max() <= 0.5


def test_sim_hands_unknown_hand():
    with pytest.raises(gf.InvalidInputError, match="got 'claw', expected one of allegro"):
        sim.hand_model("claw")


# ---- a loop of one's own -----------------------------------------------------------------------


def started(model, **options):
    data = mujoco.MjData(model)
    data.qpos[:] = sim.close(model, "box")
    mujoco.mj_forward(model, data)
    return data, sim.HandLoop(model, data, "box", **options)


def stepped(model, data, loop, ticks):
    commands = []
    for _ in range(ticks):
        mujoco.mj_step1(model, data)
        commands.append(loop.step(data.time))
        mujoco.mj_step2(model, data)
    return commands


def test_hand_loop_holds_in_ten_lines():
    model = jaws(BOTH)
    data, loop = started(model)
    before = data.body("box").xpos.copy()
    assert loop.joint_names == ("left", "right")
    assert loop.links.count("left") == 4
    commands = stepped(model, data, loop, 300)
    assert_allclose(data.body("box").xpos, before, atol=1e-5)
    # Twice the force with which two pads of friction 0.8 just hold it.
    forces, links = commands[-1].solution.normal_forces, np.array(loop.links)
    normal = [forces[links == name].sum() for name in ("left", "right")]
    assert_allclose(normal, 2 * 0.2 * 9.81 / 2 / 0.8, rtol=0.1)


# A third pad, beside the box, that comes to touch it late.
LATE = """<body name="late" pos="0 -.1 .1"><joint name="late" type="slide" axis="0 1 0"/>
  <geom type="box" size=".01 .005 .01" mass=".1"/></body>"""


def jaws_and_a_third():
    motor = '<motor name="mlate" joint="late" ctrlrange="-20 20"/>'
    return jaws(BOTH + motor, more=f"<worldbody>{LATE}</worldbody>")


def test_hand_loop_counts_on_contacts_that_come_late():
    model = jaws_and_a_third()
    data = mujoco.MjData(model)
    data.qpos[:] = sim.close(model, "box")
    slide = model.joint("late").qposadr[0]
    data.qpos[slide] = 0.0
    mujoco.mj_forward(model, data)
    loop = sim.HandLoop(model, data, "box")
    assert "late" not in loop.links
    assert not loop.holding[loop.joint_names.index("late")]
    before = stepped(model, data, loop, 30)
    data.qpos[slide] = 0.0752  # it stands 0.2 mm in the box
    after = stepped(model, data, loop, 200)
    assert "late" in loop.links
    assert loop.holding[loop.joint_names.index("late")]
    own = np.array(loop.links) == "late"
    assert loop.book.engagement[own].max() == 1
    assert not any(each.kept or each.without_slot for each in after)
    forces = np.array([each.solution.c for each in (*before[1:], *after)])
    assert np.abs(np.diff(forces, axis=0)).max() <= 500 * model.opt.timestep + 1e-9
    assert after[-1].solution.normal_forces[own].max() > 0


def test_hand_loop_says_what_it_has_no_room_for(monkeypatch):
    monkeypatch.setattr("graspforce.sim.hand_loop._SPARE_SLOTS", 1)
    model = jaws_and_a_third()
    data = mujoco.MjData(model)
    data.qpos[:] = sim.close(model, "box")
    slide = model.joint("late").qposadr[0]
    data.qpos[slide] = 0.0
    mujoco.mj_forward(model, data)
    loop = sim.HandLoop(model, data, "box")
    assert stepped(model, data, loop, 5)[-1].without_slot == 0
    data.qpos[slide] = 0.0752
    assert stepped(model, data, loop, 2)[-1].without_slot == 3  # of four corners


def test_hand_loop_ticks_without_an_answer_keep_the_last_torques():
    model = jaws(BOTH)
    data, loop = started(model)
    good = stepped(model, data, loop, 20)[-1]
    limits = loop.motors.limits
    # As if the motors had lost their strength: no torque of any use is within these.
    loop.motors.limits = lambda data: (np.full(2, 5.0), np.full(2, 6.0))
    loop._mu = 0.01
    kept = stepped(model, data, loop, 5)
    assert all(each.kept for each in kept)
    assert {str(each.solution.status) for each in kept} == {"INFEASIBLE"}
    for each in kept:
        assert_allclose(each.tau, np.clip(good.tau, 5.0, 6.0))
    loop.motors.limits = limits
    loop._mu = None
    again = stepped(model, data, loop, 20)
    assert not again[-1].kept
    assert_allclose(again[-1].tau, good.tau, atol=0.05)


def test_hand_loop_wants_contacts_that_a_motor_makes():
    model = jaws(BOTH)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with pytest.raises(gf.InvalidInputError, match="nothing touches 'box', expected fingers"):
        sim.HandLoop(model, data, "box")


def test_ticks_that_the_law_cannot_bear_are_refused_beforehand():
    model = jaws(BOTH)
    data = mujoco.MjData(model)
    data.qpos[:] = sim.close(model, "box")
    mujoco.mj_forward(model, data)
    with pytest.raises(gf.InvalidInputError, match=r"rate: got 20 Hz, expected 40 Hz or more"):
        sim.HandLoop(model, data, "box", rate=20.0)
    stiff = sim.Gains(object_stiffness=1e5, object_damping=200.0)
    with pytest.raises(gf.InvalidInputError, match=r"expected 500 Hz or more with an object stiff"):
        sim.Trial("stiff", "", model, data.qpos, body="box", gains=stiff, rate=250.0)


def test_sim_hands_nan_ends_the_run_with_tick_and_cause(monkeypatch):
    model = jaws(BOTH)
    (trial,) = sim.own(model, "box", duration=0.2)
    push = sim.Push((1e13, 0.0, 0.0), start=0.05, duration=0.1)
    log = sim.run(dataclasses.replace(trial, disturbance=sim.Disturbance(pushes=(push,))))
    assert log.ending is sim.Ending.DIVERGED
    assert log.message.startswith("at tick 25 (0.050 s)")
    assert np.isfinite(log.position).all()


# ---- closing -----------------------------------------------------------------------------------


def test_closing_says_which_side_is_missing():
    model = jaws(BOTH, more='<contact><exclude body1="right" body2="box"/></contact>')
    with pytest.raises(gf.InvalidInputError) as caught:
        sim.close(model, "box")
    assert "all contacts are on one side of 'box'" in str(caught.value)
    assert "along (1.00, 0.00, 0.00)" in str(caught.value).replace("-0.00", "0.00")
    assert "left touches at 4 points" in str(caught.value)
    assert "right is 0.0 mm away" in str(caught.value)


def test_closing_says_how_far_fingers_stay():
    short = 'range="0 .002"'
    model = jaws(BOTH, joints=f'limited="true" {short}')
    with pytest.raises(gf.InvalidInputError, match=r"nothing touches 'box': left is 2\.\d mm away"):
        sim.close(model, "box")


def test_closing_says_that_the_motors_are_too_weak():
    weak = BOTH.replace('"-20 20"', '"-.5 .5"')
    with pytest.raises(gf.InvalidInputError, match="do not hold the weight of 'box' within"):
        sim.close(jaws(weak), "box")


@pytest.mark.filterwarnings("ignore:the file's limit:graspforce.GraspForceWarning")
def test_closing_aims_where_it_is_told():
    """The end of a finger comes to the point named and not to the nearest one."""
    model = sim.hand_model("allegro")
    closed = sim.close(model, "object", touch={"thumb_4": [0.0, 0.02, -0.0225]})
    data = mujoco.MjData(model)
    data.qpos[:] = closed
    mujoco.mj_forward(model, data)
    grasp = gf.hands.MujocoGrasp(model, data, "object")
    (at,) = grasp.points[[link == "thumb_4" for link in grasp.links]]
    local = data.body("object").xmat.reshape(3, 3).T @ (at - data.body("object").xpos)
    assert_allclose(local, [0.0, 0.02, -0.0225], atol=4e-3)
    with pytest.raises(gf.InvalidInputError, match="touch: got 'toe', expected fingers of index_4"):
        sim.close(model, "object", touch={"toe": [0, 0, 0]})


def test_inertia_of_an_object_that_hangs_on_another_is_its_own():
    """By the inertia of its parts; MuJoCo's composite one is about the whole tree's centre."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body><freejoint/>
      <geom type="box" size=".1 .2 .3" pos=".2 0 0"/>
      <body name="object" pos=".5 .1 .2" euler="20 30 40"><joint type="hinge" axis="0 1 0"/>
        <geom type="box" size=".02 .01 .03" mass=".1"/>
        <body pos="0 0 .1"><joint type="slide"/><geom type="sphere" size=".02" mass=".05"/></body>
      </body></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    expected = np.zeros((3, 3))
    for body in (2, 3):
        R, arm = data.ximat[body].reshape(3, 3), data.xipos[body] - data.subtree_com[2]
        expected += R @ np.diag(model.body_inertia[body]) @ R.T
        expected += model.body_mass[body] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    found = object_inertia(model, data, model.body("object").id)
    assert_allclose(found, expected, atol=1e-12)


# ---- motors ------------------------------------------------------------------------------------

KINDS = {
    "motor": '<motor name="m{0}" joint="{0}" ctrlrange="-20 20"/>',
    "gear": '<motor name="m{0}" joint="{0}" gear="-4" ctrlrange="-5 5"/>',
    "position": '<position name="m{0}" joint="{0}" kp="800" kv="10" ctrlrange="-1 1"/>',
    "velocity": '<velocity name="m{0}" joint="{0}" kv="100" ctrlrange="-1 1"/>',
    "general": '<general name="m{0}" joint="{0}" gaintype="affine" gainprm="10 5 0" '
    'biastype="affine" biasprm="1 -2 -3" ctrlrange="-3 3"/>',
    "cylinder": '<cylinder name="m{0}" joint="{0}" area="2" timeconst=".02" ctrlrange="-9 9"/>',
    "exact": '<general name="m{0}" joint="{0}" dyntype="filterexact" dynprm=".02" gainprm="2" '
    'ctrlrange="-9 9"/>',
    "lagging servo": '<position name="m{0}" joint="{0}" kp="800" timeconst=".01" '
    'ctrlrange="-1 1" forcerange="-20 20"/>',
    "integrated": '<intvelocity name="m{0}" joint="{0}" kp="800" ctrlrange="-50 50" '
    'actrange="-1 1"/>',
    "muscles": '<muscle name="a{0}" joint="{0}" force="40" lengthrange="-.1 .1" gear="1"/>'
    '<muscle name="b{0}" joint="{0}" force="40" lengthrange="-.1 .1" gear="-1"/>',
}  # fmt: skip


def of_kind(kind):
    return jaws("".join(KINDS[kind].format(name) for name in ("left", "right")))


@pytest.mark.parametrize("kind", KINDS)
def test_motors_make_the_torques_that_they_say(kind):
    model = of_kind(kind)
    motors = gf.hands.MujocoMotors(model)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[:2], data.qvel[:2] = (0.004, -0.003), (0.02, -0.01)
    mujoco.mj_forward(model, data)
    lo, hi = motors.limits(data)
    assert (lo < hi).all()
    for _ in range(10):
        tau = lo + rng.random(2) * (np.minimum(hi, 30) - np.maximum(lo, -30))
        tau = np.clip(tau, np.maximum(lo, -30), np.minimum(hi, 30))
        made = motors.write(data, tau, 1e-3, at_once=True)
        mujoco.mj_forward(model, data)
        assert_allclose(data.qfrc_actuator[:2], made, atol=1e-9)
        assert_allclose(made, tau, atol=1e-9)
    beyond = motors.write(data, 2 * hi + 1, 1e-3, at_once=True)
    assert (beyond <= hi + 1e-9).all()


@pytest.mark.parametrize("kind", KINDS)
def test_hand_loop_holds_by_motors_of_every_kind(kind):
    model = of_kind(kind)
    (trial,) = sim.own(model, "box", duration=0.2, rate=1000.0)
    log = sim.run(trial)
    assert log.verdict == "held"
    assert 1e3 * log.position_error.max() <= 0.1
    assert log.torque_use <= 1


def test_motors_that_lag_are_led():
    """A filter's control goes beyond what is wanted, so that it is there after one tick."""
    model = of_kind("cylinder")
    motors, data = gf.hands.MujocoMotors(model), mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    made = motors.write(data, [0.5, -0.5], 1e-3)
    assert_allclose(made, [0.5, -0.5])
    assert_allclose(data.ctrl, [5.0, -5.0])
    mujoco.mj_step(model, data)
    assert_allclose(2 * data.act, [0.5, -0.5])


@pytest.mark.parametrize(
    ("kind", "steps"),
    [
        *itertools.product(("cylinder", "exact", "lagging servo", "integrated"), (1, 4)),
        ("muscles", 1),  # whose pace changes with every step
    ],
)
def test_motors_that_lag_make_what_they_say_when_the_tick_is_over(kind, steps):
    """In MuJoCo, whose joints are held where the motors were told."""
    model = of_kind(kind)
    motors, data, rng = gf.hands.MujocoMotors(model), mujoco.MjData(model), np.random.default_rng(1)
    for _ in range(10):
        data.act[:] = rng.uniform(0.1, 0.5, model.na)
        data.qpos[:2], data.qvel[:2] = rng.uniform(-4e-3, 4e-3, 2), rng.uniform(-0.02, 0.02, 2)
        mujoco.mj_forward(model, data)
        qpos, qvel = data.qpos.copy(), data.qvel.copy()
        lo, hi = motors.limits(data)
        near = data.qfrc_actuator[:2] + rng.uniform(-0.05, 0.05, 2) * np.minimum(hi - lo, 20)
        made = motors.write(data, np.clip(near, lo, hi), steps * model.opt.timestep)
        for _ in range(steps):
            mujoco.mj_step(model, data)
            data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        assert_allclose(data.qfrc_actuator[:2], made, atol=1e-9)


def test_motors_of_unknown_kinds_are_named():
    model = jaws(BOTH)
    model.actuator_gaintype[1] = int(mujoco.mjtGain.mjGAIN_USER)
    with pytest.raises(gf.ModelImportError, match=r"actuator 'mright': got the gain type 'user'"):
        gf.hands.MujocoMotors(model)
    with pytest.raises(gf.InvalidInputError, match="got 'up', which has no motor, expected some"):
        gf.hands.MujocoMotors(model, ["up"])


def test_motors_without_a_limit_take_tau_max():
    model = jaws("".join(f'<position joint="{n}" kp="500"/>' for n in ("left", "right")))
    with pytest.raises(gf.ModelImportError, match="'left': its motor has no limit"):
        sim.close(model, "box")
    start = sim.close(model, "box", tau_max=10.0)
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    loop = sim.HandLoop(model, data, "box", tau_max=10.0)
    assert_allclose(loop.tau_hi, 10.0)
    assert not stepped(model, data, loop, 50)[-1].kept


# ---- the command -------------------------------------------------------------------------------


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "jaws.xml"
    mujoco.mj_saveLastXML(str(path), jaws(BOTH))
    return path


def simulate(*arguments):
    return CliRunner().invoke(cli.app, ["simulate", *map(str, arguments)])


def test_simulate_takes_a_scene_of_ones_own(scene, tmp_path):
    out = simulate(
        "--model", scene, "--object", "box", "--set", "duration=.1", "--log", tmp_path / "l.npz"
    )
    assert out.exit_code == 0, out.output
    assert "box held" in out.output
    assert "kept" in out.output
    with np.load(tmp_path / "l.npz") as data:
        assert len(data["t"]) == 50
        assert not data["kept"].any()


def test_simulate_studies_disturbances_on_any_scene(scene):
    out = simulate(
        "--model", scene, "--object", "box", "--set", "duration=.05", "--disturbance", "all"
    )
    assert out.exit_code == 0, out.output
    for kind in ("push", "payload", "friction", "noise", "delay", "dropout"):
        assert f"jaws, {kind}" in out.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--object", "lid"], "object: got 'lid', expected a body of the model: left, right, box"),
        ([], "--object: missing; --model came without it"),
        (["--object", "box", "--move", "up"], "--move: got 'up', expected numbers like 0,0,.02"),
        (["--object", "box", "--set", "way=1"], "way: not an option with --model; expected one of"),
        (["--object", "box", "--disturbance", "rain"], "disturbance: got 'rain', expected all"),
        (["hold", "--object", "box"], "expected one of the two"),
    ],
)
def test_simulate_says_what_is_wrong_with_a_scene(scene, arguments, message):
    out = simulate("--model", scene, *arguments)
    assert out.exit_code == 2
    assert message in out.stderr
    assert out.stderr.count("\n") == 1


def test_simulate_a_file_that_is_no_scene(tmp_path):
    out = simulate("--model", tmp_path / "no.xml", "--object", "box")
    assert out.exit_code == 2
    assert "there is no such file" in out.stderr
    out = simulate("hold", "--turn", "5")
    assert "--turn: goes with --model only" in out.stderr
