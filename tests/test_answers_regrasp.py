"""Which finger can leave, how far and how fast: by another solver, and from the data alone."""

import numpy as np
import pytest
from clarabel_oracle import critical_load, random_problem
from conftest import ALLEGRO

import graspforce as gf
from graspforce.baselines import socp

regrasp = gf.regrasp


def feasible(count, seed=0):
    rng = np.random.default_rng(seed)
    found = [p for _, p in gf.files.read(ALLEGRO) if gf.solve(p).status is gf.Status.SOLVED]
    while len(found) < count + 10:
        problem = random_problem(rng)
        if gf.solve(problem).status is gf.Status.SOLVED:
            found.append(problem)
    return found


def without(problem, i):
    """The problem with contact i and its joints cut out by hand."""
    kept = np.repeat(np.arange(problem.n) != i, problem.layout.dims)
    assert not problem.layout.ceilings
    joints = np.abs(problem.J[kept]).max(axis=0) > 0
    return gf.ForceProblem(
        problem.W[:, kept], problem.f, [m for j, m in enumerate(problem.models) if j != i],
        J=problem.J[kept][:, joints], tau_lo=problem.tau_lo[joints], tau_hi=problem.tau_hi[joints],
        alpha=problem.alpha,
    )  # fmt: skip


def test_a_finger_can_leave_where_clarabel_holds_the_load_without_it():
    yes = no = 0
    for problem in feasible(0):
        for i in range(problem.n):
            found = regrasp.can_leave(problem, i)
            other = socp.solve(without(problem, i))
            assert found.possible == (other.status is gf.Status.SOLVED)
            assert found.solution.verify().ok
            if found.possible:
                yes += 1
                own = slice(problem.starts[i], problem.starts[i + 1])
                assert not found.solution.c[own].any()
                assert found.certificate is None
            else:
                no += 1
                assert gf.check_certificate(found.solution.problem, found.certificate)
    assert yes
    assert no


def test_the_lowest_engagement_is_enclosed_with_proof():
    seen = 0
    for problem in feasible(0):
        limited = problem.replace(c_max=1.2 * gf.solve(problem).normal_forces.max())
        for i in range(problem.n):
            edge = regrasp.lowest_engagement(limited, i)
            if regrasp.can_leave(limited, i).possible:
                assert edge.upper == edge.lower == 0
                continue
            seen += 1
            assert edge.upper - edge.lower <= 1e-3 * edge.upper
            engagement = np.ones(problem.n)
            for share, status in (
                (edge.upper, gf.Status.SOLVED),
                (0.998 * edge.upper, gf.Status.INFEASIBLE),
            ):
                engagement[i] = share
                assert socp.solve(limited.replace(engagement=engagement)).status is status
    assert seen > 5


def test_the_next_to_lift_leaves_the_largest_multiple_of_the_load():
    for problem in (feasible(0)[0], *feasible(0)[-2:]):
        found = regrasp.next_to_lift(problem)
        for i, margin in enumerate(found.margins):
            if np.isnan(margin):
                assert not regrasp.can_leave(problem, i).possible
            else:
                assert margin == pytest.approx(critical_load(without(problem, i)), rel=0.02)
        left = np.isnan(found.margins).all()
        assert found.finger == (None if left else np.nanargmax(found.margins))
    heavy = problem.replace(f=1e3 * problem.f)
    assert regrasp.next_to_lift(heavy).finger is None


def test_the_payload_falls_with_the_engagement():
    problem = feasible(0)[0].replace(c_max=15)
    held = regrasp.payload_during_lift(problem, 2)
    assert held.shape == (11,)
    assert (np.diff(held) <= 1e-3 * held[:-1]).all()
    assert held[0] == pytest.approx(1 + gf.payload.along(problem, problem.f).lower, rel=2e-3)
    again = regrasp.payload_during_lift(problem, 2, engagements=[1, 0])
    assert again == pytest.approx(held[[0, -1]])


def test_the_shortest_ramp_keeps_every_limit_and_cannot_be_shortened():
    seen = 0
    for problem in feasible(8):
        if problem.layout.rate_limits:
            continue
        for i in range(problem.n):
            ramp = regrasp.shortest_ramp(problem, i, rate=20.0)
            if ramp is None:
                assert not regrasp.can_leave(problem, i).possible
                continue
            seen += 1
            assert ramp.least <= ramp.duration <= ramp.least * (1 + 2e-3)
            own = slice(problem.starts[i], problem.starts[i + 1])
            for t in np.linspace(0, ramp.duration, 7):
                c = ramp.at(t)
                floors = problem.replace(c_min=None)
                barriers = floors.barriers
                assert np.abs(problem.W @ c - problem.f).max() < 1e-8 * np.abs(problem.f).max()
                if t < ramp.duration:
                    assert gf.equations.strictly_inside(c, barriers)
            assert not ramp.at(ramp.duration)[own].any()
            step = np.abs(ramp.at(ramp.duration / 100) - ramp.at(0)).max()
            assert step <= 20.0 * ramp.duration / 100 * (1 + 1e-9)
            if seen < 12:  # by Clarabel no end is nearer
                near = 0.995 * ramp.duration
                alone = np.abs(ramp.start[own]).max() / 20.0
                if alone < near and not problem.layout.ceilings and not problem.layout.floors \
                        and not problem.layout.inequalities:  # fmt: skip
                    kept = np.repeat(np.arange(problem.n) != i, problem.layout.dims)
                    closer = without(problem, i).replace(
                        c_last=ramp.start[kept], dc_max=20.0 * near
                    )
                    assert socp.solve(closer).status is gf.Status.INFEASIBLE
    assert seen > 8


def test_fingers_have_names():
    problem = feasible(0)[0].replace(c_max=15)
    names = ["index", "middle", "ring", "thumb"]
    by_name = regrasp.lowest_engagement(problem, "ring", fingers=names)
    assert by_name.upper == regrasp.lowest_engagement(problem, 2).upper
    assert regrasp.lowest_engagement(problem, "finger 3").upper == by_name.upper
    with pytest.raises(
        gf.InvalidInputError, match="got 'pinky', expected 0 to 3 or one of index, middle"
    ):
        regrasp.can_leave(problem, "pinky", fingers=names)
    for wrong in (4, -1, 1.5, None, True):
        with pytest.raises(gf.InvalidInputError, match=r"finger: got .*finger 1, finger 2"):
            regrasp.can_leave(problem, wrong)
    with pytest.raises(gf.InvalidInputError, match="fingers: got 1 names, expected 4"):
        regrasp.can_leave(problem, 0, fingers=["thumb"])


def test_wrong_arguments_are_refused():
    problem = feasible(0)[0]
    with pytest.raises(gf.InvalidInputError, match="c_max: missing"):
        regrasp.lowest_engagement(problem, 0)
    with pytest.raises(gf.InvalidInputError, match="c_max: missing"):
        regrasp.payload_during_lift(problem, 0)
    with pytest.raises(gf.InvalidInputError, match="rate: got 0"):
        regrasp.shortest_ramp(problem, 0, 0)
    with pytest.raises(gf.InvalidInputError, match="f: got zeros"):
        regrasp.next_to_lift(problem.replace(f=np.zeros(6)))
    with pytest.raises(gf.InvalidInputError, match="problem: got"):
        regrasp.can_leave([], 0)
