"""graspforce.jax: solve_batch under jit, vmap, grad and scan."""

from __future__ import annotations

import numpy as np
import pytest

import graspforce as gf
from graspforce.scenarios.random import grasps

jax = pytest.importorskip("jax")
jax.config.update("jax_enable_x64", True)

from jax.test_util import check_grads  # noqa: E402

import graspforce.jax as gj  # noqa: E402

MODEL = gf.PCWF(0.5)
TIGHT = gf.Settings(tol=1e-18)


@pytest.fixture(scope="module")
def arrays():
    problems = grasps(5, seed=3)
    return [
        jax.numpy.array(np.array([getattr(each, name) for each in problems]))
        for name in ("W", "f", "J", "mu")
    ]


def solve(W, f, J, mu, alpha=5.0):
    return gj.solve(W, f, MODEL, J=J, tau_lo=-0.5, tau_hi=0.5, alpha=alpha, mu=mu, settings=TIGHT)


def test_it_is_solve_batch_also_under_jit(arrays):
    W, f, J, mu = map(np.asarray, arrays)
    batch = gf.solve_batch(W, f, MODEL, J=J, tau_lo=-0.5, tau_hi=0.5, mu=mu, settings=TIGHT)
    for found in (solve(*arrays), jax.jit(solve)(*arrays)):
        assert (np.asarray(found.c) == batch.c).all()
        assert (np.asarray(found.status) == batch.status).all()
    assert solve(*(each[0] for each in arrays)).c.shape == (12,)


def test_vmap_makes_one_batch_of_all_rows(arrays, monkeypatch):
    calls = []
    given = gj.solve_fields
    monkeypatch.setattr(gj, "solve_fields", lambda *each: calls.append(1) or given(*each))
    expected = solve(*arrays).c
    calls.clear()
    found = jax.vmap(solve)(*arrays)
    assert len(calls) == 1
    assert (found.c == expected).all()
    alphas = jax.numpy.array([1.0, 5.0, 10.0])
    nested = jax.vmap(lambda alpha: solve(*arrays, alpha))(alphas)
    assert len(calls) == 2
    assert nested.c.shape == (3, 5, 12)
    assert (nested.c[1] == expected).all()


def test_gradients_against_differences(arrays):
    W, f, J, mu = arrays
    check_grads(
        lambda W, f, mu, alpha: solve(W, f, J, mu, alpha)[:2], (W, f, mu, 5.0),
        order=1, modes=["rev"], atol=1e-4, rtol=1e-4, eps=1e-5,
    )  # fmt: skip


def test_grad_inside_jit_and_scan(arrays):
    W, f, J, mu = arrays

    def total(alpha):
        def step(carry, load):
            return carry + solve(W[0], load, J[0], mu[0], alpha).c.sum(), None

        return jax.lax.scan(step, 0.0, f)[0]

    slope = jax.jit(jax.grad(total))(5.0)
    difference = (total(5.0 + 1e-4) - total(5.0 - 1e-4)) / 2e-4
    np.testing.assert_allclose(slope, difference, rtol=1e-5)


def test_internal_forces_of_motors(arrays):
    W, f, J, mu = (each[0] for each in arrays)
    internal = 0.05 * np.random.default_rng(0).normal(size=(2, 12))

    def total(internal):
        found = gj.solve(
            W, f, MODEL, J=J, tau_lo=-0.5, tau_hi=0.5, mu=mu, settings=TIGHT, internal=internal
        )
        assert found.c.shape == (12,)
        return found.tau @ np.arange(12) + found.c.sum()

    check_grads(total, (internal,), order=1, modes=["rev"], atol=1e-5, rtol=1e-5, eps=1e-5)


def test_rows_that_are_not_solved_have_zero_gradients(arrays):
    W, f, J, mu = arrays
    f = f.at[1].multiply(1e4).at[2].set(np.nan)
    gradient = jax.grad(lambda f: solve(W, f, J, mu).c.sum())(f)
    assert not np.asarray(gradient[1:3]).any()
    assert np.asarray(gradient[0]).any()


def test_unknown_arguments_and_lengths_that_differ(arrays):
    W, f, _, _ = arrays
    with pytest.raises(gf.InvalidInputError, match="cmax: not an option"):
        gj.solve(W, f, MODEL, cmax=50)
    with pytest.raises(gf.InvalidInputError, match="expected one length B"):
        gj.solve(W, f[:3], MODEL, c_max=50)


def test_single_precision(arrays):
    W, f = (each.astype("float32") for each in arrays[:2])
    assert gj.solve(W, f, MODEL, c_max=50).c.dtype == np.float32
