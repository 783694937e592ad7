"""What every baseline makes of problems without an answer, odd ones, and bad input."""

import importlib
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from baseline_oracles import socp as oracle
from grasps import plant

import graspforce as gf
from graspforce import files, scenarios
from graspforce.baselines import (
    compact_dual,
    dikin,
    gradient_flow,
    lp,
    minimum_norm,
    neural_network,
    qp,
    sdp,
    socp,
    wbf_conic,
)

EXAMPLES = Path(__file__).parents[1] / "examples"


class Socp:
    """The second-order cone program by another solver, as if it were a module."""

    def __init__(self, solver, objective):
        self.__name__ = f"socp_{solver}"
        self._options = {"solver": solver, "objective": objective}

    def solve(self, problem, **options):
        return socp.solve(problem, **self._options, **options)


QOCO, SCS = Socp("qoco", "norm"), Socp("scs", "norm")
METHODS = (
    compact_dual, dikin, gradient_flow, lp, neural_network, qp, sdp, socp, QOCO, SCS, wbf_conic,
)  # fmt: skip
PYRAMIDS = (compact_dual, lp, qp)
# Their objectives ask for a firmer grip as long as nothing limits it.
ENDLESS = (lp, wbf_conic)


@pytest.fixture(params=METHODS, ids=lambda module: module.__name__.rsplit(".", 1)[-1])
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


def test_verdicts_on_the_examples_are_those_of_solve(method):
    for _, problem in files.read(EXAMPLES / "several_grasps.json"):
        wanted = gf.solve(problem).status
        assert wanted in (gf.Status.SOLVED, gf.Status.INFEASIBLE)
        assert method.solve(problem).status is wanted


def test_slightly_too_heavy_is_infeasible_slightly_less_is_not(method):
    problem = opposed(c_max=10)  # carries 2·0.5·10 N
    options = {"facets": 128} if method in PYRAMIDS else {}
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
    if method in (neural_network, QOCO, SCS):
        assert solution.c == pytest.approx(oracle(problem, "norm")[1], abs=1e-5)


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


def test_no_limits_at_all_has_a_least_effort_but_no_firmest_grip(method):
    solution = method.solve(opposed())
    if method in ENDLESS:
        assert solution.status is gf.solve(opposed()).status is gf.Status.UNBOUNDED
        assert not solution.c.any()
        assert solution.verify().ok
        return
    assert solution.status is gf.Status.SOLVED
    if method not in (dikin, gradient_flow, sdp):  # mu = 0.5, and the pyramid's at its facet
        least = 2 / np.cos(np.pi / 8) if method in PYRAMIDS else 2
        assert solution.normal_forces == pytest.approx([least, least], abs=1e-6)


def test_a_far_limit_is_a_limit():
    # The grip that the logarithms want grows with the ceiling, for ever only without one.
    for c_max in (1e3, 1e8):
        solution = wbf_conic.solve(opposed(c_max=c_max))
        wanted = gf.solve(opposed(c_max=c_max))
        assert solution.status is gf.Status.SOLVED
        assert solution.phi == pytest.approx(wanted.phi, abs=1e-5)


def test_one_contact_without_limits_among_others():
    contacts = [gf.Contact((s * 0.04, 0, 0), (-s, 0, 0), gf.PCWF(0.5)) for s in (1, -1)]
    row = np.zeros((1, 6))
    row[0, 1] = 1.0  # a tangential force has a limit, the squeeze has none
    problem = gf.Grasp(contacts).problem([0, 0, 2, 0, 0, 0], A=row, b=[3.0])
    for method in (gf, wbf_conic):
        solution = method.solve(problem)
        assert solution.status is gf.Status.UNBOUNDED
        assert solution.verify().ok


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
    if method in (socp, QOCO, wbf_conic):
        with pytest.raises(gf.InvalidInputError, match="tol"):
            method.solve(problem, tol=0)
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


def test_minimum_norm_has_the_verdicts_that_need_no_limits():
    assert minimum_norm.solve(opposed(f=(0, 0, 900, 0, 0, 0), c_max=10)).status is gf.Status.SOLVED
    unreachable = minimum_norm.solve(opposed(f=(0, 0, 1, 0.5, 0, 0), c_max=10))
    assert unreachable.status is gf.Status.WRENCH_UNREACHABLE
    huge = opposed(c_max=1e300).replace(f=[0, 0, 1e300, 0, 0, 0])
    assert minimum_norm.solve(huge).status is gf.Status.INVALID_NUMBERS
    empty = opposed(f=np.zeros(6), c_max=10).replace(engagement=0.0)
    assert minimum_norm.solve(empty).status is gf.Status.SOLVED


@pytest.mark.parametrize(
    ("module", "package"),
    [
        (sdp, "clarabel"),
        (sdp, "scipy"),
        (neural_network, "scipy.integrate"),
        (socp, "clarabel"),
        (socp, "scipy.sparse"),
        (wbf_conic, "clarabel"),
        (lp, "highspy"),
        (qp, "daqp"),
        (QOCO, "qoco"),
        (SCS, "scs"),
    ],
)
def test_a_missing_package_names_its_pip_line(module, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    name = package.partition(".")[0]
    with pytest.raises(
        gf.MissingExtraError, match=rf"needs {name}, .*: pip install .*'{name}[<>=]"
    ):
        module.solve(opposed(c_max=10))


@pytest.mark.parametrize("package", ["ecos", "moreau"])
def test_a_missing_package_of_no_extra_is_named_itself(package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(gf.MissingExtraError, match=f"pip install {package}$") as caught:
        socp.solve(opposed(c_max=10), solver=package)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize("solver", ["ecos", "moreau"])
def test_solvers_that_no_extra_brings(solver):
    pytest.importorskip(solver)
    for objective in ("normal", "norm"):
        problem = scenarios.get("regrasp").problem(0.6)
        solution = socp.solve(problem, solver=solver, objective=objective)
        assert solution.status is gf.Status.SOLVED
        value = oracle(problem, objective)[0]
        c = solution.c
        found = solution.normal_forces.max() if objective == "normal" else c @ c / 2
        assert found == pytest.approx(value, abs=1e-6)
        heavy = socp.solve(problem.replace(f=40 * problem.f), solver=solver, objective=objective)
        assert heavy.status is gf.Status.INFEASIBLE
        kept = socp.Prepared(problem, solver=solver, objective=objective)
        other = scenarios.get("regrasp").problem(0.7)
        assert kept.solve(other).nu == pytest.approx(
            socp.solve(other, objective=objective).nu, abs=1e-3
        )


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
    heavy = {"scipy", "clarabel", "highspy", "daqp", "qoco", "scs", "matplotlib"}
    assert not heavy & set(run.stdout.split())
