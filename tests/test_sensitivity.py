"""Derivatives against differences of the solver itself, and against each other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from conftest import ALLEGRO
from grasps import plant

import graspforce as gf
from graspforce.contact import model_of
from graspforce.scenarios.random import geometry, grasps

# Derivatives, and differences, are as exact as the forces that they are taken at.
TIGHT = gf.Settings(tol=1e-18)
QUANTITIES = ("c", "internal_forces", "tau", "phi", "friction_margins", "torque_margins")


def rich_problem(seed):
    """Soft and hard fingers, shared joints, ceilings, floors, inequalities and torque bias."""
    rng = np.random.default_rng(seed)
    while True:
        problem, load = geometry(rng)
        problem = problem.replace(f=problem.f + 0.3 * load)
        if problem.active.all() and gf.solve(problem, TIGHT).status is gf.Status.SOLVED:
            return problem


def with_pulls_and_weights(seed):
    """A rich problem of which some contacts pull, and whose cones have weights."""
    rng = np.random.default_rng(seed)
    while True:
        problem = rich_problem(seed)
        pulls = rng.uniform(0.1, 2, problem.n) * (rng.random(problem.n) < 0.7)
        pulls[0] = 1.0
        pulling = [
            model_of(model.dim, model.mu, model.gamma, pull)
            for model, pull in zip(problem.models, pulls.tolist(), strict=True)
        ]
        problem = problem.replace(models=pulling, cone_weight=rng.uniform(0.3, 2, problem.n))
        if gf.solve(problem, TIGHT).status is gf.Status.SOLVED:
            return problem


def with_internal_forces(seed):
    """A rich problem, on odd seeds with pulls and weights too, whose motors pull together."""
    rng = np.random.default_rng(seed)
    problem = with_pulls_and_weights(seed) if seed % 2 else rich_problem(seed)
    while not problem.layout.joints:
        seed += 1000
        problem = rich_problem(seed)
    count = int(rng.integers(1, min(3, problem.layout.joints) + 1))
    internal = rng.normal(size=(count, problem.layout.joints))
    internal *= rng.random(internal.shape) < 0.7
    internal[np.arange(count), np.arange(count)] = 1.0
    return problem.replace(internal=internal * np.abs(problem.J).max())


def entries(problem, name, rng, most=3):
    """Directions along which a field may change: few entries at a time."""
    shape = problem.layout.slots[name].shape
    size = int(np.prod(shape))
    for index in rng.permutation(size)[:most]:
        direction = np.zeros(size)
        direction[index] = 1.0
        yield direction.reshape(shape)


def moved(problem, name, change):
    packed = np.array(problem.packed)
    slot = problem.layout.slots[name]
    packed[slot.start : slot.stop] += np.ravel(change)
    return gf.ForceProblem.from_packed(problem.layout, packed)


def differences(problem, name, direction, step):
    """Central differences of every quantity, of the fourth order; None outside what is solvable."""
    found = []
    for scale in (1, 2):
        ends = [
            gf.solve(moved(problem, name, sign * scale * step * direction), TIGHT)
            for sign in (1, -1)
        ]
        if any(end.status is not gf.Status.SOLVED for end in ends):
            return None
        above, below = (
            np.concatenate([np.ravel(getattr(end, each)) for each in QUANTITIES]) for end in ends
        )
        found.append((above - below) / (2 * scale * step))
    return (4 * found[0] - found[1]) / 3


def difference(problem, name, direction):
    """The differences by quantity: each of the step that agrees best with the next larger one.

    A step that is right for Phi may be too small for c, whose changes are then all rounding.
    """
    steps = [size_of(problem, name) * 10.0 ** -(i / 2) for i in range(3, 15)]
    tried = [differences(problem, name, direction, step) for step in steps]
    pairs = [(a, b) for a, b in pairwise(tried) if a is not None and b is not None]
    sizes = [np.size(getattr(gf.solve(problem, TIGHT), each)) for each in QUANTITIES]
    split = np.cumsum(sizes)[:-1]
    by_quantity = [zip(np.split(a, split), np.split(b, split), strict=True) for a, b in pairs]
    return [
        min(choices, key=lambda pair: np.abs(pair[0] - pair[1]).max(initial=0))[1]
        for choices in zip(*by_quantity, strict=True)
    ]


def assert_agree(found, expected, words):
    """Each quantity to 1e-6 of its largest change."""
    for name, value, part in zip(QUANTITIES, found, expected, strict=True):
        scale = np.abs(part).max(initial=0) + 1e-4  # below it differences are rounding
        np.testing.assert_allclose(
            np.ravel(value), part, atol=1e-6 * scale, rtol=0, err_msg=f"{words} {name}"
        )


def size_of(problem, name):
    """What a field's numbers are large or small beside."""
    if name.startswith("tau"):
        return float((problem.tau_hi - problem.tau_lo).min())
    return max(float(np.abs(getattr(problem, name)).max()), 1e-2)


def differentiable(problem, name):
    slot = problem.layout.slots[name]
    if slot.start == slot.stop or (name == "engagement" and not problem.layout.ceilings):
        return False
    return not (name in ("mu", "gamma") and set(problem.layout.dims) == {1})


@pytest.mark.parametrize("seed", range(20))
def test_every_field_against_differences_of_the_solver(seed):
    rng = np.random.default_rng(seed)
    problem = rich_problem(seed)
    answer = gf.solve(problem, TIGHT)
    derivatives = gf.sensitivity(answer)
    full_rank = np.linalg.matrix_rank(problem.W) == len(problem.W)
    for name in problem.layout.slots:
        if not differentiable(problem, name) or (name in ("W", "f") and not full_rank):
            continue
        compare(derivatives, problem, name, rng)


def compare(derivatives, problem, name, rng, most=3):
    """Compare derivatives by some entries of a field with differences."""
    value = np.asarray(getattr(problem, name))
    for direction in entries(problem, name, rng, most):
        if name == "engagement" and (value * direction).sum() == 1:
            continue  # no room above
        if name in ("J", "A") and not (value * direction).any():
            continue  # would tie contacts together
        if name in ("c_min", "pull") and not (value * direction).any():
            continue  # no room below
        if name in ("mu", "gamma") and problem.layout.dims[int(direction.argmax())] == 1:
            continue
        found = derivatives.jvp(of=QUANTITIES, **{name: direction})
        assert_agree(found, difference(problem, name, direction), name)


@pytest.mark.parametrize("make", [rich_problem, with_pulls_and_weights, with_internal_forces])
@pytest.mark.parametrize("seed", range(10))
def test_vjp_is_the_adjoint_of_jvp(seed, make):
    rng = np.random.default_rng(seed)
    problem = make(100 + seed)
    derivatives = gf.sensitivity(gf.solve(problem, TIGHT))
    changes = {
        name: rng.normal(size=slot.shape)
        for name, slot in problem.layout.slots.items()
        if differentiable(problem, name)
    }
    rank = np.linalg.matrix_rank(problem.W)
    if rank < len(problem.W):
        del changes["W"], changes["f"]
    forward = derivatives.jvp(of=QUANTITIES, **changes)
    weights = [rng.normal(size=np.shape(each)) for each in forward]
    back = derivatives.vjp(**dict(zip(QUANTITIES, weights, strict=True)))
    left = [float(np.sum(w * each)) for w, each in zip(weights, forward, strict=True)]
    right = [float(np.sum(back[name] * change)) for name, change in changes.items()]
    size = sum(map(abs, left)) + sum(map(abs, right))
    assert abs(sum(left) - sum(right)) <= 1e-10 * size


@pytest.mark.parametrize("index", range(0, 12, 3))
def test_a_real_hand(index):
    """Allegro grasps, whose fingers' joints are coupled by their contacts."""
    rng = np.random.default_rng(index)
    problem = gf.files.read(ALLEGRO)[index].problem
    answer = gf.solve(problem, TIGHT)
    if answer.status is gf.Status.SOLVED:
        for name in ("W", "f", "J", "mu", "tau_lo", "tau_hi", "tau_bias", "alpha"):
            compare(gf.sensitivity(answer), problem, name, rng, most=2)


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


def test_a_soft_wrench_and_rate_limits():
    problem = grasps(1, seed=9)[0].replace(alpha=5.0)
    last = gf.solve(problem).c
    problem = problem.replace(
        f_soft=[0, 0, 0.1, 0.01, 0, 0.02], c_last=1.02 * last, dc_max=0.5 + np.abs(last)
    )
    derivatives = gf.sensitivity(gf.solve(problem, TIGHT))
    rng = np.random.default_rng(0)
    for name in ("f", "W", "f_soft", "c_last", "dc_max", "alpha", "mu", "J"):
        for direction in entries(problem, name, rng):
            value = np.asarray(getattr(problem, name))
            if name in ("J", "f_soft") and not (value * direction).any():
                continue
            found = derivatives.jvp(of=QUANTITIES, **{name: direction})
            assert_agree(found, difference(problem, name, direction), name)


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


@pytest.mark.parametrize("seed", range(8))
def test_internal_forces_of_motors(seed):
    rng = np.random.default_rng(seed)
    problem = with_internal_forces(seed)
    derivatives = gf.sensitivity(gf.solve(problem, TIGHT))
    full_rank = np.linalg.matrix_rank(problem.W) == len(problem.W)
    for name in problem.layout.slots:
        if differentiable(problem, name) and (full_rank or name not in ("W", "f")):
            compare(derivatives, problem, name, rng, most=2)


@pytest.mark.parametrize("seed", range(8))
def test_contacts_that_pull_and_cones_with_weights(seed):
    rng = np.random.default_rng(seed)
    problem = with_pulls_and_weights(seed)
    derivatives = gf.sensitivity(gf.solve(problem, TIGHT))
    full_rank = np.linalg.matrix_rank(problem.W) == len(problem.W)
    for name in problem.layout.slots:
        if differentiable(problem, name) and (full_rank or name not in ("W", "f")):
            compare(derivatives, problem, name, rng, most=2)


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
