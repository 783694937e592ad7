"""solve_batch: row by row what solve says, whatever the shapes, the order and the threads."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest

import graspforce as gf
from graspforce.scenarios.random import geometry, grasps

PCWF = gf.PCWF(0.5)


def arrays(problems, *names):
    return {name: np.array([getattr(each, name) for each in problems]) for name in names}


@pytest.fixture(scope="module")
def four_fingers():
    """Arguments of 200 grasps: feasible ones, overloaded ones, weights from .01 to 1000."""
    problems = grasps(200, seed=5)
    fields = arrays(problems, "W", "f", "J", "mu", "alpha")
    fields["f"][::7] *= 1000
    return fields | {"models": PCWF, "tau_lo": -0.5, "tau_hi": 0.5}


def row(fields, i):
    """The ForceProblem of a row."""
    mu = fields["mu"][i]
    own = {name: value[i] for name, value in fields.items() if np.ndim(value) and name != "mu"}
    shared = {
        name: value
        for name, value in fields.items()
        if not np.ndim(value) and name not in ("mu", "models")
    }
    return gf.ForceProblem(models=[gf.PCWF(each) for each in mu], **own, **shared)


def assert_same(batch, i, solution, tolerance=1e-9):
    assert batch.status[i] == solution.status
    if solution.status is gf.Status.SOLVED:
        size = np.abs(solution.c).max()
        np.testing.assert_allclose(batch.c[i], solution.c, atol=tolerance * size, rtol=0)


def test_every_row_is_what_solve_says(four_fingers):
    batch = gf.solve_batch(**four_fingers)
    assert len(batch) == 200
    assert {gf.Status(status) for status in batch.status} == {
        gf.Status.SOLVED,
        gf.Status.INFEASIBLE,
    }
    for i in range(200):
        solution = gf.solve(row(four_fingers, i))
        assert_same(batch, i, solution)
        assert batch[i].problem == solution.problem
        assert batch[i].newton_steps == solution.newton_steps
        np.testing.assert_allclose(batch.tau[i], batch[i].tau, atol=1e-12)
        np.testing.assert_allclose(batch.friction_margins[i], batch[i].friction_margins, atol=1e-12)
        np.testing.assert_allclose(batch.torque_margins[i], batch[i].torque_margins, atol=1e-12)
        np.testing.assert_allclose(batch.wrench_error[i], batch[i].wrench_error, atol=1e-12)
        np.testing.assert_allclose(batch.suboptimality[i], batch[i].suboptimality, rtol=1e-9)
        assert (batch[i].certificate is None) == (solution.certificate is None)
    checked = batch.verify()
    assert checked.ok.all()
    assert (checked.certificate_holds[batch.status == gf.Status.INFEASIBLE] == True).all()  # noqa: E712


def test_layouts_of_every_kind():
    rng = np.random.default_rng(3)
    for _ in range(40):
        problem, load = geometry(rng)
        options = problem.arguments()
        loads = np.array([problem.f + scale * load for scale in (0, 0.3, 1)])
        batch = gf.solve_batch(**{**options, "f": loads})
        for i, f in enumerate(loads):
            assert_same(batch, i, gf.solve(problem.replace(f=f)), 1e-6)


def test_bits_do_not_depend_on_threads_order_or_neighbours(four_fingers):
    fields = {
        name: np.tile(value, (6, *[1] * (np.ndim(value) - 1))) if np.ndim(value) else value
        for name, value in four_fingers.items()
    }
    fields["f"] = fields["f"] * np.random.default_rng(0).uniform(0.8, 1.2, (1200, 1))
    once = gf.solve_batch(**fields, threads=1)
    for threads in (2, 7):
        again = gf.solve_batch(**fields, threads=threads)
        for name in ("c", "nu", "status", "newton_steps", "nearest", "decrement", "violation"):
            assert getattr(again, name).tobytes() == getattr(once, name).tobytes()
    order = np.random.default_rng(1).permutation(1200)
    shuffled = {name: value[order] if np.ndim(value) else value for name, value in fields.items()}
    assert gf.solve_batch(**shuffled).c.tobytes() == once.c[order].tobytes()
    some = {name: value[5:9] if np.ndim(value) else value for name, value in fields.items()}
    assert gf.solve_batch(**some).c.tobytes() == once.c[5:9].tobytes()


def test_rows_that_cannot_be_held_come_with_the_force_for_the_nearest_wrench(four_fingers):
    fields = {**four_fingers, "f": 30 * np.asarray(four_fingers["f"])}
    batch = gf.solve_batch(**fields)
    assert (batch.status == gf.Status.INFEASIBLE).any()
    assert (batch.nearest == (batch.status == gf.Status.INFEASIBLE)).all()
    assert batch.verify().ok.all()
    assert (batch.friction_margins[batch.nearest] > 0).all()
    for i in np.flatnonzero(batch.nearest)[:5].tolist():
        alone = gf.solve(batch[i].problem)
        assert batch.c[i] == pytest.approx(alone.c, abs=1e-6)
        assert batch.missing[i] == pytest.approx(alone.missing, abs=1e-6)
        assert batch[i].message == alone.message


def test_a_start_is_accepted_or_refused_row_by_row(four_fingers):
    cold = gf.solve_batch(**four_fingers)
    warm = gf.solve_batch(**four_fingers, start=cold)
    assert (warm.status == cold.status).all()
    assert (warm.start[cold.solved] == gf.Start.GIVEN).all()
    assert (warm.newton_steps[cold.solved] <= 2).all()
    broken = np.array(cold.c)
    broken[0] = np.nan
    broken[1] *= -1
    refused = gf.solve_batch(**four_fingers, start=broken)
    assert (refused.start[:2] == gf.Start.COLD).all()
    assert refused.c[:2].tobytes() == cold.c[:2].tobytes()
    one = gf.solve_batch(**four_fingers, start=cold.c[8])
    assert (one.status == cold.status).all()


def test_arrays_are_read_where_they_stand(four_fingers):
    count = 20_000
    W = np.broadcast_to(four_fingers["W"][1], (count, 6, 12)).copy()
    f = np.broadcast_to(four_fingers["f"][1], (count, 6)).copy()
    out = gf.solve_batch(W, f, PCWF, c_max=20)
    tracemalloc.start()
    again = gf.solve_batch(W, f, PCWF, c_max=20, out=out)
    assert tracemalloc.get_traced_memory()[1] < 1e5  # W has 11.5 MB
    tracemalloc.stop()
    assert np.shares_memory(again.c, out.c)


@pytest.mark.parametrize("change", ["float32", "strided", "reversed", "integers"])
def test_other_types_and_strides_are_converted(four_fingers, change):
    fields = dict(four_fingers)
    if change == "float32":
        fields["W"] = fields["W"].astype(np.float32)
        fields["J"] = fields["J"].astype(np.float32)
    elif change == "strided":
        fields["W"] = np.asfortranarray(fields["W"])
        fields["J"] = np.repeat(fields["J"], 2, axis=2)[:, :, ::2]
    elif change == "reversed":
        fields = {name: value[::-1] if np.ndim(value) else value for name, value in fields.items()}
    else:
        fields["alpha"] = np.full(200, 3)
    plain = {
        name: np.array(value, dtype=np.float64, order="C") if np.ndim(value) else value
        for name, value in fields.items()
    }
    assert gf.solve_batch(**fields).c.tobytes() == gf.solve_batch(**plain).c.tobytes()


@pytest.mark.parametrize(
    ("name", "place", "number", "words"),
    [
        ("W", (3, 1), np.nan, "W[3, 1]: got nan, expected finite numbers everywhere"),
        ("f", (2,), np.inf, "f[2]: got inf, expected finite numbers everywhere"),
        ("J", (0, 11), np.nan, "J[0, 11]: got nan, expected finite numbers everywhere"),
        ("mu", (1,), -0.5, "mu[1]: got -0.5, expected more than 0"),
        ("alpha", (), 0.0, "alpha: got 0, expected more than 0"),
        ("tau_lo", (4,), 0.7, "tau_lo[4]: got 0.7, expected less than tau_hi"),
        ("c_max", (1,), np.inf, "c_max[1]: got inf, expected finite numbers everywhere"),
    ],
)
def test_a_bad_row_spoils_no_other(four_fingers, name, place, number, words):
    fields = dict(four_fingers) | {"c_max": np.full((200, 4), 50.0)}
    fields["tau_lo"] = np.full((200, 12), -0.5)
    good = gf.solve_batch(**fields)
    fields[name] = np.array(fields[name])
    fields[name][(9, *place)] = number
    batch = gf.solve_batch(**fields)
    assert batch.status[9] == gf.Status.INVALID_NUMBERS
    assert not batch.c[9].any()
    assert batch.reason(9) == words
    assert "Newton steps" in batch.reason(8)
    rest = np.arange(200) != 9
    assert batch.c[rest].tobytes() == good.c[rest].tobytes()
    assert batch.verify().ok.all()
    for quantity in ("tau", "friction_margins", "torque_margins", "wrench_error", "phi"):
        assert not np.isnan(getattr(batch, quantity)).any()


def test_contacts_out_of_the_grasp(four_fingers):
    engagement = np.ones((200, 4))
    engagement[::2, 1] = 0
    batch = gf.solve_batch(**four_fingers, c_max=50, engagement=engagement)
    for i in range(6):
        problem = row(four_fingers, i).replace(c_max=50, engagement=engagement[i])
        assert_same(batch, i, gf.solve(problem))
    assert np.isinf(batch.friction_margins[::2, 1]).all()
    assert batch.verify().ok.all()


def test_shapes_that_do_not_fit_are_named_with_both(four_fingers):
    W, f = four_fingers["W"], four_fingers["f"]
    with pytest.raises(gf.InvalidInputError, match=r"f: got shape \(5, 6\).*W of shape \(200, 6,"):
        gf.solve_batch(W, f[:5], PCWF, c_max=20)
    with pytest.raises(gf.InvalidInputError, match=r"f: got shape \(200, 5\), expected shape \(6,"):
        gf.solve_batch(W, f[:, :5], PCWF, c_max=20)
    with pytest.raises(gf.InvalidInputError, match=r"start: got shape \(200, 5\)"):
        gf.solve_batch(W, f, PCWF, c_max=20, start=np.zeros((200, 5)))
    batch = gf.solve_batch(W[:3], f[:3], PCWF, c_max=20)
    with pytest.raises(gf.InvalidInputError, match=r"start: got a batch with forces of shape"):
        gf.solve_batch(W, f, PCWF, c_max=20, start=batch)
    with pytest.raises(gf.InvalidInputError, match="out: got a batch of 3 rows, expected 200"):
        gf.solve_batch(W, f, PCWF, c_max=20, out=batch)


@pytest.mark.parametrize("kind", [complex, object, bool])
def test_types_that_are_no_real_numbers(four_fingers, kind):
    with pytest.raises(gf.InvalidInputError, match="f: got type"):
        gf.solve_batch(four_fingers["W"], np.ones((200, 6)).astype(kind), PCWF, c_max=20)


def test_arguments_that_belong_together_and_unknown_ones(four_fingers):
    W, f = four_fingers["W"], four_fingers["f"]
    with pytest.raises(gf.InvalidInputError, match="tau_lo: missing"):
        gf.solve_batch(W, f, PCWF, J=four_fingers["J"])
    with pytest.raises(gf.InvalidInputError, match="cmax: not an option"):
        gf.solve_batch(W, f, PCWF, cmax=20)
    with pytest.raises(gf.InvalidInputError, match="threads: got 0"):
        gf.solve_batch(W, f, PCWF, c_max=20, threads=0)


def test_an_empty_batch_and_a_batch_of_one(four_fingers):
    W, f = four_fingers["W"], four_fingers["f"]
    empty = gf.solve_batch(W[:0], f[:0], PCWF, c_max=20)
    assert len(empty) == 0
    assert empty.c.shape == (0, 12)
    assert empty.tau.shape == (0, 0)
    assert empty.friction_margins.shape == (0, 4)
    assert empty.verify().ok.shape == (0,)
    one = gf.solve_batch(W[1], f[1], PCWF, c_max=20)
    assert len(one) == 1
    assert_same(one, 0, gf.solve(gf.ForceProblem(W[1], f[1], PCWF, c_max=20)))


def test_rows_by_index_and_slice(four_fingers):
    batch = gf.solve_batch(**four_fingers)
    assert batch[-1] == batch[199]
    with pytest.raises(IndexError, match="row: got 200"):
        batch[200]
    part = batch[7:20]
    assert part.c.tobytes() == batch.c[7:20].tobytes()
    assert part[0].certificate == batch[7].certificate
    assert [each.status for each in part] == [gf.Status(s) for s in part.status]


def test_the_reference_solves_a_batch(four_fingers):
    fields = {name: v[:4] if np.ndim(v) else v for name, v in four_fingers.items()}
    settings = gf.Settings(backend="reference")
    batch = gf.solve_batch(**fields, settings=settings)
    native = gf.solve_batch(**fields)
    assert (batch.status == native.status).all()
    np.testing.assert_allclose(batch.c[1:], native.c[1:], rtol=1e-3)


def test_ctrl_c_stops_a_batch(four_fingers):
    program = """
import signal
import numpy as np, graspforce as gf
from graspforce.scenarios.random import grasps
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a shell's background
problem = grasps(1)[0]
W = np.broadcast_to(problem.W, (3_000_000, 6, 12))
f = np.broadcast_to(problem.f * 1000, (3_000_000, 6))  # each takes the engine
print("ready", flush=True)
try:
    gf.solve_batch(W, f, problem.models, J=problem.J, tau_lo=-0.5, tau_hi=0.5, threads=2)
except KeyboardInterrupt:
    print("stopped")
"""
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None
        assert run.stdout.readline() == "ready\n"
        try:
            run.wait(0.5)
        except subprocess.TimeoutExpired:
            os.kill(run.pid, signal.SIGINT)
        assert run.stdout.read() == "stopped\n"


def test_solve_many_keeps_the_order_of_mixed_layouts():
    rng = np.random.default_rng(11)
    problems = [geometry(rng)[0] for _ in range(30)] + grasps(30, seed=8)
    problems = [problems[i] for i in rng.permutation(60)]
    solutions = gf.solve_many(each for each in problems)
    assert len(solutions) == 60
    for problem, found in zip(problems, solutions, strict=True):
        alone = gf.solve(problem)
        assert found.problem is problem
        assert found.status is alone.status
        if found.status is gf.Status.SOLVED:
            size = np.abs(alone.c).max()
            np.testing.assert_allclose(found.c, alone.c, atol=1e-6 * size, rtol=0)
    assert gf.solve_many([]) == []


def test_a_stream_of_problems_is_read_as_it_is_solved():
    problem = grasps(1)[0]
    read = 0

    def endless():
        nonlocal read
        while True:
            read += 1
            yield problem

    stream = gf.iterate_many(endless())
    assert next(stream).status is gf.Status.SOLVED
    assert read < 20_000
    with pytest.raises(gf.InvalidInputError, match="problems: got 3"):
        gf.solve_many([problem, 3])


def test_a_leading_axis_of_one_is_shared(four_fingers):
    W, f = four_fingers["W"][:1], four_fingers["f"]
    batch = gf.solve_batch(W, f, PCWF, c_max=20)
    assert batch.c.tobytes() == gf.solve_batch(W[0], f, PCWF, c_max=20).c.tobytes()
    assert batch.solved.any()


def test_a_coefficient_of_which_only_the_square_counts_is_still_checked(four_fingers):
    rng = np.random.default_rng(0)
    W = rng.normal(size=(3, 6, 16))
    gamma = np.full((3, 4), 0.005)
    gamma[1, 2] = -0.005
    f = 0.1 * np.array([each[:, ::4].sum(axis=1) for each in W])
    batch = gf.solve_batch(W, f, gf.SFC(0.5, 0.005), c_max=20, gamma=gamma)
    assert (batch.status == gf.Status.INVALID_NUMBERS).tolist() == [False, True, False]
    assert batch.reason(1) == "gamma[2]: got -0.005, expected more than 0"


def test_a_joint_that_touches_nothing_is_a_condition_by_itself(four_fingers):
    fields = {name: v[1:3] if np.ndim(v) else v for name, v in four_fingers.items()}
    fields["J"] = np.array(fields["J"])
    fields["J"][:, :, 4] = 0
    lo = np.full((2, 12), -0.5)
    lo[1, 4] = 0.1  # with a torque that is always 0
    batch = gf.solve_batch(**(fields | {"tau_lo": lo}))
    for i in range(2):
        assert_same(batch, i, gf.solve(row(fields, i).replace(tau_lo=lo[i])))
    assert batch.status.tolist() == [gf.Status.SOLVED, gf.Status.INFEASIBLE]


def with_pulls(rng, fields):
    fields["models"] = [gf.PCWF(0.5, pull) for pull in (3.0, 0.0, 1.0, 0.0)]
    fields["f"][::3] *= -1


def with_internal_forces(rng, fields):
    joints = fields["J"].shape[2]
    fields["internal"] = rng.normal(size=(2, joints))


def with_cone_weights(rng, fields):
    fields["cone_weight"] = rng.uniform(0.1, 2, size=(len(fields["f"]), 4))


KINDS = [with_pulls, with_internal_forces, with_cone_weights]


@pytest.mark.parametrize("backend", ["native", "reference"])
@pytest.mark.parametrize("kinds", [*([kind] for kind in KINDS), KINDS])
def test_pulls_internal_forces_and_weights_of_cones(kinds, backend):
    problems = grasps(40 if backend == "native" else 4, seed=9)
    fields = arrays(problems, "W", "f", "J", "alpha")
    fields |= {"models": PCWF, "tau_lo": -0.5, "tau_hi": 0.5, "c_max": 40.0}
    fields["engagement"] = np.ones((len(problems), 4))
    fields["engagement"][1, 0] = 0  # out of the grasp
    for kind in kinds:
        kind(np.random.default_rng(2), fields)
    settings = gf.Settings(backend=backend)
    batch = gf.solve_batch(**fields, settings=settings)
    assert batch.solved.sum() > len(problems) // 2
    assert batch.verify().ok.all()
    shared = ("models", "tau_lo", "tau_hi", "c_max", "internal")
    for i in range(len(problems)):
        one = gf.ForceProblem(
            **{name: value if name in shared else value[i] for name, value in fields.items()}
        )
        assert batch[i].problem == one
        solution = gf.solve(one, settings)
        assert_same(batch, i, solution)
        if not batch.solved[i]:
            continue
        names = ("tau", "friction_margins", "torque_margins", "phi", "friction_residual",
                 "internal_forces", "suboptimality")  # fmt: skip
        for name in names:
            value = getattr(solution, name)
            size = np.abs(value)[np.isfinite(value)].max(initial=0) + 1e-6
            np.testing.assert_allclose(getattr(batch, name)[i], value, atol=1e-6 * size, rtol=1e-6)
    again = gf.solve_batch(**fields, start=batch, settings=settings)
    taken = again.start[batch.solved] == gf.Start.GIVEN
    assert taken.all() or "internal" in fields  # of internal forces a start says nothing


def test_what_joints_cannot_feel_needs_joints():
    with pytest.raises(gf.InvalidInputError, match="internal: given without J"):
        gf.solve_batch(np.eye(3), np.zeros((2, 3)), PCWF, c_max=5.0, internal=np.ones((1, 2)))
