"""The paper's hand: kinematics against itself, the Jacobian against finite differences."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import graspforce as gf
from graspforce.hands import Hand, PaperHand

HANDS = [
    PaperHand(base_axis=axis, elbow=elbow)
    for axis in ("palm_normal", "radial")
    for elbow in ("outward", "inward", ("outward", "inward", "inward", "outward"))
]
RADIAL = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
each_hand = pytest.mark.parametrize("hand", HANDS, ids=repr)


def reachable_points(hand: PaperHand, rng: np.random.Generator) -> np.ndarray:
    """Fingertips above the palm, anywhere from folded to nearly straight."""
    d = rng.standard_normal((4, 3))
    d[:, 2] = np.abs(d[:, 2]) + 0.1
    return hand.bases + d / np.linalg.norm(d, axis=1)[:, None] * rng.uniform(0.02, 0.149, (4, 1))


def contacts_at(points, rng, models) -> list[gf.Contact]:
    normals = rng.standard_normal((len(points), 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return [
        gf.Contact(p, n, model, tangent=rng.standard_normal(3))
        for p, n, model in zip(points, normals, models, strict=True)
    ]


def central(function, q, h=1e-6) -> np.ndarray:
    """Derivative of an array by each joint angle, joints last."""
    steps = h * np.eye(len(q))
    return np.stack([(function(q + e) - function(q - e)) / (2 * h) for e in steps], axis=-1)


def link_orientation(hand, q) -> np.ndarray:
    """The last links' axes as columns [along, bend axis, across], shape (4, 3, 3)."""
    base, knee, tip = hand.joint_positions(q).transpose(1, 0, 2)
    along = (tip - knee) / hand.link
    bend = np.cross(knee - base, tip - knee)
    bend /= np.linalg.norm(bend, axis=1)[:, None]
    return np.stack((along, bend, np.cross(along, bend)), axis=-1)


def test_upright_at_zero_and_the_base_axis_each_reading_names():
    for hand in HANDS:
        expected = hand.bases + np.array([0, 0, 0.15])
        np.testing.assert_allclose(hand.forward_kinematics(np.zeros(12)), expected, atol=1e-15)
    # Finger 1 leans out by 90°: along +x; then the first joint turns it by 90° about its axis.
    q = np.zeros(12)
    q[1] = np.pi / 2
    for hand in HANDS:
        np.testing.assert_allclose(hand.forward_kinematics(q)[0], [0.2, 0, 0], atol=1e-15)
    q[0] = np.pi / 2
    palm, radial = PaperHand("palm_normal"), PaperHand("radial")
    np.testing.assert_allclose(palm.forward_kinematics(q)[0], [0.05, 0.15, 0], atol=1e-15)
    np.testing.assert_allclose(radial.forward_kinematics(q)[0], [0.2, 0, 0], atol=1e-15)
    q[1] = 0
    np.testing.assert_allclose(palm.forward_kinematics(q)[0], [0.05, 0, 0.15], atol=1e-15)
    np.testing.assert_allclose(radial.forward_kinematics(q)[0], [0.05, -0.15, 0], atol=1e-15)


@each_hand
def test_forward_undoes_inverse_kinematics(hand):
    rng = np.random.default_rng(1)
    for _ in range(50):
        points = reachable_points(hand, rng)
        q = hand.inverse_kinematics(points)
        np.testing.assert_allclose(hand.forward_kinematics(q), points, rtol=0, atol=1e-14)
        drawn = hand.joint_positions(q)
        np.testing.assert_array_equal(drawn[:, 0], hand.bases)
        lengths = np.linalg.norm(np.diff(drawn, axis=1), axis=2)
        np.testing.assert_allclose(lengths, hand.link, rtol=1e-13)


@each_hand
def test_the_knee_is_on_the_side_that_the_elbow_names(hand):
    rng = np.random.default_rng(2)
    elbows = (hand.elbow,) * 4 if isinstance(hand.elbow, str) else hand.elbow
    for _ in range(20):
        base, knee, tip = hand.joint_positions(
            hand.inverse_kinematics(reachable_points(hand, rng))
        ).transpose(1, 0, 2)
        out = RADIAL if hand.base_axis == "radial" else (tip - base) * [1, 1, 0]
        side = np.einsum("ij,ij->i", knee - (base + tip) / 2, out)
        assert [("inward", "outward")[int(s > 0)] for s in side] == list(elbows)


@each_hand
def test_a_straight_finger_is_in_reach_and_a_fingertip_on_the_first_axis_too(hand):
    straight = hand.forward_kinematics(np.full(12, 0.3) * np.tile([1, 1, 0], 4))
    np.testing.assert_allclose(
        hand.forward_kinematics(hand.inverse_kinematics(straight)), straight, atol=1e-8
    )
    on_axis = hand.bases + (RADIAL if hand.base_axis == "radial" else [0, 0, 1]) * np.array(0.1)
    q = hand.inverse_kinematics(on_axis)
    np.testing.assert_allclose(hand.forward_kinematics(q), on_axis, atol=1e-15)


@pytest.mark.parametrize(
    ("points", "text"),
    [
        (
            np.tile([0, 0, 0.1], (4, 1)) + 0.2 * np.eye(4, 3, -1),
            r"points\[1\].*finger 2: 0\.2291 m",
        ),
        ([[0.05, 0, 0]] + [[0, 0, 0.1]] * 3, r"points\[0\].*finger 1: 0 m.*at most 0\.15 m"),
        (np.zeros((3, 3)), r"points: got shape \(3, 3\), expected shape \(4, 3\)"),
        (np.full((4, 3), np.nan), r"points\[0, 0\]: got nan"),
    ],
)
def test_out_of_reach_names_finger_distance_and_reach(points, text):
    with pytest.raises(gf.InvalidInputError, match=text):
        PaperHand().inverse_kinematics(points)


@each_hand
def test_jacobian_is_the_derivative_of_the_fingertips_in_contact_frames(hand):
    rng = np.random.default_rng(3)
    models = [gf.PCWF(0.5), gf.FPC(), gf.SFC(0.5, 0.01), gf.PCWF(0.3)]
    q = hand.inverse_kinematics(reachable_points(hand, rng))
    contacts = contacts_at(hand.forward_kinematics(q), rng, models)
    J = hand.jacobian(contacts, q)
    assert J.shape == (3 + 1 + 4 + 3, 12)
    tips = central(hand.forward_kinematics, q)  # (finger, xyz, joint)
    rows = [
        contacts[0].frame.T @ tips[0],
        contacts[1].normal[None] @ tips[1],
        contacts[2].frame.T @ tips[2],
        contacts[3].frame.T @ tips[3],
    ]
    torsion_row = 6 + 1
    forces = np.delete(J, torsion_row, axis=0)
    np.testing.assert_allclose(forces, np.vstack(rows), rtol=0, atol=1e-10)


@each_hand
def test_torsion_turns_with_the_last_link(hand):
    rng = np.random.default_rng(4)
    q = hand.inverse_kinematics(reachable_points(hand, rng))
    contacts = contacts_at(hand.forward_kinematics(q), rng, [gf.SFC(0.5, 0.01)] * 4)
    R = link_orientation(hand, q)
    turning = np.einsum("ijkq,ilk->ijlq", central(lambda p: link_orientation(hand, p), q), R)
    omega = np.stack((turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]), axis=1)
    expected = np.stack([contact.normal @ w for contact, w in zip(contacts, omega, strict=True)])
    np.testing.assert_allclose(hand.jacobian(contacts, q)[3::4], expected, rtol=0, atol=1e-8)


@each_hand
def test_a_rolled_contact_moves_with_the_last_link(hand):
    """A contact 4 mm from the fingertip is a point of the link: FD of the rigid motion."""
    rng = np.random.default_rng(5)
    q = hand.inverse_kinematics(reachable_points(hand, rng))
    tips = hand.forward_kinematics(q)
    in_link = rng.standard_normal((4, 3)) * 0.004 / 3
    R = link_orientation(hand, q)
    points = tips + np.einsum("ijk,ik->ij", R, in_link)
    contacts = contacts_at(points, rng, [gf.PCWF(0.5)] * 4)

    def moved(p):
        turned = np.einsum("ijk,ik->ij", link_orientation(hand, p), in_link)
        return hand.forward_kinematics(p) + turned

    expected = np.vstack(
        [contact.frame.T @ d for contact, d in zip(contacts, central(moved, q), strict=True)]
    )
    np.testing.assert_allclose(hand.jacobian(contacts, q), expected, rtol=0, atol=1e-9)


@each_hand
def test_virtual_work(hand):
    """The joints' power tau·dq is the power of the forces on the moving fingertips."""
    rng = np.random.default_rng(6)
    q = hand.inverse_kinematics(reachable_points(hand, rng))
    contacts = contacts_at(hand.forward_kinematics(q), rng, [gf.PCWF(0.5)] * 4)
    c, rate = rng.standard_normal(12), rng.standard_normal(12)
    h = 1e-6
    velocity = hand.forward_kinematics(q + h * rate) - hand.forward_kinematics(q - h * rate)
    forces = [contacts[i].frame @ c[3 * i : 3 * i + 3] for i in range(4)]
    tau = hand.jacobian(contacts, q).T @ c
    assert tau @ rate == pytest.approx(np.sum(forces * velocity) / (2 * h), abs=1e-9)


def test_signs_on_an_upright_finger():
    """Finger 1 upright pushes the object outward with 1 N: the pitch joint needs +0.15 N·m."""
    q = np.zeros(12)
    for axis, push, torques in [
        ("palm_normal", [1.0, 0, 0], [0, 0.15, 0.075]),
        ("radial", [1.0, 0, 0], [0, 0.15, 0.075]),
        ("palm_normal", [0, 1.0, 0], [0, 0, 0]),
        ("radial", [0, 1.0, 0], [-0.15, 0, 0]),
    ]:
        hand = PaperHand(axis)
        tips = hand.forward_kinematics(q)
        contacts = [gf.Contact(tip, push, gf.FPC()) for tip in tips]
        tau = hand.jacobian(contacts, q).T @ [1.0, 0, 0, 0]
        np.testing.assert_allclose(tau[:3], torques, atol=1e-15)
        np.testing.assert_array_equal(tau[3:], 0)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda c: c[:3], "contacts: got 3, expected 4"),
        (lambda c: [*c[:3], None], r"contacts\[3\]: got None, expected a Contact"),
        (lambda c: [c[1], c[0], *c[2:]], r"contacts\[0\]: 0\.0\d+ m from the tip of finger 1"),
    ],
)
def test_contacts_belong_to_their_fingers(change, text):
    hand = PaperHand("radial")
    q = hand.inverse_kinematics([[0.04, 0, 0.1], [0, 0.04, 0.1], [-0.04, 0, 0.1], [0, -0.04, 0.1]])
    contacts = [
        gf.Contact(tip, -normal, gf.PCWF(0.5))
        for tip, normal in zip(hand.forward_kinematics(q), RADIAL, strict=True)
    ]
    hand.jacobian(contacts, q)
    with pytest.raises(gf.InvalidInputError, match=text):
        hand.jacobian(change(contacts), q)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"base_axis": "normal"}, "base_axis: got 'normal', expected 'palm_normal' or 'radial'"),
        ({"elbow": "up"}, "elbow: got 'up'"),
        ({"elbow": None}, "elbow: got None"),
        ({"elbow": ("outward",) * 3}, "elbow: got .* or four of these"),
        ({"link": 0}, "link: got 0.0 m"),
        ({"half_width": -1}, "half_width: got -1.0 m"),
        ({"tau_max": float("nan")}, "tau_max: got nan"),
    ],
)
def test_bad_arguments(arguments, text):
    with pytest.raises(gf.InvalidInputError, match=text):
        PaperHand(**arguments)


def test_it_is_a_value_and_a_hand():
    hand = PaperHand("radial", elbow=["inward"] * 4, tau_max=1)
    assert isinstance(hand, Hand)
    assert pickle.loads(pickle.dumps(hand)) == hand
    assert eval(repr(hand)) == hand
    assert hand != PaperHand("radial", elbow="inward")
    assert len({hand, PaperHand(), PaperHand()}) == 2
    assert hand.joint_names[:4] == ("finger1_base", "finger1_pitch", "finger1_knee", "finger2_base")
    assert len(hand.joint_names) == 12
    np.testing.assert_array_equal(hand.tau_lo, np.full(12, -1.0))
    np.testing.assert_array_equal(hand.tau_hi, np.full(12, 1.0))
    with pytest.raises(AttributeError):
        hand.link = 1
