"""Columns of many solutions: each row says what its Solution says."""

import math

import numpy as np
import pytest
from grasps import plant

import graspforce as gf
from graspforce._engine import native
from graspforce.batch import BatchProblems
from graspforce.columns import Columns

VECTORS = ("c", "nu", "tau", "normal_forces", "friction_margins", "torque_margins")
NUMBERS = (
    "newton_steps", "decrement", "suboptimality", "violation", "phi", "friction_residual",
    "torque_residual", "wrench_error",
)  # fmt: skip


def make_problems():
    """All kinds of contacts and limits, solvable or not, with and without removed contacts."""
    rng = np.random.default_rng(7)
    options = (
        {}, {"ceilings": True}, {"floors": True}, {"rates": True}, {"inequalities": 3},
        {"bias": True, "shared": True}, {"removed": 1}, {"hand": False},
        {"ceilings": True, "floors": True, "rates": True, "inequalities": 2},
    )  # fmt: skip
    kinds = (["PCWF"] * 3, ["SFC", "PCWF", "FPC"], ["FPC"] * 7, ["SFC"] * 4)
    problems = [
        plant(rng, each, **option).problem for option in options for each in kinds for _ in range(2)
    ]
    problems += [problem.replace(f=20 * problem.f) for problem in problems[::5]]
    free = gf.ForceProblem(np.eye(6, 9), [0, 0, 1, 0, 0, 0], gf.PCWF(0.5))
    return [*problems, free]


@pytest.fixture(scope="module")
def columns():
    return Columns(gf.solve(problem) for problem in make_problems())


def test_columns_have_every_case(columns):
    statuses = set(columns.rows("status"))
    assert {gf.Status.SOLVED, gf.Status.INFEASIBLE} < statuses
    assert len({solution.problem.layout for solution in columns}) > 20
    assert any(not solution.problem.active.all() for solution in columns)


@pytest.mark.parametrize("name", NUMBERS)
def test_columns_of_numbers_are_those_of_the_solutions(columns, name):
    expected = [getattr(solution, name) for solution in columns]
    np.testing.assert_allclose(getattr(columns, name), expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", VECTORS)
def test_columns_of_vectors_are_those_of_the_solutions_filled_up_with_nan(columns, name):
    column = getattr(columns, name)
    assert column.shape == (len(columns), max(len(getattr(each, name)) for each in columns))
    for row, solution in zip(column, columns, strict=True):
        expected = getattr(solution, name)
        np.testing.assert_allclose(row[: len(expected)], expected, rtol=1e-10, atol=1e-12)
        assert np.isnan(row[len(expected) :]).all()


def test_columns_of_verdicts(columns):
    assert columns.status.dtype == np.int64
    assert columns.status.tolist() == [int(solution.status) for solution in columns]
    assert columns.solved.tolist() == [each.status is gf.Status.SOLVED for each in columns]
    largest = [np.abs(each.tau).max(initial=0.0) for each in columns]
    np.testing.assert_allclose(columns.max_torque, largest, rtol=1e-10)


def test_columns_of_one_layout_hold_no_nan_and_fields_keep_their_shape():
    problems = list(gf.scenarios.regrasp(duration=0.1).problems())
    columns = Columns(map(gf.solve, problems))
    assert columns.torque_margins.shape == (25, 12)
    assert np.isfinite(columns.torque_margins).all()
    np.testing.assert_array_equal(columns.field("W"), [problem.W for problem in problems])
    assert columns.field("alpha").tolist() == [5.0] * 25


def test_columns_of_many_solutions_are_all_there():
    """More than are computed together."""
    first, second = (gf.solve(p) for p in gf.scenarios.dynamic(duration=0.008).problems())
    columns = Columns([first] * 5000 + [second] * 2)
    np.testing.assert_allclose(columns.phi[:5000], first.phi, rtol=1e-12)
    np.testing.assert_allclose(columns.phi[5000:], second.phi, rtol=1e-12)


def test_columns_are_a_sequence_of_their_solutions(columns):
    assert columns[-1] is list(columns)[-1]
    part = columns[2:5]
    assert isinstance(part, Columns)
    assert [*part] == [columns[2], columns[3], columns[4]]
    assert repr(part) == f"Columns(3 solutions, {int(part.solved.sum())} solved)"


def test_columns_of_no_solutions():
    assert len(Columns([])) == 0
    assert Columns([]).newton_steps.size == 0


def test_messages_and_certificates_are_those_of_the_solutions(columns):
    assert columns.messages() == [solution.message for solution in columns]
    y, z = columns.certificates()
    for i, solution in enumerate(columns):
        proof = solution.certificate
        assert len(y[i]) == (0 if proof is None else len(solution.nu))
        if proof is not None:
            assert gf.Certificate(y[i], z[i]) == proof


def test_the_first_flaw_of_many_problems_is_that_of_one_by_one(rng):
    """Also where the limits of different rows cross, but of none its own."""
    J, count = rng.normal(size=(9, 4)), 50
    W, f = rng.normal(size=(count, 6, 9)), rng.normal(size=(count, 6))
    low = rng.uniform(-3, 3, size=(count, 4))
    given = {"J": J, "tau_lo": low, "tau_hi": low + 0.1, "c_max": rng.uniform(2, 9, (count, 3))}
    given |= {"c_min": given["c_max"] - 1, "alpha": rng.uniform(1, 5, count)}
    flaws = {
        "W": math.nan, "f": math.inf, "tau_lo": 4.0, "tau_hi": -4.0, "c_max": 0.0, "c_min": 10.0,
        "alpha": -1.0,
    }  # fmt: skip
    for name, value in ({"": 0.0} | flaws).items():
        fields = {key: np.array(each) for key, each in ({"W": W, "f": f} | given).items()}
        expected = None
        if name:
            row = int(rng.integers(count))
            fields[name][(row, *np.zeros(fields[name].ndim - 1, dtype=int))] = value
            if row + 1 < count:
                fields[name][row + 1] = value
            own = {key: each[row] if key != "J" else each for key, each in fields.items()}
            with pytest.raises(gf.InvalidInputError) as caught:
                gf.ForceProblem(models=gf.PCWF(0.5), **own)
            expected = (row, str(caught.value))
        found = BatchProblems.of(gf.PCWF(0.5), fields).first_flaw()
        assert (found and (found[0], native.describe(found[1]))) == expected
