"""A start inside all cones and limits, or the certificate that there is none.

The methods of Buss, Faybusovich and Moore need a strictly feasible start. The WBF paper says of
[9] only that it gets one by a gradient method. Here every block of P is relaxed by sigma times its
unit, which always has a start, and sigma is reduced by steepest descent on
weight·sigma − ln det P in the metric of Dikin's ellipsoid, for growing weights. The
start is found when all blocks are positive definite without sigma; where none exists, the
multipliers of the last steps are the certificate, and sigma is the least violation.
"""

from __future__ import annotations

import math

import numpy as np

from graspforce import equations
from graspforce._engine.outcome import PlainOutcome, Status
from graspforce._util.arrays import Array
from graspforce.baselines._active import Active
from graspforce.baselines._lmi import Lmi, dikin_direction, line_search
from graspforce.certificate import Certificate, check_certificate
from graspforce.solution import Solution

MAX_STEPS = 200
# The weight of sigma beyond which rounding dominates.
FINAL_WEIGHT = 1e13


def feasible_start(view: Active) -> tuple[Array, int] | Solution:
    """Find a force with W c = f strictly inside every cone and limit.

    Returns:
        The force, shape (m,), and the steps taken; or the Solution that ends the solve:
        INFEASIBLE with its certificate, else MAX_STEPS or STALLED.
    """
    c_p, N = equations.particular_and_nullspace(view.W, view.problem.f)
    in_c = Lmi.of(view)
    strict = in_c.substitute(c_p, N)
    # Sigma is in units of the first violation, which grows without bound with an overload.
    size = max(1.0, view.violation(c_p))
    of_limits, of_cones = view.inner.violation_scales()
    relaxed = strict.widen(size * of_cones, size * of_limits)
    x = np.append(np.zeros(N.shape[1]), 1.2 * view.violation(c_p) / size + 0.1)
    weight, steps, proof, status = 10.0, 0, None, Status.MAX_STEPS
    while steps < MAX_STEPS:
        if strict.at(x[:-1]).inside:
            return c_p + N @ x[:-1], steps
        point = relaxed.at(x)
        gradient = point.gradient
        gradient[-1] += weight
        try:
            d = dikin_direction(point, gradient)
        except np.linalg.LinAlgError:  # the metric is singular to rounding
            status = Status.STALLED
            break
        decrement = math.sqrt(max(0.0, -float(gradient @ d)))
        steps += 1
        if decrement < 1:
            proof = _proof(view, in_c, point.multipliers(d)) or proof
        if decrement >= 0.3:
            x = x + line_search(point.spectrum(d), weight * float(d[-1]), 1.0) * d
        elif proof is not None and relaxed.rows <= 1e-7 * weight * x[-1]:
            break
        elif weight >= FINAL_WEIGHT:
            status = Status.STALLED
            break
        else:
            weight *= 10
    c = view.problem.scatter(c_p + N @ x[:-1])
    if proof is None:
        return Solution(PlainOutcome(status, steps, c, np.zeros(len(view.W))), view.problem)
    y, z = proof
    every = view.problem.scatter_multipliers(z)
    return Solution(
        PlainOutcome(Status.INFEASIBLE, steps, c, y, violation=size * float(x[-1]), y=y, z=every),
        view.problem,
    )


def infeasible(view: Active) -> Solution | None:
    """Return the proof that a problem is infeasible, if there is one."""
    found = feasible_start(view)
    if isinstance(found, Solution) and found.status is Status.INFEASIBLE:
        return found
    return None


def infeasible_or(view: Active, own: Solution) -> Solution:
    """Return the proof that a problem is infeasible, if there is one, for a method's failure."""
    return infeasible(view) or own


def _proof(view: Active, in_c: Lmi, multipliers: list[Array]) -> tuple[Array, Array] | None:
    """Return y and z of a Certificate from the multipliers of P's blocks, if they prove any."""
    *cones, limits = multipliers
    z = limits.ravel()[:-1]  # the last row is sigma's own
    target = view.A.T @ z
    for part, Z in zip(in_c.blocks, cones, strict=False):  # the last of the blocks is the limits
        target = target - np.einsum("abc,jacb->j", Z, part.F)
    y = equations.least_squares(view.W.T, target)
    size = float(max(np.abs(y).max(), z.max(initial=0.0)))
    y, z = y / size, np.maximum(z / size, 0.0)
    return (y, z) if check_certificate(view.problem, Certificate(y, z)) else None
