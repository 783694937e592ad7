"""A force strictly inside every cone and limit, or the certificate that there is none, in NumPy.

Section III-C.5 of the paper: one slack sigma relaxes every cone and limit by its own scale and is
minimised by Newton's method on kappa·sigma + Phi_relaxed in the null space of W for
growing kappa. The NumPy solver uses it where it has no feasible start,
:meth:`graspforce.Solution.verify` to check UNBOUNDED.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from graspforce._util.arrays import Array
from graspforce.certificate import Certificate
from graspforce.equations import (
    grad_phi_lin,
    grad_phi_soc,
    hess_phi_lin,
    hess_phi_soc,
    inside_cones,
    least_squares,
    newton_step,
    relative_violation,
    slacks,
    strictly_inside,
)
from graspforce.problem import ForceProblem

# Relative tolerance of the slack that is reported as the least violation.
SIGMA_TOLERANCE = 1e-7
# A slack below this is rounding; where no point well inside is found, one below that the edge's.
SIGMA_ROUNDING, SIGMA_OF_EDGE = 1e-13, 1e-9
# Relative slack of a point inside by more than rounding; a set squeeze has ten times that.
DEPTH = 1e-10


class PhaseOne(NamedTuple):
    """Where Phase 1 ended.

    Attributes:
        c: the forces, shape (m,), with W c = f.
        steps: Newton steps taken.
        inside: whether they are strictly inside every cone and limit.
        certificate: the proof that no forces are inside; None without one.
        violation: the least relative violation with a certificate, else 0.
        out_of_steps: stopped by the limit on steps.
        on_edge: forces on the boundary make the wrench, to rounding, and none inside were found.
    """

    c: Array
    steps: int
    inside: bool = False
    certificate: Certificate | None = None
    violation: float = 0.0
    out_of_steps: bool = False
    on_edge: bool = False


def find_inside(
    problem: ForceProblem, N: Array, c: Array, max_steps: int, depth: float = DEPTH
) -> PhaseOne:
    """Shrink one slack that relaxes every cone and limit.

    Ends as soon as c is strictly inside, or when the multipliers of a Newton step prove that sigma
    cannot reach zero and sigma is within 1e-7 of its minimum.

    Args:
        problem: what to find forces for, every contact in the grasp.
        N: null space of W, shape (m, q).
        c: forces with W c = f to start from, shape (m,).
        max_steps: the most Newton steps.
        depth: the relative slack that counts as inside.
    """
    relaxed = _Relaxed(problem)
    x = np.append(c, 1.2 * relaxed.least_sigma(c) + 0.1)
    basis = np.pad(N, ((0, 1), (0, 1)))
    basis[-1, -1] = 1.0
    kappa, certificate = 10.0, None
    terms = len(relaxed.b) + 2 * problem.n

    def stopped(step: int) -> PhaseOne:
        """By rounding: with a proof if there is one, else on the edge if no further away."""
        if certificate is not None:
            return PhaseOne(x[:-1], step, certificate=certificate, violation=float(x[-1]))
        return PhaseOne(x[:-1], step, on_edge=bool(x[-1] < SIGMA_OF_EDGE))

    for step in range(1, max_steps + 1):
        gradient, hessian = relaxed.derivatives(x)
        gradient[-1] += kappa
        try:
            d = basis @ newton_step(basis.T @ gradient, basis.T @ hessian @ basis)
        except np.linalg.LinAlgError:
            return stopped(step)
        lam = math.sqrt(max(0.0, -float(gradient @ d)))
        if lam < 1:
            certificate = relaxed.certificate(x, d) or certificate
        gamma = 1.0
        while not relaxed.inside(x + gamma * d) and gamma > 1e-16:
            gamma *= 0.7
        if lam >= 0.25:
            gamma = max(min(gamma, 1 / (1 + lam)), 0.9 * gamma if gamma < 1 else 0.0)
        if gamma <= 1e-16 and lam >= 0.3:
            return stopped(step)
        x = x + gamma * d
        if well_inside(x[:-1], problem, depth):
            return PhaseOne(x[:-1], step, inside=True)
        if lam < 0.3:
            sigma = float(x[-1])
            if certificate is not None and terms / kappa < SIGMA_TOLERANCE * sigma:
                return PhaseOne(x[:-1], step, certificate=certificate, violation=sigma)
            if terms / kappa < SIGMA_ROUNDING:
                return stopped(step)
            kappa *= 10
    return PhaseOne(x[:-1], max_steps, out_of_steps=True)


def well_inside(c: Array, problem: ForceProblem, depth: float = DEPTH) -> bool:
    """Tell whether forces are inside every cone and limit by a relative slack of ``depth``."""
    sigma = relative_violation(c, problem.barriers, problem.violation_scales())
    return bool(strictly_inside(c, problem.barriers) and sigma < -depth)


class _Relaxed:
    """The barriers of Phase 1 in x = (c, sigma): every limit moved out by sigma·scale.

    A cone is moved out along its axis: sigma adds the contact's reach to its normal force.
    """

    def __init__(self, problem: ForceProblem) -> None:
        self.problem, self.barriers = problem, problem.barriers
        self.scales = problem.violation_scales()
        rows, cones = self.scales
        self.A = np.column_stack((self.barriers.A, -rows))
        self.b = self.barriers.b
        push = np.zeros(self.barriers.A.shape[1])
        push[problem.starts[:-1]] = cones / problem.mu
        self.lift = np.column_stack((np.eye(len(push)), push))

    def least_sigma(self, c: Array) -> float:
        """The smallest slack that admits c."""
        return float(relative_violation(c, self.barriers, self.scales))

    def inside(self, x: Array) -> bool:
        within = (slacks(x, self.A, self.b) > 0).all()
        return bool(within and inside_cones(self.lift @ x, self.barriers.cones))

    def derivatives(self, x: Array) -> tuple[Array, Array]:
        lift, c, cones = self.lift, self.lift @ x, self.barriers.cones
        gradient = grad_phi_lin(x, self.A, self.b) + lift.T @ grad_phi_soc(c, cones)
        hessian = hess_phi_lin(x, self.A, self.b) + lift.T @ hess_phi_soc(c, cones) @ lift
        return gradient, hessian

    def certificate(self, x: Array, d: Array) -> Certificate | None:
        """Multipliers of a Newton step with λ < 1, dual feasible: a certificate if gap > 0."""
        lift, c, cones = self.lift, self.lift @ x, self.barriers.cones
        r = slacks(x, self.A, self.b)
        z = (1 + self.A @ d / r) / r
        cone = grad_phi_soc(c, cones) + hess_phi_soc(c, cones) @ (lift @ d)
        y = least_squares(self.problem.equalities[0].T, self.barriers.A.T @ z + cone)
        total = float(z @ -self.A[:, -1]) + abs(float(lift[:, -1] @ cone))
        certificate = Certificate(y / total, z / total)
        return certificate if certificate.proves_infeasible(self.problem) else None
