"""The NumPy transcription of the paper: every equation against its definition.

Gradients and Hessians are checked by complex step: Im F(x + i h e)/h is the derivative with no
subtraction, hence to the last digits.
"""

import math
import re

import numpy as np
import pytest
from grasps import KINDS, cone_gradient, cone_margins, inside_forces, plant, random_model

import graspforce as gf
from graspforce import reference

H = 1e-30
MODELS = [
    gf.FPC(),
    gf.PCWF(0.5),
    gf.PCWF(1.3),
    gf.SFC(0.7, 0.004),
    gf.SFC(0.4, 2.0),
]
DIGITS = 1e-12


def derivative(function, x):
    """Jacobian of ``function`` by complex step; the last axis is x's."""
    columns = [np.imag(function(x + 1j * H * e)) / H for e in np.eye(len(x))]
    return np.stack(columns, axis=-1)


def close(got, wanted):
    """Agreement to DIGITS of the largest entry."""
    got, wanted = np.asarray(got), np.asarray(wanted)
    assert got.shape == wanted.shape
    assert np.abs(got - wanted).max() <= DIGITS * np.abs(wanted).max()


@pytest.fixture
def polyhedron(rng):
    A = rng.normal(size=(9, 5))
    x = rng.normal(size=5)
    return x, A, A @ x + rng.uniform(0.1, 2, 9)


@pytest.fixture
def mixed(rng):
    models = [random_model(rng, kind) for kind in KINDS * 2]
    return inside_forces(rng, models), models


# ---- III-A -------------------------------------------------------------------------------------


def test_eq5_slacks(polyhedron):
    x, A, b = polyhedron
    assert reference.slacks(x, A, b).tolist() == pytest.approx(
        [b[i] - sum(A[i, j] * x[j] for j in range(5)) for i in range(9)]
    )


def test_eq6_is_the_sum_of_natural_logs(polyhedron):
    x, A, b = polyhedron
    assert reference.phi_lin(x, A, b) == pytest.approx(-sum(map(math.log, b - A @ x)), rel=1e-13)


def test_eq7_gradient_and_hessian(polyhedron):
    x, A, b = polyhedron
    close(reference.grad_phi_lin(x, A, b), derivative(lambda z: reference.phi_lin(z, A, b), x))
    close(reference.hess_phi_lin(x, A, b), derivative(lambda z: reference.grad_phi_lin(z, A, b), x))


# ---- III-B -------------------------------------------------------------------------------------


def test_eq8_split_and_stack(mixed):
    c, models = mixed
    parts = reference.split(c, models)
    assert [len(part) for part in parts] == [model.dim for model in models]
    assert np.concatenate(parts).tolist() == c.tolist()


def test_eq9_is_the_sum_of_the_logs_of_the_cones(mixed):
    c, models = mixed
    total, start = 0.0, 0
    for model in models:
        n, *t = c[start : start + model.dim]
        start += model.dim
        match model:
            case gf.FPC():
                total -= math.log(n**2)
            case gf.PCWF(mu):
                total -= math.log(mu**2 * n**2 - t[0] ** 2 - t[1] ** 2)
            case gf.SFC(mu, gamma):
                total -= math.log(mu**2 * n**2 - t[0] ** 2 - t[1] ** 2 - (mu / gamma * t[2]) ** 2)
    assert reference.phi_soc(c, models) == pytest.approx(total, rel=1e-13)


def test_a_frictionless_contacts_barrier_is_minus_two_log_n():
    assert reference.phi_soc(np.array([3.0]), [gf.FPC()]) == pytest.approx(-2 * math.log(3))


@pytest.mark.parametrize("model", MODELS, ids=str)
def test_eq10_matrix_of_the_cone(model, rng):
    R = reference.R_mu(model)
    assert np.array_equal(R, R.T)
    y = inside_forces(rng, [model])
    assert reference.g(y, model) == pytest.approx(-(y @ R @ y))
    assert reference.g(y, model) > 0
    if model.dim > 1:
        edge = y.copy()
        edge[0] = np.linalg.norm(np.sqrt(np.diag(R)[1:]) * y[1:]) / model.mu
        assert reference.g(edge, model) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("model", MODELS, ids=str)
@pytest.mark.parametrize("share", [0.0, 0.5, 0.999])
def test_eq11_and_13_by_complex_step(model, share):
    y = np.array([2.0, 0.8, 0.6, 0.0][: model.dim])
    if model.dim == 4:
        y[1:] = [0.6 * 0.8, 0.8 * 0.8, 0.6 * model.gamma / model.mu]
    y[1:] *= share * getattr(model, "mu", 1) * 2.0
    close(
        reference.grad_phi_soc_contact(y, model),
        derivative(lambda z: reference.phi_soc(z, [model]), y),
    )
    close(
        reference.hess_phi_soc_contact(y, model),
        derivative(lambda z: reference.grad_phi_soc_contact(z, model), y),
    )


def test_eq12_and_14_by_complex_step(mixed):
    c, models = mixed
    close(reference.grad_phi_soc(c, models), derivative(lambda z: reference.phi_soc(z, models), c))
    close(
        reference.hess_phi_soc(c, models),
        derivative(lambda z: reference.grad_phi_soc(z, models), c),
    )
    close(reference.grad_phi_soc(c, models), cone_gradient(c, models))


# ---- III-C -------------------------------------------------------------------------------------


def test_eq15_and_20_as_rows(rng):
    J = rng.normal(size=(7, 4))
    lo, hi, c = -rng.uniform(1, 2, 4), rng.uniform(1, 2, 4), rng.normal(size=7)
    A, b = reference.torque_limits(J, lo, hi)
    assert b - A @ c == pytest.approx(np.concatenate((hi - J.T @ c, J.T @ c - lo)))
    models = [gf.PCWF(0.5), gf.FPC(), gf.PCWF(0.4)]
    A, b = reference.ceilings(models, np.array([1, 0.5, 0.25]), np.array([8.0, 6.0, 4.0]))
    assert (b - A @ c).tolist() == pytest.approx([8 - c[0], 3 - c[3], 1 - c[4]])


def test_eq16_objective_and_its_derivatives(rng):
    planted = plant(
        rng, KINDS * 2, alpha=2.5, ceilings=True, floors=True, inequalities=2, bias=True
    )
    problem, c = planted.problem, planted.c
    A, b = problem.linear_limits()

    def phi(z):
        return reference.phi_soc(z, problem.models) + 2.5 * reference.phi_lin(z, A, b)

    def slope(z):
        return reference.grad_phi_soc(z, problem.models) + 2.5 * reference.grad_phi_lin(z, A, b)

    assert reference.objective(c, problem) == pytest.approx(phi(c).real)
    gradient, hessian = reference.derivatives(c, problem)
    close(gradient, derivative(phi, c))
    close(hessian, derivative(slope, c))
    assert reference.objective(-c, problem) == math.inf  # pulling
    assert reference.objective(100 * c, problem) == math.inf  # beyond the limits


def test_eq16_inside_the_mirrored_cone_is_outside():
    """g > 0 also for −c: the objective must look at the sign of the normal force."""
    problem = gf.ForceProblem(np.ones((1, 2)), [1.0], gf.FPC(), c_max=5.0)
    assert reference.objective(np.array([2.0, -1.0]), problem) == math.inf


@pytest.mark.parametrize("rank", [6, 5, 3])
def test_eq17_particular_solution_and_nullspace(rng, rank):
    W = rng.normal(size=(6, rank)) @ rng.normal(size=(rank, 11))
    f = W @ rng.normal(size=11)
    c_p, N = reference.particular_and_nullspace(W, f)
    assert W @ c_p == pytest.approx(f, abs=1e-12)
    assert N.shape == (11, 11 - rank)
    assert np.abs(W @ N).max() < 1e-13
    assert np.abs(N.T @ N - np.eye(11 - rank)).max() < 1e-13


def test_eq17_rank_does_not_depend_on_the_units_of_the_rows(rng):
    """Torques in N·m of a hand of 1 mm are a million times smaller than forces."""
    W = rng.normal(size=(6, 9)) * np.array([1, 1, 1, 1e-12, 1e-12, 1e-12])[:, None]
    assert reference.particular_and_nullspace(W, W @ np.ones(9))[1].shape == (9, 3)


def test_eq18_and_19_in_the_reduced_variables(rng):
    planted = plant(rng, ["PCWF"] * 4, ceilings=True)
    problem = planted.problem
    c_p, N = reference.particular_and_nullspace(problem.W, problem.f)
    lam = N.T @ (planted.c - c_p)
    assert c_p + N @ lam == pytest.approx(planted.c)
    assert reference.reduced_objective(lam, c_p, N, problem) == pytest.approx(
        reference.objective(planted.c, problem)
    )
    gradient, hessian = reference.reduced_derivatives(planted.c, N, problem)
    full_gradient, full_hessian = reference.derivatives(planted.c, problem)
    assert gradient == pytest.approx(N.T @ full_gradient)
    assert hessian == pytest.approx(N.T @ full_hessian @ N)
    # Planted: the reduced gradient vanishes at the optimum.
    assert np.abs(gradient).max() < 1e-9 * np.abs(full_gradient).max()


def test_eq21_solves_the_newton_system(rng):
    B = rng.normal(size=(6, 6)) * 10.0 ** np.arange(-6, 6, 2)
    hessian, gradient = B.T @ B + np.diag(10.0 ** np.arange(-12, 12, 4)), rng.normal(size=6)
    step = reference.newton_step(gradient, hessian)
    residual = hessian @ step + gradient
    assert np.abs(residual).max() < 1e-6 * (np.abs(hessian) @ np.abs(step)).max()


def test_eq22_and_the_margins(mixed):
    c, models = mixed
    parts = [
        reference.g(part, model)
        for part, model in zip(reference.split(c, models), models, strict=True)
    ]
    assert reference.friction_residual(c, models) == min(parts)
    assert reference.friction_margins(c, models) == pytest.approx(cone_margins(c, models))


def test_decrement_is_the_length_of_the_newton_step(rng):
    """λ² = gᵀH⁻¹g in the null space, of Phi divided by min(1, alpha)."""
    for alpha in (0.2, 4.0):
        planted = plant(rng, ["PCWF"] * 4, alpha=alpha)
        problem = planted.problem
        _, N = reference.particular_and_nullspace(problem.W, problem.f)
        c = planted.c + 0.01 * N @ rng.normal(size=N.shape[1])
        gradient, hessian = reference.reduced_derivatives(c, N, problem)
        wanted = math.sqrt(gradient @ np.linalg.solve(hessian, gradient) / min(1, alpha))
        assert reference.decrement(c, problem) == pytest.approx(wanted, rel=1e-6)
        assert reference.decrement(planted.c, problem) < 1e-6


@pytest.mark.parametrize(
    ("c", "limit"),
    [
        ([5, 3, 4], 9),  # on the cone, in whole numbers
        ([1, 0.5**0.5, 0.5**0.5], 9),  # on the cone but for rounding
        ([5, 5 - 1e-15, 0], 9),  # the last number inside it
        ([1, 0.1, 0.2], 1),  # on a limit
        ([1, 0.1, 0.2], 1 + 2**-52),  # the last number inside it
        ([5, 4, 4], 9),
        ([1, 0.1, 0.2], 0.5),
        ([0, 0, 0], 9),
        ([5e-324, 0, 0], 9),  # the squares of its slack vanish
    ],
)
def test_decrement_on_the_boundary_and_outside_is_infinite(c, limit):
    problem = gf.ForceProblem([[1.0, 0, 0]], [1.0], gf.PCWF(1.0), c_max=limit)
    assert reference.decrement(np.array(c, dtype=float), problem) == math.inf


@pytest.mark.parametrize("margin", [1e-3, 1e-9, 1e-12])
def test_decrement_close_to_the_boundary_is_a_number(margin):
    """One cone's barrier grows like −ln margin: its decrement tends to 1 towards its boundary."""
    problem = gf.ForceProblem([[1.0, 0, 0]], [1.0], gf.PCWF(1.0), c_max=5)
    c = np.array([1, 1 - margin, 0])
    assert reference.decrement(c, problem) == pytest.approx(1, abs=max(1e-3, 2 * margin))


def test_bound_on_the_decrement_after_a_full_step():
    assert reference.decrement_after(0.1) == pytest.approx((0.1 / 0.9) ** 2)
    assert reference.decrement_after(1.0) == math.inf


@pytest.mark.parametrize("alpha", [0.3, 5.0])
def test_the_bound_on_the_decrement_holds(rng, alpha):
    """(λ/(1 − λ))² bounds the decrement after a full step, wherever the step starts."""
    planted = plant(rng, ["PCWF", "SFC", "PCWF", "FPC"], alpha=alpha, ceilings=True)
    problem = planted.problem
    _, N = reference.particular_and_nullspace(problem.W, problem.f)
    seen = 0
    for size in np.geomspace(0.01, 1.0, 40):
        c = planted.c + size * N @ rng.normal(size=N.shape[1])
        if reference.objective(c, problem) == math.inf:
            continue
        before = reference.decrement(c, problem)
        if before < 0.9:
            d = N @ reference.newton_step(*reference.reduced_derivatives(c, N, problem))
            after = reference.decrement(c + d, problem)
            assert after <= reference.decrement_after(before) + 1e-9
            seen += 1
    assert seen >= 5


def test_every_equation_of_the_paper_has_its_function():
    """The table of the module's docstring: (5) to (22), complete, and of functions that exist."""
    rows = re.findall(r"\((\d+)\)\s+([A-Za-z_, ]+?)(?=\s{2,}|\n)", reference.__doc__)
    table = {int(number): names.split(", ") for number, names in rows}
    assert sorted(table) == list(range(5, 23))
    for number, names in table.items():
        for name in names:
            text = getattr(reference, name.strip()).__doc__
            assert f"Eq. ({number})" in text, f"{name} does not name its equation ({number})"
