"""Verdicts against another solver, and proofs against everything that could fool them.

Clarabel solves the same question as a second-order cone program: the least sigma that relaxes
every limit by sigma of its scale. SOLVED iff it is negative, INFEASIBLE iff positive.
"""

import importlib
import math
from fractions import Fraction

import numpy as np
import pytest
from clarabel_oracle import (
    critical_load,
    least_violation,
    limits_by_hand,
    most_along,
    random_problem,
    violation_of,
)
from grasps import components, cone_matrix, plant

import graspforce as gf
from graspforce import _engine
from graspforce._engine import dispatch


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
            assert solution.violation == pytest.approx(sigma, rel=1e-6, abs=1e-9)
            assert gf.check_certificate(problem, solution.certificate)
            assert solution.certificate.proves_infeasible(problem)
        assert solution.verify().ok
    assert undecided <= count // 50
    assert min(feasible, infeasible) >= count // 4


@pytest.mark.parametrize("core", _engine.modules)
def test_the_least_violation_is_the_same_on_every_core(core, monkeypatch):
    monkeypatch.setattr(dispatch, "_solve", importlib.import_module(core).solve)
    rng = np.random.default_rng(3)
    judged = 0
    while judged < 150:
        problem = random_problem(rng)
        solution = gf.solve(problem)
        if solution.status is not gf.Status.INFEASIBLE:
            continue
        judged += 1
        least = least_violation(problem)
        assert solution.violation == pytest.approx(least, rel=1e-6, abs=1e-9)


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


# ---- force and violation ------------------------------------------------------------------


@pytest.fixture
def overloaded(rng, default):
    problem = plant(rng, ["PCWF", "SFC", "PCWF", "FPC"], ceilings=True).problem
    return gf.solve(problem.replace(f=30 * problem.f), default)


def test_the_force_of_an_infeasible_grasp_keeps_the_limits(overloaded):
    """The violation is that of the force that makes the wrench; c is another, see test_nearest."""
    problem, c = overloaded.problem, overloaded.c
    assert overloaded.status is gf.Status.INFEASIBLE
    assert overloaded.nearest
    assert violation_of(problem, c) < 0
    assert overloaded.violation == pytest.approx(least_violation(problem), rel=1e-6)


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
    # A solver's proof lies on the edge of the dual cones; half of its gap makes room there.
    room = np.zeros(len(good.z))
    ceilings = slice(2 * problem.layout.joints, 2 * problem.layout.joints + problem.n)
    room[ceilings] = 0.5 * good.excess(problem) / problem.c_max.sum()
    good = gf.Certificate(good.y, good.z + room)
    verdicts = {True: 0, False: 0}
    for size in np.geomspace(1e-6, 3, 100):
        y = good.y * np.exp(size * rng.normal(size=6))
        z = good.z * np.exp(size * rng.normal(size=len(good.z)))
        if rng.random() < 0.1:
            z[rng.integers(len(z))] *= -1
        mutant = gf.Certificate(y, z)
        margin = how_far_it_holds(problem, mutant)
        if abs(margin) > 1e-11:
            assert gf.check_certificate(problem, mutant) == (margin > 0)
            verdicts[bool(margin > 0)] += 1
    assert min(verdicts.values()) >= 20


def float_beside(number, direction):
    """The nearest float beside an exact number, above (1) or below (−1) it."""
    near = float(number)
    beyond = (Fraction(near) - number) * direction > 0
    return near if beyond else math.nextafter(near, direction * math.inf)


def exact_sum(a, b):
    return sum(Fraction(x) * Fraction(y) for x, y in zip(a, b, strict=True))


def test_a_gap_that_is_rounding_proves_nothing():
    """The exact gap is negative by less than a digit, so its sign in floats is a matter of luck."""
    rng = np.random.default_rng(6)
    for _ in range(300):
        w, c_max = rng.uniform(0.1, 1, 7), rng.uniform(0.1, 1, 7)
        most = float_beside(exact_sum(w, c_max), -1)  # ceilings reach this, all of them together
        # The row with b = 0 keeps e away from the edge of the dual cones and out of the gap.
        extra = {"A": np.ones((1, 7)), "b": [0.0]}
        problem = gf.ForceProblem([w], [most], gf.FPC(), c_max=c_max, **extra)
        proof = gf.Certificate([1.0], np.append(w, 0.1))
        assert not gf.check_certificate(problem, proof)
        assert gf.check_certificate(problem.replace(f=[most * (1 + 1e-11)]), proof)


def test_a_dual_cone_that_rounding_alone_reaches_proves_nothing():
    """e = a·z − y is negative by less than a digit, where a proof needs e ≥ 0."""
    rng = np.random.default_rng(7)
    for _ in range(300):
        a, z = rng.uniform(0.1, 1, (7, 1)), rng.uniform(0.1, 1, 7)
        y = float_beside(exact_sum(a[:, 0], z), 1)
        problem = gf.ForceProblem([[1.0]], [0.0], gf.FPC(), A=a, b=-np.ones(7))
        assert not gf.check_certificate(problem, gf.Certificate([y], z))
        assert gf.check_certificate(problem, gf.Certificate([y * (1 - 1e-11)], z))


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
