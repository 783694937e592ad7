"""A scene that a user writes: an own MJCF, its motors and names, and pictures of it."""

import dataclasses
import math

import numpy as np
import pytest

import graspforce as gf
from graspforce import sim, trajectory
from graspforce.sim import render
from graspforce.sim.reach import reach

mujoco = pytest.importorskip("mujoco")

CENTRE = np.array([0.0, 0.0, 0.1])
RADIUS, TIP = 0.03, 0.006  # of the can and of the fingertips [m]
MASS = 0.2  # [kg]
MOTOR = 'name="{0}" ctrlrange="-.4 .4"'


def can_in_three_fingers(motor=MOTOR, option=""):
    """A can in three fingers, written with no thought of graspforce: no camera, plain colours."""
    fingers = "".join(
        f"""<body pos="{0.06 * math.cos(a)} {0.06 * math.sin(a)} 0" euler="0 0 {math.degrees(a)}">
          <joint name="a{i}" axis="1 0 0"/><joint name="b{i}" axis="0 1 0"/>
          <geom type="capsule" size=".005" fromto="0 0 0 0 0 .06" mass=".02" contype="0"
            conaffinity="0"/>
          <body pos="0 0 .06"><joint name="c{i}" axis="0 1 0"/>
            <geom type="capsule" size=".005" fromto="0 0 0 0 0 .06" mass=".02" contype="0"
              conaffinity="0"/>
            <geom name="t{i}" size="{TIP}" pos="0 0 .06" mass=".002"/></body></body>"""
        for i, a in enumerate(2 * math.pi / 3 * np.arange(3), 1)
    )
    motors = "".join(
        f'<motor joint="{joint}{i}" {motor.format(f"{joint}{i}")}/>'
        for i in (1, 2, 3) for joint in "abc"
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option cone="elliptic" impratio="100" noslip_iterations="3" timestep=".001"
            integrator="implicitfast" {option}/>
          <default><geom solref=".002 1" solimp=".95 .99 .001" friction=".8"/></default>
          <worldbody>{fingers}
            <body name="can" pos="0 0 .1"><freejoint/>
              <geom type="cylinder" size="{RADIUS} .03" mass="{MASS}"/></body></worldbody>
          <actuator>{motors}</actuator></mujoco>"""
    )
    outward = [[math.cos(a), math.sin(a), 0.0] for a in 2 * math.pi / 3 * np.arange(3)]
    grips = tuple(sim.Grip(RADIUS * np.array(o), np.negative(o)) for o in outward)
    fingers = tuple(sim.Finger((f"a{i}", f"b{i}", f"c{i}"), f"t{i}") for i in (1, 2, 3))
    start = model.qpos0.copy()
    start[:9] = np.tile([0.0, -0.8, 1.2], 3)
    tips = [CENTRE + grip.point - TIP * grip.normal for grip in grips]
    return sim.Trial(
        name="can", summary="a can goes up by 1 cm", model=model,
        start=reach(model, start, fingers, tips), fingers=fingers, grips=grips, body="can",
        motion=trajectory.Move(CENTRE, np.array([0.0, 0.0, 0.01]), 0.1, 0.4), mu=0.8, duration=0.6,
    )  # fmt: skip


@pytest.fixture(scope="module")
def run():
    trial = can_in_three_fingers()
    return trial, sim.run(trial)


def test_sim_an_own_hand_lifts_an_own_can(run):
    _, log = run
    assert log.verdict == "held"
    assert log.position[-1, 2] - log.position[0, 2] == pytest.approx(0.01, abs=1e-4)
    assert 1e3 * log.position_error.max() <= 0.1
    assert log.tau_max.tolist() == [0.4] * 9
    assert log.torque_use <= 1
    np.testing.assert_allclose(log.force[-1].sum(axis=0), [0, 0, MASS * 9.81], atol=0.01)


@pytest.mark.parametrize(
    "motor",
    [
        'name="motor of {0}" ctrlrange="-.4 .4"',
        'gear="5" ctrlrange="-.08 .08"',
        'gear="-2" ctrlrange="-1 1" forcerange="-.2 .2"',
    ],
    ids=["another name", "geared", "reversed"],
)
def test_sim_whatever_the_motors_are_called_and_geared_the_joints_get_the_same(run, motor):
    log = sim.run(can_in_three_fingers(motor))
    np.testing.assert_allclose(log.tau_max, 0.4)
    np.testing.assert_allclose(log.position, run[1].position, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (' name="{0}" ctrlrange="-.4 .4"', "", "joint 'a1': its motor's limit is inf"),
        ('ctrlrange="-.4 .4"', 'ctrlrange="0 .4"', "'a1': its motor's limit is -?0 N·m"),
    ],
)
def test_sim_motors_without_a_limit_are_refused(old, new, message):
    with pytest.raises(gf.ModelImportError, match=message):
        sim.run(can_in_three_fingers(f" {MOTOR}".replace(old, new)))


def edited(trial, change):
    """The trial with its model's MJCF changed by ``change``, a function of an MjSpec."""
    spec = mujoco.MjSpec()
    hinge = spec.worldbody.add_body(name="object")
    hinge.add_freejoint()
    hinge.add_geom(name="ball", size=(0.01, 0, 0))
    finger = spec.worldbody.add_body()
    finger.add_joint(name="a")
    finger.add_geom(name="tip", size=(0.01, 0, 0), pos=(0.1, 0, 0))
    change(spec)
    model = spec.compile()
    return dataclasses.replace(
        trial, model=model, start=model.qpos0, fingers=(sim.Finger(("a",), "tip"),),
        grips=trial.grips[:1], body="object",
    )  # fmt: skip


def servo(spec):
    actuator = spec.add_actuator(name="servo", target="a", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=5.0)


def ball(spec):
    spec.joint("a").type = mujoco.mjtJoint.mjJNT_BALL


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda spec: None, "joint 'a': expected one <motor>, got no actuator"),
        (servo, "joint 'a': expected one <motor>, got 'servo'; the loop commands torques"),
        (ball, "joint 'a': expected a hinge or a slide"),
    ],
    ids=["none", "position servo", "ball joint"],
)
def test_sim_joints_that_take_no_torque_are_refused(run, change, message):
    with pytest.raises(gf.ModelImportError, match=message):
        sim.run(edited(run[0], change))


def test_sim_trials_that_do_not_fit_their_model(run):
    trial, _ = run
    for change, message in (
        ({"model": "can.xml"}, "model: got a str, expected an mujoco.MjModel"),
        ({"start": np.zeros(3)}, r"start: got shape \(3,\), expected shape \(16,\)"),
        ({"fingers": (*trial.fingers[:2], trial.fingers[0])}, "fingers: got 'a1' twice"),
        ({"fingers": (), "grips": (), "ground": "floor"}, "fingers: got none, expected them"),
        ({"motion": None}, "motion: missing; fingers came without it"),
    ):
        with pytest.raises(gf.InvalidInputError, match=message):
            dataclasses.replace(trial, **change)
    with pytest.raises(gf.InvalidInputError, match=r"normal: got .* of length 2"):
        sim.Grip([0.03, 0, 0], [-2, 0, 0])
    with pytest.raises(gf.ModelImportError, match=r"geom 'can': not in the model.*'t1', 't2'"):
        sim.run(dataclasses.replace(trial, fingers=(sim.Finger(("a1", "b1", "c1"), "can"),),
                                    grips=trial.grips[:1]))  # fmt: skip


def test_sim_an_object_out_of_reach_is_dropped_and_the_fingers_named(run):
    trial, _ = run
    start = trial.start.copy()
    start[9:12] += [0.0, 0.2, 0.0]
    log = sim.run(dataclasses.replace(trial, start=start))
    assert log.ending is sim.Ending.DROPPED
    assert log.message.startswith(
        "at tick 0 (0.000 s) the object was 200 mm off its target, not in contact: t1, t2, t3"
    )
    assert len(log.t) == 1


def test_sim_two_points_that_cannot_twist_an_object_say_so(run):
    """Two point contacts give no torque about the line between them, and the law asks for some."""
    trial, _ = run
    noise = sim.Disturbance(angle_noise=0.01)
    log = sim.run(
        dataclasses.replace(trial, fingers=trial.fingers[:2], grips=trial.grips[:2],
                            disturbance=noise)
    )  # fmt: skip
    assert log.ending is sim.Ending.DROPPED
    assert np.all(log.status == gf.Status.WRENCH_UNREACHABLE)
    assert (
        "; tick 0 was the first that was not solved: the wrench is outside the range of W: these "
        "contacts cannot make it, whatever their forces" in log.message
    )
    assert "N·m about" in log.message
    assert "soft fingers" in log.message


def test_sim_divergence_is_seen_with_mujocos_reset_switched_on(run):
    """MuJoCo starts a diverged simulation again from its first pose unless it is told not to."""
    trial, _ = run
    push = sim.Disturbance(pushes=(sim.Push((1e13, 0.0, 0.0), start=0.05, duration=0.1),))
    log = sim.run(dataclasses.replace(trial, disturbance=push))
    assert log.ending is sim.Ending.DIVERGED
    assert "at tick 25 (0.050 s)" in log.message
    assert np.isfinite(log.position).all()


# ---- pictures ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def camera(run):
    try:
        camera = render.Camera(*run)
    except sim.RenderError as error:
        pytest.skip(str(error))
    with camera:
        yield camera


def pixel(camera, point):
    """Where a point is in the picture: column and row, through a pinhole."""
    left, right_ = camera._scene.camera  # a pair of eyes
    middle, forward, up = (left.pos + right_.pos) / 2, left.forward, left.up
    right = np.cross(forward, up)
    ray = point - middle
    height, width = camera.image(0).shape[:2]
    scale = (
        height / 2 / math.tan(math.radians(camera._model.vis.global_.fovy) / 2) / (ray @ forward)
    )
    return round(width / 2 + scale * (ray @ right)), round(height / 2 - scale * (ray @ up))


def test_sim_arrows_are_as_long_as_their_forces(run, camera):
    trial, log = run
    tick = 200
    length = camera._length
    # Half as long as the contacts are apart is the largest force of the middling tick.
    apart = np.linalg.norm(trial.grips[0].point - trial.grips[1].point)
    largest = np.median(np.linalg.norm(log.force, axis=-1).max(axis=1))
    assert length * largest == pytest.approx(apart / 2)
    camera._length = 0.0
    without = camera.image(tick).astype(int)
    camera._length = length
    changed = np.abs(camera.image(tick) - without).sum(axis=2) > 30
    for finger in range(3):
        start, way = log.point[tick, finger], length * log.force[tick, finger]
        for share, drawn in ((0.15, True), (0.5, True), (0.93, True), (1.1, False)):
            column, row = pixel(camera, start + share * way)
            near = changed[row - 1 : row + 2, column - 1 : column + 2]
            assert near.any() == drawn, (finger, share)


def test_sim_what_is_in_the_object_is_seen_through_it(run, camera):
    trial, _ = run
    assert trial.model.geom("t1").rgba[3] == 1  # the user's model stays as it is
    body = camera._model.geom_bodyid == camera._model.body("can").id
    assert camera._model.geom_rgba[body, 3].max() < 0.5
    assert camera._model.geom_rgba[~body, 3].min() == 1
    assert trial.model.geom_rgba[body, 3].min() == 1


def test_sim_an_own_scene_is_drawn_at_any_size(run, camera, tmp_path):
    pytest.importorskip("imageio")
    assert run[0].model.vis.global_.offwidth == 640
    sim.save_still(*run, tmp_path / "can.png", 0.3)
    assert (tmp_path / "can.png").stat().st_size > 10_000
