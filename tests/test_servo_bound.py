"""The arrays that live in a Servo, budgets, and what a tick tells about itself."""

import threading

import numpy as np
import pytest
from test_servo import DT, Stream

import graspforce as gf


def test_ticks_from_bound_arrays_are_steps_to_the_last_digit(backend):
    stream = Stream(floors=True)
    settings = gf.Settings(backend=backend)
    passed, bound = (gf.Servo(stream.problem, settings) for _ in range(2))
    for k in range(6):
        fields = stream.fields(k * DT) | {"engagement": np.full(4, 1 - 0.01 * k)}
        solution = passed.step(**fields, alpha=2 + 0.1 * k)
        for name, value in fields.items():
            getattr(bound, name)[...] = value
        bound.alpha[...] = 2 + 0.1 * k
        assert bound.tick() is gf.Status.SOLVED
        assert np.array_equal(bound.c, solution.c)
        assert np.array_equal(bound.nu, solution.nu)
        assert bound.problem == solution.problem
        told = bound.solution
        assert told.problem == solution.problem
        assert (told.newton_steps, told.start) == (solution.newton_steps, solution.start)


@pytest.mark.parametrize(
    "name",
    ["f", "W", "J", "tau_lo", "tau_hi", "tau_bias", "c_max", "c_min", "engagement", "A", "b"],
)
def test_every_bound_array_counts(name):
    stream = Stream(floors=True, inequalities=2, bias=True)
    servo = gf.Servo(stream.problem)
    before = getattr(stream.problem, name)
    if name == "f":
        after = before * 1.01
    else:
        shift = 1e-3 if name == "c_min" else -1e-3
        after = before + shift * np.abs(before).mean()
    getattr(servo, name)[...] = after
    servo.tick()
    assert servo.problem == stream.problem.replace(**{name: after})
    cold = gf.solve(servo.problem)
    assert servo.c == pytest.approx(cold.c, rel=1e-4, abs=1e-4)


def test_steps_and_ticks_see_each_others_numbers(backend):
    stream = Stream()
    servo = gf.Servo(stream.problem, gf.Settings(backend=backend))
    servo.f[:] *= 1.01
    solution = servo.step(alpha=3.0)
    assert solution.problem == stream.problem.replace(f=stream.problem.f * 1.01, alpha=3.0)
    assert servo.alpha == 3.0
    servo.tick()
    assert servo.problem == solution.problem
    assert np.array_equal(servo.f, stream.problem.f * 1.01)


@pytest.mark.parametrize(
    ("name", "where", "bad"),
    [
        ("f", 2, np.nan),
        ("W", (0, 3), np.inf),
        ("J", (1, 1), -np.inf),
        ("tau_hi", 0, -100.0),
        ("alpha", (), 0.0),
        ("engagement", 1, 1.5),
        ("c_max", 3, 0.0),
    ],
)
def test_a_refused_tick_names_the_number_and_leaves_no_trace(backend, name, where, bad):
    stream = Stream()
    servo, untouched = (gf.Servo(stream.problem, gf.Settings(backend=backend)) for _ in range(2))
    for each in (servo, untouched):
        each.tick()
    c = servo.c.copy()
    array = getattr(servo, name)
    good = array[where].copy()
    array[where] = bad
    for _ in range(2):
        with pytest.raises(gf.InvalidInputError, match=name):
            servo.tick()
    assert np.array_equal(servo.c, c)
    assert servo.problem == stream.problem
    array[where] = good
    for each in (servo, untouched):
        each.f[:] *= 1.01
        assert each.tick() is gf.Status.SOLVED
    assert np.array_equal(servo.c, untouched.c)


def test_bound_arrays_cannot_be_replaced_or_reshaped():
    servo = gf.Servo(Stream().problem)
    with pytest.raises(AttributeError):
        servo.f = np.zeros(6)
    with pytest.raises(ValueError, match="broadcast"):
        servo.f[:] = np.zeros(5)
    for name in ("c", "nu"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(servo, name)[0] = 1.0


def test_a_view_outlives_its_servo():
    servo = gf.Servo(Stream().problem)
    servo.tick()
    c, f = servo.c, servo.f
    kept = c.copy()
    del servo
    f[:] = 0
    assert np.array_equal(c, kept)


def test_a_solution_before_the_first_tick_is_refused(backend):
    servo = gf.Servo(Stream().problem, gf.Settings(backend=backend))
    with pytest.raises(gf.InvalidInputError, match="before the first tick"):
        _ = servo.solution


def test_a_tick_tells_where_it_set_out(backend):
    stream = Stream()
    servo = gf.Servo(stream.problem, gf.Settings(backend=backend))
    starts = [servo.step(**stream.fields(k * DT)).start for k in range(4)]
    assert starts[0] is gf.Start.COLD
    assert starts[2:] == [gf.Start.EXTRAPOLATED] * 2
    servo.reset()
    assert servo.step().start is gf.Start.COLD
    given = gf.solve(stream.problem, gf.Settings(backend=backend), start=servo.c.copy())
    assert given.start is gf.Start.GIVEN


def test_a_wrench_that_jumps_to_and_fro_is_answered_from_where_the_last_was():
    """Extrapolation would overshoot, so that the tick holds."""
    problem = Stream().problem
    servo = gf.Servo(problem)
    starts = [servo.step(f=problem.f * (1 + 0.3 * (k % 2))).start for k in range(8)]
    assert gf.Start.HELD in starts[2:]


def strictly_inside(problem, c):
    normals = c.reshape(-1, 3)
    tau = problem.J.T @ c + problem.tau_bias
    return (
        (np.linalg.norm(normals[:, 1:], axis=1) < problem.mu * normals[:, 0]).all()
        and (normals[:, 0] < problem.engagement * problem.c_max).all()
        and (problem.tau_lo < tau).all()
        and (tau < problem.tau_hi).all()
    )


def test_a_budget_of_one_step_gives_usable_forces_and_arrives():
    stream = Stream(kinds=("PCWF",) * 4)
    far = stream.problem.replace(f=1.3 * stream.problem.f)
    free = gf.solve(far)
    assert free.newton_steps > 2
    servo = gf.Servo(far, gf.Settings(max_steps=1))
    statuses = []
    for _ in range(3 * free.newton_steps):
        solution = servo.step()
        statuses.append(solution.status)
        assert solution.newton_steps == 1
        assert strictly_inside(far, solution.c)
        if solution.status is gf.Status.SOLVED:
            break
        assert "max_steps" in solution.message
    assert statuses == [gf.Status.MAX_STEPS] * (len(statuses) - 1) + [gf.Status.SOLVED]
    assert servo.c == pytest.approx(free.c, rel=1e-4, abs=1e-4)


def test_a_budget_of_time_ends_a_solve_and_is_measured():
    problem = Stream().problem
    hasty = gf.solve(problem, gf.Settings(budget_us=1e-3))
    assert hasty.status is gf.Status.MAX_STEPS
    assert hasty.newton_steps == 1
    assert hasty.elapsed_us > 1e-3
    patient = gf.solve(problem, gf.Settings(budget_us=1e12))
    unlimited = gf.solve(problem)
    assert patient.status is gf.Status.SOLVED
    assert patient.newton_steps == unlimited.newton_steps
    assert np.array_equal(patient.c, unlimited.c)
    assert patient.elapsed_us > 0
    assert unlimited.elapsed_us == 0


@pytest.mark.parametrize("bad", [0, -1.0, np.nan, "1"])
def test_a_budget_that_is_none_is_refused(bad):
    with pytest.raises(gf.InvalidInputError, match="budget_us"):
        gf.Settings(budget_us=bad)


@pytest.mark.parametrize("contacts", [4, 16])
def test_servos_in_threads_answer_as_they_do_alone(contacts):
    """Below and above the size from which the interpreter's lock is released."""
    streams = [Stream(seed, kinds=("PCWF",) * contacts) for seed in range(4)]
    ticks = 60

    def run(stream):
        servo = gf.Servo(stream.problem)
        return [servo.step(**stream.fields(k * DT)).c for k in range(ticks)]

    alone = [run(stream) for stream in streams]
    together = [None] * len(streams)

    def work(i):
        together[i] = run(streams[i])

    threads = [threading.Thread(target=work, args=(i,)) for i in range(len(streams))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one, other in zip(alone, together, strict=True):
        assert np.array_equal(one, other)
