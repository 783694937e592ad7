"""Wishes in newtons and shares: met, as another solver confirms, or refused, with what can be."""

import numpy as np
import pytest
from clarabel_oracle import random_problem
from conftest import ALLEGRO

import graspforce as gf
from graspforce.baselines import socp
from graspforce.scenarios import paper

firmness = gf.firmness


def allegro():
    return [problem for _, problem in gf.files.read(ALLEGRO)]


def feasible(count, seed=0):
    """Random grasps of 3 to 6 contacts with all kinds of limits that have an answer."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        problem = random_problem(rng)
        if gf.solve(problem).status is gf.Status.SOLVED:
            found.append(problem)
    return found


def least_by_clarabel(problem):
    solution = socp.solve(problem)
    assert solution.status is gf.Status.SOLVED
    return solution.normal_forces.max()


def some_grasps():
    return [p for p in allegro() if gf.solve(p).status is gf.Status.SOLVED] + feasible(15)


# ---- the least possible force ------------------------------------------------------------------


def test_the_least_largest_normal_force_is_enclosed_to_a_millionth_with_proof():
    for problem in some_grasps():
        edge = firmness.least(problem)
        assert 0 <= edge.upper - edge.lower <= 1e-6 * edge.upper
        assert edge.lower * (1 - 1e-7) <= least_by_clarabel(problem) <= edge.upper * (1 + 1e-7)
        assert edge.solution.verify().ok
        assert edge.solution.normal_forces.max() <= edge.upper
        # The proof is of the problem with a ceiling just below the bound.
        below = edge.solution.problem
        ceilings = len(below.b) - len(problem.b)
        lowered = np.append(problem.b, np.full(ceilings, edge.lower * (1 - 1e-9)))
        assert gf.check_certificate(below.replace(b=lowered), edge.certificate)


def test_the_least_force_of_a_grasp_without_an_answer_is_none():
    heavy = allegro()[0]
    edge = firmness.least(heavy.replace(f=1e4 * heavy.f))
    assert not edge.found
    assert edge.solution.status is gf.Status.INFEASIBLE


# ---- wishes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("times", [1.02, 1.5, 4.0])
def test_a_multiple_of_the_least_force_is_met_within_a_hundredth(times):
    met, costs = 0, []
    for problem in some_grasps():
        grip = firmness.choose(problem, times_least=times)
        costs.append(grip.solves)
        truth = least_by_clarabel(problem)
        assert grip.solution.status is gf.Status.SOLVED
        assert abs(grip.least / truth - 1) < 0.005
        if grip.met:
            met += 1
            assert abs(grip.largest_normal / truth / times - 1) <= 0.01
            assert grip.solution.verify().ok
        else:
            assert "cannot be had" in grip.message
            firm = gf.solve(problem.replace(alpha=1e-4)).normal_forces.max()
            assert firm < 1.02 * times * truth
    assert met > 5
    assert np.median(costs) <= 10
    assert max(costs) <= 25


def test_a_slip_reserve_holds_with_that_much_less_friction():
    problem = allegro()[0]
    grip = firmness.choose(problem, slip_reserve=0.3)
    assert grip.met
    assert grip.slip_reserve > 0.3
    mu = problem.mu[0]
    slippery = problem.replace(models=gf.PCWF(0.7 * mu))
    assert gf.Solution(grip.solution._outcome, slippery).friction_margins.min() > 0
    assert grip.alpha == problem.alpha


def test_a_slip_reserve_counts_the_torsion_of_soft_fingers():
    rng = np.random.default_rng(3)
    found = 0
    while found < 5:
        problem = random_problem(rng)
        if 4 not in problem.layout.dims or gf.solve(problem).status is not gf.Status.SOLVED:
            continue
        grip = firmness.choose(problem, slip_reserve=0.1)
        if not grip.met:
            continue
        found += 1
        assert grip.solution.problem.gamma[problem.gamma != 1] == pytest.approx(
            0.9 * problem.gamma[problem.gamma != 1]
        )
        less = [
            gf.SFC(0.9 * model.mu, 0.9 * model.gamma) if isinstance(model, gf.SFC)
            else gf.PCWF(0.9 * model.mu) if isinstance(model, gf.PCWF) else model
            for model in problem.models
        ]  # fmt: skip
        assert (
            gf.Solution(grip.solution._outcome, problem.replace(models=less)).friction_residual > 0
        )


def test_a_torque_reserve_is_kept_at_both_ends():
    problem = allegro()[0]
    firm = problem.replace(alpha=0.01)  # whose torques would come near the limits
    assert np.abs(gf.solve(firm).tau).max() > 0.9 * 0.7
    grip = firmness.choose(firm, torque_reserve=0.2)
    assert grip.met
    assert np.abs(grip.solution.tau).max() < 0.8 * 0.7
    assert grip.torque_reserve > 0.2


def test_a_largest_normal_force_is_a_ceiling_whatever_the_engagement():
    problem = allegro()[0].replace(c_max=20, engagement=[1, 0.5, 1, 1])
    free = gf.solve(problem).normal_forces.max()
    grip = firmness.choose(problem, largest_normal=0.5 * free)
    assert grip.met
    assert grip.largest_normal < 0.5 * free


def test_all_wishes_hold_together():
    problem = allegro()[0]
    grip = firmness.choose(
        problem, times_least=2, slip_reserve=0.2, torque_reserve=0.3, largest_normal=15
    )
    assert grip.met
    assert grip.slip_reserve > 0.2
    assert grip.torque_reserve > 0.3
    hard = problem.replace(models=gf.PCWF(0.8 * problem.mu[0]), tau_lo=-0.49, tau_hi=0.49)
    assert abs(grip.largest_normal / least_by_clarabel(hard) / 2 - 1) <= 0.01


def test_firmer_wishes_are_firmer():
    problem = allegro()[0]
    forces = [firmness.choose(problem, times_least=k).largest_normal for k in (1.1, 1.5, 2, 3, 5)]
    assert forces == sorted(forces)
    bounds = [
        firmness.choose(problem, times_least=2, slip_reserve=r).least for r in (0.0, 0.1, 0.2, 0.3)
    ]
    assert bounds == sorted(bounds)


# ---- refusals ----------------------------------------------------------------------------------


def test_a_force_below_the_least_is_refused_with_the_least():
    problem = allegro()[0]
    truth = least_by_clarabel(problem)
    grip = firmness.choose(problem, largest_normal=0.5 * truth)
    assert not grip.met
    said = f"largest_normal={0.5 * truth:g} cannot be had: at least "
    assert grip.message.startswith(said)
    assert grip.message.endswith(" N are needed")
    assert abs(float(grip.message.removeprefix(said).split()[0]) / truth - 1) < 0.006
    assert grip.solution.status is gf.Status.SOLVED
    assert grip.largest_normal <= 1.002 * truth


def test_wishes_that_exclude_each_other_are_named_both():
    problem = allegro()[0]
    force = 1.05 * least_by_clarabel(problem)
    grip = firmness.choose(problem, largest_normal=force, slip_reserve=0.3, torque_reserve=0.1)
    assert not grip.met
    said = f"largest_normal={force:g} and slip_reserve=0.3 exclude each other: at least "
    assert grip.message.startswith(said)
    slippery = problem.replace(models=gf.PCWF(0.7 * problem.mu[0]), tau_lo=-0.63, tau_hi=0.63)
    needed = float(grip.message.removeprefix(said).split()[0])
    assert abs(needed / least_by_clarabel(slippery) - 1) < 0.01
    assert grip.message.endswith("N are needed with slip_reserve=0.3 and torque_reserve=0.1")
    assert grip.slip_reserve > 0.3


def test_times_the_least_above_the_largest_normal_force_names_both():
    problem = allegro()[0]
    force = 2 * least_by_clarabel(problem)
    grip = firmness.choose(problem, largest_normal=force, times_least=3)
    assert not grip.met
    assert "times_least=3 and largest_normal=" in grip.message
    assert grip.largest_normal < force


def test_a_share_that_is_too_large_is_refused_with_the_largest():
    problem = allegro()[0]
    for name in ("slip_reserve", "torque_reserve"):
        grip = firmness.choose(problem, **{name: 0.97})
        assert not grip.met
        share = float(grip.message.split(f"at most {name}=")[1].split()[0])
        assert firmness.choose(problem, **{name: share - 0.01}).met
        assert not firmness.choose(problem, **{name: share + 0.01}).met
        assert getattr(grip, name) >= share - 0.002


def test_a_grasp_without_an_answer_says_so():
    problem = allegro()[0]
    for broken, word in ((problem.replace(f=1e3 * problem.f), "violation"),
                         (problem.replace(J=None, tau_lo=None, tau_hi=None), "c_max")):  # fmt: skip
        grip = firmness.choose(broken, times_least=2)
        assert not grip.met
        assert grip.message.startswith("no wish can be met")
        assert word in grip.message


def test_no_load_has_no_multiple():
    problem = allegro()[0]
    grip = firmness.choose(problem.replace(f=np.zeros(6)), times_least=2)
    assert not grip.met
    assert "largest_normal" in grip.message


@pytest.mark.parametrize(
    ("wishes", "text"),
    [
        ({}, "no wish: expected largest_normal"),
        ({"times_least": 1.0}, "times_least: got 1, expected more than 1"),
        ({"times_least": np.nan}, "times_least: got nan"),
        ({"slip_reserve": 1.0}, "slip_reserve: got 1, expected 0 or more, below 1"),
        ({"slip_reserve": -0.1}, "slip_reserve: got -0.1"),
        ({"torque_reserve": "much"}, "torque_reserve: got type"),
        ({"largest_normal": 0}, "largest_normal: got 0"),
    ],
)
def test_wishes_out_of_range_are_refused(wishes, text):
    with pytest.raises(gf.InvalidInputError, match=text):
        firmness.choose(allegro()[0], **wishes)


def test_wishes_about_what_is_not_there_are_refused():
    bare = allegro()[0].replace(J=None, tau_lo=None, tau_hi=None, c_max=20)
    with pytest.raises(gf.InvalidInputError, match="torque_reserve: the problem has no joints"):
        firmness.choose(bare, torque_reserve=0.1)
    cables = gf.ForceProblem(np.eye(3), [1, 1, 1], gf.FPC(), c_max=9)
    with pytest.raises(gf.InvalidInputError, match="slip_reserve: no contact of the problem"):
        firmness.choose(cables, slip_reserve=0.1)
    with pytest.raises(gf.InvalidInputError, match="got 2 N, expected more than 3 N, the largest"):
        firmness.choose(bare.replace(c_min=3), largest_normal=2)
    with pytest.raises(gf.InvalidInputError, match="problem: got"):
        firmness.choose(3, slip_reserve=0.1)
    for rtol in (0, 1, "x"):
        with pytest.raises(gf.InvalidInputError, match="rtol"):
            firmness.least(bare, rtol=rtol)


# ---- in a loop ---------------------------------------------------------------------------------


def test_a_firm_servo_keeps_its_wishes_smoothly_in_few_steps():
    problems = list(paper.dynamic().problems())
    servo = firmness.FirmServo(problems[0], times_least=3, slip_reserve=0.1)
    grips = [servo.step(W=p.W, f=p.f, J=p.J) for p in problems]
    assert all(grip.solution.status is gf.Status.SOLVED for grip in grips)
    assert min(grip.slip_reserve for grip in grips) > 0.1
    firm = np.array([grip.times_least for grip in grips])
    assert np.abs(firm / 3 - 1).max() < 0.1
    for grip, problem in list(zip(grips, problems, strict=True))[::50]:
        slippery = problem.replace(models=gf.PCWF(0.9 * problem.mu[0]))
        assert abs(grip.least / least_by_clarabel(slippery) - 1) < 0.005
    steps = [grip.solution.newton_steps for grip in grips[1:]]
    assert max(steps) <= 2
    moves = np.linalg.norm(np.diff([grip.solution.c for grip in grips], axis=0), axis=1)
    assert (moves[1:-1] <= 5 * np.maximum(moves[:-2], moves[2:])).all()


def test_a_firm_servo_reports_a_tick_without_an_answer_and_goes_on():
    problem = allegro()[0]
    servo = firmness.FirmServo(problem, times_least=2)
    assert servo.step().met
    lost = servo.step(f=1e3 * problem.f)
    assert not lost.met
    assert lost.solution.status is gf.Status.INFEASIBLE
    assert servo.step(f=problem.f).met


def test_a_firm_servo_is_as_it_was_after_a_wrong_argument():
    problem = allegro()[0]
    servo = firmness.FirmServo(problem, largest_normal=10)
    before = servo.problem
    with pytest.raises(gf.InvalidInputError, match="f: got shape"):
        servo.step(f=[1, 2])
    assert servo.problem == before
    assert servo.step(f=problem.f).met


def test_friction_that_drops_is_followed_as_fast_as_the_rate_limits_allow():
    problem = allegro()[0].replace(alpha=1e3)
    limited = problem.replace(c_last=gf.solve(problem).c, dc_max=0.2)
    servo = firmness.FirmServo(limited, slip_reserve=0.05)
    last, statuses = np.array(limited.c_last), []
    for tick in range(60):
        grip = servo.step(models=gf.PCWF(0.5 if tick < 20 else 0.35))
        statuses.append(grip.solution.status)
        assert np.abs(grip.c - last).max() < 0.2
        assert np.abs(problem.W @ grip.c - problem.f).max() < 1e-9
        if grip.met:
            assert grip.slip_reserve > 0.05
        else:
            assert gf.check_certificate(grip.solution.problem, grip.solution.certificate)
            assert grip.message.startswith("the rate limits admit no force within all the other")
        last = grip.c
        assert np.array_equal(servo.problem.c_last, last)
    late = statuses.index(gf.Status.INFEASIBLE, 20)
    assert late == 20
    assert statuses[-10:] == [gf.Status.SOLVED] * 10


def test_in_physics_less_friction_than_assumed_holds_with_a_slip_reserve_and_drops_without():
    pytest.importorskip("mujoco")
    from graspforce import sim
    from graspforce.sim.scenes import cube

    assumed = paper.static().problem(0.0).replace(alpha=1e3)  # a light grip
    outcome = {}
    for reserve in (0.0, 0.4):
        grip = firmness.choose(assumed, slip_reserve=reserve)
        assert grip.met
        trial = cube.trial(
            "hold", "with 30 % less friction", paper.AT_REST, 0.7 * 0.5,
            mu=grip.solution.problem.mu[0], alpha=grip.alpha, duration=0.4,
        )  # fmt: skip
        outcome[reserve] = sim.run(trial).position_error.max()
    assert outcome[0.4] < 1e-3 < 0.02 < outcome[0.0]
