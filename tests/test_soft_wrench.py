"""f_soft: rows of W c = f that may be missed, at a cost that is added to Phi."""

import importlib

import numpy as np
import pytest
from clarabel_oracle import limits_by_hand, socp
from grasps import KINDS, components, cone_matrix, plant

import graspforce as gf
from graspforce import baselines, files
from graspforce.columns import Columns

OPTIONS = (
    {},
    {"shared": True},
    {"ceilings": True, "floors": True, "inequalities": 2, "bias": True},
    {"removed": 1},
    {"rates": True},
)


def soften(rng, planted, rows):
    """The planted problem with soft rows and the same optimum: f = W c + f_soft² nu there."""
    f_soft = np.where(rows, 10 ** rng.uniform(-2, 0, 6) * [1, 1, 1, 0.04, 0.04, 0.04], 0.0)
    f = planted.problem.W @ planted.c + f_soft**2 * planted.nu
    return planted.problem.replace(f=f, f_soft=f_soft)


@pytest.mark.parametrize("backend", ["native", "reference"])
@pytest.mark.parametrize("alpha", [0.2, 5.0, 100.0])
@pytest.mark.parametrize("options", OPTIONS, ids=lambda options: "-".join(options) or "plain")
def test_planted_minima_are_found(rng, backend, alpha, options):
    for seed in range(4 if backend == "native" else 1):
        planted = plant(np.random.default_rng(seed), rng.choice(KINDS, 5), alpha, **options)
        problem = soften(rng, planted, rng.random(6) < 0.6)
        found = gf.solve(problem, gf.Settings(tol=1e-14, backend=backend))
        assert found.status is gf.Status.SOLVED
        assert np.abs(found.c - planted.c).max() <= 1e-6 * np.abs(planted.c).max()
        assert np.abs(found.nu - planted.nu).max() <= 1e-5 * np.abs(planted.nu).max()
        assert found.verify().ok


def test_phi_has_the_cost_of_what_is_missed(rng):
    planted = plant(rng, ["PCWF", "SFC", "FPC", "PCWF"], ceilings=True)
    problem = soften(rng, planted, np.arange(6) != 2)
    soft = problem.f_soft > 0
    inside = gf.solve(problem)
    cost = (
        ((problem.W @ inside.c - problem.f) / np.where(soft, problem.f_soft, np.inf)) ** 2
    ).sum()
    plain = gf.reference.objective(inside.c, planted.problem)
    assert inside.phi == pytest.approx(plain + cost / 2, rel=1e-12)
    assert Columns([inside, inside]).phi == pytest.approx([inside.phi] * 2, rel=1e-12)


def test_derivatives_are_those_of_the_objective(rng):
    planted = plant(rng, ["PCWF", "SFC", "FPC"], ceilings=True)
    problem = soften(rng, planted, np.ones(6, dtype=bool))
    gradient, hessian = gf.reference.derivatives(planted.c, problem)
    for i, step in enumerate(1e-6 * np.eye(problem.m)):
        ahead, behind = planted.c + step, planted.c - step
        slope = gf.reference.objective(ahead, problem) - gf.reference.objective(behind, problem)
        assert slope / 2e-6 == pytest.approx(gradient[i], abs=1e-6 * np.abs(gradient).max() + 1e-6)
        turn = np.subtract(*(gf.reference.derivatives(c, problem)[0] for c in (ahead, behind)))
        assert turn / 2e-6 == pytest.approx(hessian[i], abs=1e-6 * np.abs(hessian).max())


def test_a_stiff_wrench_that_cannot_be_made_ends_at_the_nearest_one(rng):
    """Clarabel projects f on what cones and limits can make."""
    for _ in range(5):
        planted = plant(rng, rng.choice(KINDS[1:], 4), ceilings=True)
        unit = np.array([1, 1, 1, 0.04, 0.04, 0.04])
        problem = planted.problem.replace(f=8 * planted.problem.f, f_soft=1e-3 * unit)
        found = gf.solve(problem)
        assert found.status is gf.Status.SOLVED
        missed = np.linalg.norm((problem.W @ found.c - problem.f) / unit)
        rows, bounds, *_ = limits_by_hand(problem)
        m = problem.m
        wide = np.hstack((rows, np.zeros((len(rows), 1))))
        cones = [
            (np.hstack((np.zeros((model.dim, part.start)), cone_matrix(model),
                        np.zeros((model.dim, m + 1 - part.stop)))), np.zeros(model.dim))
            for model, part in zip(problem.models, components(problem.models), strict=True)
        ]  # fmt: skip
        distance = np.zeros((7, m + 1))
        distance[0, m] = 1
        distance[1:, :m] = problem.W / unit[:, None]
        cones.append((distance, np.append(0.0, -problem.f / unit)))
        nothing = np.zeros((0, m + 1)), np.zeros(0)
        status, least, _ = socp(np.eye(m + 1)[m], nothing, (wide, bounds), cones)
        assert status in ("Solved", "AlmostSolved")
        assert missed >= (1 - 1e-7) * least
        # The barriers' weights bound what they keep the forces from: ½‖·‖² is that far from least.
        weights = 2 * problem.n + problem.alpha * len(bounds)
        assert missed**2 <= least**2 + 2 * weights * 1e-3**2 + 1e-6 * least**2


def test_a_pinch_holds_whatever_leans_and_nothing_jumps(default):
    contacts = [gf.Contact((-s, 0, 0), (s / abs(s), 0, 0), gf.PCWF(0.6)) for s in (0.03, -0.03)]
    f_soft = [0, 0, 0, 1e-3, 0, 0]
    pinch = gf.Grasp(contacts).problem([0, 0, 3, 0, 0, 0], c_max=20, f_soft=f_soft)
    servo, forces = gf.Servo(pinch, default), []
    for offset in 0.005 * np.sin(np.linspace(0, np.pi, 201)):
        tick = servo.step(f=np.array([0, 0, 3, 3 * offset, 0, 0]))
        assert tick.status is gf.Status.SOLVED
        assert tick.normal_forces.min() > 3
        forces.append(tick.c)
    jumps = np.abs(np.diff(forces, axis=0)).max(axis=1)
    assert jumps.max() < 1e-2
    exact = gf.solve(pinch.replace(f=[0, 0, 3, 0.015, 0, 0], f_soft=None), default)
    assert exact.status is gf.Status.WRENCH_UNREACHABLE


def test_what_limits_forbid_is_infeasible_and_the_proof_is_silent_on_soft_rows(rng, default):
    planted = plant(rng, ["PCWF"] * 4, ceilings=True)
    problem = planted.problem.replace(f=50 * planted.problem.f, f_soft=[0, 0.1, 0, 0, 0.01, 0])
    found = gf.solve(problem, default)
    assert found.status is gf.Status.INFEASIBLE
    assert found.verify().ok
    assert not found.certificate.y[[1, 4]].any()
    loud = found.certificate.y.copy()
    loud[1] = 1e-200
    assert not gf.check_certificate(problem, gf.Certificate(loud, found.certificate.z))


def test_a_wrench_out_of_reach_is_one_only_in_its_exact_rows(rng, default):
    planted = plant(rng, ["FPC"] * 3)
    off = planted.problem.f + np.linalg.svd(planted.problem.W)[0][:, -1]
    assert gf.solve(planted.problem.replace(f=off), default).status is gf.Status.WRENCH_UNREACHABLE
    soft = gf.solve(planted.problem.replace(f=off, f_soft=1.0), default)
    assert soft.status is gf.Status.SOLVED
    assert soft.verify().ok


def test_no_softness_is_the_same_as_zero(rng, default):
    problem = plant(rng, ["PCWF"] * 4, ceilings=True).problem
    zero = gf.solve(problem.replace(f_soft=0.0), default)
    assert np.abs(zero.c - gf.solve(problem, default).c).max() < 1e-9


def test_steps_ticks_files_and_copies_carry_it(rng, tmp_path):
    planted = plant(rng, ["PCWF"] * 4, ceilings=True)
    problem = soften(rng, planted, np.arange(6) > 2)
    stepped, written = gf.Servo(problem), gf.Servo(problem)
    for softness in (problem.f_soft, 2 * problem.f_soft, np.zeros(6), problem.f_soft):
        solution = stepped.step(f_soft=softness)
        written.f_soft[:] = softness
        assert written.tick() is solution.status
        assert np.array_equal(written.c, solution.c)
        assert np.abs(solution.c - gf.solve(solution.problem).c).max() < 1e-3
    assert "soft wrench" in repr(problem)
    assert problem.replace(alpha=2.0).arguments()["f_soft"] is not None
    path = tmp_path / "soft.npz"
    np.savez(path, mu=0.5, **{name: problem.arguments()[name][None] for name in
             ("W", "f", "J", "tau_lo", "tau_hi", "c_max", "engagement", "f_soft")})  # fmt: skip
    ((_, read),) = files.read(path)
    assert np.array_equal(read.f_soft, problem.f_soft)


@pytest.mark.parametrize(
    ("f_soft", "words"),
    [
        (-1.0, r"^f_soft\[0\]: got -1, expected 0 or more"),
        ([0, 0, 0, 0, np.inf, 0], r"^f_soft\[4\]: got inf, expected finite"),
        ([0.1, 0.1], r"^f_soft: got shape \(2,\), expected shape"),
    ],
)
def test_wrong_softness_is_named(rng, f_soft, words):
    problem = plant(rng, ["PCWF"] * 3).problem
    with pytest.raises(gf.InvalidInputError, match=words):
        problem.replace(f_soft=f_soft)


@pytest.mark.parametrize("name", sorted(baselines.METHODS))
def test_other_methods_refuse_it(rng, name):
    problem = plant(rng, ["PCWF"] * 4, ceilings=True).problem.replace(f_soft=0.1)
    with pytest.raises(gf.InvalidInputError, match="f_soft: got a soft wrench"):
        importlib.import_module(baselines.METHODS[name]).solve(problem)
