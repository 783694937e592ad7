"""What a control loop computes in every tick, against other ways to the same numbers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import graspforce as gf
from graspforce._engine import native
from graspforce.hands.transmission import _determined

core = native.module


def rotation(rng):
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return Q * np.linalg.det(Q)


@pytest.mark.parametrize("seed", range(20))
def test_the_nearest_motion_balances_its_two_wishes(seed):
    """The gradient of ½|q − wished|² in the metric and ½|weights (J q − wanted)|²/give is 0."""
    rng = np.random.default_rng(seed)
    m, n = rng.integers(0, 9), rng.integers(1, 7)
    root = rng.standard_normal((n, n + 1))
    metric, J = root @ root.T, rng.standard_normal((m, n))
    wanted, wished = rng.standard_normal(m), rng.standard_normal(n)
    weights, give = rng.random(m) * (rng.random(m) < 0.8), 10.0 ** rng.uniform(-3, 1)
    kept = wished.copy()
    q = core.nearest_motion(metric, J, wanted, weights, give, wished)
    gradient = metric @ (q - wished) + J.T @ (weights**2 * (J @ q - wanted)) / give
    assert_allclose(gradient, 0, atol=1e-9 * (1 + np.abs(wanted / give).max(initial=0)))
    assert_allclose(wished, kept, rtol=0)


def test_a_motor_that_moves_nothing_keeps_what_is_wished():
    metric = np.diag([2.0, 0.0, 3.0])
    J = np.array([[1.0, 0.0, 2.0]])
    one = np.ones(1)
    q = core.nearest_motion(metric, J, one, one, 1e-9, np.array([0.0, 7.0, 0.0]))
    assert q[1] == 7
    assert_allclose(J @ q, 1, atol=1e-8)


@pytest.mark.parametrize("seed", range(20))
def test_contact_maps_are_those_of_the_contacts(seed):
    rng = np.random.default_rng(seed)
    n, nv = rng.integers(1, 6), 7
    points, origin = rng.uniform(-1, 1, (n, 3)), rng.standard_normal(3)
    axes = np.array([rotation(rng).T for _ in range(n)])
    models = [[gf.FPC(), gf.PCWF(0.5), gf.SFC(0.5, 0.01)][k] for k in rng.integers(0, 3, n)]
    dims = np.array([model.dim for model in models])
    dofs = np.flatnonzero(rng.random(nv) < 0.7)
    screws = rng.standard_normal((len(dofs), 6))
    moved = rng.integers(-1, 2, (n, nv)).astype(float)
    W, work = core.contact_maps(points, axes, dims, origin, screws, moved, dofs)
    contacts = [
        gf.Contact(point, frame[0], model, frame[1])
        for point, frame, model in zip(points, axes, models, strict=True)
    ]
    assert_allclose(W, gf.grasp_map(contacts, origin), atol=1e-14)
    acting = np.repeat(moved[:, dofs], dims, axis=0)
    assert_allclose(work, acting * (W.T @ screws.T), atol=1e-13)


def simulated(rng, bodies, nv):
    """Return arrays as MuJoCo has them, with any numbers."""
    root = rng.standard_normal((nv, nv))
    return {
        "mass_matrix": root @ root.T, "places": rng.permutation(nv),
        "ends": np.sort(rng.uniform(-1, 1, (nv, 2))), "near": rng.uniform(0.1, 1, nv),
        "above": rng.integers(0, 2, (bodies, nv)).astype(float), "roots": np.arange(bodies),
        "damping": rng.random(nv), "qpos": rng.uniform(-1, 1, nv), "qvel": rng.random(nv),
        "subtree_com": rng.random((bodies, 3)), "cvel": rng.random((bodies, 6)),
        "cdof_dot": rng.random((nv, 6)),
    }  # fmt: skip


@pytest.mark.parametrize("seed", range(20))
def test_motors_move_inertia_by_energy(seed):
    """Half of rates times inertia times rates, whatever the rates: energy is no matter of axes."""
    rng = np.random.default_rng(seed)
    nv, n = 8, 4
    given = simulated(rng, 3, nv)
    given["ends"][0] = -np.inf, np.inf
    dofs = np.sort(rng.permutation(nv)[:6])
    driven = rng.standard_normal((6, n)) * (rng.random((6, n)) < 0.5)
    driven[:, 1] = 0.0
    by_rate, time = rng.random(n), 0.01
    inertia, metric = core.RobotMotion(**given).inertia(dofs, driven, time, by_rate)
    for _ in range(5):
        rates = rng.standard_normal(n)
        joints = np.zeros(nv)
        joints[dofs] = driven @ rates
        of_dampers = time * (given["damping"] @ joints**2)
        of_motors = time * (by_rate @ np.where(driven.any(axis=0), rates, 0.0) ** 2)
        energy = joints @ given["mass_matrix"] @ joints + of_dampers + of_motors
        assert rates @ inertia @ rates == pytest.approx(energy, rel=1e-12, abs=1e-12)
        more = 0.0
        for dof in dofs:
            at = given["qpos"][given["places"][dof]]
            low, high = given["ends"][dof]
            left = min(at - low, high - at) / given["near"][dof]
            heavier = 1 / min(max(left, 1e-3), 1) ** 2 - 1
            more += heavier * given["mass_matrix"][dof, dof] * joints[dof] ** 2
        assert rates @ metric @ rates == pytest.approx(energy + more, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_contacts_on_one_body_with_the_object_have_nothing_to_follow(seed):
    """A link that moves just as the object does: no joint has to accelerate."""
    rng = np.random.default_rng(seed)
    given = simulated(rng, 2, 3)
    spin, velocity, angular, linear = rng.standard_normal((4, 3))
    given["cvel"][1] = [*spin, *velocity]
    # One degree of freedom carries all of the link's acceleration by rates.
    given["above"][:] = [[0, 0, 0], [1, 0, 0]]
    given["qvel"][0] = 2.0
    centre, position = given["subtree_com"][1], rng.standard_normal(3)
    arm = centre - position
    at_centre = linear + np.cross(angular, arm) + np.cross(spin, np.cross(spin, arm))
    given["cdof_dot"][0] = np.array([*angular, *(at_centre - np.cross(spin, velocity))]) / 2
    points, axes = rng.standard_normal((3, 3)), np.array([rotation(rng) for _ in range(3)])
    found = core.RobotMotion(**given).follow(
        points, axes, np.array([1, 3, 4]), np.array([1, 1, 1]), position, spin,
        np.concatenate((linear, angular)),
    )  # fmt: skip
    assert_allclose(found, 0, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_motions_that_drives_and_couplings_determine_are_the_inverses(seed):
    rng = np.random.default_rng(seed)
    n, p = rng.integers(1, 6), rng.integers(0, 4)
    drives, couplings = rng.standard_normal((n, n + p)), rng.standard_normal((p, n + p))
    inverse = np.linalg.inv(np.vstack((couplings, drives)))
    found = core.determined_motions(drives, couplings)
    assert_allclose(found, inverse[:, p:], rtol=1e-9, atol=1e-9 * np.abs(inverse).max())
    assert core.determined_motions(drives[:-1], couplings) is None
    if n > 1:
        again = np.vstack((drives[:-1], drives[0]))  # two drives of one motion
        assert core.determined_motions(again, couplings) is None
        nearly = np.vstack((drives[:-1], drives[0] + 1e-6 * drives[-1]))
        assert _determined(nearly, couplings) is None
        assert _determined(drives, couplings) is not None


@pytest.mark.parametrize("seed", range(20))
def test_a_span_has_the_rank_and_the_projector_of_the_singular_values(seed):
    rng = np.random.default_rng(seed)
    m, k, rank = rng.integers(1, 9), rng.integers(1, 7), rng.integers(0, 5)
    shares = 10.0 ** -rng.uniform(0, 4, rank)  # some of it short
    rows = rng.standard_normal((m, rank)) * shares @ rng.standard_normal((rank, k))
    rows += 1e-12 * rng.standard_normal((m, k))
    _, sizes, right = np.linalg.svd(rows)
    count = int((sizes > 1e-8).sum())
    basis = core.span(rows, 1e-8)
    assert basis.shape == (count, k)
    assert_allclose(basis @ basis.T, np.eye(count), atol=1e-14)
    assert_allclose(basis.T @ basis, right[:count].T @ right[:count], atol=1e-6)


def test_loops_rows_and_gaps_are_those_of_the_joints():
    """Two joints that follow, beside a loop of which one row is play."""
    turns = np.array([True, True, True, False, False])
    follows = np.array([[0, 0, 0, 1.0, -2.0]])
    loop = np.array([[0.1, -0.1, 0, 0, 0], [0, 0.1, 0.1, 0, 0], [1e-5, 0, 1e-5, 0, 0]])
    rows, share = core.linkage_rows(
        turns, [1, 0], [3, 1], np.vstack((loop, follows)), np.array([3e-4, 0, 4e-4, 0.7])
    )
    assert share == pytest.approx(5e-4 / 0.1)
    assert len(rows) == 3
    (_, _, _, *slides) = rows[np.abs(rows[:, 3]) > 0].ravel()
    assert_allclose(slides, follows[0, 3:])
    assert_allclose(rows @ [1, 1, -1, 0, 0], 0, atol=1e-12)  # what the loop leaves
    with pytest.raises(ValueError, match="as many rows as the couplings have"):
        core.linkage_rows(turns, [1], [4], loop, np.zeros(3))


def test_ends_are_reached_at_them_and_beyond():
    values, places = np.array([0.0, 5.0, -1.0]), np.array([2, 0])
    low, high = np.array([-2.0, -1.0]), np.array([0.0, 1.0])
    assert not core.any_at_end(values, places, low, high)
    assert core.any_at_end(values, places, np.array([-1.0, -1.0]), high)
    assert core.any_at_end(values, places, low, np.array([0.0, 0.0]))
    assert not core.any_at_end(values, places[:0], low[:0], high[:0])


def test_arrays_of_other_shapes_are_refused():
    rng = np.random.default_rng(0)
    given = simulated(rng, 3, 4)
    with pytest.raises(ValueError, match="expected a plain array"):
        core.RobotMotion(**given | {"near": np.ones(5)})
    with pytest.raises(ValueError, match="expected a plain array"):
        core.nearest_motion(np.eye(3), np.ones((2, 3)), np.ones(2), np.ones(3), 1.0, np.ones(3))
    motion = core.RobotMotion(**given)
    with pytest.raises(IndexError, match="no such body"):
        motion.follow(
            np.zeros((1, 3)), np.eye(3)[None], np.array([3]), np.array([3]), np.zeros(3),
            np.zeros(3), np.zeros(6),
        )  # fmt: skip
