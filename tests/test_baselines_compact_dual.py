"""The compact-dual LP against HiGHS, on facetted cones that the test makes itself."""

import itertools

import numpy as np
import pytest
from baseline_oracles import limits, random_problems, removed_columns, socp
from grasps import KINDS, components, cone_matrix, random_model
from scipy.optimize import linprog

import graspforce as gf
from graspforce import scenarios
from graspforce.baselines import compact_dual
from graspforce.baselines._pyramids import facet_rows
from graspforce.baselines.compact_dual import eliminate, simplex


def highs(problem, facets, inner):
    A, b = limits(problem)
    rows = []
    for model, part, here in zip(
        problem.models, components(problem.models), problem.engagement > 1e-6, strict=True
    ):
        if here:
            own = facet_rows(model, facets, inner)
            padded = np.zeros((len(own), problem.m))
            padded[:, part] = own
            rows.append(padded)
    F = np.vstack(rows)
    out = removed_columns(problem)
    cost = np.zeros(problem.m)
    cost[[part.start for part in components(problem.models)]] = 1.0
    return linprog(
        cost,
        np.vstack((A, F)),
        np.concatenate((b, np.zeros(len(F)))),
        np.vstack((problem.W, out)),
        np.concatenate((problem.f, np.zeros(len(out)))),
        bounds=(None, None),
        method="highs",
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("facets", [4, 6, 8, 32])
def test_pyramids_lie_inside_and_around_the_cone(kind, facets, rng):
    model = random_model(rng, kind)
    y = np.linalg.solve(cone_matrix(model), rng.normal(size=(model.dim, 4000)))
    rolled = cone_matrix(model) @ y
    margin = rolled[0] - np.linalg.norm(rolled[1:], axis=0)
    inner = (facet_rows(model, facets, True) @ y <= 0).all(axis=0)
    outer = (facet_rows(model, facets, False) @ y <= 0).all(axis=0)
    assert (margin[inner] >= -1e-12).all()
    assert outer[margin >= 0].all()
    if kind != "FPC":
        assert (inner != outer).any()


@pytest.mark.parametrize("cones", ["inner", "outer"])
def test_agrees_with_highs(cones, rng):
    paper = [scenarios.get("static").problem(0.0), scenarios.get("regrasp").problem(0.6)]
    for problem in itertools.chain(paper, random_problems(rng, 25)):
        for facets in (4, 8, 32):
            solution = compact_dual.solve(problem, facets=facets, cones=cones)
            other = highs(problem, facets, cones == "inner")
            if other.status == 2:
                assert solution.status is gf.Status.STALLED
                continue
            assert solution.status is gf.Status.SOLVED
            assert solution.normal_forces.sum() == pytest.approx(other.fun, rel=1e-9)
            assert solution.wrench_error < 1e-12
            limit_margin = solution.verify().limit_margin
            assert limit_margin > -1e-9
            if cones == "inner":
                assert solution.friction_margins.min() > -1e-9


def test_outer_pyramids_leave_the_true_cone():
    problem = scenarios.get("dynamic").problem(0.7)
    assert compact_dual.solve(problem, cones="outer").friction_margins.min() < -1e-3


def test_many_facets_approach_the_exact_cones_from_both_sides():
    problem = scenarios.get("static").problem(0.0)
    exact, _ = socp(problem, "normals")
    previous = np.inf
    for facets in (8, 16, 32, 64):
        inner = compact_dual.solve(problem, facets=facets).normal_forces.sum()
        outer = compact_dual.solve(problem, facets=facets, cones="outer").normal_forces.sum()
        assert outer <= exact + 1e-9
        assert exact - 1e-9 <= inner < previous
        previous = inner
    assert previous == pytest.approx(exact, rel=2e-3)


def test_too_few_facets_are_no_proof_of_infeasibility():
    # Along a corner of the square pyramid the friction is whole, between two it is 1/√2.
    contacts = [
        gf.Contact((s * 0.04, 0, 0), (-s, 0, 0), gf.PCWF(0.5), tangent=(0, 1, 1)) for s in (1, -1)
    ]
    weight = 0.95 * 2 * 0.5 * 10 * 2**-0.5
    pull = [0, weight, weight, 0, 0, 0]  # along x of one frame, y of the other has no share
    problem = gf.Grasp(contacts).problem(pull, c_max=10)
    turned = gf.Grasp(
        [gf.Contact(c.point, c.normal, c.model, tangent=(0, 0, 1)) for c in contacts]
    ).problem(pull, c_max=10)
    assert gf.solve(problem).status is gf.Status.SOLVED
    by_facets = {compact_dual.solve(p, facets=4).status for p in (problem, turned)}
    assert gf.Status.STALLED in by_facets
    assert gf.Status.INFEASIBLE not in by_facets


def test_infeasible_with_proof():
    problem = scenarios.get("static").problem(0.0)
    solution = compact_dual.solve(problem.replace(f=30 * problem.f))
    assert solution.status is gf.Status.INFEASIBLE
    assert solution.verify().ok


def test_elimination_gives_every_solution(rng):
    for rank in (6, 5, 3):
        W = rng.normal(size=(6, rank)) @ rng.normal(size=(rank, 12))
        f = W @ rng.normal(size=12)
        c_p, N = eliminate(W, f)
        assert N.shape == (12, 12 - rank)
        assert np.linalg.matrix_rank(N) == 12 - rank
        assert W @ c_p == pytest.approx(f)
        assert pytest.approx(0, abs=1e-12) == W @ N


def test_simplex_on_degenerate_random_programs(rng):
    for _ in range(50):
        p, v = rng.integers(2, 6), 20
        A = np.round(rng.normal(size=(p, v)))
        A[:, ~A.any(axis=0)] = 1.0
        A /= np.linalg.norm(A, axis=0)
        h = np.round(rng.normal(size=v), 1)
        target = A @ np.round(np.maximum(0, rng.normal(size=v)))
        vertex = simplex(A, h, target, 500)
        other = linprog(h, A_eq=A, b_eq=target, method="highs")
        if other.status == 3:
            assert vertex.status is gf.Status.UNBOUNDED
        else:
            assert vertex.status is gf.Status.SOLVED
            assert h[vertex.basis] @ vertex.values == pytest.approx(other.fun, abs=1e-9)


def test_simplex_names_an_empty_set():
    assert simplex(np.eye(2), np.ones(2), -np.ones(2), 50).status is gf.Status.INFEASIBLE


def test_bad_options():
    problem = scenarios.get("static").problem(0.0)
    for facets in (3, 5, 2, 8.0):
        with pytest.raises(gf.InvalidInputError, match="facets"):
            compact_dual.solve(problem, facets=facets)
    with pytest.raises(gf.InvalidInputError, match="cones"):
        compact_dual.solve(problem, cones="middle")
