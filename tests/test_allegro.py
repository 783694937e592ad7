"""Grasps of a real four-fingered hand on scanned household objects.

Twelve are in tests/data, whose README says where they are from and how their references were made;
where ../shared has the whole set of 193, with references of other hands, the tests run on it too.
"""

import linearised_cones
import numpy as np
import pytest
from conftest import ALLEGRO, SHARED

import graspforce as gf
from graspforce.baselines import compact_dual, dikin, lp, sdp, socp

SETS = [path for path in (ALLEGRO, SHARED / "allegro_ycb.npz") if path.exists()]


@pytest.fixture(scope="module", params=SETS, ids=lambda path: path.stem)
def path(request):
    return request.param


@pytest.fixture(scope="module")
def allegro(path):
    with np.load(path) as data:
        return dict(data)


def spread(sequence, count):
    """Some ``count`` of a sequence, from its whole length; all of a short one."""
    return sequence[:: max(1, len(sequence) // count)]


def problems(data, alpha):
    for i in range(len(data["W"])):
        yield gf.ForceProblem(
            data["W"][i],
            data["f"][i],
            gf.PCWF(data["mu"][i]),
            J=data["J"][i],
            tau_lo=-data["tau_limit"],
            tau_hi=data["tau_limit"],
            alpha=alpha,
        )


@pytest.mark.parametrize("alpha", [1, 5])
@pytest.mark.parametrize(("backend", "count"), [("reference", 16), ("native", 193)])
def test_every_grasp(allegro, backend, count, alpha):
    settings = gf.Settings(tol=1e-14, backend=backend)
    feasible = allegro["ref_status"] == "Solved"
    wanted = allegro[f"wbf_c_alpha{alpha}"]
    assert (~feasible).sum() == 2
    every = list(problems(allegro, alpha))
    for i in {*spread(range(len(every)), count), *np.flatnonzero(~feasible)}:
        solution = gf.solve(every[i], settings)
        if feasible[i]:
            assert solution.status is gf.Status.SOLVED
            assert np.abs(solution.c - wanted[i]).max() <= 1e-6
            assert solution.normal_forces.max() >= allegro["ref_min_max_normal"][i]
        else:
            assert solution.status is gf.Status.INFEASIBLE
            assert gf.check_certificate(every[i], solution.certificate)
        assert solution.verify().ok


@pytest.mark.parametrize(("alpha", "ratio"), [(1e3, 2.5), (1e6, 1.1)])
def test_a_light_grip_comes_near_the_least_possible(allegro, alpha, ratio):
    """alpha 1e6 has to be solved as reliably as alpha 1, and squeezes little."""
    every = list(problems(allegro, alpha))
    ratios = []
    for i in spread(np.flatnonzero(allegro["ref_status"] == "Solved"), 64):
        solution = gf.solve(every[i])
        assert solution.status is gf.Status.SOLVED
        assert solution.verify().ok
        ratios.append(solution.normal_forces.max() / allegro["ref_min_max_normal"][i])
    assert min(ratios) >= 1 - 1e-9
    assert np.median(ratios) < ratio


def test_the_least_largest_normal_force_is_the_references(allegro):
    feasible = allegro["ref_status"] == "Solved"
    wanted = allegro["ref_min_max_normal"]
    every = list(problems(allegro, 5))
    for i, problem in enumerate(every):
        solution = socp.solve(problem)
        if feasible[i]:
            assert solution.status is gf.Status.SOLVED
            assert solution.normal_forces.max() == pytest.approx(wanted[i], abs=1e-6)
        else:
            assert solution.status is gf.Status.INFEASIBLE
            assert solution.verify().ok
    for i in spread(np.flatnonzero(feasible), 20):
        inner, outer = (
            lp.solve(every[i], facets=64, cones=cones, objective="normal").normal_forces.max()
            for cones in ("inner", "outer")
        )
        assert outer - 1e-9 <= wanted[i] <= inner + 1e-9
        assert inner - outer < 0.02 * wanted[i]


def test_linearised_cones_squeeze_harder_or_leave_the_cones(path, allegro):
    """The kept table in short: inner pyramids squeeze harder, outer ones slip nearly always."""
    every = list(linearised_cones.grasps(path))
    assert len(every) == 6 * len(allegro["W"])
    some = spread(every, 160)
    for row in linearised_cones.judge(some, facets=(4, 8)):
        assert row.feasible > 0.7 * len(some)
        assert row.norms.min() > 1 - 1e-6
        # Between its edges an inner pyramid has cos(pi/facets) of the friction. A grip that takes
        # that much more force everywhere is the most that the median may be.
        assert 1.02 < np.median(row.norms**2) < 1 / np.cos(np.pi / row.facets) ** 2
        assert row.left > 0.95 * row.feasible


def test_inner_pyramids_call_feasible_grasps_infeasible():
    every = list(linearised_cones.grasps(ALLEGRO))
    lost = [every[i] for i in (9, 10, 21, 38, 50, 51, 52)]
    assert all(gf.solve(problem).verify().ok for problem in lost)
    (row,) = linearised_cones.judge(lost, facets=(4,))
    assert row.lost == row.feasible == len(lost)


@pytest.mark.parametrize("method", [dikin, sdp, compact_dual])
def test_the_papers_methods_solve_the_feasible_and_prove_the_others(allegro, method):
    feasible = allegro["ref_status"] == "Solved"
    least = allegro["ref_min_max_normal"]
    for i, problem in enumerate(problems(allegro, 5)):
        solution = method.solve(problem)
        if feasible[i]:
            assert solution.status is gf.Status.SOLVED
            assert solution.normal_forces.max() >= least[i] - 1e-6
        else:
            assert solution.status is gf.Status.INFEASIBLE
            assert solution.verify().ok
