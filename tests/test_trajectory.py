"""Motions against their finite differences, wrenches against Newton's and Euler's laws."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import graspforce as gf
from graspforce.trajectory import Circle, Hold, Move, Screw, Sway, wrench

CIRCLE = Circle((0.025, 0.05, 0.1), 0.025, 2.0, math.pi / 8, 1.0)
MOTIONS = [CIRCLE, Circle((0, 0, 0), 0.3, 0.7, -0.2, 2.5), Hold((0.025, -0.05, 0.1), 0.1)]


@pytest.mark.parametrize("motion", MOTIONS, ids=repr)
@pytest.mark.parametrize("t", [0.0, 0.3, 1.1, 1.996])
def test_motion_each_derivative_is_the_finite_difference_of_the_one_before(motion, t):
    h = 1e-5
    before, now, after = motion.at(t - h), motion.at(t), motion.at(t + h)
    pairs = [
        ("position", "velocity"),
        ("velocity", "acceleration"),
        ("yaw", "yaw_rate"),
        ("yaw_rate", "yaw_acceleration"),
    ]
    for quantity, derivative in pairs:
        difference = (getattr(after, quantity) - getattr(before, quantity)) / (2 * h)
        np.testing.assert_allclose(difference, getattr(now, derivative), rtol=1e-6, atol=1e-6)
    # The angular velocity is that of the rotation: dR/dt = ω × R, column by column.
    turning = (after.rotation - before.rotation) / (2 * h)
    spin = np.cross(now.angular_velocity, now.rotation.T).T
    np.testing.assert_allclose(turning, spin, rtol=0, atol=1e-6)


def test_motion_the_papers_circle():
    start, half = CIRCLE.at(0), CIRCLE.at(1.0)
    np.testing.assert_allclose(start.position, [0.05, 0.05, 0.1], atol=1e-15)
    np.testing.assert_allclose(half.position, [0, 0.05, 0.1], atol=1e-15)
    np.testing.assert_allclose(CIRCLE.at(2.0).position, start.position, atol=1e-15)
    for t in np.linspace(0, 2, 17):
        state = CIRCLE.at(t)
        assert np.linalg.norm(state.position - CIRCLE.centre) == pytest.approx(0.025)
        assert state.position[2] == 0.1
        # Centripetal: v²/r towards the centre.
        v = np.linalg.norm(state.velocity)
        assert v == pytest.approx(2 * math.pi * 0.025 / 2)
        assert np.linalg.norm(state.acceleration) == pytest.approx(v**2 / 0.025)
    assert CIRCLE.at(0.25).yaw == pytest.approx(math.pi / 8)
    assert CIRCLE.at(0.25).yaw_acceleration == pytest.approx(-math.pi / 8 * (2 * math.pi) ** 2)


def test_motion_rotation_turns_counterclockwise_seen_from_above():
    quarter = Hold((0, 0, 0), math.pi / 2).at(0).rotation
    np.testing.assert_allclose(quarter @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_motion_holding_weight():
    np.testing.assert_allclose(wrench(0.25, np.eye(3)), [0, 0, 0.25 * 9.81, 0, 0, 0], rtol=1e-15)
    np.testing.assert_array_equal(wrench(0.25, 1e-4, gravity=0), np.zeros(6))


def test_motion_euler_equation_in_world_axes():
    """The torque is the finite difference of the angular momentum R I0 R.T ω of a spinning body."""
    rng = np.random.default_rng(0)
    I0 = np.diag([1.0, 2.0, 2.5])
    axis = np.array([0.36, 0.48, 0.8])
    K = np.cross(axis, np.eye(3)).T  # K v = axis × v

    def momentum(t):  # about a fixed axis by the angle 0.3 + t² (rate 2t)
        angle = 0.3 + t**2
        R = np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K
        return R @ I0 @ R.T @ (2 * t * axis), R @ I0 @ R.T

    t, h = 0.7, 1e-5
    expected = (momentum(t + h)[0] - momentum(t - h)[0]) / (2 * h)
    a = rng.standard_normal(3)
    f = wrench(3.0, momentum(t)[1], a, 2 * t * axis, 2 * axis)
    np.testing.assert_allclose(f[3:], expected, rtol=1e-8)
    np.testing.assert_allclose(f[:3] / 3.0 - a, [0, 0, 9.81], atol=1e-14)


def test_motion_scalar_inertia_is_the_moment_about_the_vertical():
    tensor = np.diag([1e-4, 2e-4, 3e-4])
    state = CIRCLE.at(0.4)
    arguments = (state.acceleration, state.angular_velocity, state.angular_acceleration)
    np.testing.assert_allclose(
        wrench(0.25, 3e-4, *arguments), wrench(0.25, tensor, *arguments), rtol=1e-14
    )


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: wrench(0, 1e-4), "mass: got 0.0 kg"),
        (lambda: wrench(1, 0.0), "inertia: got 0.0 kg"),
        (lambda: wrench(1, np.eye(2)), r"inertia: got shape \(2, 2\), expected shape \(3, 3\)"),
        (lambda: wrench(1, np.triu(np.ones((3, 3)))), "inertia: .* symmetric"),
        (lambda: wrench(1, np.diag([1, 1, -1.0])), "inertia: got a least principal moment of -1"),
        (lambda: wrench(1, 1e-4, angular_velocity=[1, 0, 0]), "inertia: got a scalar"),
        (lambda: wrench(1, 1e-4, [0, 0]), r"acceleration: got shape \(2,\)"),
        (lambda: wrench(1, 1e-4, gravity=float("nan")), "gravity: got nan"),
        (lambda: Circle((0, 0), 1, 1), r"centre: got shape \(2,\)"),
        (lambda: Circle((0, 0, 0), 0, 1), "radius: got 0.0 m"),
        (lambda: Circle((0, 0, 0), 1, -1), "period: got -1.0 s"),
        (lambda: Circle((0, 0, 0), 1, 1, 1, 0), "yaw_frequency: got 0.0 Hz"),
        (lambda: CIRCLE.at(float("inf")), "t: got inf"),
        (lambda: Hold((0, 0, 0)).at(float("nan")), "t: got nan"),
        (lambda: Hold(("a", 0, 0)), "position: got type"),
    ],
)
def test_motion_bad_input_names_the_argument(call, text):
    with pytest.raises(gf.InvalidInputError, match=text):
        call()


@pytest.mark.parametrize("motion", MOTIONS, ids=repr)
def test_motions_are_values(motion):
    assert pickle.loads(pickle.dumps(motion)) == motion
    assert eval(repr(motion)) == motion
    assert hash(motion) == hash(pickle.loads(pickle.dumps(motion)))
    assert Hold([0, 0, 1]) == Hold(np.array([0.0, 0, 1]))


@pytest.mark.parametrize(
    "motion",
    [
        Move(np.array([0.1, 0.0, 0.2]), np.array([0.0, 0.03, -0.01]), 0.1, 0.7),
        Sway(np.zeros(3), np.array([0.05, 0.02, -0.04]), 0.15, 0.2, 1.5),
        Screw(np.zeros(3), 2.0, 1.5, 0.3, 0.0036),
    ],
    ids=lambda motion: type(motion).__name__,
)
def test_motions_from_rest_have_the_derivatives_that_they_say(motion):
    h = 1e-5
    for t in np.linspace(0.0513, 2.0, 40):
        before, state, after = motion.at(t - h), motion.at(t), motion.at(t + h)
        for rate, name in (("velocity", "position"), ("acceleration", "velocity")):
            slope = (getattr(after, name) - getattr(before, name)) / (2 * h)
            np.testing.assert_allclose(getattr(state, rate), slope, atol=2e-4)
        assert state.yaw_rate == pytest.approx((after.yaw - before.yaw) / (2 * h), abs=1e-6)
        slope = (after.yaw_rate - before.yaw_rate) / (2 * h)
        assert state.yaw_acceleration == pytest.approx(slope, abs=2e-3)


def test_motions_from_rest_arrive():
    move = Move(np.zeros(3), np.array([0.01, 0.0, 0.0]), 0.3, 0.7)
    np.testing.assert_array_equal(move.at(0.2).position, 0)
    np.testing.assert_allclose(move.at(1.1).position, [0.01, 0, 0])
    screw = Screw(np.zeros(3), 7.0, 0.5, 0.4, 0.0036)
    assert screw.at(screw.duration).yaw == pytest.approx(7.0)
    assert screw.at(screw.duration + 1).yaw_rate == 0
    assert screw.at(99.0).position[2] == pytest.approx(0.0036 * 7.0 / (2 * np.pi))


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: Move((0, 0, 0), (0, 0, 1), 0.0, 0.0), "duration"),
        (lambda: Sway((0, 0, 0), (0, 0, 1), 0.1, 0.0, -1.0), "period"),
        (lambda: Screw((0, 0, 0), 0.0, 1.0, 0.1, 0.01), "angle"),
        (lambda: Screw((0, 0, 0), 1.0, 0.0, 0.1, 0.01), "rate"),
        (lambda: Screw((0, 0, 0), 1.0, 1.0, 0.0, 0.01), "ramp"),
    ],
)
def test_motions_from_rest_need_positive_times_and_rates(make, name):
    with pytest.raises(gf.InvalidInputError, match=f"^{name}: got .*, expected more than 0"):
        make()
