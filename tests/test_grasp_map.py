"""The grasp map W against forces and torques put together by hand, and against virtual work."""

import numpy as np
import pytest
from grasps import KINDS, components, random_contacts, random_model
from scipy.spatial.transform import Rotation

import graspforce as gf
from graspforce.grasp_map import stacked_maps

MIXED = [*KINDS, *KINDS[::-1]]


@pytest.fixture
def contacts(rng):
    return random_contacts(rng, [random_model(rng, kind) for kind in MIXED])


def wrench_by_hand(contacts, c, origin):
    """Add up force and torque contact by contact, with nothing but cross products."""
    force, torque = np.zeros(3), np.zeros(3)
    for contact, part in zip(contacts, components([k.model for k in contacts]), strict=True):
        normal, x = contact.normal, contact.tangent
        y = np.cross(normal, x)
        y_i = np.zeros(4)
        y_i[: contact.model.dim] = c[part]
        push = y_i[0] * normal + y_i[1] * x + y_i[2] * y
        force += push
        torque += np.cross(contact.point - origin, push) + y_i[3] * normal
    return np.concatenate((force, torque))


@pytest.mark.parametrize("origin", [(0, 0, 0), (0.3, -0.2, 0.1)])
def test_wrench_is_the_sum_of_the_contacts_forces_and_torques(contacts, rng, origin):
    W = gf.grasp_map(contacts, origin)
    c = rng.normal(size=W.shape[1])
    assert W @ c == pytest.approx(wrench_by_hand(contacts, c, np.array(origin)), abs=1e-14)


def test_shape_and_order_of_the_columns(contacts):
    W = gf.grasp_map(contacts)
    assert W.shape == (6, sum(contact.model.dim for contact in contacts))
    for contact, part in zip(contacts, components([k.model for k in contacts]), strict=True):
        alone = gf.grasp_map([contact])
        assert np.array_equal(W[:, part], alone)
        assert alone[:3, 0] == pytest.approx(contact.normal)


def test_a_soft_fingers_torsion_is_pure_torque_about_the_normal():
    W = gf.grasp_map([gf.Contact((1, 2, 3), (0, 1, 0), gf.SFC(0.5, 0.01))])
    assert W[:, 3].tolist() == [0, 0, 0, 0, 1, 0]


def test_virtual_work(contacts, rng):
    """c·(velocities of the contact points in their frames) = (W c)·(twist of the body)."""
    W = gf.grasp_map(contacts)
    c, twist = rng.normal(size=W.shape[1]), rng.normal(size=6)
    power = 0.0
    h = 1e-6
    for contact, part in zip(contacts, components([k.model for k in contacts]), strict=True):
        # The body moves by the twist; the point's velocity by central difference of its motion.
        moved = [
            Rotation.from_rotvec(s * h * twist[3:]).as_matrix() @ contact.point + s * h * twist[:3]
            for s in (-1, 1)
        ]
        velocity = (moved[1] - moved[0]) / (2 * h)
        rates = np.append(contact.frame.T @ velocity, twist[3:] @ contact.normal)
        power += rates[: contact.model.dim] @ c[part]
    assert twist @ (W @ c) == pytest.approx(power, rel=1e-8)


def test_a_rigid_motion_of_everything_moves_the_wrench_with_it(contacts, rng):
    R = Rotation.random(random_state=5).as_matrix()
    shift = np.array([0.4, -0.1, 0.2])
    moved = [
        gf.Contact(R @ k.point + shift, R @ k.normal, k.model, R @ k.tangent) for k in contacts
    ]
    W, W_moved = gf.grasp_map(contacts), gf.grasp_map(moved, origin=shift)
    turn = np.kron(np.eye(2), R)
    assert W_moved == pytest.approx(turn @ W, abs=1e-14)


def test_moving_the_origin_moves_the_torque_by_the_cross_product(contacts, rng):
    origin = np.array([0.1, 0.2, -0.3])
    c = rng.normal(size=gf.grasp_map(contacts).shape[1])
    here, there = gf.grasp_map(contacts) @ c, gf.grasp_map(contacts, origin) @ c
    assert there[:3] == pytest.approx(here[:3])
    assert there[3:] == pytest.approx(here[3:] - np.cross(origin, here[:3]), abs=1e-14)


def test_grasp_holds_the_same_map_and_the_models(contacts):
    grasp = gf.Grasp(contacts, origin=(0.01, 0, 0))
    assert np.array_equal(grasp.W, gf.grasp_map(contacts, (0.01, 0, 0)))
    assert grasp.models == tuple(k.model for k in contacts)
    assert grasp.contacts == tuple(contacts)
    assert grasp.J is None
    assert grasp.tau_lo is None
    problem = grasp.problem(np.ones(6), c_max=5.0, alpha=2.0)
    assert np.array_equal(problem.W, grasp.W)
    assert problem.alpha == 2.0
    assert "6 contacts" in repr(grasp)


class TwoJoints:
    """The least hand: a fixed Jacobian, two joints of unequal strength."""

    joint_names = ("bend", "spread")
    tau_lo = np.array([-1.0, -2.0])
    tau_hi = np.array([1.5, 2.5])

    def jacobian(self, contacts, q):
        m = sum(contact.model.dim for contact in contacts)
        return np.outer(np.arange(1.0, m + 1), np.asarray(q))


def test_grasp_takes_jacobian_and_limits_from_the_hand(contacts):
    hand = TwoJoints()
    assert isinstance(hand, gf.hands.Hand)
    problem = gf.Grasp(contacts, hand, q=[0.1, 0.2]).problem(np.ones(6))
    assert np.array_equal(problem.J, hand.jacobian(contacts, [0.1, 0.2]))
    assert np.array_equal(problem.tau_lo, hand.tau_lo)
    assert np.array_equal(problem.tau_hi, hand.tau_hi)
    tighter = gf.Grasp(contacts, hand, q=[0.1, 0.2]).problem(np.ones(6), tau_hi=1.0)
    assert tighter.tau_hi.tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("arguments", "missing"), [({"q": [0, 0]}, "hand"), ({"hand": TwoJoints()}, "q")]
)
def test_hand_and_joint_angles_come_together(contacts, arguments, missing):
    with pytest.raises(gf.InvalidInputError, match=f"^{missing}: missing"):
        gf.Grasp(contacts, **arguments)


def test_joint_angles_of_another_number_are_refused(contacts):
    with pytest.raises(gf.InvalidInputError, match=r"^q: got shape \(3,\), expected shape \(2,\)"):
        gf.Grasp(contacts, TwoJoints(), q=[0, 0, 0])


@pytest.mark.filterwarnings("ignore::graspforce.GraspForceWarning")
def test_stacked_maps_are_those_of_contacts(rng):
    kinds = [gf.SFC(0.5, 0.01), gf.FPC(), gf.PCWF(0.5)]
    points, tangents = 0.1 * rng.normal(size=(2, 200, 3, 3))
    normals = rng.normal(size=(200, 3, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[:9] = np.eye(3)
    tangents[:9] = np.roll(np.eye(3), 1, axis=0)
    tangents[9:30] *= 1e-200
    origins = rng.normal(size=(200, 1, 3))
    expected = [
        gf.grasp_map(
            [gf.Contact(points[i, j], normals[i, j], kinds[j], tangents[i, j]) for j in range(3)],
            origins[i, 0],
        )
        for i in range(200)
    ]  # fmt: skip
    given = (origins, points, normals, tangents, [model.dim for model in kinds])
    np.testing.assert_array_equal(stacked_maps(*given, exact=True), expected)
    ordinary = [each[30:] if len(each) == 200 else each for each in given]
    np.testing.assert_allclose(stacked_maps(*ordinary), expected[30:], atol=1e-14)
