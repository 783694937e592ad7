"""Where a family of problems stops being feasible, enclosed from both sides.

A family is a function of one number x whose problems are feasible above an edge x* and infeasible
below it: a ceiling [N], a factor on the friction or on the torque limits, minus a load. Most are
affine in x, f(x) = f0 + x f1 and b(x) = b0 + x b1. Then every probe bounds x* from below, whatever
its verdict:

* an infeasible one by its certificate (y, z): ``y·f(x) > z·b(x)`` stays a proof up to its root;
* a solved one by its multipliers: with y = nu and z = alpha/slack, A.T z − W.T y = −∇Phi_soc lies
  in the dual of the cones, so (y, z) is a certificate for the x where y·f(x) exceeds z·b(x).

The next probe lies just above the lower bound. From the infeasible side this is Newton's method on
the least violation, a convex function of x. The bound counts only where
:func:`graspforce.check_certificate` confirms it, rounding included.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from graspforce._engine.outcome import Status
from graspforce.certificate import Certificate, check_certificate
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.solve import solve

Family = Callable[[float], ForceProblem]

# The next probe's place between the bounds, seen from the lower one.
_NEAR = 0.05
# Bounds nearer to each other than this part of the first probe's x are at the end of rounding.
_NOTHING = 1e-12


@dataclass(frozen=True, slots=True)
class Edge:
    """The enclosed edge of a family.

    Attributes:
        lower: below it no force will do; proved where ``certificate`` is given.
        upper: at it ``solution`` is SOLVED; inf where no x was found to help.
        solution: the answer at ``upper``; of the last probe where nothing was solved.
        certificate: proof for every x below ``lower``; None where rounding or a family that is not
            affine allows none.
        solves: how many problems were solved.
        newton_steps: of all of them.
    """

    lower: float
    upper: float
    solution: Solution
    certificate: Certificate | None
    solves: int
    newton_steps: int

    @property
    def found(self) -> bool:
        """Whether any x was found to be feasible."""
        return math.isfinite(self.upper)


def find_edge(
    family: Family,
    start: float,
    rtol: float,
    *,
    affine: bool = True,
    least: float = -math.inf,
    most: float = math.inf,
    known: tuple[float, Solution] | None = None,
) -> Edge:
    """Enclose the edge of a family until the bounds are within ``rtol`` of each other.

    Args:
        family: problems by x.
        start: the first x to try.
        rtol: wanted (upper − lower)/|upper|.
        affine: whether f and b are affine in x and nothing else depends on it.
        least: a lower bound that is known.
        most: the largest x that makes sense; the edge is not sought beyond it.
        known: an x above the edge, and a solution that meets its problem's limits.

    Returns:
        The enclosure; ``upper`` is inf where every probe up to ``most`` was infeasible.
    """
    lower, (upper, best) = least, known or (math.inf, None)
    last = None
    proof: Certificate | None = None
    solves = steps = slow = stalls = 0
    x, reach = start, abs(start) or 1.0
    while solves < 60:
        last = solve(family(x), start=None if best is None else best.c)
        solves, steps, gap = solves + 1, steps + last.newton_steps, upper - lower
        if last.status is Status.SOLVED:
            if x < upper:
                upper, best = x, last
        elif last.status is Status.INFEASIBLE:
            if x > lower:
                lower, proof = x, last.certificate if affine else None
        elif last.status is Status.ON_EDGE:
            lower, proof = max(lower, x), proof if lower > x else None
        elif last.status in (Status.WRENCH_UNREACHABLE, Status.UNBOUNDED) or stalls == 4:
            break
        else:
            stalls += 1
        if affine and (found := lower_bound(family, x, last, lower, least)) is not None:
            lower, proof = found
        if lower >= most or lower == math.inf:
            break
        narrow = upper - lower <= max(rtol * abs(upper), _NOTHING * reach)
        if math.isfinite(upper) and (narrow or upper <= lower):
            break
        if not math.isfinite(upper):
            step = reach * 4.0**solves
            x = min(max(lower + _NEAR * max(abs(lower), reach), x + step), most)
        elif not math.isfinite(lower):
            x = upper - reach * 4.0**solves
        else:
            slow = slow + 1 if upper - lower > gap / 2 else 0
            share = _NEAR if affine and slow < 2 else 0.5
            near = max(share * (upper - lower), 0.9 * rtol * abs(upper))
            x = lower + near if last.status <= Status.INFEASIBLE else (x + upper) / 2
    assert last is not None
    return Edge(lower, upper, best or last, proof, solves, steps)


def lower_bound(
    family: Family,
    x: float,
    solution: Solution,
    least: float = -math.inf,
    domain: float = -math.inf,
) -> tuple[float, Certificate] | None:
    """Return the x below which the multipliers of a probe at x prove infeasibility, and them.

    Args:
        family: affine in x.
        x: where it was probed.
        solution: what was found there.
        least: only bounds above this one count.
        domain: the family may be asked for what is above this, and for more than x only at x = 0.
    """
    problem = solution.problem
    if solution.status is Status.SOLVED:
        ordinary, forces = solution.without_pulls()
        A, b = ordinary.linear_limits()
        certificate = Certificate(solution.nu, problem.alpha / (b - A @ forces))
    elif solution.certificate is not None:
        certificate = solution.certificate
    else:
        return None
    other = (x + domain) / 2 if -math.inf < domain < x else x / 2 or 1.0
    here = certificate.excess(problem)
    slope = (certificate.excess(family(other)) - here) / (other - x)
    if slope >= 0:  # proves nothing, or the infeasibility of every x above
        return (math.inf, certificate) if here > 0 else None
    bound = x - here / slope
    if not math.isfinite(bound):
        return (math.inf, certificate) if here > 0 else None
    bound -= 1e-9 * abs(here / slope) + 1e-12 * abs(bound)  # leaves room for rounding
    if bound <= least or not check_certificate(family(bound), certificate):
        return None
    return bound, certificate
