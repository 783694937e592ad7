"""The recurrent neural network: its projection, its path, its end against another solver."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from baseline_oracles import random_problems, socp

import graspforce as gf
from graspforce import files, scenarios
from graspforce.baselines import neural_network
from graspforce.baselines.neural_network import project

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_projection_onto_the_cone_is_moreaus(rng):
    y = rng.normal(size=(500, 4))
    p = project(y)
    rest = p - y  # in the dual cone, which is the cone itself, and at a right angle to p
    for each in (p, rest):
        assert (each[:, 0] >= np.linalg.norm(each[:, 1:], axis=1) - 1e-12).all()
    assert np.einsum("ij,ij->i", p, rest) == pytest.approx(0, abs=1e-12)
    assert project(np.array([[2.0, 0, 0, 0], [-1.0, 0, 0, 0]])).tolist() == [[2, 0, 0, 0], [0] * 4]


def test_ends_at_the_least_norm_from_rest_and_from_a_feasible_start(rng):
    paper = [scenarios.get("static").problem(0.0), scenarios.get("dynamic").problem(0.7)]
    for i, problem in enumerate(itertools.chain(paper, random_problems(rng, 35))):
        value, c = socp(problem, "norm")
        for start in (None, gf.solve(problem, check=True).c)[i > 3 :]:
            solution = neural_network.solve(problem, start=start)
            assert solution.status is gf.Status.SOLVED
            assert solution.c @ solution.c / 2 == pytest.approx(value, abs=1e-6)
            assert solution.c == pytest.approx(c, abs=1e-4)
            assert solution.wrench_error < 1e-12
            assert solution.friction_margins.min() > -1e-6


def test_without_an_answer_the_flow_is_left_soon(monkeypatch):
    """Its multipliers grow too slowly to be suspicious for a thousand steps."""
    calls = []
    rates = neural_network._Network.rates
    monkeypatch.setattr(
        neural_network._Network, "rates", lambda *args: calls.append(1) or rates(*args)
    )
    problems = [problem for _, problem in files.read(EXAMPLES / "several_grasps.json")]
    hopeless = [each for each in problems if gf.solve(each).status is gf.Status.INFEASIBLE]
    assert hopeless
    for problem in hopeless:
        calls.clear()
        solution = neural_network.solve(problem)
        assert solution.status is gf.Status.INFEASIBLE
        assert solution.verify().ok
        assert len(calls) < 20_000  # of which the Jacobian's differences are most


def test_forces_scale_with_the_problem():
    problem = scenarios.get("static").problem(0.0)
    big = problem.replace(
        f=100 * problem.f, tau_lo=100 * problem.tau_lo, tau_hi=100 * problem.tau_hi
    )
    c = neural_network.solve(problem).c
    assert neural_network.solve(big).c == pytest.approx(100 * c, rel=1e-6, abs=1e-4)


def test_nu_is_the_price_of_the_wrench():
    problem = scenarios.get("static").problem(0.0)
    nu = neural_network.solve(problem).nu
    step = 1e-2 * np.eye(6)[2]
    up, down = (socp(problem.replace(f=problem.f + s * step), "norm")[0] for s in (1, -1))
    assert (up - down) / 2e-2 == pytest.approx(nu[2], abs=1e-4)
