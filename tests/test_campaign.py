"""The random campaign in short: no wrong verdict, none missing at a margin of 1e-3."""

import campaign
import numpy as np
import pytest

import graspforce as gf


def verdicts(geometries, margin=None, hard=False, seed=7):
    tasks = ((seed, index, margin, hard) for index in geometries)
    return [v for task in tasks for v in campaign.judge_geometry(task) if v is not None]


def test_campaign_every_grasp_is_decided_and_rightly():
    found = verdicts(range(120))
    assert len(found) > 1000
    assert {v.expected for v in found} == {
        gf.Status.SOLVED,
        gf.Status.INFEASIBLE,
        gf.Status.WRENCH_UNREACHABLE,
    }
    assert [v for v in found if v.wrong or not v.decided] == []


@pytest.mark.parametrize(
    ("margin", "hard", "decided"), [(1e-4, False, 1), (1e-5, False, 0.99), (None, True, 1)]
)
def test_campaign_the_hard_ends(margin, hard, decided):
    found = verdicts(range(40), margin, hard)
    assert [v for v in found if v.wrong] == []
    assert np.mean([v.decided for v in found]) >= decided


def test_campaign_a_proof_outlives_the_rounding_that_ends_phase_1():
    """Here the search for the least violation once went on to numbers that overflow."""
    found = verdicts([1402], seed=1)
    assert [v for v in found if v.wrong or not v.decided] == []


def test_campaign_the_critical_load_of_a_pinch_is_what_friction_gives():
    """Two fingers of at most 10 N and mu = .5 hold up to 10 N, and nothing downward but as much."""
    contacts = [
        gf.Contact((x, 0, 0), (-np.sign(x), 0, 0), gf.PCWF(0.5), tangent=(0, 0, 1))
        for x in (-0.02, 0.02)
    ]
    W = gf.grasp_map(contacts)
    problem = gf.ForceProblem(W, np.zeros(6), gf.PCWF(0.5), c_max=10.0)
    ends = campaign.load_interval(problem, np.array([0, 0, 1.0, 0, 0, 0]))
    assert ends == pytest.approx((-10, 10), rel=1e-7)


@pytest.mark.parametrize("lie", ["swap", "slip"])
def test_campaign_the_judge_catches_a_liar(monkeypatch, lie):
    honest = gf.solve

    def dishonest(problem):
        if lie == "slip":  # the forces of another load
            return gf.Solution(honest(problem.replace(f=1.001 * problem.f))._outcome, problem)
        return honest(problem.replace(f=0.5 * problem.f))  # a verdict on another load

    monkeypatch.setattr(campaign.gf, "solve", dishonest)
    assert any(v.wrong for v in verdicts(range(20)))


def test_campaign_a_case_is_the_same_each_time():
    once, again = (list(campaign.cases(3, 5, None, False)) for _ in range(2))
    assert [case and case.problem for case in once] == [case and case.problem for case in again]
