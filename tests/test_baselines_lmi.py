"""SDP, Dikin recursion and gradient flow: one objective, three methods, other solvers."""

import itertools

import numpy as np
import pytest
from baseline_oracles import (
    effort_and_barrier,
    least_effort_and_barrier,
    random_problems,
    socp,
)
from grasps import cone_matrix, plant, random_model

import graspforce as gf
from graspforce import scenarios
from graspforce.baselines import dikin, gradient_flow, sdp
from graspforce.baselines._active import Active
from graspforce.baselines._descent import descend
from graspforce.baselines._lmi import Lmi, friction_matrices, line_search

BARRIER = 0.1


def paper_grasps():
    return [scenarios.get("static").problem(0.0), scenarios.get("dynamic").problem(0.7)]


# ---- the matrix P ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["FPC", "PCWF", "SFC"])
def test_P_has_the_eigenvalues_of_the_cone(kind, rng):
    for _ in range(20):
        model = random_model(rng, kind)
        c = rng.normal(size=model.dim)
        s, *t = cone_matrix(model) @ c
        size = np.linalg.norm(t)
        expected = [s] if not t else [s - size, s + size] + [s] * (model.dim - 2)
        P = np.tensordot(c, friction_matrices(model), 1)
        assert np.linalg.eigvalsh(P) == pytest.approx(sorted(expected), abs=1e-12)


def test_the_barrier_is_minus_ln_det_with_its_derivatives(rng):
    problem = plant(rng, ["PCWF", "SFC", "FPC", "PCWF"], ceilings=True).problem
    lmi = Lmi.of(Active.of(problem))
    c = dikin.solve(problem).c
    zero = effort_and_barrier(problem, c, 0.0)
    assert lmi.at(c).barrier == pytest.approx(effort_and_barrier(problem, c, 1.0) - zero)
    d = rng.normal(size=problem.m) * 1e-6
    ahead, behind = lmi.at(c + d), lmi.at(c - d)
    slope = (ahead.barrier - behind.barrier) / 2
    assert lmi.at(c).gradient @ d == pytest.approx(slope, rel=1e-4)
    root = lmi.at(c).metric_root
    assert root.T @ root @ d == pytest.approx((ahead.gradient - behind.gradient) / 2, rel=1e-3)
    growth = np.log1p(lmi.at(c).spectrum(d)).sum()
    assert growth == pytest.approx(lmi.at(c).barrier - ahead.barrier, abs=1e-9)


def test_line_search_finds_the_root_of_the_derivative(rng):
    for _ in range(50):
        spectrum = rng.normal(size=12)
        slope = 0.1 * spectrum.sum() - rng.uniform(0.01, 1)  # downhill at 0
        t = line_search(spectrum, slope, 0.1)
        assert 0 < t < 1 / -spectrum.min()
        assert slope - 0.1 * (spectrum / (1 + t * spectrum)).sum() == pytest.approx(0, abs=1e-7)


@pytest.mark.parametrize("size", [0.0, 1e-200])
def test_line_search_along_a_direction_that_goes_nowhere(size):
    """What the gradient is at an optimum to the last bit; its squares are zero as well."""
    assert np.isfinite(line_search(np.full(12, size), 0.0, 0.1))


def test_a_zero_direction_is_no_step():
    problem = paper_grasps()[0]
    solution = descend(
        problem, lambda _: lambda _, gradient: 0 * gradient, barrier=BARRIER, tol=1e-9,
        max_steps=5, start=gf.solve(problem).c, decrement_every=20,
    )  # fmt: skip
    assert solution.status is gf.Status.MAX_STEPS
    assert solution.c == pytest.approx(gf.solve(problem).c)


# ---- the methods -------------------------------------------------------------------------------


@pytest.mark.parametrize("objective", ["normals", "norm"])
def test_sdp_without_barrier_is_the_socp(objective, rng):
    for problem in itertools.chain(paper_grasps(), random_problems(rng, 15)):
        solution = sdp.solve(problem, barrier=0, objective=objective)
        assert solution.status is gf.Status.SOLVED
        value, _ = socp(problem, objective)
        c = solution.c
        found = solution.normal_forces.sum() if objective == "normals" else c @ c / 2
        assert found == pytest.approx(value, abs=1e-6)
        assert solution.friction_margins.min() > -1e-7
        assert solution.wrench_error < 1e-9


@pytest.mark.parametrize("objective", ["normals", "norm"])
def test_the_sdp_has_an_answer_where_clarabel_is_in_difficulties(objective, rng):
    """Its decomposition of the blocks panics on three of these, its progress ends on the others."""
    problems = list(random_problems(rng, 264))
    for i in (18, 141, 161, 162, 209, 250, 252, 263):
        solution = sdp.solve(problems[i], barrier=0, objective=objective)
        assert solution.status is gf.Status.SOLVED
        assert solution.verify().limit_margin > -1e-7


def test_the_three_methods_find_the_least_of_effort_and_barrier(rng):
    for problem in itertools.chain(paper_grasps(), random_problems(rng, 7)):
        least, c = least_effort_and_barrier(problem, BARRIER)
        for method in (sdp, dikin, gradient_flow):
            solution = method.solve(problem, barrier=BARRIER)
            assert solution.status is gf.Status.SOLVED
            assert solution.verify().ok
            assert effort_and_barrier(problem, solution.c, BARRIER) == pytest.approx(
                least, abs=1e-6
            )
            assert solution.c == pytest.approx(c, abs=1e-3)


@pytest.mark.parametrize(("method", "count"), [(dikin, 50), (gradient_flow, 50)])
def test_from_a_feasible_start_to_the_sdp_optimum(method, count, rng):
    for problem in itertools.chain(paper_grasps(), random_problems(rng, count)):
        start = gf.solve(problem, check=True).c
        solution = method.solve(problem, start=start)
        assert solution.status is gf.Status.SOLVED
        optimum = effort_and_barrier(problem, sdp.solve(problem).c, BARRIER)
        assert effort_and_barrier(problem, solution.c, BARRIER) == pytest.approx(optimum, abs=1e-6)


def test_a_start_at_the_optimum_costs_no_step(rng):
    problem = paper_grasps()[0]
    best = dikin.solve(problem, tol=1e-14).c
    assert dikin.solve(problem, start=best).newton_steps == 0
    assert gradient_flow.solve(problem, start=best).newton_steps == 0


def test_dikin_ends_quadratically_and_the_flow_does_not():
    problem = paper_grasps()[0]
    near = dikin.solve(problem, tol=1e-6).newton_steps
    assert dikin.solve(problem, tol=1e-12).newton_steps <= near + 2
    assert gradient_flow.solve(problem).newton_steps > 10 * near


def test_less_barrier_comes_closer_to_the_least_effort():
    problem = paper_grasps()[0]
    least = socp(problem, "normals")[0]
    excess = [dikin.solve(problem, barrier=b).normal_forces.sum() - least for b in (1, 0.1, 0.01)]
    assert excess[0] > excess[1] > excess[2] > 0
    rows = 36  # of P: each adds at most barrier to the effort
    assert excess[2] <= rows * 0.01


@pytest.mark.parametrize("method", [sdp, dikin, gradient_flow])
def test_forces_scale_with_the_problem(method):
    problem = paper_grasps()[0]
    doubled = problem.replace(f=2 * problem.f, tau_lo=2 * problem.tau_lo, tau_hi=2 * problem.tau_hi)
    c = method.solve(problem, barrier=0.1).c
    assert method.solve(doubled, barrier=0.2).c == pytest.approx(2 * c, abs=2e-4)


FORCES = ("f", "tau_lo", "tau_hi", "tau_bias", "c_max", "c_min", "b")


def in_other_units(problem, scale):
    """The same problem with all forces times a number."""
    given = problem.arguments()
    return gf.ForceProblem(
        **(given | {name: scale * given[name] for name in FORCES if given[name] is not None})
    )


@pytest.mark.parametrize(("method", "most"), [(sdp, 6), (dikin, 1)])
def test_verdicts_are_those_of_solve_far_from_the_papers_forces(method, most, rng):
    """Dikin's steps have no end in 200 where the barrier is a tiny part of the forces."""
    for problem in itertools.chain(paper_grasps(), random_problems(rng, 4)):
        others = [problem.replace(f=10.0**k * problem.f) for k in (-8, -5, 4, 6, 9)]
        others += [in_other_units(problem, 10.0**k) for k in (-8, -5, most)]
        for other in others:
            assert method.solve(other).status is gf.solve(other).status


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e4])
@pytest.mark.parametrize("objective", ["normals", "norm"])
def test_the_sdp_is_the_same_in_any_unit_of_force(scale, objective):
    problem = paper_grasps()[1]
    other = in_other_units(problem, scale)
    degree = 1 if objective == "normals" else 2
    for barrier in (0.0, 0.1):
        one = sdp.solve(problem, barrier=barrier, objective=objective)
        two = sdp.solve(other, barrier=scale**degree * barrier, objective=objective)
        assert one.status is two.status is gf.Status.SOLVED
        assert two.c / scale == pytest.approx(one.c, abs=1e-3)
        assert two.nu / scale ** (degree - 1) == pytest.approx(one.nu, abs=1e-3)


def test_last_newton_steps_where_clarabel_ends_short():
    scenario = scenarios.get("regrasp", shape="smooth")
    for t in np.arange(0.49, 0.5, 0.0005):
        problem = scenario.problem(float(t))
        solution = sdp.solve(problem)
        assert solution.status is gf.Status.SOLVED
        assert solution.c == pytest.approx(dikin.solve(problem).c, abs=1e-4)


def test_nu_is_the_price_of_the_wrench():
    problem = paper_grasps()[0]
    for options in ({"barrier": 0.1}, {"barrier": 0}):
        nu = sdp.solve(problem, **options).nu
        for k, step in ((2, 1e-3), (3, 1e-5)):
            values = []
            for sign in (1, -1):
                moved = problem.replace(f=problem.f + sign * step * np.eye(6)[k])
                c = sdp.solve(moved, **options).c
                values.append(effort_and_barrier(problem, c, options["barrier"]) if
                              options["barrier"] else c[problem.starts[:-1]].sum())  # fmt: skip
            assert (values[0] - values[1]) / (2 * step) == pytest.approx(nu[k], abs=2e-3)


def test_the_sdp_regrasps_with_continuous_forces():
    # Schlegl et al. [11]: a finger lets go by its ceiling and comes back, on the paper's circle.
    scenario = scenarios.get("regrasp", shape="smooth")
    times = np.append(np.arange(0.4, 0.505, 0.004), np.arange(1.496, 1.6, 0.004))
    forces, there = [], []
    for t in times:
        problem = scenario.problem(float(t))
        solution = sdp.solve(problem)
        assert solution.status is gf.Status.SOLVED
        forces.append(solution.normal_forces)
        there.append(problem.active[0])
    assert not all(there)
    assert any(there)
    jumps = np.abs(np.diff(forces, axis=0)).max(axis=1)
    jumps[np.diff(times) > 0.1] = 0
    assert jumps.max() < 0.25
