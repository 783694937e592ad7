"""Problems whose exact optimum is known beforehand (how, says ``grasps.plant``)."""

import numpy as np
import pytest
from grasps import KINDS, cone_gradient, plant

import graspforce as gf

ACCURACY = 1e-7  # of the largest force


def draw(rng):
    """One of the many sorts of planted problem: 3 to 8 contacts, alpha .1 to 100."""
    n = int(rng.integers(3, 9))
    kinds = [str(kind) for kind in rng.choice(KINDS, n)]
    return plant(
        rng,
        kinds,
        alpha=10 ** rng.uniform(-1, 2),
        shared=rng.random() < 0.4,
        spare=int(rng.integers(0, 3)),
        ceilings=rng.random() < 0.4,
        floors=rng.random() < 0.3,
        inequalities=int(rng.integers(0, 3)),
        bias=rng.random() < 0.3,
        rates=rng.random() < 0.3,
        hand=rng.random() < 0.85,
        removed=int(rng.integers(n)) if rng.random() < 0.15 else None,
    )


def check(planted, settings):
    """The optimum, its multipliers, its status and its own account of itself."""
    problem, c = planted.problem, planted.c
    solution = gf.solve(problem, settings)
    assert solution.status is gf.Status.SOLVED
    assert np.abs(solution.c - c).max() <= ACCURACY * np.abs(c).max()
    assert solution.verify().ok
    assert 0 <= solution.suboptimality < 1e-6
    assert solution.violation == 0
    assert solution.certificate is None
    kept = np.repeat(problem.active, [model.dim for model in problem.models])
    pull = problem.W[:, kept].T @ planted.nu
    slack = 1e-5 * max(np.abs(pull).max(), np.abs(cone_gradient(c[kept], present(problem))).max())
    assert np.abs(problem.W[:, kept].T @ solution.nu - pull).max() <= slack
    if planted.nu_is_unique:
        assert solution.nu == pytest.approx(planted.nu, abs=1e-5 * np.abs(planted.nu).max())


def present(problem):
    return [m for m, here in zip(problem.models, problem.active, strict=True) if here]


@pytest.mark.parametrize(("backend", "count"), [("reference", 40), ("native", 500)])
def test_planted_optima(backend, count):
    rng = np.random.default_rng(1)
    for _ in range(count):
        check(draw(rng), gf.Settings(tol=1e-14, backend=backend))


def test_the_planting_is_right(rng):
    """∇Phi = W.T nu at c*, from the formulas, without any solver."""
    for _ in range(20):
        planted = draw(rng)
        problem = planted.problem
        A, b = problem.linear_limits()
        kept = np.repeat(problem.active, [model.dim for model in problem.models])
        gradient = cone_gradient(planted.c[kept], present(problem))
        gradient += problem.alpha * A[:, kept].T @ (1 / (b - A @ planted.c))
        wanted = problem.W[:, kept].T @ planted.nu
        size = problem.alpha * np.abs(A[:, kept].T) @ (1 / (b - A @ planted.c))
        assert np.abs(gradient - wanted).max() <= 1e-11 * size.max()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [3, 8])
@pytest.mark.parametrize("alpha", [0.1, 1.0, 100.0])
def test_one_contact_model_throughout(rng, exact, kind, n, alpha):
    check(plant(rng, [kind] * n, alpha=alpha), exact)


@pytest.mark.parametrize(
    "sort",
    [
        {"shared": True, "spare": 2},
        {"spare": 1},
        {"ceilings": True},
        {"floors": True},
        {"ceilings": True, "floors": True},
        {"inequalities": 2},
        {"bias": True},
        {"hand": False},
        {"removed": 1},
        {"removed": 0, "shared": True, "floors": True, "inequalities": 1, "bias": True},
    ],
    ids=str,
)
@pytest.mark.parametrize("seed", range(3))
def test_every_sort_of_limit_by_itself(exact, sort, seed):
    check(plant(np.random.default_rng(seed), ["PCWF", "SFC", "FPC", "PCWF"], 2.0, **sort), exact)


@pytest.mark.parametrize("rows", [1, 2, 3, 7, 9])
def test_grasp_maps_of_another_number_of_rows(rng, exact, rows):
    """3 in the plane; more than 6 with a second body or a passive joint."""
    for _ in range(3):
        W = rng.normal(size=(rows, 3 * 4)) * np.where(np.arange(rows) < 3, 1, 0.04)[:, None]
        check(plant(rng, ["PCWF"] * 4, W=W), exact)


def test_more_rows_than_freedom(rng, exact):
    """Three frictionless contacts, six rows: W c = f alone fixes c."""
    planted = plant(rng, ["FPC"] * 3)
    assert np.linalg.matrix_rank(planted.problem.W) == 3
    check(planted, exact)


@pytest.mark.parametrize("alpha", [1e-4, 1e4, 1e6])
def test_alpha_far_from_one(rng, exact, alpha):
    check(plant(rng, ["PCWF"] * 4, alpha=alpha), exact)


@pytest.mark.parametrize(("backend", "n"), [("reference", 16), ("native", 16), ("native", 40)])
def test_many_contacts(rng, backend, n):
    check(plant(rng, ["PCWF", "SFC"] * (n // 2)), gf.Settings(tol=1e-14, backend=backend))


@pytest.mark.parametrize(("backend", "count"), [("reference", 15), ("native", 300)])
def test_a_ring_of_fingers_that_carries_nothing(backend, count):
    """Closed form: each presses with 2 c_max/(2 + alpha), and no tangential force at all.

    −2 ln n − alpha ln(c_max − n) is least there. Full symmetry and zeros everywhere: where
    differences vanish exactly and a rounding error has no company.
    """
    rng = np.random.default_rng(8)
    for _ in range(count):
        n, mu = 2 * int(rng.integers(1, 5)), rng.uniform(0.1, 1.5)
        model = [gf.PCWF(mu), gf.SFC(mu, 0.01)][int(rng.integers(2))]
        alpha, c_max = 10 ** rng.uniform(-2, 4), 10 ** rng.uniform(-2, 3)
        angles = np.arange(n) * 2 * np.pi / n
        around = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(n)))
        grasp = gf.Grasp([gf.Contact(0.03 * p, -p, model) for p in around])
        problem = grasp.problem(np.zeros(6), c_max=c_max, alpha=alpha)
        solution = gf.solve(problem, gf.Settings(tol=1e-14, backend=backend))
        assert solution.status is gf.Status.SOLVED
        push = 2 * c_max / (2 + alpha)
        assert solution.normal_forces == pytest.approx(np.full(n, push), rel=1e-6)
        assert np.delete(solution.c, problem.starts[:-1]) == pytest.approx(0, abs=1e-6 * push)
        assert solution.verify().ok


def test_phi_is_least_at_the_answer(rng, default):
    """Every step in the null space of W makes Phi larger: what `optimum` means."""
    planted = plant(rng, ["PCWF", "SFC", "PCWF"], ceilings=True)
    problem = planted.problem
    solution = gf.solve(problem, default)
    N = np.linalg.svd(problem.W)[2][np.linalg.matrix_rank(problem.W) :].T
    for _ in range(50):
        step = 1e-3 * N @ rng.normal(size=N.shape[1])
        moved = gf.reference.objective(solution.c + step, problem)
        assert moved > solution.phi - solution.suboptimality
