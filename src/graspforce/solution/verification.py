"""Check of a result: its residuals recomputed from the problem's data alone, in NumPy.

No residual of the solver is used. SOLVED and the bound on the decrement are checked by
the forces, INFEASIBLE by its certificate, WRENCH_UNREACHABLE by the range of W, UNBOUNDED by a new
search for large forces; the other statuses only by the finiteness of their numbers and the bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from graspforce import equations
from graspforce._engine.outcome import Outcome, Status
from graspforce._util.arrays import Array
from graspforce.certificate import Certificate
from graspforce.equations import RUNAWAY
from graspforce.problem import ForceProblem
from graspforce.reference.phase_one import find_inside

# SOLVED means that W c = f holds to this fraction of the wrenches that add up to f.
WRENCH_TOLERANCE = 1e-9
# ON_EDGE means that limits moved out by this share admit the forces, which make f to that one.
EDGE, EDGE_TOLERANCE = 1e-9, 1e-7
# Relative tolerance of a certified bound; and a violation that is none, of empty grasps as well.
BOUND_TOLERANCE, ROUNDING = 1e-6, 1e-9
# Most Newton steps of the search for forces that show UNBOUNDED.
MAX_SEARCH_STEPS = 200


@dataclass(frozen=True, slots=True)
class Verification:
    """What :meth:`Solution.verify` recomputed from the data, and whether it confirms the status.

    Attributes:
        ok: the numbers below confirm the status; :meth:`Solution.verify` says what that takes.
        wrench_error: largest |W c − f| [N, N·m].
        friction_margin: smallest of the friction margins [N].
        limit_margin: smallest slack of the linear limits, in each limit's own unit.
        decrement: Newton decrement of Phi over its unit at c, from NumPy; inf outside.
        certificate_holds: the certificate proves infeasibility; None when there is none.
        undetermined: how many components of c neither W c = f nor the torques determine: they, and
            what of the friction margin is theirs, are as asked, and need not come about. 0
            without J.
    """

    ok: bool
    wrench_error: float
    friction_margin: float
    limit_margin: float
    decrement: float
    certificate_holds: bool | None
    undetermined: int


def verify(outcome: Outcome, problem: ForceProblem) -> Verification:
    """Check a solver's result for a problem; see :meth:`graspforce.Solution.verify`.

    Args:
        outcome: its status, forces, multipliers, bound, violation and certificate.
        problem: the problem that it solved.
    """
    active = problem.active_forces
    whole = np.append(outcome.c, outcome.internal_forces) + problem.preload
    problem = problem.without_pulls()
    inner, c = problem.restricted(), whole[active]
    barriers = inner.barriers
    with np.errstate(all="ignore"):
        friction = float(equations.friction_margins(c, barriers.cones).min(initial=math.inf))
        limits = float(equations.slacks(c, barriers.A, barriers.b).min(initial=math.inf))
        inside = friction > 0 and limits > 0
        decrement, error = math.inf, 0.0
        if inside:
            decrement, error = equations.decrement_and_error(c, inner.equalities[0], barriers)
        bounded = decrement <= (1 + BOUND_TOLERANCE) * outcome.decrement + error
        well_formed = (
            np.isfinite(whole).all() and np.isfinite(outcome.nu).all() and not whole[~active].any()
        ) and (inside or not outcome.nearest)
        holds = _certificate_holds(outcome, problem)
        match Status(outcome.status):
            case Status.SOLVED:
                ok = inside and _is_balanced(whole, problem)
            case Status.INFEASIBLE:
                admitted = inside or _within_violation(c, inner, outcome.violation)
                ok = bool(holds) and admitted and _at_least_proved(outcome, problem)
            case Status.WRENCH_UNREACHABLE:
                ok = not equations.wrench_reachable(*inner.equalities)
            case Status.ON_EDGE:
                error = equations.relative_wrench_error(whole, *problem.equalities)
                ok = bool(error <= EDGE_TOLERANCE) and _within_violation(c, inner, EDGE)
            case Status.UNBOUNDED:
                ok = not problem.has_limits or _is_unbounded(inner)
            case Status.MAX_STEPS | Status.STALLED:
                ok = True
            case Status.INVALID_NUMBERS:
                ok = equations.may_overflow(problem.packed)
        wrench_error = float(equations.wrench_error(whole[: problem.m], problem.W, problem.f))
    return Verification(
        bool(ok and bounded and well_formed),
        wrench_error,
        friction,
        limits,
        decrement,
        holds,
        problem.undetermined,
    )


def _is_balanced(c: Array, problem: ForceProblem) -> bool:
    return bool(equations.relative_wrench_error(c, *problem.equalities) <= WRENCH_TOLERANCE)


def _certificate_holds(outcome: Outcome, problem: ForceProblem) -> bool | None:
    """Whether the certificate holds; None without one."""
    y, z = outcome.y, outcome.z
    if y is None or z is None:
        return None
    return Certificate(y, z[problem.counted_limits()]).proves_infeasible(problem)


def _at_least_proved(outcome: Outcome, problem: ForceProblem) -> bool:
    """Whether the violation is no smaller than the certificate proves.

    Limits and cones that are moved out by sigma of their scales let y·f − z·b be at most sigma
    times what the multipliers make of the scales.
    """
    y, z = outcome.y, outcome.z
    if y is None or z is None:
        return False
    certificate = Certificate(y, z[problem.counted_limits()])
    A, _ = problem.linear_limits()
    e = A.T @ certificate.z - problem.equalities[0].T @ y
    of_rows, of_cones = problem.violation_scales()
    normals = (e[problem.starts[:-1]] * of_cones / problem.mu)[problem.active]
    bound = certificate.excess(problem) / (certificate.z @ of_rows + normals.sum())
    return bool(outcome.violation >= (1 - BOUND_TOLERANCE) * bound - ROUNDING)


def _within_violation(c: Array, problem: ForceProblem, violation: float) -> bool:
    """Whether cones and limits that are moved out by a relative violation admit the forces.

    Args:
        c: the forces.
        problem: every contact in the grasp.
        violation: how far.
    """
    barriers, scales = problem.barriers, problem.violation_scales()
    A, b = np.abs(barriers.A), np.abs(barriers.b)
    rounding = 64 * np.finfo(float).eps * ((A @ np.abs(c) + b) / scales[0]).max(initial=0.0)
    found = equations.relative_violation(c, barriers, scales)
    return bool(found <= (1 + BOUND_TOLERANCE) * violation + rounding)


def _is_unbounded(problem: ForceProblem) -> bool:
    """Whether forces strictly inside all limits exist 1e6 times above the limits' own scale.

    The search fixes the sum of the normal forces by one more row of W c = f.

    Args:
        problem: every contact in the grasp.
    """
    total = RUNAWAY * float(equations.force_size(problem.barriers, problem.f)) or 1.0
    if not problem.n or not math.isfinite(total):
        return False
    normals = np.zeros(problem.m)
    normals[problem.starts[:-1]] = 1.0
    f_soft = np.append(problem.f_soft, 0.0) if problem.layout.soft_wrench else None
    W, f = np.vstack((problem.W, normals)), np.append(problem.f, total)
    scaled = problem.replace(W=W, f=f, f_soft=f_soft)
    try:
        if not all(equations.wrench_reachable(*each.equalities) for each in (problem, scaled)):
            return False
        c_p, N = equations.particular_and_nullspace(*scaled.equalities)
        found = find_inside(scaled, N, c_p, MAX_SEARCH_STEPS)
    except np.linalg.LinAlgError:
        return False
    return found.inside and _is_balanced(found.c, scaled)
