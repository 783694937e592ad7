"""Verdicts against another solver, and proofs against everything that could fool them.

Clarabel solves the same question as a second-order cone program: the least sigma that relaxes
every limit by sigma of its scale. SOLVED iff it is negative, INFEASIBLE iff positive.
"""

import clarabel
import numpy as np
import pytest
from grasps import (
    KINDS,
    components,
    cone_matrix,
    finger_jacobian,
    plant,
    random_contacts,
    random_fingers,
    random_model,
)
from scipy import sparse

import graspforce as gf

# ---- the other solver --------------------------------------------------------------------------


def socp(q, equalities, inequalities, cones):
    """Minimise q·x with E x = e, G x ≤ h, M x + v in Lorentz cones; return status, value, x."""
    (E, e), (G, h) = equalities, inequalities
    A = np.vstack((E, G, *[-M for M, _ in cones]))
    b = np.concatenate((e, h, *[v for _, v in cones]))
    kinds = [clarabel.ZeroConeT(len(e)), clarabel.NonnegativeConeT(len(h))]
    kinds += [clarabel.SecondOrderConeT(len(v)) for _, v in cones]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    settings.max_threads = 1
    nothing = sparse.csc_array((len(q), len(q)))
    answer = clarabel.DefaultSolver(nothing, q, sparse.csc_array(A), b, kinds, settings).solve()
    return str(answer.status), answer.obj_val, np.array(answer.x)


def limits_by_hand(problem):
    """Rows A c ≤ b and what one unit of relative violation of each means, and each cone's unit.

    From the words of reference.violation_scales: a contact's reach is the normal force that
    alone would use up the tightest range among its joints' torques and its ceiling.
    """
    models, m = problem.models, problem.m
    parts = components(models)
    reach = []
    for i, part in enumerate(parts):
        lever = np.abs(problem.J[part.start])
        ranges = problem.tau_hi - problem.tau_lo
        candidates = [r / a for r, a in zip(ranges, lever, strict=True) if a > 0]
        if problem.c_max.size:
            candidates.append(problem.engagement[i] * problem.c_max[i])
        reach.append(min(candidates))
    rows, bounds, scales = [], [], []
    for j in range(problem.J.shape[1]):
        half = (problem.tau_hi[j] - problem.tau_lo[j]) / 2
        rows += [problem.J[:, j], -problem.J[:, j]]
        bounds += [problem.tau_hi[j] - problem.tau_bias[j], problem.tau_bias[j] - problem.tau_lo[j]]
        scales += [half, half]
    for i, part in enumerate(parts):
        if problem.c_max.size:
            rows.append(np.eye(m)[part.start])
            bounds.append(problem.engagement[i] * problem.c_max[i])
            scales.append(reach[i])
        if problem.c_min.size:
            rows.append(-np.eye(m)[part.start])
            bounds.append(-problem.engagement[i] * problem.c_min[i])
            scales.append(reach[i])
    each = np.repeat(reach, [model.dim for model in models])
    for a, b in zip(problem.A, problem.b, strict=True):
        rows.append(a)
        bounds.append(b)
        scales.append(np.abs(a) @ each)
    cone_scales = [getattr(x, "mu", 1.0) * r for x, r in zip(models, reach, strict=True)]
    return np.array(rows), np.array(bounds), np.array(scales), cone_scales


def least_violation(problem):
    """Least sigma such that c exists with W c = f and every limit relaxed by sigma·scale."""
    A, b, scales, cone_scales = limits_by_hand(problem)
    m = problem.m
    cones = []
    parts = components(problem.models)
    for model, part, scale in zip(problem.models, parts, cone_scales, strict=True):
        M = np.zeros((model.dim, m + 1))
        M[:, part] = cone_matrix(model)
        M[0, m] = scale
        cones.append((M, np.zeros(model.dim)))
    E = np.column_stack((problem.W, np.zeros(len(problem.f))))
    status, sigma, _ = socp(
        np.eye(m + 1)[m], (E, problem.f), (np.column_stack((A, -scales)), b), cones
    )
    assert status in ("Solved", "AlmostSolved"), status
    return sigma


def most_along(problem, y):
    """The largest y·W c over all c in the cones and limits: the support of what is possible."""
    A, b, _, _ = limits_by_hand(problem)
    parts = components(problem.models)
    cones = []
    for model, part in zip(problem.models, parts, strict=True):
        M = np.zeros((model.dim, problem.m))
        M[:, part] = cone_matrix(model)
        cones.append((M, np.zeros(model.dim)))
    none = (np.empty((0, problem.m)), np.empty(0))
    status, value, _ = socp(-(problem.W.T @ y), none, (A, b), cones)
    assert status in ("Solved", "AlmostSolved"), status
    return -value


def critical_load(problem):
    """The largest k for which the wrench k·f is possible."""
    A, b, _, _ = limits_by_hand(problem)
    m = problem.m
    parts = components(problem.models)
    cones = []
    for model, part in zip(problem.models, parts, strict=True):
        M = np.zeros((model.dim, m + 1))
        M[:, part] = cone_matrix(model)
        cones.append((M, np.zeros(model.dim)))
    E = np.column_stack((problem.W, -problem.f))
    status, value, _ = socp(
        -np.eye(m + 1)[m], (E, np.zeros(len(problem.f))), (np.pad(A, ((0, 0), (0, 1))), b), cones
    )
    assert status == "Solved", status
    return -value


# ---- random grasps, about half of which can do it ------------------------------------------------


def random_problem(rng):
    n = int(rng.integers(3, 7))
    kinds = rng.choice(KINDS[1:], n) if rng.random() < 0.7 else rng.choice(KINDS, n)
    models = [random_model(rng, str(kind)) for kind in kinds]
    contacts = random_contacts(rng, models)
    W = gf.grasp_map(contacts)
    if np.linalg.matrix_rank(W) < 6:  # out of reach is another verdict
        return random_problem(rng)
    J = finger_jacobian(
        rng,
        [model.dim for model in models],
        random_fingers(rng, n, rng.random() < 0.3),
        int(rng.integers(0, 2)),
    )
    strength = rng.uniform(0.2, 0.8, J.shape[1])
    options = {"J": J, "tau_lo": -strength, "tau_hi": strength * rng.uniform(0.5, 1.5)}
    if rng.random() < 0.3:
        options["tau_bias"] = 0.5 * strength * rng.uniform(-1, 1, len(strength))
    if rng.random() < 0.4:
        options |= {"c_max": rng.uniform(3, 12, n), "engagement": rng.uniform(0.3, 1, n)}
    if rng.random() < 0.2:
        options["c_min"] = rng.uniform(0.05, 0.6, n)
    if rng.random() < 0.2:
        options |= {"A": rng.normal(size=(2, W.shape[1])), "b": rng.uniform(-1, 10, 2)}
    direction = rng.normal(size=6) * [1, 1, 1, 0.02, 0.02, 0.02]
    f = np.exp(rng.uniform(0, 4)) * direction
    return gf.ForceProblem(W, f, models, alpha=10 ** rng.uniform(-1, 2), **options)


@pytest.mark.parametrize(("backend", "count"), [("reference", 25), ("native", 200)])
def test_verdicts_agree_with_clarabel(backend, count):
    rng = np.random.default_rng(3)
    settings = gf.Settings(backend=backend)
    feasible = infeasible = undecided = 0
    for _ in range(count):
        problem = random_problem(rng)
        sigma = least_violation(problem)
        if abs(sigma) < 1e-6:
            undecided += 1
            continue
        solution = gf.solve(problem, settings)
        if sigma < 0:
            feasible += 1
            assert solution.status is gf.Status.SOLVED
            assert solution.violation == 0
            assert solution.certificate is None
        else:
            infeasible += 1
            assert solution.status is gf.Status.INFEASIBLE
            assert solution.violation == pytest.approx(sigma, rel=1e-5, abs=1e-8)
            assert gf.check_certificate(problem, solution.certificate)
            assert solution.certificate.proves_infeasible(problem)
        assert solution.verify().ok
    assert undecided <= count // 50
    assert min(feasible, infeasible) >= count // 4


@pytest.mark.parametrize(("backend", "count"), [("reference", 2), ("native", 15)])
@pytest.mark.parametrize("margin", [1e-2, 1e-3, 1e-4])
def test_verdicts_beside_the_critical_load(backend, count, margin):
    rng = np.random.default_rng(4)
    settings = gf.Settings(backend=backend)
    for _ in range(count):
        planted = plant(rng, ["PCWF", "SFC", "PCWF", "PCWF"], alpha=1.0)
        limit = critical_load(planted.problem)
        assert limit > 1
        for side, status in ((-1, gf.Status.SOLVED), (1, gf.Status.INFEASIBLE)):
            load = (1 + side * margin) * limit
            solution = gf.solve(planted.problem.replace(f=load * planted.problem.f), settings)
            assert solution.status is status
            assert solution.verify().ok


# ---- the least-violation force ------------------------------------------------------------------


def violation_of(problem, c):
    """The relative violation of c, by hand."""
    A, b, scales, cone_scales = limits_by_hand(problem)
    rows = ((A @ c - b) / scales).max()
    parts = components(problem.models)
    slips = []
    for model, part, scale in zip(problem.models, parts, cone_scales, strict=True):
        y = cone_matrix(model) @ c[part]
        slips.append((np.linalg.norm(y[1:]) - y[0]) / scale)
    return max(rows, *slips)


@pytest.fixture
def overloaded(rng, default):
    problem = plant(rng, ["PCWF", "SFC", "PCWF", "FPC"], ceilings=True).problem
    return gf.solve(problem.replace(f=30 * problem.f), default)


def test_the_force_of_an_infeasible_grasp_violates_least(overloaded):
    problem, c = overloaded.problem, overloaded.c
    assert overloaded.status is gf.Status.INFEASIBLE
    assert overloaded.wrench_error <= 1e-9 * (np.abs(problem.W) @ np.abs(c)).max()
    assert violation_of(problem, c) == pytest.approx(overloaded.violation, rel=1e-4)
    assert overloaded.violation == pytest.approx(least_violation(problem), rel=1e-5)


# ---- certificates ------------------------------------------------------------------------------


@pytest.mark.parametrize(("backend", "count"), [("reference", 3), ("native", 20)])
def test_the_certificate_is_right_whoever_computes_it(backend, count):
    """sup {y·W c} over cones and limits, by Clarabel, lies below y·f and below z·b."""
    rng = np.random.default_rng(5)
    seen = 0
    while seen < count:
        problem = random_problem(rng)
        solution = gf.solve(problem, gf.Settings(backend=backend))
        if solution.status is not gf.Status.INFEASIBLE:
            continue
        seen += 1
        certificate = solution.certificate
        most = most_along(problem, certificate.y)
        assert certificate.y @ problem.f > most - 1e-7 * abs(most)
        assert most <= certificate.z @ problem.linear_limits()[1] + 1e-7
        assert certificate.excess(problem) == pytest.approx(
            certificate.y @ problem.f - certificate.z @ problem.linear_limits()[1]
        )
        assert (certificate.z >= 0).all()


@pytest.fixture
def proof(overloaded):
    return overloaded.problem, overloaded.certificate


def test_a_certificate_may_be_scaled(proof):
    problem, good = proof
    for k in (1e-6, 1.0, 1e6):
        assert gf.check_certificate(problem, gf.Certificate(k * good.y, k * good.z))


def test_tampered_certificates_are_refused(proof, rng):
    problem, good = proof
    negative = good.z.copy()
    negative[int(np.argmin(good.z))] = -1e-6 * good.z.max()
    tampered = {
        "y turned round": gf.Certificate(-good.y, good.z),
        "z turned round": gf.Certificate(good.y, -good.z),
        "no y": gf.Certificate(0 * good.y, good.z),
        "no z": gf.Certificate(good.y, 0 * good.z),
        "nothing": gf.Certificate(0 * good.y, 0 * good.z),
        "too much y": gf.Certificate(1e6 * good.y, good.z),
        "too little z": gf.Certificate(good.y, good.z / 1e6),
        "one multiplier negative": gf.Certificate(good.y, negative),
        "z in another order": gf.Certificate(good.y, good.z[::-1]),
        "y in another order": gf.Certificate(good.y[::-1], good.z),
        "no number in y": gf.Certificate(good.y * np.nan, good.z),
        "no number in z": gf.Certificate(good.y, good.z * np.nan),
        "noise": gf.Certificate(rng.normal(size=6), rng.uniform(size=len(good.z))),
    }
    assert gf.check_certificate(problem, good)
    for how, certificate in tampered.items():
        assert not gf.check_certificate(problem, certificate), how


def how_far_it_holds(problem, certificate):
    """The least of all that a proof needs to be positive, relative to the terms it is made of."""
    A, b, _, _ = limits_by_hand(problem)
    y, z = certificate.y, certificate.z
    # limits_by_hand takes joint by joint and contact by contact: sort z to its order.
    rows, bounds = problem.linear_limits()
    order = [
        next(k for k in range(len(b)) if np.array_equal(rows[k], A[i]) and bounds[k] == b[i])
        for i in range(len(b))
    ]
    z = z[order]
    e = A.T @ z - problem.W.T @ y
    size = (np.abs(A.T) @ np.abs(z) + np.abs(problem.W.T) @ np.abs(y)).max()
    gap = (y @ problem.f - z @ b) / (np.abs(y) @ np.abs(problem.f) + np.abs(z) @ np.abs(b))
    least = [gap, z.min() / np.abs(z).max()] if (z < 0).any() else [gap]
    for model, part in zip(problem.models, components(problem.models), strict=True):
        # e·c ≥ 0 for all c of the cone {L c in the Lorentz cone}: L⁻ᵀ e is in it too.
        dual = np.linalg.solve(cone_matrix(model), e[part])
        least.append((dual[0] - np.linalg.norm(dual[1:])) / size)
    return min(least)


@pytest.mark.parametrize("seed", range(4))
def test_mutated_certificates_are_judged_by_the_definition(seed, default):
    """Random changes large and small: accepted if and only if still a proof."""
    rng = np.random.default_rng(seed)
    problem = plant(rng, ["PCWF", "SFC", "FPC", "PCWF"], ceilings=True, floors=True).problem
    problem = problem.replace(f=8 * problem.f)
    good = gf.solve(problem, default).certificate
    verdicts = set()
    for size in np.geomspace(1e-6, 3, 100):
        y = good.y * np.exp(size * rng.normal(size=6))
        z = good.z * np.exp(size * rng.normal(size=len(good.z)))
        if rng.random() < 0.1:
            z[rng.integers(len(z))] *= -1
        mutant = gf.Certificate(y, z)
        margin = how_far_it_holds(problem, mutant)
        if abs(margin) > 1e-11:
            assert gf.check_certificate(problem, mutant) == (margin > 0)
            verdicts.add(margin > 0)
    assert verdicts == {True, False} or (verdicts == {False} and seed > 1)


def test_a_certificate_of_the_wrong_size_is_refused(proof):
    problem, good = proof
    for y, z in (
        (good.y[:5], good.z),
        (good.y, good.z[:-1]),
        (good.y, np.append(good.z, 1.0)),
        (good.y[None], good.z),
    ):
        with pytest.raises(gf.InvalidInputError, match=r"got .* expected"):
            gf.check_certificate(problem, gf.Certificate(y, z))


def test_a_certificate_proves_nothing_about_another_problem(proof, rng):
    problem, good = proof
    feasible = problem.replace(f=problem.f / 30)
    assert not gf.check_certificate(feasible, good)
    assert not gf.check_certificate(problem.replace(f=-problem.f), good)


@pytest.mark.parametrize("seed", range(5))
def test_no_certificate_survives_where_the_grasp_can_do_it(seed, default):
    """Shrink the load below the critical one: the proof must fail from there on."""
    planted = plant(np.random.default_rng(seed), ["PCWF"] * 4, alpha=1.0)
    problem = planted.problem
    limit = critical_load(problem)
    above = problem.replace(f=limit * 1.001 * problem.f)
    certificate = gf.solve(above, default).certificate
    assert gf.check_certificate(above, certificate)
    for load in (limit * (1 - 1e-9), limit * 0.999, 1.0):
        assert not gf.check_certificate(problem.replace(f=load * problem.f), certificate)


def test_certificates_are_values(proof):
    _, good = proof
    same = gf.Certificate(good.y.copy(), good.z.copy())
    assert good == same
    assert hash(good) == hash(same)
    assert good != gf.Certificate(-good.y, good.z)
    assert good != "proof"


@pytest.mark.parametrize("removed", [0, 3])
def test_a_grasp_with_a_removed_contact_is_proved_infeasible_too(rng, default, removed):
    problem = plant(rng, ["PCWF"] * 5, removed=removed, shared=True, inequalities=1).problem
    solution = gf.solve(problem.replace(f=100 * problem.f), default)
    assert solution.status is gf.Status.INFEASIBLE
    assert solution.certificate.z.shape == solution.problem.linear_limits()[1].shape
    assert solution.verify().ok
    assert not solution.c[problem.starts[removed] :][:3].any()


def test_rows_alone_can_be_infeasible(default):
    """A clamp that must push with 2 N and may with 1 N, as proved by hand with y = 0."""
    problem = gf.ForceProblem(
        [[1.0, -1.0]], [0.0], gf.FPC(), A=[[1.0, 0.0], [-1.0, 0.0]], b=[1.0, -2.0], c_max=9.0
    )
    solution = gf.solve(problem, default)
    assert solution.status is gf.Status.INFEASIBLE
    assert solution.verify().ok
    by_hand = gf.Certificate(np.zeros(1), np.array([1e-3, 1e-3, 1.0, 1.0]))
    assert gf.check_certificate(problem, by_hand)


@pytest.mark.parametrize("unit", [1.0, 1e-200])
def test_a_proof_has_no_unit(unit):
    """Multipliers as small as you like prove what large ones do, and no more."""
    W = np.zeros((6, 3))
    W[5, 1] = 1
    problem = gf.ForceProblem(W, np.zeros(6), gf.PCWF(0.5), c_max=1.0, A=np.zeros((1, 3)), b=[-1.0])
    z = np.array([0, unit])  # 0 <= -1 alone is the contradiction
    assert gf.check_certificate(problem, gf.Certificate(np.zeros(6), z))
    astray = np.array([0, 0, 0, 0, 0, unit])  # e is tangential: outside the dual cone
    assert not gf.check_certificate(problem, gf.Certificate(astray, z))


def test_numbers_that_overflow_prove_nothing():
    W = np.zeros((6, 3))
    W[[0, 1, 2], [0, 1, 2]] = 1e6
    problem = gf.ForceProblem(W, [1.0, 0.3, 0, 0, 0, 0], gf.PCWF(0.5), c_max=10)
    assert gf.solve(problem).status is gf.Status.SOLVED
    y = np.array([-1e303, 1e304, 0, 0, 0, 0])
    with np.errstate(all="ignore"):
        assert not gf.check_certificate(problem, gf.Certificate(y, np.zeros(1)))
