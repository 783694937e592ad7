"""The paper in NumPy, one function per equation: teaching text and oracle of the tests.

Read it beside Sections III-A to III-C of the paper; the equation numbers are its. It does what
the paper does and no more: a null-space basis for each problem, dense Newton steps in the
reduced variables, backtracking, a Phase 1 with one slack variable. It is not fast.
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
from itertools import pairwise
from typing import Any

import numpy as np

from graspforce._arrays import Array
from graspforce.certificate import Certificate, check_certificate
from graspforce.contact import FPC, SFC, ContactModel, contact_starts
from graspforce.outcome import PlainOutcome, Start, Status
from graspforce.problem import ForceProblem
from graspforce.settings import Settings

# Forces this many times their reach, with no minimum found, mean that nothing holds them.
RUNAWAY = 1e6
# A slack of this part of the numbers that it is the difference of is nothing but their rounding.
ROUNDING = 2e-15
# A direction of the wrench that W, in rows of unit length, reaches by less than this is out of
# reach to rounding; fainter ones than 1e-10 may be counted either way.
RANK_TOLERANCE = 1e-13

# ---- III-A  polyhedral barrier ----------------------------------------------------------------


def slacks(x: Array, A: Array, b: Array) -> Array:
    """Slacks r = b − A x of Eq. (5): positive inside the polyhedron Q."""
    return b - A @ x


def phi_lin(x: Array, A: Array, b: Array) -> Any:
    """Eq. (6): −Σ ln r_i."""
    return -np.log(slacks(x, A, b)).sum()


def grad_phi_lin(x: Array, A: Array, b: Array) -> Array:
    """Eq. (7), first line: A.T d with d_i = 1/r_i."""
    return A.T @ (1 / slacks(x, A, b))


def hess_phi_lin(x: Array, A: Array, b: Array) -> Array:
    """Eq. (7), second line: A.T diag(d)² A."""
    d = 1 / slacks(x, A, b)
    return A.T @ (d[:, None] ** 2 * A)


# ---- III-B  second-order cone barrier ---------------------------------------------------------


def split(c: Array, models: Sequence[ContactModel]) -> list[Array]:
    """Eq. (8) read backwards: the stacked vector's contacts y_1 … y_n."""
    starts = contact_starts(models)
    return [c[start:end] for start, end in pairwise(starts)]


def R_mu(model: ContactModel) -> Array:
    """Eq. (10): diag(−mu², 1, …, 1), so that the cone is y.T R y < 0.

    FPC is the cone without tangents and mu = 1. The elliptic cone of SFC measures its torsion
    in units of gamma/mu, so the last entry is (mu/gamma)².
    """
    if isinstance(model, FPC):
        return np.diag([-1.0])
    torsion = [model.mu / model.gamma] if isinstance(model, SFC) else []
    return np.diag([-1.0, 1.0, 1.0, 1.0][: model.dim]) * np.square([model.mu, 1.0, 1.0, *torsion])


def g(y: Array, model: ContactModel) -> Any:
    """g_i = mu² y_0² − ‖ŷ‖² of Eq. (11): positive inside the cone."""
    return -(y @ R_mu(model) @ y)


def phi_soc(c: Array, models: Sequence[ContactModel]) -> Any:
    """Eq. (9): −Σ ln g_i."""
    return -sum(np.log(g(y, model)) for y, model in zip(split(c, models), models, strict=True))


def grad_phi_soc_contact(y: Array, model: ContactModel) -> Array:
    """Eq. (11): (2/g) R_mu y."""
    return 2 / g(y, model) * (R_mu(model) @ y)


def grad_phi_soc(c: Array, models: Sequence[ContactModel]) -> Array:
    """Eq. (12): the contacts' gradients, stacked."""
    return np.concatenate(
        [grad_phi_soc_contact(y, model) for y, model in zip(split(c, models), models, strict=True)]
    )


def hess_phi_soc_contact(y: Array, model: ContactModel) -> Array:
    """Eq. (13): ∇Phi ∇Phi.T + (2/g) R_mu."""
    grad = grad_phi_soc_contact(y, model)
    return np.outer(grad, grad) + 2 / g(y, model) * R_mu(model)


def hess_phi_soc(c: Array, models: Sequence[ContactModel]) -> Array:
    """Eq. (14): block diagonal, a block a contact."""
    starts = contact_starts(models)
    hessian = np.zeros((starts[-1], starts[-1]))
    for i, (y, model) in enumerate(zip(split(c, models), models, strict=True)):
        block = slice(starts[i], starts[i + 1])
        hessian[block, block] = hess_phi_soc_contact(y, model)
    return hessian


# ---- III-C  force distribution by weighted barrier functions ----------------------------------


def torque_limits(J: Array, tau_lo: Array, tau_hi: Array) -> tuple[Array, Array]:
    """Eq. (15): tau_lo ≤ J.T c ≤ tau_hi as A c ≤ b."""
    return np.vstack((J.T, -J.T)), np.concatenate((tau_hi, -tau_lo))


def ceilings(
    models: Sequence[ContactModel], engagement: Array, c_max: Array
) -> tuple[Array, Array]:
    """Eq. (20): c_norm,i ≤ w_i c_max,i as A c ≤ b; w_i is ``engagement``."""
    starts = contact_starts(models)
    A = np.zeros((len(models), starts[-1]))
    A[np.arange(len(models)), starts[:-1]] = 1.0
    return A, engagement * c_max


def objective(c: Array, problem: ForceProblem) -> float:
    """Eq. (16): Phi_soc(c) + alpha·Phi_lin(c); inf outside the cones or the limits."""
    view = _View(problem)
    inner = c[view.kept]
    if not view.inside(inner):
        return math.inf
    return float(phi_soc(inner, view.models) + problem.alpha * phi_lin(inner, view.A, view.b))


def particular_and_nullspace(W: Array, f: Array) -> tuple[Array, Array]:
    """Eq. (17): c_p = W⁺ f and a basis N of the null space of W, by the SVD.

    W may have any rank; the rank is judged after scaling its rows to equal length, because
    forces and torques have different units.
    """
    size = np.linalg.norm(W, axis=1)
    size[size == 0] = 1.0
    U, s, Vt = np.linalg.svd(W / size[:, None])
    rank = int((s > 1e-10 * s[0]).sum()) if s.size else 0
    c_p = Vt[:rank].T @ ((U[:, :rank].T @ (f / size)) / s[:rank])
    return c_p, Vt[rank:].T


def reduced_objective(lam: Array, c_p: Array, N: Array, problem: ForceProblem) -> float:
    """Eq. (18): Phi(c_p + N lam)."""
    return objective(c_p + N @ lam, problem)


def reduced_derivatives(c: Array, N: Array, problem: ForceProblem) -> tuple[Array, Array]:
    """Eq. (19): gradient N.T ∇Phi(c) and Hessian N.T ∇²Phi(c) N in lam."""
    gradient, hessian = derivatives(c, problem)
    return N.T @ gradient, N.T @ hessian @ N


def newton_step(gradient: Array, hessian: Array) -> Array:
    """Eq. (21) with gamma = 1: −(∇²Phi)⁻¹ ∇Phi, scaled to a unit diagonal first."""
    scale = 1 / np.sqrt(np.diag(hessian))
    scaled = hessian * scale[:, None] * scale
    return -scale * np.linalg.solve(scaled, scale * gradient)


def friction_residual(c: Array, models: Sequence[ContactModel]) -> float:
    """Smallest squared distance of the contact forces to slipping, r_f of Eq. (22).

    Args:
        c: contact forces, shape (m,), contact-major, each ``[n, x, y(, torsion)]`` [N, N·m].
        models: n contact models; fix m.

    Returns:
        min_i (mu_i² n_i² − ‖t_i‖²) [N²]; negative when some contact slips.
    """
    return float(min(g(y, model) for y, model in zip(split(c, models), models, strict=True)))


def least_squares(A: Array, b: Array) -> Array:
    """Return the least-norm minimiser of ‖A x − b‖."""
    return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], dtype=np.float64)


# ---- what the equations are made into ---------------------------------------------------------


def derivatives(c: Array, problem: ForceProblem) -> tuple[Array, Array]:
    """Gradient and Hessian of Phi of Eq. (16) in c."""
    A, b = problem.linear_limits()
    gradient = grad_phi_soc(c, problem.models) + problem.alpha * grad_phi_lin(c, A, b)
    hessian = hess_phi_soc(c, problem.models) + problem.alpha * hess_phi_lin(c, A, b)
    return gradient, hessian


def friction_margins(c: Array, models: Sequence[ContactModel]) -> Array:
    """Margins mu n − ‖tangential force‖ of the contacts, shape (n,) [N]."""
    margins: list[float] = []
    for y, model in zip(split(c, models), models, strict=True):
        R = R_mu(model)
        margins.append(math.sqrt(-R[0, 0]) * y[0] - math.sqrt(float(y[1:] @ R[1:, 1:] @ y[1:])))
    return np.array(margins)


def decrement(c: Array, problem: ForceProblem) -> float:
    """Newton decrement at c of Phi / min(1, alpha) on {W c = f}; see :func:`decrement_and_error`.

    It is the length of what projecting onto W d = 0 leaves of the scaled gradient γ, where
    ``∇Phi = G.T γ`` and ``∇²Phi = G.T G``: the Hessian itself, which holds squares, is not formed.
    It is inf outside, and on the boundary as far as rounding can tell.
    """
    return decrement_and_error(c, problem)[0]


def decrement_and_error(c: Array, problem: ForceProblem) -> tuple[float, float]:
    """Return :func:`decrement` and how far the rounding of c and W may have moved it.

    Near the boundary the last digit of c counts. And contacts that nearly coincide leave W with
    faint directions: a relative change of W by 1e-16 turns the directions with W d = 0 by as much
    times its condition, and the decrement follows.
    """
    view = _View(problem)
    if not view.models:
        return 0.0, 0.0
    inner = c[view.kept]
    with np.errstate(all="ignore"):
        if not view.inside(inner, ROUNDING):
            return math.inf, 0.0
        G, gamma = view.factored_derivatives(inner)
        order = np.argsort(
            -np.abs(G).max(axis=1)
        )  # what rounding does to the large rows stays there
        Q, R = np.linalg.qr(G[order])
        along = Q.T @ gamma[order]
        size = np.linalg.norm(view.W, axis=1, keepdims=True)
        _, strengths, directions = np.linalg.svd(view.W / np.where(size > 0, size, 1), False)
        rank = int((strengths > RANK_TOLERANCE * strengths.max(initial=0)).sum())
        if rank == len(inner):  # W c = f has one solution
            return 0.0, 0.0
        try:
            Z = np.linalg.solve(R.T, directions[:rank].T)
        except np.linalg.LinAlgError:
            return math.inf, 0.0
        Z /= np.linalg.norm(Z, axis=0)
        basis, _ = np.linalg.qr(Z)
        left = along
        for _ in range(2):  # once more for what cancellation leaves
            left = left - basis @ (basis.T @ left)
        length = float(np.linalg.norm(left))
        condition = float(np.linalg.cond(Z) * strengths[0] / strengths[rank - 1]) if rank else 1.0
        turned = 16 * len(inner) * condition * float(np.linalg.norm(along))
        moved = 64 * float(np.linalg.norm(np.abs(G) @ np.abs(inner)))
        error = np.finfo(float).eps * (turned + moved)
    return (length, error) if math.isfinite(length) else (math.inf, 0.0)


def wrench_reachable(problem: ForceProblem) -> bool:
    """Tell whether f is in the range of W, so that some contact force makes it (Eq. 17)."""
    view = _View(problem)
    c_p, _ = particular_and_nullspace(view.W, problem.f)
    off = np.abs(view.W @ c_p - problem.f).max()
    size = max(np.abs(problem.f).max(), (np.abs(view.W) @ np.abs(c_p)).max())
    return bool(off <= 1e-9 * size)


def violation_scales(problem: ForceProblem) -> tuple[Array, Array]:
    """What one unit of relative violation means, for each linear limit and each cone.

    A contact's *reach* is the normal force that alone would use up the tightest range among its
    joints' torques and its ceiling. A cone may be violated by mu·reach, a ceiling or floor by
    reach, a torque limit or a rate limit by half its range, a row of A by what forces of the size
    of reach make.

    Returns:
        scales of all rows that :meth:`ForceProblem.linear_limits` keeps, shape (v,), and of the
        cones, shape (n,).
    """
    normals = problem.starts[:-1]
    half = (problem.tau_hi - problem.tau_lo) / 2
    with np.errstate(divide="ignore"):
        reach = (2 * half / np.abs(problem.J[normals])).min(axis=1, initial=np.inf)
    if problem.layout.ceilings:
        reach = np.minimum(reach, problem.engagement * problem.c_max)
    known = reach[np.isfinite(reach) & problem.active]
    fallback = known.max() if known.size else float(np.abs(problem.f).max()) or 1.0
    reach = np.where(np.isfinite(reach), reach, fallback)
    own = np.abs(problem.A) @ np.repeat(reach * problem.active, problem.layout.dims)
    rows = [half, half]
    rows += [reach] * (problem.layout.ceilings + problem.layout.floors)
    rows += [problem.dc_max] * (2 * problem.layout.rate_limits)
    rows += [np.where(own > 0, own, np.maximum(np.abs(problem.b), fallback))]
    return np.concatenate(rows)[problem.counted_limits()], problem.mu * reach


class _View:
    """A problem without its removed contacts, and optionally with Phase 1's slack variable.

    Phi is divided by min(1, alpha) here, so that each term is standard self-concordant.
    """

    def __init__(self, problem: ForceProblem) -> None:
        self.problem = problem
        self.kept = np.repeat(problem.active, problem.layout.dims)
        self.models = [
            model for model, here in zip(problem.models, problem.active, strict=True) if here
        ]
        A, b = problem.linear_limits()
        self.A, self.b = A[:, self.kept], b
        self.W = problem.W[:, self.kept]
        self.cone_weight = 1 / min(1.0, problem.alpha)
        self.limit_weight = problem.alpha * self.cone_weight

    def inside(self, c: Array, rounding: float = 0.0) -> bool:
        """Whether every slack is above this part of the numbers that it is the difference of."""
        least = rounding * (np.abs(self.b) + np.abs(self.A) @ np.abs(c)) if rounding else 0.0
        return bool(
            (self.b - self.A @ c > least).all()
            and all(y[0] > 0 and g(y, model) > rounding * -R_mu(model)[0, 0] * y[0] ** 2
                    for y, model in zip(split(c, self.models), self.models, strict=True))
        )  # fmt: skip

    def derivatives(self, c: Array) -> tuple[Array, Array]:
        soc, lin = self.cone_weight, self.limit_weight
        return (
            soc * grad_phi_soc(c, self.models) + lin * grad_phi_lin(c, self.A, self.b),
            soc * hess_phi_soc(c, self.models) + lin * hess_phi_lin(c, self.A, self.b),
        )

    def factored_derivatives(self, c: Array) -> tuple[Array, Array]:
        """G and γ with ∇Phi = G.T γ and ∇²Phi = G.T G, strictly inside."""
        rows = [math.sqrt(self.limit_weight) * self.A / (self.b - self.A @ c)[:, None]]
        scaled = [np.full(len(self.b), math.sqrt(self.limit_weight))]
        start = 0
        for model in self.models:
            # In s = (mu n, w t) the Hessian of −ln det s is 2 B²/det s, where B is the boost of the
            # cone's axis to (s_0, −ŝ)/√det s, and the gradient −√(2/det s)·√2 B e_0.
            weights = np.sqrt(np.abs(np.diag(R_mu(model))))
            s = weights * c[start : start + model.dim]
            radius = math.hypot(*s[1:])
            det = (s[0] - radius) * (s[0] + radius)
            w = np.concatenate((s[:1], -s[1:])) / math.sqrt(det)
            B = np.eye(model.dim) + np.outer(w, w) / (1 + w[0])
            B[0], B[:, 0] = w, w
            block = np.zeros((model.dim, len(c)))
            block[:, start : start + model.dim] = (
                math.sqrt(2 * self.cone_weight / det) * B * weights
            )
            rows.append(block)
            scaled.append(-math.sqrt(2 * self.cone_weight) * np.eye(model.dim)[0])
            start += model.dim
        return np.vstack(rows), np.concatenate(scaled)

    def value(self, c: Array) -> float:
        return float(
            self.cone_weight * phi_soc(c, self.models)
            + self.limit_weight * phi_lin(c, self.A, self.b)
        )

    def spread(self, c: Array) -> Array:
        """Put the removed contacts back, with zero force."""
        whole = np.zeros(len(self.kept))
        whole[self.kept] = c
        return whole


def decrement_after(step: float) -> float:
    """Bound on the decrement after a full Newton step whose own decrement is ``step``."""
    return (step / (1 - step)) ** 2 if step < 1 else math.inf


def backtrack(view: _View, c: Array, d: Array, slope: float) -> float:
    """γ of Eq. (21): halve until the step stays inside and the objective falls (Armijo)."""
    gamma, before = 1.0, view.value(c)
    while gamma > 1e-16:
        trial = c + gamma * d
        if view.inside(trial) and view.value(trial) <= before + 0.1 * gamma * slope:
            return gamma
        gamma /= 2
    return 0.0


def solve(problem: ForceProblem, settings: Settings, start: Array | None = None) -> PlainOutcome:
    """Section III-C.4 and 5: Phase 1 when there is no feasible start, then Newton's method.

    Args:
        problem: what to solve.
        settings: tolerance and step limit.
        start: contact forces to start from, shape (m,); they are projected onto W c = f.
    """
    with np.errstate(all="ignore"):
        try:
            outcome = _solve(problem, settings, start)
        except np.linalg.LinAlgError:
            return _nothing(problem, Status.INVALID_NUMBERS)
    if not (np.isfinite(outcome.c).all() and np.isfinite(outcome.nu).all()):
        return _nothing(problem, Status.INVALID_NUMBERS)
    return outcome


def _nothing(problem: ForceProblem, status: Status) -> PlainOutcome:
    return PlainOutcome(status, 0, np.zeros(problem.m), np.zeros(len(problem.f)))


def _solve(problem: ForceProblem, settings: Settings, start: Array | None) -> PlainOutcome:
    layout = problem.layout
    if not (layout.joints or layout.ceilings or layout.inequalities or layout.rate_limits):
        return _nothing(problem, Status.UNBOUNDED)
    if not wrench_reachable(problem):
        return _nothing(problem, Status.WRENCH_UNREACHABLE)
    if not problem.active.any():
        return replace(_nothing(problem, Status.SOLVED), decrement=0.0)
    view = _View(problem)
    c_p, N = particular_and_nullspace(view.W, problem.f)
    guess = c_p if start is None else c_p + N @ (N.T @ (start[view.kept] - c_p))
    steps, given = 0, start is not None and view.inside(guess)
    if not view.inside(guess):
        first = phase_1(view, N, guess, settings)
        if first.status != Status.SOLVED:
            return first
        guess, steps = first.c[view.kept], first.newton_steps
    outcome = minimise(view, N, guess, settings, steps)
    return replace(outcome, start=Start.GIVEN if given else Start.COLD)


def minimise(view: _View, N: Array, c: Array, settings: Settings, steps: int) -> PlainOutcome:
    """Newton's method from a strictly feasible start; ends by the a-priori decrement bound.

    A full step whose decrement is λ < 1 leaves one of at most (λ/(1 − λ))² behind, so the step
    is taken and judged by that bound, without a further factorisation.
    """
    status, bound = Status.MAX_STEPS, math.inf
    runaway = RUNAWAY * (violation_scales(view.problem)[1] / view.problem.mu).max()
    gradient, hessian = view.derivatives(c)
    for _ in range(settings.max_steps):
        if N.shape[1] == 0:  # W c = f has one solution
            status, bound = Status.SOLVED, 0.0
            break
        d = N @ newton_step(N.T @ gradient, N.T @ hessian @ N)
        steps += 1
        lam = math.sqrt(max(0.0, -float(gradient @ d)))
        gamma = 1.0 if lam < 0.25 else backtrack(view, c, d, -(lam**2))
        if gamma == 0:
            status = Status.STALLED
            break
        c = c + gamma * d
        bound = decrement_after(lam) if gamma == 1 else math.inf
        gradient, hessian = view.derivatives(c)
        if bound**2 / 2 <= settings.tol:
            status = Status.SOLVED
            break
        if np.abs(c).max() > runaway:
            status = Status.UNBOUNDED
            break
    alpha = view.problem.alpha
    nu = least_squares(view.W.T, gradient) * min(1.0, alpha)
    return PlainOutcome(status, steps, view.spread(c), nu, bound)


def phase_1(view: _View, N: Array, c: Array, settings: Settings) -> PlainOutcome:
    """Section III-C.5: shrink one slack that relaxes every cone and limit.

    Minimises kappa·sigma + Phi_relaxed for growing kappa. Ends as soon as c is strictly inside
    (SOLVED, meaning that a start was found), or when the multipliers of a Newton step prove
    that sigma cannot reach zero, and then goes on to the least violation (INFEASIBLE).
    """
    problem = view.problem
    row_scale, all_cones = violation_scales(problem)
    cone_scale = all_cones[problem.active]
    relaxed = _Relaxed(view, row_scale, cone_scale)
    x = np.append(c, 1.2 * relaxed.least_sigma(c) + 0.1)
    basis = np.zeros((len(x), N.shape[1] + 1))
    basis[:-1, :-1], basis[-1, -1] = N, 1.0
    kappa, proof, step, status = 10.0, None, 0, Status.MAX_STEPS
    terms = len(view.b) + 2 * len(view.models)
    for step in range(1, settings.max_steps + 1):
        gradient, hessian = relaxed.derivatives(x)
        gradient[-1] += kappa
        d = basis @ newton_step(basis.T @ gradient, basis.T @ hessian @ basis)
        lam = math.sqrt(max(0.0, -float(gradient @ d)))
        if lam < 1:
            proof = relaxed.proof(x, d) or proof
        gamma = 1.0
        while not relaxed.inside(x + gamma * d) and gamma > 1e-16:
            gamma *= 0.7
        if lam >= 0.25:
            gamma = max(min(gamma, 1 / (1 + lam)), 0.9 * gamma if gamma < 1 else 0.0)
        x = x + gamma * d
        if view.inside(x[:-1]):
            return PlainOutcome(Status.SOLVED, step, view.spread(x[:-1]), np.zeros(len(problem.f)))
        if lam < 0.3:
            sigma = float(x[-1])
            if proof is not None and terms / kappa < 1e-7 * sigma:
                y, z = proof
                full = np.zeros(len(problem.counted_limits()))
                full[problem.counted_limits()] = z
                return PlainOutcome(
                    Status.INFEASIBLE, step, view.spread(x[:-1]), y, violation=sigma, y=y, z=full
                )
            if terms / kappa < 1e-13:
                status = Status.STALLED
                break
            kappa *= 10
    return PlainOutcome(status, step, view.spread(x[:-1]), np.zeros(len(problem.f)))


class _Relaxed:
    """The barriers of Phase 1 in x = (c, sigma): every limit moved out by sigma·scale."""

    def __init__(self, view: _View, row_scale: Array, cone_scale: Array) -> None:
        self.view = view
        self.A = np.hstack((view.A, -row_scale[:, None]))
        self.b = view.b
        self.cone_scale = cone_scale
        self.starts = contact_starts(view.models)

    def _lift(self, i: int) -> Array:
        """The map from x to contact i's cone coordinates: sigma adds to the normal force."""
        model = self.view.models[i]
        lift = np.zeros((model.dim, self.A.shape[1]))
        lift[:, self.starts[i] : self.starts[i + 1]] = np.eye(model.dim)
        lift[0, -1] = self.cone_scale[i] / math.sqrt(-R_mu(model)[0, 0])
        return lift

    def least_sigma(self, c: Array) -> float:
        """The smallest slack that admits c."""
        margins = friction_margins(c, self.view.models)
        cones = -margins / self.cone_scale
        limits = (self.view.A @ c - self.b) / -self.A[:, -1]
        return float(max(cones.max(), limits.max(initial=-np.inf)))

    def inside(self, x: Array) -> bool:
        cones = (self._lift(i) @ x for i in range(len(self.view.models)))
        return bool((self.b - self.A @ x > 0).all()) and all(
            y[0] > 0 and g(y, model) > 0 for y, model in zip(cones, self.view.models, strict=True)
        )

    def derivatives(self, x: Array) -> tuple[Array, Array]:
        gradient = grad_phi_lin(x, self.A, self.b)
        hessian = hess_phi_lin(x, self.A, self.b)
        for i, model in enumerate(self.view.models):
            lift = self._lift(i)
            gradient = gradient + lift.T @ grad_phi_soc_contact(lift @ x, model)
            hessian = hessian + lift.T @ hess_phi_soc_contact(lift @ x, model) @ lift
        return gradient, hessian

    def proof(self, x: Array, d: Array) -> tuple[Array, Array] | None:
        """Multipliers from a Newton step with λ < 1: dual feasible, so a proof if their gap > 0."""
        r = self.b - self.A @ x
        z = (1 + self.A @ d / r) / r
        cone = np.zeros(self.A.shape[1])
        for i, model in enumerate(self.view.models):
            lift = self._lift(i)
            y = lift @ x
            cone += lift.T @ (
                grad_phi_soc_contact(y, model) + hess_phi_soc_contact(y, model) @ (lift @ d)
            )
        target = self.view.A.T @ z + cone[:-1]
        y = least_squares(self.view.W.T, target)
        total = float(z @ -self.A[:, -1]) + abs(float(cone[-1]))
        y, z = y / total, z / total
        holds = check_certificate(self.view.problem, Certificate(y, z))
        return (y, z) if holds else None
