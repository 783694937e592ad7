"""graspforce.warp on Warp's CPU device, and its CUDA kernels compiled, which needs no GPU."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from batch import rows
from grasps import SIZES
from pages import DOCS, run
from warp_problems import random_batch

import graspforce as gf
import graspforce.warp as gw
from graspforce.warp.kernels import Shape, kernels

# That the tests run on the CPU is what graspforce.warp warns of.
pytestmark = pytest.mark.filterwarnings("ignore:f. on Warp's CPU device")

EXACT = 1e-18  # a tolerance at which rounding decides
# Few layouts, because their kernels take seconds to compile; each has what the others lack.
LAYOUTS = {
    "plain": (("PCWF",) * 4, {}),
    "mixed": (
        ("SFC", "PCWF", "FPC", "PCWF", "SFC"),
        {"joints": 4, "floors": True, "engagement": True, "bias": True},
    ),
    "pair": (("PCWF",) * 2, {"joints": 2, "ceilings": False}),
}
ROWS = {"plain": 2000, "mixed": 1000, "pair": 500}


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """Keep Warp quiet and its kernels out of the user's cache; it reads both when it is started."""
    wp.config.kernel_cache_dir = str(tmp_path_factory.mktemp("warp"))
    wp.config.log_level = wp.LOG_WARNING


@pytest.fixture(scope="module", params=LAYOUTS)
def solved(request):
    """A layout's arrays, the problems made of them, and their forces."""
    kinds, options = LAYOUTS[request.param]
    arrays, models = random_batch(np.random.default_rng(1), kinds, ROWS[request.param], **options)
    problems = bind(arrays, models)
    return arrays, problems, problems.solve(tol=EXACT)


def on_cpu(array, real=np.float64):
    return wp.array(np.asarray(array, dtype=real), device="cpu")


def bind(arrays, models, **options):
    arrays = {name: on_cpu(array) for name, array in arrays.items()}
    return gw.Problems(models=models, **arrays, **options)


def plain(B=3, **changes):
    """The arguments of Problems in the plain layout; a tuple stands for an array of that shape."""
    arrays, models = random_batch(np.random.default_rng(2), LAYOUTS["plain"][0], B)
    changes = {k: on_cpu(np.ones(v)) if isinstance(v, tuple) else v for k, v in changes.items()}
    return {name: on_cpu(array) for name, array in arrays.items()} | {"models": models} | changes


def statuses(forces):
    return [gf.Status(status) for status in forces.status.numpy()]


# ---- forces ------------------------------------------------------------------------------------


def test_every_row_is_what_solve_finds(solved):
    _, problems, forces = solved
    c, nu, tau = forces.c.numpy(), forces.nu.numpy(), forces.tau.numpy()
    feasible = agreed = 0
    for row, status in enumerate(statuses(forces)):
        problem = problems[row]
        solution = gf.solve(problem, gf.Settings(tol=EXACT))
        feasible += solution.status is gf.Status.SOLVED
        if status is not gf.Status.SOLVED:
            continue
        assert solution.status is gf.Status.SOLVED, f"row {row} is {solution.status}"
        agreed += 1
        np.testing.assert_allclose(c[row], solution.c, atol=1e-8 * max(1, abs(solution.c).max()))
        pull = problem.W.T @ solution.nu  # nu itself is not unique with two contacts
        np.testing.assert_allclose(problem.W.T @ nu[row], pull, atol=1e-6 * max(1, abs(pull).max()))
        np.testing.assert_allclose(tau[row], problem.J.T @ c[row] + problem.tau_bias, atol=1e-12)
    assert 0.99 * feasible <= agreed <= feasible < len(problems)


def test_a_hundred_thousand_rows_and_their_gradients_are_those_of_solve_batch():
    """Four fingers, a tenth of them overloaded, at a tolerance at which rounding decides."""
    count, part, rng = 100_000, 10_000, np.random.default_rng(7)
    fields, problems = rows(count)
    load = np.where(rng.random((count, 1)) < 0.1, 30.0, 1.0) * rng.uniform(0.5, 1.05, (count, 1))
    fields = fields | {"f": load * fields["f"], "c_max": np.full((count, 4), 50.0)}
    own = [np.s_[..., 3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(4)]  # joints of a finger

    def by_contact(J):
        return np.concatenate([J[each] for each in own], axis=-2)

    limits = {"tau_lo": -0.5, "tau_hi": 0.5}
    ours = bind(fields | {"J": by_contact(fields["J"])}, problems[0].models, **limits)
    forces = ours.solve(tol=1e-20, max_steps=100)
    batch = gf.solve_batch(**fields, **limits, models=gf.PCWF(0.5), settings=gf.Settings(tol=1e-20))
    here, there = forces.status.numpy() == gf.Status.SOLVED, batch.solved
    assert 0.05 < np.mean(batch.status == gf.Status.INFEASIBLE) < 0.15
    assert not np.any(here & ~there)
    assert np.mean(here[there]) > 0.995  # the others are the CPU's to finish
    c = forces.c.numpy()
    size = np.abs(batch.c).max(axis=1, keepdims=True)
    np.testing.assert_array_less(np.abs(c - batch.c)[here] / size[here], 1e-8)

    weights = rng.normal(size=c.shape)
    found = ours.vjp(forces, c=on_cpu(weights))
    expected = gf.sensitivity(batch[:part]).vjp(c=weights[:part])
    held = here[:part]
    for name in ("f", "W", "J", "mu", "alpha"):
        mine, theirs = found[name].numpy()[:part][held], np.asarray(expected[name])[held]
        theirs = by_contact(theirs) if name == "J" else theirs
        mine, theirs = mine.reshape(len(mine), -1), theirs.reshape(len(theirs), -1)
        most = np.abs(theirs).max(axis=1)
        if name == "alpha":  # which may do nothing to what is asked for, of c that are nevertheless
            change = np.abs(weights[:part] * batch.c[:part]).sum(axis=1)
            most = np.maximum(most, (change / fields["alpha"][:part])[held])
        np.testing.assert_array_less(np.abs(mine - theirs).max(axis=1) / most, 1e-8, err_msg=name)


def test_what_solved_claims_is_borne_out_by_numpy(solved):
    _, problems, _ = solved
    tol = 1e-4  # so coarse that the bound matters
    forces = problems.solve(tol=tol)
    c, good = forces.c.numpy(), forces.status.numpy() == gf.Status.SOLVED
    for row in np.flatnonzero(good)[:100].tolist():
        problem = problems[row]
        A, b = problem.linear_limits()
        assert (A @ c[row] < b).all()
        parts = np.abs(problem.W) @ np.abs(c[row]) + np.abs(problem.f)
        assert np.abs(problem.W @ c[row] - problem.f).max() <= 1.01e-10 * parts.max()
        assert gf.reference.decrement(c[row], problem) ** 2 / 2 <= 1.01 * tol


def test_a_wrench_that_the_contacts_cannot_make_is_never_solved():
    arrays, models = random_batch(
        np.random.default_rng(2), LAYOUTS["pair"][0], 50, **LAYOUTS["pair"][1]
    )
    arrays["f"][::2] += 1e-3 * np.random.default_rng(3).normal(size=(25, 6))
    problems = bind(arrays, models)
    forces = problems.solve()
    assert gf.Status.SOLVED not in statuses(forces)[::2]
    found = problems.finish_on_cpu(forces)
    assert {found[row].status for row in range(0, 50, 2)} == {gf.Status.WRENCH_UNREACHABLE}


def test_a_start_saves_steps_and_one_outside_the_limits_is_ignored(solved):
    _, problems, forces = solved
    good = forces.status.numpy() == gf.Status.SOLVED
    again = problems.solve(forces.c)
    assert (again.status.numpy()[good] == gf.Status.SOLVED).all()
    assert (again.newton_steps.numpy()[good] == 1).all()
    outside = problems.solve(on_cpu(np.full(forces.c.shape, np.nan)), tol=EXACT)
    np.testing.assert_array_equal(outside.c.numpy()[good], forces.c.numpy()[good])


def test_out_is_written_to_and_may_be_the_start():
    problems = gw.Problems(**plain())
    first = problems.solve()
    expected = first.c.numpy()
    assert problems.solve(first.c, out=first) is first
    np.testing.assert_allclose(first.c.numpy(), expected, atol=1e-4)
    bare = first._replace(tau=None)
    assert problems.solve(out=bare) is bare


def test_new_numbers_in_the_same_arrays_count():
    arguments = plain()
    problems = gw.Problems(**arguments)
    before = problems.solve().c.numpy()
    arguments["f"].assign(0.5 * arguments["f"].numpy())
    after = problems.solve().c.numpy()
    assert (np.abs(after - before).max(axis=1) > 1e-3).all()
    np.testing.assert_allclose(after[1], gf.solve(problems[1]).c, atol=1e-4)


def test_rows_and_numbers_that_all_problems_share():
    arguments = plain(B=5)
    shared = {name: on_cpu(arguments[name].numpy()[0]) for name in ("W", "J", "tau_lo", "tau_hi")}
    numbers = {"c_max": 20.0, "alpha": 3.0, "models": gf.PCWF(0.7)}
    del arguments["mu"], arguments["gamma"]
    problems = gw.Problems(**(arguments | shared | numbers))
    forces = problems.solve(tol=EXACT)
    gradients = problems.vjp(forces, c=forces.c)
    assert set(gradients) == {"f"}
    for row in range(5):
        problem = problems[row]
        assert (problem.alpha, problem.c_max[0], problem.mu[0]) == (3.0, 20.0, 0.7)
        np.testing.assert_array_equal(problem.W, shared["W"].numpy())
        np.testing.assert_allclose(forces.c.numpy()[row], gf.solve(problem).c, atol=1e-4)


def test_any_order_in_memory():
    arguments = plain()
    expected = gw.solve(**arguments).c.numpy()
    for name in ("W", "f", "J", "mu"):
        turned = np.moveaxis(arguments[name].numpy(), 0, -1).copy()
        axes = (turned.ndim - 1, *range(turned.ndim - 1))
        arguments[name] = on_cpu(turned).transpose(axes)
        assert not arguments[name].is_contiguous
    np.testing.assert_array_equal(gw.solve(**arguments).c.numpy(), expected)


def test_no_problems_at_all():
    forces = gw.solve(**{
        name: array if name == "models" else on_cpu(array.numpy()[:0])
        for name, array in plain().items()
    })  # fmt: skip
    assert forces.c.shape == (0, 12)


@pytest.mark.parametrize(
    ("name", "value"),
    [("f", np.nan), ("W", np.inf), ("mu", -0.5), ("alpha", -1.0), ("alpha", 0.0), ("c_max", -1.0)],
)
def test_numbers_that_make_no_problem_are_not_solved_and_harm_no_neighbour(name, value):
    arguments = plain()
    expected = gw.solve(**arguments)
    array = arguments[name].numpy().copy()
    array[1] = value
    forces = gw.solve(**(arguments | {name: on_cpu(array)}))
    assert forces.status.numpy()[1] != gf.Status.SOLVED
    np.testing.assert_array_equal(forces.c.numpy()[::2], expected.c.numpy()[::2])


def test_a_row_that_nothing_bounds_is_unbounded():
    arrays, models = random_batch(
        np.random.default_rng(2), LAYOUTS["pair"][0], 3, **LAYOUTS["pair"][1]
    )
    opposed = [gf.Contact((0.04 * x, 0, 0), (-x, 0, 0), gf.PCWF(0.5)) for x in (1, -1)]
    arrays["W"][1], arrays["f"][1] = gf.grasp_map(opposed), [0, 0, 1, 0, 0, 0]
    arrays["J"][1, ::3] = 1e-17  # as rounding leaves it where no joint feels the squeeze
    problems = bind(arrays, models)
    assert statuses(problems.solve())[1] is gf.Status.UNBOUNDED
    assert gf.solve(problems[1]).status is gf.Status.UNBOUNDED


def test_max_steps():
    problems = gw.Problems(**plain())
    forces = problems.solve(max_steps=2)
    assert statuses(forces) == [gf.Status.MAX_STEPS] * 3
    assert forces.newton_steps.numpy().tolist() == [2, 2, 2]


def test_single_precision_is_as_exact_as_the_docs_say():
    rng = np.random.default_rng(3)
    arrays, models = random_batch(rng, LAYOUTS["plain"][0], 1000)
    double = bind(arrays, models).solve()
    arrays = {name: on_cpu(array, np.float32) for name, array in arrays.items()}
    single = gw.solve(models=models, precision="single", **arrays)
    good = double.status.numpy() == gf.Status.SOLVED
    both = good & (single.status.numpy() == gf.Status.SOLVED)
    assert both.sum() == (single.status.numpy() == gf.Status.SOLVED).sum() > 0.99 * good.sum()
    c = double.c.numpy()[both]
    error = np.abs(single.c.numpy()[both] - c).max(axis=1) / np.abs(c).max(axis=1)
    assert np.median(error) < 1e-4
    assert np.quantile(error, 0.99) < 2e-3


def test_the_cpu_finishes_what_is_not_solved(solved):
    _, problems, found = solved
    forces = gw.Forces(*(wp.clone(array) for array in found))
    open_rows = np.flatnonzero(forces.status.numpy() != gf.Status.SOLVED).tolist()
    solutions = problems.finish_on_cpu(forces)
    assert list(solutions) == open_rows
    for row, solution in solutions.items():
        assert solution.verify().ok
        assert forces.status.numpy()[row] == solution.status
        np.testing.assert_array_equal(forces.c.numpy()[row], solution.c)
        np.testing.assert_array_equal(forces.tau.numpy()[row], solution.tau)
    others = np.setdiff1d(np.arange(len(problems)), open_rows)
    np.testing.assert_array_equal(forces.c.numpy()[others], found.c.numpy()[others])


# ---- gradients ---------------------------------------------------------------------------------


def losses(solved, rng):
    """Numbers L = v·c + w·tau, their gradients, and the rows in which they mean something."""
    arrays, problems, forces = solved
    v, w = rng.normal(size=forces.c.shape), rng.normal(size=forces.tau.shape)
    gradients = problems.vjp(forces, c=on_cpu(v), tau=on_cpu(w), wanted=list(arrays))
    return v, w, {name: array.numpy() for name, array in gradients.items()}


def test_gradients_against_central_differences(solved):
    """Every number of a problem is moved at once, along a direction of its own."""
    arrays, problems, forces = solved
    rng = np.random.default_rng(4)
    v, w, gradients = losses(solved, rng)
    moves = {name: array * rng.normal(size=array.shape) for name, array in arrays.items()}
    if len(problems.models) == 2:  # f has to stay in the range of W
        moves |= {"W": 0 * moves["W"], "f": (arrays["W"] @ v[..., np.newaxis])[..., 0]}
    sides, good = [], forces.status.numpy() == gf.Status.SOLVED
    for step in (1e-6, -1e-6):
        moved = {name: array + step * moves[name] for name, array in arrays.items()}
        side = bind(moved, problems.models).solve(forces.c, tol=1e-20)
        sides.append((v * side.c.numpy()).sum(1) + (w * side.tau.numpy()).sum(1))
        good &= side.status.numpy() == gf.Status.SOLVED
    terms = [(gradients[name] * moves[name]).reshape(len(problems), -1) for name in arrays]
    terms, change = np.concatenate(terms, axis=1)[good], (sides[0] - sides[1])[good] / 2e-6
    error = np.abs(change - terms.sum(1)) / np.abs(terms).sum(1)
    assert good.sum() > 400
    assert np.median(error) < 1e-9
    assert np.quantile(error, 0.99) < 1e-6


def test_gradients_against_the_implicit_function_theorem_in_numpy(solved):
    """Each gradient by itself: −p·∂(∇Phi) by central differences of ∇Phi, written down again."""
    arrays, problems, forces = solved
    v, w, gradients = losses(solved, np.random.default_rng(5))
    rows = np.flatnonzero(forces.status.numpy() == gf.Status.SOLVED)[:20]
    for row in rows.tolist():
        numbers = {name: array[row] for name, array in arrays.items()}
        c, models = forces.c.numpy()[row], problems.models
        expected = implicit_gradients(numbers, models, c, v[row], w[row])
        found = {name: gradient[row] for name, gradient in gradients.items()}
        if len(models) == 2:  # what leads out of the range of W is no gradient
            for side in (found, expected):
                side["f"] = numbers["W"].T @ side["f"]
                del side["W"]
        for name, gradient in expected.items():
            atol = 2e-5 * max(1e-3, np.abs(gradient).max())
            np.testing.assert_allclose(found[name], gradient, atol=atol, err_msg=f"{name}, {row}")


def implicit_gradients(numbers, models, c, v, w):
    """dL/dx of L = v·c + w·tau at an optimum c, for every array x of a problem's numbers."""
    sizes = [model.dim for model in models]
    share = numbers.get("engagement", np.ones(len(models)))
    kept = np.repeat(share > 1e-6, sizes)

    def flat(values):
        return np.concatenate([np.ravel(values[name]) for name in numbers])

    def split(x):
        ends = np.cumsum([np.size(values) for values in numbers.values()])[:-1]
        parts = zip(numbers.items(), np.split(x, ends), strict=True)
        return {name: part.reshape(np.shape(values)) for (name, values), part in parts}

    def gradient(x, forces):
        return phi_gradient(split(x), sizes, share > 1e-6, forces)

    x, W = flat(numbers), numbers["W"][:, kept]
    H = np.column_stack([difference(lambda y: gradient(x, y), c, i) for i in np.flatnonzero(kept)])
    H = H[kept]
    H = (H + H.T) / 2
    J = np.zeros((len(c), len(w)))
    q = numbers["J"].shape[1]
    for i, start in enumerate(np.cumsum([0, *sizes[:-1]])):
        part = slice(start, start + sizes[i])
        J[part, q * i : q * (i + 1)] = numbers["J"][part]
    right = (v + J @ w)[kept]
    system = np.block([[H, W.T], [W, np.zeros((6, 6))]])
    solution = np.linalg.lstsq(system, np.append(right, np.zeros(6)), rcond=None)[0]
    p, by_f = np.zeros(len(c)), solution[kept.sum() :]
    p[kept] = solution[: kept.sum()]
    g = gradient(x, c)
    nu = np.linalg.lstsq(W.T, g[kept], rcond=None)[0]
    expected = split(
        np.array([-p @ difference(lambda y: gradient(y, c), x, i) for i in range(len(x))])
    )
    expected["W"] = np.outer(nu, p) - np.outer(by_f, c)
    expected["f"] = by_f
    for i, start in enumerate(np.cumsum([0, *sizes[:-1]])):
        part = slice(start, start + sizes[i])
        expected["J"][part] += np.outer(c[part], w[q * i : q * (i + 1)])
    if "tau_bias" in expected:
        expected["tau_bias"] += w
    return expected


def difference(function, x, i):
    step = np.zeros(len(x))
    step[i] = 1e-6 * max(abs(x[i]), 1e-3)
    return (function(x + step) - function(x - step)) / (2 * step[i])


def phi_gradient(numbers, sizes, there, c):
    """∇Phi at c of the contacts in the grasp."""
    share, n = numbers.get("engagement", np.ones(len(sizes))), len(sizes)
    g = np.zeros(len(c))
    for i, start in enumerate(np.cumsum([0, *sizes[:-1]])):
        part = slice(start, start + sizes[i])
        y, alpha = c[part], numbers["alpha"]
        if not there[i]:
            continue
        mu = numbers["mu"][i] if sizes[i] > 1 else 1.0
        weights = np.array([mu**2, -1, -1, -((mu / numbers["gamma"][i]) ** 2)])[: sizes[i]]
        g[part] = -2 * weights * y / (weights @ y**2)
        if "c_max" in numbers:
            g[start] += alpha / (share[i] * numbers["c_max"][i] - y[0])
        if "c_min" in numbers:
            g[start] -= alpha / (y[0] - share[i] * numbers["c_min"][i])
        J = numbers["J"][part]
        q = J.shape[1]
        joints = slice(q * i, q * (i + 1))
        tau = J.T @ y + numbers.get("tau_bias", np.zeros(n * q))[joints]
        g[part] += alpha * J @ (1 / (numbers["tau_hi"][joints] - tau))
        g[part] -= alpha * J @ (1 / (tau - numbers["tau_lo"][joints]))
    return g


def test_rows_that_are_not_solved_have_no_gradient(solved):
    _, _, forces = solved
    _, _, gradients = losses(solved, np.random.default_rng(6))
    bad = forces.status.numpy() != gf.Status.SOLVED
    assert bad.any()
    for array in gradients.values():
        assert not array[bad].any()
        assert np.isfinite(array).all()


def test_only_the_wanted_gradients_are_written():
    problems = gw.Problems(**plain())
    forces = problems.solve(tol=EXACT)
    everything = problems.vjp(forces, c=forces.c)
    assert set(everything) == {"W", "f", "mu", "gamma", "J", "tau_lo", "tau_hi", "c_max", "alpha"}
    some = problems.vjp(forces, c=forces.c, wanted=("f", "alpha"))
    assert set(some) == {"f", "alpha"}
    own = {"f": wp.zeros_like(some["f"]), "mu": wp.zeros((3, 4), dtype=wp.float64, device="cpu")}
    problems.vjp(forces, c=forces.c, out=own)
    for name, array in (some | own).items():
        np.testing.assert_array_equal(array.numpy(), everything[name].numpy())


# ---- a set squeeze -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def squeezed():
    """Grasps of which contact 1 has its normal force set; the first row's floor is above it."""
    arrays, models = random_batch(np.random.default_rng(8), ("PCWF",) * 4, 200, floors=True)
    arrays["f"] *= 0.3
    arrays["c_min"][:, 1] = arrays["c_max"][:, 1] = np.linspace(0.3, 2, 200)
    arrays["c_min"][0, 1] *= 1.001
    problems = bind(arrays, models)
    return arrays, problems, problems.solve(tol=1e-15)


def test_a_floor_at_the_ceiling_sets_the_normal_force(squeezed):
    arrays, problems, forces = squeezed
    c, good = forces.c.numpy(), forces.status.numpy() == gf.Status.SOLVED
    assert good.sum() > 100
    assert not good[0]
    feasible = 0
    for row in range(1, 200):
        solution = gf.solve(problems[row], gf.Settings(tol=1e-15))
        feasible += solution.status is gf.Status.SOLVED
        if good[row]:
            assert solution.status is gf.Status.SOLVED
            assert c[row, 3] == pytest.approx(arrays["c_max"][row, 1], rel=1e-9)
            np.testing.assert_allclose(c[row], solution.c, atol=1e-6 * abs(solution.c).max())
    assert good.sum() >= 0.97 * feasible


def test_gradients_at_a_set_squeeze(squeezed):
    arrays, problems, forces = squeezed
    rng = np.random.default_rng(9)
    v = rng.normal(size=forces.c.shape)
    gradients = problems.vjp(forces, c=on_cpu(v), wanted=list(arrays))
    good = np.flatnonzero(forces.status.numpy() == gf.Status.SOLVED)[:40].tolist()
    for row in good:
        solution = gf.solve(problems[row], gf.Settings(tol=1e-15))
        expected = gf.sensitivity(solution).vjp(c=v[row], wrt=("c_max", "c_min", "f", "mu"))
        for name, gradient in expected.items():
            atol = 1e-4 * max(1.0, np.abs(gradient).max())
            np.testing.assert_allclose(gradients[name].numpy()[row], gradient, atol=atol)


def test_a_set_squeeze_in_single_precision_and_with_engagement():
    arrays, models = random_batch(np.random.default_rng(8), ("PCWF",) * 4, 100, floors=True)
    arrays["f"] *= 0.3
    arrays["c_min"][:, 1] = arrays["c_max"][:, 1] = 1.0
    arrays["engagement"] = np.full((100, 4), 0.5)
    double = bind(arrays, models).solve()
    arrays = {name: on_cpu(array, np.float32) for name, array in arrays.items()}
    single = gw.solve(models=models, precision="single", **arrays)
    for forces, most in ((double, 1e-9), (single, 1e-4)):
        good = forces.status.numpy() == gf.Status.SOLVED
        assert good.sum() > 50
        np.testing.assert_allclose(forces.c.numpy()[good, 3], 0.5, rtol=2 * most)


# ---- refusals ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"W": np.eye(3)}, r"W: got type ndarray, expected a warp.array.*graspforce.solve"),
        ({"f": (3, 5)}, r"f: got shape \(3, 5\), expected \(3, 6\)"),
        ({"precision": "single"}, r'W: got float64, expected float32 with precision="single"'),
        ({"W": (3, 3, 12)}, r"W: got shape \(3, 3, 12\).*rows of zeros"),
        ({"W": (2, 6, 12)}, r"W: got shape \(2, 6, 12\), expected \(3, 6, 12\)"),
        ({"models": [gf.FPC()] * 3}, r"W: got 12 columns, expected 3"),
        ({"models": gf.FPC()}, r"models: got 12 contacts, expected at most 8.*graspforce.solve"),
        ({"J": (3, 12, 5)}, r"J: got shape \(3, 12, 5\).*at most 4.*graspforce.s"),
        ({"J": (3, 11, 3)}, r"J: got shape \(3, 11, 3\), expected \(B, 12, q\)"),
        ({"J": None}, r"tau_lo: given without J"),
        ({"tau_hi": None}, r"J: given without tau_hi"),
        ({"tau_lo": (3, 11)}, r"tau_lo: got shape \(3, 11\), expected \(3, 12\)"),
        ({"c_max": None, "engagement": 1.0}, r"engagement: given without c_max"),
        ({"c_max": "20"}, r"c_max: got '20', expected a warp.array"),
        ({"J": None, "tau_lo": None, "tau_hi": None, "c_max": None}, r"J, c_max: got neither"),
        ({"precision": "half"}, r"precision: got 'half', expected 'double' or 'single'"),
        ({"A": 1}, r"A: not an option of graspforce.warp; expected one of mu, gamma"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_by_name(changes, text):
    with pytest.raises(gf.InvalidInputError, match=text):
        gw.Problems(**plain(**changes))


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda p, f: p.solve(on_cpu(np.ones((3, 11)))), r"start: got shape \(3, 11\), expected"),
        (lambda p, f: p.solve(tol=0), r"tol: got 0.0, expected more than 0"),
        (lambda p, f: p.solve(max_steps=0), r"max_steps: got 0, expected an integer"),
        (lambda p, f: p.solve(out=f._replace(c=f.nu)), r"out.c: got shape \(3, 6\), expected"),
        (lambda p, f: p.solve(out=f._replace(status=f.nu)), r"out.status: got float64, expected i"),
        (lambda p, f: p.vjp(f, c=f.nu), r"c: got shape \(3, 6\), expected \(3, 12\)"),
        (lambda p, f: p.vjp(f, c=f.c, wanted=["c_min"]), r"c_min: not an option of these problems"),
        (lambda p, f: p.vjp(f, out={"f": f.c}), r"out\['f'\]: got shape \(3, 12\), expected"),
        (lambda p, f: p[3], r"row: got 3, expected less than 3"),
    ],
)  # fmt: skip
def test_wrong_arguments_of_the_methods_are_refused_by_name(call, text):
    problems = gw.Problems(**plain())
    forces = problems.solve()
    with pytest.raises(gf.InvalidInputError, match=text):
        call(problems, forces)


@pytest.mark.filterwarnings("default")
def test_the_cpu_device_is_warned_of():
    with pytest.warns(gf.GraspForceWarning, match=r"graspforce\.solve is several times as fast"):
        gw.Problems(**plain())


def test_without_warp_the_pip_line_is_named():
    code = "import sys; sys.modules['warp'] = None; import graspforce.warp"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "MissingExtraError: graspforce.warp needs warp-lang, which is not" in run.stderr
    assert "pip install 'warp-lang>=" in run.stderr


def test_the_snippet_of_the_docs_does_what_it_says(capsys):
    session = run(DOCS / "gpu.md", device="cpu")
    assert capsys.readouterr().out == "1000 solved; c has the shape (1000, 9)\n"
    problems, forces, by_f = session["problems"], session["forces"], session["by_f"].numpy()
    c, S = gf.solve(problems[7], gf.Settings(tol=EXACT)).c, gf.Settings(tol=EXACT)
    np.testing.assert_allclose(forces.c.numpy()[7], c, atol=1e-3)
    step = np.eye(6)[2] * 1e-5
    sides = [gf.solve(problems[7].replace(f=problems[7].f + s * step), S).c for s in (1, -1)]
    change = (0.5 * sides[0] @ sides[0] - 0.5 * sides[1] @ sides[1]) / 2e-5
    assert by_f[7, 2] == pytest.approx(change, rel=1e-2)


# ---- CUDA --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("layout", "precision"), [("plain", "double"), ("mixed", "double"), ("plain", "single")]
)
def test_the_kernels_compile_for_cuda(layout, precision, tmp_path):
    kinds, options = LAYOUTS[layout]
    given = [options.get(name, False) for name in ("floors", "engagement", "bias")]
    lanes = 4 if len(kinds) == 4 else 8
    dims = tuple(SIZES[kind] for kind in kinds)
    found = kernels(Shape(dims, options.get("joints", 3), True, *given, precision, lanes))
    for kernel in (found.solve, found.vjp):
        folder = tmp_path / kernel.key
        (file,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=folder, use_ptx=False)
        assert Path(file).suffix == ".cubin"
        assert Path(file).read_bytes()[:4] == b"\x7fELF"
