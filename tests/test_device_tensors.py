"""Tensors and JAX arrays through Warp's kernels: on a CUDA device, and forced on Warp's CPU device.

What the CPU's front end finds for the same numbers is what they have to find.
"""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest
from warp_problems import random_batch

import graspforce as gf
from graspforce.contact import contact_starts

pytest.importorskip("warp")
import warp as wp

pytestmark = pytest.mark.filterwarnings("ignore:f. on Warp's CPU device")
EXACT = gf.Settings(tol=1e-18, max_steps=50)
# Joints in no order, five of 15 felt by nobody; and as many as places, in order.
LAYOUTS = {
    "plain": (("PCWF",) * 4, {}),
    "mixed": (
        ("SFC", "PCWF", "FPC"),
        {"joints": 3, "floors": True, "engagement": True, "bias": True},
    ),
}


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    wp.config.kernel_cache_dir = str(tmp_path_factory.mktemp("warp"))
    wp.config.log_level = wp.LOG_WARNING


@pytest.fixture(scope="module", params=LAYOUTS)
def batch(request):
    """Arrays by the names of solve_batch's arguments, and models."""
    kinds, options = LAYOUTS[request.param]
    arrays, models = random_batch(np.random.default_rng(1), kinds, 60, **options)
    starts, blocks = contact_starts(models), arrays["J"]
    order = np.random.default_rng(2).permutation(9 + 2) if request.param == "mixed" else range(12)
    J = np.zeros((60, starts[-1], len(order)))
    for i in range(len(models)):
        rows = slice(starts[i], starts[i + 1])
        J[:, rows, [order[3 * i + k] for k in range(3)]] = blocks[:, rows, :3]
    arrays["J"] = J
    for name in ("tau_lo", "tau_hi", "tau_bias"):
        if name in arrays:
            spare = np.full(
                (60, len(order)), {"tau_lo": -0.3, "tau_hi": 0.2, "tau_bias": 0.01}[name]
            )
            spare[:, list(order[: arrays[name].shape[1]])] = arrays[name]
            arrays[name] = spare
    return arrays, models


class Torch:
    """graspforce.torch on a device."""

    def __init__(self, device):
        self.module = importlib.import_module("graspforce.torch")
        self.torch, self.device = sys.modules["torch"], device

    def array(self, numbers, kind="float64"):
        kind = getattr(self.torch, kind)
        return self.torch.tensor(np.asarray(numbers), dtype=kind, device=self.device)

    def solve(self, arrays, models, **options):
        return self.module.solve(models=models, **arrays, **options)

    def gradients(self, arrays, models, v, w, **options):
        leaves = {name: value.detach().clone().requires_grad_() for name, value in arrays.items()}
        found = self.solve(leaves, models, **options)
        ((found.c * self.array(v)).sum() + (found.tau * self.array(w)).sum()).backward()
        return {name: self.numpy(leaf.grad) for name, leaf in leaves.items()}

    def numpy(self, tensor):
        return tensor.detach().cpu().numpy()


class Jax:
    """graspforce.jax on a device."""

    def __init__(self, device):
        self.jax = importlib.import_module("jax")
        self.jax.config.update("jax_enable_x64", True)
        self.module = importlib.import_module("graspforce.jax")
        self.device = self.jax.devices(device)[0]

    def array(self, numbers, kind="float64"):
        return self.jax.device_put(np.asarray(numbers, dtype=kind), self.device)

    def solve(self, arrays, models, **options):
        run = self.jax.jit(lambda arrays: self.module.solve(models=models, **arrays, **options))
        return run(arrays)

    def gradients(self, arrays, models, v, w, **options):
        def loss(arrays):
            found = self.module.solve(models=models, **arrays, **options)
            return (found.c * v).sum() + (found.tau * w).sum()

        found = self.jax.jit(self.jax.grad(loss))(arrays)
        return {name: self.numpy(value) for name, value in found.items()}

    def numpy(self, array):
        return np.asarray(array)


@pytest.fixture(params=["torch-cpu", "jax-cpu", "torch-cuda", "jax-cuda"])
def front(request, monkeypatch):
    """A front end whose arrays on its device go through the kernels."""
    library, device = request.param.split("-")
    module = pytest.importorskip(library)
    if device == "cuda":
        there = module.cuda.is_available() if library == "torch" else "cuda" in platforms(module)
        if not there:
            pytest.skip("no CUDA device")
    end = Torch(device) if library == "torch" else Jax(device)
    if device == "cpu":
        if not wp.is_cpu_available():
            pytest.skip("Warp without its CPU device")
        if library == "jax":
            monkeypatch.setattr(end.module, "_BY_KERNELS", "cpu")
        else:
            monkeypatch.setattr(end.module, "_BY_KERNELS", {"cpu"})
            for operator in (end.module._solve_op, end.module._backward_op):
                kernels = operator._backend_fns["cuda"]
                monkeypatch.setitem(operator._backend_fns, "cpu", kernels)
    return end


def platforms(jax):
    found = {"cpu"}
    try:
        jax.devices("cuda")
        found.add("cuda")
    except RuntimeError:
        pass
    return found


def given(front, arrays, kind="float64"):
    return {name: front.array(numbers, kind) for name, numbers in arrays.items()}


def test_forces_and_torques_are_those_of_solve_batch(front, batch):
    arrays, models = batch
    found = front.solve(given(front, arrays), models, settings=EXACT)
    expected = gf.solve_batch(models=models, settings=EXACT, **arrays)
    solved = front.numpy(found.status) == gf.Status.SOLVED
    assert 0.98 * expected.solved.sum() <= solved.sum()
    assert expected.solved[solved].all()
    np.testing.assert_allclose(front.numpy(found.c)[solved], expected.c[solved], atol=1e-8)
    np.testing.assert_allclose(front.numpy(found.tau)[solved], expected.tau[solved], atol=1e-9)


def test_two_hands_of_one_size_keep_their_own_joints(front):
    arrays, models = random_batch(np.random.default_rng(6), ("PCWF",) * 4, 20, joints=3)
    starts, blocks = contact_starts(models), arrays["J"]
    for order in (np.arange(12), np.arange(12)[::-1], np.arange(12)):
        J = np.zeros((20, starts[-1], 12))
        for i in range(4):
            J[:, starts[i] : starts[i + 1], order[3 * i : 3 * i + 3]] = blocks[
                :, starts[i] : starts[i + 1]
            ]
        hand = arrays | {"J": J}
        for name in ("tau_lo", "tau_hi"):
            hand[name] = np.empty((20, 12))
            hand[name][:, order] = arrays[name]
        found = front.solve(given(front, hand), models, settings=EXACT)
        expected = gf.solve_batch(models=models, settings=EXACT, **hand)
        solved = front.numpy(found.status) == gf.Status.SOLVED
        assert solved.sum() >= 0.9 * expected.solved.sum() > 5
        np.testing.assert_allclose(front.numpy(found.c)[solved], expected.c[solved], atol=1e-8)
        np.testing.assert_allclose(front.numpy(found.tau)[solved], expected.tau[solved], atol=1e-9)


def test_gradients_are_those_of_sensitivity(front, batch):
    arrays, models = batch
    rng = np.random.default_rng(3)
    solved = gf.solve_batch(models=models, settings=EXACT, **arrays)
    v, w = rng.normal(size=solved.c.shape), rng.normal(size=solved.tau.shape)
    found = front.gradients(given(front, arrays), models, v, w, settings=EXACT)
    expected = gf.sensitivity(solved).vjp(c=v, tau=w, wrt=tuple(arrays))
    good = front.numpy(front.solve(given(front, arrays), models, settings=EXACT).status) == 0
    assert good.sum() > 15
    for name, gradient in found.items():
        wanted = expected[name] * (arrays[name] != 0) if name == "J" else expected[name]
        error = np.abs(gradient - wanted)[good].reshape(good.sum(), -1).max(axis=1)
        size = np.abs(expected[name])[good].reshape(good.sum(), -1).max(axis=1)
        assert np.quantile(error / np.maximum(size, 1e-3), 0.9) < 1e-6, name
        assert not gradient[~good].any(), name


def test_what_rows_share_gets_the_sum_of_their_gradients(front):
    arrays, models = random_batch(np.random.default_rng(4), ("PCWF",) * 4, 8, joints=0)
    shared = {"W": arrays["W"][0], "f": 0.3 * arrays["f"], "mu": arrays["mu"][:1]}
    shared |= {"c_max": 25.0, "alpha": arrays["alpha"]}
    v = np.random.default_rng(5).normal(size=(8, 12))
    found = front.gradients(given(front, shared), models, v, np.zeros((8, 0)), settings=EXACT)
    full = {
        "W": np.repeat(shared["W"][None], 8, 0), "f": shared["f"], "alpha": shared["alpha"],
        "mu": np.repeat(shared["mu"], 8, 0), "c_max": np.full((8, 4), 25.0),
    }  # fmt: skip
    expected = front.gradients(given(front, full), models, v, np.zeros((8, 0)), settings=EXACT)
    for name, axes in (("W", 0), ("c_max", None), ("mu", 0)):
        total = expected[name].sum(axis=axes)
        np.testing.assert_allclose(found[name].reshape(total.shape), total, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found["f"], expected["f"], rtol=1e-9, atol=1e-12)


def test_one_problem_and_single_precision(front, batch):
    arrays, models = batch
    one = {name: numbers[0] for name, numbers in arrays.items()}
    expected = gf.solve_batch(models=models, **one)
    found = front.solve(given(front, one), models)
    assert found.c.shape == expected.c[0].shape
    np.testing.assert_allclose(front.numpy(found.c), expected.c[0], atol=1e-4)
    single = front.solve(given(front, one, "float32"), models)
    assert "float32" in str(single.c.dtype)
    assert "float32" in str(single.tau.dtype)
    np.testing.assert_allclose(front.numpy(single.c), expected.c[0], atol=2e-3)


def test_a_row_with_a_nan_between_the_blocks_of_J_is_not_solved(front, batch):
    arrays, models = batch
    if len(models) != 4:
        return
    spoilt = dict(arrays, J=arrays["J"].copy())
    spoilt["J"][3, 0, 11] = np.nan
    status = front.numpy(front.solve(given(front, spoilt), models).status)
    expected = front.numpy(front.solve(given(front, arrays), models).status)
    assert status[3] != gf.Status.SOLVED
    np.testing.assert_array_equal(np.delete(status, 3), np.delete(expected, 3))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"f_soft": np.ones(6)}, "f_soft: got one, which the kernels for a GPU do not take.*CPU"),
        ({"A": np.ones((1, 12)), "b": np.ones(1)}, "A: got one, which the kernels"),
        ({"J": np.ones((12, 12))}, r"J: got joint 0 felt by contacts 0, 1, 2, 3, expected.*CPU"),
        ({"J": np.eye(12, 20), "tau_lo": -1.0, "tau_hi": 1.0}, "J: got 5 joints a contact, exp"),
        ({"W": np.zeros((3, 12)), "f": np.zeros(3)}, r"W: got shape .*graspforce.solve"),
    ],
)  # fmt: skip
def test_what_the_kernels_do_not_take_is_refused_with_the_reason(
    front, batch, changes, text, capfd
):
    arrays, models = random_batch(np.random.default_rng(2), ("PCWF",) * 4, 2)
    J = np.zeros((12, 12))
    for i in range(4):
        J[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = arrays["J"][0, 3 * i : 3 * i + 3]
    with pytest.raises(Exception, match=text) as caught:
        front.numpy(front.solve(given(front, arrays | {"J": J} | changes), models).c)
    expected = (
        gf.InvalidInputError if isinstance(front, Torch) else front.jax.errors.JaxRuntimeError
    )
    assert isinstance(caught.value, expected)


def test_different_types_are_refused_by_name(front, batch):
    arrays, models = batch
    mixed = given(front, arrays) | {"mu": front.array(arrays["mu"], "float32")}
    with pytest.raises(gf.InvalidInputError, match=r"mu: got .*float32, expected .*float64 as of"):
        front.solve(mixed, models)


def test_wrong_shapes_are_refused_by_name(front, batch):
    if not isinstance(front, Torch):
        return
    arrays, models = batch
    with pytest.raises(gf.InvalidInputError, match=r"c_max: got shape \(60, 2\), expected"):
        front.solve(given(front, arrays | {"c_max": np.ones((60, 2))}), models)
    with pytest.raises(gf.InvalidInputError, match=r"f: got 7 rows, expected 60 as of W, or one"):
        front.solve(given(front, arrays | {"f": np.ones((7, 6))}), models)


def test_vmap_lays_all_rows_side_by_side(front):
    if not isinstance(front, Jax):
        return
    arrays, models = random_batch(np.random.default_rng(4), ("PCWF",) * 4, 5, joints=0)
    W, f = (front.array(arrays[name]) for name in ("W", "f"))
    alphas = front.array([1.0, 5.0])

    def solve(alpha):
        return front.module.solve(W, 0.3 * f, models, c_max=25.0, alpha=alpha, settings=EXACT)

    found = front.jax.vmap(solve)(alphas).c
    assert found.shape == (2, 5, 12)
    np.testing.assert_allclose(found[1], solve(alphas[1]).c, atol=1e-9)
