"""Hands from MJCF: against PaperHand, against finite differences of MuJoCo's kinematics."""

from __future__ import annotations

import itertools
import pickle
import warnings

import numpy as np
import pytest
from models import TIPS, contacts_at, paper_hand_xml

import graspforce as gf
from graspforce.hands import Hand, ImportedHand, PaperHand, UnderactuatedHand, from_mjcf

mujoco = pytest.importorskip("mujoco")

MODELS = [gf.SFC(0.5, 0.01), gf.FPC(), gf.PCWF(0.3), gf.PCWF(0.5)]


def compiled(xml):
    return mujoco.MjModel.from_xml_string(xml)


def finger(joints, motors, extra="", inside=""):
    """A finger of hinges and slides along a chain, 3 cm apart, and a site at its tip."""
    chain = ""
    for joint in joints:
        chain += f"""<body name="link_{joint.split('"')[1]}" pos=".01 0 .03"><joint {joint}/>
          <geom type="capsule" size=".004" fromto="0 0 0 0 0 .02" mass=".02"/>"""
    chain += f'<site name="tip" pos=".002 .003 .02"/>{inside}' + "</body>" * len(joints)
    return f"""<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="palm">
      <geom size=".02"/>{chain}</body></worldbody><actuator>{motors}</actuator>{extra}</mujoco>"""


def motor(joint, more='forcerange="-1 1"'):
    return f'<motor joint="{joint}" {more}/>'


HINGES = ['name="a" axis="1 0 0"', 'name="b" axis="0 1 0"', 'name="c" axis="0 1 0.2"']


def material_velocity(hand, contact, q, dq, h=1e-6):
    """Velocity of the point of the tip's body that is at the contact, by central differences."""
    robot = hand.robot

    def pose(angles):
        configuration = robot.configuration(angles)
        body = mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_SITE, "tip")
        body = robot.model.site_bodyid[body]
        return configuration._data.xpos[body].copy(), configuration._data.xmat[body].reshape(
            3, 3
        ).copy()

    at, turned = pose(q)
    local = turned.T @ (contact.point - at)
    ahead, behind = pose(q + h * dq), pose(q - h * dq)
    linear = (ahead[0] + ahead[1] @ local - behind[0] - behind[1] @ local) / (2 * h)
    spin = (ahead[1] - behind[1]) @ turned.T / (2 * h)
    return linear, np.array([spin[2, 1], spin[0, 2], spin[1, 0]])


def in_frame(contact, linear, angular):
    rows = contact.frame.T @ linear
    return np.append(rows, contact.normal @ angular)[: contact.model.dim]


# ---- kinematics --------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", ["radial", "palm_normal"])
def test_the_papers_hand_from_a_file_is_paper_hand(axis, tmp_path):
    path = tmp_path / "hand.xml"
    path.write_text(paper_hand_xml(axis))
    hand, own = from_mjcf(path, TIPS), PaperHand(axis)
    assert isinstance(hand, Hand)
    assert isinstance(hand, UnderactuatedHand)
    assert hand.joint_names == hand.q_names == own.joint_names
    assert hand.fingers["tip3"] == own.joint_names[6:9]
    assert hand.notes == ()
    np.testing.assert_array_equal(hand.tau_lo, own.tau_lo)
    np.testing.assert_array_equal(hand.tau_hi, own.tau_hi)
    rng = np.random.default_rng(1)
    for models in itertools.islice(itertools.permutations(MODELS), 0, 24, 5):
        q = rng.uniform(-1, 1, 12)
        tips = own.forward_kinematics(q)
        np.testing.assert_allclose(hand.fingertip_positions(q), tips, atol=1e-15)
        contacts = contacts_at(tips + rng.uniform(-0.004, 0.004, (4, 3)), rng, models)
        J = hand.jacobian(contacts, q)
        np.testing.assert_allclose(J, own.jacobian(contacts, q), atol=1e-15)
        # Fingers that share no joint must not seem to: the engine counts on exact zeros.
        np.testing.assert_array_equal(J == 0, own.jacobian(contacts, q) == 0)
        assert hand.passive_rows(contacts, q).shape == (0, J.shape[0])


def test_a_grasp_of_the_imported_hand_solves_like_the_papers():
    own = PaperHand("radial")
    tips = np.array([[0.04, 0, 0.1], [0, 0.04, 0.1], [-0.04, 0, 0.1], [0, -0.04, 0.1]])
    q = own.inverse_kinematics(tips)
    outwards = tips * 25 - [0, 0, 2.5]
    contacts = [gf.Contact(p, -n, gf.PCWF(0.5)) for p, n in zip(tips, outwards, strict=True)]
    f = [0.1, 0, 2.5, 0, 0.01, 0]
    found = [
        gf.solve(gf.Grasp(contacts, hand, q).problem(f), check=True)
        for hand in (own, from_mjcf(compiled(paper_hand_xml(options='gravity="0 0 0"')), TIPS))
    ]
    np.testing.assert_allclose(found[1].c, found[0].c, atol=1e-9)
    np.testing.assert_allclose(found[1].tau, found[0].tau, atol=1e-10)


def test_jacobian_against_finite_differences():
    joints = ['name="slide" type="slide" axis="0.6 0 0.8"', *HINGES]
    hand = from_mjcf(compiled(finger(joints, "".join(map(motor, ["slide", *"abc"])))), ["tip"])
    rng = np.random.default_rng(2)
    for _ in range(5):
        q = rng.uniform(-1, 1, 4) * [0.02, 1, 1, 1]
        (contact,) = contacts_at(
            hand.fingertip_positions(q) + rng.uniform(-0.01, 0.01, 3), rng, [gf.SFC(0.5, 0.01)]
        )
        J = hand.jacobian([contact], q)
        for j, dq in enumerate(np.eye(4)):
            expected = in_frame(contact, *material_velocity(hand, contact, q, dq))
            np.testing.assert_allclose(J[:, j], expected, atol=1e-8)


def test_a_pad_moves_as_the_jacobian_of_a_contact_there_says():
    hand = from_mjcf(compiled(finger(HINGES, "".join(map(motor, "abc")))), ["tip"])
    q, pads = np.array([0.3, -0.5, 0.7]), [[0.01, -0.004, 0.02]]
    point = hand.fingertip_positions(q, pads)
    assert np.linalg.norm(point - hand.fingertip_positions(q)) == pytest.approx(
        np.linalg.norm(pads)
    )
    contact = gf.Contact(point[0], (1, 0, 0), gf.PCWF(0.5), (0, 1, 0))
    moved = [
        (hand.fingertip_positions(q + dq, pads) - hand.fingertip_positions(q - dq, pads))[0] / 2e-6
        for dq in 1e-6 * np.eye(3)
    ]
    np.testing.assert_allclose(hand.jacobian([contact], q), np.transpose(moved), atol=1e-8)
    with pytest.raises(gf.InvalidInputError, match="pads: got"):
        hand.fingertip_positions(q, pads[0])


def test_columns_are_in_the_order_of_the_joints_whatever_the_motors_is():
    xml = finger(HINGES, motor("c") + motor("a", 'forcerange="-2 3"') + motor("b"))
    hand = from_mjcf(compiled(xml), ["tip"])
    assert hand.joint_names == hand.q_names == ("a", "b", "c")
    assert hand.tau_lo.tolist() == [-2, -1, -1]
    assert hand.tau_hi.tolist() == [3, 1, 1]


def test_several_contacts_on_a_finger_other_links_and_the_palm():
    hand = from_mjcf(compiled(paper_hand_xml()), {"index": "tip1", "thumb": "f3_distal"})
    assert hand.made_by == ("tip1", "f3_distal")
    assert hand.joint_names == tuple(PaperHand().joint_names[i] for i in (0, 1, 2, 6, 7, 8))
    rng = np.random.default_rng(3)
    q = rng.uniform(-1, 1, 6)
    contacts = contacts_at(rng.uniform(-0.1, 0.1, (5, 3)), rng, [gf.PCWF(0.5)] * 5)
    many = hand.touching(["index", "thumb", "index", "f1_proximal", "palm"])
    J = many.jacobian(contacts, q).reshape(5, 3, 6)
    one = {
        name: [hand.touching([name]).jacobian([contact], q) for contact in contacts]
        for name in ("index", "thumb")
    }
    np.testing.assert_array_equal(J[0], one["index"][0])
    np.testing.assert_array_equal(J[1], one["thumb"][1])
    np.testing.assert_array_equal(J[2], one["index"][2])
    np.testing.assert_array_equal(J[3][:, [0, 1]], one["index"][3][:, [0, 1]])
    assert not J[3][:, 2:].any()  # beyond its own two joints
    assert not J[4].any()
    assert one["index"][0][:, :3].any()


def test_a_hand_on_a_floating_mount_is_as_held_there():
    xml = paper_hand_xml().replace('<body name="palm">', '<body name="palm"><freejoint/>')
    rng = np.random.default_rng(4)
    q, points = rng.uniform(-1, 1, 12), rng.uniform(-0.1, 0.1, (4, 3))
    contacts = contacts_at(points, rng, [gf.PCWF(0.5)] * 4)
    free, fixed = (from_mjcf(compiled(each), TIPS) for each in (xml, paper_hand_xml()))
    np.testing.assert_allclose(free.jacobian(contacts, q), fixed.jacobian(contacts, q), atol=1e-15)
    assert not free.touching(["palm"]).jacobian(contacts[:1], q).any()


def test_it_pickles_and_does_not_touch_the_model():
    model = compiled(paper_hand_xml())
    before = pickle.dumps(model)
    hand = from_mjcf(model, TIPS)
    rng = np.random.default_rng(5)
    q = rng.uniform(-1, 1, 12)
    contacts = contacts_at(hand.fingertip_positions(q), rng, [gf.PCWF(0.5)] * 4)
    again = pickle.loads(pickle.dumps(hand))
    np.testing.assert_array_equal(again.jacobian(contacts, q), hand.jacobian(contacts, q))
    assert pickle.dumps(model) == before


# ---- couplings, by virtual work ----------------------------------------------------------------


def equality(*rows):
    return "<equality>" + "".join(f"<joint {row}/>" for row in rows) + "</equality>"


FOLLOWING = {
    "a line": (equality('joint1="c" joint2="b" polycoef=".1 .7 0 0 0"'), ("a", "b")),
    "a cubic": (equality('joint1="c" joint2="b" polycoef="0 .7 .3 -.2 0"'), ("a", "b")),
    "a chain": (
        equality('joint1="c" joint2="b" polycoef="0 .5 0 0 0"', 'joint1="b" joint2="a"'),
        ("a",),
    ),
    "the first leads, by its motor": (
        equality('joint1="b" joint2="c" polycoef=".2 -2 0 0 0"'),
        ("a", "b"),
    ),
    "a lock": (equality('joint1="c" polycoef=".3 0 0 0 0"'), ("a", "b")),
}


@pytest.mark.parametrize("kind", FOLLOWING)
def test_mimic_joints_by_virtual_work(kind):
    extra, motors = FOLLOWING[kind]
    hand = from_mjcf(compiled(finger(HINGES, "".join(map(motor, motors)), extra)), ["tip"])
    assert hand.joint_names == hand.q_names == motors
    rng = np.random.default_rng(6)
    for _ in range(4):
        q, dq = rng.uniform(-0.8, 0.8, (2, len(motors)))
        (contact,) = contacts_at(hand.fingertip_positions(q) + 0.004, rng, [gf.SFC(0.5, 0.01)])
        J, c = hand.jacobian([contact], q), rng.normal(size=4)
        dx = in_frame(contact, *material_velocity(hand, contact, q, dq))
        assert (J.T @ c) @ dq == pytest.approx(c @ dx, abs=1e-8)
        assert len(hand.passive_rows([contact], q)) == 0
    if kind == "a line":
        assert hand.notes == ("'b' also moves 'c' by 0.7 per unit of its own motion",)


TENDON = """<tendon><fixed name="curl"><joint joint="b" coef=".01"/><joint joint="c" coef=".02"/>
  </fixed></tendon>"""


def tendon_finger():
    motors = motor("a") + '<motor tendon="curl" forcerange="0 40"/>'
    return compiled(finger(HINGES, motors, TENDON))


def test_a_tendon_that_curls_two_joints():
    with pytest.warns(UserWarning, match="no motor controls 1 of 2 motions of 'b', 'c'"):
        hand = from_mjcf(tendon_finger(), ["tip"])
    assert hand.joint_names == ("a", "curl")
    assert hand.q_names == ("a", "b", "c")
    assert (hand.tau_lo.tolist(), hand.tau_hi.tolist()) == ([-1, 0], [1, 40])
    assert hand.fingers == {"tip": ("a", "curl")}
    assert "'curl' also moves 'b' by 20, 'c' by 40 per unit of its own motion" in hand.notes
    rng = np.random.default_rng(7)
    for _ in range(4):
        q, dq = rng.uniform(-0.8, 0.8, (2, 3))
        contacts = contacts_at(hand.fingertip_positions(q) + 0.004, rng, [gf.PCWF(0.5)])
        J, rows = hand.jacobian(contacts, q), hand.passive_rows(contacts, q)
        assert rows.shape == (1, 3)
        # A force that the tendon can hold: its work over any motion is the motors'.
        c = rng.normal(size=3)
        c -= rows[0] * (rows[0] @ c) / (rows[0] @ rows[0])
        dx = in_frame(contacts[0], *material_velocity(hand, contacts[0], q, dq))
        pulled = np.array([dq[0], 0.01 * dq[1] + 0.02 * dq[2]])
        assert (J.T @ c) @ pulled == pytest.approx(c @ dx, abs=1e-8)
        # And one that it cannot: the row is the work over the motion that leaves it still.
        still = np.array([0, 2, -1]) / 5**0.5
        dx = in_frame(contacts[0], *material_velocity(hand, contacts[0], q, still))
        assert np.abs(rows[0]) == pytest.approx(np.abs(dx), abs=1e-8)


SPRUNG = [
    'name="a" axis="1 0 0" stiffness=".3" springref="20"',
    'name="b" axis="0 1 0" stiffness=".05"',
    'name="c" axis="0 1 0.2" stiffness=".2" damping=".1" frictionloss=".05"',
]


@pytest.mark.parametrize("gravity", ["0 0 0", "3 -4 -8"])
def test_weight_and_springs_are_the_slope_of_the_energy(gravity):
    """Over the motions of the drives, and over that which no drive takes part in."""
    options = f'<option gravity="{gravity}"><flag energy="enable"/></option>'
    spring = '<tendon><fixed name="curl" stiffness="40" springlength=".003"><joint'
    motors = motor("a") + '<motor tendon="curl" forcerange="0 40"/>'
    xml = finger(
        SPRUNG, motors, options + TENDON.replace('<tendon><fixed name="curl"><joint', spring)
    )
    with pytest.warns(UserWarning, match="no motor controls 1 of 2 motions"):
        hand = from_mjcf(compiled(xml), ["tip"])

    def energy(angles):
        data = mujoco.MjData(hand.robot.model)
        data.qpos[:] = angles
        mujoco.mj_forward(hand.robot.model, data)
        return data.energy[0]

    rng = np.random.default_rng(8)
    for _ in range(3):
        q = rng.uniform(-0.8, 0.8, 3)
        slope = np.array([energy(q + e) - energy(q - e) for e in 1e-5 * np.eye(3)]) / 2e-5
        by_drive = np.array([[1, 0], [0, 20], [0, 40]])  # the tendon's arms are 0.01 and 0.02
        np.testing.assert_allclose(hand.tau_bias(q), by_drive.T @ slope, atol=1e-7)
        contacts = contacts_at(hand.fingertip_positions(q) + 0.004, rng, [gf.PCWF(0.5)])
        grasp = gf.Grasp(contacts, hand, q)
        np.testing.assert_allclose(grasp.tau_bias, by_drive.T @ slope, atol=1e-7)
        # Forces that hold it do no work over any motion but the drives', weight and springs
        # included.
        c = np.linalg.lstsq(grasp.passive_rows, grasp.passive_loads, rcond=None)[0]
        still = np.array([0, 2, -1]) / 5**0.5
        dx = in_frame(contacts[0], *material_velocity(hand, contacts[0], q, still))
        assert c @ dx == pytest.approx(-slope @ still, abs=1e-7)


def test_the_forces_of_an_underactuated_grasp_leave_its_free_motion_alone():
    """Two tendon fingers in a plane: the tendon turns both joints of a finger alike.

    A finger holds a force only if its moments about both joints are equal, hence only along its
    first link: to carry f upwards with links that lean by 1.2 rad takes normals of f/2 tan 1.2.
    """

    def finger_at(x, name):
        return f"""<body pos="{x} 0 0"><joint name="{name}1" axis="0 1 0"/>
          <geom size=".01"/><body pos="0 0 .05"><joint name="{name}2" axis="0 1 0"/>
          <geom size=".01"/><site name="{name}" pos="0 0 .05"/></body></body>"""

    tendons = "".join(
        f'<fixed name="pull_{n}"><joint joint="{n}1" coef=".01"/><joint joint="{n}2" coef=".01"/>'
        f"</fixed>"
        for n in "lr"
    )
    motors = "".join(f'<motor tendon="pull_{n}" forcerange="-50 50"/>' for n in "lr")
    worldbody = finger_at(-0.08, "l") + finger_at(0.08, "r")
    model = compiled(
        f"""<mujoco><compiler autolimits="true"/><option gravity="0 0 0"/>
        <worldbody>{worldbody}</worldbody><tendon>{tendons}</tendon><actuator>{motors}</actuator></mujoco>"""
    )
    with pytest.warns(UserWarning, match="no motor controls"):
        hand = from_mjcf(model, ["l", "r"])
    q = np.array([1.2, -1.2, -1.2, 1.2])
    tips = hand.fingertip_positions(q)
    contacts = [
        gf.Contact(tip, normal, gf.SFC(0.8, 0.01))
        for tip, normal in zip(tips, [(1, 0, 0), (-1, 0, 0)], strict=True)
    ]
    grasp = gf.Grasp(contacts, hand, q, origin=tips.mean(axis=0))
    assert grasp.passive_rows.shape == (2, 8)
    solution = gf.solve(grasp.problem([0, 0, 2.0, 0, 0, 0]), check=True)
    np.testing.assert_allclose(solution.normal_forces, np.tan(1.2), rtol=1e-9)
    np.testing.assert_allclose(grasp.passive_rows @ solution.c, 0, atol=1e-9)
    # A wrench that may be missed softens none of the equations of motions without a motor.
    for f_soft in (0.1, np.full(6, 0.1)):
        soft = gf.solve(grasp.problem([0, 0, 2.0, 0, 0, 0], f_soft=f_soft), check=True)
        assert np.abs(grasp.W @ soft.c - soft.problem.f[:6]).max() > 1e-4
        np.testing.assert_allclose(grasp.passive_rows @ soft.c, 0, atol=1e-9)
    with pytest.raises(gf.InvalidInputError, match=r"f_soft: got shape \(8,\), expected"):
        grasp.problem([0, 0, 2.0, 0, 0, 0], f_soft=np.ones(8))


def test_a_parallelogram_linkage():
    """A crank of 6 cm turns a coupler that stays level, so the tip moves as the crank's end."""
    xml = """<mujoco><compiler angle="radian"/><worldbody>
      <body name="crank"><joint name="crank" axis="0 1 0"/><geom size=".01"/>
        <body name="coupler" pos="0 0 .06"><joint name="coupler" axis="0 1 0"/>
          <geom size=".01" pos=".03 0 0"/><site name="tip" pos=".05 0 .02"/></body></body>
      <body name="rocker" pos=".04 0 0"><joint name="rocker" axis="0 1 0"/><geom size=".01"/></body>
      </worldbody>
      <equality><connect body1="coupler" body2="rocker" anchor=".04 0 0"/></equality>
      <actuator><motor joint="crank" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>"""
    hand = from_mjcf(compiled(xml), ["tip"])
    assert hand.joint_names == ("crank",)
    assert hand.q_names == ("crank", "coupler", "rocker")
    notes = "'crank' also moves 'coupler' by -1, 'rocker' by 1 per unit of its own motion"
    assert hand.notes == (notes,)
    for angle in (0.0, 0.4, -0.7):
        q = [angle, -angle, angle]
        contact = gf.Contact(hand.fingertip_positions(q)[0], (0, 0, 1), gf.SFC(0.5, 0.01))
        J = contact.frame @ hand.jacobian([contact], q)[:3, 0]
        np.testing.assert_allclose(J, [0.06 * np.cos(angle), 0, -0.06 * np.sin(angle)], atol=1e-9)
        assert hand.jacobian([contact], q)[3, 0] == pytest.approx(0, abs=1e-12)
        assert len(hand.passive_rows([contact], q)) == 0


def test_free_motions_that_the_contacts_cannot_load_are_no_equations():
    """Two fingers with a motorless last joint each; contacts on one tip and on the other's base."""

    def one(name, y):
        return f"""<body name="{name}1" pos="0 {y} 0"><joint name="{name}1" axis="1 0 0"/>
          <geom size=".01"/><body name="{name}2" pos="0 0 .05"><joint name="{name}2" axis="1 0 0"/>
          <geom size=".01"/></body></body>"""

    xml = f"""<mujoco><compiler autolimits="true"/><worldbody>{one("l", -0.05)}{one("r", 0.05)}
      </worldbody><actuator>{motor("l1")}{motor("r1")}</actuator></mujoco>"""
    with pytest.warns(UserWarning, match="no motor controls '[lr]2'"):
        hand = from_mjcf(compiled(xml), ["l2", "r2"])
    contacts = contacts_at([[0, -0.05, 0.1], [0, 0.05, 0.1]], np.random.default_rng(1),
                           [gf.PCWF(0.5)] * 2)  # fmt: skip
    assert hand.passive_rows(contacts, np.zeros(4)).shape == (2, 6)
    rows = hand.touching(["l2", "r1"]).passive_rows(contacts, np.zeros(4))
    assert rows.shape == (1, 6)
    assert rows[0, :3].any()
    assert not rows[0, 3:].any()


def test_a_loose_body_tied_to_a_finger_is_not_held_for_it():
    tied = '<equality><connect body1="link_c" body2="toy" anchor="0 0 .02"/></equality>'
    xml = finger(HINGES, "".join(map(motor, "abc")))
    with_toy = xml.replace(
        "<worldbody>", '<worldbody><body name="toy"><freejoint/><geom size=".01"/></body>'
    ).replace("</mujoco>", tied + "</mujoco>")
    contacts = contacts_at([[0, 0, 0.1]], np.random.default_rng(9), [gf.PCWF(0.5)])
    hand, plain = from_mjcf(compiled(with_toy), ["tip"]), from_mjcf(compiled(xml), ["tip"])
    q = [0.1, 0.2, 0.3]
    np.testing.assert_allclose(hand.jacobian(contacts, q), plain.jacobian(contacts, q), atol=1e-15)
    with pytest.raises(gf.InvalidInputError, match="names: got 'toy'"):
        hand.touching(["toy"])


def test_a_joint_without_a_motor_is_an_equation():
    with pytest.warns(UserWarning, match="no motor controls 'c'"):
        hand = from_mjcf(compiled(finger(HINGES, motor("a") + motor("b"))), ["tip"])
    assert hand.joint_names == ("a", "b")
    assert hand.q_names == ("a", "b", "c")
    full = from_mjcf(compiled(finger(HINGES, "".join(map(motor, "abc")))), ["tip"])
    rng = np.random.default_rng(8)
    q = rng.uniform(-1, 1, 3)
    contacts = contacts_at(full.fingertip_positions(q), rng, [gf.PCWF(0.5)])
    J = full.jacobian(contacts, q)
    np.testing.assert_allclose(hand.jacobian(contacts, q), J[:, :2], atol=1e-15)
    rows = hand.passive_rows(contacts, q)
    np.testing.assert_allclose(rows * np.sign(rows[0, 0] * J[0, 2]), J[:, 2:].T, atol=1e-15)


# ---- limits ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("actuators", "joint", "expected"),
    [
        ('<motor joint="a" forcerange="-.3 .2"/>', "", (-0.3, 0.2)),
        ('<motor joint="a" gear="-5" forcerange="-.3 .2"/>', "", (-1.0, 1.5)),
        ('<motor joint="a" gear="2" ctrlrange="-.3 .4"/>', "", (-0.6, 0.8)),
        ('<motor joint="a" ctrlrange="-.3 .4" forcerange="-.1 1"/>', "", (-0.1, 0.4)),
        ('<general joint="a" gainprm="3" ctrlrange="-.3 .4"/>', "", (-0.9, 1.2)),
        ('<position joint="a" kp="3" ctrlrange="-1 1" forcerange="-.5 .5"/>', "", (-0.5, 0.5)),
        ('<motor joint="a"/>', 'actuatorfrcrange="-.7 .6"', (-0.7, 0.6)),
        ('<cylinder joint="a" area=".5" bias=".1 0 0" ctrlrange="-.2 1"/>', "", (0, 0.6)),
        ('<motor joint="a" ctrlrange="-.5 1"/>', 'actuatorfrcrange="-.7 .6"', (-0.5, 0.6)),
        (
            '<motor joint="a" forcerange="0 .5"/><motor joint="a" gear="-1" forcerange="0 .2"/>',
            "",
            (-0.2, 0.5),
        ),
    ],
)
def test_limits_from_the_file(actuators, joint, expected):
    hand = from_mjcf(compiled(finger([f'name="a" axis="1 0 0" {joint}'], actuators)), ["tip"])
    assert (hand.tau_lo[0], hand.tau_hi[0]) == pytest.approx(expected, abs=1e-15)
    assert hand.notes == ()


def test_limits_that_look_like_placeholders_are_reported_once_and_used():
    ranges = ('forcerange="-1000 1000"', 'forcerange="-15 15"', 'forcerange="-.7 .7"')
    xml = finger(HINGES, "".join(map(motor, "abc", ranges)))
    with pytest.warns(UserWarning, match="may be a placeholder") as caught:
        hand = from_mjcf(compiled(xml), ["tip"])
    texts = [str(each.message) for each in caught]
    assert tuple(texts) == hand.notes
    assert [text.split(" may be")[0] for text in texts] == [
        "the file's limit of 1000 N·m for a",
        "the file's limit of 15 N·m for b",
    ]
    assert {each.filename for each in caught} == {__file__}
    assert hand.tau_hi.tolist() == [1000, 15, 0.7]
    with pytest.warns(UserWarning, match="15 N·m for b"):
        hand = from_mjcf(compiled(xml), ["tip"], tau_max={"a": 0.5})
    assert hand.tau_hi.tolist() == [0.5, 15, 0.7]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hand = from_mjcf(compiled(xml), ["tip"], tau_max=0.6)
    assert (hand.tau_lo.tolist(), hand.tau_hi.tolist()) == ([-0.6] * 3, [0.6] * 3)


def test_a_grippers_slide_may_pull_harder():
    xml = finger(['name="a" type="slide" axis="1 0 0"'], motor("a", 'forcerange="-150 150"'))
    assert from_mjcf(compiled(xml), ["tip"]).notes == ()


def test_a_tendon_is_judged_by_the_torque_it_makes():
    tendon = TENDON.replace('".01"', '"1"').replace('".02"', '"1"')  # as long as the angles' sum
    xml = finger(HINGES, motor("a") + '<motor tendon="curl" forcerange="-15 15"/>', tendon)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        from_mjcf(compiled(xml), ["tip"])
    assert "limit of 15 N for curl may be a placeholder" in str(caught[0].message)


def test_motors_of_ball_joints_elsewhere_do_not_shift_the_others():
    """Such a motor has three inputs and outputs, so that numbers of motors and inputs differ."""
    ball = '<body name="ball"><joint name="ball" type="ball"/><geom size=".01"/></body>'
    xml = finger(HINGES, "".join(map(motor, "abc", ['ctrlrange="-.3 .4" gear="2"'] * 3)))
    plain = from_mjcf(compiled(xml), ["tip"])
    xml = xml.replace("<worldbody>", f"<worldbody>{ball}")
    xml = xml.replace("<actuator>", '<actuator><orientation name="turner" joint="ball"/>')
    hand = from_mjcf(compiled(xml), ["tip"])
    assert hand.tau_hi.tolist() == plain.tau_hi.tolist() == [0.8] * 3
    assert hand.notes == ("motor 'turner' is left out: it drives neither a joint nor a tendon",)
    contacts = contacts_at([[0, 0, 0.1]], np.random.default_rng(9), [gf.PCWF(0.5)])
    q = [0.1, 0.2, 0.3]
    np.testing.assert_array_equal(hand.jacobian(contacts, q), plain.jacobian(contacts, q))


def test_two_motors_on_one_motion_share_its_load():
    xml = finger(HINGES, "".join(map(motor, "abc")), FOLLOWING["a line"][0])
    alone = finger(HINGES, "".join(map(motor, "ab")), FOLLOWING["a line"][0])
    both, one = (from_mjcf(compiled(each), ["tip"]) for each in (xml, alone))
    assert both.joint_names == ("a", "b", "c")
    contacts = contacts_at([[0, 0, 0.1]], np.random.default_rng(9), [gf.PCWF(0.5)])
    J, expected = both.jacobian(contacts, [0.1, 0.2]), one.jacobian(contacts, [0.1, 0.2])
    np.testing.assert_allclose(J[:, 1] + 0.7 * J[:, 2], expected[:, 1], atol=1e-14)


def test_no_limit_at_all_is_refused_with_the_way_out():
    xml = finger(HINGES, motor("a") + motor("b", "") + '<position joint="c" ctrlrange="-1 1"/>')
    with pytest.raises(gf.ModelImportError, match=r"no torque limit for b, c: give tau_max"):
        from_mjcf(compiled(xml), ["tip"])
    damped = '<cylinder joint="c" area=".5" bias="0 0 -1" ctrlrange="-1 1"/>'
    with pytest.raises(gf.ModelImportError, match=r"no torque limit for b, c: give tau_max"):
        from_mjcf(compiled(finger(HINGES, motor("a") + motor("b", "") + damped)), ["tip"])
    hand = from_mjcf(compiled(xml), ["tip"], tau_max={"b": 0.4, "c": 0.3})
    assert hand.tau_hi.tolist() == [1, 0.4, 0.3]


def test_tau_max_of_motors_that_act_one_way():
    """As tendons do: given both ways it would let them push."""
    one_way = ['forcerange="0 5"', 'gear="-1" ctrlrange="0 2"', 'forcerange="-3 3"']
    xml = finger(HINGES, "".join(map(motor, "abc", one_way)))
    hand = from_mjcf(compiled(xml), ["tip"], tau_max=0.5)
    assert (hand.tau_lo.tolist(), hand.tau_hi.tolist()) == ([0, -0.5, -0.5], [0.5, 0, 0.5])
    # Two of them against each other act both ways.
    pair = motor("a", 'forcerange="0 5"') + motor("a", 'gear="-1" forcerange="0 2"')
    hand = from_mjcf(compiled(finger(HINGES[:1], pair)), ["tip"], tau_max=0.5)
    assert (hand.tau_lo.tolist(), hand.tau_hi.tolist()) == ([-0.5], [0.5])


def test_a_range_of_nothing_is_no_motor():
    xml = finger(HINGES, motor("a") + motor("b") + motor("c", 'ctrlrange="0 1" gear="0"'))
    with pytest.warns(UserWarning, match="no motor controls 'c'"):
        hand = from_mjcf(compiled(xml), ["tip"])
    assert "motor 'actuator 2' is left out: it drives neither a joint nor a tendon" in hand.notes
    clipped = [*HINGES[:2], HINGES[2] + ' actuatorfrcrange="-1e-9 0"']
    xml = finger(clipped, "".join(map(motor, "abc", ['forcerange="-1 1"'] * 2 + [
        'forcerange="0 1"'])))  # fmt: skip
    with pytest.warns(UserWarning, match="no motor controls 'c'"):
        hand = from_mjcf(compiled(xml), ["tip"])
    assert hand.joint_names == ("a", "b")
    assert (
        "the file gives 'c' no torque at all: taken as without a motor; tau_max gives it one"
        in hand.notes
    )
    assert from_mjcf(compiled(xml), ["tip"], tau_max=1).joint_names == ("a", "b", "c")


# ---- bad input ---------------------------------------------------------------------------------


def test_files_that_are_no_models(tmp_path):
    with pytest.raises(gf.ModelImportError, match=r"nowhere\.xml: there is no such file"):
        from_mjcf(tmp_path / "nowhere.xml", ["tip"])
    with pytest.raises(gf.ModelImportError, match="there is no such file"):
        from_mjcf(tmp_path, ["tip"])
    bad = tmp_path / "bad.xml"
    for text in ("hello", "<mujoco><body/></mujoco>", '<html lang="en"/>'):
        bad.write_text(text)
        with pytest.raises(gf.ModelImportError, match=r"bad\.xml: not a model that MuJoCo reads: "):
            from_mjcf(str(bad), ["tip"])
    with pytest.raises(gf.InvalidInputError, match="source: got 3, expected a path or an mujoco"):
        from_mjcf(3, ["tip"])


def test_missing_meshes_refuse_no_file(tmp_path):
    """Whatever needs no mesh is that of a model without; a missing weight is said to be."""
    xml = finger(HINGES, "".join(map(motor, "abc")))
    expected = from_mjcf(compiled(xml), ["tip"])
    assets = """<asset><mesh file="gone.stl"/><mesh name="pad" file="far/gone.obj"
      scale="1 1 1e-3"/></asset><compiler meshdir="nowhere"/>"""
    shapes = '<geom type="mesh" mesh="gone"/><geom type="mesh" mesh="pad"/>'
    inertia = '<inertial pos="0 0 .01" mass=".02" diaginertia="1e-6 1e-6 1e-6"/>'
    path = tmp_path / "hand.xml"
    path.write_text(finger(HINGES, "".join(map(motor, "abc")), assets, inertia + shapes))
    hand = from_mjcf(path, ["tip"])
    assert hand.notes == ()
    q = [0.1, 0.2, 0.3]
    contacts = contacts_at([[0, 0, 0.1]], np.random.default_rng(9), [gf.PCWF(0.5)])
    np.testing.assert_array_equal(hand.jacobian(contacts, q), expected.jacobian(contacts, q))
    path.write_text(finger(HINGES, "".join(map(motor, "abc")), assets, shapes))
    with pytest.warns(
        UserWarning, match=r"missing \(gone\.stl, far/gone\.obj\), .* of link_c: tau"
    ):
        hand = from_mjcf(path, ["tip"])
    np.testing.assert_array_equal(hand.jacobian(contacts, q), expected.jacobian(contacts, q))
    # One that is there is read, and refused if it is no mesh.
    (tmp_path / "nowhere").mkdir()
    (tmp_path / "nowhere" / "gone.stl").write_text("no mesh")
    with pytest.raises(gf.ModelImportError, match="not a model that MuJoCo reads"):
        from_mjcf(path, ["tip"])


def refused(match, fingertips=TIPS, xml=None, error=gf.InvalidInputError, **options):
    with pytest.raises(error, match=match):
        from_mjcf(compiled(xml or paper_hand_xml()), fingertips, **options)


def test_names_that_are_not_there_list_those_that_are():
    refused(r"fingertips: got 'tip5', .* expected one of world, palm, f1_base.*tip4$", ["tip5"])
    refused("fingertips: got 'tip5'", {"index": "tip5"})
    refused(r"tau_max: got a limit for 'knee', expected one of finger1_base, ", tau_max={"knee": 1})
    hand = from_mjcf(compiled(paper_hand_xml()), TIPS[:2])
    with pytest.raises(gf.InvalidInputError, match=r"names: got 'tip3'.*f2_distal, tip1, tip2$"):
        hand.touching(["tip1", "tip3"])  # a finger that is no part of this hand


def test_fingertips_of_the_wrong_kind():
    refused(r"fingertips: got \[\], expected names of at least one link", [])
    refused("fingertips: got 'tip1', expected names", "tip1")
    refused("fingertips: got 3, expected names", 3)
    refused("fingertips: got 'tip1' twice", ["tip1", "tip2", "tip1"])


def test_fingers_without_a_motor():
    refused(
        "finger 'palm' has no actuated joint: no motor moves 'palm'",
        ["tip1", "palm"],
        error=gf.ModelImportError,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        refused(
            "finger 'tip2' has no actuated joint",
            xml=paper_hand_xml(actuators=motor("finger1_base") + motor("finger1_knee")),
            error=gf.ModelImportError,
        )


def test_ball_joints_are_refused():
    xml = finger([*HINGES[:1], 'name="ball" type="ball"'], motor("a"))
    refused("ball joint 'ball' moves a finger", ["tip"], xml, gf.ModelImportError)


@pytest.mark.parametrize("bad", [0, -1, float("nan"), float("inf"), "much", {"finger1_base": 0}])
def test_bad_torque_limits(bad):
    refused("tau_max", tau_max=bad)


def test_wrong_numbers_of_contacts_and_angles():
    hand = from_mjcf(compiled(paper_hand_xml()), TIPS)
    contact = gf.Contact((0, 0, 0.1), (1, 0, 0), gf.PCWF(0.5))
    with pytest.raises(gf.InvalidInputError, match="contacts: got 1, expected 4, made by tip1, "):
        hand.jacobian([contact], np.zeros(12))
    with pytest.raises(gf.InvalidInputError, match=r"q: got shape \(11,\), expected shape \(12,\)"):
        gf.Grasp([contact] * 4, hand, np.zeros(11))
    with pytest.raises(gf.InvalidInputError, match="finite"):
        hand.fingertip_positions(np.full(12, np.nan))


def test_without_mujoco_the_error_names_the_pip_line(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(gf.MissingExtraError, match=r"pip install 'mujoco[<>=]"):
        from_mjcf("hand.xml", ["tip"])
    assert ImportedHand.__doc__
