"""The wrench that brings an object to where it should be, on rigid bodies integrated here."""

import copy
import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import graspforce as gf
from graspforce.control import ObjectLaw, ObjectState
from graspforce.control.object_law import rotation_vector
from graspforce.trajectory import Circle, Hold

INERTIA = np.array([[3.0, 0.4, -0.2], [0.4, 2.0, 0.3], [-0.2, 0.3, 1.5]]) * 1e-3
GRAVITY = np.array([0.3, -0.2, -9.6])


def fall(law, motion, state, seconds, dt=2e-4):
    """Yield a rigid body's states under the law, by the midpoint rule in body axes."""

    def rates(state, t):
        f = law.wrench(law.acceleration(motion.at(t), state), state, GRAVITY)
        R, omega = state.rotation, state.angular_velocity
        inertia = R @ INERTIA @ R.T
        spin = np.linalg.solve(inertia, f[3:] - np.cross(omega, inertia @ omega))
        return f[:3] / 0.2 + GRAVITY, spin

    def moved(state, by, linear, spin, velocity, omega):
        return ObjectState(
            state.position + by * velocity,
            (Rotation.from_rotvec(by * omega) * Rotation.from_matrix(state.rotation)).as_matrix(),
            state.velocity + by * linear, state.angular_velocity + by * spin,
        )  # fmt: skip

    for k in range(round(seconds / dt)):
        t = k * dt
        half = moved(state, dt / 2, *rates(state, t), state.velocity, state.angular_velocity)
        middle = rates(half, t + dt / 2)
        state = moved(state, dt, *middle, half.velocity, half.angular_velocity)
        yield t + dt, state


@pytest.mark.parametrize(("stiffness", "damping"), [(400.0, 40.0), (900.0, 20.0)])
def test_errors_fall_off_as_the_gains_say(stiffness, damping):
    """Both of position and of rotation: ë + d ė + k e = 0, whatever the mass and the inertia."""
    law = ObjectLaw(0.2, INERTIA, stiffness=stiffness, damping=damping)
    offset, axis = np.array([0.01, -0.02, 0.005]), np.array([0.6, 0.0, 0.8])
    start = ObjectState(
        offset, Rotation.from_rotvec(0.3 * axis).as_matrix(), np.zeros(3), np.zeros(3)
    )
    rates = np.array([[0, 1], [-stiffness, -damping]])
    for t, state in fall(law, Hold((0, 0, 0)), start, 0.3):
        share = expm(t * rates)[0, 0]  # of an error that is let go at rest
        assert_allclose(state.position, offset * share, atol=1e-6)
        assert_allclose(rotation_vector(state.rotation), 0.3 * axis * share, atol=1e-5)


@pytest.mark.parametrize("gains", [{"stiffness": 0, "damping": 0}, {}])
def test_a_body_that_is_on_its_way_stays_on_it(gains):
    """The feed-forward of what a target does: inertia, weight, gyroscopic torque."""
    motion = Circle((0.1, 0.0, 0.2), radius=0.05, period=0.8, yaw_amplitude=0.4)
    turned = Rotation.from_rotvec([0.5, -1.0, 0.7]).as_matrix()
    law, first = ObjectLaw(0.2, INERTIA, turned=turned, **gains), motion.at(0)
    start = ObjectState(
        first.position, first.rotation @ turned, first.velocity, first.angular_velocity
    )
    for t, state in fall(law, motion, start, 0.8):
        target = motion.at(t)
        assert_allclose(state.position, target.position, atol=1e-6)
        assert_allclose(state.rotation, target.rotation @ turned, atol=1e-5)


def test_gains_that_are_changed_count_and_a_copy_has_them():
    law = ObjectLaw(0.2, INERTIA)
    law.stiffness, law.mass = 100.0, 0.5
    state = ObjectState(np.array([0, 0, 0.01]), np.eye(3), np.zeros(3), np.zeros(3))
    for each in (law, copy.deepcopy(law), pickle.loads(pickle.dumps(law))):
        wanted = each.acceleration(Hold((0, 0, 0)).at(0), state)
        assert_allclose(wanted, [0, 0, -1, 0, 0, 0])
        assert_allclose(each.wrench(wanted, state, np.zeros(3)), [0, 0, -0.5, 0, 0, 0])


def test_the_wrench_at_rest_holds_the_weight():
    law = ObjectLaw(0.2, INERTIA)
    state = ObjectState(np.ones(3), np.eye(3), np.zeros(3), np.zeros(3))
    f = law.wrench(law.acceleration(Hold((1, 1, 1)).at(0), state), state)
    assert_allclose(f, [0, 0, 0.2 * 9.81, 0, 0, 0], atol=1e-12)


def test_rotation_vectors_are_scipys(rng):
    vectors = rng.normal(size=(300, 3))
    lengths = np.concatenate((rng.uniform(0, np.pi, 200), np.pi - np.logspace(-9, -1, 100)))
    vectors *= lengths[:, None] / np.linalg.norm(vectors, axis=1)[:, None]
    small = 1e-7 * rng.normal(size=(10, 3))
    for vector in np.concatenate((vectors, small, np.zeros((1, 3)))):
        R = Rotation.from_rotvec(vector).as_matrix()
        assert_allclose(rotation_vector(R), vector, rtol=1e-9, atol=1e-15)
    for axis in np.eye(3):  # half a turn goes either way
        assert_allclose(np.abs(rotation_vector(2 * np.outer(axis, axis) - np.eye(3))), np.pi * axis)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"mass": 0}, "mass: got 0"),
        ({"mass": np.nan}, "mass: got nan"),
        ({"inertia": np.eye(2)}, r"inertia: got shape \(2, 2\)"),
        ({"inertia": np.diag([1.0, 1.0, 0.0])}, r"got \[\[1.0, 0.0, 0.0\], .* positive definite"),
        ({"inertia": np.eye(3) + np.eye(3, k=1)}, "expected a symmetric, positive definite matrix"),
        ({"stiffness": -1}, "stiffness: got -1"),
        ({"damping": -1}, "damping: got -1"),
        ({"turned": np.ones(3)}, r"turned: got shape \(3,\)"),
        ({"turned": 2 * np.eye(3)}, r"turned: got \[\[2.0, 0.0, 0.0\], .* expected a rotation"),
        ({"turned": -np.eye(3)}, "expected a rotation matrix"),
    ],
)
def test_what_is_no_body_or_no_gain_is_refused(arguments, said):
    with pytest.raises(gf.InvalidInputError, match=said):
        ObjectLaw(**{"mass": 0.2, "inertia": INERTIA} | arguments)


def test_a_state_is_what_can_be_read_as_one():
    law, target = ObjectLaw(0.2, INERTIA), Hold((0, 0, 0)).at(0)
    state = ObjectState([0, 0, 0.01], np.eye(3).tolist(), (0, 0, 0), (0, 0, 0))
    assert_allclose(law.acceleration(target, state), [0, 0, -4, 0, 0, 0])
    with pytest.raises(gf.InvalidInputError, match=r"rotation: got shape \(4,\)"):
        ObjectState(np.zeros(3), [1, 0, 0, 0], np.zeros(3), np.zeros(3))
    lost = ObjectState(np.array([0, np.nan, 0]), np.eye(3), np.zeros(3), np.zeros(3))
    with pytest.raises(gf.InvalidInputError, match="expected finite numbers"):
        law.acceleration(target, lost)
    with pytest.raises(gf.InvalidInputError, match=r"acceleration\[0\]: got nan"):
        law.wrench(np.full(6, np.nan), state)
    spun = ObjectState(np.zeros(3), np.eye(3), np.zeros(3), np.full(3, 1e200))
    with pytest.raises(gf.InvalidInputError, match="gravity: got numbers"):
        law.wrench(np.zeros(6), spun)
