"""Derivatives against differences of the solver, exact ones of its equations, and each other."""

from __future__ import annotations

import derivatives as sweep
import numpy as np
import pytest
from conftest import ALLEGRO, SHARED
from derivatives import TIGHT, with_pulls_and_weights
from grasps import plant

import graspforce as gf
from graspforce.scenarios.random import grasps


@pytest.mark.parametrize("kind", sweep.KINDS)
@pytest.mark.parametrize("seed", range(20))
def test_every_field_against_what_is_exact_and_differences_of_the_solver(seed, kind):
    """``make derivatives`` is the long run."""
    found = list(sweep.errors(sweep.KINDS[kind](seed), np.random.default_rng(seed), most=2))
    assert [each for each in found if not each.exact <= 1e-9] == []
    assert [each for each in found if not each.differences <= 1e-6] == []
    assert len({each.field for each in found}) > 1


@pytest.mark.parametrize("kind", sweep.KINDS)
@pytest.mark.parametrize("seed", range(10))
def test_vjp_is_the_adjoint_of_jvp(seed, kind):
    problem = sweep.KINDS[kind](100 + seed)
    assert sweep.adjoint_error(problem, np.random.default_rng(seed)) <= 1e-10


@pytest.mark.parametrize("kind", sweep.KINDS)
def test_a_field_alone_gets_what_it_gets_among_all(kind):
    """Parts of the problem that are not asked for are left out of the work, not of the answer."""
    for seed in range(5):
        solution = gf.solve(sweep.KINDS[kind](seed))
        derivatives, rng = gf.sensitivity(solution), np.random.default_rng(seed)
        weights = {
            name: rng.normal(size=np.shape(getattr(solution, name)))
            for name in ("c", "tau", "phi", "friction_margins", "torque_margins")
        }
        for name, expected in derivatives.vjp(**weights).items():
            found = derivatives.vjp(**weights, wrt=(name,))
            np.testing.assert_array_equal(found[name], expected, err_msg=name)


def test_rows_of_limits_that_touch_nothing_count():
    problem = grasps(1, seed=4)[0]
    with_three = problem.W @ (gf.solve(problem).c * np.repeat([1, 1, 0, 1], 3))
    J = np.where(np.arange(12) == 7, 0.0, problem.J)  # a joint that no contact moves
    A = np.array([np.zeros(12), np.ones(12)])
    ceilings = {"c_max": 50.0, "engagement": [1, 1, 0, 1], "f": with_three}
    for more in ({}, ceilings):
        changed = problem.replace(J=J, A=A, b=[2.0, 100.0], **more)
        assert sweep.adjoint_error(changed, np.random.default_rng(0)) <= 1e-10


@pytest.mark.parametrize("index", range(0, 12, 3))
def test_a_real_hand(index):
    """Allegro grasps, whose fingers' joints are coupled by their contacts."""
    problem = gf.files.read(ALLEGRO)[index].problem
    if gf.solve(problem).status is gf.Status.SOLVED:
        for each in sweep.errors(problem, np.random.default_rng(index), most=2):
            assert each.exact <= 1e-9, each
            assert each.differences <= 1e-6, each


@pytest.mark.skipif(not SHARED.exists(), reason="needs ../shared/data")
def test_all_grasps_of_a_real_hand():
    """An entry of each field for every one that can be held."""
    each = gf.files.read(SHARED / "allegro_ycb.npz")
    held = [grasp.problem for grasp in each]
    held = [problem for problem in held if gf.solve(problem).status is gf.Status.SOLVED]
    assert len(held) == 191
    for i, problem in enumerate(held[::8]):
        rng = np.random.default_rng(i)
        for each in sweep.errors(problem, rng, most=1):
            assert each.exact <= 1e-9, each
            assert each.differences <= 1e-6, each
    assert max(sweep.adjoint_error(p, np.random.default_rng(0)) for p in held) <= 1e-10


def test_a_set_squeeze_follows_its_floor_and_ceiling(rng):
    planted = plant(rng, ["PCWF", "SFC", "PCWF", "PCWF"], alpha=2.0, ceilings=True)
    first = np.eye(4)[0]
    squeeze = 1.02 * planted.c[0] / planted.problem.engagement[0]
    c_max = np.where(first > 0, squeeze, planted.problem.c_max)

    def squeezed(more):
        problem = planted.problem.replace(
            c_max=c_max + more * first, c_min=(squeeze + more) * first
        )
        return gf.solve(problem, TIGHT)

    derivatives = gf.sensitivity(squeezed(0.0))
    found = derivatives.jvp(of=("c",), c_max=first, c_min=first)[0]
    expected = (squeezed(1e-4).c - squeezed(-1e-4).c) / 2e-4
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max(), rtol=0)
    back = derivatives.vjp(c=expected)
    assert (back["c_max"] + back["c_min"])[0] == pytest.approx(found @ expected, rel=1e-3)


def test_a_batch_is_its_rows_and_zero_where_not_solved():
    problems = grasps(40, seed=2)
    fields = {
        name: np.array([getattr(each, name) for each in problems])
        for name in ("W", "f", "J", "mu", "alpha")
    }
    fields["f"][3] *= 1e4
    fields["f"][4] = np.nan
    batch = gf.solve_batch(**fields, models=gf.PCWF(1), tau_lo=-0.5, tau_hi=0.5, settings=TIGHT)
    derivatives = gf.sensitivity(batch)
    assert derivatives.solved.tolist() == [i not in (3, 4) for i in range(40)]
    rng = np.random.default_rng(0)
    weights = {"c": rng.normal(size=batch.c.shape), "tau": rng.normal(size=batch.tau.shape)}
    found = derivatives.vjp(**weights)
    changes = {name: rng.normal(size=found[name].shape) for name in ("f", "W", "mu")}
    dc, dtau = derivatives.jvp(**changes)
    for i in range(40):
        if i in (3, 4):
            assert not any(value[i].any() for value in found.values())
            assert not dc[i].any()
            continue
        one = gf.sensitivity(batch[i])
        expected = one.vjp(c=weights["c"][i], tau=weights["tau"][i])
        for name, value in expected.items():
            np.testing.assert_allclose(found[name][i], value, rtol=1e-9, atol=1e-12)
        expected = one.jvp(**{name: change[i] for name, change in changes.items()})
        np.testing.assert_allclose(dc[i], expected[0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(dtau[i], expected[1], rtol=1e-9, atol=1e-12)


def test_jacobians_hold_the_columns_of_jvp():
    answer = gf.solve(grasps(1, seed=4)[0], TIGHT)
    derivatives = gf.sensitivity(answer)
    jacobian = derivatives.jacobian("f")
    assert jacobian.shape == (12, 6)
    for i in range(6):
        (dc,) = derivatives.jvp(of=("c",), f=np.eye(6)[i])
        np.testing.assert_allclose(jacobian[:, i], dc, rtol=1e-8, atol=1e-12)
    assert derivatives.jacobian("W", of="tau").shape == (12, 6, 12)


def test_a_contact_out_of_the_grasp_has_no_part_in_anything():
    problem = grasps(1, seed=4)[0].replace(c_max=50, engagement=[1, 0, 1, 1])
    answer = gf.solve(problem, TIGHT)
    assert answer.status is gf.Status.SOLVED
    found = gf.sensitivity(answer).vjp(c=np.ones(12), friction_margins=np.ones(4))
    assert all(np.isfinite(value).all() for value in found.values())
    assert not found["mu"][1]
    assert not found["W"][:, 3:6].any()


def test_what_is_no_quantity_or_field():
    derivatives = gf.sensitivity(gf.solve(grasps(1)[0]))
    with pytest.raises(gf.InvalidInputError, match="force: not an option"):
        derivatives.vjp(force=np.ones(12))
    with pytest.raises(gf.InvalidInputError, match="c_max: not an option"):
        derivatives.jvp(c_max=np.ones(4))
    with pytest.raises(gf.InvalidInputError, match=r"f: got shape \(5,\), expected shape \(6,\)"):
        derivatives.jvp(f=np.ones(5))
    with pytest.raises(gf.InvalidInputError, match="answer: got"):
        gf.sensitivity(3)


def test_pulls_in_a_batch_with_rows_that_are_not_solved():
    problem = with_pulls_and_weights(3)
    fields = problem.arguments() | {"f": np.array([problem.f, 1e9 * problem.f, problem.f])}
    fields["f"][2, 0] = np.nan
    derivatives = gf.sensitivity(gf.solve_batch(**fields, settings=TIGHT))
    assert derivatives.solved.tolist() == [True, False, False]
    found = derivatives.vjp(c=np.ones((3, problem.m)))
    alone = gf.sensitivity(gf.solve(problem, TIGHT)).vjp(c=np.ones(problem.m))
    assert "pull" in found
    for name, value in found.items():
        np.testing.assert_allclose(value[0], alone[name], rtol=1e-7, atol=1e-9)
        assert not value[1:].any()
    (dc,) = derivatives.jvp(of=("c",), pull=np.ones(problem.n))
    assert not dc[1:].any()
