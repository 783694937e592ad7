"""How firm a grip shall be, in newtons and shares: the answer to "which alpha?".

:func:`choose` takes wishes and returns the forces that meet them, with the alpha that makes them.
:func:`least` encloses the smallest largest normal force with which the grasp can be held at all,
and a firmness is a multiple of that. :class:`FirmServo` keeps the wishes tick after tick.

Some wishes are hard limits, so that no trade-off can touch them: with a slip reserve the problem is
solved with less friction (the slip margin itself need not grow with a firmer alpha), with a torque
reserve within narrower torque limits, with a largest normal force under a ceiling.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple, Unpack

import numpy as np

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array, as_number, require_instance
from graspforce.answers.edge import Edge, Family, find_edge, lower_bound
from graspforce.answers.wishes import (
    Wishes,
    ceilings_at,
    slip_reserves,
    torque_reserves,
    with_friction,
)
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem, ProblemArguments
from graspforce.servo import Servo
from graspforce.solution import Solution
from graspforce.solve import solve

__all__ = ["FirmServo", "Grip", "choose", "least"]

# alpha stays in this range: outside it the largest normal force hardly changes any more.
_FIRMEST, _LIGHTEST = 1e-2, 1e6
# A least force below this part of a light grip's is none.
_NO_FORCE = 1e-6
# Wishes are met to a part in a hundred: the least force is known to half of the first, the wanted
# one met to the second.
_OF_LEAST, _OF_TARGET = 8e-3, 5e-3


@dataclass(frozen=True, slots=True)
class Grip:
    """Forces that meet the wishes, or the nearest that can be had.

    Attributes:
        solution: its ``problem`` has the hard wishes in it, as lower friction, narrower torque
            limits and ceilings.
        c: the contact forces to apply, shape (m,) [N, N·m]: those of ``solution``, but for a tick
            of a :class:`FirmServo` that its rate limits make infeasible.
        alpha: the weight that gives these forces.
        met: whether every wish is met.
        message: what was reached, or why a wish cannot be met and what can.
        least: the least possible largest normal force under the hard wishes [N], to half a percent;
            nan where it was not needed. :func:`least` gives it with proof.
        problem: the problem as it was given, against which the reserves are measured.
        solves: how many problems were solved.
    """

    solution: Solution
    c: Array
    alpha: float
    met: bool
    message: str
    least: float
    problem: ForceProblem
    solves: int

    @property
    def largest_normal(self) -> float:
        """The largest normal force [N]."""
        return float(self.c[self.problem.starts[:-1]].max())

    @property
    def times_least(self) -> float:
        """It over the least possible one; nan where that was not needed."""
        return self.largest_normal / self.least

    @property
    def slip_reserve(self) -> float:
        """By what share friction may fall, at all contacts at once, before one of them slips."""
        return float(slip_reserves(self.problem, self.c).min())

    @property
    def torque_reserve(self) -> float:
        """The smallest distance of a torque to its limit over half the joint's range."""
        tau = self.solution.tau + self.problem.J.T @ (self.c - self.solution.c)
        return float(torque_reserves(self.problem, tau).min(initial=math.inf))


def least(problem: ForceProblem, *, rtol: float = 1e-6) -> Edge:
    """Enclose the least possible largest normal force of a grasp.

    Args:
        problem: of the grasp; its alpha has no part in the answer.
        rtol: how near the bounds shall be to each other, relative.

    Returns:
        The bounds [N]: forces whose largest normal is at most ``upper`` in ``solution``, and a
        ``certificate`` that no force does it with less than ``lower``. Without an answer, because
        the grasp is infeasible whatever the forces, ``upper`` is inf and ``solution`` says why.

    Raises:
        InvalidInputError: no problem, or an rtol out of range.
    """
    require_instance(problem, "problem", ForceProblem)
    share = as_number(rtol, "rtol")
    if not 0 < share < 1:
        raise InvalidInputError(f"rtol: got {share:g}, expected more than 0 and less than 1")
    size = float(np.abs(problem.f).max()) or 1.0
    return _least(problem, share, 3 * size)


def _least(
    problem: ForceProblem, rtol: float, start: float, known: tuple[float, Solution] | None = None
) -> Edge:
    """As :func:`least`, from a first guess [N] and a grip that is known."""
    return find_edge(_ceiling_family(problem), start, rtol, least=0.0, known=known)


def _ceiling_family(problem: ForceProblem) -> Family:
    """Return the problems in which no normal force exceeds x [N]."""
    rows = np.eye(problem.m)[problem.starts[:-1]][problem.active]
    ones = np.ones(len(rows))
    base = problem.replace(A=np.vstack((problem.A, rows)), b=np.append(problem.b, ones), alpha=1.0)
    return lambda x: base.replace(b=np.append(problem.b, x * ones))


def choose(
    problem: ForceProblem,
    largest_normal: float | None = None,
    times_least: float | None = None,
    slip_reserve: float | None = None,
    torque_reserve: float | None = None,
) -> Grip:
    """Find contact forces that meet wishes in a user's terms, any of them together.

    Args:
        problem: of the grasp. Its alpha holds where ``times_least`` is not given.
        largest_normal: no finger shall push harder [N]; a hard limit.
        times_least: the largest normal force shall be this many times the least possible one under
            the other wishes, above 1; met within 1 %. 1.5 is a light grip, 10 a firm one.
        slip_reserve: the forces shall hold with friction lower by this share, 0.3 for 30 %, at all
            contacts at once; a hard limit.
        torque_reserve: the share of every joint's torque range that shall stay free, half of it at
            each end: with 0.2 and ±0.7 N·m no torque exceeds 0.56 N·m; a hard limit.

    Returns:
        The forces, their alpha, and whether the wishes are met. A wish that cannot be met is told
        in ``message``, and the forces are then the nearest that can be had.

    Raises:
        InvalidInputError: no wish, a wish out of range, or one about joints or friction that the
            problem does not have.
    """
    require_instance(problem, "problem", ForceProblem)
    wishes, times = _checked(problem, largest_normal, times_least, slip_reserve, torque_reserve)
    hard = wishes.applied(problem)
    first = solve(hard if times is None else hard.replace(alpha=_PROBE))
    if first.status is not Status.SOLVED:
        return _refused(problem, wishes, first)
    if times is None:
        return _grip(problem, first, True, math.nan, 1)
    light = float(first.normal_forces.max())
    bounds = _least(hard, _OF_LEAST, 0.9 * light, (light, first))
    return _as_firm(problem, wishes, first, bounds, times)


# Where the search for alpha begins: on most grasps within a quarter of the least force.
_PROBE = 1e4


def _checked(
    problem: ForceProblem,
    largest_normal: float | None,
    times_least: float | None,
    slip_reserve: float | None,
    torque_reserve: float | None,
) -> tuple[Wishes, float | None]:
    wishes = Wishes(largest_normal, slip_reserve, torque_reserve)
    if times_least is None and not wishes.given:
        raise InvalidInputError(
            "no wish: expected largest_normal, times_least, slip_reserve or torque_reserve"
        )
    wishes.check(problem)
    if times_least is None:
        return wishes, None
    times = as_number(times_least, "times_least")
    if times <= 1:
        raise InvalidInputError(
            f"times_least: got {times:g}, expected more than 1, which is the least possible force"
        )
    return wishes, times


class FirmServo:
    """A :class:`graspforce.Servo` that keeps the wishes of :func:`choose` tick after tick.

    The hard wishes hold in every tick that is SOLVED. With ``times_least`` alpha follows the load:
    the least possible force is tracked by a probe or two a tick, and alpha moves a part of the way
    to where the largest normal force is the wanted multiple, at most by a twentieth a tick, so that
    the forces stay as smooth as the load and the ticks one or two Newton steps.

    Args:
        problem: the first tick's problem; its shape stays.
        largest_normal, times_least, slip_reserve, torque_reserve: as in :func:`choose`.
        settings: of the Servo.

    Raises:
        InvalidInputError: as :func:`choose`.

    Attributes:
        problem: the next tick's problem, without the wishes.
    """

    def __init__(
        self,
        problem: ForceProblem,
        largest_normal: float | None = None,
        times_least: float | None = None,
        slip_reserve: float | None = None,
        torque_reserve: float | None = None,
        settings: Settings | None = None,
    ) -> None:
        require_instance(problem, "problem", ForceProblem)
        self._wishes, self._times = _checked(
            problem, largest_normal, times_least, slip_reserve, torque_reserve
        )
        self.problem = problem
        self._servo = Servo(self._wishes.applied(problem), settings)
        self._alpha, self._move, self._least = problem.alpha, 0.0, math.nan
        if times_least is not None:
            grip = choose(problem, largest_normal, times_least, slip_reserve, torque_reserve)
            self._alpha, self._least = grip.alpha, grip.least

    def step(self, **changes: Unpack[ProblemArguments]) -> Grip:
        """Solve the next tick from what has changed, as :meth:`graspforce.Servo.step`.

        Args:
            **changes: arguments of :class:`graspforce.ForceProblem`; ``models`` with less friction
                where slip was seen. With ``times_least`` alpha is the FirmServo's own, with rate
                limits ``c_last`` is, after a tick that is SOLVED.

        Returns:
            This tick's grip. ``met`` is False while alpha is on its way, and in a tick that is not
            SOLVED. Where rate limits alone make a tick infeasible, as after friction that drops,
            ``c`` goes as far as they allow towards forces that meet everything.

        Raises:
            InvalidInputError: an argument is wrong; the FirmServo is as it was before the call.
        """
        problem = self.problem.replace(**changes)
        hard = self._wishes.applied(problem)
        if self._times is not None:
            hard = hard.replace(alpha=self._alpha)
        solution = self._servo.step_to(hard)
        solves, met, c = 1, solution.status is Status.SOLVED, solution.c
        text = None if met else solution.message
        if problem.layout.rate_limits and not met:
            solves, c, text = 2, *_towards(hard)
        self.problem = problem.replace(c_last=c) if problem.layout.rate_limits else problem
        if self._times is not None and met:
            self._least, solves = _tracked(hard, self._least)
            ratio = float(solution.normal_forces.max()) / self._least
            met = abs(ratio / self._times - 1) <= 0.01
            off = math.log(max(ratio - 1, 1e-3) / max(self._times - 1, 1e-3))
            self._move = (self._move + min(max(_GAIN * off, -_MOVE), _MOVE)) / 2
            self._alpha = min(max(self._alpha * math.exp(self._move), _FIRMEST), _LIGHTEST)
            solves += 1
        return _grip(problem, solution, met, self._least, solves, text, c)


# Of a FirmServo: the part of the way to the wanted firmness that ln alpha goes in a tick, over the
# usual slope −0.7 of the ratio in ln alpha, and the most that it goes.
_GAIN, _MOVE = 0.8, 0.05


def _towards(hard: ForceProblem) -> tuple[Array, str]:
    """Return the forces one tick nearer to those that meet everything, within the rate limits.

    On the straight line W c = f stays as it was, and what c_last violates shrinks in every tick.
    """
    last, most = hard.c_last, hard.dc_max
    free = solve(hard.replace(c_last=None, dc_max=None))
    if free.status is not Status.SOLVED:
        return last, free.message
    move = free.c - last
    with np.errstate(divide="ignore"):
        share = min(1.0, float((_WITHIN * most / np.abs(move)).min()))
    text = (
        "the rate limits admit no force within all the other limits in this tick; it goes "
        f"{100 * share:.3g} % of the way to one"
    )
    return last + share * move, text


# The part of the rate limits that is used where forces go straight, clear of rounding.
_WITHIN = 1 - 1e-9


def _tracked(hard: ForceProblem, force: float) -> tuple[float, int]:
    """Return the least largest normal force [N] from that of a similar problem, and the solves.

    Just below the edge a certificate's bound is off by the square of the distance.
    """
    family, solves = _ceiling_family(hard), 0
    while solves < 3 and force > 0:
        x = 0.995 * force
        solution, solves = solve(family(x)), solves + 1
        found = lower_bound(family, x, solution)
        if found is None or not 0 < found[0] < math.inf:
            break
        force = found[0]
        if solution.status is Status.INFEASIBLE and force < 1.02 * x:
            return force, solves
    size = float(np.abs(hard.f).max()) or 1.0
    bounds = find_edge(family, force if force > 0 else size, _OF_LEAST, least=0.0)
    return (bounds.lower + bounds.upper) / 2, solves + bounds.solves


# ---- a multiple of the least force -------------------------------------------------------------


def _as_firm(
    problem: ForceProblem, wishes: Wishes, first: Solution, bounds: Edge, times: float
) -> Grip:
    """Find the alpha whose largest normal force is ``times`` the least one."""
    force, ceiling = (bounds.lower + bounds.upper) / 2, wishes.largest_normal
    target = times * force
    solves = 1 + bounds.solves
    if force <= _NO_FORCE * float(first.normal_forces.max()):
        text = (
            f"times_least={times:g} has no meaning here: the grasp holds this load without any "
            "force; ask for largest_normal instead"
        )
        return _grip(problem, first, False, force, solves, text)
    if ceiling is not None and target > ceiling:
        firm, used = _to_target(first, ceiling * (1 - _OF_TARGET), force)
        text = (
            f"times_least={times:g} and largest_normal={ceiling:g} exclude each other: {times:g} "
            f"times the least possible {force:.3g} N is {target:.3g} N; the forces are those of "
            f"{firm.normal_forces.max() / force:.3g} times the least"
        )
        return _grip(problem, firm, False, force, solves + used, text)
    found, used = _to_target(first, target, force)
    reached = float(found.normal_forces.max())
    solves += used
    if reached > target * (1 + _OF_TARGET):  # no alpha is so light: a ceiling is
        hard = found.problem
        ceiling = min(1.05 * target, target + (target - force) / 2)
        capped = hard.replace(c_max=ceilings_at(hard, ceiling), alpha=1.0)
        found, used = _to_target(solve(capped), target, force)
        reached, solves = float(found.normal_forces.max()), solves + used + 1
    if abs(reached / target - 1) <= 0.01:
        return _grip(problem, found, True, force, solves)
    text = (
        f"times_least={times:g} cannot be had: the least possible largest normal force is "
        f"{force:.3g} N, and the {'firmest' if reached < target else 'lightest'} grip within the "
        f"limits has {reached:.3g} N, {reached / force:.3g} times as much"
    )
    return _grip(problem, found, False, force, solves, text)


class _Point(NamedTuple):
    """A solution in the search for alpha.

    Attributes:
        x: ln alpha.
        y: ln(largest normal/least − 1), less the wanted one.
        slope: dy/dx.
    """

    x: float
    y: float
    slope: float


def _to_target(first: Solution, target: float, force: float) -> tuple[Solution, int]:
    """Return the solution whose largest normal force is ``target`` [N], or the nearest one.

    ln(largest normal/force − 1) falls with ln alpha, in the middle of the range nearly along a line
    of slope −0.7. Newton's method with the derivative of the optimum; between two points on either
    side of the root, the cubic that has their values and slopes.

    Args:
        first: of the same problem with any alpha.
        target: wanted force [N].
        force: the least possible one [N].

    Returns:
        The solution, and how many problems were solved.
    """
    if first.status is not Status.SOLVED:
        return first, 0
    wanted = math.log(max(target / force - 1, 1e-6))
    best, here, solves = first, _point(first, force, wanted), 0
    # The points nearest to the root on either side; the ends of the range have no slope yet.
    light = _Point(math.log(_LIGHTEST), -math.inf, 0.0)
    firm = _Point(math.log(_FIRMEST), math.inf, 0.0)
    narrow = math.inf  # what the bracket's width has to fall below, lest it is halved
    while abs(float(best.normal_forces.max()) / target - 1) > _OF_TARGET and solves < 15:
        firm, light = (here, light) if here.y > 0 else (firm, here)
        width = light.x - firm.x
        if width < 1e-3:
            break
        if light.y == -math.inf and here.y + 3 * here.slope * width > 0:
            break  # the force hardly falls any more: no alpha is so light
        if not math.isfinite(firm.y - light.y):  # one side is not known: longer and longer steps
            step = abs(here.y) / min(max(-here.slope, 0.1), 2.0)
            step = math.copysign(max(step, 1.5 * (solves + 1)), here.y)
            x = min(max(here.x + step, firm.x), light.x)
        elif width > narrow:
            x, narrow = (firm.x + light.x) / 2, math.inf
        else:
            x = min(max(_between(firm, light), firm.x + 0.05 * width), light.x - 0.05 * width)
            narrow = 0.7 * width
        found = solve(first.problem.replace(alpha=math.exp(x)), start=best.c)
        solves += 1
        if found.status is not Status.SOLVED:
            break
        best, here = found, _point(found, force, wanted)
    return best, solves


def _between(firm: _Point, light: _Point) -> float:
    """Return x at y = 0 of the cubic x(y) through two points with their slopes."""
    width, share = light.y - firm.y, -firm.y / (light.y - firm.y)
    line = (light.x - firm.x) / width
    # No steeper than where such a cubic may turn back.
    starts, ends = (max(min(1 / min(p.slope, -1e-9), 0.0), 3 * line) for p in (firm, light))
    t, u = share, 1 - share
    return (
        (1 + 2 * t) * u * u * firm.x
        + t * u * u * width * starts
        + t * t * (3 - 2 * t) * light.x
        - t * t * u * width * ends
    )


def _point(solution: Solution, force: float, wanted: float) -> _Point:
    """Return where a solution is in the search, its slope by the derivative of the optimum."""
    ordinary, forces = solution.without_pulls()
    problem, forces = ordinary.restricted(), forces[ordinary.active_forces]
    barriers, (W, f) = problem.barriers, problem.equalities
    _, hessian = equations.derivatives(forces, barriers)
    push = problem.alpha * equations.grad_phi_lin(forces, barriers.A, barriers.b)
    # H dc + W.T dnu = −push with W dc = 0, in units in which H has a unit diagonal.
    unit = 1 / np.sqrt(np.diag(hessian))
    _, null = equations.particular_and_nullspace(W * unit, f)
    scaled = hessian * unit[:, None] * unit
    dc = -unit * (null @ np.linalg.solve(null.T @ scaled @ null, null.T @ (unit * push)))
    normals = solution.normal_forces[solution.problem.active]
    above = max(float(normals.max()) - force, 1e-6 * force)
    rate = float(dc[problem.starts[:-1]][normals.argmax()])
    return _Point(math.log(problem.alpha), math.log(above / force) - wanted, rate / above)


# ---- hard wishes that cannot be met ------------------------------------------------------------


def _refused(problem: ForceProblem, wishes: Wishes, failed: Solution) -> Grip:
    """Say which wish cannot be met, or which two exclude each other, and what can be had."""
    plain = solve(problem)
    solves = 2
    if plain.status is not Status.SOLVED:
        text = f"no wish can be met, because the grasp itself has no answer: {plain.message}"
        return _grip(problem, plain, False, math.nan, solves, text)
    names = list(wishes.given)
    for size in range(1, len(names) + 1):
        for some in itertools.combinations(names, size):
            solves += 1
            if solve(wishes.only(*some).applied(problem)).status is not Status.SOLVED:
                return _without(problem, wishes, some, plain, solves)
    return _grip(problem, failed, False, math.nan, solves, failed.message)


def _without(
    problem: ForceProblem, wishes: Wishes, some: tuple[str, ...], plain: Solution, solves: int
) -> Grip:
    """Say that some wishes, as few as possible, exclude each other; the first gives way."""
    others = wishes.only(*(name for name in wishes.given if name != some[0]))
    if solve(others.applied(problem)).status is not Status.SOLVED:  # there are more conflicts
        wishes = wishes.only(*some)
        others = wishes.only(*some[1:])
    edge, value, said = _nearest(others.applied(problem), some[0], wishes.given[some[0]])
    solves += 2 + edge.solves
    asked = [f"{name}={wishes.given[name]:g}" for name in some]
    held = [f"{name}={value:g}" for name, value in others.given.items()]
    conflict = (
        f"{' and '.join(asked)} exclude each other" if asked[1:] else f"{asked[0]} cannot be had"
    )
    text = f"{conflict}: {said}{' with ' + ' and '.join(held) if held else ''}"
    near = solve(Wishes(**(others.given | {some[0]: value})).applied(problem))
    found = near if near.status is Status.SOLVED else plain
    return _grip(problem, found, False, math.nan, solves, text)


def _nearest(base: ForceProblem, name: str, asked: float) -> tuple[Edge, float, str]:
    """Return how far a wish can go in a problem: the edge, its value, and a sentence."""
    if name == "largest_normal":
        edge = _least(base, 1e-3, 2 * asked)
        return edge, edge.upper, f"at least {edge.upper:.3g} N are needed"
    if name == "slip_reserve":
        edge = find_edge(
            lambda x: base.replace(models=with_friction(base, x)), 1.0, 5e-3, affine=False,
            least=1 - asked, most=1.0,
        )  # fmt: skip
    else:
        middle, half = (base.tau_hi + base.tau_lo) / 2, (base.tau_hi - base.tau_lo) / 2
        edge = find_edge(
            lambda x: base.replace(tau_lo=middle - x * half, tau_hi=middle + x * half), 1.0, 5e-3,
            least=1 - asked, most=1.0,
        )  # fmt: skip
    most = max(1 - edge.upper, 0.0)
    return edge, most, f"at most {name}={most:.3g} can be had"


def _grip(
    problem: ForceProblem,
    solution: Solution,
    met: bool,
    force: float,
    solves: int,
    text: str | None = None,
    c: Array | None = None,
) -> Grip:
    alpha, largest = solution.problem.alpha, float(solution.normal_forces.max())
    if text is None:
        text = f"the largest normal force is {largest:.3g} N"
        if force == force:
            text += f", {largest / force:.3g} times the least possible {force:.3g} N"
        text += f"; alpha is {alpha:.3g}"
    return Grip(solution, solution.c if c is None else c, alpha, met, text, force, problem, solves)
