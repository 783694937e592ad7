"""Section IV as data: the problems are right, and the numbers are the paper's."""

from __future__ import annotations

import csv
import dataclasses
import functools
import pickle

import numpy as np
import pytest

import graspforce as gf
from graspforce import scenarios
from graspforce.hands import PaperHand
from graspforce.trajectory import Hold

# Finger 1 starts to let go, is gone for the first time, and is there again for the first time.
RAMP, LEAVES, BACK = 63, 125, 376


@functools.cache
def dynamic() -> scenarios.Log:
    return scenarios.run(scenarios.dynamic())


@functools.cache
def regrasp(c_max: float, shape: str = "linear") -> scenarios.Log:
    return scenarios.run(scenarios.regrasp(c_max, shape))


@functools.cache
def sweep() -> scenarios.AlphaSweep:
    return scenarios.sweep_alpha()


# ---- the data ----------------------------------------------------------------------------------


def test_scenario_ticks_at_250_hz_for_two_seconds():
    times = scenarios.dynamic().times
    assert len(times) == 500
    np.testing.assert_allclose(times, np.arange(500) / 250, rtol=0, atol=1e-15)
    assert len(scenarios.dynamic(rate=1000, duration=0.5).times) == 500


@pytest.mark.parametrize("name", scenarios.NAMES)
def test_contacts_are_on_the_cubes_sides_and_face_their_fingers(name):
    scenario = scenarios.get(name)
    for t in (0.0, 0.4, 1.7):
        state = scenario.state(t)
        for i, contact in enumerate(scenario.contacts_at(t)):
            assert np.linalg.norm(contact.point - state.position) == pytest.approx(0.0375)
            into = (state.position - contact.point) / 0.0375
            np.testing.assert_allclose(contact.normal, into, atol=1e-12)
            np.testing.assert_allclose(contact.tangent, [0, 0, 1], atol=1e-15)
            assert -contact.normal @ scenario.hand.bases[i] > 0.9 * 0.05
        tips = scenario.hand.forward_kinematics(scenario.joint_angles(t))
        points = [contact.point for contact in scenario.contacts_at(t)]
        np.testing.assert_allclose(tips, points, atol=1e-14)


def test_the_grasp_map_is_constant_in_the_cubes_own_axes():
    scenario = scenarios.dynamic()
    W0 = scenario.problem(0.0).W
    for t in (0.2, 0.8, 1.9):
        R = scenario.state(t).rotation
        to_cube = np.kron(np.eye(2), R.T)
        np.testing.assert_allclose(to_cube @ scenario.problem(t).W, W0, atol=1e-15)


@pytest.mark.parametrize("hand", [scenarios.dynamic().hand, PaperHand("radial")], ids=repr)
def test_the_jacobian_makes_the_fingertips_follow_the_cube(hand):
    """J q̇ is the contacts' velocity in the contact frames, q̇ from the inverse kinematics."""
    scenario, h = scenarios.dynamic(hand=hand), 1e-6
    for t in (0.1, 0.63, 1.4):
        ahead, behind = scenario.joint_angles(t + h), scenario.joint_angles(t - h)
        q_rate = ((ahead - behind + np.pi) % (2 * np.pi) - np.pi) / (2 * h)
        contacts, state = scenario.contacts_at(t), scenario.state(t)
        velocity = [
            contact.frame.T
            @ (state.velocity + np.cross(state.angular_velocity, contact.point - state.position))
            for contact in contacts
        ]
        J = scenario.problem(t).J
        np.testing.assert_allclose(J @ q_rate, np.concatenate(velocity), rtol=0, atol=1e-7)


def test_the_wrench_holds_the_cube_up_turns_it_and_carries_it_round():
    scenario = scenarios.dynamic()
    inertia = 0.25 * 0.075**2 / 6
    for t in (0.0, 0.25, 1.3):
        state = scenario.state(t)
        force = 0.25 * (state.acceleration + np.array([0, 0, 9.81]))
        expected = [*force, 0, 0, inertia * state.yaw_acceleration]
        np.testing.assert_allclose(scenario.problem(t).f, expected, atol=1e-15)
    at_rest = scenarios.static().problem(1.0)
    np.testing.assert_allclose(at_rest.f, [0, 0, 0.25 * 9.81, 0, 0, 0], atol=1e-15)
    assert at_rest == scenarios.static().problem(0.0)


def test_scenario_only_regrasp_has_ceilings_and_its_engagement_is_the_papers():
    assert not scenarios.dynamic().problem(0.0).layout.ceilings
    scenario = scenarios.regrasp(30.0)
    for t, w in [(0, 1), (0.25, 1), (0.375, 0.5), (0.5, 0), (1.0, 0), (1.5, 0), (1.625, 0.5)]:
        problem = scenario.problem(t)
        np.testing.assert_allclose(problem.engagement, [w, 1, 1, 1], atol=1e-12)
        np.testing.assert_array_equal(problem.c_max, 30.0)


def test_scenarios_are_values():
    for name in scenarios.NAMES:
        scenario = scenarios.get(name)
        assert scenario == scenarios.get(name)
        copy = pickle.loads(pickle.dumps(scenario))
        assert copy == scenario
        assert hash(copy) == hash(scenario)
        assert copy.problem(0.3) == scenario.problem(0.3)
        with pytest.raises(AttributeError):
            scenario.alpha = 1.0
    assert scenarios.get("static", alpha=1.0) == scenarios.static(1.0)
    assert scenarios.get("regrasp", c_max=50.0) != scenarios.regrasp()


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: scenarios.get("dance"), "name: got 'dance', expected one of static, dynamic"),
        (lambda: scenarios.get("static", c_max=1.0), "c_max: not an option of scenario 'static'"),
        (lambda: scenarios.static(alpha=0), "alpha: got 0.0"),
        (lambda: scenarios.static(mu=-1), "PCWF.mu: got -1.0"),
        (lambda: scenarios.dynamic(rate=0), "rate: got 0.0 Hz"),
        (lambda: scenarios.dynamic(duration=1e-6), "duration: got 1e-06 s, expected at least one"),
        (lambda: scenarios.regrasp(c_max=-1), "c_max: got -1.0 N"),
        (lambda: scenarios.regrasp(shape="cubic"), "shape: got 'cubic'"),
        (lambda: scenarios.Cube(0.25, 0), "side: got 0.0 m"),
        (lambda: scenarios.Cube(float("inf"), 1), "mass: got inf"),
        (
            lambda: dataclasses.replace(scenarios.regrasp(), c_max=None),
            "c_max: missing; schedule came without it",
        ),
        (
            lambda: dataclasses.replace(
                scenarios.regrasp(), schedule=gf.regrasp.Schedule(contacts=3)
            ),
            "schedule: got one for 3 contacts, expected 4",
        ),
        (
            lambda: dataclasses.replace(
                scenarios.static(), contacts=scenarios.static().contacts[:2]
            ),
            "contacts: got 2, expected 4",
        ),
        (
            lambda: dataclasses.replace(
                scenarios.static(), motion=Hold((0, 0, 0.2))
            ).problem(0),
            r"points\[0\]: out of reach of finger 1: 0\.2\d* m from its base",
        ),
    ],
)  # fmt: skip
def test_scenario_bad_input_names_the_argument(call, text):
    with pytest.raises(gf.InvalidInputError, match=text):
        call()


# ---- Section IV-A: static ----------------------------------------------------------------------


def test_scenario_a_larger_alpha_grips_more_lightly():
    result = sweep()
    assert (result.status == gf.Status.SOLVED).all()
    assert result.alpha[0] == pytest.approx(0.01)
    assert result.alpha[-1] == pytest.approx(100)
    assert (np.diff(result.normal_forces.max(axis=1)) < 0).all()
    assert (np.diff(result.torque_residual) > 0).all()
    assert (np.diff(result.friction_residual) < 0).all()
    np.testing.assert_allclose(result.torque_residual, 0.5 - result.max_torque, atol=1e-15)


def test_scenario_static_numbers_of_the_paper():
    result = sweep()
    firm, light = result.normal_forces[0], result.normal_forces[-1]
    assert 5 < firm.min() < firm.max() < 10.5
    assert result.max_torque[0] == pytest.approx(0.498, abs=5e-4)
    assert 0.85 < light.min() < light.max() < 2.05
    assert result.max_torque[-1] == pytest.approx(0.11, abs=5e-3)


def test_scenario_sweep_takes_what_it_is_given_and_refuses_nonsense():
    one = scenarios.sweep_alpha([5.0], scenarios.static(hand=PaperHand("radial")))
    expected = gf.solve(scenarios.static(hand=PaperHand("radial")).problem(0))
    np.testing.assert_allclose(one.c, [expected.c], rtol=1e-12)
    for alphas, text in [([1.0, -1.0], r"alphas\[1\]: got -1"), ([], "alphas: got shape"),
                         ([[1.0]], "alphas: got shape")]:  # fmt: skip
        with pytest.raises(gf.InvalidInputError, match=text):
            scenarios.sweep_alpha(alphas)


# ---- Section IV-B.1: dynamic -------------------------------------------------------------------


def test_scenario_dynamic_numbers_of_the_paper():
    log = dynamic()
    assert (log.status == gf.Status.SOLVED).all()
    assert 0.18 < log.max_torque.min() < log.max_torque.max() < 0.26
    assert log.friction_residual.min() > 0.72
    assert 1.8 < log.normal_forces.min() < log.normal_forces.max() < 4.5


def test_scenario_dynamic_takes_one_newton_step_a_tick():
    log = dynamic()
    assert (log.newton_steps == 1).sum() >= 495
    assert log.newton_steps[2:].max() <= 2
    # A decrement of at most √(2e-9) bounds Phi(c) − Phi* by about 1e-9.
    assert log.suboptimality.max() <= 1.01e-9


@pytest.mark.parametrize("elbow", ["outward", "inward"])
@pytest.mark.parametrize("axis", ["palm_normal", "radial"])
def test_either_reading_of_the_hand_carries_the_cube_within_its_limits(axis, elbow):
    scenario = scenarios.dynamic(hand=PaperHand(axis, elbow), rate=50)
    log = scenarios.run(scenario)
    assert (log.status == gf.Status.SOLVED).all()
    assert log.max_torque.max() < 0.28
    assert log.friction_residual.min() > 0.5


def test_scenario_ticks_agree_with_cold_solves_and_verify():
    log, scenario = dynamic(), scenarios.dynamic()
    for k in (0, 1, 2, 137, 499):
        cold = gf.solve(scenario.problem(log.t[k]), gf.Settings(tol=1e-14))
        assert cold.verify().ok
        np.testing.assert_allclose(log.c[k], cold.c, atol=1e-4)
        np.testing.assert_allclose(
            log.tau[k], scenario.problem(log.t[k]).J.T @ log.c[k], atol=1e-15
        )


# ---- Section IV-B.2: regrasp -------------------------------------------------------------------

ceilings = pytest.mark.parametrize("c_max", [10.0, 20.0, 100.0])


@ceilings
def test_scenario_regrasp_fingers_2_and_4_rise_and_3_falls(c_max):
    log, away = regrasp(c_max), slice(LEAVES, BACK)
    assert (log.status == gf.Status.SOLVED).all()
    np.testing.assert_array_equal(log.normal_forces[away, 0], 0)
    np.testing.assert_array_equal(log.tau[away, :3], 0)
    assert (log.normal_forces[[LEAVES - 1, BACK], 0] > 0).all()
    before, after = log.normal_forces[RAMP], log.normal_forces[LEAVES]
    assert after[1] > before[1] + 0.2
    assert after[3] > before[3] + 0.2
    assert after[2] < before[2] - 0.5
    mean = log.normal_forces[away].mean(axis=0)
    assert 2.9 < mean[1] < 4
    assert 2.9 < mean[3] < 4
    assert 0.7 < mean[2] < 1.2
    # Beside the same motion with all four fingers: finger 3 has nothing left to oppose, and the
    # three have to work harder.
    four_fingers = dataclasses.replace(scenarios.regrasp(c_max), schedule=None)
    for k in range(LEAVES, BACK, 25):
        four = gf.solve(four_fingers.problem(log.t[k]), check=True)
        assert log.normal_forces[k, 2] < four.normal_forces[2] - 0.5
        assert log.max_torque[k] > np.abs(four.tau).max()


@ceilings
def test_scenario_regrasp_takes_few_newton_steps(c_max):
    log = regrasp(c_max)
    assert (log.newton_steps == 1).sum() >= 470
    assert log.newton_steps.max() <= 6


@pytest.mark.parametrize(
    ("c_max", "shape"), [(10.0, "linear"), (20.0, "linear"), (100.0, "linear"), (20.0, "smooth")]
)
def test_scenario_regrasp_forces_do_not_jump_when_the_finger_leaves_and_returns(c_max, shape):
    jumps = np.abs(np.diff(regrasp(c_max, shape).c, axis=0)).max(axis=1)
    for tick in (LEAVES, BACK):
        jump = jumps[tick - 1]
        assert jump <= 5 * max(jumps[tick - 2], jumps[tick])


def test_scenario_regrasp_forces_are_continuous_in_time():
    """Ever closer to the finger's leaving, the forces tend to those without it."""
    scenario = scenarios.regrasp()
    without = gf.solve(scenario.problem(0.5)).c
    gaps = [
        np.abs(gf.solve(scenario.problem(0.5 - dt), gf.Settings(tol=1e-14)).c - without).max()
        for dt in (1e-2, 1e-3, 1e-4)
    ]
    assert gaps[1] < 0.2 * gaps[0]
    assert gaps[2] < 0.2 * gaps[1]
    assert gaps[2] < 0.01


# ---- the log -----------------------------------------------------------------------------------


def test_scenario_progress_hears_of_every_tick():
    heard: list[int] = []
    scenarios.run(scenarios.dynamic(duration=0.02), progress=heard.append)
    assert heard == [0, 1, 2, 3, 4]


def test_scenario_log_arrays_fit_the_problems():
    scenario = scenarios.regrasp(duration=0.04)
    log = scenarios.run(scenario)
    T = 10
    shapes = {"t": (T,), "f": (T, 6), "engagement": (T, 4), "c": (T, 12), "tau": (T, 12),
              "normal_forces": (T, 4), "friction_residual": (T,), "torque_residual": (T,),
              "max_torque": (T,), "newton_steps": (T,), "suboptimality": (T,),
              "status": (T,)}  # fmt: skip
    assert {name: getattr(log, name).shape for name in shapes} == shapes
    for k, problem in enumerate(scenario.problems()):
        np.testing.assert_array_equal(log.f[k], problem.f)
        assert np.abs(problem.W @ log.c[k] - log.f[k]).max() < 1e-9
        np.testing.assert_array_equal(log.normal_forces[k], log.c[k, ::3])
        r_f = min(0.25 * n**2 - x**2 - y**2 for n, x, y in log.c[k].reshape(4, 3))
        assert log.friction_residual[k] == pytest.approx(r_f, rel=1e-12)
    assert repr(log) == "Log(regrasp: 10 ticks, 10 solved)"
    assert pickle.loads(pickle.dumps(log)).scenario == scenario


def test_scenario_csv_round_trip(tmp_path):
    soft = dataclasses.replace(
        scenarios.dynamic(duration=0.012),
        contacts=scenarios.dynamic().cube.side_contacts(gf.SFC(0.5, 0.01)),
    )
    log = scenarios.run(soft)
    log.write_csv(tmp_path / "log.csv")
    with (tmp_path / "log.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    for k, row in enumerate(rows):
        assert float(row["t [s]"]) == log.t[k]
        assert float(row["f_z [N]"]) == log.f[k, 2]
        assert float(row["m_z [Nm]"]) == log.f[k, 5]
        assert float(row["c2_normal [N]"]) == log.c[k, 4]
        assert float(row["c4_torsion [Nm]"]) == log.c[k, 15]
        assert float(row["tau_finger4_knee [Nm]"]) == log.tau[k, 11]
        assert float(row["friction_residual [N^2]"]) == log.friction_residual[k]
        assert int(row["newton_steps"]) == log.newton_steps[k]
        assert row["status"] == "SOLVED"
    assert len(rows[0]) == 1 + 6 + 4 + 16 + 12 + 6


def test_scenario_an_infeasible_tick_is_logged_not_raised(tmp_path):
    log = scenarios.run(scenarios.dynamic(mu=0.05, duration=0.008))
    assert (log.status == gf.Status.INFEASIBLE).all()
    assert repr(log) == "Log(dynamic: 2 ticks, 0 solved)"
    log.write_csv(tmp_path / "log.csv")
    assert "INFEASIBLE" in (tmp_path / "log.csv").read_text(encoding="utf-8")
