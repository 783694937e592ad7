"""The equations as functions of arrays: a batch is its rows, and each has one living function."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest
from grasps import cone_margins, cone_matrix, inside_forces, plant, random_model

import graspforce as gf
from graspforce import equations as eq
from graspforce import reference

PACKAGE = Path(gf.__file__).parent
KINDS = ["PCWF", "FPC", "SFC", "PCWF"]
DIMS = (3, 1, 4, 3)
ROWS = (2, 3)  # the leading axes of the batch


class Batch:
    """Problems of one shape, their contacts' coefficients too each its own."""

    def __init__(self, rng):
        self.planted = [
            plant(rng, KINDS, alpha=10 ** rng.uniform(-1, 1), ceilings=True) for _ in range(6)
        ]
        problems = [each.problem for each in self.planted]
        most = min(len(each.linear_limits()[1]) for each in problems)
        self.rows = [
            {
                "c": each.c * (1 + 0.01 * rng.normal(size=len(each.c))),
                "mu": problem.mu,
                "gamma": problem.gamma,
                "W": problem.W,
                "f": problem.f,
                "A": problem.linear_limits()[0][:most],
                "b": problem.linear_limits()[1][:most],
                "alpha": problem.alpha,
                "J": rng.normal(size=(11, 5)),
                "tau_lo": -rng.uniform(1, 2, 5),
                "tau_hi": rng.uniform(1, 2, 5),
                "engagement": rng.uniform(0.1, 1, 4),
                "c_max": rng.uniform(5, 10, 4),
                "N": rng.normal(size=(11, 4)),
                "lam": 1e-3 * rng.normal(size=4),
                "scales": (rng.uniform(1, 2, most), rng.uniform(1, 2, 4)),
            }
            for each, problem in zip(self.planted, problems, strict=True)
        ]

    @property
    def stacked(self):
        def stack(name):
            values = [row[name] for row in self.rows]
            if name == "scales":
                return tuple(np.reshape(part, (*ROWS, -1)) for part in zip(*values, strict=True))
            return np.reshape(values, (*ROWS, *np.shape(values[0])))

        return {name: stack(name) for name in self.rows[0]}


@pytest.fixture(scope="module")
def batch():
    return Batch(np.random.default_rng(31))


def cones(v):
    return eq.Cones.of(DIMS, v["mu"], v["gamma"])


def barriers(v):
    return eq.Barriers(cones(v), v["A"], v["b"], v["alpha"])


def contact(v):
    """The soft finger's force and scaling."""
    return eq.by_contact(v["c"], DIMS)[..., 2, :], cones(v).scaling[..., 2, :]


FUNCTIONS = {
    "slacks": lambda v: eq.slacks(v["c"], v["A"], v["b"]),
    "phi_lin": lambda v: eq.phi_lin(v["c"], v["A"], v["b"]),
    "grad_phi_lin": lambda v: eq.grad_phi_lin(v["c"], v["A"], v["b"]),
    "hess_phi_lin": lambda v: eq.hess_phi_lin(v["c"], v["A"], v["b"]),
    "by_contact": lambda v: eq.by_contact(v["c"], DIMS),
    "stacked": lambda v: eq.stacked(eq.by_contact(v["c"], DIMS), DIMS),
    "split": lambda v: eq.split(v["c"], DIMS)[2],
    "R_mu": lambda v: eq.R_mu(contact(v)[1]),
    "g": lambda v: eq.g(*contact(v)),
    "phi_soc": lambda v: eq.phi_soc(v["c"], cones(v)),
    "grad_phi_soc_contact": lambda v: eq.grad_phi_soc_contact(*contact(v)),
    "grad_phi_soc": lambda v: eq.grad_phi_soc(v["c"], cones(v)),
    "hess_phi_soc_contact": lambda v: eq.hess_phi_soc_contact(*contact(v)),
    "hess_phi_soc": lambda v: eq.hess_phi_soc(v["c"], cones(v)),
    "joint_torques": lambda v: eq.joint_torques(v["c"], v["J"], v["tau_lo"]),
    "torque_limits": lambda v: eq.torque_limits(v["J"], v["tau_lo"], v["tau_hi"]),
    "ceilings": lambda v: eq.ceilings(DIMS, v["engagement"], v["c_max"])[1],
    "inside_cones": lambda v: eq.inside_cones(v["c"], cones(v)),
    "strictly_inside": lambda v: eq.strictly_inside(v["c"], barriers(v), eq.ROUNDING),
    "objective": lambda v: eq.objective(v["c"], barriers(v)),
    "derivatives": lambda v: eq.derivatives(v["c"], barriers(v)),
    "reduced_objective": lambda v: eq.reduced_objective(v["lam"], v["c"], v["N"], barriers(v)),
    "reduced_derivatives": lambda v: eq.reduced_derivatives(v["c"], v["N"], barriers(v)),
    "newton_step": lambda v: eq.newton_step(*eq.derivatives(v["c"], barriers(v))),
    "friction_residual": lambda v: eq.friction_residual(v["c"], cones(v)),
    "friction_margins": lambda v: eq.friction_margins(v["c"], cones(v)),
    "dual_margins": lambda v: eq.dual_margins(v["c"], cones(v)),
    "torque_margins": lambda v: eq.torque_margins(0.9 * v["tau_lo"], v["tau_lo"], v["tau_hi"]),
    "relative_violation": lambda v: eq.relative_violation(v["c"], barriers(v), v["scales"]),
    "force_size": lambda v: eq.force_size(barriers(v), v["f"]),
    "wrench_error": lambda v: eq.wrench_error(v["c"], v["W"], v["f"]),
    "relative_wrench_error": lambda v: eq.relative_wrench_error(v["c"], v["W"], v["f"]),
    "factored_derivatives": lambda v: eq.factored_derivatives(v["c"], barriers(v)),
}
# For one problem: the rank of W decides a shape, or the arguments are plain numbers.
SINGLE = {
    "particular_and_nullspace", "wrench_reachable", "decrement_and_error", "decrements_and_errors",
    "least_squares", "may_overflow", "decrement_after", "suboptimality", "undetermined",
    "backtrack",
}  # fmt: skip


def test_every_function_is_here():
    public = {
        node.name
        for node in ast.parse((PACKAGE / "equations.py").read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    }
    assert public == set(FUNCTIONS) | SINGLE


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_batch_is_its_rows(name, batch):
    whole, single = FUNCTIONS[name](batch.stacked), [FUNCTIONS[name](row) for row in batch.rows]
    if not isinstance(whole, tuple):
        whole, single = (whole,), [(each,) for each in single]
    for got, *wanted in zip(whole, *single, strict=True):
        assert got.shape == (*ROWS, *np.shape(wanted[0]))
        assert got.reshape(np.shape(wanted)) == pytest.approx(np.array(wanted), rel=1e-9, abs=1e-12)


def test_rows_outside_are_infinite_and_leave_the_others_alone(batch):
    values = batch.stacked
    good = eq.objective(values["c"], barriers(values))
    c = np.array(values["c"])
    c[0, 1] *= -1
    c[1, 2, 0] = np.nan
    found = eq.objective(c, barriers(values))
    assert found[0, 1] == found[1, 2] == np.inf
    found[0, 1], found[1, 2] = good[0, 1], good[1, 2]
    assert np.array_equal(found, good)


def test_scaled_forces_make_every_cone_the_same(rng):
    """s = scaling·y is what the tests' own matrix of the cone says."""
    for kind in ("FPC", "PCWF", "SFC"):
        model = random_model(rng, kind)
        y = inside_forces(rng, [model])
        s = model.cone_scaling * y
        assert s == pytest.approx(cone_matrix(model) @ y, rel=1e-15)
        assert s[0] > np.linalg.norm(s[1:])


def test_dual_margins_are_the_least_product_with_the_cone(rng):
    models = [random_model(rng, kind) for kind in KINDS]
    found = eq.Cones.of_models(models)
    e = rng.normal(size=11)
    margins = eq.dual_margins(e, found)
    for model, part, margin in zip(models, eq.split(e, DIMS), margins, strict=True):
        # The generators (1, mu u) of the cone, the torsion gamma.
        u = rng.normal(size=(20000, model.dim - 1))
        u /= np.linalg.norm(u, axis=1, keepdims=True) if model.dim > 1 else 1
        edge = np.column_stack(
            (np.ones(len(u)), model.cone_scaling[0] * u / model.cone_scaling[1:])
        )
        least = (edge @ part).min()
        assert margin == pytest.approx(least, abs=2e-2 * np.linalg.norm(part) * (1 + model.mu))
        assert least >= margin - 1e-12


def test_margins_of_small_numbers_do_not_vanish(rng):
    models = [random_model(rng, kind) for kind in KINDS]
    c = inside_forces(rng, models)
    wanted = cone_margins(c, models)
    for size in (1e-200, 1e200):
        found = eq.friction_margins(size * c, eq.Cones.of_models(models))
        assert found / size == pytest.approx(wanted, rel=1e-12)


def test_factors_of_the_derivatives(batch):
    """∇Phi = Gᵀγ and ∇²Phi = GᵀG, of Phi / min(1, alpha)."""
    for row in batch.rows:
        G, gamma = eq.factored_derivatives(row["c"], barriers(row))
        gradient, hessian = eq.derivatives(row["c"], barriers(row))
        unit = min(1.0, row["alpha"])
        assert G.T @ gamma == pytest.approx(gradient / unit, rel=1e-9, abs=1e-9)
        assert np.abs(G.T @ G - hessian / unit).max() <= 1e-10 * np.abs(hessian / unit).max()


def test_the_slack_of_a_cone_keeps_its_digits_near_the_boundary():
    """(mu n − ‖t‖)(mu n + ‖t‖) in whole numbers and powers of two, where squares lose half."""
    scaling = gf.PCWF(1.0).cone_scaling
    y = np.array([1 + 2.0**-40, 1.0, 0.0])
    assert eq.g(y, scaling) == 2.0**-40 * (2 + 2.0**-40)


def test_one_living_function_for_every_equation():
    """Every function of the table is called by the package, not only defined and given out."""
    called = set()
    for path in PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for function in ast.walk(tree):
            if not isinstance(function, ast.FunctionDef):
                continue
            for node in ast.walk(function):
                if isinstance(node, ast.Call):
                    name = getattr(node.func, "id", getattr(node.func, "attr", None))
                    # The reference's function of the same name only gives the other one out.
                    if name != function.name or path.name != "reference.py":
                        called.add(name)
    table = re.findall(r"\(\d+\)\s+([A-Za-z_, ]+?)(?=\s{2,}|\n)", reference.__doc__)
    names = {name for row in table for name in row.split(", ")}
    assert len(names) == 19
    assert names <= called


def test_equations_stand_below_the_problem_and_the_solver():
    tree = ast.parse((PACKAGE / "equations.py").read_text(encoding="utf-8"))
    modules = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert {m for m in modules if m.startswith("graspforce")} == {
        "graspforce._util.arrays",
        "graspforce.contact",
    }


def test_answers_and_other_methods_do_not_stand_on_the_reference():
    importing = re.compile(
        r"^\s*from graspforce(\.reference)? import.*\breference\b|graspforce\.reference import",
        re.M,
    )
    files = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if importing.search(path.read_text(encoding="utf-8"))
    }
    assert files == {"_engine/dispatch.py"}


def test_errors_import_nothing_of_the_package():
    tree = ast.parse((PACKAGE / "errors.py").read_text(encoding="utf-8"))
    modules = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert not {m for m in modules if m.startswith("graspforce")}
