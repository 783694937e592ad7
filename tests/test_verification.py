"""Solution.verify judges every status by the problem's data, whoever claims it."""

import numpy as np
import pytest
from grasps import KINDS, plant, random_contacts, random_model
from test_solve import forged

import graspforce as gf
from graspforce import reference

NOTHING = {"decrement": np.inf, "violation": 0.0, "y": None, "z": None}


def claim(problem, status, c=None, **numbers):
    """A Solution that claims a status, with no forces unless given."""
    forces = np.zeros(problem.m) if c is None else c
    fields = NOTHING | {"status": status, "c": forces, "nu": np.zeros(len(problem.f))} | numbers
    return forged(gf.solve(problem), **fields)


def squeeze(rows, bounds, f=0.0):
    """Two pairs of frictionless contacts on a rail, each pushing against the other."""
    return gf.ForceProblem([[1.0, -1.0, 1.0, -1.0]], [f], gf.FPC(), A=rows, b=bounds)


# ---- UNBOUNDED ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "problem",
    [
        gf.ForceProblem([[1.0, -1.0]], [0.0], gf.FPC()),  # no limit at all
        gf.ForceProblem([[1.0, -1.0]], [0.0], gf.FPC(), c_min=1.0),  # floors alone
        gf.ForceProblem([[1.0]], [3.0], gf.FPC()),  # no limit, and no choice either
        squeeze([[1.0, 0, 0, 0]], [3.0]),
        squeeze([[1.0, 0, 1e-17, 0]], [3.0]),  # the rounding of a Jacobian
        squeeze([[1.0, 0, -1.0, 0]], [3.0]),  # the limit recedes
        squeeze([[1.0, 0, 0, 0]], [1e-9], 1e-9),
        squeeze([[1.0, 0, 0, 0]], [1e12], 1e9),
    ],
)
def test_a_grip_that_nothing_limits(problem, default):
    solution = gf.solve(problem, default)
    assert solution.status is gf.Status.UNBOUNDED
    assert not solution.c.any()
    assert solution.verify().ok


@pytest.mark.parametrize(
    "problem",
    [
        squeeze([[1.0, 0, 0, 0], [0, 0, 1.0, 0]], [3.0, 3.0]),
        squeeze([[1.0, 0, 1e-4, 0]], [3.0]),  # far out, but there is an end
        squeeze([[1.0, 0, 1e-5, 0]], [3.0]),
        squeeze([[1.0, 0, 0, 0], [0, 0, 1.0, 0]], [3.0, 3e5]),
        gf.ForceProblem([[1.0]], [3.0], gf.FPC(), c_max=5.0),  # no choice
    ],
)
def test_a_grip_that_has_an_end_is_not_unbounded(problem, default):
    solution = gf.solve(problem, default)
    assert solution.status is gf.Status.SOLVED
    assert solution.verify().ok
    assert not claim(problem, gf.Status.UNBOUNDED).verify().ok


@pytest.mark.parametrize("kinds", [["PCWF"] * 3, ["SFC"] * 3, ["PCWF", "SFC", "FPC", "PCWF"]])
def test_random_grips_with_and_without_an_end(rng, kinds, default):
    """Limits on one contact of several leave the others free to squeeze, limits on all do not."""
    seen = {gf.Status.SOLVED: 0, gf.Status.UNBOUNDED: 0}
    for _ in range(20):
        models = [random_model(rng, kind) for kind in kinds]
        W = gf.grasp_map(random_contacts(rng, models))
        m = W.shape[1]
        for A in (np.eye(m)[[0]], np.vstack((np.eye(m), -np.eye(m)))):
            problem = gf.ForceProblem(
                W, 1e-3 * rng.normal(size=6), models, A=A, b=np.full(len(A), 5.0)
            )
            solution = gf.solve(problem, default)
            if solution.status in seen:
                seen[solution.status] += 1
            assert solution.verify().ok
            if len(A) > 1:
                assert solution.status is not gf.Status.UNBOUNDED
                assert not claim(problem, gf.Status.UNBOUNDED).verify().ok
    assert min(seen.values()) >= 3


def test_no_forces_at_all_are_not_unbounded():
    """The squeeze is free, but no force makes the wrench, or none keeps the limits."""
    free = squeeze([[1.0, 0, 0, 0]], [3.0])
    assert claim(free, gf.Status.UNBOUNDED).verify().ok
    for part in (1.0, 1e-6):  # beside forces a million times as large the smaller one is rounding
        away = free.replace(W=np.vstack((free.W, np.zeros(4))), f=[0.0, part])
        assert not claim(away, gf.Status.UNBOUNDED).verify().ok
    shut = squeeze([[1.0, 0, 0, 0], [-1.0, 0, 0, 0]], [3.0, -4.0])
    assert not claim(shut, gf.Status.UNBOUNDED).verify().ok
    heavy = squeeze([[1.0, 0, 0, 0]], [1e303])  # forces beyond 1e308 are none
    assert not claim(heavy, gf.Status.UNBOUNDED).verify().ok


# ---- the others --------------------------------------------------------------------------------


@pytest.fixture
def problem(rng):
    return plant(rng, ["PCWF", "SFC", "PCWF", "FPC"], ceilings=True).problem


@pytest.mark.parametrize("status", list(gf.Status), ids=str)
def test_forces_that_are_no_numbers_bear_nothing_out(problem, status):
    assert not claim(problem, status, c=np.full(problem.m, np.nan)).verify().ok
    assert not claim(problem, status, nu=np.full(6, np.inf)).verify().ok


@pytest.mark.parametrize("status", list(gf.Status), ids=str)
def test_a_contact_out_of_the_grasp_has_no_force(rng, status):
    problem = plant(rng, ["PCWF"] * 4, removed=1).problem
    solution = gf.solve(problem)
    assert solution.verify().ok
    c = solution.c + np.eye(problem.m)[3]
    assert not claim(problem, status, c=c).verify().ok


@pytest.mark.parametrize("status", [gf.Status.MAX_STEPS, gf.Status.STALLED], ids=str)
def test_an_early_end_claims_what_its_bound_says(problem, status):
    solution = gf.solve(problem)
    nearby = solution.c * (1 + 1e-9)
    assert claim(problem, status, c=nearby).verify().ok
    assert claim(problem, status, c=-nearby).verify().ok  # whatever it is, nothing is claimed
    assert claim(problem, status, c=solution.c, decrement=solution.decrement).verify().ok
    assert not claim(problem, status, c=-nearby, decrement=0.5).verify().ok
    far = gf.solve(problem, gf.Settings(tol=1e-2))
    assert not claim(problem, status, c=far.c, decrement=1e-9).verify().ok


def test_ticks_cut_short_bear_out_what_they_claim(rng, backend):
    for alpha in (0.1, 100.0):
        problem = plant(rng, KINDS * 2, alpha=alpha, ceilings=True).problem
        for max_steps in (*range(1, 12), 20, 24, 28, 30, 32):
            settings = gf.Settings(max_steps=max_steps, backend=backend)
            for load in (1.0, 50.0):
                solution = gf.solve(problem.replace(f=load * problem.f), settings)
                assert solution.newton_steps <= max_steps
                assert solution.verify().ok


def test_numbers_that_do_not_overflow_are_not_invalid(problem):
    assert not claim(problem, gf.Status.INVALID_NUMBERS).verify().ok
    for size in (1e-200, 1e200):
        extreme = problem.replace(c_max=size)
        assert claim(extreme, gf.Status.INVALID_NUMBERS).verify().ok


def test_the_violation_is_what_the_forces_need(problem):
    overloaded = gf.solve(problem.replace(f=30 * problem.f))
    assert overloaded.status is gf.Status.INFEASIBLE
    assert overloaded.verify().ok
    assert not forged(overloaded, violation=0.999 * overloaded.violation).verify().ok
    assert not forged(overloaded, c=1.01 * overloaded.c).verify().ok


def test_forces_outside_have_no_bound(problem):
    overloaded = gf.solve(problem.replace(f=30 * problem.f))
    assert overloaded.decrement == overloaded.suboptimality == np.inf
    assert not forged(overloaded, decrement=1.2).verify().ok


def test_the_bound_may_be_passed_by_rounding_only(problem):
    beside = gf.solve(problem.replace(alpha=1.1 * problem.alpha)).c
    measured, error = reference.decrement_and_error(beside, problem)
    assert 1e-3 < measured < 0.5
    assert error < 1e-8 * measured
    solution = forged(gf.solve(problem), c=beside, decrement=measured)
    assert solution.verify().ok
    assert not forged(solution, decrement=measured * (1 - 1e-5)).verify().ok
    assert 0 < solution.phi - gf.solve(problem).phi <= solution.suboptimality


@pytest.mark.parametrize("size", [1e160, 1e300, 1.7e308])
def test_numbers_that_overflow_in_the_check_are_judged_too(rng, size):
    """Rows whose squares leave double precision end the check, not the caller."""
    problem = plant(rng, ["PCWF"] * 3, inequalities=2).problem
    good = gf.solve(problem)
    for entry in range(problem.A.size):
        A = np.array(problem.A)
        A.flat[entry] = -size
        extreme = problem.replace(A=A)
        for status in gf.Status:
            assert isinstance(claim(extreme, status, c=good.c).verify().ok, bool)
