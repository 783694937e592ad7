"""Where Python and the compiled core meet: the base class of Solution, the KKT system."""

import copy
import gc
import importlib
import pickle
import weakref

import numpy as np
import pytest
from grasps import plant

import graspforce as gf
from graspforce import _engine, reference
from graspforce.solution import Solution


@pytest.fixture(params=_engine.modules)
def core(request):
    return importlib.import_module(request.param)


@pytest.fixture
def problem(rng):
    return plant(rng, ["PCWF", "SFC", "PCWF", "FPC"], ceilings=True).problem


def solve(core, solution, problem):
    return core.solve(solution, problem, problem.layout, problem.packed, None, 1e-9, 100, np.inf)


# ---- the base class of Solution ------------------------------------------------------------------


def test_every_core_makes_solutions_of_one_type(core, problem):
    found = solve(core, Solution, problem)
    assert type(found) is Solution
    assert found.problem is problem
    assert found.verify().ok
    assert isinstance(found, importlib.import_module(_engine.modules[0]).SolutionBase)


def test_a_class_derived_from_solution_is_made_too(core, problem):
    class Marked(Solution):
        mark = 7

    found = solve(core, Marked, problem)
    assert type(found) is Marked
    assert found.mark == 7
    assert found.verify().ok


@pytest.mark.parametrize("other", [object, dict, 7])
def test_nothing_else_is_taken_for_a_solution(core, problem, other):
    with pytest.raises(TypeError, match="SolutionBase"):
        solve(core, other, problem)


def test_a_solution_frees_what_it_holds(core, problem):
    class Loop(Solution):
        pass

    found = solve(core, Loop, problem)
    seen = weakref.ref(found)
    del found
    assert seen() is None
    found = solve(core, Loop, problem)
    found.self = found
    seen = weakref.ref(found)
    del found
    gc.collect()
    assert seen() is None


def test_a_solution_holds_its_members_by_the_names_of_python(problem):
    found = gf.solve(problem)
    found.c[:1]
    kept, outcome = found.problem, found._outcome
    del found._outcome
    with pytest.raises(AttributeError):
        found.c  # noqa: B018
    found._outcome = outcome
    assert found.problem is kept
    with pytest.raises(AttributeError):
        found.anything = 1


def test_a_solution_is_copied_and_pickled(problem):
    found = gf.solve(problem)
    for other in (copy.copy(found), copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert other == found
        assert other is not found


# ---- the KKT system ------------------------------------------------------------------------------


def test_the_kkt_system_is_solved_for_every_column(core, problem, rng):
    c = gf.solve(problem).c
    A, b = problem.linear_limits()
    H = reference.hess_phi_soc(c, problem.models) + problem.alpha * reference.hess_phi_lin(c, A, b)
    W, m, k = problem.W, problem.m, len(problem.f)
    rhs = np.vstack([rng.normal(size=(m, 5)), W @ rng.normal(size=(m, 5))])
    found = core.kkt_solve(problem.layout, problem.packed, c, rhs)
    assert found.shape == (m + k, 5)
    d, nu = found[:m], found[m:]
    scale = np.abs(H) @ np.abs(d) + np.abs(W.T) @ np.abs(nu)
    assert (np.abs(H @ d + W.T @ nu - rhs[:m]) <= 1e-9 * scale).all()
    np.testing.assert_allclose(W @ d, rhs[m:], rtol=0, atol=1e-11 * np.abs(d).max())


def test_the_optimum_follows_the_kkt_system(core, problem, rng):
    exact = gf.Settings(tol=1e-20)
    c = gf.solve(problem, exact).c
    df = problem.W @ rng.normal(size=problem.m)
    rhs = np.concatenate([np.zeros(problem.m), df])[:, None]
    d = core.kkt_solve(problem.layout, problem.packed, c, rhs)[: problem.m, 0]
    step = 1e-5
    ends = [gf.solve(problem.replace(f=problem.f + s * df), exact).c for s in (step, -step)]
    np.testing.assert_allclose(
        d, (ends[0] - ends[1]) / (2 * step), rtol=0, atol=1e-4 * abs(d).max()
    )


def test_the_kkt_system_wants_its_sizes_and_forces_inside(core, problem):
    layout, packed, c = problem.layout, problem.packed, np.array(gf.solve(problem).c)
    rhs = np.zeros((problem.m + len(problem.f), 2))
    with pytest.raises(ValueError, match="m \\+ r \\+ k rows"):
        core.kkt_solve(layout, packed, c, rhs[1:])
    with pytest.raises(ValueError, match="size"):
        core.kkt_solve(layout, packed, c[1:], rhs)
    with pytest.raises(ValueError, match="size"):
        core.kkt_solve(layout, packed[1:], c, rhs)
    c[0] = -1
    with pytest.raises(ValueError, match="strictly inside"):
        core.kkt_solve(layout, packed, c, rhs)
    assert core.kkt_solve(layout, packed, gf.solve(problem).c, rhs[:, :0]).shape == (len(rhs), 0)
