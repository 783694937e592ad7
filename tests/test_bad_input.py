"""Every bad input: an InvalidInputError that names the argument, what came, what was expected.

What is mathematically impossible though well formed (no bound at all, a wrench out of reach,
rows of A that exclude each other) is a status instead, and is here too.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import graspforce as gf

RNG = np.random.default_rng(7)
W = RNG.normal(size=(6, 12))
J = RNG.normal(size=(12, 9))
GOOD = {
    "W": W,
    "f": np.ones(6),
    "models": [gf.PCWF(0.5)] * 4,
    "J": J,
    "tau_lo": -np.ones(9),
    "tau_hi": np.ones(9),
    "tau_bias": np.full(9, 0.1),
    "c_max": np.full(4, 8.0),
    "c_min": np.full(4, 0.5),
    "engagement": np.ones(4),
    "A": RNG.normal(size=(2, 12)),
    "b": np.full(2, 50.0),
    "alpha": 5.0,
}
ARRAYS = [name for name in GOOD if name not in ("models", "alpha")]
SCALAR_TOO = ("tau_lo", "tau_hi", "tau_bias", "c_max", "c_min", "engagement")


def refused(match, **changes):
    """Check that the constructor and replace() refuse alike, with a text matching ``match``."""
    with pytest.raises(gf.InvalidInputError, match=match):
        gf.ForceProblem(**(GOOD | changes))
    with pytest.raises(gf.InvalidInputError, match=match):
        gf.ForceProblem(**GOOD).replace(**changes)


def spoil(array, value, index=-1):
    spoiled = np.array(array, dtype=float)
    spoiled.flat[index] = value
    return spoiled


def test_the_good_problem_is_good():
    gf.ForceProblem(**GOOD)


# ---- shapes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARRAYS)
def test_one_too_many_in_any_direction(name):
    good = np.asarray(GOOD[name])
    for axis in range(good.ndim):
        bad = np.concatenate((good, np.take(good, [0], axis)), axis)
        # A longer W or J is the others' disagreement with it: the text names one of the two.
        other = {"W": ["f", "W"], "J": ["J", "tau_lo"], "A": ["A", "b"]}.get(name, [name])
        refused(rf"^({'|'.join(other)}): got (shape|\d+ columns).*, expected ", **{name: bad})


@pytest.mark.parametrize("name", ARRAYS)
def test_wrong_number_of_dimensions(name):
    good = np.asarray(GOOD[name])
    refused(rf"^{name}: got shape \(1, .*, expected shape \(", **{name: good[None]})
    refused(rf"^{name}: got shape \(.*, expected shape \(", **{name: good[0] + np.zeros((1, 1, 1))})


@pytest.mark.parametrize("name", [name for name in ARRAYS if name not in SCALAR_TOO])
def test_a_scalar_stands_only_for_what_is_one_number_a_joint_or_contact(name):
    refused(rf"^{name}: got shape \(\), expected shape \(", **{name: 1.0})


@pytest.mark.parametrize("name", ["W", "J", "A"])
def test_empty_matrices(name):
    refused(rf"^{name}: got shape \(0, 12\)|^{name}: got shape \(12, 0\)",
            **{name: np.zeros((12, 0) if name == "J" else (0, 12))})  # fmt: skip
    refused("^W: got shape", W=np.zeros((6, 0)))


# ---- what is no finite number ------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ARRAYS)
def test_not_finite_anywhere(name, value):
    good = np.asarray(GOOD[name])
    for index in (0, good.size // 2, -1):
        bad = spoil(good, value, index)
        where = ", ".join(str(int(i)) for i in np.argwhere(~np.isfinite(bad))[0])
        refused(rf"^{name}\[{where}\]: got {value}, expected finite", **{name: bad})


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_not_finite_scalars(value):
    for name in (*SCALAR_TOO, "alpha"):
        refused(rf"^{name}(\[0\])?: got {value}, expected finite", **{name: value})
    for make in (gf.PCWF, lambda x: gf.SFC(x, 0.01), lambda x: gf.SFC(0.5, x)):
        with pytest.raises(gf.InvalidInputError, match=f"got {value}, expected finite"):
            make(value)


@pytest.mark.parametrize(
    ("junk", "came"),
    [
        ("a word", "type str"),
        (["x"] * 6, "type str"),
        (np.ones(6) * 1j, "type complex128"),
        ([None] * 6, "type object"),
        (object(), "type object"),
        (np.ones(6, dtype=bool), "type bool"),
        ([[1, 2], [3]], "not a regular array"),
        ([10**400] * 6, "type object"),
    ],
)
@pytest.mark.parametrize("name", ARRAYS)
def test_no_numbers(name, junk, came):
    refused(rf"^{name}: .*{came}.*expected", **{name: junk})


@pytest.mark.parametrize("name", ["W", "f"])
def test_required_arrays(name):
    refused(rf"^{name}: got None, expected real numbers", **{name: None})


# ---- signs and ranges --------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0, -0.0, -1, -1e-300])
def test_friction_must_be_positive(value):
    with pytest.raises(gf.InvalidInputError, match=r"^PCWF\.mu: got .*, expected more than 0"):
        gf.PCWF(value)
    with pytest.raises(gf.InvalidInputError, match=r"^SFC\.mu: got .*, expected more than 0"):
        gf.SFC(value, 0.01)
    with pytest.raises(gf.InvalidInputError, match=r"^SFC\.gamma: got .* m, expected more than 0"):
        gf.SFC(0.5, value)


@pytest.mark.parametrize("value", [0, -1])
def test_alpha_must_be_positive(value):
    refused(rf"^alpha: got {value}.*, expected more than 0", alpha=value)


@pytest.mark.parametrize("value", ["5", None, [5.0], True])
def test_alpha_must_be_one_number(value):
    refused(r"^alpha: got (type|shape|None)", alpha=value)


@pytest.mark.parametrize("value", [0, -2])
def test_ceilings_must_be_positive(value):
    refused(
        rf"^c_max\[1\]: got {value}, expected more than 0", c_max=spoil(GOOD["c_max"], value, 1)
    )


def test_floors_must_not_be_negative():
    refused(r"^c_min\[3\]: got -0\.1, expected 0 or more", c_min=spoil(GOOD["c_min"], -0.1))
    assert gf.ForceProblem(**(GOOD | {"c_min": 0})).c_min.tolist() == [0] * 4


@pytest.mark.parametrize("value", [-0.01, 1.01, -1e-9, 5])
def test_engagement_lies_between_0_and_1(value):
    bad = spoil(GOOD["engagement"], value, 2)
    refused(rf"^engagement\[2\]: got {value:g}, expected 0 to 1", engagement=bad)


@pytest.mark.parametrize("gap", [0.0, 0.5])
def test_torque_limits_must_not_exclude_each_other(gap):
    lower = spoil(GOOD["tau_lo"], 1 + gap, 4)
    refused(rf"^tau_lo\[4\]: got {1 + gap:g}, expected less than tau_hi", tau_lo=lower)


@pytest.mark.parametrize("floor", [8.001, 9.0])
def test_a_floor_must_not_be_above_the_ceiling(floor):
    refused(rf"^c_min\[0\]: got {floor:g}, expected at most c_max",
            c_min=spoil(GOOD["c_min"], floor, 0))  # fmt: skip


# ---- what must come together -------------------------------------------------------------------


@pytest.mark.parametrize("missing", ["J", "tau_lo", "tau_hi"])
def test_jacobian_and_torque_limits_come_together(missing):
    refused(rf"^{missing}: missing; .* came without it, expected all of J, tau_lo, tau_hi or none",
            **{missing: None})  # fmt: skip


@pytest.mark.parametrize("given", ["J", "tau_lo", "tau_hi"])
def test_jacobian_or_limits_alone(given):
    none = dict.fromkeys(("J", "tau_lo", "tau_hi", "tau_bias")) | {given: GOOD[given]}
    refused(rf"^(J|tau_lo|tau_hi): missing; {given} came without it", **none)


def test_bias_without_joints():
    refused("^tau_bias: given without J", J=None, tau_lo=None, tau_hi=None)


def test_engagement_without_ceilings():
    refused("^engagement: given without c_max", c_max=None, engagement=np.full(4, 0.5))


@pytest.mark.parametrize(("missing", "given"), [("A", "b"), ("b", "A")])
def test_inequalities_come_with_both_sides(missing, given):
    refused(rf"^{missing}: missing; {given} came without it", **{missing: None})


# ---- contacts ----------------------------------------------------------------------------------


@pytest.mark.parametrize("models", [[], ()])
def test_no_contact_models(models):
    refused("^models: got no contacts, expected at least one", models=models)


@pytest.mark.parametrize(
    ("models", "name"),
    [
        (None, "models"),
        (0.5, "models"),
        ("PCWF", r"models\[0\]"),
        ([gf.PCWF(0.5)] * 3 + [0.5], r"models\[3\]"),
        ([gf.PCWF] * 4, r"models\[0\]"),
        (gf.PCWF, "models"),
    ],
    ids=str,
)
def test_no_contact_model(models, name):
    refused(rf"^{name}: got .*, expected", models=models)


@pytest.mark.parametrize(
    ("models", "wanted"),
    [([gf.PCWF(0.5)] * 3, 9), ([gf.SFC(0.5, 0.01)] * 4, 16), ([gf.FPC(), gf.PCWF(0.5)], 4)],
)
def test_models_that_do_not_add_up_to_the_columns_of_the_map(models, wanted):
    refused(f"^W: got 12 columns, expected {wanted}, the components of the {len(models)} contact",
            models=models)  # fmt: skip


def test_one_model_that_does_not_divide_the_columns():
    with pytest.raises(gf.InvalidInputError, match=r"^W: got 7 columns, expected 6"):
        gf.ForceProblem(np.ones((6, 7)), np.ones(6), gf.PCWF(0.5), c_max=1)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("point", (1, 2)),
        ("point", (1, 2, np.nan)),
        ("point", None),
        ("normal", (0, 0, 1, 0)),
        ("normal", (0, 0, 0)),
        ("normal", (0, 0, 1.1)),
        ("normal", (0, np.inf, 1)),
        ("tangent", (1, 0)),
        ("tangent", (0, 0, 1)),
        ("model", None),
        ("model", 0.5),
        ("model", "PCWF"),
        ("model", [gf.PCWF(0.5), gf.PCWF(0.6)]),
        ("model", gf.PCWF),
    ],
    ids=str,
)
def test_contact(argument, value):
    good = {"point": (0, 0, 0), "normal": (0, 0, 1), "model": gf.PCWF(0.5), "tangent": (1, 0, 0)}
    with pytest.raises(gf.InvalidInputError, match=rf"^{argument}(\[\d\])?: (got|not) .*expected"):
        gf.Contact(**(good | {argument: value}))


CONTACT = gf.Contact((0, 0, 0), (0, 0, 1), gf.PCWF(0.5))


@pytest.mark.parametrize(
    "contacts",
    [[], (), None, CONTACT, ["contact"], np.zeros((2, 3))],
    ids=["list", "tuple", "None", "one contact", "text", "array"],
)
@pytest.mark.parametrize("make", [gf.grasp_map, gf.Grasp])
def test_no_contacts(make, contacts):
    with pytest.raises(gf.InvalidInputError, match=r"^contacts(\[0\])?: got .*expected"):
        make(contacts)


def test_origin():
    with pytest.raises(gf.InvalidInputError, match=r"^origin: got shape \(2,\), expected"):
        gf.grasp_map([CONTACT], origin=(0, 0))


def test_unknown_option_of_a_grasps_problem():
    with pytest.raises((gf.InvalidInputError, TypeError), match="c_mux"):
        gf.Grasp([CONTACT]).problem(np.ones(6), c_mux=4)


# ---- settings, start ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tol", 0),
        ("tol", -1e-9),
        ("tol", 1.0),
        ("tol", np.nan),
        ("tol", "small"),
        ("tol", None),
        ("max_steps", 0),
        ("max_steps", -3),
        ("max_steps", 2.5),
        ("max_steps", np.nan),
        ("max_steps", "many"),
        ("backend", "fortran"),
        ("backend", None),
    ],
)
def test_settings(name, value):
    with pytest.raises(gf.InvalidInputError, match=rf"^{name}: got .*expected"):
        gf.Settings(**{name: value})


@pytest.mark.parametrize("start", [np.zeros(11), np.zeros((12, 1)), np.full(12, np.nan), "zero"])
def test_start(start, default):
    with pytest.raises(gf.InvalidInputError, match=r"^start(\[0\])?: got .*expected"):
        gf.solve(gf.ForceProblem(**GOOD), default, start=start)


# ---- well formed, but impossible: a status, never an exception ----------------------------------


def verdict(default, **changes):
    none = dict.fromkeys(("J", "tau_lo", "tau_hi", "tau_bias", "c_min", "A", "b", "engagement"))
    base = gf.ForceProblem(**(GOOD | none | {"c_max": 8.0} | changes))
    solution = gf.solve(base, default)
    assert np.isfinite(solution.c).all()
    assert solution.status.name in repr(solution)
    assert solution.message
    return solution


def test_no_bound_at_all(default):
    solution = verdict(default, c_max=None)
    assert solution.status is gf.Status.UNBOUNDED
    assert "c_max" in solution.message


def test_floors_alone_are_no_bound(default):
    grip = gf.ForceProblem(np.array([[1.0, -1.0]]), [0.0], gf.FPC(), c_min=1.0)
    assert gf.solve(grip, default).status is gf.Status.UNBOUNDED


def test_inequalities_that_bound_one_contact_of_many_are_no_bound(default):
    """Contacts 2 and 3 can still squeeze for ever between them."""
    W = np.array([[1.0, -1.0, 1.0, -1.0]])
    problem = gf.ForceProblem(W, [0.0], gf.FPC(), A=[[1.0, 0, 0, 0]], b=[3.0])
    assert gf.solve(problem, default).status is gf.Status.UNBOUNDED


def test_a_wrench_outside_the_range_of_the_map(default):
    flat = W.copy()
    flat[5] = flat[4]
    solution = verdict(default, W=flat, f=[0, 0, 0, 0, 1, -1])
    assert solution.status is gf.Status.WRENCH_UNREACHABLE
    assert solution.verify().ok
    assert "range of W" in solution.message


@pytest.mark.parametrize(
    ("twist", "status"),
    [
        (1e-6, gf.Status.WRENCH_UNREACHABLE),
        (-1e-7, gf.Status.WRENCH_UNREACHABLE),
        (1e-14, gf.Status.SOLVED),
    ],
)
def test_out_of_reach_by_more_than_rounding(default, twist, status):
    """Two point contacts cannot turn the object about the line between them, not even a little."""
    ends = [gf.Contact((s, 0, 0), (-s, 0, 0), gf.PCWF(0.5)) for s in (-1.0, 1.0)]
    solution = gf.solve(gf.Grasp(ends).problem([0, 0, 1.0, twist, 0, 0], c_max=9), default)
    assert solution.status is status
    assert solution.verify().ok


@pytest.mark.parametrize(
    ("A", "b"),
    [
        (np.vstack((np.eye(12)[0], -np.eye(12)[0])), [1.0, -2.0]),
        (np.zeros((1, 12)), [-1.0]),
        (np.eye(12)[:1], [-1.0]),
    ],
    ids=["two rows", "0 ≤ −1", "pulling"],
)
def test_inequalities_that_exclude_each_other_or_the_cones(default, A, b):
    solution = verdict(default, A=A, b=b)
    assert solution.status is gf.Status.INFEASIBLE
    assert gf.check_certificate(solution.problem, solution.certificate)


def test_every_contact_out_of_the_grasp(default):
    """Nobody holds the object: the wrench is out of reach, and that is the verdict."""
    solution = verdict(default, engagement=0.0)
    assert solution.status is gf.Status.WRENCH_UNREACHABLE
    assert not solution.c.any()


def test_every_contact_out_of_the_grasp_and_nothing_to_hold(default):
    solution = verdict(default, engagement=0.0, f=np.zeros(6))
    assert solution.status is gf.Status.SOLVED
    assert solution.verify().ok
    assert solution.phi == 0


# ---- whatever comes ----------------------------------------------------------------------------

numbers = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-3, 3)
junk = (
    st.none()
    | st.booleans()
    | numbers
    | st.text(max_size=3)
    | st.lists(numbers, max_size=13)
    | st.lists(st.lists(numbers, min_size=1, max_size=4), max_size=4)
    | st.sampled_from([object(), gf.PCWF(0.5), {"a": 1}, {1, 2}, 10**400, b"bytes", gf.FPC])
)


def complaint(make, **arguments):
    """The text of the refusal, or None where the arguments are taken."""
    try:
        make(**arguments)
    except gf.InvalidInputError as error:
        return str(error)
    return None


@given(name=st.sampled_from(list(GOOD)), value=junk)
def test_any_junk_in_any_argument_is_taken_or_refused_by_name(name, value):
    text = complaint(gf.ForceProblem, **(GOOD | {name: value}))
    if text is not None:
        assert "expected" in text or "given without" in text
        assert text.split(":")[0].split("[")[0] in GOOD


@given(name=st.sampled_from(["point", "normal", "model", "tangent"]), value=junk)
def test_any_junk_in_any_argument_of_a_contact_is_taken_or_refused_by_name(name, value):
    good = {"point": (0, 0, 0), "normal": (0, 0, 1), "model": gf.PCWF(0.5), "tangent": (1, 0, 0)}
    text = complaint(gf.Contact, **(good | {name: value}))
    if text is not None:
        assert text.split(":")[0].split("[")[0] == name


SIZES = [1e-300, 1e-160, 1e-60, 1e60, 1e160, 1e300]


@pytest.mark.filterwarnings("ignore:.*:RuntimeWarning")  # NumPy warns of the overflow; allowed
@pytest.mark.parametrize("name", ["W", "f", "J", "tau_hi", "c_max", "A", "b", "alpha", "mu"])
@pytest.mark.parametrize("size", SIZES)
def test_numbers_of_any_size_end_in_a_status_and_finite_forces(default, name, size):
    changes = {name: np.asarray(GOOD.get(name)) * size} if name != "mu" else {}
    if name == "mu":
        changes = {"models": gf.PCWF(size)}
    elif name == "alpha":
        changes = {"alpha": 5 * size}
    elif name == "tau_hi":
        changes |= {"tau_lo": -changes["tau_hi"]}
    problem = gf.ForceProblem(**(GOOD | {"c_min": None} | changes))
    solution = gf.solve(problem, default)
    assert isinstance(solution.status, gf.Status)
    assert np.isfinite(solution.c).all()
    assert np.isfinite(solution.nu).all()
    if solution.status is gf.Status.SOLVED:
        assert solution.verify().ok
