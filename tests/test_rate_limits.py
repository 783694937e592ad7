"""|c − c_last| ≤ dc_max: a tick may not change the forces by more than it is allowed to."""

import numpy as np
import pytest
from grasps import plant

import graspforce as gf

MOST = 0.3  # N


@pytest.fixture
def stream(rng):
    """A grasp, the forces that hold it, and a wrench that jumps to one that needs other forces."""
    planted = plant(rng, ["PCWF", "SFC", "FPC", "PCWF", "PCWF"], ceilings=True)
    return planted.problem.replace(c_last=planted.c, dc_max=MOST)


def test_a_limit_far_away_changes_little_and_a_near_one_binds(stream, exact):
    free = stream.replace(c_last=None, dc_max=None)
    optimum = gf.solve(free, exact).c
    far = gf.solve(stream.replace(dc_max=1e6), exact).c
    assert np.abs(far - optimum).max() < 1e-6
    elsewhere = optimum + np.where(np.arange(len(optimum)) == 0, 0.05, 0)
    near = gf.solve(stream.replace(c_last=elsewhere, dc_max=0.06), exact)
    assert near.status is gf.Status.SOLVED
    assert np.abs(near.c - elsewhere).max() < 0.06
    assert near.verify().ok


def test_every_tick_keeps_to_it_while_the_wrench_wanders(stream, default, rng):
    servo = gf.Servo(stream, default)
    last, f, reached = np.array(stream.c_last), np.array(stream.f), 0.0
    for _ in range(40):
        f = f + 0.02 * np.abs(stream.f).max() * rng.normal(size=6) * [1, 1, 1, 0.03, 0.03, 0.03]
        solution = servo.step(f=f)
        if solution.status is not gf.Status.SOLVED:
            assert solution.verify().ok
            assert np.array_equal(servo.c_last, last)
            continue
        assert np.array_equal(solution.problem.c_last, last)
        change = np.abs(solution.c - last).max()
        assert change < MOST
        reached = max(reached, change)
        last = solution.c
        assert np.array_equal(servo.c_last, last)
    assert reached > 0.1 * MOST


def test_a_jump_that_it_forbids_is_proved_infeasible(stream, default):
    assert gf.solve(stream, default).status is gf.Status.SOLVED
    slow = stream.replace(dc_max=1e-3, f=1.2 * stream.f)
    assert gf.solve(slow.replace(c_last=None, dc_max=None), default).status is gf.Status.SOLVED
    solution = gf.solve(slow, default)
    assert solution.status is gf.Status.INFEASIBLE
    assert gf.check_certificate(slow, solution.certificate)
    assert solution.verify().ok


def test_rate_limits_alone_bound_the_grip(default):
    problem = gf.ForceProblem(
        np.eye(3), [1, 0, 0], gf.PCWF(0.5), c_last=[1, 0.1, 0], dc_max=[0.5, 0.5, 0.5]
    )
    assert gf.solve(problem, default).status is gf.Status.SOLVED


def test_ticks_written_in_place_agree_with_steps(stream):
    stepped, written = gf.Servo(stream), gf.Servo(stream)
    for k in range(5):
        f = (1 + 0.01 * k) * stream.f
        solution = stepped.step(f=f)
        written.f[:] = f
        assert written.tick() is solution.status
        assert np.array_equal(written.c, solution.c)
        assert np.array_equal(written.c_last, stepped.c_last)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"c_last": None}, "^c_last: missing; dc_max came without it"),
        ({"dc_max": None}, "^dc_max: missing; c_last came without it"),
        ({"dc_max": 0.0}, r"^dc_max\[0\]: got 0, expected more than 0"),
        ({"c_last": 1.0}, r"^c_last: got shape \(\), expected shape"),
        ({"c_last": [np.nan] + [0.0] * 13}, r"^c_last\[0\]: got nan, expected finite"),
    ],
)
def test_wrong_rate_limits_are_named(stream, changes, words):
    with pytest.raises(gf.InvalidInputError, match=words):
        stream.replace(**changes)
