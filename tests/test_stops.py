"""Joints that lean on stops, brakes, and motors that the user names, through every door."""

from __future__ import annotations

from contextlib import nullcontext

import mujoco
import numpy as np
import pytest

import graspforce as gf
from graspforce.hands import MujocoGrasp, PinocchioGrasp, from_mjcf, from_urdf

HEAD = """<mujoco><compiler angle="radian" autolimits="true"/>
  <option cone="elliptic" impratio="100" noslip_iterations="5" timestep=".001"
    integrator="implicitfast"/>
  <default><geom friction="1" solref=".004 1"/><equality solref=".002 1"/>
    <joint damping=".02" armature=".001" solreflimit=".002 1"/></default>"""


NAMES = {1: "a", -1: "b"}  # of the fingers on the two sides of x


def settled(text, ctrl, start=(), steps=3000, hold=None):
    """Return a scene after some seconds; an object called ``hold`` is held for the first."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for name, angle in dict(start).items():
        data.joint(name).qpos[:] = angle
    where = None if hold is None else np.array(data.joint(hold).qpos)
    for step in range(steps):
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data)
        if where is not None and step < 800:
            data.joint(hold).qpos[:], data.joint(hold).qvel[:] = where, 0
    return model, data


def holds_as_physics_does(reader, data, model, rest=1e-3):
    """The physics' forces are a solution: of W c = f, of what motors do, and of what stops bear."""
    c = reader.contact_forces(data)
    by_motor = np.array([
        data.actuator_force[model.actuator_trnid[:, 0] == model.tendon(name).id][0]
        if name in tendons(model)
        else data.qfrc_actuator[model.joint(name).dofadr[0]]
        for name in reader.joint_names
    ])  # fmt: skip
    asked, motors = reader.J.T @ c + reader.tau_bias, reader.actuation.stopped == 0
    if len(reader.internal):
        among = reader.internal[:, motors].T
        asked += reader.internal.T @ np.linalg.lstsq(among, (by_motor - asked)[motors])[0]
    np.testing.assert_allclose(asked[motors], by_motor[motors], atol=rest, rtol=rest)
    assert ((asked - by_motor) * reader.actuation.stopped >= 0).all()
    np.testing.assert_allclose(reader.passive_rows @ c, reader.passive_loads, atol=rest)
    assert (reader.A @ c <= reader.b + rest).all()
    return c


def tendons(model):
    return [model.tendon(i).name for i in range(model.ntendon)]


def finger(side, low):
    return f"""<body pos="{0.045 * side} 0 0" euler="0 0 {0 if side > 0 else np.pi}">
      <joint name="root_{NAMES[side]}" axis="0 -1 0"/>
      <geom type="capsule" size=".005" fromto="0 0 0 0 0 .05" mass=".02"/>
      <body name="link_{NAMES[side]}" pos="0 0 .05">
        <joint name="tip_{NAMES[side]}" axis="0 -1 0" range="{low} 1.5"/>
        <geom type="capsule" size=".005" fromto="0 0 0 0 0 .05" mass=".02"/>
        <geom type="box" size=".006 .012 .012" pos="-.006 0 .05" mass=".005"/></body></body>"""


CUBE = """<body name="cube" pos="0 0 .1"><joint type="free" name="cube" damping="0" armature="0"/>
  <geom type="box" size=".028 .015 .015" mass=".1"/></body>"""
ACTUATORS = {
    "root motors": "".join(f'<motor joint="root_{NAMES[s]}" ctrlrange="-1 1"/>' for s in (1, -1)),
    "tendons": "".join(f'<motor tendon="pull_{NAMES[s]}" ctrlrange="0 100"/>' for s in (1, -1)),
    "weak motors at the tips": "".join(
        f'<motor joint="{j}_{NAMES[s]}" ctrlrange="-{m} {m}"/>'
        for s in (1, -1)
        for j, m in (("root", 1), ("tip", 0.01))
    ),
    "antagonists": "".join(
        f'<motor tendon="{t}_{NAMES[s]}" ctrlrange="0 100"/>'
        for s in (1, -1)
        for t in ("flexor", "extensor")
    ),
    "antagonists and weak ones at the tips": "".join(
        f'<motor tendon="{t}_{NAMES[s]}" ctrlrange="0 {m}"/>'
        for s in (1, -1)
        for t, m in {"flexor": 100, "extensor": 100, "tip_flexor": 1, "tip_extensor": 1}.items()
    ),
}
ARMS = {
    "pull": {"root": 0.012, "tip": 0.003},
    "flexor": {"root": 0.012},
    "extensor": {"root": -0.008},
    "tip_flexor": {"tip": 0.004},
    "tip_extensor": {"tip": -0.005},
}
TENDONS = "".join(
    f'<fixed name="{tendon}_{NAMES[s]}">'
    + "".join(f'<joint joint="{j}_{NAMES[s]}" coef="{arm}"/>' for j, arm in arms.items())
    + "</fixed>"
    for s in (1, -1)
    for tendon, arms in ARMS.items()
)


def gripper(actuators, low=-0.17):
    return (
        f"{HEAD}<worldbody>{finger(1, low)}{finger(-1, low)}{CUBE}</worldbody>"
        f"<tendon>{TENDONS}</tendon><actuator>{ACTUATORS[actuators]}</actuator></mujoco>"
    )


WEIGHT = [0, 0, 0.1 * 9.81, 0, 0, 0]
CTRL = {
    "root motors": 0.6,
    "tendons": 50.0,
    "weak motors at the tips": [0.6, 0, 0.6, 0],
    "antagonists": [60.0, 15.0, 60.0, 15.0],
    "antagonists and weak ones at the tips": [60.0, 15.0, 0.5, 0.2] * 2,
}


@pytest.mark.parametrize("actuators", ACTUATORS)
def test_a_finger_whose_tip_leans_on_its_stop_holds(actuators):
    start = {"tip_a": -0.17, "tip_b": -0.17, "root_a": 0.09, "root_b": 0.09}
    model, data = settled(gripper(actuators), CTRL[actuators], start)
    assert data.body("cube").xpos[2] > 0.09
    assert data.joint("tip_a").qpos[0] < -0.169
    grasp, reader = gf.Grasp.from_mujoco(model, data, "cube"), MujocoGrasp(model, data, "cube")
    holds_as_physics_does(reader, data, model, rest=2e-3)
    solution = gf.solve(grasp.problem(WEIGHT), check=True)
    assert solution.verify().ok
    said = [note for note in grasp.notes if note.startswith("at a stop") and "tip_a, tip_b" in note]
    assert len(said) == 1
    if "weak" in actuators:  # their stops bear more than they could
        at_tips = [name.startswith("tip") for name in grasp.joint_names]
        most = np.maximum(reader.tau_hi, -reader.tau_lo)
        assert (np.abs(solution.motor_forces) / most)[at_tips].max() > 2
        assert len(grasp.A) == 0
    else:
        assert len(grasp.A) == 2
        assert not len(grasp.passive_rows)
        assert (grasp.A @ solution.c < grasp.b).all()


def test_a_stop_does_not_pull():
    """Forces that turn the tips off their stops are borne by nothing."""
    q = {"root_a": 0.09, "root_b": 0.09, "tip_a": -0.17, "tip_b": -0.17}
    hand = two_fingers()
    onto, off = grasp_of(hand, q, 1), grasp_of(hand, q, -1)
    assert onto.notes == ("at a stop, which can push off what no motor moves, and not pull: "
                          "tip_a, tip_b",)  # fmt: skip
    assert gf.solve(onto.problem(WEIGHT)).status is gf.Status.SOLVED
    assert gf.solve(off.problem(WEIGHT)).status is gf.Status.INFEASIBLE
    # A hundredth off its stop a joint does not lean: nothing may load it.
    free = grasp_of(hand, q | {"tip_a": -0.16, "tip_b": -0.16}, 1)
    assert free.notes == ()
    assert free.A.shape == (0, 6)
    assert free.passive_rows.shape == (2, 6)
    assert gf.solve(free.problem(WEIGHT)).status is not gf.Status.SOLVED


def two_fingers():
    model = mujoco.MjModel.from_xml_string(gripper("root motors"))
    with pytest.warns(UserWarning, match="no motor controls"):
        return from_mjcf(model, ["link_a", "link_b"])


def grasp_of(hand, q, into):
    """Contacts at the fingers' ends that press the tips onto their stops (1), or off them (−1)."""
    q = [q[name] for name in hand.q_names]
    contacts = [
        gf.Contact((0.03 * side * into, 0, 0.1), (-side * into, 0, 0), gf.PCWF(0.8))
        for side in (1, -1)
    ]
    return gf.Grasp(contacts, hand, q, origin=(0, 0, 0.1))


def jaw(side, name):
    """A jaw as the 2F-85's: a driver, a coupler that may lean, a sprung link that bears the pad."""
    return f"""<body pos="{0.03 * side} 0 0" euler="0 0 {0 if side > 0 else np.pi}">
      <body pos=".02 0 .01"><joint name="driver{name}" axis="0 -1 0" range="-1 1"/>
        <geom type="capsule" size=".004" fromto="0 0 0 .02 0 .02" mass=".02" contype="0"/>
        <body name="coupler{name}" pos=".02 0 .02">
          <joint name="coupler{name}" axis="0 -1 0" range=".0862 1.5"/>
          <geom type="capsule" size=".003" fromto="0 0 0 -.02 0 .04" mass=".01" contype="0"/>
          <site name="one{name}" pos="-.02 0 .04"/></body></body>
      <body pos="0 0 .02"><joint name="spring{name}" axis="0 -1 0" stiffness=".05" springref=".1"/>
        <geom type="capsule" size=".003" fromto="0 0 0 .01 0 .03" mass=".01" contype="0"/>
        <body name="pad{name}" pos=".01 0 .03"><joint name="follower{name}" axis="0 -1 0"/>
          <geom type="capsule" size=".003" fromto="0 0 0 .01 0 .02" mass=".01" contype="0"/>
          <site name="other{name}" pos=".01 0 .02"/>
          <geom type="box" pos="-.004 0 .035" size=".003 .01 .015" mass=".01"/>
        </body></body></body>"""


@pytest.mark.parametrize("on_arm", [False, True], ids=["alone", "on an arm"])
def test_a_gripper_whose_couplers_lean_on_their_stops(on_arm):
    arm = """<body><joint name="lift" type="slide" axis="0 0 1" damping="20"/>
      <geom size=".01" mass=".3" contype="0"/><body><joint name="turn" axis="0 1 0" damping="2"/>
      <geom size=".01" mass=".3" contype="0"/>"""
    jaws = jaw(1, "R") + jaw(-1, "L")
    holders = '<position joint="lift" kp="3000" forcerange="-99 99"/>'
    holders += '<position joint="turn" kp="300" forcerange="-99 99"/>'
    text = f"""{HEAD}<worldbody>{arm + jaws + "</body></body>" if on_arm else jaws}
      <body name="cube" pos="0 0 .085"><joint type="free" name="cube" damping="0" armature="0"/>
        <geom type="box" size=".0335 .012 .012" mass=".1"/></body></worldbody>
      <equality><connect site1="oneR" site2="otherR"/><connect site1="oneL" site2="otherL"/>
        <joint joint1="driverR" joint2="driverL"/></equality>
      <tendon><fixed name="grip"><joint joint="driverR" coef=".5"/>
        <joint joint="driverL" coef=".5"/></fixed></tendon>
      <actuator>{holders if on_arm else ""}<motor tendon="grip" ctrlrange="-5 5"/></actuator>
      </mujoco>"""
    ctrl = [0.0, 0.0, 1.0] if on_arm else 1.0
    model, data = settled(text, ctrl, steps=5000, hold="cube")
    assert data.body("cube").xpos[2] > 0.07
    assert data.joint("couplerL").qpos[0] < 0.087
    with pytest.warns(UserWarning, match="placeholder") if on_arm else nullcontext():
        reader = MujocoGrasp(model, data, "cube")
        grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert sorted(reader.joint_names) == (["grip", "lift", "turn"] if on_arm else ["grip"])
    c = reader.contact_forces(data)
    bias = reader.J.T @ c + reader.tau_bias
    assert bias[reader.joint_names.index("grip")] == pytest.approx(1.0, abs=5e-3)
    if on_arm:  # all of the gripper moves with the arm
        lift = reader.joint_names.index("lift")
        np.testing.assert_allclose(reader.J[:, lift], reader.W[2], atol=1e-12)
    assert (reader.A @ c < reader.b).all()
    assert len(reader.passive_rows) == 0
    assert any("and not pull: couplerR, couplerL" in note for note in grasp.notes)
    assert not any("not in contact" in note for note in grasp.notes)
    assert gf.solve(grasp.problem(WEIGHT)).status is gf.Status.SOLVED


def test_a_stop_alone_is_no_motor():
    """Two jaws at their outer stops: what they squeeze is the motors', not the stops'."""
    jaws = "".join(
        f"""<body pos="{0.05 * s} 0 0">
          <joint name="jaw_{NAMES[s]}" type="slide" axis="{-s} 0 0" range="0 .1"/>
          <geom type="box" size=".01 .02 .02" mass=".1"/></body>"""
        for s in (1, -1)
    )
    text = f"""{HEAD}<worldbody>{jaws}<body name="cube"><freejoint/>
      <geom type="box" size=".0401 .02 .02" mass=".1"/></body></worldbody><actuator>
      <motor joint="jaw_a" ctrlrange="-5 5"/><motor joint="jaw_b" ctrlrange="-5 5"/></actuator>
      </mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert grasp.tau_lo.tolist() == [-5, -5]
    assert grasp.tau_hi.tolist() == [5, 5]
    assert any("the motors' limits hold at the stops of jaw_a, jaw_b" in n for n in grasp.notes)
    # With a strong motor on the other side, the stop bears what that presses into it.
    data.joint("jaw_b").qpos[:] = 0.001
    data.qpos[2] += 0.0005
    model.actuator_ctrlrange[1] = [-50, 50]
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    assert grasp.tau_hi[0] > 50
    assert grasp.tau_lo[0] == -5
    solution = gf.solve(grasp.problem(WEIGHT), check=True)
    assert 5 < solution.tau[0] < 50


def test_an_upper_stop_pushes_the_other_way():
    """A tip at the upper end of its range: the grip from the other side is the one that holds."""
    text = gripper("root motors").replace(' 1.5"/>', ' -.17"/>').replace('"-0.17 ', '"-1 ')
    with pytest.warns(UserWarning, match="no motor controls"):
        hand = from_mjcf(mujoco.MjModel.from_xml_string(text), ["link_a", "link_b"])
    onto, off = grasp_of(hand, Q, 1), grasp_of(hand, Q, -1)
    assert len(onto.A) == len(off.A) == 2
    assert gf.solve(onto.problem(WEIGHT)).status is gf.Status.INFEASIBLE
    assert gf.solve(off.problem(WEIGHT)).status is gf.Status.SOLVED


def test_a_tendon_at_the_end_of_its_range():
    text = gripper("root motors").replace(
        '<fixed name="pull_a">', '<fixed name="pull_a" range="0 1">'
    )
    model = mujoco.MjModel.from_xml_string(text)
    with pytest.warns(UserWarning, match="no motor controls"):
        hand = from_mjcf(model, ["link_a", "link_b"])
    q = {"root_a": 0.02, "tip_a": -0.08, "root_b": 0.0, "tip_b": 0.1}
    grasp = grasp_of(hand, q, 1)
    assert any("and not pull: pull_a" in note for note in grasp.notes)
    (row,) = grasp.A
    # The motor holds the root, so that the tendon's stop bears all that acts on the tip.
    plain = two_fingers().passive_rows(grasp.contacts, [q[n] for n in hand.q_names])
    across = plain[np.abs(plain[:, :3]).any(axis=1)][0]
    assert abs(row @ across) == pytest.approx(np.linalg.norm(row) * np.linalg.norm(across))


# ---- URDF and Pinocchio ------------------------------------------------------------------------


def urdf(effort=0.0, friction=0.0):
    links, joints = '<link name="palm"/>', ""
    for side, letter in NAMES.items():
        for name, parent, z, most in (
            (f"root_{letter}", "palm", 0.0, 1.0), (f"tip_{letter}", f"root_{letter}", 0.05, effort)
        ):  # fmt: skip
            x = 0.045 * side if parent == "palm" else 0.0
            turn = np.pi if parent == "palm" and side < 0 else 0.0
            low = -1.5 if name.startswith("root") else -0.17
            links += f"""<link name="{name}"><inertial><mass value=".02"/>
              <origin xyz="0 0 .025"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0"
              iyz="0"/></inertial></link>"""
            joints += f"""<joint name="{name}" type="revolute"><parent link="{parent}"/>
              <child link="{name}"/><origin xyz="{x} 0 {z}" rpy="0 0 {turn}"/><axis xyz="0 -1 0"/>
              <limit lower="{low}" upper="1.5" effort="{most}" velocity="1"/>
              <dynamics damping="0" friction="{friction}"/></joint>"""
    return f'<robot name="gripper">{links}{joints}</robot>'


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return path

    return write


Q = {"root_a": 0.09, "root_b": 0.09, "tip_a": -0.17, "tip_b": -0.17}


def of_pinocchio(path, q, contacts, **options):
    pinocchio = pytest.importorskip("pinocchio")
    robot = pinocchio.buildModelFromUrdf(str(path))
    angles = np.array([q[str(name)] for name in robot.names[1:]])
    return robot, angles, PinocchioGrasp(
        robot, angles, contacts, ["tip_a", "tip_b"], origin=(0, 0, 0.1), **options
    )  # fmt: skip


def test_every_door_sees_the_same_stops(written):
    path = written(urdf())
    with pytest.warns(UserWarning, match="no motor controls"):
        hand = from_urdf(path, ["tip_a", "tip_b"])
    from_file = grasp_of(hand, Q, 1)
    weightless = mujoco.MjModel.from_xml_path(str(path))
    with pytest.warns(UserWarning, match="no motor controls"):
        mjcf = from_mjcf(weightless, ["tip_a", "tip_b"], tau_max={"root_a": 1.0, "root_b": 1.0})
    other = grasp_of(mjcf, Q, 1)
    _, _, read = of_pinocchio(path, Q, from_file.contacts)
    assert from_file.joint_names == other.joint_names == read.joint_names == ("root_a", "root_b")
    for name in ("J", "tau_lo", "tau_hi", "tau_bias", "passive_rows", "A", "b"):
        expected = getattr(from_file, name)
        np.testing.assert_allclose(getattr(read, name), expected, atol=1e-12)
        np.testing.assert_allclose(getattr(other, name), expected, atol=1e-9)
    assert from_file.A.shape == (2, 6)
    assert from_file.notes == other.notes == read.notes[-1:]


def test_a_pinocchio_reader_sees_a_joint_reach_its_stop_and_leave_it(written):
    contacts = grasp_of(two_fingers(), Q, 1).contacts
    with pytest.warns(UserWarning, match="no motor controls"):
        _, angles, reader = of_pinocchio(written(urdf()), Q | {"tip_a": 0.0}, contacts)
    assert reader.A.shape == (1, 6)
    assert reader.passive_rows.shape == (1, 6)
    angles[:] = [Q[name] for name in ("root_a", "tip_a", "root_b", "tip_b")]
    reader.update(angles, contacts, origin=(0, 0, 0.1))
    assert reader.A.shape == (2, 6)
    assert reader.passive_rows.shape == (0, 6)
    assert "tip_a, tip_b" in reader.notes[-1]


# Joints with motors, whose limits their stops open, and without, whose stops are rows of A.
@pytest.mark.parametrize("effort", [1.0, 0.0])
def test_a_pinocchio_reader_sees_joints_go_from_one_stop_to_the_other(effort, written):
    path, contacts = written(urdf(effort)), grasp_of(two_fingers(), Q, 1).contacts
    _, _, reader = of_pinocchio(path, Q, contacts)
    before = reader.actuation
    _, angles, expected = of_pinocchio(path, Q | {"tip_a": 1.5, "tip_b": 1.5}, contacts)
    reader.update(angles, contacts, origin=(0, 0, 0.1))
    for name in ("J", "passive_rows", "A", "b", "stopped"):
        found = getattr(reader.actuation, name)
        np.testing.assert_allclose(found, getattr(expected.actuation, name), atol=1e-12)
    if effort:
        assert (before.stopped.tolist(), expected.actuation.stopped.tolist()) == (
            [0, 1, 0, 1], [0, -1, 0, -1]
        )  # fmt: skip
    else:
        assert np.abs(before.A - expected.A).max() > 0.01


# ---- brakes and motors -------------------------------------------------------------------------


def test_locked_joints_are_held_and_motors_are_those_named(written):
    path = written(urdf(effort=0.0))
    hand = from_urdf(path, ["tip_a", "tip_b"], locked=["tip_a", "tip_b"])
    assert hand.joint_names == ("root_a", "root_b")
    assert hand.q_names == ("root_a", "tip_a", "root_b", "tip_b")
    assert hand.notes == ("held whatever the contacts do to them: tip_a, tip_b",)
    free = Q | {"tip_a": 0.3, "tip_b": 0.3}
    locked = grasp_of(hand, free, -1)
    assert len(locked.passive_rows) == len(locked.A) == 0
    every = ["root_a", "root_b", "tip_a", "tip_b"]
    driven = from_urdf(path, ["tip_a", "tip_b"], tau_max=1.0, motors=every)
    assert driven.joint_names == ("root_a", "tip_a", "root_b", "tip_b")
    np.testing.assert_allclose(locked.J, grasp_of(driven, free, -1).J[:, [0, 2]], atol=1e-12)
    with pytest.warns(UserWarning, match="no motor controls 'tip_a'"):
        some = from_urdf(
            path, ["tip_a", "tip_b"], tau_max=1.0, motors=["root_a", "root_b", "tip_b"]
        )
    assert some.joint_names == ("root_a", "root_b", "tip_b")
    with pytest.raises(gf.ModelImportError, match="no torque limit for tip_a"):
        from_urdf(path, ["tip_a", "tip_b"], motors=["root_a", "tip_a", "root_b"])
    for name in ("locked", "motors"):
        with pytest.raises(gf.InvalidInputError, match=f"{name}: got 'thumb', expected some of"):
            from_urdf(path, ["tip_a", "tip_b"], **{name: ["thumb"]})
    contacts = locked.contacts
    _, _, read = of_pinocchio(path, free, contacts, locked=["tip_a", "tip_b"])
    np.testing.assert_allclose(read.J, locked.J, atol=1e-12)
    assert read.joint_names == hand.joint_names
    _, _, read = of_pinocchio(path, free, contacts, tau_max=1.0, motors=list(driven.joint_names))
    assert read.joint_names == driven.joint_names


def test_locked_and_motors_of_mujocos_doors():
    start = {"tip_a": -0.17, "tip_b": -0.17, "root_a": 0.09, "root_b": 0.09}
    model, data = settled(gripper("root motors"), 0.6, start, steps=500)
    tips = ["tip_a", "tip_b"]
    locked = gf.Grasp.from_mujoco(model, data, "cube", locked=tips)
    assert locked.joint_names == ("root_a", "root_b")
    assert len(locked.A) == len(locked.passive_rows) == 0
    assert "held whatever the contacts do to them: tip_a, tip_b" in locked.notes
    reader = MujocoGrasp(model, data, "cube", locked=tips)
    np.testing.assert_array_equal(reader.J, locked.J)
    other = gf.Grasp.from_mujoco(
        model, data, "cube", motors=["tip_a", "root_b", "tip_b"], tau_max=1.0, locked=["root_a"]
    )
    assert other.joint_names == ("tip_a", "root_b", "tip_b")
    hand = from_mjcf(model, ["link_a", "link_b"], locked=tips)
    assert hand.joint_names == ("root_a", "root_b")
    assert "tip_a" in hand.q_names
    hand = from_mjcf(model, ["link_a"], motors=["tip_a"], tau_max=0.3, locked=["root_a"])
    assert hand.joint_names == ("tip_a",)
    braked = from_mjcf(model, ["link_a"], tau_max={"tip_a": 0.3}, locked=["root_a"])
    assert braked.joint_names == ("tip_a",)  # a motor of a joint on its brake does nothing
    for name in ("locked", "motors"):
        with pytest.raises(gf.InvalidInputError, match=f"{name}: got 'thumb', expected some of"):
            from_mjcf(model, ["link_a"], **{name: ["thumb"]})
        with pytest.raises(gf.InvalidInputError, match=f"{name}: got 'thumb', expected some of"):
            gf.Grasp.from_mujoco(model, data, "cube", **{name: ["thumb"]})


def test_friction_in_joints_is_noted(written):
    path = written(urdf(effort=1.0, friction=0.02))
    hand = from_urdf(path, ["tip_a", "tip_b"])
    assert "root_a (up to 0.02), tip_a (up to 0.02)" in hand.notes[0]
    rubs = '<joint name="root_a" frictionloss=".1"'
    text = gripper("root motors").replace('<joint name="root_a"', rubs)
    with pytest.warns(UserWarning, match="no motor controls"):
        hand = from_mjcf(mujoco.MjModel.from_xml_string(text), ["link_a", "link_b"])
    assert hand.notes[-1].endswith("not counted [N·m; N for slides]: root_a (up to 0.1)")
