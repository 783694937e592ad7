"""Closed linkages: postures are closed, and J is that of the closed loop, on and off an arm."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import graspforce as gf
from graspforce.hands import MujocoGrasp, from_mjcf

ARM = """<body name="a1"><joint name="arm1" axis="0 1 0"/><geom size=".02" mass=".3"/>
  <body name="a2" pos=".2 0 .1"><joint name="arm2" axis="0 0 1"/><geom size=".02" mass=".3"/>
  <body name="a3" pos=".1 .05 .1"><joint name="arm3" axis="1 0 0"/><geom size=".02" mass=".3"/>
  <body pos="0 0 .1">"""
# A slender tip body carries the contact; {e} tilts axes that ought to be parallel.
LINKAGES = {
    "four-bar": """<body name="crank"><joint name="crank" axis="0 1 0"/><geom size=".004"/>
      <body name="tip" pos=".01 0 .05"><joint name="tip" axis="{e} 1 {e}"/><geom size=".004"/>
        <site name="pad" pos=".07 0 .03"/><site name="one" pos=".05 0 .02"/></body></body>
      <body name="rocker" pos=".04 0 -.01"><joint name="rocker" axis="-{e} 1 {e}"/>
        <geom size=".004"/><site name="other" pos=".02 0 .08"/></body>""",
    "slider-crank": """<body name="crank"><joint name="crank" axis="0 1 0"/><geom size=".004"/>
      <body name="rod" pos=".0106 0 .0106"><joint name="rod" axis="{e} 1 {e}"/><geom size=".004"/>
        <site name="one" pos=".05 0 -.0106"/></body></body>
      <body name="tip" pos=".0606 0 0"><joint name="tip" type="slide" axis="1 {e} {e}"/>
        <geom size=".004"/><site name="other"/><site name="pad" pos=".02 .01 .01"/></body>""",
    "inverted slider": """<body name="crank"><joint name="crank" axis="0 1 0"/><geom size=".004"/>
      <site name="one" pos=".01 0 .03"/></body>
      <body name="guide" pos=".06 0 0"><joint name="guide" axis="{e} 1 0"/><geom size=".004"/>
        <body name="tip" pos="-.05 0 .03"><joint name="tip" type="slide" axis="-.857 {e} .515"/>
          <geom size=".004"/><site name="other"/><site name="pad" pos="-.01 0 .02"/>
        </body></body>""",
}


def linkage(kind, *, on_arm=False, tilt=0.0):
    inner = LINKAGES[kind].replace("{e}", repr(tilt))
    world = ARM + inner + "</body>" * 4 if on_arm else inner
    driven = (*(("arm1", "arm2", "arm3") if on_arm else ()), "crank")
    motors = "".join(f'<motor joint="{each}" ctrlrange="-5 5"/>' for each in driven)
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler angle="radian" autolimits="true"/>
        <default><geom mass=".02"/></default>
        <worldbody>{world}</worldbody><equality><connect site1="one" site2="other"/></equality>
        <actuator>{motors}</actuator></mujoco>"""
    )


def gap_and_tip(model, q):
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    base = data.xmat[model.body("crank").parentid[0]]
    gap = base.reshape(3, 3).T @ (data.site("one").xpos - data.site("other").xpos)
    return gap, np.array(data.site("pad").xpos)  # the gap in the axes of what bears the linkage


def closed(model, q, gap=(0.0, 0.0, 0.0)):
    """Close the loop to a gap by its joints without a motor: differences of positions alone."""
    passive = [i for i in range(model.nq) if not model.joint(i).name.startswith(("arm", "crank"))]
    q = np.array(q)
    for _ in range(40):
        left = gap_and_tip(model, q)[0] - gap
        slopes = []
        for i in passive:
            ahead, behind = np.array(q), np.array(q)
            ahead[i], behind[i] = ahead[i] + 1e-6, behind[i] - 1e-6
            slopes.append((gap_and_tip(model, ahead)[0] - gap_and_tip(model, behind)[0]) / 2e-6)
        step = np.linalg.lstsq(np.transpose(slopes), -left, rcond=1e-2)[0]
        q[passive] += step
        if np.abs(step).max() < 1e-13:
            break
    return q, passive


def tip_motion(model, q, joint, gap=(0.0, 0.0, 0.0)):
    """How the tip moves as a driven joint does, the loop kept as it is: shape (3,)."""
    tips = []
    for side in (1e-5, -1e-5):
        moved = np.array(q)
        moved[model.joint(joint).qposadr[0]] += side
        tips.append(gap_and_tip(model, closed(model, moved, gap)[0])[1])
    return (tips[0] - tips[1]) / 2e-5


def posture(model, crank):
    q = np.zeros(model.nq)
    for name, angle in {"arm1": 0.3, "arm2": -0.4, "arm3": 0.5, "crank": crank}.items():
        if any(model.joint(i).name == name for i in range(model.njnt)):
            q[model.joint(name).qposadr[0]] = angle
    return q


# ---- from a file -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", LINKAGES)
@pytest.mark.parametrize("on_arm", [False, True], ids=["alone", "on an arm"])
@pytest.mark.parametrize("tilt", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize("off", [0.0, 1e-6, 1e-3, None], ids=lambda off: f"off by {off}")
def test_j_of_the_closed_loop_whatever_is_not_quite_right(kind, on_arm, tilt, off):
    """Axes tilted, and postures off, by a µrad and a mrad; or only the driver's angle known."""
    model = linkage(kind, on_arm=on_arm, tilt=tilt)
    hand = from_mjcf(model, ["pad"])
    assert hand.joint_names == (*(("arm1", "arm2", "arm3") if on_arm else ()), "crank")
    q, passive = closed(model, posture(model, 0.4))
    given = posture(model, 0.4)
    if off is not None:
        given = np.array(q)
        given[passive] += off * np.array([1.0, -1.0])
    contact = gf.Contact(gap_and_tip(model, q)[1], (0.6, 0, 0.8), gf.PCWF(0.5))
    places = [int(model.joint(name).qposadr[0]) for name in hand.q_names]
    grasp = gf.Grasp([contact], hand, given[places])
    expected = [contact.frame.T @ tip_motion(model, q, name) for name in hand.joint_names]
    np.testing.assert_allclose(grasp.J, np.transpose(expected), atol=1e-6)
    assert len(grasp.passive_rows) == 0
    said = [note for note in grasp.notes if "closed by moving" in note]
    assert len(said) == (off is None or off > 1e-5)


def test_a_posture_that_is_not_closed_is_said_to_be():
    model = linkage("four-bar")
    hand = from_mjcf(model, ["pad"])
    q, _ = closed(model, posture(model, 0.4))
    contact = gf.Contact(gap_and_tip(model, q)[1], (0, 0, 1), gf.PCWF(0.5))
    grasp = gf.Grasp([contact], hand, [0.4, 0, 0])
    (note,) = grasp.notes
    gap = 1000 * np.linalg.norm(gap_and_tip(model, posture(model, 0.4))[0])
    assert f"the closed linkage of tip and rocker open by {gap:.3g} mm" in note
    assert f"tip by {q[1]:.3g}, rocker by {q[2]:.3g}" in note
    np.testing.assert_allclose(hand.fingertip_positions([0.4, 0, 0])[0], contact.point, atol=1e-9)
    assert gf.Grasp([contact], hand, q).notes == ()


def test_a_posture_that_cannot_be_closed_is_refused_with_its_gap():
    text = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
      <body name="crank"><joint name="crank" axis="0 1 0"/><geom size=".004"/>
        <body name="tip" pos="0 0 .05"><joint name="tip" axis="0 1 0"/><geom size=".004"/>
        <site name="one" pos=".02 0 0"/></body></body>
      <body name="rocker" pos=".2 0 0"><joint name="rocker" axis="0 1 0"/><geom size=".004"/>
        <site name="other" pos="0 0 .05"/></body></worldbody>
      <equality><connect site1="one" site2="other"/></equality>
      <actuator><motor joint="crank" ctrlrange="-5 5"/></actuator></mujoco>"""
    hand = from_mjcf(mujoco.MjModel.from_xml_string(text), ["tip"])
    # The links reach 0.05 + 0.02 + 0.05 m of the 0.2 m between their joints.
    with pytest.raises(
        gf.InvalidInputError, match=r"tip and rocker open by 180 mm, .* to 8[0-9.]+ mm at"
    ):
        hand.tau_bias([0.0, 0.0, 0.0])


def test_a_motors_angle_at_which_the_linkage_cannot_be_is_refused():
    """A rod that is too short for the crank to stand up: 0.05 m, of 0.085 m."""
    model = linkage("slider-crank")
    model.body("rod").pos[:] = [0.06, 0, 0.06]
    hand = from_mjcf(model, ["pad"])
    hand.tau_bias([0.5, 0.3, 0.0])
    with pytest.raises(gf.InvalidInputError, match=r"closes at crank = .* and not at -0\.4"):
        hand.tau_bias([-0.4, 0.4, 0.0])


def test_a_floating_base_is_no_part_of_its_loops():
    """A linkage on a mount that floats: its soft loop has nothing to do with the mount."""
    inner = LINKAGES["four-bar"].replace("{e}", "1e-4")
    text = f"""<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
      <body pos=".1 .2 .3" euler=".2 .3 .4"><freejoint/><geom size=".02"/>{inner}</body></worldbody>
      <equality><connect site1="one" site2="other"/></equality>
      <actuator><motor joint="crank" ctrlrange="-5 5"/></actuator></mujoco>"""
    hand = from_mjcf(mujoco.MjModel.from_xml_string(text), ["pad"])
    assert hand.q_names == ("crank", "tip", "rocker")
    assert len(hand.notes) == 1
    assert "'crank' also moves 'tip' by" in hand.notes[0]


def test_measured_angles_choose_how_the_linkage_is_assembled():
    """A four-bar has two closed postures; measured angles that are a little off say which."""
    model = linkage("four-bar")
    hand = from_mjcf(model, ["pad"])
    one, _ = closed(model, [0.4, 0, 0])
    other, _ = closed(model, [0.4, -2.0, -2.0])
    assert np.abs(one - other).max() > 0.5
    for q in (one, other):
        tip = hand.fingertip_positions(q + np.array([0, 0.02, -0.02]))[0]
        np.testing.assert_allclose(tip, gap_and_tip(model, q)[1], atol=1e-9)


def test_two_fingers_of_one_motor():
    """The driver's angle alone: the other finger mimics it, and both loops close."""

    def finger(n, s):
        w = -s * 0.02
        return f"""<body pos="{s * -0.03} 0 0"><joint name="drv{n}" axis="0 {s} 0"/>
          <geom size=".004"/><body name="cpl{n}" pos="0 0 .04"><joint name="cpl{n}" axis="0 {s} 0"/>
          <geom size=".004"/><site name="tip{n}" pos="0 0 .02"/></body></body>
          <body name="fol{n}" pos="{s * -0.03 + w} 0 0"><joint name="fol{n}" axis="0 {s} 0"/>
          <geom size=".004"/></body>"""

    text = f"""<mujoco><compiler angle="radian" autolimits="true"/><worldbody>{finger("a", 1)}
      {finger("b", -1)}</worldbody><equality>
      <connect body1="cpla" body2="fola" anchor="-.02 0 0"/>
      <connect body1="cplb" body2="folb" anchor=".02 0 0"/><joint joint1="drvb" joint2="drva"/>
      </equality><actuator><motor joint="drva" ctrlrange="-1 1"/></actuator></mujoco>"""
    hand = from_mjcf(mujoco.MjModel.from_xml_string(text), ["tipa", "tipb"])
    q = [0.35 if name == "drva" else 0.0 for name in hand.q_names]
    tips = hand.fingertip_positions(q)
    contacts = [
        gf.Contact(tip, (side, 0, 0), gf.PCWF(0.5)) for tip, side in zip(tips, (1, -1), strict=True)
    ]
    J = gf.Grasp(contacts, hand, q).J
    # A parallelogram's coupler does not turn: the tip moves as the end of the crank.
    np.testing.assert_allclose(J[[0, 3], 0], 0.04 * np.cos(0.35), atol=1e-9)


# ---- from a simulation -------------------------------------------------------------------------


@pytest.mark.parametrize("kind", LINKAGES)
@pytest.mark.parametrize("tilt", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize("off", [0.0, 1e-6, 1e-3])
def test_j_in_a_simulation_whose_loops_are_soft(kind, tilt, off):
    """MuJoCo's loops gape: they are followed as they stand, and by their own joints alone."""
    model = linkage(kind, on_arm=True, tilt=tilt)
    q, passive = closed(model, posture(model, 0.4))
    q[passive] += off * np.array([1.0, -1.0])
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    reader = MujocoGrasp(model, data, "a1", joints=["arm2", "arm3", "crank"])
    gap, tip = gap_and_tip(model, q)
    contact = gf.Contact(tip, (0.6, 0, 0.8), gf.PCWF(0.5))
    J = reader.jacobian([contact], ["tip"])
    # The tip belongs to the object, which arm1 carries: it is the ground that moves relative to it.
    expected = [-contact.frame.T @ tip_motion(model, q, name, gap) for name in reader.joint_names]
    np.testing.assert_allclose(J, np.transpose(expected), atol=1e-6)


def gripper(*, soft=0.0):
    """A four-bar finger that touches a cube: its loop's far link touches nothing."""
    inner = LINKAGES["four-bar"].replace("{e}", "0.0")
    pad = '<geom size=".01" pos=".07 0 .03"/><site name="pad"'
    text = f"""<mujoco><compiler angle="radian" autolimits="true"/>
      <default><geom mass=".02"/></default><worldbody>{inner.replace('<site name="pad"', pad)}
      <body name="cube" pos=".08 0 .11"><freejoint/><geom type="box" size=".02 .02 .0205"/></body>
      </worldbody><equality><connect site1="one" site2="other"/></equality>
      <actuator><motor joint="crank" ctrlrange="-5 5"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:3], _ = closed(linkage("four-bar"), np.zeros(3))
    data.qpos[2] += soft
    mujoco.mj_forward(model, data)
    return model, data


def test_a_simulation_tells_the_gap_of_its_loops():
    model, data = gripper(soft=0.02)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    gap = 1000 * np.linalg.norm(data.site("one").xpos - data.site("other").xpos)
    (note,) = [each for each in grasp.notes if "is open by" in each]
    assert f"the closed linkage of tip and rocker is open by {gap:.3g} mm: J is off by" in note
    assert "is open by" not in "".join(gf.Grasp.from_mujoco(*gripper(), "cube").notes)
    with pytest.raises(gf.InvalidInputError, match=r"tip and rocker is open by .* mm, expected"):
        gf.Grasp.from_mujoco(*gripper(soft=-0.3), "cube")


def test_links_of_a_loop_are_one_finger():
    """The rocker touches nothing, and is no finger without contact for that."""
    grasp = gf.Grasp.from_mujoco(*gripper(), "cube")
    assert len(grasp.contacts) == 1
    assert not any("not in contact" in note for note in grasp.notes)


# ---- from Pinocchio ----------------------------------------------------------------------------


def in_pinocchio(model):
    """The same bodies and joints, and the constraint that closes the loop."""
    pin = pytest.importorskip("pinocchio")
    robot, joints, offsets = pin.Model(), {0: 0}, {0: pin.SE3.Identity()}
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        place = offsets[parent] * pin.SE3(np.eye(3), np.array(model.body_pos[body]))
        if not model.body_jntnum[body]:  # fixed to its parent
            joints[body], offsets[body] = joints[parent], place
            continue
        joint = int(model.body_jntadr[body])
        slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
        number = robot.addJoint(
            joints[parent], kind(np.array(model.jnt_axis[joint])), place, model.joint(joint).name
        )
        robot.addBodyFrame(model.body(body).name, number, pin.SE3.Identity(), 0)
        joints[body], offsets[body] = number, pin.SE3.Identity()
    robot.lowerEffortLimit, robot.upperEffortLimit = np.full((2, robot.nv), [[-5.0], [5.0]])
    ends = []
    for site in (model.site("one"), model.site("other")):
        body = int(site.bodyid[0])
        ends += [joints[body], offsets[body] * pin.SE3(np.eye(3), np.array(site.pos))]
    return robot, ends


@pytest.mark.parametrize("kind", LINKAGES)
@pytest.mark.parametrize("on_arm", [False, True], ids=["alone", "on an arm"])
@pytest.mark.parametrize("tilt", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize("off", [0.0, 1e-6, 1e-3])
def test_j_of_a_loop_that_pinocchios_constraint_closes(kind, on_arm, tilt, off):
    pin = pytest.importorskip("pinocchio")
    model = linkage(kind, on_arm=on_arm, tilt=tilt)
    q, passive = closed(model, posture(model, 0.4))
    q[passive] += off * np.array([1.0, -1.0])
    gap, tip = gap_and_tip(model, q)
    contact = gf.Contact(tip, (0.6, 0, 0.8), gf.PCWF(0.5))
    robot, ends = in_pinocchio(model)
    loop = pin.PointAnchorConstraintModel(robot, *ends)
    driven = [*(("arm1", "arm2", "arm3") if on_arm else ()), "crank"]
    grasp = gf.Grasp.from_pinocchio(robot, q, [contact], ["tip"], motors=driven, loops=[loop])
    assert grasp.joint_names == tuple(driven)
    expected = [contact.frame.T @ tip_motion(model, q, name, gap) for name in driven]
    np.testing.assert_allclose(grasp.J, np.transpose(expected), atol=1e-6)
    assert len(grasp.passive_rows) == 0
    assert any("is open by" in note for note in grasp.notes) == (np.linalg.norm(gap) > 6e-6)


def test_a_loop_follows_pinocchios_joints_from_tick_to_tick():
    """And a weld holds what a point alone does not; what is no constraint is refused."""
    pin = pytest.importorskip("pinocchio")
    model = linkage("four-bar")
    robot, ends = in_pinocchio(model)
    loop = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, robot, *ends)
    at = [closed(model, posture(model, crank))[0] for crank in (0.4, 0.1)]
    contacts = [[gf.Contact(gap_and_tip(model, q)[1], (0, 0, 1), gf.PCWF(0.5))] for q in at]
    reader = gf.hands.PinocchioGrasp(
        robot, at[0], contacts[0], ["tip"], motors=["crank"], loops=[loop]
    )
    reader.update(at[1], contacts[1])
    expected = contacts[1][0].frame.T @ tip_motion(model, at[1], "crank")
    np.testing.assert_allclose(reader.J[:, 0], expected, atol=1e-6)
    with pytest.raises(
        gf.InvalidInputError, match=r"linkage of tip and rocker open by \d+\.?\d* mm"
    ):
        reader.update(np.array([0.4, 1.0, 0.0]), contacts[0])
    weld = pin.FrameAnchorConstraintModel(robot, *ends)
    held = gf.Grasp.from_pinocchio(
        robot, at[0], contacts[0], ["tip"], motors=["crank"], loops=[weld]
    )
    np.testing.assert_allclose(held.J, 0, atol=1e-9)
    with pytest.raises(gf.InvalidInputError, match=r"loops\[1\]: got a int, expected a pinocchio"):
        gf.Grasp.from_pinocchio(robot, at[0], contacts[0], ["tip"], loops=[loop, 3])
