"""The paper in NumPy, one function per equation: teaching text and oracle of the tests.

Read it beside Sections III-A to III-C of the paper; the equation numbers are its. The functions are
those of :mod:`graspforce.equations`, here with contact models and problems as arguments; below
them is the paper's method, built from these alone. It is the paper's method without additions: a
null-space basis for each problem, dense Newton steps in the reduced variables, backtracking, a
Phase 1 with one slack variable (:mod:`graspforce.reference.phase_one`). It is not fast.
``Settings(backend="reference")`` runs on it.

========  =====================================  ========  ================================
Eq.       function                               Eq.       function
========  =====================================  ========  ================================
(5)       slacks                                 (15)      torque_limits
(6)       phi_lin                                (16)      objective
(7)       grad_phi_lin, hess_phi_lin             (17)      particular_and_nullspace
(8)       split                                  (18)      reduced_objective
(9)       phi_soc                                (19)      reduced_derivatives
(10)      R_mu                                   (20)      ceilings
(11)      grad_phi_soc_contact                   (21)      newton_step
(12)      grad_phi_soc                           (22)      friction_residual
(13)      hess_phi_soc_contact
(14)      hess_phi_soc
========  =====================================  ========  ================================

The barrier functions accept complex vectors, so that complex-step differentiation can check the
derivatives to the last digit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from graspforce import equations
from graspforce._engine.outcome import PlainOutcome, Start, Status
from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array
from graspforce.contact import ContactModel
from graspforce.equations import (
    RUNAWAY,
    Barriers,
    Cones,
    backtrack,
    decrement_after,
    force_size,
    grad_phi_lin,
    hess_phi_lin,
    least_squares,
    may_overflow,
    newton_step,
    particular_and_nullspace,
    phi_lin,
    slacks,
    torque_limits,
)
from graspforce.problem import ForceProblem
from graspforce.reference.nearest import find_nearest, move_inward, project_wrench
from graspforce.reference.phase_one import PhaseOne, find_inside, well_inside

__all__ = [
    "RUNAWAY",
    "R_mu",
    "backtrack",
    "ceilings",
    "decrement",
    "decrement_after",
    "decrement_and_error",
    "derivatives",
    "friction_margins",
    "friction_residual",
    "g",
    "grad_phi_lin",
    "grad_phi_soc",
    "grad_phi_soc_contact",
    "hess_phi_lin",
    "hess_phi_soc",
    "hess_phi_soc_contact",
    "least_squares",
    "newton_step",
    "objective",
    "particular_and_nullspace",
    "phi_lin",
    "phi_soc",
    "reduced_derivatives",
    "reduced_objective",
    "slacks",
    "solve",
    "split",
    "torque_limits",
    "violation_scales",
    "wrench_reachable",
]

# ---- III-B  second-order cone barrier ---------------------------------------------------------


def split(c: Array, models: Sequence[ContactModel]) -> list[Array]:
    """Eq. (8) read backwards: the stacked vector's contacts y_1 … y_n.

    Args:
        c: contact forces, shape (m,) [N, N·m].
        models: n contact models; fix m.

    Returns:
        n views of c, each of its model's ``dim`` components.
    """
    return equations.split(c, [model.dim for model in models])


def R_mu(model: ContactModel) -> Array:
    """Matrix of a contact's cone, Eq. (10): diag(−mu², 1, …), so that the cone is y.T R y < 0.

    Args:
        model: its contact model.

    Returns:
        Shape (dim, dim); FPC has mu = 1, SFC the last entry (mu/gamma)².
    """
    return equations.R_mu(model.cone_scaling)


def g(y: Array, model: ContactModel) -> Any:
    """g_i = mu² y_0² − ‖ŷ‖² of Eq. (11): positive inside the cone and its mirror image.

    Args:
        y: force of one contact, shape (dim,) [N, N·m].
        model: its contact model.

    Returns:
        A number [N²].
    """
    return equations.g(y, model.cone_scaling)


def phi_soc(c: Array, models: Sequence[ContactModel]) -> Any:
    """Barrier of the friction cones, Eq. (9): −Σ ln g_i, with natural logarithms.

    Args:
        c: contact forces strictly inside the cones, shape (m,) [N, N·m].
        models: n contact models; fix m.

    Returns:
        A number [-].
    """
    return equations.phi_soc(c, Cones.of_models(models))


def grad_phi_soc_contact(y: Array, model: ContactModel) -> Array:
    """Gradient of one contact's barrier −ln g, Eq. (11): (2/g) R_mu y.

    Args:
        y: force of one contact, strictly inside its cone, shape (dim,) [N, N·m].
        model: its contact model.

    Returns:
        Shape (dim,) [1/N, 1/(N·m)].
    """
    return equations.grad_phi_soc_contact(y, model.cone_scaling)


def grad_phi_soc(c: Array, models: Sequence[ContactModel]) -> Array:
    """Gradient of Eq. (9), Eq. (12): the contacts' gradients, stacked.

    Args:
        c: contact forces strictly inside the cones, shape (m,) [N, N·m].
        models: n contact models; fix m.

    Returns:
        Shape (m,) [1/N, 1/(N·m)].
    """
    return equations.grad_phi_soc(c, Cones.of_models(models))


def hess_phi_soc_contact(y: Array, model: ContactModel) -> Array:
    """Hessian of one contact's barrier −ln g, Eq. (13): ∇Phi ∇Phi.T + (2/g) R_mu.

    Args:
        y: force of one contact, strictly inside its cone, shape (dim,) [N, N·m].
        model: its contact model.

    Returns:
        Shape (dim, dim) [1/N², …].
    """
    return equations.hess_phi_soc_contact(y, model.cone_scaling)


def hess_phi_soc(c: Array, models: Sequence[ContactModel]) -> Array:
    """Hessian of Eq. (9), Eq. (14): block diagonal, a block a contact.

    Args:
        c: contact forces strictly inside the cones, shape (m,) [N, N·m].
        models: n contact models; fix m.

    Returns:
        Shape (m, m) [1/N², …].
    """
    return equations.hess_phi_soc(c, Cones.of_models(models))


# ---- III-C  force distribution by weighted barrier functions ----------------------------------


def ceilings(
    models: Sequence[ContactModel], engagement: Array, c_max: Array
) -> tuple[Array, Array]:
    """Ceilings of the normal forces, c_norm,i ≤ w_i c_max,i, as A c ≤ b, Eq. (20).

    Args:
        models: n contact models; fix m.
        engagement: the paper's w_i, 0 to 1, shape (n,) [-].
        c_max: ceilings of contacts that are fully engaged, shape (n,) [N].

    Returns:
        A, shape (n, m), and b, shape (n,) [N].
    """
    return equations.ceilings([model.dim for model in models], engagement, c_max)


def objective(c: Array, problem: ForceProblem) -> float:
    """The weighted objective, Eq. (16): Phi_soc(c) + alpha·Phi_lin(c).

    Args:
        c: contact forces, shape (m,) [N, N·m].
        problem: whose cones, limits and alpha; contacts that are out of the grasp do not count.

    Returns:
        A number [-]; inf outside the cones or the limits.
    """
    return float(equations.objective(*_restricted(c, problem)))


def derivatives(c: Array, problem: ForceProblem) -> tuple[Array, Array]:
    """Gradient and Hessian of Phi of Eq. (16) in c.

    Args:
        c: contact forces strictly inside, shape (m,) [N, N·m].
        problem: whose cones, limits and alpha; every contact is in the grasp.

    Returns:
        Shapes (m,) and (m, m) [1/N, 1/N², …].
    """
    return equations.derivatives(*_restricted(c, problem))


def reduced_objective(lam: Array, c_p: Array, N: Array, problem: ForceProblem) -> float:
    """Phi in the reduced variables, Eq. (18): Phi(c_p + N lam).

    Args:
        lam: reduced variables, shape (q,).
        c_p: particular solution of W c = f, shape (m,) [N, N·m].
        N: null space of W, shape (m, q).
        problem: whose cones, limits and alpha.

    Returns:
        A number [-]; inf outside the cones or the limits.
    """
    return float(equations.reduced_objective(lam, *_moved(c_p, N, problem)))


def reduced_derivatives(c: Array, N: Array, problem: ForceProblem) -> tuple[Array, Array]:
    """Derivatives in lam of Eq. (18), Eq. (19): N.T ∇Phi(c) and N.T ∇²Phi(c) N.

    Args:
        c: contact forces c_p + N lam strictly inside, shape (m,) [N, N·m].
        N: null space of W, shape (m, q).
        problem: whose cones, limits and alpha.

    Returns:
        Gradient, shape (q,), and Hessian, shape (q, q).
    """
    return equations.reduced_derivatives(*_moved(c, N, problem))


def friction_residual(c: Array, models: Sequence[ContactModel]) -> float:
    """Smallest squared distance of the contact forces to slipping, r_f of Eq. (22).

    Args:
        c: contact forces, shape (m,), contact-major, each ``[n, x, y(, torsion)]`` [N, N·m].
        models: n contact models; fix m.

    Returns:
        min_i (mu_i² n_i² − ‖t_i‖²) [N²]; negative when some contact slips.
    """
    return float(equations.friction_residual(c, Cones.of_models(models)))


# ---- checks of an answer -----------------------------------------------------------------------


def friction_margins(c: Array, models: Sequence[ContactModel]) -> Array:
    """Margins mu n − ‖tangential force‖ of the contacts, shape (n,) [N]."""
    return equations.friction_margins(c, Cones.of_models(models))


def decrement(c: Array, problem: ForceProblem) -> float:
    """Newton decrement at c of Phi over its unit on {W c = f}; inf outside."""
    return decrement_and_error(c, problem)[0]


def decrement_and_error(c: Array, problem: ForceProblem) -> tuple[float, float]:
    """Return :func:`decrement` and how far the rounding of c and W may have moved it.

    See :func:`graspforce.equations.decrement_and_error`.
    """
    inner, barriers = _restricted(c, problem)
    return equations.decrement_and_error(inner, problem.restricted().equalities[0], barriers)


def wrench_reachable(problem: ForceProblem) -> bool:
    """Tell whether the exact rows of f are in W's range: some contact force makes them (Eq. 17)."""
    return equations.wrench_reachable(*problem.restricted().equalities)


def violation_scales(problem: ForceProblem) -> tuple[Array, Array]:
    """See :meth:`graspforce.ForceProblem.violation_scales`."""
    return problem.violation_scales()


def _restricted(c: Array, problem: ForceProblem) -> tuple[Array, Barriers]:
    """The forces and barriers of the contacts that are in the grasp."""
    loaded = (c + problem.preload[: len(c)])[problem.active_forces[: len(c)]]
    return loaded, problem.without_pulls().restricted().barriers


def _moved(c: Array, N: Array, problem: ForceProblem) -> tuple[Array, Array, Barriers]:
    """The forces with the preload of what pulls, N, and the barriers of both."""
    return c + problem.preload[: len(c)], N, problem.without_pulls().barriers


# ---- the paper's method -----------------------------------------------------------------------


def solve(problem: ForceProblem, settings: Settings, start: Array | None = None) -> PlainOutcome:
    """Section III-C.4 and 5: Phase 1 when there is no feasible start, then Newton's method.

    Args:
        problem: what to solve.
        settings: tolerance and step limit.
        start: contact forces to start from, shape (m,); they are projected onto W c = f.
    """
    # What no linear algebra can solve overflows, or has been rounded to a singular system.
    failed = Status.INVALID_NUMBERS if may_overflow(problem.packed) else Status.STALLED
    with np.errstate(all="ignore"):
        try:
            if start is not None:
                start = np.append(start, np.zeros(problem.layout.internals)) + problem.preload
            outcome = _of_contacts(problem, _solve(problem.without_pulls(), settings, start))
        except np.linalg.LinAlgError:
            return _of_contacts(problem, _empty_outcome(problem, failed))
    if not (np.isfinite(outcome.c).all() and np.isfinite(outcome.nu).all()):
        return _of_contacts(problem, _empty_outcome(problem, failed))
    return outcome


def _of_contacts(problem: ForceProblem, found: PlainOutcome) -> PlainOutcome:
    """Return an outcome with c and the internal forces apart, and c without the preload.

    Args:
        problem: the problem as it was given.
        found: of :meth:`graspforce.ForceProblem.without_pulls`, the internal forces behind c.
    """
    none = not found.c.any()  # zeros stand for no answer
    forces = found.c if none else found.c - problem.preload
    return replace(found, c=forces[: problem.m], internal_forces=forces[problem.m :])


def _empty_outcome(problem: ForceProblem, status: Status) -> PlainOutcome:
    forces = np.zeros(problem.m + problem.layout.internals)
    return PlainOutcome(status, 0, forces, np.zeros(len(problem.f)))


def _solve(problem: ForceProblem, settings: Settings, start: Array | None) -> PlainOutcome:
    if not problem.has_limits:
        return _empty_outcome(problem, Status.UNBOUNDED)
    inner = problem.restricted()
    W, f = inner.equalities
    if not equations.wrench_reachable(W, f):
        return _hold_nearest(problem, settings, start)
    if not inner.n and not problem.layout.internals:
        nu = _soft_multipliers(problem, np.zeros(problem.m))
        return replace(_empty_outcome(problem, Status.SOLVED), decrement=0.0, nu=nu)
    c_p, N = particular_and_nullspace(W, f)
    lam = np.zeros(N.shape[1])
    if start is not None:
        lam = N.T @ (start[problem.active_forces] - c_p)
    steps, inside = 0, well_inside(c_p + N @ lam, inner)
    given = start is not None and inside
    if not inside:
        first = find_inside(inner, N, c_p + N @ lam, settings.max_steps)
        if not first.inside:
            return _not_inside(problem, inner, first, settings.max_steps)
        steps, lam = first.steps, N.T @ (first.c - c_p)
    if inner.squeezed.any():
        c, (c_p, N) = c_p + N @ lam, particular_and_nullspace(*_set_normals(inner))
        lam = N.T @ (c - c_p)
    outcome = minimise(inner, c_p, N, lam, settings.tol, settings.max_steps - steps)
    steps += outcome.newton_steps
    if outcome.status == Status.UNBOUNDED:
        return replace(_empty_outcome(problem, Status.UNBOUNDED), newton_steps=steps)
    return replace(
        outcome,
        c=problem.scatter(outcome.c),
        newton_steps=steps,
        start=Start.GIVEN if given else Start.COLD,
    )


def _not_inside(
    problem: ForceProblem, inner: ForceProblem, first: PhaseOne, max_steps: int
) -> PlainOutcome:
    """Infeasible, on the edge, or undecided: the forces for the nearest wrench with the verdict."""
    c, steps, nu = first.c, first.steps, np.zeros(len(problem.f))
    if first.certificate is None and not first.on_edge:
        status = Status.MAX_STEPS if first.out_of_steps else Status.STALLED
        return PlainOutcome(status, steps, problem.scatter(c), nu)
    if first.certificate is None:
        edge = move_inward(inner, c, max_steps - steps)
        steps += edge.steps
        return PlainOutcome(Status.ON_EDGE, steps, problem.scatter(edge.c), nu, nearest=edge.found)
    nearest = find_nearest(inner, c, max_steps - steps)
    c, steps = problem.scatter(nearest.c), steps + nearest.steps
    y, z = first.certificate.y, problem.scatter_multipliers(first.certificate.z)
    return PlainOutcome(
        Status.INFEASIBLE, steps, c, y, violation=first.violation, y=y, z=z, nearest=nearest.found
    )


def _hold_nearest(problem: ForceProblem, settings: Settings, start: Array | None) -> PlainOutcome:
    """Solve for the wrench nearest to f in the range of W, which does not hold f itself."""
    empty = _empty_outcome(problem, Status.WRENCH_UNREACHABLE)
    inner = problem.restricted()
    if not inner.n and not problem.layout.internals:
        return empty
    nearest = problem.replace(f=project_wrench(inner))
    if not equations.wrench_reachable(*nearest.restricted().equalities):
        return empty  # numbers that are lost to rounding
    found = _solve(nearest, settings, start)
    held = found.nearest or found.status == Status.SOLVED
    if not held and found.status not in (Status.INFEASIBLE, Status.ON_EDGE):
        return replace(empty, newton_steps=found.newton_steps)
    return replace(
        empty, newton_steps=found.newton_steps, c=found.c, nu=found.nu, start=found.start,
        nearest=held,
    )  # fmt: skip


def minimise(
    problem: ForceProblem, c_p: Array, N: Array, lam: Array, tol: float, max_steps: int
) -> PlainOutcome:
    """Newton's method from a strictly feasible start; ends by the a-priori decrement bound.

    A full step whose decrement is λ < 1 leaves one of at most (λ/(1 − λ))² behind, so the step
    is taken and judged by that bound, without a further factorisation.

    Args:
        problem: every contact in the grasp.
        c_p: particular solution of W c = f, shape (m,).
        N: null space of W, shape (m, q).
        lam: where to start, shape (q,).
        tol: bound on decrement²/2 at return.
        max_steps: the most Newton steps.
    """
    barriers = problem.barriers
    c: Array = c_p + N @ lam
    status, bound, steps = Status.MAX_STEPS, math.inf, 0
    runaway = RUNAWAY * force_size(barriers, problem.f)
    while steps < max_steps:
        if N.shape[1] == 0:  # W c = f has one solution
            status, bound = Status.SOLVED, 0.0
            break
        gradient, hessian = equations.reduced_derivatives(c, N, barriers)
        d = newton_step(gradient, hessian)
        steps += 1
        slope = float(gradient @ d)
        if slope > 0:  # upwards: rounding has the last word in the Hessian
            status = Status.STALLED
            break
        length = math.sqrt(-slope / barriers.unit)
        gamma = 1.0 if length < 0.25 else backtrack(lam, d, slope, c_p, N, barriers)
        if gamma == 0:
            status = Status.STALLED
            break
        lam = lam + gamma * d
        c = c_p + N @ lam
        bound = decrement_after(length) if gamma == 1 else math.inf
        if bound**2 / 2 <= tol:
            status = Status.SOLVED
            break
        if np.abs(c).max() > runaway:
            status = Status.UNBOUNDED
            break
    W, _ = _set_normals(problem)
    nu = least_squares(W.T, equations.derivatives(c, barriers)[0])[: len(problem.f)]
    return PlainOutcome(status, steps, c, nu + _soft_multipliers(problem, c), bound)


def _set_normals(problem: ForceProblem) -> tuple[Array, Array]:
    """W and f of the exact rows, with a row for each normal force that its limits set."""
    W, f = problem.equalities
    if not problem.squeezed.any():
        return W, f
    normals = np.array(problem.starts[:-1])[problem.squeezed]
    squeezes = (problem.engagement * problem.c_max)[problem.squeezed]
    return np.vstack((W, np.eye(W.shape[1])[normals])), np.append(f, squeezes)


def _soft_multipliers(problem: ForceProblem, c: Array) -> Array:
    """Multipliers (f − W c)/f_soft² of the soft rows of W c = f, zero of the exact ones."""
    nu = np.zeros(len(problem.f))
    soft = ~problem.exact
    if soft.any():
        nu[soft] = (problem.f - problem.W @ c[: problem.m])[soft] / problem.f_soft[soft] ** 2
    return nu
