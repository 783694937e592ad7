"""What only a GPU can show; without one all of it is skipped.

The front ends on a CUDA device are in ``test_device_tensors.py``.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from grasps import SIZES
from warp_problems import random_batch

import graspforce as gf

wp = pytest.importorskip("warp")

import graspforce.warp as gw  # noqa: E402

wp.config.log_level = wp.LOG_WARNING
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")

TIGHT = gf.Settings(tol=1e-15)
LAYOUTS = {  # 77 rows fill no warp
    "pair": (("PCWF",) * 2, {"joints": 2, "ceilings": False}),
    "three": (("PCWF",) * 3, {}),
    "four": (("PCWF",) * 4, {"floors": True}),
    "mixed": (
        ("SFC", "PCWF", "FPC", "PCWF", "SFC"),
        {"joints": 4, "floors": True, "engagement": True, "bias": True},
    ),
    "eight": (("PCWF",) * 8, {"joints": 1}),
}


@pytest.fixture(params=LAYOUTS)
def batch(request):
    kinds, options = LAYOUTS[request.param]
    return random_batch(np.random.default_rng(1), kinds, 77, **options)


def on_gpu(arrays, real=np.float64):
    return {
        name: wp.array(np.asarray(array, dtype=real), device="cuda")
        for name, array in arrays.items()
    }


def test_forces_are_those_of_solve(batch):
    arrays, models = batch
    problems = gw.Problems(models=models, **on_gpu(arrays))
    forces = problems.solve(tol=1e-15)
    good = forces.status.numpy() == gf.Status.SOLVED
    solutions = [gf.solve(problems[row], TIGHT) for row in range(77)]
    feasible = np.array([solution.status is gf.Status.SOLVED for solution in solutions])
    assert feasible[good].all()
    assert good.sum() >= 0.97 * feasible.sum() > 20
    for row in np.flatnonzero(good).tolist():
        size = max(1.0, np.abs(solutions[row].c).max())
        np.testing.assert_allclose(forces.c.numpy()[row], solutions[row].c, atol=1e-6 * size)
        np.testing.assert_allclose(forces.tau.numpy()[row], solutions[row].tau, atol=1e-6 * size)


def test_gradients_are_those_of_sensitivity(batch):
    arrays, models = batch
    if len(models) == 2:
        pytest.skip("with two contacts W has dependent rows, and these gradients are not unique")
    problems = gw.Problems(models=models, **on_gpu(arrays))
    forces = problems.solve(tol=1e-18)
    rng = np.random.default_rng(2)
    v, w = (rng.normal(size=each.shape) for each in (forces.c, forces.tau))
    given = on_gpu({"c": v, "tau": w})
    found = problems.vjp(forces, wanted=list(arrays), **given)
    good = np.flatnonzero(forces.status.numpy() == gf.Status.SOLVED)
    errors = []
    starts = np.cumsum([0, *(model.dim for model in models)])
    q = arrays["J"].shape[-1]
    for row in good.tolist():
        solution = gf.solve(problems[row], gf.Settings(tol=1e-18))
        expected = gf.sensitivity(solution).vjp(c=v[row], tau=w[row], wrt=tuple(arrays))
        dense, expected["J"] = expected["J"], np.zeros((starts[-1], q))
        for i, (start, end) in enumerate(pairwise(starts)):
            expected["J"][start:end] = dense[start:end, q * i : q * (i + 1)]
        for name, wanted in expected.items():
            size = max(1e-3, np.abs(wanted).max())
            errors.append(np.abs(found[name].numpy()[row] - wanted).max() / size)
    assert len(errors) > 100
    assert np.quantile(errors, 0.95) < 1e-6


def test_a_floor_at_the_ceiling_sets_the_normal_force():
    arrays, models = random_batch(np.random.default_rng(8), ("PCWF",) * 4, 77, floors=True)
    arrays["f"] *= 0.3
    arrays["c_min"][:, 1] = arrays["c_max"][:, 1] = 1.0
    forces = gw.solve(models=models, **on_gpu(arrays))
    good = forces.status.numpy() == gf.Status.SOLVED
    assert good.sum() > 40
    np.testing.assert_allclose(forces.c.numpy()[good, 3], 1.0, rtol=2e-9)


def test_a_graph_does_what_the_call_does():
    arrays, models = random_batch(np.random.default_rng(3), ("PCWF",) * 4, 1000)
    given = on_gpu(arrays)
    problems = gw.Problems(models=models, **given)
    forces = problems.solve()
    with wp.ScopedCapture("cuda") as capture:
        problems.solve(out=forces)
    given["f"].assign(0.5 * arrays["f"])
    wp.capture_launch(capture.graph)
    found = forces.c.numpy()
    np.testing.assert_array_equal(found, problems.solve().c.numpy())
    np.testing.assert_allclose(found[5], gf.solve(problems[5]).c, atol=1e-4)


def test_single_precision():
    arrays, models = random_batch(np.random.default_rng(3), ("PCWF",) * 4, 1000)
    double = gw.solve(models=models, **on_gpu(arrays))
    single = gw.solve(models=models, precision="single", **on_gpu(arrays, np.float32))
    both = (double.status.numpy() == 0) & (single.status.numpy() == 0)
    assert both.sum() > 0.99 * (double.status.numpy() == 0).sum()
    c = double.c.numpy()[both]
    error = np.abs(single.c.numpy()[both] - c).max(axis=1) / np.abs(c).max(axis=1)
    assert np.median(error) < 1e-4


# ---- torch ---------------------------------------------------------------------------------------


@pytest.fixture
def tensors():
    """torch, its front end, four fingers' tensors with a full J, and their models."""
    torch = pytest.importorskip("torch")
    if not torch.cuda.is_available():
        pytest.skip("torch without CUDA")
    import graspforce.torch as gt

    arrays, models = random_batch(np.random.default_rng(3), ("PCWF",) * 4, 1000)
    assert SIZES["PCWF"] == 3
    J = np.zeros((1000, 12, 12))
    for i in range(4):
        J[:, 3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = arrays["J"][:, 3 * i : 3 * i + 3]
    arrays["J"] = J
    return torch, gt, {name: torch.tensor(a, device="cuda") for name, a in arrays.items()}, models


def test_torch_on_a_stream_of_its_own(tensors):
    torch, gt, given, models = tensors
    expected = gt.solve(models=models, **given)
    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        for _ in range(20):  # memory is used again before the device is done
            moved = {name: 1.0 * value for name, value in given.items()}
            found = gt.solve(models=models, **moved)
    torch.cuda.current_stream().wait_stream(stream)
    assert (found.c == expected.c).all()
    assert found.c.is_cuda


def test_torch_compiles_to_one_graph(tensors):
    torch, gt, given, models = tensors

    def solve(alpha):
        return gt.solve(models=models, **given | {"alpha": alpha}).c

    alpha = given["alpha"].clone().requires_grad_()
    solve(alpha).sum().backward()
    expected, alpha.grad = alpha.grad, None
    torch.compile(solve, fullgraph=True, backend="aot_eager")(alpha).sum().backward()
    np.testing.assert_allclose(alpha.grad.cpu(), expected.cpu(), rtol=1e-9, atol=1e-12)


def test_torch_tensors_on_different_devices_are_refused_by_name(tensors):
    _, gt, given, models = tensors
    with pytest.raises(gf.InvalidInputError, match="mu: got a tensor on cpu, expected cuda:0 as o"):
        gt.solve(models=models, **given | {"mu": given["mu"].cpu()})


def test_torch_computes_single_in_double(tensors):
    _, gt, given, models = tensors
    single = {name: value.float() for name, value in given.items()}
    found = gt.solve(models=models, **single)
    expected = gt.solve(models=models, **{name: value.double() for name, value in single.items()})
    assert (found.c == expected.c.float()).all()


# ---- jax -----------------------------------------------------------------------------------------


def test_jax_inside_scan_and_without_jit():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    try:
        device = jax.devices("cuda")[0]
    except RuntimeError:
        pytest.skip("JAX without CUDA")
    import graspforce.jax as gj

    arrays, models = random_batch(np.random.default_rng(3), ("PCWF",) * 4, 64, joints=0)
    given = {name: jax.device_put(array, device) for name, array in arrays.items()}
    plain = gj.solve(models=models, **given)  # without jit
    assert plain.c.devices() == {device}

    def tick(total, f):
        found = gj.solve(models=models, **given | {"f": f})
        return total + found.c.sum(), found.c

    scaled = jax.numpy.stack([given["f"], 0.5 * given["f"]])
    total, each = jax.jit(lambda f: jax.lax.scan(tick, 0.0, f))(scaled)
    np.testing.assert_allclose(each[0], plain.c, atol=1e-9)
    slope = jax.jit(jax.grad(lambda f: jax.lax.scan(tick, 0.0, f)[0]))(scaled)
    assert np.isfinite(slope).all()
    assert np.isfinite(total)
    alone = jax.grad(lambda f: gj.solve(models=models, **given | {"f": f}).c.sum())(given["f"])
    np.testing.assert_allclose(slope[0], alone, rtol=1e-6, atol=1e-9)


def test_jax_on_the_cpu_beside_a_gpu_takes_every_problem():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    import graspforce.jax as gj

    arrays, models = random_batch(np.random.default_rng(3), ("PCWF",) * 4, 5, joints=0)
    with jax.default_device(jax.devices("cpu")[0]):
        found = gj.solve(models=models, f_soft=0.01, **arrays)
    expected = gf.solve_batch(models=models, f_soft=0.01, **arrays)
    np.testing.assert_array_equal(np.asarray(found.c), expected.c)
