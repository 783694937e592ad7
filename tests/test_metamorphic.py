"""What must not change, or must change in a known way, when the problem is said differently.

No oracle but the library against itself: scaled, turned, permuted, rewritten.
"""

import numpy as np
import pytest
from conftest import on_both_backends
from grasps import KINDS, components, plant
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

import graspforce as gf

SAME = 1e-7  # of the largest force


@st.composite
def planted_problems(draw, least=3, kinds=KINDS, **fixed):
    """A feasible problem of some sort, with the contacts behind it."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    options = {
        "alpha": 10 ** draw(st.floats(-1, 2)),
        "shared": draw(st.booleans()),
        "spare": draw(st.integers(0, 1)),
        "ceilings": draw(st.booleans()),
        "floors": draw(st.booleans()),
        "inequalities": draw(st.integers(0, 2)),
        "bias": draw(st.booleans()),
    }
    names = draw(st.lists(st.sampled_from(kinds), min_size=least, max_size=6))
    return plant(rng, names, **(options | fixed))


seeds = st.integers(0, 2**32).map(np.random.default_rng)
COUNTS = {"reference": 5, "native": 60}


def solve(problem, settings):
    solution = gf.solve(problem, settings)
    assert solution.status is gf.Status.SOLVED
    return solution


def assert_same(got, wanted):
    assert np.abs(np.asarray(got) - wanted).max() <= SAME * np.abs(wanted).max()


def given_arguments(problem):
    return {name: value for name, value in problem.arguments().items() if value is not None}


# ---- units -------------------------------------------------------------------------------------


@on_both_backends(**COUNTS, planted=planted_problems(), k=st.floats(-12, 12).map(np.exp2))
def test_forces_scale_with_wrench_and_limits(settings, planted, k):
    problem = planted.problem
    forces = ("f", "tau_lo", "tau_hi", "tau_bias", "c_max", "c_min", "b")
    given = given_arguments(problem)
    scaled = problem.replace(**{name: k * given[name] for name in forces if name in given})
    assert_same(solve(scaled, settings).c, k * solve(problem, settings).c)


@on_both_backends(**COUNTS, planted=planted_problems(), k=st.floats(-12, 12).map(np.exp2))
def test_the_unit_of_length_does_not_matter(settings, planted, k):
    """Metres to anything else: torques, J, gamma and the torsions follow."""
    problem = planted.problem
    given = given_arguments(problem)
    units = np.ones(problem.m)
    for model, part in zip(problem.models, components(problem.models), strict=True):
        if isinstance(model, gf.SFC):
            units[part.stop - 1] = k
    rows = np.array([1, 1, 1, k, k, k])
    models = [gf.SFC(x.mu, k * x.gamma) if isinstance(x, gf.SFC) else x for x in problem.models]
    changes = {
        "W": rows[:, None] * problem.W / units,
        "f": rows * problem.f,
        "models": models,
        "J": k * problem.J / units[:, None],
    }
    changes |= {name: k * given[name] for name in ("tau_lo", "tau_hi", "tau_bias") if name in given}
    if "A" in given:
        changes["A"] = problem.A / units
    assert_same(solve(problem.replace(**changes), settings).c, units * solve(problem, settings).c)


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_the_unit_of_a_row_does_not_matter(settings, planted, rng):
    """Each linear limit and each row of W c = f may be multiplied by a positive number."""
    problem = planted.problem
    rows, joints = np.exp2(rng.uniform(-9, 9, 6)), np.exp2(rng.uniform(-9, 9, len(problem.tau_lo)))
    given = given_arguments(problem)
    changes = {"W": rows[:, None] * problem.W, "f": rows * problem.f, "J": problem.J * joints}
    changes |= {
        name: joints * given[name] for name in ("tau_lo", "tau_hi", "tau_bias") if name in given
    }
    if "A" in given:
        sizes = np.exp2(rng.uniform(-9, 9, len(problem.b)))
        changes |= {"A": sizes[:, None] * problem.A, "b": sizes * problem.b}
    assert_same(solve(problem.replace(**changes), settings).c, solve(problem, settings).c)


# ---- frames ------------------------------------------------------------------------------------


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_turning_and_moving_the_world_leaves_the_forces_in_contact_frames(settings, planted, rng):
    """Contacts turned, wrench turned, torque taken about the point that moved along."""
    R = Rotation.random(random_state=rng).as_matrix()
    shift = rng.normal(size=3)
    moved = [
        gf.Contact(R @ k.point + shift, R @ k.normal, k.model, R @ k.tangent)
        for k in planted.contacts
    ]
    problem = planted.problem
    turned = problem.replace(
        W=gf.grasp_map(moved, origin=shift), f=np.kron(np.eye(2), R) @ problem.f
    )
    assert_same(solve(turned, settings).c, solve(problem, settings).c)


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_moving_the_torques_origin_changes_nothing(settings, planted, rng):
    problem, origin = planted.problem, rng.normal(0, 0.1, 3)
    f = problem.f.copy()
    f[3:] -= np.cross(origin, f[:3])
    moved = problem.replace(W=gf.grasp_map(planted.contacts, origin), f=f)
    assert_same(solve(moved, settings).c, solve(problem, settings).c)


@on_both_backends(
    **COUNTS, planted=planted_problems(kinds=("PCWF", "SFC", "PCWF", "FPC")), rng=seeds
)
def test_rolling_the_contact_frames_leaves_the_forces_in_the_world(settings, planted, rng):
    problem = planted.problem
    rolled, turns = [], []
    for contact in planted.contacts:
        angle = rng.uniform(-np.pi, np.pi)
        x, y = contact.frame[:, 1:].T
        tangent = np.cos(angle) * x + np.sin(angle) * y
        rolled.append(gf.Contact(contact.point, contact.normal, contact.model, tangent))
        turn = np.eye(4)  # old components from new ones
        turn[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        turns.append(turn[: contact.model.dim, : contact.model.dim])
    T = block_diag(*turns)
    other = problem.replace(W=gf.grasp_map(rolled), J=T.T @ problem.J)
    if problem.A.size:
        other = other.replace(A=problem.A @ T)
    assert_same(T @ solve(other, settings).c, solve(problem, settings).c)


# ---- order -------------------------------------------------------------------------------------


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_permuting_the_contacts_permutes_the_forces(settings, planted, rng):
    problem = planted.problem
    order = rng.permutation(problem.n)
    parts = components(problem.models)
    columns = np.concatenate([np.arange(problem.m)[parts[i]] for i in order])
    given = given_arguments(problem)
    changes = {
        name: given[name][order] for name in ("c_max", "c_min", "engagement") if name in given
    }
    changes |= {"W": problem.W[:, columns], "J": problem.J[columns]}
    changes |= {"A": problem.A[:, columns]} if "A" in given else {}
    other = problem.replace(models=[problem.models[i] for i in order], **changes)
    assert_same(solve(other, settings).c, solve(problem, settings).c[columns])


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_the_order_of_joints_and_rows_does_not_matter(settings, planted, rng):
    problem = planted.problem
    given = given_arguments(problem)
    joints, rows = rng.permutation(len(problem.tau_lo)), rng.permutation(6)
    changes = {
        name: given[name][joints] for name in ("tau_lo", "tau_hi", "tau_bias") if name in given
    }
    changes |= {"J": problem.J[:, joints], "W": problem.W[rows], "f": problem.f[rows]}
    if "A" in given:
        changes |= {"A": problem.A[::-1], "b": problem.b[::-1]}
    assert_same(solve(problem.replace(**changes), settings).c, solve(problem, settings).c)


# ---- the same limits in other words ------------------------------------------------------------


@on_both_backends(**COUNTS, planted=planted_problems(bias=True))
def test_a_bias_is_a_shift_of_the_limits(settings, planted):
    problem = planted.problem
    shifted = problem.replace(
        tau_lo=problem.tau_lo - problem.tau_bias,
        tau_hi=problem.tau_hi - problem.tau_bias,
        tau_bias=0.0,
    )
    with_bias, without = solve(problem, settings), solve(shifted, settings)
    assert_same(without.c, with_bias.c)
    assert_same(without.tau + problem.tau_bias, with_bias.tau)
    assert without.torque_margins == pytest.approx(with_bias.torque_margins, rel=1e-6, abs=1e-9)


@on_both_backends(
    **COUNTS, planted=planted_problems(ceilings=True), floors=st.booleans(), torques=st.booleans()
)
def test_every_limit_may_be_written_as_rows_of_A(settings, planted, floors, torques):
    """Same Phi term for term, hence the same forces, Phi and multipliers."""
    problem = planted.problem
    normals = np.eye(problem.m)[problem.starts[:-1]]
    A, b = [problem.A, normals], [problem.b, problem.engagement * problem.c_max]
    without = {"c_max": None, "engagement": None}
    if floors and problem.layout.floors:
        A.append(-normals)
        b.append(-problem.engagement * problem.c_min)
        without["c_min"] = None
    elif problem.layout.floors:
        without["c_min"] = problem.engagement * problem.c_min
    if torques:
        A += [problem.J.T, -problem.J.T]
        b += [problem.tau_hi - problem.tau_bias, problem.tau_bias - problem.tau_lo]
        without |= dict.fromkeys(("J", "tau_lo", "tau_hi", "tau_bias"))
    rewritten = problem.replace(A=np.vstack(A), b=np.concatenate(b), **without)
    first, second = solve(problem, settings), solve(rewritten, settings)
    assert_same(second.c, first.c)
    assert second.phi == pytest.approx(first.phi, rel=1e-9, abs=1e-9)


@on_both_backends(**COUNTS, planted=planted_problems(ceilings=True))
def test_engagement_and_ceiling_count_only_as_their_product(settings, planted):
    """Where there are no floors, which engagement scales as well."""
    problem = planted.problem.replace(c_min=None)
    merged = problem.replace(c_max=problem.engagement * problem.c_max, engagement=1.0)
    assert_same(solve(merged, settings).c, solve(problem, settings).c)


@on_both_backends(**COUNTS, planted=planted_problems(kinds=("PCWF", "SFC"), inequalities=1))
def test_a_row_given_twice_counts_twice(settings, planted):
    """Two equal rows weigh in Phi as one row does with twice the barrier: not redundant."""
    problem = planted.problem
    twice = problem.replace(A=np.vstack((problem.A, problem.A)), b=np.tile(problem.b, 2))
    slack, slack_twice = ((p.b - p.A @ solve(p, settings).c)[0] for p in (problem, twice))
    assert slack_twice > slack


@on_both_backends(**COUNTS, planted=planted_problems(least=4), rng=seeds)
def test_a_contact_with_engagement_0_is_no_contact(settings, planted, rng):
    problem = planted.problem
    if not problem.layout.ceilings:
        problem = problem.replace(c_max=100.0)
    out = int(rng.integers(problem.n))
    engagement = problem.engagement.copy()
    engagement[out] = 0.0
    gone = problem.replace(engagement=engagement)
    stay = np.arange(problem.n) != out
    columns = np.repeat(stay, [model.dim for model in problem.models])
    given = given_arguments(gone)
    changes = {
        name: given[name][stay] for name in ("c_max", "c_min", "engagement") if name in given
    }
    changes |= {"A": problem.A[:, columns]} if "A" in given else {}
    J = problem.J[columns]
    joints = J.any(axis=0)  # those of no other contact leave with it
    changes |= {
        name: given[name][joints] for name in ("tau_lo", "tau_hi", "tau_bias") if name in given
    }
    left = gone.replace(
        models=[model for model, here in zip(problem.models, stay, strict=True) if here],
        W=problem.W[:, columns],
        J=J[:, joints],
        **changes,
    )
    # Fewer fingers may not be able to: then ask for what they can do.
    f = left.W @ planted.c[columns]
    first, second = (gf.solve(p.replace(f=f), settings) for p in (gone, left))
    assert first.status is second.status
    assert not first.c[~columns].any()
    if first.status is gf.Status.SOLVED:
        assert_same(first.c[columns], second.c)


# ---- the equations -----------------------------------------------------------------------------


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_redundant_rows_of_the_grasp_map_change_nothing(settings, planted, rng):
    problem = planted.problem
    mix = np.vstack((np.eye(6), np.eye(6)[:1], rng.normal(size=(2, 6))))
    wider = problem.replace(W=mix @ problem.W, f=mix @ problem.f)
    first, second = solve(problem, settings), solve(wider, settings)
    assert_same(second.c, first.c)
    pull = problem.W.T @ first.nu
    assert wider.W.T @ second.nu == pytest.approx(pull, abs=1e-5 * np.abs(pull).max())


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_rows_that_contradict_each_other_are_out_of_reach(settings, planted, rng):
    problem = planted.problem
    wider = problem.replace(
        W=np.vstack((problem.W, problem.W[:1])), f=np.append(problem.f, problem.f[0] + 1.0)
    )
    solution = gf.solve(wider, settings)
    assert solution.status is gf.Status.WRENCH_UNREACHABLE
    assert solution.verify().ok


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_any_mixture_of_the_equations_is_the_same_equations(settings, planted, rng):
    problem = planted.problem
    left, right = (np.linalg.qr(rng.normal(size=(6, 6)))[0] for _ in range(2))
    mix = left @ np.diag(np.exp2(rng.uniform(-3, 3, 6))) @ right
    mixed = problem.replace(W=mix @ problem.W, f=mix @ problem.f)
    assert_same(solve(mixed, settings).c, solve(problem, settings).c)


@on_both_backends(reference=3, native=30, rng=seeds, kind=st.sampled_from(["PCWF", "SFC"]))
def test_two_opposed_contacts(settings, rng, kind):
    """Two point contacts cannot turn the object about the line through them; soft fingers can."""
    model = {"PCWF": gf.PCWF(0.6), "SFC": gf.SFC(0.6, 0.005)}[kind]
    R = Rotation.random(random_state=rng).as_matrix()
    axis = R[:, 0]
    contacts = [gf.Contact(s * 0.03 * axis, -s * axis, model, R[:, 1]) for s in (-1, 1)]
    problem = gf.Grasp(contacts).problem(np.zeros(6), c_max=20.0)
    assert np.linalg.matrix_rank(problem.W) == (5 if kind == "PCWF" else 6)
    # Inside the cones of a grip of 8 N, for any direction.
    force = rng.uniform(-1.5, 1.5, 3)
    torque = np.cross(0.03 * axis, R[:, 1:] @ rng.uniform(-1, 1, 2))
    carried = gf.solve(problem.replace(f=np.append(force, torque)), settings)
    assert carried.status is gf.Status.SOLVED
    assert carried.verify().ok
    twist = np.append(np.zeros(3), 0.01 * axis)
    turned = gf.solve(problem.replace(f=np.append(force, torque) + twist), settings)
    wanted = gf.Status.WRENCH_UNREACHABLE if kind == "PCWF" else gf.Status.SOLVED
    assert turned.status is wanted
    assert turned.verify().ok


@on_both_backends(**COUNTS, planted=planted_problems(kinds=("PCWF",)))
def test_a_planar_problem_is_the_spatial_one_with_the_other_forces_shut(settings, planted):
    """Rows [f_x, f_y, torque]: as leaving the equations of the other three away."""
    problem = planted.problem
    rows = [0, 1, 5]
    planar = problem.replace(W=problem.W[rows], f=problem.f[rows])
    solution = solve(planar, settings)
    assert solution.nu.shape == (3,)
    # It is the optimum of the spatial problem that asks for the wrench it makes.
    whole = problem.replace(f=problem.W @ solution.c)
    again = gf.solve(whole, settings, start=solution.c)
    assert again.status is gf.Status.SOLVED
    assert_same(again.c, solution.c)
    best = solve(problem, settings).phi
    assert solution.phi <= best + 1e-9 * abs(best)


# ---- alpha -------------------------------------------------------------------------------------


@on_both_backends(**COUNTS, planted=planted_problems())
def test_more_weight_on_the_limits_never_goes_nearer_to_them(settings, planted):
    """Phi_lin at the optimum never rises with alpha, and Phi_soc never falls."""
    problem = planted.problem
    A, b = problem.linear_limits()
    linear, cones = [], []
    for alpha in np.geomspace(0.01, 100, 7):
        solution = solve(problem.replace(alpha=alpha), settings)
        linear.append(-np.log(b - A @ solution.c).sum())
        cones.append(solution.phi - alpha * linear[-1])
    assert (np.diff(linear) <= 1e-7 * np.abs(linear).max()).all()
    assert (np.diff(cones) >= -1e-7 * np.abs(cones).max()).all()


@on_both_backends(**COUNTS, planted=planted_problems(), rng=seeds)
def test_the_least_objective_is_convex_in_the_wrench(settings, planted, rng):
    """Along the line between the wrenches of two forces inside the limits."""
    problem, c = planted.problem, planted.c
    step = np.abs(c) * rng.normal(size=problem.m)
    while gf.reference.objective(c + step, problem) == np.inf:
        step = step / 2
    ends = [problem.f, problem.W @ (c + step / 2)]
    phis = [
        solve(problem.replace(f=(1 - s) * ends[0] + s * ends[1]), settings).phi
        for s in (0.0, 0.5, 1.0)
    ]
    assert phis[1] <= (phis[0] + phis[2]) / 2 + 1e-9 * max(map(abs, phis))
