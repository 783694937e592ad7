"""Payloads, the ball of wrenches and the classical measures, by other solvers and closed forms."""

import numpy as np
import pytest
from clarabel_oracle import critical_load, most_along, random_problem
from conftest import ALLEGRO
from scipy.spatial import ConvexHull

import graspforce as gf

payload = gf.payload


def feasible(count, seed=0):
    rng = np.random.default_rng(seed)
    found = [p for _, p in gf.files.read(ALLEGRO) if gf.solve(p).status is gf.Status.SOLVED][:4]
    while len(found) < count + 4:
        problem = random_problem(rng)
        if gf.solve(problem).status is gf.Status.SOLVED:
            found.append(problem)
    return found


# ---- along a direction -------------------------------------------------------------------------


@pytest.mark.parametrize("problem", feasible(12), ids=str)
def test_the_interval_holds_clarabels_load(problem):
    found = payload.along(problem, problem.f)
    assert 0 < found.upper - found.lower <= 1e-4 * found.lower
    most = critical_load(problem) - 1
    assert found.lower <= most * (1 + 1e-7)
    assert most <= found.upper * (1 + 1e-7)
    assert found.solution.verify().ok
    assert found.solution.problem == problem.replace(f=problem.f - (-found.lower) * problem.f)
    above = problem.replace(f=problem.f + found.upper * (1 + 1e-8) * problem.f)
    assert gf.check_certificate(above, found.certificate)


def test_a_load_that_is_not_held_has_no_payload():
    problem = feasible(0)[0]
    found = payload.along(problem.replace(f=100 * problem.f), problem.f)
    assert found.lower == found.upper == -np.inf
    assert found.solution.status is gf.Status.INFEASIBLE


@pytest.mark.parametrize(
    ("direction", "most"),
    [
        ((0, 0, 1, 0, 0, 0), 40.0),
        ((0.4, 0, 1, 0, 0, 0), 40.0),
        ((0, 0, -1, 0, 0, 0), 0.0),
        ((1, 0, 0, 0, 0, 0), 0.0),
        ((0.6, 0, 1, 0, 0, 0), 0.0),
    ],
)
def test_from_the_edge_a_load_grows_inwards_alone(direction, most):
    """A plate on four feet that press with up to 10 N: nothing is held at the tip of its cone."""
    feet = [(0.05, 0.05, 0), (-0.05, 0.05, 0), (-0.05, -0.05, 0), (0.05, -0.05, 0)]
    plate = gf.Grasp([gf.Contact(foot, (0, 0, 1), gf.PCWF(0.5)) for foot in feet])
    found = payload.along(plate.problem(np.zeros(6), c_max=10), direction)
    assert gf.solve(plate.problem(np.zeros(6), c_max=10)).status is gf.Status.ON_EDGE
    assert 0 <= found.lower <= most <= found.upper + 1e-9
    assert found.upper - found.lower <= 1e-4 * most + 1e-9
    assert (found.solution.status is gf.Status.SOLVED) == (most > 0)


def test_nothing_is_added_out_of_reach():
    contacts = [gf.Contact((s * 0.1, 0, 0), (-s, 0, 0), gf.PCWF(0.5)) for s in (1, -1)]
    pinch = gf.Grasp(contacts).problem([0, 0, 1, 0, 0, 0], c_max=10)
    found = payload.along(pinch, [0, 0, 0, 1, 0, 0])
    assert found.lower == found.upper == 0
    assert payload.along(pinch, [0, 0, 1, 0, 0, 0]).lower == pytest.approx(9, rel=1e-4)
    assert payload.ball(pinch).upper == 0


def test_what_nothing_limits_has_no_end():
    problem = feasible(0)[0].replace(J=None, tau_lo=None, tau_hi=None)
    assert payload.along(problem, problem.f).upper == np.inf


def test_wrong_arguments_are_refused():
    problem = feasible(0)[0]
    with pytest.raises(gf.InvalidInputError, match="direction: got zeros only"):
        payload.along(problem, np.zeros(6))
    with pytest.raises(gf.InvalidInputError, match="direction: got shape"):
        payload.along(problem, [1, 2])
    with pytest.raises(gf.InvalidInputError, match="rtol: got 2"):
        payload.along(problem, problem.f, rtol=2)
    with pytest.raises(gf.InvalidInputError, match="length: got 0"):
        payload.ball(problem, length=0)
    with pytest.raises(gf.InvalidInputError, match="problem: got"):
        payload.ball(None)
    with pytest.raises(gf.InvalidInputError, match="grasp: got"):
        payload.classic(problem)
    with pytest.raises(gf.InvalidInputError, match="W: got 2 rows"):
        payload.ball(gf.ForceProblem(np.eye(2, 3), [0, 0], gf.PCWF(1), c_max=1))


# ---- the ball ----------------------------------------------------------------------------------


@pytest.mark.parametrize("problem", feasible(4), ids=str)
def test_the_ball_is_enclosed_and_its_wrenches_can_be_made(problem, rng):
    found = payload.ball(problem)
    assert 0 < found.lower >= 0.99 * found.upper
    sizes = np.array([1, 1, 1, *[found.length] * 3])
    for _ in range(300):
        u = rng.normal(size=6)
        u *= found.lower / np.linalg.norm(u)
        assert gf.solve(problem.replace(f=problem.f + sizes * u)).status is gf.Status.SOLVED
    assert np.linalg.norm(found.weakest / sizes) == pytest.approx(1)
    beyond = problem.f + 1.02 * found.upper * found.weakest
    assert gf.solve(problem.replace(f=beyond)).status is gf.Status.INFEASIBLE
    # By Clarabel no wrench goes farther than this along the weakest direction.
    across = found.weakest / sizes**2
    reach = most_along(problem, across) - across @ problem.f
    assert found.lower <= reach * (1 + 1e-6)
    assert reach <= found.upper * (1 + 1e-6)
    for wrench, c in zip(found.wrenches, found.forces, strict=True):
        assert np.abs(problem.W @ c - wrench).max() < 1e-9 * np.abs(found.wrenches).max()
        assert gf.equations.strictly_inside(c, problem.barriers)


def test_the_ball_lies_within_a_polytope_of_many_facets(rng):
    """By Clarabel's planes in random directions, near the weakest one and far: none may cut it."""
    problem = feasible(0)[1]
    found = payload.ball(problem)
    sizes = np.array([1, 1, 1, *[found.length] * 3])
    u = rng.normal(size=(512, 6)) * np.geomspace(1e-3, 1e3, 512)[:, None] + found.weakest / sizes
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    reach = [most_along(problem, across) - across @ problem.f for across in u / sizes]
    assert found.lower <= min(reach) * (1 + 1e-6)
    assert min(reach) < 1.05 * found.upper  # it is no small ball in a large polytope


def test_the_ball_of_a_load_that_is_not_held_is_none():
    problem = feasible(0)[0]
    assert payload.ball(problem.replace(f=100 * problem.f)).upper == 0


def test_the_ball_in_the_plane():
    """Four frictionless pushes on a square plate: 2 N each way, torque by the pairs."""
    points = [
        (1, 0.5),
        (1, -0.5),
        (-1, 0.5),
        (-1, -0.5),
        (0.5, 1),
        (-0.5, 1),
        (0.5, -1),
        (-0.5, -1),
    ]
    W = np.array([
        [-np.sign(x) if abs(x) == 1 else 0, -np.sign(y) if abs(y) == 1 else 0,
         (y * np.sign(x) if abs(x) == 1 else -x * np.sign(y))] for x, y in points
    ]).T  # fmt: skip
    found = payload.ball(gf.ForceProblem(W, np.zeros(3), gf.FPC(), c_max=1), length=1)
    hull = ConvexHull([W @ c for c in np.array(np.meshgrid(*[[0, 1]] * 8)).reshape(8, -1).T])
    exact = -hull.equations[:, -1].max()
    assert found.lower <= exact * (1 + 1e-9)
    assert exact <= found.upper * (1 + 1e-9)
    assert found.lower >= 0.99 * found.upper


# ---- classical measures ------------------------------------------------------------------------


def test_the_classical_measures_of_a_pinch_with_soft_fingers():
    """Torsion is the weakest: with g = gamma/length, g by L1 and 2 g/sqrt(1 + g²) by L∞."""
    contacts = [gf.Contact((s * 0.04, 0, 0), (-s, 0, 0), gf.SFC(0.5, 0.005)) for s in (1, -1)]
    found = payload.classic(gf.Grasp(contacts), length=0.04, rtol=1e-3)
    g = 0.005 / 0.04
    for (lower, upper), exact in (
        (found.epsilon_l1, g), (found.epsilon_linf, 2 * g / np.hypot(1, g))
    ):  # fmt: skip
        assert lower <= exact * (1 + 1e-9)
        assert exact <= upper * (1 + 1e-9)
        assert upper <= lower * 1.0011
    assert found.volume > 0
    assert found.length == 0.04


def test_epsilon_against_a_hull_of_fine_pyramids():
    rng = np.random.default_rng(5)
    points = rng.normal(size=(5, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    grasp = gf.Grasp([gf.Contact(0.04 * p, -p, gf.PCWF(0.6)) for p in points])
    found = payload.classic(grasp, length=0.04)
    around = 2 * np.pi * np.arange(64) / 64
    edges = np.column_stack((np.ones(64), 0.6 * np.cos(around), 0.6 * np.sin(around)))
    scaling = np.array([1, 1, 1, 25, 25, 25])[:, None]
    W = scaling * grasp.W
    corners = np.concatenate([edges @ W[:, 3 * i : 3 * i + 3].T for i in range(5)])
    hull = ConvexHull(np.vstack((np.zeros(6), corners)))
    inner = max(-hull.equations[:, -1].max(), 0)
    lower, upper = found.epsilon_l1
    assert inner * (1 - 1e-9) <= upper
    assert lower <= inner / np.cos(np.pi / 64) + 1e-9
    assert found.volume <= hull.volume
    assert found.volume > 0.9 * hull.volume
    assert found.smallest_singular_value == pytest.approx(np.linalg.svd(W)[1][-1])
    assert found.epsilon_linf[0] >= lower


def test_grasps_that_do_not_reach_every_wrench_have_no_epsilon():
    contacts = [gf.Contact((s * 0.1, 0, 0), (-s, 0, 0), gf.PCWF(0.5)) for s in (1, -1)]
    found = payload.classic(gf.Grasp(contacts))
    assert found.epsilon_l1 == found.epsilon_linf == (0, 0)
    assert found.smallest_singular_value == pytest.approx(0, abs=1e-12)
