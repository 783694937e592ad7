"""Contacts that come and go, and torques through position servos."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import graspforce as gf
from graspforce.contact import PATCH_ANGLES, patch_weights
from graspforce.control import ContactBook, position_command

DT = 1e-3
POINTS = np.array([[0.04, 0, 0.01], [-0.02, 0.03, 0], [-0.02, -0.03, 0]])
NORMALS = -POINTS / np.linalg.norm(POINTS, axis=1)[:, None]
LINKS = ["thumb", "index", "index"]


def a_book(**options):
    return ContactBook({"thumb": 1, "index": 2}, ramp=0.1, patience=0.02, **options)


def started(**options):
    book = a_book(**options)
    book.update(POINTS, NORMALS, LINKS, DT)
    return book


def rotation(seed):
    Q, R = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    Q *= np.sign(np.diag(R))
    return Q * np.linalg.det(Q)


def test_a_grasp_that_holds_is_engaged_at_once():
    book = started()
    assert book.links == ("thumb", "index", "index")
    assert_array_equal(book.engagement, 1.0)
    assert_allclose(book.points, POINTS)
    assert_allclose(book.frames[..., 0], NORMALS)
    for contact, frame in zip(book.contacts(gf.PCWF(0.5)), book.frames, strict=True):
        assert_allclose(
            contact.frame.T if contact.frame[0, 0] != frame[0, 0] else contact.frame, frame
        )
        assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1)


@pytest.mark.parametrize("seed", range(20))
def test_the_order_of_the_contacts_is_no_matter(seed):
    book, rng = started(), np.random.default_rng(seed)
    for _ in range(30):
        order = rng.permutation(3)
        noise = 2e-4 * rng.standard_normal((3, 3))
        book.update((POINTS + noise)[order], NORMALS[order], [LINKS[i] for i in order], DT)
        assert_allclose(book.points, POINTS + noise)
        assert_array_equal(book.engagement, 1.0)
        assert book.present.all()


def test_flicker_changes_nothing():
    """A tenth of the contacts dropped at random: none is missing for as long as the patience."""
    book, rng = started(), np.random.default_rng(0)
    for _ in range(2000):
        there = np.flatnonzero(rng.random(3) > 0.1)
        book.update(POINTS[there], NORMALS[there], [LINKS[i] for i in there], DT)
        assert_array_equal(book.present, np.isin(range(3), there))
        assert_array_equal(book.engagement, 1.0)
        assert_allclose(book.points, POINTS)


def test_a_contact_that_left_lets_go_by_the_ramp_and_comes_back_by_it():
    book, seen = started(), []
    for tick in range(400):
        there = [0, 1] if tick < 200 else [0, 1, 2]
        book.update(POINTS[there], NORMALS[there], [LINKS[i] for i in there], DT)
        seen.append(book.engagement.copy())
    w = np.array(seen)[:, 2]
    assert_array_equal(np.array(seen)[:, :2], 1.0)
    assert_array_equal(w[:19], 1.0)  # the patience
    assert_allclose(w[20:120], 1 - 0.01 * np.arange(1, 101), atol=0.011)
    assert_array_equal(w[121:200], 0.0)
    assert_allclose(w[200:300], 0.01 * np.arange(1, 101), atol=1e-9)
    assert np.abs(np.diff(w)).max() <= DT / 0.1 + 1e-12


def test_a_touch_of_one_tick_weighs_next_to_nothing():
    book = a_book()
    book.update(POINTS[:2], NORMALS[:2], LINKS[:2], DT)
    for tick in range(100):
        there = [0, 1, 2] if tick == 10 else [0, 1]
        book.update(POINTS[there], NORMALS[there], [LINKS[i] for i in there], DT)
        assert book.engagement[2] <= 0.21  # one tick and the patience of 20
    assert book.engagement[2] == 0


def test_places_stay_on_an_object_that_moves():
    book = started()
    R, p = rotation(3), np.array([0.3, -0.1, 0.5])
    book.update([], [], [], DT, p, R)
    assert_allclose(book.points, p + POINTS @ R.T)
    assert_allclose(book.frames[..., 0], NORMALS @ R.T)
    assert_array_equal(book.engagement, 1.0)
    book.update(p + POINTS @ R.T, NORMALS @ R.T, LINKS, DT, p, R)
    assert book.present.all()
    assert_allclose(book.points, p + POINTS @ R.T)


def test_a_frame_turns_no_more_than_its_normal():
    book, rng = started(), np.random.default_rng(1)
    normals = NORMALS.copy()
    for _ in range(500):
        before = book.frames.copy()
        turned = normals + 0.02 * rng.standard_normal((3, 3))
        turned /= np.linalg.norm(turned, axis=1)[:, None]
        book.update(POINTS, turned, LINKS, DT)
        angle = np.linalg.norm(turned - normals, axis=1)
        assert (np.linalg.norm(book.frames[..., 1] - before[..., 1], axis=1) <= 1.1 * angle).all()
        assert_allclose(book.frames[..., 0], turned)
        normals = turned


def test_a_normal_that_comes_to_lie_along_x_has_a_frame():
    book = started()
    x = book.frames[0, :, 1]
    for degrees in range(0, 91, 5):
        angle = np.deg2rad(degrees)
        n = NORMALS[0] * np.cos(angle) + x * np.sin(angle)
        book.update([POINTS[0]], [n / np.linalg.norm(n)], ["thumb"], DT)
        assert_allclose(book.frames[0] @ book.frames[0].T, np.eye(3), atol=1e-12)


def test_a_normal_that_jumps_onto_x_gets_another_x():
    book = started()
    book.update([POINTS[0]], [book.frames[0, :, 1]], ["thumb"], DT)
    assert_allclose(book.frames[0].T @ book.frames[0], np.eye(3), atol=1e-12)


def test_two_contacts_near_one_slot_take_two():
    book = a_book()
    book.update(POINTS[:2], NORMALS[:2], LINKS[:2], DT)
    near = POINTS[1] + [0.002, 0, 0]
    book.update([POINTS[1], near], NORMALS[[1, 1]], ["index", "index"], DT)
    assert_allclose(book.points[1:], [POINTS[1], near])


def test_the_last_place_of_a_free_slot_attracts_nothing():
    book = started()
    for _ in range(150):  # the third lets go
        book.update(POINTS[:2], NORMALS[:2], LINKS[:2], DT)
    assert book.engagement[2] == 0
    for share in np.linspace(0, 1, 30):  # the second moves to where it was
        point = (1 - share) * POINTS[1] + share * POINTS[2]
        book.update([POINTS[0], point], NORMALS[:2], LINKS[:2], DT)
        assert_array_equal(book.present, [True, True, False])


def test_a_contact_out_of_reach_is_a_new_one():
    book = a_book(reach=0.005)
    book.update(POINTS[:2], NORMALS[:2], LINKS[:2], DT)
    moved = POINTS[1] + [0, 0.008, 0]
    book.update([POINTS[0], moved], NORMALS[:2], LINKS[:2], DT)
    assert_allclose(book.points[1:], [POINTS[1], moved])
    assert_array_equal(book.present, [True, False, True])
    assert_allclose(book.engagement, [1, 1, 0.01])
    # No slot is free for a third; the one that lets go is not taken over.
    book.update([POINTS[0], moved, [0, 0, 0.05]], NORMALS, LINKS, DT)
    assert book.without_slot == 1
    assert_allclose(book.points[1], POINTS[1])


def test_the_nearest_keep_their_slots():
    """Two contacts of a link that came near each other do not swap."""
    book = a_book(reach=0.05)
    book.update(POINTS, NORMALS, LINKS, DT)
    shifted = POINTS.copy()
    shifted[1:, 1] *= 0.5
    book.update(shifted[::-1], NORMALS[::-1], LINKS[::-1], DT)
    assert_allclose(book.points, shifted)


def test_links_without_slots_are_passed_over():
    book = a_book()
    book.update(POINTS, NORMALS, ["thumb", "palm", "index"], DT)
    assert_array_equal(book.present, [True, True, False])
    assert book.without_slot == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((POINTS[:2], NORMALS, LINKS, DT), r"points: got shape \(2, 3\), expected shape \(3, 3\)"),
        ((POINTS, 2 * NORMALS, LINKS, DT), r"normals\[0\]: got 2, expected vectors of length 1"),
        ((POINTS * np.nan, NORMALS, LINKS, DT), r"points\[0, 0\]: got nan"),
        ((POINTS, NORMALS, LINKS, 0.0), r"dt: got 0.0 s, expected more than 0"),
        ((POINTS, NORMALS, LINKS, DT, [1, 2]), r"position: got shape \(2,\)"),
    ],
)
def test_what_cannot_be_taken_changes_nothing(arguments, words):
    book = started()
    before = (book.points, book.frames, book.engagement.copy(), book.present)
    with pytest.raises(gf.InvalidInputError, match=words):
        book.update(*arguments)
    for was, value in zip(
        before, (book.points, book.frames, book.engagement, book.present), strict=True
    ):
        assert_array_equal(value, was)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (({},), "slots: got"),
        ((["thumb"],), "slots: got"),
        (({"thumb": 0},), r"slots\['thumb'\]: got 0, expected an integer"),
    ],
)
def test_a_book_without_slots_is_refused(arguments, words):
    with pytest.raises(gf.InvalidInputError, match=words):
        ContactBook(*arguments)


# ---- torques through position servos -----------------------------------------------------------


def servo_torque(command, q, stiffness, damping, q_dot, q_min, q_max, tau_max):
    """A position servo as MuJoCo has it: ctrlrange, then bias, then forcerange."""
    u = np.clip(command, q_min, q_max)
    return np.clip(stiffness * (u - q) - damping * q_dot, -tau_max, tau_max)


def test_the_command_makes_the_torque():
    rng = np.random.default_rng(0)
    q, q_dot, k, d = rng.uniform(-1, 1, 7), rng.uniform(-2, 2, 7), rng.uniform(1, 50, 7), 0.3
    tau = rng.uniform(-1, 1, 7)
    sent = position_command(tau, q, k, damping=d, q_dot=q_dot)
    assert_allclose(servo_torque(sent.q, q, k, d, q_dot, -np.inf, np.inf, np.inf), tau, atol=1e-12)
    assert_allclose(sent.tau, tau, atol=1e-12)
    assert not sent.saturated.any()


def test_saturation_is_said():
    q, k = np.zeros(4), np.array([1.0, 1.0, 10.0, 10.0])
    limits = {"q_min": -0.5, "q_max": 0.5, "tau_max": 2.0}
    sent = position_command([0.4, 0.6, 3.0, -3.0], q, k, **limits)
    assert_allclose(sent.tau, [0.4, 0.5, 2.0, -2.0])
    assert_array_equal(sent.saturated, [False, True, True, True])
    made = servo_torque(sent.q, q, k, 0, 0, -0.5, 0.5, 2.0)
    assert_allclose(made, sent.tau)
    assert (np.abs(sent.q) <= 0.5).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stiffness": [1, 0.0]}, r"stiffness\[1\]: got 0, expected more than 0"),
        ({"tau": [1, 2, 3.0]}, r"tau: got shape \(3,\), expected shape \(2,\)"),
        ({"q_min": 1.0, "q_max": 1.0}, r"q_min\[0\]: got 1, expected less than q_max"),
        ({"tau_max": np.nan}, r"tau_max\[0\]: got nan, expected"),
        ({"q": [0, np.inf]}, r"q\[1\]: got inf"),
    ],
)
def test_bad_arguments_are_named(changes, words):
    given = {"tau": [1.0, 1.0], "q": [0.0, 0.0], "stiffness": 1.0} | changes
    with pytest.raises(gf.InvalidInputError, match=words):
        position_command(**given)


def test_spare_slots_take_what_comes_late():
    """First of a link without slots, then more of one than it has; kept until they have let go."""
    book = a_book(spare=2)
    book.update(POINTS, NORMALS, LINKS, DT)
    assert book.links == ("thumb", "index", "index", None, None)
    assert_array_equal(book.engagement, [1, 1, 1, 0, 0])
    late = np.array([[0, 0, 0.05], [-0.01, 0, 0.05], [0.01, 0, 0.05]])
    normals = np.tile([0.0, 0.0, -1.0], (3, 1))

    def update(count, link="palm"):
        book.update(
            np.vstack((POINTS, late[:count])), np.vstack((NORMALS, normals[:count])),
            [*LINKS, *[link] * count], DT,
        )  # fmt: skip

    update(1)
    assert book.links == ("thumb", "index", "index", "palm", None)
    assert_allclose(book.engagement, [1, 1, 1, 0.01, 0])
    assert book.without_slot == 0
    update(3)
    assert book.links[3:] == ("palm", "palm")
    assert_array_equal(book.slots, [0, 1, 2, 3, 4, -1])
    assert book.without_slot == 1
    for _ in range(10):
        update(0)
    update(1, "wrist")  # the palm's still count
    assert book.without_slot == 1
    for _ in range(40):
        update(0)
    update(1, "wrist")
    assert book.links[3] == "wrist"
    assert book.without_slot == 0


def test_cones_of_one_patch_share_their_weight():
    """A link's contacts whose normals agree, as far as they are engaged; others weigh 1."""
    book, rng, shared = a_book(), np.random.default_rng(0), []
    for _ in range(60):
        tilted = np.array([0, 0, 1.0]) + 0.3 * rng.standard_normal((3, 3))
        tilted /= np.linalg.norm(tilted, axis=1)[:, None]
        there = np.flatnonzero(rng.random(3) > 0.4)
        book.update(POINTS[there], tilted[there], [LINKS[i] for i in there], 0.03)
        counts, normals = np.maximum(book.engagement, 1e-3), book.frames[:, :, 0]
        near, far = np.cos(PATCH_ANGLES)
        agreed = min(max((normals[1] @ normals[2] - far) / (near - far), 0), 1)
        assert_allclose(book.cone_weight[0], 1)
        for one, other in ((1, 2), (2, 1)):
            expected = counts[one] / (counts[one] + agreed * counts[other])
            assert_allclose(book.cone_weight[one], expected, rtol=1e-12)
        shared.append(expected)
        if (book.engagement == 1).all():
            assert_allclose(book.cone_weight, patch_weights(normals, LINKS), rtol=1e-12)
    assert min(shared) < 0.6


def test_more_contacts_than_ever_are_taken():
    book = a_book()
    k = 500
    points = np.tile(POINTS[1], (k, 1)) + 1e-4 * np.arange(k)[:, None]
    book.update(points, np.tile(NORMALS[1], (k, 1)), ["index"] * k, DT)
    assert book.without_slot == k - 2
    assert_allclose(book.points[1:], points[:2])


def test_without_spare_slots_other_links_are_passed_over():
    book = a_book()
    book.update(POINTS, NORMALS, ["thumb", "index", "wrist"], DT)
    assert_array_equal(book.slots, [0, 1, -1])
    assert book.without_slot == 0
