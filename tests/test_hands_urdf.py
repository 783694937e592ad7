"""Hands from URDF, grasps from Pinocchio: PaperHand, differences, virtual work, MuJoCo."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from models import contacts_at, paper_hand_urdf, urdf_joint, urdf_robot

import graspforce as gf
from graspforce._util.native_stderr import native_stderr
from graspforce.hands import Hand, PaperHand, UnderactuatedHand, from_mjcf, from_urdf

pin = pytest.importorskip("pinocchio")

PADS = tuple(f"pad{i}" for i in (1, 2, 3, 4))


@pytest.fixture
def written(tmp_path):
    """Write text as a URDF file and return its path."""

    def write(text):
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return path

    return write


def example_robot(path):
    """A file of the example-robot-data package, where that is installed."""
    root = Path(pin.__file__)
    for above in root.parents:
        for share in (above / "cmeel.prefix/share", above / "share"):
            file = share / "example-robot-data/robots" / path
            if file.is_file():
                return file
    pytest.skip("example-robot-data is not installed")
    return None


def material_velocity(hand, tip, point, q, dq, h=1e-6):
    """Velocity of the point of ``tip`` that is at ``point``, by Pinocchio's forward kinematics."""

    def placement(angles):
        configuration = hand.robot.configuration(angles)
        return configuration._data.oMf[hand.robot.model.getFrameId(tip)].copy()

    here, ahead, behind = (placement(each) for each in (q, q + h * dq, q - h * dq))
    local = here.actInv(point)
    linear = (ahead.act(local) - behind.act(local)) / (2 * h)
    spin = (ahead.rotation - behind.rotation) @ here.rotation.T / (2 * h)
    return linear, np.array([spin[2, 1], spin[0, 2], spin[1, 0]])


def in_frame(contact, linear, angular):
    rows = np.append(contact.frame.T @ linear, contact.normal @ angular)
    return rows[: contact.model.dim] if not isinstance(contact.model, gf.FPC) else rows[:1]


def check_by_differences(hand, rng, spread, rounds=3):
    """Every column of J against the velocities of the material points at the contacts."""
    for _ in range(rounds):
        q = rng.uniform(-spread, spread, len(hand.q_names))
        points = hand.fingertip_positions(q) + rng.uniform(-0.01, 0.01, (len(hand.made_by), 3))
        models = [gf.SFC(0.5, 0.01), gf.PCWF(0.5), gf.FPC(), gf.PCWF(0.3)][: len(points)]
        contacts = contacts_at(points, rng, models)
        J = hand.jacobian(contacts, q)
        for j, name in enumerate(hand.joint_names):
            dq = np.array([float(each == name) for each in hand.q_names])
            expected = [
                in_frame(contact, *material_velocity(hand, tip, contact.point, q, dq))
                for contact, tip in zip(contacts, hand.made_by, strict=True)
            ]
            np.testing.assert_allclose(J[:, j], np.concatenate(expected), atol=1e-8)


# ---- kinematics --------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", ["radial", "palm_normal"])
def test_the_papers_hand_from_a_file_is_paper_hand(axis, written):
    hand, own = from_urdf(written(paper_hand_urdf(axis)), PADS), PaperHand(axis)
    assert isinstance(hand, Hand)
    assert isinstance(hand, UnderactuatedHand)
    assert set(hand.joint_names) == set(own.joint_names)
    assert hand.joint_names == hand.q_names
    assert hand.notes == ()
    assert hand.tau_hi.tolist() == [0.5] * 12
    order = [own.joint_names.index(name) for name in hand.joint_names]
    rng = np.random.default_rng(1)
    last_links = from_urdf(written(paper_hand_urdf(axis)), [f"distal{i}" for i in (1, 2, 3, 4)])
    models = [gf.SFC(0.5, 0.01), gf.FPC(), gf.PCWF(0.3), gf.PCWF(0.5)]
    for _ in range(5):
        q = rng.uniform(-1, 1, 12)
        tips = own.forward_kinematics(q)
        np.testing.assert_allclose(hand.fingertip_positions(q[order]), tips, atol=1e-15)
        pads = last_links.fingertip_positions(q[order], [[0, 0, 0.075]] * 4)
        np.testing.assert_allclose(pads, tips, atol=1e-15)
        contacts = contacts_at(tips + rng.uniform(-0.004, 0.004, (4, 3)), rng, models)
        J, expected = hand.jacobian(contacts, q[order]), own.jacobian(contacts, q)[:, order]
        np.testing.assert_allclose(J, expected, atol=1e-15)
        np.testing.assert_array_equal(J == 0, expected == 0)


def test_mujoco_reads_the_same_hand(written):
    """Two libraries, one file: the same Jacobian, joint by joint."""
    mujoco = pytest.importorskip("mujoco")
    mimics = {"c": 'joint="b" multiplier=".7" offset=".1"'}
    path = written(mimicking("abc", mimics))
    mine = from_urdf(path, ["tip"])
    with pytest.raises(gf.ModelImportError, match="a URDF names no motors"):
        from_mjcf(path, ["tip"])
    text = path.read_text().replace(
        "<link", '<mujoco><compiler fusestatic="false"/></mujoco><link', 1
    )
    spec = mujoco.MjSpec.from_string(text)
    for name in "ab":
        spec.add_actuator(
            target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcelimited=True, forcerange=[-1, 1]
        )
    if not spec.equalities:  # MuJoCo may or may not read the mimic tag
        coupling = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1="c", name2="b"
        )
        coupling.data[:5] = [0.1, 0.7, 0, 0, 0]
    other = from_mjcf(spec.compile(), ["tip"])
    assert other.joint_names == mine.joint_names == ("a", "b")
    rng = np.random.default_rng(11)
    for q in rng.uniform(-1, 1, (4, 2)):
        tips = mine.fingertip_positions(q)
        np.testing.assert_allclose(other.fingertip_positions(q), tips, atol=1e-12)
        contacts = contacts_at(tips + 0.003, rng, [gf.SFC(0.5, 0.01)])
        J = mine.jacobian(contacts, q)
        np.testing.assert_allclose(other.jacobian(contacts, q), J, atol=1e-12)


def test_a_real_hand_joints_by_name():
    path = example_robot("allegro_hand_description/urdf/allegro_right_hand.urdf")
    tips = {name: f"link_{i}.0_tip" for name, i in
            {"index": 3, "middle": 7, "ring": 11, "thumb": 15}.items()}  # fmt: skip
    with pytest.warns(UserWarning, match="limit of 15 N·m for joint_0.0, .* a placeholder"):
        doubted = from_urdf(path, tips)
    assert doubted.tau_hi.tolist() == [15] * 16
    hand = from_urdf(path, tips, tau_max=0.7)
    (note,) = hand.notes
    assert note.startswith("friction in the joints helps to hold and is not counted")
    assert "joint_0.0 (up to 10)" in note
    assert hand.tau_lo.tolist() == [-0.7] * 16
    numbers = {"index": range(4), "middle": range(4, 8), "ring": range(8, 12),
               "thumb": range(12, 16)}  # fmt: skip
    assert hand.fingers == {
        finger: tuple(f"joint_{i}.0" for i in own) for finger, own in numbers.items()
    }
    check_by_differences(hand, np.random.default_rng(2), 0.7)


def test_a_real_hand_holds_a_sphere():
    """A 5 cm ball between thumb and fingers, contacts where the fingertips are."""
    path = example_robot("allegro_hand_description/urdf/allegro_right_hand.urdf")
    tips = [f"link_{i}.0_tip" for i in (3, 7, 11, 15)]
    hand = from_urdf(path, tips, tau_max=0.7)
    angles = {0: 0.0, 1: 0.9, 2: 0.7, 3: 0.5, 12: 1.3, 13: 0.3, 14: 0.4, 15: 0.6}
    angles |= {i + 4 * k: angles[i] for i in range(4) for k in (1, 2)}
    q = [angles[int(name.split("_")[1].split(".")[0])] for name in hand.q_names]
    at = hand.fingertip_positions(q)
    centre = (at[1] + at[3]) / 2
    inwards = (centre - at) / np.linalg.norm(centre - at, axis=1)[:, None]
    contacts = [gf.Contact(p, n, gf.PCWF(0.9)) for p, n in zip(at, inwards, strict=True)]
    grasp = gf.Grasp(contacts, hand, q, origin=centre)
    solution = gf.solve(grasp.problem([0, 0, 0.5, 0, 0, 0]), check=True)
    assert solution.verify().ok
    assert np.abs(solution.tau).max() < 0.7


def test_several_contacts_on_a_finger_and_the_palm(written):
    hand = from_urdf(written(paper_hand_urdf("radial")), {"index": "pad1", "thumb": "pad3"})
    own = [f"finger{i}_{each}" for i in (1, 3) for each in ("base", "pitch", "knee")]
    assert hand.joint_names == tuple(own)
    rng = np.random.default_rng(3)
    q = rng.uniform(-1, 1, 6)
    contacts = contacts_at(rng.uniform(-0.1, 0.1, (4, 3)), rng, [gf.PCWF(0.5)] * 4)
    J = hand.touching(["index", "index", "proximal3", "palm"]).jacobian(contacts, q)
    J = J.reshape(4, 3, 6)
    for i, contact in enumerate(contacts[:2]):
        alone = hand.touching(["pad1"]).jacobian([contact], q)
        np.testing.assert_array_equal(J[i], alone)
    assert J[2][:, 3:5].any()
    assert not J[2][:, [0, 1, 2, 5]].any()
    assert not J[3].any()
    with pytest.raises(gf.InvalidInputError, match=r"names: got 'pad2', .* palm"):
        hand.touching(["pad2"])  # moved by joints that are no part of this hand


# ---- mimic joints, by virtual work -------------------------------------------------------------


def chain(*joints):
    """Three links in a row."""
    return urdf_robot(["root", "one", "two", "three", "tip"], [
        *joints, urdf_joint("tip_fixed", "three", "tip", kind="fixed", origin="0 .01 .03"),
    ])  # fmt: skip


ENDS = (("root", "one"), ("one", "two"), ("two", "three"))
AXES = ("1 0 0", "0 1 0", "0 1 0.2")


def mimicking(names, mimics, kinds=("revolute",) * 3):
    limit = '<limit effort=".5" velocity="1" lower="-2" upper="2"/>'
    return chain(*(
        urdf_joint(name, *ends, kind=kind, axis=axis, origin="0.01 0 .03",
              more=limit + (f"<mimic {mimics[name]}/>" if name in mimics else ""))
        for name, ends, axis, kind in zip(names, ENDS, AXES, kinds, strict=True)
    ))  # fmt: skip


MIMICS = {
    "a multiple": ("abc", {"c": 'joint="b" multiplier=".7" offset=".1"'}, ("a", "b")),
    "the same": ("abc", {"c": 'joint="b"'}, ("a", "b")),
    "one that comes later": ("abc", {"a": 'joint="c" multiplier="-.5"'}, ("b", "c")),
    "a chain": (
        "abc",
        {"a": 'joint="b" multiplier="2"', "b": 'joint="c" multiplier=".5" offset=".2"'},
        ("c",),
    ),
}


@pytest.mark.parametrize("kinds", [("revolute",) * 3, ("continuous",) * 3])
@pytest.mark.parametrize("case", MIMICS)
def test_mimic_joints_by_virtual_work(case, kinds, written):
    names, mimics, leaders = MIMICS[case]
    hand = from_urdf(written(mimicking(names, mimics, kinds)), ["tip"])
    assert hand.joint_names == hand.q_names == leaders
    rng = np.random.default_rng(4)
    for _ in range(4):
        q, dq = rng.uniform(-0.8, 0.8, (2, len(leaders)))
        (contact,) = contacts_at(hand.fingertip_positions(q) + 0.004, rng, [gf.SFC(0.5, 0.01)])
        c = rng.normal(size=4)
        dx = in_frame(contact, *material_velocity(hand, "tip", contact.point, q, dq))
        assert (hand.jacobian([contact], q).T @ c) @ dq == pytest.approx(c @ dx, abs=1e-8)
        assert len(hand.passive_rows([contact], q)) == 0
    if case == "a multiple":
        assert hand.notes == ("'b' also moves 'c' by 0.7 per unit of its own motion",)


def test_a_mimic_of_nothing():
    """A hand that is sold: its joints mimic names that its file does not have."""
    path = example_robot("alex_description/urdf/alex_psyonic_hands.urdf")
    match = r"'Left_index_q2' mimics 'index_q1', which is not there; expected one of .*Left_index"
    with pytest.raises(gf.ModelImportError, match=match):
        from_urdf(path, ["Left_index_L2"])
    with pytest.warns(UserWarning, match="may be a placeholder"):  # of the arm; the thumb is sound
        from_urdf(path, ["Left_thumb_L2"])


def test_a_gripper_that_is_sold():
    path = example_robot("panda_description/urdf/panda.urdf")
    arm = {f"panda_joint{i}": 87.0 if i < 5 else 12.0 for i in range(1, 8)}  # known to be true
    hand = from_urdf(path, ["panda_leftfinger", "panda_rightfinger"], tau_max=arm)
    assert hand.joint_names[-1] == "panda_finger_joint1"
    assert hand.tau_hi[-1] == 100  # a slide's [N]: nothing to doubt
    assert "'panda_finger_joint1' also moves 'panda_finger_joint2' by 1" in hand.notes[-1]
    check_by_differences(hand, np.random.default_rng(5), 0.5, rounds=2)


# ---- limits ------------------------------------------------------------------------------------


def with_efforts(*efforts, kinds=("revolute",) * 3):
    mores = [
        "" if effort is None else f'<limit effort="{effort}" velocity="1" lower="-2" upper="2"/>'
        for effort in efforts
    ]
    return chain(*(
        urdf_joint(name, *ends, kind=kind, axis=axis, origin="0 0 .03", more=more)
        for name, ends, axis, kind, more in zip("abc", ENDS, AXES, kinds, mores, strict=True)
    ))  # fmt: skip


def test_limits_come_from_the_file_or_the_user(written):
    path = written(with_efforts(0.5, 15, 1000))
    with pytest.warns(UserWarning, match="may be a placeholder") as caught:
        hand = from_urdf(path, ["tip"])
    assert hand.notes == tuple(str(each.message) for each in caught)
    assert [note.split(" may")[0] for note in hand.notes] == [
        "the file's limit of 15 N·m for b",
        "the file's limit of 1000 N·m for c",
    ]
    assert {each.filename for each in caught} == {__file__}
    assert hand.tau_hi.tolist() == [0.5, 15, 1000]
    hand = from_urdf(path, ["tip"], tau_max={"b": 0.7, "c": 0.3})
    assert (hand.tau_lo.tolist(), hand.notes) == ([-0.5, -0.7, -0.3], ())
    assert from_urdf(path, ["tip"], tau_max=0.2).tau_hi.tolist() == [0.2] * 3


def test_a_slide_has_newtons(written):
    hand = from_urdf(written(with_efforts(0.5, 100, 0.5, kinds=("revolute", "prismatic",
                                                               "revolute"))), ["tip"])  # fmt: skip
    assert hand.notes == ()
    check_by_differences(hand, np.random.default_rng(6), 0.5)


def test_no_limit_at_all_is_refused_with_the_way_out(written):
    path = written(with_efforts(0.5, None, 0.5, kinds=("revolute", "continuous", "revolute")))
    with pytest.raises(gf.ModelImportError, match="no torque limit for b: give tau_max"):
        from_urdf(path, ["tip"])
    assert from_urdf(path, ["tip"], tau_max={"b": 0.4}).tau_hi.tolist() == [0.5, 0.4, 0.5]


def test_an_effort_of_zero_is_no_motor(written):
    path = written(with_efforts(0.5, 0, 0.5))
    with pytest.warns(UserWarning, match="no motor controls 'b'"):
        hand = from_urdf(path, ["tip"])
    assert hand.joint_names == ("a", "c")
    assert hand.q_names == ("a", "b", "c")
    assert (
        "the file gives 'b' no torque at all: taken as without a motor; tau_max gives it one"
        in hand.notes
    )
    rng = np.random.default_rng(7)
    q = rng.uniform(-1, 1, 3)
    full = from_urdf(path, ["tip"], tau_max={"b": 0.5})
    contacts = contacts_at(full.fingertip_positions(q), rng, [gf.PCWF(0.5)])
    J, rows = full.jacobian(contacts, q), hand.passive_rows(contacts, q)
    np.testing.assert_allclose(hand.jacobian(contacts, q), J[:, [0, 2]], atol=1e-15)
    np.testing.assert_allclose(rows * np.sign(rows[0, 0] * J[0, 1]), J[:, 1:2].T, atol=1e-15)


# ---- a Pinocchio model and lists of points -----------------------------------------------------


def paper_model(written, axis="radial"):
    return pin.buildModelFromUrdf(str(written(paper_hand_urdf(axis))))


def cube_contacts():
    points = 0.04 * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]) + [0, 0, 0.1]
    return [gf.Contact(p, (0.04 * np.array([0, 0, 2.5]) - p) / 0.04, gf.PCWF(0.5)) for p in points]


def test_from_pinocchio_is_the_hand_with_its_weight(written):
    model = paper_model(written)
    hand = from_urdf(written(paper_hand_urdf("radial")), PADS)
    contacts = cube_contacts()
    tips = np.array([contact.point for contact in contacts])
    own = PaperHand("radial")
    q = own.inverse_kinematics(tips)[[own.joint_names.index(name) for name in hand.q_names]]
    v = np.random.default_rng(8).normal(size=12)
    grasp = gf.Grasp.from_pinocchio(model, q, contacts, PADS, v, origin=(0, 0, 0.1))
    np.testing.assert_allclose(grasp.J, hand.jacobian(contacts, q), atol=1e-15)
    assert grasp.joint_names == hand.joint_names
    assert grasp.links == PADS
    bias = pin.rnea(model, model.createData(), q, v, np.zeros(12))
    np.testing.assert_allclose(grasp.tau_bias, bias, atol=1e-15)
    np.testing.assert_array_equal(grasp.W, gf.grasp_map(contacts, (0, 0, 0.1)))
    # At rest it is the slope of the potential energy.
    grasp = gf.Grasp.from_pinocchio(model, q, contacts, PADS)
    energy = [
        pin.computePotentialEnergy(model, model.createData(), q + step) for e in np.eye(12) for
        step in (1e-6 * e, -1e-6 * e)
    ]  # fmt: skip
    slope = np.diff(np.reshape(energy, (12, 2)))[:, 0] / -2e-6
    np.testing.assert_allclose(grasp.tau_bias, slope, atol=1e-8)
    solution = gf.solve(grasp.problem([0, 0, 2.5, 0, 0, 0]), check=True)
    np.testing.assert_allclose(solution.tau, grasp.J.T @ solution.c + grasp.tau_bias, atol=1e-12)


def quietly(function, *arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function(*arguments)


@pytest.mark.parametrize("case", ["a joint that follows", "a joint without a motor"])
def test_a_hand_from_a_file_weighs_what_its_model_does(case, written):
    follows = case == "a joint that follows"
    mimic = {"c": 'joint="b" multiplier=".7"'}
    path = written(mimicking("abc", mimic) if follows else with_efforts(0.5, 0, 0.5))
    model = pin.buildModelFromUrdf(str(path), mimic=True)
    hand = quietly(from_urdf, path, ["tip"])
    rng = np.random.default_rng(14)
    q = rng.uniform(-0.8, 0.8, len(hand.q_names))
    contacts = contacts_at(hand.fingertip_positions(q) + 0.01, rng, [gf.SFC(0.5, 0.01)])
    other = quietly(gf.Grasp.from_pinocchio, model, q, contacts, ["tip"])
    grasp = gf.Grasp(contacts, hand, q)
    assert grasp.joint_names == other.joint_names
    assert np.abs(grasp.tau_bias).max() > 1e-4
    np.testing.assert_allclose(grasp.J, other.J, atol=1e-14)
    np.testing.assert_allclose(grasp.tau_bias, other.tau_bias, atol=1e-14)
    # The sign of a motion that nothing drives is nobody's.
    mine, theirs = (each.passive_rows * each.passive_loads[:, None] for each in (grasp, other))
    np.testing.assert_allclose(mine, theirs, atol=1e-14)
    assert len(mine) == 1 - follows
    plain = pin.buildModelFromUrdf(str(path))

    def energy(angles):
        whole = [*angles, 0.7 * angles[1]] if follows else angles
        return pin.computePotentialEnergy(plain, plain.createData(), np.array(whole))

    slope = [(energy(q + e) - energy(q - e)) / 2e-6 for e in 1e-6 * np.eye(len(q))]
    driven = [hand.q_names.index(name) for name in hand.joint_names]
    np.testing.assert_allclose(grasp.tau_bias, np.array(slope)[driven], atol=1e-8)


def test_several_contacts_and_what_does_not_move(written):
    model = paper_model(written)
    contacts = cube_contacts()
    q = np.zeros(12)
    grasp = gf.Grasp.from_pinocchio(model, q, contacts, ["pad1", "pad1", "palm", "universe"])
    assert grasp.joint_names == ("finger1_base", "finger1_pitch", "finger1_knee")
    J = grasp.J.reshape(4, 3, 3)
    assert J[0].any()
    assert J[1].any()
    assert not J[2:].any()


def test_a_reader_that_is_updated_is_one_made_anew(written):
    model = paper_model(written)
    contacts, own = cube_contacts(), PaperHand("radial")
    rng = np.random.default_rng(12)
    arguments = ["pad1", "pad1", "palm", "universe"]
    q = np.zeros(12)
    reader = gf.hands.PinocchioGrasp(model, q, contacts, arguments)
    start = own.inverse_kinematics(np.array([contact.point for contact in contacts]))
    for _ in range(20):
        q, v = start + rng.normal(size=12) * 0.1, rng.normal(size=12)
        contacts = contacts_at(rng.normal(size=(4, 3)) * 0.1, rng, [gf.SFC(0.5, 0.01)] * 4)
        origin = rng.normal(size=3) * 0.1
        reader.update(q, contacts, v, origin)
        other = gf.Grasp.from_pinocchio(model, q, contacts, arguments, v, origin)
        for name in ("origin", "W", "J", "tau_bias", "tau_lo", "tau_hi"):
            np.testing.assert_array_equal(getattr(reader, name), getattr(other, name), name)
        for name in ("contacts", "links", "joint_names", "notes"):
            assert getattr(reader, name) == getattr(other, name)
        # The point of the link that is at the contact, moved by each joint alone.
        for column, name in enumerate(reader.joint_names):
            dof = model.joints[model.getJointId(name)].idx_v
            for row, contact in enumerate(contacts[:2]):
                a, b = (moved_point(model, q, q + s * np.eye(12)[dof], "pad1", contact.point)
                        for s in (-1e-6, 1e-6))  # fmt: skip
                rate = contact.frame.T @ (b - a) / 2e-6
                np.testing.assert_allclose(reader.J[4 * row :][:3, column], rate, atol=1e-9)


def moved_point(model, q, q_moved, frame, point):
    """Where a point of the world at q is at q_moved when it goes along with a frame."""
    data, index = model.createData(), model.getFrameId(frame)
    pin.framesForwardKinematics(model, data, q)
    local = data.oMf[index].actInv(point)
    pin.framesForwardKinematics(model, data, q_moved)
    return data.oMf[index].act(local)


def test_a_robot_of_one_joint(written):
    path = written(urdf_robot(["palm", "tip"], [urdf_joint("a", "palm", "tip", axis="0 0 1")]))
    contact = gf.Contact((0.03, 0.0, 0.02), (0, 1, 0), gf.PCWF(0.5), tangent=(0, 0, 1))
    reader = gf.hands.PinocchioGrasp(pin.buildModelFromUrdf(str(path)), [0.0], [contact], ["tip"])
    np.testing.assert_allclose(reader.J, [[0.03], [0], [0]], atol=1e-15)
    hand = from_urdf(path, ["tip"])
    np.testing.assert_allclose(hand.jacobian([contact], [0.0]), reader.J, atol=1e-15)


def test_an_update_that_is_refused_leaves_the_reader(written):
    model, contacts, q = paper_model(written), cube_contacts(), np.zeros(12)
    reader = gf.hands.PinocchioGrasp(model, q, contacts, PADS)
    before = reader.J.copy()
    for match, *arguments in (
        ("contacts: got 3, expected 4, made by pad1, pad2, pad3, pad4", q, contacts[:3]),
        (r"q: got shape \(11,\), expected shape \(12,\)", q[1:], contacts),
        (r"v: got shape \(11,\), expected shape \(12,\)", q, contacts, q[1:]),
        (r"origin: got shape \(2,\)", q + 0.1, contacts, None, (0, 0)),
    ):
        with pytest.raises(gf.InvalidInputError, match=match):
            reader.update(*arguments)
    np.testing.assert_array_equal(reader.J, before)


def test_a_floating_base_is_held(written):
    path = str(written(paper_hand_urdf("radial")))
    model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
    fixed = pin.buildModelFromUrdf(path)
    rng = np.random.default_rng(9)
    q = rng.uniform(-1, 1, 12)
    base = np.array([0, 0, 0, 0, 0, 0, 1.0])
    arguments = (cube_contacts(), PADS)
    grasp = gf.Grasp.from_pinocchio(model, np.concatenate((base, q)), *arguments)
    expected = gf.Grasp.from_pinocchio(fixed, q, *arguments)
    np.testing.assert_allclose(grasp.J, expected.J, atol=1e-15)
    np.testing.assert_allclose(grasp.tau_bias, expected.tau_bias, atol=1e-15)
    assert grasp.joint_names == expected.joint_names


def test_pinocchios_own_mimic_joints_are_the_files():
    path = example_robot("panda_description/urdf/panda.urdf")
    model = pin.buildModelFromUrdf(str(path), mimic=True)
    tips = ["panda_leftfinger", "panda_rightfinger"]
    hand = from_urdf(path, tips, tau_max=20.0)
    rng = np.random.default_rng(10)
    q = rng.uniform(-0.5, 0.5, 8)
    contacts = contacts_at(hand.fingertip_positions(q), rng, [gf.PCWF(0.5)] * 2)
    grasp = gf.Grasp.from_pinocchio(model, q, contacts, tips, tau_max=20.0)
    np.testing.assert_allclose(grasp.J, hand.jacobian(contacts, q), atol=1e-12)
    assert grasp.joint_names == hand.joint_names
    follower = gf.Grasp.from_pinocchio(model, q, contacts[1:], tips[1:], tau_max=20.0)
    assert follower.joint_names[-1] == "panda_finger_joint1"
    np.testing.assert_allclose(follower.J, grasp.J[3:], atol=1e-12)


def test_a_gripper_whose_jaws_mimic_each_other_has_one_motor(written):
    """Pinocchio keeps that only if it is asked to: then the model has one degree of freedom."""
    limit = '<limit effort="20" velocity="1" lower="0" upper=".03"/>'
    mimic = limit + '<mimic joint="ja" multiplier="-.5"/>'
    joints = [
        urdf_joint("ja", "base", "a", kind="prismatic", axis="1 0 0", more=limit),
        urdf_joint("jb", "base", "b", kind="prismatic", axis="0 0 1", more=mimic),
    ]
    path = written(urdf_robot(["base", "a", "b"], joints))
    model = pin.buildModelFromUrdf(str(path), mimic=True)
    contacts = [
        gf.Contact((-0.02, 0, 0), (1, 0, 0), gf.PCWF(0.5), (0, 0, 1)),
        gf.Contact((0.02, 0, 0), (-1, 0, 0), gf.PCWF(0.5), (0, 0, 1)),
    ]
    grasp = gf.Grasp.from_pinocchio(model, [0.01], contacts, ["a", "b"])
    again = gf.Grasp(contacts, from_urdf(path, ["a", "b"]), [0.01])
    for each in (grasp, again):
        assert each.joint_names == ("ja",)
        np.testing.assert_allclose(each.J[:, 0], [1, 0, 0, 0, -0.5, 0], atol=1e-15)
        # Jaw b goes down as a closes, so its weight helps to.
        mass = pin.buildModelFromUrdf(str(path)).inertias[2].mass
        assert mass > 0
        assert each.tau_bias == pytest.approx([-0.5 * 9.81 * mass])


def test_a_passive_joint_bears_what_it_weighs(written):
    model = pin.buildModelFromUrdf(str(written(with_efforts(0.5, 0, 0.5))))
    q = np.array([0.3, 0.4, -0.2])
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    tip = data.oMf[model.getFrameId("tip")].translation
    contact = gf.Contact(tip, (0, 0, 1), gf.PCWF(0.5))
    with pytest.warns(UserWarning, match="no motor controls 'b'"):
        grasp = gf.Grasp.from_pinocchio(model, q, [contact], ["tip"])
    weight = pin.computeGeneralizedGravity(model, data, q)
    assert np.abs(grasp.passive_loads) == pytest.approx(np.abs(weight[1:2]), abs=1e-15)
    assert grasp.tau_bias == pytest.approx(weight[[0, 2]], abs=1e-15)
    c = np.linalg.lstsq(grasp.passive_rows, grasp.passive_loads, rcond=None)[0]
    pin.computeJointJacobians(model, data, q)
    J = pin.getFrameJacobian(model, data, model.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED)
    felt = J[:3, 1] @ -(contact.frame @ c)
    assert felt == pytest.approx(weight[1], abs=1e-15)


# ---- bad input ---------------------------------------------------------------------------------


def test_files_that_are_no_urdf(tmp_path, capfd):
    with pytest.raises(gf.ModelImportError, match=r"no\.urdf: cannot read the file: No such file"):
        from_urdf(tmp_path / "no.urdf", ["tip"])
    with pytest.raises(gf.ModelImportError, match="cannot read the file"):
        from_urdf(tmp_path, ["tip"])
    bad = tmp_path / "bad.urdf"
    bad.write_text("hello")
    with pytest.raises(gf.ModelImportError, match=r"bad\.urdf: not a URDF: syntax error"):
        from_urdf(str(bad), ["tip"])
    bad.write_text("<mujoco/>")
    with pytest.raises(gf.ModelImportError, match="got <mujoco>, expected a URDF's <robot>"):
        from_urdf(bad, ["tip"])
    assert capfd.readouterr() == ("", "")  # Pinocchio's parser was not let at them
    tie = '<joint name="j" type="{}"><parent link="a"/><child link="{}"/></joint>'
    links = '<link name="a"/><link name="b"/>'
    for text, reason in (
        (links, r"Two root links found: \[a\] and \[b\]$"),
        (links + tie.format("fixed", "c"), r"child link \[c\] of joint \[j\] not found$"),
        (links + tie.format("revolute", "b"), r"REVOLUTE but it does not specify limits"),
        (links + '<link name="a"/>', r"link 'a' is not unique"),
    ):
        bad.write_text(f'<robot name="r">{text}</robot>')
        with pytest.raises(
            gf.ModelImportError, match=f"not a robot that Pinocchio reads: .*{reason}"
        ):
            from_urdf(bad, ["tip"])
    assert capfd.readouterr() == ("", "")
    bad.write_text(mimicking("abc", {"c": 'joint="b" multiplier="two"'}))
    with pytest.raises(gf.ModelImportError, match="mimic of joint 'c': could not convert"):
        from_urdf(bad, ["tip"])


def test_what_is_printed_of_a_file_that_is_read_is_not_lost(capfd):
    with native_stderr() as said:
        os.write(2, b"a warning\n")
        assert capfd.readouterr().err == ""
        assert said() == "a warning\n"
    assert capfd.readouterr().err == "a warning\n"


def test_names_that_are_not_there(written):
    path = written(paper_hand_urdf("radial"))
    with pytest.raises(gf.InvalidInputError, match=r"fingertips: got 'thumb', .*palm, base1.*pad4"):
        from_urdf(path, ["thumb"])
    with pytest.raises(gf.InvalidInputError, match="tau_max: got a limit for 'knee', expected one"):
        from_urdf(path, PADS, tau_max={"knee": 1.0})


def test_fingers_without_a_motor(written):
    with pytest.raises(gf.ModelImportError, match="finger 'palm' has no actuated joint"):
        from_urdf(written(paper_hand_urdf("radial")), ["pad1", "palm"])
    path = written(with_efforts(0, 0, 0))
    with pytest.raises(gf.ModelImportError, match=r"finger 'tip' has no actuated joint: .*tau_max"):
        from_urdf(path, ["tip"])
    assert len(from_urdf(path, ["tip"], tau_max=0.5).joint_names) == 3


def test_bad_arguments_of_from_pinocchio(written):
    model, contacts = paper_model(written), cube_contacts()
    q = np.zeros(12)

    def refused(match, *arguments, error=gf.InvalidInputError, **options):
        with pytest.raises(error, match=match):
            gf.Grasp.from_pinocchio(*arguments, **options)

    refused("model: got a str, expected a pinocchio.Model", "hand.urdf", q, contacts, PADS)
    refused(r"q: got shape \(11,\), expected shape \(12,\)", model, q[1:], contacts, PADS)
    refused(r"v: got shape \(11,\)", model, q, contacts, PADS, q[1:])
    refused(r"links: got \('pad1', .*expected 3 names", model, q, contacts[:3], PADS)
    refused("links: got 'pad1', expected a list of str", model, q, contacts, "pad1")
    refused(r"links: got 'pad9'.*universe, palm", model, q, contacts, ["pad9", *PADS[1:]])
    refused("contacts: got none", model, q, [], [])
    refused("origin: got shape", model, q, contacts, PADS, origin=(0, 0))
    refused(
        "no motor moves any of the links palm",
        model, q, contacts[:1], ["palm"], error=gf.ModelImportError,
    )  # fmt: skip


def test_without_pinocchio_the_error_names_the_pip_line(monkeypatch, written):
    model = paper_model(written)
    monkeypatch.setitem(__import__("sys").modules, "pinocchio", None)
    match = r"pip install 'pin[<>=]"
    with pytest.raises(gf.MissingExtraError, match=match):
        from_urdf("hand.urdf", ["tip"])
    with pytest.raises(gf.MissingExtraError, match=match):
        gf.Grasp.from_pinocchio(model, np.zeros(12), cube_contacts(), PADS)


# ---- mimic joints beside a Pinocchio model -----------------------------------------------------

GRIPPERS = {
    "slides": ("prismatic", "1 0 0", "-1 0 0", 1.0),
    "knuckles": ("revolute", "0 1 0", "0 1 0", -1.0),
    "one slower": ("prismatic", "1 0 0", "-1 0 0", 0.5),
}


def gripper(case, mimic=True):
    kind, left, right, multiplier = GRIPPERS[case]
    limit = '<limit effort="4" velocity="1" lower="0" upper=".03"/>'
    follows = f'<mimic joint="left" multiplier="{multiplier}"/>' if mimic else ""
    joints = [
        urdf_joint("wrist", "root", "palm", axis="0 0 1"),
        urdf_joint("left", "palm", "a", kind=kind, origin="-.03 0 0", axis=left, more=limit),
        urdf_joint(
            "right", "palm", "b", kind=kind, origin=".03 0 0", axis=right, more=limit + follows
        ),
    ]
    return urdf_robot(["root", "palm", "a", "b"], joints)


def pinch():
    return [gf.Contact((x, 0, 0.05), (-np.sign(x), 0, 0), gf.PCWF(0.5)) for x in (-0.02, 0.02)]


@pytest.mark.parametrize("case", GRIPPERS)
@pytest.mark.parametrize("mimic", [False, True])
def test_the_urdf_beside_a_model_tells_its_mimic_joints(case, mimic, written):
    text = gripper(case)
    path = written(text)
    hand = from_urdf(path, ["a", "b"])
    model = pin.buildModelFromXML(text, mimic=mimic)
    for urdf in (text, path, str(path)):
        grasp = gf.Grasp.from_pinocchio(model, pin.neutral(model), pinch(), ["a", "b"], urdf=urdf)
        assert grasp.joint_names == hand.joint_names == ("wrist", "left")
        expected = hand.jacobian(pinch(), np.zeros(2))
        np.testing.assert_allclose(grasp.J, expected, atol=1e-12)


@pytest.mark.parametrize("case", ["slides", "knuckles"])
def test_jaws_whose_motors_a_model_does_not_tell_are_refused(case):
    model = pin.buildModelFromXML(gripper(case))
    q = pin.neutral(model)
    with pytest.raises(gf.ModelImportError, match="joints 'left' and 'right' of one link"):
        gf.Grasp.from_pinocchio(model, q, pinch(), ["a", "b"])
    both = {"left": 4.0, "right": 4.0}
    grasp = gf.Grasp.from_pinocchio(model, q, pinch(), ["a", "b"], tau_max=both)
    assert grasp.joint_names == ("wrist", "left", "right")
    assert any("urdf= does" in note for note in grasp.notes)
    # So do motors that are named, both or with the other one locked, and no note has doubts.
    for motors, locked in ((("wrist", "left", "right"), ()), (("wrist", "left"), ("right",))):
        grasp = gf.Grasp.from_pinocchio(model, q, pinch(), ["a", "b"], motors=motors, locked=locked)
        assert grasp.joint_names == motors
        assert not any("urdf= does" in note for note in grasp.notes)
    with pytest.raises(gf.ModelImportError, match="joints 'left' and 'right' of one link"):
        gf.Grasp.from_pinocchio(model, q, pinch(), ["a", "b"], motors=["wrist", "left"])
    # A file without mimic joints says that each has a motor.
    grasp = gf.Grasp.from_pinocchio(model, q, pinch(), ["a", "b"], urdf=gripper(case, mimic=False))
    assert grasp.joint_names == ("wrist", "left", "right")


def test_fingers_of_several_joints_are_no_jaws(written):
    model = paper_model(written)
    grasp = gf.Grasp.from_pinocchio(model, np.zeros(12), cube_contacts(), PADS)
    assert len(grasp.joint_names) == 12


@pytest.mark.parametrize(
    ("urdf", "text"),
    [
        ("missing.urdf", "cannot read"),
        ("<robot", "urdf: not a URDF"),
        ("<mujoco/>", "got <mujoco>"),
    ],
)
def test_what_is_no_urdf_is_refused(urdf, text):
    model = pin.buildModelFromXML(gripper("slides"))
    with pytest.raises(gf.ModelImportError, match=text):
        gf.Grasp.from_pinocchio(model, pin.neutral(model), pinch(), ["a", "b"], urdf=urdf)
