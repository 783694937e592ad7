"""What every baseline makes of problems without an answer, odd ones, and bad input."""

import importlib
import subprocess
import sys

import numpy as np
import pytest
from baseline_oracles import socp
from grasps import plant

import graspforce as gf
from graspforce import scenarios
from graspforce.baselines import compact_dual, dikin, gradient_flow, neural_network, sdp

OWN = (compact_dual, dikin, gradient_flow, neural_network, sdp)


@pytest.fixture(params=OWN, ids=lambda module: module.__name__.rsplit(".", 1)[1])
def method(request):
    return request.param


def opposed(model=None, f=(0, 0, 2, 0, 0, 0), **limits):
    """Two contacts on a line: W has rank 5 with point contacts."""
    model = model or gf.PCWF(0.5)
    contacts = [gf.Contact((s * 0.04, 0, 0), (-s, 0, 0), model) for s in (1, -1)]
    return gf.Grasp(contacts).problem(f, **limits)


def test_overload_is_infeasible_with_a_proof(method, rng):
    problems = [scenarios.get("static").problem(0.0), scenarios.get("regrasp").problem(0.6)]
    problems += [plant(rng, ["SFC", "PCWF", "FPC", "PCWF"], ceilings=True).problem]
    for problem in problems:
        heavy = problem.replace(f=40 * problem.f)
        solution = method.solve(heavy)
        assert solution.status is gf.Status.INFEASIBLE
        assert solution.verify().ok
        assert solution.certificate.proves_infeasible(heavy)
        assert solution.violation == pytest.approx(gf.solve(heavy).violation, rel=1e-5)
        with pytest.raises(gf.InfeasibleGraspError):
            solution.raise_if_failed()


def test_slightly_too_heavy_is_infeasible_slightly_less_is_not(method):
    problem = opposed(c_max=10)  # carries 2·0.5·10 N
    options = {"facets": 128} if method is compact_dual else {}
    under = method.solve(problem.replace(f=[0, 0, 9.99, 0, 0, 0]), **options)
    assert under.status is gf.Status.SOLVED
    over = method.solve(problem.replace(f=[0, 0, 10.01, 0, 0, 0]), **options)
    assert over.status is gf.Status.INFEASIBLE
    assert over.verify().ok


def test_unreachable_wrench(method):
    solution = method.solve(opposed(f=(0, 0, 1, 0.5, 0, 0), c_max=10))
    assert solution.status is gf.Status.WRENCH_UNREACHABLE
    assert solution.verify().ok
    assert not solution.c.any()


@pytest.mark.parametrize("model", [gf.PCWF(0.5), gf.SFC(0.5, 0.005)])
def test_grasp_map_of_any_rank(method, model):
    problem = opposed(model, c_max=10)
    solution = method.solve(problem)
    assert solution.status is gf.Status.SOLVED
    assert solution.wrench_error < 1e-9
    if method is neural_network:
        assert solution.c == pytest.approx(socp(problem, "norm")[1], abs=1e-5)


def test_a_removed_contact_has_no_force(method, rng):
    problem = plant(rng, ["PCWF", "SFC", "PCWF", "PCWF", "FPC"], removed=1).problem
    solution = method.solve(problem)
    assert solution.status is gf.Status.SOLVED
    assert not solution.c[3:7].any()
    assert solution.normal_forces[[0, 2, 3]].min() > 0


def test_all_contacts_removed(method):
    empty = opposed(f=np.zeros(6), c_max=10).replace(engagement=0.0)
    assert method.solve(empty).status is gf.Status.SOLVED
    heavy = empty.replace(f=[0, 0, 1, 0, 0, 0])
    assert method.solve(heavy).status is gf.Status.WRENCH_UNREACHABLE


def test_no_limits_at_all_has_a_least_effort(method):
    solution = method.solve(opposed())
    assert solution.status is gf.Status.SOLVED
    if method in (compact_dual, neural_network):  # mu = 0.5, and the pyramid's at its facet
        least = 2 / np.cos(np.pi / 8) if method is compact_dual else 2
        assert solution.normal_forces == pytest.approx([least, least], abs=1e-6)


def test_forces_that_the_wrench_alone_decides(method):
    only = gf.ForceProblem([[1.0]], [2.0], gf.FPC(), c_max=5)
    assert method.solve(only).c == pytest.approx([2.0])
    assert method.solve(only).status is gf.Status.SOLVED
    for f in (-1.0, 6.0):
        solution = method.solve(only.replace(f=[f]))
        assert solution.status is gf.Status.INFEASIBLE
        assert solution.verify().ok


def test_numbers_that_overflow_end_as_a_status(method):
    problem = opposed(c_max=1e300).replace(f=[0, 0, 1e300, 0, 0, 0])
    solution = method.solve(problem)
    assert np.isfinite(solution.c).all()
    assert solution.status is gf.Status.INVALID_NUMBERS


def test_step_limit(method):
    problem = scenarios.get("static").problem(0.0)
    start = {"start": gf.solve(problem).c} if method in (dikin, gradient_flow) else {}
    solution = method.solve(problem, max_steps=1, **start)
    assert solution.status is gf.Status.MAX_STEPS
    assert np.isfinite(solution.c).all()
    with pytest.raises(gf.NotConvergedError):
        solution.raise_if_failed()


def test_bad_options(method):
    problem = opposed(c_max=10)
    for steps in (0, -1, 2.5):
        with pytest.raises(gf.InvalidInputError, match="max_steps"):
            method.solve(problem, max_steps=steps)
    if method in (dikin, gradient_flow):
        for barrier in (0, -1, np.nan):
            with pytest.raises(gf.InvalidInputError, match="barrier"):
                method.solve(problem, barrier=barrier)
    if method in (dikin, gradient_flow, neural_network):
        with pytest.raises(gf.InvalidInputError, match="tol"):
            method.solve(problem, tol=0)
        with pytest.raises(gf.InvalidInputError, match="start"):
            method.solve(problem, start=[1, 2, 3])


def test_bad_options_of_the_sdp():
    problem = opposed(c_max=10)
    with pytest.raises(gf.InvalidInputError, match="barrier"):
        sdp.solve(problem, barrier=-1)
    with pytest.raises(gf.InvalidInputError, match="objective"):
        sdp.solve(problem, objective="torque")


@pytest.mark.parametrize(
    ("module", "package"), [(sdp, "clarabel"), (sdp, "scipy"), (neural_network, "scipy.integrate")]
)
def test_a_missing_package_names_its_pip_line(module, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(gf.MissingExtraError, match=r"pip install 'graspforce\[baselines\]'"):
        module.solve(opposed(c_max=10))


def test_every_method_is_listed_and_imports_light():
    for name, module in gf.baselines.METHODS.items():
        assert importlib.import_module(module).solve
        assert module.endswith(name)
    code = (
        "import sys, importlib, graspforce as gf\n"
        "for module in gf.baselines.METHODS.values(): importlib.import_module(module)\n"
        "print(*sorted({name.split('.')[0] for name in sys.modules}))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"scipy", "clarabel", "highspy", "matplotlib"} & set(run.stdout.split())
