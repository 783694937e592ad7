"""193 grasps of a real four-fingered hand on scanned household objects.

The reference forces were computed elsewhere to a remaining Newton step below 1e-7 N; least
largest normal forces and feasibility by Clarabel.
"""

import numpy as np
import pytest

import graspforce as gf


@pytest.fixture(scope="module")
def allegro(shared_data):
    with np.load(shared_data / "allegro_ycb.npz") as data:
        return dict(data)


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
@pytest.mark.parametrize(("backend", "every"), [("reference", 12), ("native", 1)])
def test_every_grasp(allegro, backend, every, alpha):
    settings = gf.Settings(tol=1e-14, backend=backend)
    feasible = allegro["ref_status"] == "Solved"
    wanted = allegro[f"wbf_c_alpha{alpha}"]
    assert (feasible.sum(), (~feasible).sum()) == (191, 2)
    chosen = {*range(0, len(feasible), every), *np.flatnonzero(~feasible)}
    solved = infeasible = 0
    for i, problem in enumerate(problems(allegro, alpha)):
        if i not in chosen:
            continue
        solution = gf.solve(problem, settings)
        if feasible[i]:
            assert solution.status is gf.Status.SOLVED
            assert np.abs(solution.c - wanted[i]).max() <= 1e-6
            assert solution.normal_forces.max() >= allegro["ref_min_max_normal"][i]
            solved += 1
        else:
            assert solution.status is gf.Status.INFEASIBLE
            assert gf.check_certificate(problem, solution.certificate)
            infeasible += 1
        assert solution.verify().ok
    assert infeasible == 2
    assert solved == (191 if every == 1 else len(chosen) - 2)


@pytest.mark.parametrize(("alpha", "ratio"), [(1e3, 2.5), (1e6, 1.1)])
def test_a_light_grip_comes_near_the_least_possible(allegro, alpha, ratio):
    """alpha 1e6 has to be solved as reliably as alpha 1, and squeezes little."""
    feasible = allegro["ref_status"] == "Solved"
    ratios = []
    for i, problem in enumerate(problems(allegro, alpha)):
        if feasible[i] and i % 3 == 0:
            solution = gf.solve(problem)
            assert solution.status is gf.Status.SOLVED
            assert solution.verify().ok
            ratios.append(solution.normal_forces.max() / allegro["ref_min_max_normal"][i])
    assert min(ratios) >= 1 - 1e-9
    assert np.median(ratios) < ratio
