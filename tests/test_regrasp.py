"""Fingers that let go and come back: schedules, and what the forces do meanwhile."""

import numpy as np
import pytest
from grasps import finger_jacobian, random_contacts
from hypothesis import given
from hypothesis import strategies as st

import graspforce as gf
from graspforce import regrasp

# ---- schedules ---------------------------------------------------------------------------------

RELEASE = regrasp.Release(finger=1, leave=0.5, back=1.5, ramp=0.25)


@pytest.mark.parametrize("rise", [regrasp.linear, regrasp.smooth])
def test_rises_from_0_to_1_and_is_flat_outside(rise):
    s = np.linspace(-1, 2, 301)
    w = rise(s)
    assert (w[s <= 0] == 0).all()
    assert (w[s >= 1] == 1).all()
    assert (np.diff(w) >= 0).all()
    assert rise(0.5) == pytest.approx(0.5)
    assert w + rise(1 - s) == pytest.approx(np.ones_like(s))


def test_linear_is_a_straight_line():
    assert regrasp.linear([0.1, 0.25, 0.9]).tolist() == pytest.approx([0.1, 0.25, 0.9])


def test_smooth_has_a_continuous_second_derivative():
    """By central differences across both ends, where the pieces meet."""
    h = 1e-4
    for end in (0.0, 1.0):
        for x in (end - h, end, end + h):
            first = (regrasp.smooth(x + h) - regrasp.smooth(x - h)) / (2 * h)
            second = (regrasp.smooth(x + h) - 2 * regrasp.smooth(x) + regrasp.smooth(x - h)) / h**2
            assert abs(first) < 1e-5
            assert abs(second) < 0.02
    assert (regrasp.smooth(0.5 + h) - regrasp.smooth(0.5 - h)) / (2 * h) == pytest.approx(
        15 / 8, rel=1e-6
    )


@pytest.mark.parametrize("shape", ["linear", "smooth"])
def test_the_papers_schedule(shape):
    """Finger 1 away from .5 to 1.5 s, ramps of .25 s (Section IV-B.2)."""
    schedule = regrasp.Schedule(4, [RELEASE], shape)
    for t, w in [
        (0, 1),
        (0.25, 1),
        (0.375, 0.5),
        (0.5, 0),
        (1, 0),
        (1.5, 0),
        (1.625, 0.5),
        (1.75, 1),
        (9, 1),
    ]:
        assert schedule(t).tolist() == pytest.approx([1, w, 1, 1])


@given(t=st.floats(-2, 4), finger=st.integers(0, 3), ramp=st.floats(0.01, 1))
def test_engagements_stay_between_0_and_1(t, finger, ramp):
    schedule = regrasp.Schedule(4, [regrasp.Release(finger, 0.5, 1.5, ramp)], "smooth")
    w = schedule(t)
    assert ((w >= 0) & (w <= 1)).all()
    assert w[np.arange(4) != finger].tolist() == [1, 1, 1]
    assert (w[finger] == 0) == (0.5 <= t <= 1.5) or w[finger] < 1e-12


def test_releases_of_one_and_of_several_fingers():
    again = regrasp.Release(finger=1, leave=3.0, back=3.5, ramp=0.25)
    other = regrasp.Release(finger=0, leave=0.75, back=1.0, ramp=0.25)
    schedule = regrasp.Schedule(2, [RELEASE, again, other])
    assert schedule(0.875).tolist() == [0, 0]
    assert schedule(0.625).tolist() == pytest.approx([0.5, 0])
    assert schedule(2.875).tolist() == pytest.approx([1, 0.5])
    assert schedule(3.25).tolist() == [1, 0]


def test_schedules_are_values():
    assert regrasp.Schedule(4, [RELEASE]) == regrasp.Schedule(4, (RELEASE,))
    assert regrasp.Schedule(4, [RELEASE]) != regrasp.Schedule(4, [RELEASE], "smooth")
    assert hash(regrasp.Schedule(4, [RELEASE])) == hash(regrasp.Schedule(4, (RELEASE,)))


def test_removal_threshold():
    assert regrasp.REMOVAL_THRESHOLD == 1e-6
    assert regrasp.is_removed([0, 1e-6, 1.01e-6, 1]).tolist() == [True, True, False, False]


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: regrasp.Release(-1, 0, 1, 0.1), r"Release\.finger"),
        (lambda: regrasp.Release(0, 1, 0, 0.1), r"Release\.back"),
        (lambda: regrasp.Release(0, 0, np.nan, 0.1), r"Release\.back"),
        (lambda: regrasp.Release(0, 0, 1, 0), r"Release\.ramp"),
        (lambda: regrasp.Release(0, 0, 1, np.nan), r"Release\.ramp"),
        (lambda: regrasp.Schedule(1, [RELEASE]), r"Release\.finger"),
        (lambda: regrasp.Schedule(4, [RELEASE], "cubic"), "shape"),
        (lambda: regrasp.Schedule(4)("now"), "t"),
        (lambda: regrasp.Schedule(4)(np.nan), "t"),
    ],
)
def test_bad_schedules(make, name):
    with pytest.raises(gf.InvalidInputError, match=rf"^{name}: got .*expected"):
        make()


# ---- forces ------------------------------------------------------------------------------------


C_MAX = 15.0


@pytest.fixture
def grip():
    """Six fingers about a ball, which can do without any one of them and without some two."""
    rng = np.random.default_rng(2)
    models = [gf.PCWF(0.8), gf.SFC(0.8, 0.01), *[gf.PCWF(0.8)] * 4]
    contacts = random_contacts(rng, models)
    J = finger_jacobian(rng, [model.dim for model in models], [[i] for i in range(6)])
    return gf.Grasp(contacts).problem(
        [0.3, 0.2, 1.0, 0.0, 0.002, 0.0], J=J, tau_lo=-0.5, tau_hi=0.5, c_max=C_MAX, c_min=0.05,
        alpha=2.0,
    )  # fmt: skip


@pytest.mark.parametrize("finger", range(6))
def test_the_grip_can_do_without_any_finger(grip, default, finger):
    assert gf.solve(with_engagement(grip, finger, 0.0), default).status is gf.Status.SOLVED


def with_engagement(problem, finger, w):
    engagement = np.ones(problem.n)
    engagement[finger] = w
    return problem.replace(engagement=engagement)


@pytest.mark.parametrize("finger", [0, 1, 5])
def test_the_others_forces_tend_to_those_without_the_finger(grip, exact, finger):
    """As engagement → 0 the difference to the removed finger goes to zero in proportion."""
    gone = gf.solve(with_engagement(grip, finger, 0.0), exact)
    assert gone.status is gf.Status.SOLVED
    differences = []
    for w in (1e-2, 1e-3, 1e-4, 2e-6):
        solution = gf.solve(with_engagement(grip, finger, w), exact)
        assert solution.status is gf.Status.SOLVED
        assert 0 < solution.normal_forces[finger] < w * C_MAX
        differences.append(np.abs(solution.c - gone.c).max())
        assert solution.verify().ok
    assert differences[0] < 0.5
    for larger, smaller, ratio in zip(differences, differences[1:], (10, 10, 50), strict=False):
        assert smaller < 1.5 * larger / ratio + 1e-8


@pytest.mark.parametrize("shape", ["linear", "smooth"])
def test_forces_are_continuous_through_leaving_and_coming_back(backend, grip, shape):
    dt = {"reference": 0.02, "native": 0.004}[backend]
    schedule = regrasp.Schedule(6, [regrasp.Release(0, 0.5, 0.8, 0.25)], shape)
    servo = gf.Servo(with_engagement(grip, 0, 1.0), gf.Settings(backend=backend))
    times = np.arange(0.1, 1.2, dt)
    forces, away = [], []
    for t in times:
        solution = servo.step(engagement=schedule(t))
        assert solution.status is gf.Status.SOLVED
        assert (solution.normal_forces < schedule(t) * C_MAX)[schedule(t) > 0].all()
        forces.append(solution.c)
        away.append(bool(regrasp.is_removed(schedule(t))[0]))
    forces = np.array(forces)
    assert any(away)
    assert not forces[np.array(away)][:, :3].any()
    jumps = np.abs(np.diff(forces, axis=0)).max(axis=1)
    size = np.abs(forces).max()
    for k in range(2, len(jumps) - 2):
        beside = max(jumps[k - 2], jumps[k - 1], jumps[k + 1], jumps[k + 2])
        assert jumps[k] <= 5 * beside + 1e-5 * size
    # Where the finger goes and returns, the path ends where it began.
    assert forces[-1] == pytest.approx(forces[0], abs=1e-4 * size)


def test_a_servo_with_a_removed_finger_is_like_a_cold_solve(backend, grip, exact):
    servo = gf.Servo(with_engagement(grip, 0, 1.0), exact)
    for w in (1.0, 0.5, 0.1, 1e-3, 1e-5, 1e-7, 0.0, 0.0, 1e-7, 1e-5, 1e-3, 0.1, 1.0):
        problem = with_engagement(grip, 0, w)
        solution, cold = servo.step(engagement=problem.engagement), gf.solve(problem, exact)
        assert solution.problem == problem
        assert solution.status is cold.status is gf.Status.SOLVED
        assert solution.c == pytest.approx(cold.c, abs=1e-6 * np.abs(cold.c).max())
        assert solution.verify().ok


def test_two_fingers_at_once(grip, exact):
    out = [0, 4]
    engagement = np.ones(6)
    engagement[out] = 0.0
    solution = gf.solve(grip.replace(engagement=engagement), exact)
    assert solution.status is gf.Status.SOLVED
    assert np.flatnonzero(~solution.problem.active).tolist() == out
    assert not solution.normal_forces[out].any()
    assert solution.friction_margins[out].tolist() == [np.inf, np.inf]
    assert solution.verify().ok


def test_floors_shrink_with_the_engagement(grip, exact):
    """c_norm ≥ c_min·engagement: a finger on its way out is not held by its floor."""
    problem = with_engagement(grip, 2, 0.01).replace(c_min=0.5)
    solution = gf.solve(problem, exact)
    assert solution.status is gf.Status.SOLVED
    assert 0.005 < solution.normal_forces[2] < 0.01 * C_MAX
    assert (np.delete(solution.normal_forces, 2) > 0.5).all()
