"""ForceProblem as a value: what it holds, how it is changed, copied and compared.

What it refuses is in test_bad_input.py.
"""

import pickle

import numpy as np
import pytest
from grasps import KINDS, plant

import graspforce as gf
from graspforce._engine import native

FULL = {"ceilings": True, "floors": True, "inequalities": 2, "bias": True, "rates": True}
ARRAYS = (
    "W", "f", "J", "internal", "tau_lo", "tau_hi", "tau_bias", "c_max", "c_min", "engagement",
    "pull", "f_soft", "c_last", "dc_max", "A", "b",
)  # fmt: skip


@pytest.fixture
def full(rng):
    """A problem with everything in it: 6 contacts of all kinds, every sort of limit, soft rows."""
    problem = plant(rng, KINDS * 2, alpha=3.0, spare=1, **FULL).problem
    internal = rng.normal(size=(2, problem.J.shape[1]))
    return problem.replace(f_soft=[0, 0.1, 0.2, 0, 0.01, 0.02], internal=internal)


@pytest.fixture
def bare(rng):
    """Two point contacts with a ceiling."""
    return gf.ForceProblem(rng.normal(size=(6, 6)), np.ones(6), gf.PCWF(0.5), c_max=[4.0, 5.0])


# ---- what it holds -----------------------------------------------------------------------------


def test_holds_what_it_was_given(rng):
    given = {
        "W": rng.normal(size=(6, 8)),
        "f": rng.normal(size=6),
        "J": rng.normal(size=(8, 5)),
        "tau_lo": -rng.uniform(1, 2, 5),
        "tau_hi": rng.uniform(1, 2, 5),
        "tau_bias": rng.normal(size=5),
        "c_max": rng.uniform(5, 9, 3),
        "c_min": rng.uniform(0, 1, 3),
        "engagement": rng.uniform(0.1, 1, 3),
        "A": rng.normal(size=(2, 8)),
        "b": rng.normal(size=2),
    }
    models = (gf.PCWF(0.4), gf.SFC(0.5, 0.006), gf.FPC())
    problem = gf.ForceProblem(**given, models=models, alpha=7)
    for name, value in given.items():
        assert np.array_equal(getattr(problem, name), value)
    assert problem.models == models
    assert problem.alpha == 7.0
    assert (problem.n, problem.m) == (3, 8)
    assert problem.starts == [0, 3, 7, 8]
    assert problem.mu.tolist() == [0.4, 0.5, 1.0]
    assert problem.gamma[1] == 0.006


def test_scalars_are_broadcast(rng):
    W, J = rng.normal(size=(6, 12)), rng.normal(size=(12, 7))
    problem = gf.ForceProblem(
        W, np.zeros(6), gf.PCWF(0.5), J=J, tau_lo=-0.5, tau_hi=0.75, tau_bias=0.25,
        c_max=10, c_min=1, engagement=0.5,
    )  # fmt: skip
    assert problem.models == (gf.PCWF(0.5),) * 4
    for name, size, value in [
        ("tau_lo", 7, -0.5),
        ("tau_hi", 7, 0.75),
        ("tau_bias", 7, 0.25),
        ("c_max", 4, 10),
        ("c_min", 4, 1),
        ("engagement", 4, 0.5),
    ]:
        assert getattr(problem, name).tolist() == [value] * size


@pytest.mark.parametrize("model", [gf.FPC(), gf.PCWF(0.5), gf.SFC(0.5, 0.01)], ids=str)
def test_one_model_stands_for_all_contacts(model):
    problem = gf.ForceProblem(np.ones((6, 12)), np.zeros(6), model, c_max=1)
    assert problem.models == (model,) * (12 // model.dim)


def test_defaults(bare):
    assert bare.alpha == 5.0
    assert bare.engagement.tolist() == [1, 1]
    for name in ("J", "tau_lo", "tau_hi", "tau_bias", "c_min", "A", "b"):
        assert getattr(bare, name).size == 0


def test_integers_and_lists_are_taken(rng):
    problem = gf.ForceProblem(
        [[1, 0, 2], [0, 1, 3]], [1, 2], [gf.FPC()] * 3, A=[[1, 1, 1]], b=[9], alpha=1
    )
    assert problem.W.dtype == problem.b.dtype == np.float64
    assert isinstance(problem.alpha, float)


@pytest.mark.parametrize("order", ["C", "F"])
def test_memory_layout_of_the_arguments_does_not_matter(rng, order):
    W = np.asarray(rng.normal(size=(6, 6)), order=order)
    problem = gf.ForceProblem(W, np.ones(6), gf.PCWF(0.5), c_max=4)
    assert np.array_equal(problem.W, W)
    strided = gf.ForceProblem(np.repeat(W, 2, axis=1)[:, ::2], np.ones(6), gf.PCWF(0.5), c_max=4)
    assert strided == problem


def test_arguments_are_copied(rng):
    W = rng.normal(size=(6, 6))
    problem = gf.ForceProblem(W, np.ones(6), gf.PCWF(0.5), c_max=4)
    before = problem.W.copy()
    W[:] = 0
    assert np.array_equal(problem.W, before)


# ---- frozen ------------------------------------------------------------------------------------


def test_arrays_are_read_only(full):
    for problem in (full, pickle.loads(pickle.dumps(full)), full.replace(alpha=1)):
        for name in (*ARRAYS, "mu", "gamma", "packed"):
            with pytest.raises(ValueError, match="read-only"):
                getattr(problem, name)[...] = 0


def test_attributes_cannot_be_set_or_deleted(full):
    with pytest.raises(AttributeError, match=r"frozen; use problem.replace\(f="):
        full.f = np.zeros(6)
    with pytest.raises(AttributeError, match="frozen"):
        del full.f
    with pytest.raises(AttributeError):
        full.novel = 1


# ---- replace, equality, pickle, from_packed ----------------------------------------------------


# A contact's pull is its model's, as mu and gamma are.
@pytest.mark.parametrize("name", [*(name for name in ARRAYS if name != "pull"), "alpha"])
def test_replace_changes_one_argument_and_nothing_else(full, name):
    value = getattr(full, name)
    changed = full.replace(**{name: value * 0.99})
    assert np.array_equal(getattr(changed, name), value * 0.99)
    for other in {*ARRAYS, "alpha"} - {name}:
        assert np.array_equal(getattr(changed, other), getattr(full, other))
    assert changed.models == full.models
    assert changed != full
    assert np.array_equal(getattr(full, name), value)


def test_replace_of_models_changes_mu_and_gamma(full):
    models = [gf.FPC(), gf.PCWF(0.11), gf.SFC(0.12, 0.013)] * 2
    changed = full.replace(models=models)
    assert changed.mu.tolist() == [1, 0.11, 0.12] * 2
    assert changed.gamma[[2, 5]].tolist() == [0.013] * 2
    assert np.array_equal(changed.W, full.W)


def test_replace_with_nothing_is_equal(full, bare):
    for problem in (full, bare):
        assert problem.replace() == problem
        assert hash(problem.replace()) == hash(problem)


def test_replace_validates(full):
    with pytest.raises(gf.InvalidInputError, match=r"^f: got shape \(3,\)"):
        full.replace(f=np.zeros(3))
    with pytest.raises(
        gf.InvalidInputError,
        match=r"^force: not an option of ForceProblem.replace; expected .*alpha",
    ):
        full.replace(force=np.zeros(6))


def test_replace_adds_and_removes_kinds_of_limits(full, bare):
    with_floor = bare.replace(c_min=1.0)
    assert with_floor.c_min.tolist() == [1, 1]
    assert with_floor.replace(c_min=None) == bare
    assert full.replace(A=None, b=None).A.shape == (0, full.m)


@pytest.mark.parametrize(
    "without", [{"c_max": None}, {"J": None, "tau_lo": None, "tau_hi": None}], ids=str
)
def test_replace_removes_limits_whose_companions_were_never_given(rng, without):
    """engagement and tau_bias were left at their defaults: they must not stand in the way."""
    problem = gf.ForceProblem(
        rng.normal(size=(6, 6)), np.ones(6), gf.PCWF(0.5), c_max=4.0,
        J=rng.normal(size=(6, 3)), tau_lo=-1, tau_hi=1,
    )  # fmt: skip
    assert problem.replace(**without) != problem


def test_arguments_make_an_equal_problem(full, bare):
    for problem in (full, bare):
        assert gf.ForceProblem(**problem.arguments()) == problem
    assert bare.arguments()["J"] is None


def test_equality_looks_at_everything(full, bare):
    assert full == full.replace()
    assert full != bare
    assert full != "problem"
    assert full.replace(models=[gf.FPC(), gf.PCWF(0.9), gf.SFC(0.9, 1.0)] * 2) != full
    assert len({full, full.replace(), bare}) == 2


def test_equal_problems_hash_equally_whatever_the_sign_of_zero(bare):
    plus, minus = bare.replace(f=np.zeros(6)), bare.replace(f=-np.zeros(6))
    assert plus == minus
    assert hash(plus) == hash(minus)


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_pickle(full, protocol):
    copy = pickle.loads(pickle.dumps(full, protocol))
    assert copy == full
    assert hash(copy) == hash(full)
    assert np.array_equal(copy.packed, full.packed)
    assert copy.layout == full.layout


def test_packed_round_trip(full, bare):
    for problem in (full, bare):
        again = gf.ForceProblem.from_packed(problem.layout, problem.packed.copy())
        assert again == problem
        for name in (*ARRAYS, "mu", "gamma"):
            assert np.array_equal(getattr(again, name), getattr(problem, name))
        assert again.alpha == problem.alpha
        assert gf.ForceProblem(**again.arguments()) == problem


@pytest.mark.parametrize("kind", ["full", "bare"])
def test_the_fields_are_those_of_the_core(request, kind):
    layout = request.getfixturevalue(kind).layout
    assert native.module.fields(layout) == [
        (name, slot.start, *(*slot.shape, 1, 1)[:2]) for name, slot in layout.slots.items()
    ]


def test_packed_is_all_fields_in_the_order_of_the_layout(full):
    slots = full.layout.slots
    assert list(slots) == [*ARRAYS, "mu", "gamma", "cone_weight", "alpha"]
    parts = [np.ravel(getattr(full, name)) for name in slots]
    assert np.array_equal(np.concatenate(parts), full.packed)
    for name, slot in slots.items():
        assert np.shape(getattr(full, name)) == slot.shape


def test_repr_tells_what_is_in_it(full, bare):
    assert "2 FPC + 2 PCWF + 2 SFC" in repr(full)
    for word in ("joints", "ceilings", "floors", "2 inequalities", "alpha=3"):
        assert word in repr(full)
    assert repr(bare).startswith("ForceProblem(2 PCWF; ceilings; f=[")
    assert "no limits" in repr(gf.ForceProblem(np.ones((1, 1)), [1], gf.FPC()))


# ---- linear limits -----------------------------------------------------------------------------


def rows_by_hand(problem, there):
    """Every limit as (row, bound), in the documented order, one joint or contact at a time."""
    rows, m = [], problem.m
    joints, normals = range(problem.J.shape[1]), problem.starts[:-1]
    for j in joints:
        rows.append((problem.J[:, j], problem.tau_hi[j] - problem.tau_bias[j]))
    for j in joints:
        rows.append((-problem.J[:, j], problem.tau_bias[j] - problem.tau_lo[j]))
    for i in range(len(problem.c_max)):
        rows.append((np.eye(m)[normals[i]], problem.engagement[i] * problem.c_max[i]))
    for i in range(len(problem.c_min)):
        rows.append((-np.eye(m)[normals[i]], -problem.engagement[i] * problem.c_min[i]))
    for side in (1, -1):
        for i in range(len(problem.dc_max)):
            bound = problem.dc_max[i] + side * problem.c_last[i]
            rows.append((side * np.eye(m)[i], bound))
    rows += zip(problem.A, problem.b, strict=True)
    columns = np.repeat(there, [model.dim for model in problem.models])
    return [(row * columns, bound) for row, bound in rows if (row * columns).any()]


def check_rows(problem, there):
    A, b = problem.linear_limits()
    wanted = rows_by_hand(problem, there)
    assert A.shape == (len(wanted), problem.m)
    assert np.array_equal(A, [row for row, _ in wanted])
    assert b == pytest.approx([bound for _, bound in wanted], rel=1e-15)
    assert problem.counted_limits().sum() == len(wanted)


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("removed", [None, 0, 1, 5])
@pytest.mark.parametrize("kinds", [{}, FULL, {"floors": True}, {"inequalities": 1}], ids=str)
def test_linear_limits_row_by_row(rng, shared, removed, kinds):
    problem = plant(rng, KINDS * 2, shared=shared, removed=removed, **kinds).problem
    there = np.ones(6, dtype=bool)
    if removed is not None:
        there[removed] = False
    assert problem.active.tolist() == there.tolist()
    check_rows(problem, there)


def test_a_row_that_touches_a_removed_and_a_present_contact_stays(rng):
    planted = plant(rng, ["FPC"] * 4, removed=2)
    m = planted.problem.m
    A = np.zeros((3, m))
    A[0, 2] = 1.0  # the removed contact alone: goes
    A[1, [1, 2]] = 1.0  # with another: stays, without the removed one's column
    A[2, 0] = 1.0
    problem = planted.problem.replace(A=A, b=[5.0, 6.0, 7.0])
    check_rows(problem, np.array([True, True, False, True]))
    rows, bounds = problem.linear_limits()
    assert bounds[-2:].tolist() == [6, 7]
    assert rows[-2].tolist() == np.eye(m)[1].tolist()


def test_a_row_of_zeros_is_kept_as_it_limits_everything(bare):
    """0·c ≤ b is no statement about removed contacts; it is true or false by itself."""
    problem = bare.replace(A=np.zeros((1, 6)), b=[2.0], engagement=[1.0, 0.0])
    rows, bounds = problem.linear_limits()
    assert bounds[-1] == 2.0
    assert not rows[-1].any()


@pytest.mark.parametrize(
    ("engagement", "there"), [(1e-6, False), (0.0, False), (1.001e-6, True), (1.0, True)]
)
def test_removal_threshold(bare, engagement, there):
    problem = bare.replace(engagement=[1.0, engagement])
    assert problem.active.tolist() == [True, there]
    assert len(problem.linear_limits()[1]) == 1 + there


# ---- without the contacts that are out ---------------------------------------------------------


@pytest.mark.parametrize("removed", [0, 1, 5])
@pytest.mark.parametrize("kinds", [{}, FULL, {"inequalities": 2, "shared": True}], ids=str)
def test_a_restricted_problem_is_the_whole_one_without_the_removed_contacts(rng, removed, kinds):
    problem = plant(rng, KINDS * 2, removed=removed, **kinds).problem
    inner, kept = problem.restricted(), problem.active_components
    assert inner.models == tuple(np.delete(np.array(problem.models, dtype=object), removed))
    assert np.array_equal(inner.W, problem.W[:, kept])
    assert inner.active.all()
    (A, b), (rows, bounds) = inner.linear_limits(), problem.linear_limits()
    assert np.array_equal(A, rows[:, kept])
    assert np.array_equal(b, bounds)
    for got, wanted in zip(inner.violation_scales(), problem.violation_scales(), strict=True):
        present = wanted if len(wanted) == len(bounds) else wanted[problem.active]
        assert got == pytest.approx(present, rel=1e-13)
    c = rng.normal(size=inner.m)
    assert np.array_equal(problem.scatter(c)[kept], c)
    assert not problem.scatter(c)[~kept].any()
    z = rng.uniform(size=len(bounds))
    assert np.array_equal(problem.scatter_multipliers(z)[problem.counted_limits()], z)
    # What passes the constructor is the same problem: nothing was left unsaid.
    assert gf.ForceProblem(**inner.arguments()) == inner
    assert gf.solve(inner).c == pytest.approx(gf.solve(problem).c[kept], rel=1e-6)


def test_a_restricted_problem_with_rate_limits(rng):
    base = plant(rng, ["PCWF", "FPC", "SFC", "PCWF"], removed=1).problem
    problem = base.replace(c_last=rng.normal(size=11), dc_max=rng.uniform(1, 2, 11))
    inner, kept = problem.restricted(), problem.active_components
    assert np.array_equal(inner.dc_max, problem.dc_max[kept])
    for got, wanted in zip(inner.linear_limits(), problem.linear_limits(), strict=True):
        assert np.array_equal(got, wanted[:, kept] if wanted.ndim == 2 else wanted)


def test_a_problem_with_all_its_contacts_is_its_own_restriction(rng):
    problem = plant(rng, KINDS).problem
    assert problem.restricted() is problem


def test_a_problem_that_every_contact_has_left(rng):
    problem = plant(rng, ["PCWF"] * 3, ceilings=True, inequalities=1).problem.replace(engagement=0)
    inner = problem.restricted()
    assert (inner.n, inner.m) == (0, 0)
    assert inner.W.shape == (6, 0)
    assert inner.linear_limits()[0].shape == (len(problem.linear_limits()[1]), 0)
    assert not problem.scatter(np.zeros(0)).any()
