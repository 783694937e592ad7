"""graspforce.torch: solve_batch as an operator, its gradients against differences."""

from __future__ import annotations

import numpy as np
import pytest

import graspforce as gf
from graspforce.scenarios.random import grasps

torch = pytest.importorskip("torch")

import graspforce.torch as gt  # noqa: E402

MODEL = gf.PCWF(0.5)
TIGHT = gf.Settings(tol=1e-18)


@pytest.fixture
def tensors():
    problems = grasps(5, seed=3)
    return {
        name: torch.tensor(
            np.array([getattr(each, name) for each in problems]), requires_grad=name != "J"
        )
        for name in ("W", "f", "J", "mu")
    }


def solve(W, f, J, mu, alpha=5.0, limit=0.5):
    found = gt.solve(
        W, f, MODEL, J=J, tau_lo=-limit, tau_hi=limit, alpha=alpha, mu=mu, settings=TIGHT
    )
    return found.c, found.tau


def test_it_is_solve_batch(tensors):
    c, tau = solve(**tensors)
    arrays = {name: value.detach().numpy() for name, value in tensors.items()}
    batch = gf.solve_batch(**arrays, models=MODEL, tau_lo=-0.5, tau_hi=0.5, settings=TIGHT)
    assert (c.detach().numpy() == batch.c).all()
    np.testing.assert_allclose(tau.detach().numpy(), batch.tau, atol=1e-12)


def test_gradients_against_differences(tensors):
    J = tensors["J"]
    numbers = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in (5, 0.5)]
    assert torch.autograd.gradcheck(
        lambda W, f, mu, alpha, limit: solve(W, f, J, mu, alpha, limit),
        (tensors["W"], tensors["f"], tensors["mu"], *numbers),
        eps=1e-5, atol=1e-4, rtol=1e-4,
    )  # fmt: skip


def test_the_operator_is_registered_completely(tensors):
    fields = [*tensors.values(), torch.full((4,), 20.0, dtype=torch.float64)]
    fields.append(torch.tensor(5.0, dtype=torch.float64))
    del fields[2]  # J
    result = torch.library.opcheck(gt._solve_op, (fields, "W,f,mu,c_max,alpha", [3] * 4, 1e-9, 200))
    assert set(result.values()) == {"SUCCESS"}


def test_it_compiles_to_one_graph(tensors):
    compiled = torch.compile(solve, fullgraph=True, backend="aot_eager")
    for got, expected in zip(compiled(**tensors), solve(**tensors), strict=True):
        assert (got == expected).all()


def test_single_precision_one_problem_and_no_grad(tensors):
    W, f = tensors["W"], tensors["f"]
    found = gt.solve(W.float(), f.float(), MODEL, c_max=50)
    assert found.c.dtype == torch.float32
    found.c.sum().backward()
    assert torch.isfinite(W.grad).all()
    with torch.no_grad():
        one = gt.solve(W[0], f[0], MODEL, c_max=50)
    assert one.c.shape == (12,)
    assert not one.c.requires_grad
    assert one.status.item() == gf.Status.SOLVED


def test_rows_that_are_not_solved_have_zero_gradients(tensors):
    f = tensors["f"].detach().clone()
    f[1] *= 1e4
    f[2] = torch.nan
    f.requires_grad_()
    found = gt.solve(tensors["W"], f, MODEL, c_max=50)
    found.c.sum().backward()
    assert found.status.tolist()[1:3] == [gf.Status.INFEASIBLE, gf.Status.INVALID_NUMBERS]
    assert not f.grad[1:3].any()
    assert f.grad[0].any()


def test_a_second_derivative_is_refused_in_words(tensors):
    c, _ = solve(**tensors)
    (gradient,) = torch.autograd.grad(c.sum(), tensors["f"], create_graph=True)
    with pytest.raises(NotImplementedError, match="first derivatives only"):
        gradient.sum().backward()


def test_bad_arguments_are_named(tensors):
    W, f = tensors["W"], tensors["f"]
    with pytest.raises(gf.InvalidInputError, match="cmax: not an option"):
        gt.solve(W, f, MODEL, cmax=50)
    with pytest.raises(gf.InvalidInputError, match=r"f: got torch.complex128"):
        gt.solve(W, f.to(torch.complex128), MODEL, c_max=50)
    with pytest.raises(gf.InvalidInputError, match="f: got a tensor on meta"):
        gt.solve(W, f.to("meta"), MODEL, c_max=50)


def test_internal_forces_of_motors(tensors):
    W, f, J, mu = tensors.values()
    internal = torch.tensor(0.05 * np.random.default_rng(0).normal(size=(2, 12)))
    found = gt.solve(
        W, f, MODEL, J=J, tau_lo=-0.5, tau_hi=0.5, mu=mu, settings=TIGHT,
        internal=internal.requires_grad_(),
    )  # fmt: skip
    assert found.c.shape == (5, 12)
    weights = [torch.tensor(np.random.default_rng(1).normal(size=(5, 12))) for _ in range(2)]
    (weights[0] * found.c + weights[1] * found.tau).sum().backward()
    arrays = {name: value.detach().numpy() for name, value in tensors.items()}
    batch = gf.solve_batch(
        **arrays, models=MODEL, tau_lo=-0.5, tau_hi=0.5, internal=internal.detach().numpy(),
        settings=TIGHT,
    )  # fmt: skip
    np.testing.assert_allclose(found.tau.detach().numpy(), batch.tau, atol=1e-12)
    expected = gf.sensitivity(batch).vjp(c=weights[0].numpy(), tau=weights[1].numpy())
    np.testing.assert_allclose(f.grad.numpy(), expected["f"], rtol=1e-12)
    np.testing.assert_allclose(internal.grad.numpy(), expected["internal"].sum(axis=0), rtol=1e-12)


def test_contacts_that_pull_have_gradients():
    problem = grasps(1, seed=4)[0].replace(
        models=gf.PCWF(0.5, 1.0), tau_lo=-0.5, tau_hi=0.5, alpha=5.0
    )
    f = torch.tensor(problem.f, requires_grad=True)
    found = gt.solve(
        torch.tensor(problem.W), f, problem.models, J=np.array(problem.J), tau_lo=-0.5,
        tau_hi=0.5,
    )  # fmt: skip
    found.c.sum().backward()
    expected = gf.sensitivity(gf.solve(problem)).vjp(c=np.ones(problem.m))["f"]
    np.testing.assert_allclose(f.grad.numpy(), expected, rtol=1e-6, atol=1e-9)
