"""solve and the Solution that it returns: residuals, verdicts, exceptions, values."""

import json
import math
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from grasps import KINDS, cone_margins, plant, random_contacts, random_model
from scipy.spatial.transform import Rotation

import graspforce as gf
from graspforce._engine.outcome import PlainOutcome

EVERYTHING = {"ceilings": True, "floors": True, "inequalities": 2, "bias": True}


@pytest.fixture
def planted(rng):
    return plant(rng, KINDS * 2, alpha=2.0, shared=True, **EVERYTHING)


@pytest.fixture
def solved(planted, exact):
    return gf.solve(planted.problem, exact)


@pytest.fixture
def overloaded(rng, default):
    """A grasp that is asked for far more than its joints can give."""
    problem = plant(rng, ["PCWF"] * 4).problem
    return gf.solve(problem.replace(f=1e3 * problem.f), default)


@pytest.fixture
def unreachable(rng, default):
    """Two point contacts cannot make a torque about the line through them."""
    ends = [gf.Contact((s, 0, 0), (-s, 0, 0), gf.PCWF(0.5)) for s in (-1.0, 1.0)]
    return gf.solve(gf.Grasp(ends).problem([0, 0, 0, 1, 0, 0], c_max=9), default)


# ---- numbers, recomputed by hand ---------------------------------------------------------------


def test_residuals_and_margins_by_hand(solved):
    problem, c = solved.problem, solved.c
    tau = problem.tau_bias + np.array([problem.J[:, j] @ c for j in range(problem.J.shape[1])])
    assert solved.tau == pytest.approx(tau, rel=1e-13)
    margins = np.minimum(problem.tau_hi - tau, tau - problem.tau_lo)
    assert solved.torque_margins == pytest.approx(margins, rel=1e-12)
    assert solved.torque_residual == pytest.approx(margins.min(), rel=1e-12)
    assert solved.friction_margins == pytest.approx(cone_margins(c, problem.models), rel=1e-9)
    g, start = [], 0
    for model in problem.models:
        n, *t = c[start : start + model.dim]
        start += model.dim
        mu, gamma = getattr(model, "mu", 1), getattr(model, "gamma", 1)
        scale = [1, 1, mu / gamma]
        g.append((mu * n) ** 2 - sum((a * b) ** 2 for a, b in zip(t, scale, strict=False)))
    assert solved.friction_residual == pytest.approx(min(g), rel=1e-9)
    assert solved.normal_forces.tolist() == [c[i] for i in problem.starts[:-1]]
    assert solved.wrench_error == np.abs(problem.W @ c - problem.f).max()
    assert solved.wrench_error <= 1e-9 * (np.abs(problem.W) @ np.abs(c)).max()


def test_phi_by_hand(solved):
    problem, c = solved.problem, solved.c
    A, b = problem.linear_limits()
    soc, start = 0.0, 0
    for model in problem.models:
        n, *t = c[start : start + model.dim]
        start += model.dim
        mu, gamma = getattr(model, "mu", 1), getattr(model, "gamma", 1)
        scale = [1, 1, mu / gamma]
        g = (mu * n) ** 2 - sum((x * s) ** 2 for x, s in zip(t, scale, strict=False))
        soc -= math.log(g)
    lin = -sum(math.log(bound - row @ c) for row, bound in zip(A, b, strict=True))
    assert solved.phi == pytest.approx(soc + problem.alpha * lin, rel=1e-11)


def test_suboptimality_bounds_the_distance_to_the_planted_optimum(planted, backend):
    best = gf.reference.objective(planted.c, planted.problem)
    for tol in (1e-1, 1e-3, 1e-9):
        solution = gf.solve(planted.problem, gf.Settings(tol=tol, backend=backend))
        gap = solution.phi - best
        assert -1e-9 * abs(best) <= gap <= solution.suboptimality + 1e-9 * abs(best)


@pytest.mark.parametrize("alpha", [0.1, 3.0])
def test_the_tolerance_bounds_the_decrement(rng, backend, alpha):
    problem = plant(rng, ["PCWF", "SFC", "PCWF", "FPC"], alpha=alpha, ceilings=True).problem
    for tol in (1e-2, 1e-5, 1e-9):
        solution = gf.solve(problem, gf.Settings(tol=tol, backend=backend))
        assert solution.status is gf.Status.SOLVED
        assert gf.reference.decrement(solution.c, problem) ** 2 / 2 <= tol * (1 + 1e-6) + 1e-13
        # The decrement is that of Phi / min(1, alpha), and so bounds this much of Phi itself.
        longest = min(math.sqrt(2 * tol), 0.99)
        most = min(1, alpha) * (-longest - math.log1p(-longest))
        assert solution.suboptimality <= most * (1 + 1e-6) + 1e-14


def test_nu_is_the_derivative_of_the_least_phi(rng, exact):
    """∇Phi = W.T nu and dPhi*/df = nu, the latter by central differences."""
    planted = plant(rng, ["PCWF"] * 4, alpha=2.0)
    problem = planted.problem
    solution = gf.solve(problem, exact)
    gradient, _ = gf.reference.derivatives(solution.c, problem)
    assert problem.W.T @ solution.nu == pytest.approx(gradient, abs=1e-6 * np.abs(gradient).max())
    for k in range(6):
        h = 1e-5 * np.eye(6)[k]
        ahead, behind = (gf.solve(problem.replace(f=problem.f + s * h), exact).phi for s in (1, -1))
        assert solution.nu[k] == pytest.approx((ahead - behind) / 2e-5, rel=1e-4, abs=1e-4)


def test_residuals_of_a_grasp_without_joints(rng, default):
    problem = plant(rng, ["PCWF"] * 4, hand=False).problem
    solution = gf.solve(problem, default)
    assert solution.tau.shape == solution.torque_margins.shape == (0,)
    assert solution.torque_residual == math.inf
    assert "torque_residual=inf" in repr(solution)


def test_a_removed_contact_has_no_margin_to_lose(rng, default):
    solution = gf.solve(plant(rng, ["PCWF"] * 4, removed=2).problem, default)
    assert solution.status is gf.Status.SOLVED
    assert solution.friction_margins[2] == math.inf
    assert solution.normal_forces[2] == 0
    assert not solution.c[6:9].any()
    assert 0 < solution.friction_residual < math.inf
    assert np.isfinite(solution.phi)


# ---- start -------------------------------------------------------------------------------------


def test_the_start_changes_the_way_and_not_the_answer(planted, exact):
    cold = gf.solve(planted.problem, exact)
    near = gf.solve(planted.problem, exact, start=planted.c * (1 + 1e-6))
    assert near.c == pytest.approx(cold.c, abs=1e-9)
    assert near.newton_steps < cold.newton_steps
    for start in (planted.c, -planted.c, 1e6 * planted.c, np.zeros_like(planted.c)):
        again = gf.solve(planted.problem, exact, start=start)
        assert again.status is gf.Status.SOLVED
        assert again.c == pytest.approx(cold.c, abs=1e-8)


def test_the_start_need_not_make_the_wrench(planted, exact):
    moved = planted.problem.replace(f=planted.problem.f * 1.001)
    cold = gf.solve(moved, exact)
    warm = gf.solve(moved, exact, start=planted.c)
    assert warm.c == pytest.approx(cold.c, abs=1e-8)


def test_solving_twice_gives_the_same_bits(planted, exact):
    first, second = (gf.solve(planted.problem, exact) for _ in range(2))
    assert first == second
    assert first.nu.tolist() == second.nu.tolist()


def test_nothing_is_remembered_of_other_problems_of_the_same_shape(default):
    """Joint 1 moves a finger in the grasp first, one that has left it then: no limit any more."""

    def grip(J, tau_lo):
        return gf.ForceProblem(
            [[1.0, -1.0, 0.0]], [0.0], gf.FPC(), J=J, tau_lo=tau_lo, tau_hi=3.0,
            c_max=5.0, engagement=[1, 1, 0],
        )  # fmt: skip

    first = grip([[1.0, 1.0], [0, 0], [0, 0]], [-3.0, -3.0])
    second = grip([[1.0, 0.0], [0, 0], [0, 1.0]], [-3.0, 1.0])
    assert gf.solve(first, default).status is gf.Status.SOLVED
    after = gf.solve(second, default)
    assert after.status is gf.Status.SOLVED
    alone = grip([[1.0, 0.0], [0, 0], [0, 0]], [-3.0, -9e9])
    assert after.c == pytest.approx(gf.solve(alone, default).c, rel=1e-4)
    servo = gf.Servo(first, default)
    servo.step()
    assert servo.step(J=second.J, tau_lo=second.tau_lo).status is gf.Status.SOLVED


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_solving_does_not_matter(seed, exact):
    """Problems of one layout whose fingers, engagements and grasps differ, there and back."""
    rng = np.random.default_rng(seed)
    kinds = ["PCWF", "FPC", "SFC", "PCWF"]
    problems = []
    while len(problems) < 8:
        sort = {"removed": int(rng.integers(4))} if rng.random() < 0.5 else {"ceilings": True}
        problem = plant(rng, kinds, 2.0, shared=True, inequalities=1, **sort).problem
        J = np.zeros((problem.m, 20))
        J[:, : problem.J.shape[1]] = problem.J
        limits = {"tau_lo": np.full(20, -1.0), "tau_hi": np.full(20, 1.0)}
        for name, values in limits.items():
            values[: problem.J.shape[1]] = getattr(problem, name)
        problems.append(problem.replace(J=J, tau_bias=None, **limits))
    assert len({problem.layout for problem in problems}) == 1
    there = [gf.solve(problem, exact) for problem in problems]
    back = [gf.solve(problem, exact) for problem in reversed(problems)][::-1]
    for first, second in zip(there, back, strict=True):
        assert first.status is second.status is gf.Status.SOLVED
        assert first.c.tolist() == second.c.tolist()


# ---- the two backends --------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(25))
def test_native_and_reference_agree(seed):
    rng = np.random.default_rng(seed)
    kinds = [str(kind) for kind in rng.choice(KINDS, rng.integers(3, 8))]
    problem = plant(
        rng, kinds, 10 ** rng.uniform(-1, 2), shared=seed % 2 == 0, ceilings=seed % 3 == 0,
        floors=seed % 4 == 0, removed=seed % 3 if seed % 5 == 0 else None,
    ).problem  # fmt: skip
    problem = problem.replace(f=problem.f * rng.uniform(0.7, 1.2))
    native, reference = (
        gf.solve(problem, gf.Settings(tol=1e-14, backend=name)) for name in ("native", "reference")
    )
    assert native.status is reference.status
    if native.status is gf.Status.SOLVED:
        size = np.abs(reference.c).max()
        assert native.c == pytest.approx(reference.c, abs=1e-8 * size)
        assert native.phi == pytest.approx(reference.phi, rel=1e-9)
    else:
        assert native.violation == pytest.approx(reference.violation, rel=1e-4)


# ---- verdicts ----------------------------------------------------------------------------------


def test_check_raises_what_raise_if_failed_raises(planted, overloaded, unreachable, default):
    for bad in (overloaded, unreachable):
        with pytest.raises(gf.InfeasibleGraspError, match=bad.status.name) as caught:
            gf.solve(bad.problem, default, check=True)
        assert caught.value.solution == bad
        with pytest.raises(gf.InfeasibleGraspError) as caught:
            bad.raise_if_failed()
        assert caught.value.solution is bad
    good = gf.solve(planted.problem, default, check=True)
    assert good.status is gf.Status.SOLVED
    good.raise_if_failed()


def test_no_bound_and_too_few_steps_are_not_converged(planted, rng, backend):
    boundless = gf.ForceProblem(planted.problem.W, planted.problem.f, planted.problem.models)
    few = gf.Settings(max_steps=1, tol=1e-15, backend=backend)
    for problem, settings, status in [
        (boundless, gf.Settings(backend=backend), gf.Status.UNBOUNDED),
        (planted.problem, few, gf.Status.MAX_STEPS),
    ]:
        solution = gf.solve(problem, settings)
        assert solution.status is status
        assert solution.suboptimality == math.inf
        assert np.isfinite(solution.c).all()
        with pytest.raises(gf.NotConvergedError, match=status.name):
            solution.raise_if_failed()


def test_exceptions_are_of_the_family_and_pickle(overloaded):
    assert issubclass(gf.InvalidInputError, ValueError)
    assert issubclass(gf.MissingExtraError, ImportError)
    for kind in (gf.InvalidInputError, gf.ModelImportError, gf.MissingExtraError, gf.SolveError):
        assert issubclass(kind, gf.GraspForceError)
    for kind in (gf.InfeasibleGraspError, gf.NotConvergedError):
        assert issubclass(kind, gf.SolveError)
        error = pickle.loads(pickle.dumps(kind(overloaded)))
        assert type(error) is kind
        assert error.solution == overloaded
        assert str(error) == str(kind(overloaded))
    missing = gf.MissingExtraError("drawing", "matplotlib", "figures")
    assert "needs matplotlib, which is not installed: pip install 'matplotlib>=" in str(missing)
    assert str(pickle.loads(pickle.dumps(missing))) == str(missing)


def test_messages_say_what_to_do(solved, overloaded, unreachable):
    assert "solved in" in solved.message
    assert "least relative violation" in overloaded.message
    assert "range of W" in unreachable.message


# ---- verify ------------------------------------------------------------------------------------


def forged(solution, **changes):
    """A Solution with other numbers than were found."""
    raw = solution.__reduce__()[1][0]
    fields = {name: getattr(raw, name) for name in raw.__slots__} | changes
    return gf.Solution(type(raw)(**fields), solution.problem)


def test_verify_bears_out_the_truth(solved, overloaded, unreachable):
    for solution in (solved, overloaded, unreachable):
        assert solution.verify().ok
    report = solved.verify()
    assert report.ok is True
    assert report.wrench_error == solved.wrench_error
    assert report.friction_margin == solved.friction_margins.min()
    A, b = solved.problem.linear_limits()
    assert report.limit_margin == (b - A @ solved.c).min()
    assert report.decrement < 1e-5
    assert report.certificate_holds is None
    assert overloaded.verify().certificate_holds is True
    assert unreachable.verify().certificate_holds is None


def null_space(W):
    return np.linalg.svd(W)[2][np.linalg.matrix_rank(W) :].T


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_verify_finds_forces_that_are_not_the_optimum(solved, size):
    N = null_space(solved.problem.W)
    assert not forged(solved, c=solved.c + size * N[:, 0]).verify().ok


def test_verify_finds_forces_that_do_not_make_the_wrench(solved):
    assert not forged(solved, c=solved.c * (1 + 1e-7)).verify().ok


@pytest.mark.parametrize("lie", [{"c": None, "sign": -1}, {"c": None, "sign": 0}], ids=str)
def test_verify_finds_forces_outside_the_cones(solved, lie):
    assert not forged(solved, c=lie["sign"] * solved.c).verify().ok


def test_verify_takes_a_boundary_for_one(solved):
    """Forces without any slack are outside: no division by it, no warning."""
    problem, c = solved.problem, solved.c
    A = problem.linear_limits()[0]
    ceilings = {"c_max": solved.normal_forces, "engagement": 1.0, "c_min": None}
    for other in (problem.replace(A=A[:1], b=A[:1] @ c), problem.replace(**ceilings)):
        report = gf.Solution(forged(solved)._outcome, other).verify()
        assert not report.ok
        assert report.limit_margin <= 1e-14
        assert report.decrement == np.inf
    push = gf.solve(gf.ForceProblem([[1.0, 0, 0]], [5.0], gf.PCWF(1.0), c_max=9))
    report = forged(push, c=np.array([5.0, 3.0, 4.0])).verify()
    assert not report.ok
    assert report.wrench_error == report.friction_margin == 0
    assert report.decrement == np.inf
    report = forged(push, c=1e-200 * np.array([5.0, 3.0, 1.0])).verify()
    assert not report.ok
    assert report.friction_margin > 0  # but its square, by which Phi divides, is not
    assert report.decrement == np.inf


def test_verify_finds_forces_that_are_no_numbers(solved):
    assert not forged(solved, c=np.full_like(solved.c, np.nan)).verify().ok


def test_verify_finds_wrong_statuses(solved, overloaded, unreachable):
    assert not forged(solved, status=gf.Status.INFEASIBLE).verify().ok
    for c in (solved.c, np.zeros_like(solved.c)):  # no force at all makes no wrench either
        assert not forged(solved, status=gf.Status.WRENCH_UNREACHABLE, c=c).verify().ok
    assert not forged(overloaded, status=gf.Status.SOLVED).verify().ok
    assert not forged(overloaded, y=None).verify().ok
    assert not forged(overloaded, z=np.zeros_like(forged(overloaded).certificate.z)).verify().ok
    assert not forged(unreachable, status=gf.Status.SOLVED).verify().ok


def test_a_loose_answer_is_no_lie(planted, backend):
    """An early stop that says so is borne out: verify judges the claim, not the accuracy."""
    loose = gf.solve(planted.problem, gf.Settings(tol=0.01, backend=backend))
    assert loose.status is gf.Status.SOLVED
    assert loose.verify().ok


# ---- values ------------------------------------------------------------------------------------


def test_pickle_and_equality(solved, overloaded, unreachable):
    for solution in (solved, overloaded, unreachable):
        copy = pickle.loads(pickle.dumps(solution))
        assert copy == solution
        assert hash(copy) == hash(solution)
        assert copy.problem == solution.problem
        assert copy.newton_steps == solution.newton_steps
        assert copy.nu.tolist() == solution.nu.tolist()
        assert copy.suboptimality == solution.suboptimality
        assert copy.violation == solution.violation
        assert copy.certificate == solution.certificate
        assert copy.verify().ok
        assert repr(copy) == repr(solution)
    assert solved != overloaded
    assert solved != forged(solved, c=solved.c * 1.5)
    raw = solved.__reduce__()[1][0]
    assert solved == gf.Solution(raw, solved.problem.replace())
    assert solved != gf.Solution(raw, solved.problem.replace(alpha=3.0))
    assert solved != "solution"


def test_repr_names_the_verdict_and_the_margins(solved, overloaded):
    assert repr(solved).startswith("Solution(SOLVED, normal_forces=[")
    for word in ("friction_residual=", "torque_residual=", "newton_steps="):
        assert word in repr(solved)
    assert "INFEASIBLE" in repr(overloaded)


def test_a_status_prints_as_its_name_and_counts_as_its_number(solved, overloaded, capsys):
    print(solved.status, overloaded.status, solved.start)
    assert capsys.readouterr().out == "SOLVED INFEASIBLE COLD\n"
    for status in gf.Status:
        assert f"{status}" == str(status) == "%s" % status == status.name  # noqa: UP031
        assert f"{status:>20}|{status!s:<20}" == f"{status.name:>20}|{status.name:<20}"
        number = int(status)
        assert f"{status:d} {status:03d} {status:.1f}" == f"{number:d} {number:03d} {number:.1f}"
        assert "%d" % status == json.dumps(status) == str(number)  # noqa: UP031
        assert repr(status) == f"<Status.{status.name}: {number}>"
        assert pickle.loads(pickle.dumps(status)) is status
        assert status == number == np.int64(number)
        assert gf.Status(number) is status


# ---- forces in world axes ----------------------------------------------------------------------


def of_contacts(rng, kinds, rotation=None, roll=0.0, origin=(0, 0, 0)):
    """Solve a grasp whose contacts, drawn by rng, are turned about the origin and rolled."""
    R = np.eye(3) if rotation is None else rotation
    given = random_contacts(rng, [random_model(rng, kind) for kind in kinds])
    contacts = [
        gf.Contact(R @ each.point, R @ each.normal, each.model,
                   R @ (np.cos(roll) * each.frame[:, 1] + np.sin(roll) * each.frame[:, 2]))
        for each in given
    ]  # fmt: skip
    f = np.concatenate((R @ [0.3, -0.2, 1.0], R @ [0.002, 0.001, -0.003]))
    return contacts, gf.solve(
        gf.Grasp(contacts, origin=origin).problem(f, c_max=20.0), gf.Settings(tol=1e-14)
    )


def test_forces_in_world_axes_add_up_to_the_wrench(rng):
    for kinds in (("PCWF",) * 3, ("SFC", "SFC"), ("FPC", "PCWF", "SFC", "PCWF", "SFC")):
        origin = rng.normal(0, 0.01, 3)
        contacts, solution = of_contacts(rng, kinds, origin=origin)
        assert solution.status is gf.Status.SOLVED
        forces, starts = solution.forces_world, solution.problem.starts
        torque = np.zeros(3)
        for contact, force, start in zip(contacts, forces, starts, strict=False):
            torque += np.cross(contact.point - origin, force)
            if isinstance(contact.model, gf.SFC):
                torque += solution.c[start + 3] * contact.normal
        f = solution.problem.f
        assert forces.sum(axis=0) == pytest.approx(f[:3], abs=1e-7)
        assert torque == pytest.approx(f[3:], abs=1e-7)


def test_forces_in_world_axes_turn_with_the_world_and_not_with_the_frames():
    kinds = ("PCWF", "SFC", "PCWF", "PCWF")
    R = Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix()
    _, solution = of_contacts(np.random.default_rng(7), kinds)
    _, turned = of_contacts(np.random.default_rng(7), kinds, rotation=R, roll=0.7)
    assert turned.forces_world == pytest.approx(solution.forces_world @ R.T, rel=1e-5, abs=1e-6)


def test_forces_in_world_axes_with_further_rows_and_without_a_contact_that_left(rng):
    _, solution = of_contacts(rng, ("PCWF",) * 4)
    problem = solution.problem
    more = problem.replace(W=np.vstack((problem.W, np.zeros((1, 12)))), f=np.append(problem.f, 0.0))
    assert gf.solve(more).forces_world.sum(axis=0) == pytest.approx(problem.f[:3], abs=1e-7)
    gone = gf.solve(problem.replace(engagement=[1, 1, 0, 1]))
    assert gone.forces_world[2].tolist() == [0, 0, 0]


AXES, TORQUES = np.eye(3), np.ones((3, 3))


@pytest.mark.parametrize(
    ("rows", "model"),
    [
        ([AXES], gf.PCWF(0.5)),  # of a plane, for all that is known
        ([TORQUES, AXES], gf.PCWF(0.5)),
        ([2 * AXES, TORQUES], gf.PCWF(0.5)),  # in another unit
        ([[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], TORQUES], gf.PCWF(0.5)),
        ([np.ones((3, 4)) / 3**0.5, np.eye(3, 4)], gf.SFC(0.5, 0.01)),
        ([[[0.5], [0.5], [0.5]], np.ones((3, 1))], gf.FPC()),
    ],
)
def test_forces_in_world_axes_only_of_a_grasp_map(rows, model):
    """Where the first rows of W are something else, no number is better than a wrong one."""
    W = np.vstack(rows)
    solution = gf.solve(gf.ForceProblem(W, W[:, 0], model, c_max=20))
    with pytest.raises(gf.InvalidInputError, match=r"^forces_world: got W of shape .*, expected"):
        _ = solution.forces_world


def test_the_problem_is_at_hand(planted, default):
    assert gf.solve(planted.problem, default).problem is planted.problem


def test_cold_solves_in_threads_and_many_shapes_answer_as_they_do_alone():
    """More shapes than a thread keeps engines for, so that engines come and go."""
    problems = [
        plant(np.random.default_rng(seed), ["PCWF"] * (3 + seed % 9), bias=seed > 9).problem
        for seed in range(20)
    ]
    alone = [gf.solve(problem).c for problem in problems]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(gf.solve, problems * 5))
    for solution, c in zip(together, alone * 5, strict=True):
        assert np.array_equal(solution.c, c)


@pytest.mark.parametrize("alpha", [1e-4, 5.0, 1e6])
@pytest.mark.parametrize("n", [1, 2, 64, 256])
def test_one_contact_to_256(n, alpha):
    points = np.random.default_rng(n).normal(size=(n, 3))
    points[-1] = -points[0] if n > 1 else points[0]
    directions = points / np.linalg.norm(points, axis=1)[:, None]
    grasp = gf.Grasp([gf.Contact(0.04 * p, -p, gf.PCWF(0.6)) for p in directions])
    load = -2.5 * directions[0] if n == 1 else np.cross(directions[0], [1, 2, 3])
    solution = gf.solve(grasp.problem([*load, 0, 0, 0], c_max=20, alpha=alpha), check=True)
    assert solution.verify().ok


@pytest.mark.parametrize("seed", range(20))
def test_limits_that_hold_by_rounding_alone_hold_nothing(seed):
    """Two stretched fingers squeeze without torque; turned, rows of W and J are zero to 1e-17."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0, np.pi) + np.pi / 2 * np.arange(4)
    directions = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(4)))
    contacts = [gf.Contact(-0.03 * d, d, gf.PCWF(0.5), tangent=(0, 0, 1)) for d in directions]
    J = np.zeros((12, 12))
    for i in range(4):
        block = 0.07 * np.eye(3) + 0.02 * rng.normal(size=(3, 3))
        block[0] *= i % 2
        J[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    f = [0, 0, 2.5, 0, 0, 0]
    problem = gf.ForceProblem(gf.grasp_map(contacts), f, gf.PCWF(0.5), J, -0.5, 0.5)
    assert gf.solve(problem).status is gf.Status.UNBOUNDED
    assert gf.solve(problem.replace(c_max=20), check=True).verify().ok


@pytest.mark.parametrize("status", gf.Status)
def test_every_status_has_words(status):
    problem = gf.ForceProblem(np.eye(3), [1, 0, 0], gf.PCWF(0.5), c_max=2)
    outcome = PlainOutcome(status, 0, np.zeros(3), np.zeros(3))
    assert len(gf.Solution(outcome, problem).message) > 20
