"""Streams with extreme numbers in single places: a refusal, or a verdict that bears itself out.

The same is done to the core alone, faster and at random, by cpp/tests/fuzz.cpp.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_servo import Stream

import graspforce as gf

FIELDS = [
    "f", "W", "J", "tau_lo", "tau_hi", "tau_bias", "c_max", "c_min", "engagement", "A", "b",
    "alpha",
]  # fmt: skip
EXTREMES = [0.0, -0.0, 5e-324, -1e-310, 1e-300, -1e-154, 1e154, 1e300, -1e300, 1.7e308, 1.0, -1.0]
numbers = st.sampled_from(EXTREMES) | st.floats()
changes = st.tuples(
    st.sampled_from(FIELDS), st.integers(0, 200), numbers, st.sampled_from(["put", "scale"])
)
STREAM = Stream(5, floors=True, inequalities=2, bias=True)


def bears_itself_out(solution):
    """The verdict, looked at in more digits than the core has."""
    problem = solution.problem
    c, W, f = (np.asarray(x, dtype=np.longdouble) for x in (solution.c, problem.W, problem.f))
    if solution.status is gf.Status.INFEASIBLE:
        return gf.check_certificate(problem, solution.certificate)
    if solution.status is not gf.Status.SOLVED:
        return True
    size = max(np.abs(f).max(), (np.abs(W) @ np.abs(c) + np.abs(f)).max())
    A, b = (np.asarray(x, dtype=np.longdouble) for x in problem.linear_limits())
    bounds = np.concatenate([problem.tau_lo, problem.tau_hi, problem.tau_bias])
    rounding = 1e-14 * (np.abs(A) @ np.abs(c) + np.abs(b) + np.abs(bounds).max()) + 1e-320
    return (
        (np.abs(W @ c - f) <= 1e-9 * size).all()
        and (b - A @ c > -rounding).all()
        and (solution.friction_margins > -1e-14 * np.abs(solution.c).max() - 1e-320).all()
    )


@pytest.mark.filterwarnings("ignore:.*:RuntimeWarning")  # NumPy's checks overflow; allowed
@given(ticks=st.lists(st.lists(changes, max_size=3), min_size=1, max_size=4))
def test_whatever_number_stands_wherever(ticks):
    servo = gf.Servo(STREAM.problem)
    for tick in ticks:
        good, forces = servo.problem, np.array(servo.c)
        for name, index, value, how in tick:
            entries = getattr(servo, name).reshape(-1)
            index %= entries.size
            entries[index] = value if how == "put" else value * entries[index]
        try:
            status = servo.tick()
        except gf.InvalidInputError:
            assert np.array_equal(servo.c, forces)
            assert servo.problem == good
            for name in FIELDS:
                getattr(servo, name)[...] = getattr(good, name)
            continue
        assert np.isfinite(servo.c).all()
        assert np.isfinite(servo.nu).all()
        assert status is servo.solution.status
        assert servo.solution.violation < np.inf
        assert bears_itself_out(servo.solution)
        assert isinstance(servo.solution.verify().ok, bool)  # one way or the other, no exception
