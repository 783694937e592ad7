"""Which finger can leave a grasp, how far its engagement can fall, and how fast.

The public names are those of :mod:`graspforce.regrasp`, which adds the schedules. A finger is given
by its index from 0, or by its name.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce._util.arrays import (
    Array,
    as_array,
    as_number,
    as_tuple,
    came,
    index_of,
    require_instance,
)
from graspforce.answers import payload
from graspforce.answers.diagnosis import default_names
from graspforce.answers.edge import Edge, find_edge
from graspforce.certificate import Certificate
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.solve import solve

# Engagements below this are taken for those of a finger that has left.
_LEAST_ENGAGEMENT = 1e-3

# The engagements of a finger that lifts, a tenth at a time.
_LIFT = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)


@dataclass(frozen=True, slots=True)
class Departure:
    """Whether a finger can leave now.

    Attributes:
        possible: whether the others hold the load without it.
        solution: their forces; where they do not hold it, the answer that says so.
        certificate: where they do not, the proof.
    """

    possible: bool
    solution: Solution
    certificate: Certificate | None


@dataclass(frozen=True, slots=True)
class Lift:
    """Which finger to lift next.

    Attributes:
        finger: the index of the best one; None where none can leave.
        margins: for each finger the multiple of the load that the others hold without it, shape
            (n,); nan for one that cannot leave or has left.
    """

    finger: int | None
    margins: Array


@dataclass(frozen=True, slots=True)
class Ramp:
    """The fastest way to unload a finger.

    Attributes:
        duration: of the straight line from ``start`` to ``end`` [s].
        least: no way is shorter than this [s]; within 1e-3 of the duration.
        start: contact forces of the grasp with the finger, shape (m,) [N, N·m].
        end: contact forces without it, shape (m,) [N, N·m].
    """

    duration: float
    least: float
    start: Array
    end: Array

    def at(self, t: float) -> Array:
        """Return the contact forces at time t [s]: inside every limit, and W c = f throughout."""
        share = min(max(as_number(t, "t") / self.duration, 0.0), 1.0)
        return self.start + share * (self.end - self.start)


def can_leave(
    problem: ForceProblem, finger: int | str, fingers: Sequence[str] | None = None
) -> Departure:
    """Tell whether the other fingers hold the load without one, with proof either way.

    Args:
        problem: of the grasp.
        finger: its index from 0, or its name.
        fingers: names of the n contacts; default "finger 1", "finger 2", ….

    Raises:
        InvalidInputError: an argument of a wrong kind, a finger that does not exist.
    """
    i = _index(problem, finger, fingers)
    found = solve(_engaged(problem, i, 0.0))
    return Departure(found.status is Status.SOLVED, found, found.certificate)


def lowest_engagement(
    problem: ForceProblem, finger: int | str, fingers: Sequence[str] | None = None
) -> Edge:
    """Enclose how low a finger's engagement can go while the grasp holds the load.

    Args:
        problem: of the grasp, with ceilings c_max, which the engagement scales.
        finger: its index from 0, or its name.
        fingers: names of the n contacts; default "finger 1", "finger 2", ….

    Returns:
        The bounds, 1e-3 apart: 0 and 0 where the finger can leave altogether; ``upper`` is inf
        where the load is not even held with an engagement of 1.

    Raises:
        InvalidInputError: as :func:`can_leave`; no ceilings.
    """
    i = _index(problem, finger, fingers)
    if not problem.layout.ceilings:
        raise InvalidInputError("c_max: missing; the engagement is a share of it")
    away = can_leave(problem, i)
    if away.possible:
        return Edge(0.0, 0.0, away.solution, None, 1, away.solution.newton_steps)
    whole = solve(_engaged(problem, i, 1.0))
    if whole.status is not Status.SOLVED:
        return Edge(1.0, math.inf, whole, whole.certificate, 2, whole.newton_steps)
    return find_edge(
        lambda x: _engaged(problem, i, x), 0.5, 1e-3, least=_LEAST_ENGAGEMENT, known=(1.0, whole)
    )


def next_to_lift(problem: ForceProblem) -> Lift:
    """Return the finger without which the others hold the largest multiple of the load.

    Raises:
        InvalidInputError: no problem, or one without load.
    """
    require_instance(problem, "problem", ForceProblem)
    if not problem.f.any():
        raise InvalidInputError("f: got zeros, expected a load whose multiples can be compared")
    margins = np.full(problem.n, math.nan)
    for i in np.flatnonzero(problem.active):
        without = _engaged(problem, int(i), 0.0)
        found = payload.along(without, without.f, rtol=1e-2)
        if found.lower > -math.inf:
            margins[i] = 1 + found.lower
    best = None if np.isnan(margins).all() else int(np.nanargmax(margins))
    return Lift(best, margins)


def payload_during_lift(
    problem: ForceProblem,
    finger: int | str,
    engagements: ArrayLike = _LIFT,
    fingers: Sequence[str] | None = None,
) -> Array:
    """Return the multiple of the load that is held while a finger's engagement falls.

    Args:
        problem: of the grasp, with ceilings c_max.
        finger: its index from 0, or its name.
        engagements: of the finger, shape (T,).
        fingers: names of the n contacts; default "finger 1", "finger 2", ….

    Returns:
        Shape (T,); below 1 the load itself is not held.

    Raises:
        InvalidInputError: as :func:`lowest_engagement`; an engagement out of 0…1; no load.
    """
    i = _index(problem, finger, fingers)
    if not problem.layout.ceilings:
        raise InvalidInputError("c_max: missing; the engagement is a share of it")
    if not problem.f.any():
        raise InvalidInputError("f: got zeros, expected a load whose multiples can be compared")
    values = as_array(engagements, "engagements", ("T",))
    held: list[float] = []
    for e in values:
        changed = _engaged(problem, i, float(e))
        found = payload.along(changed.replace(f=np.zeros(len(problem.f))), problem.f, rtol=1e-3)
        if found.solution.status is not Status.SOLVED:  # a grip that needs load, as with floors
            found = payload.along(changed, problem.f, rtol=1e-3)
            held.append(1 + found.lower if found.lower > -math.inf else 0.0)
        else:
            held.append(found.lower)
    return np.array(held)


def shortest_ramp(
    problem: ForceProblem,
    finger: int | str,
    rate: ArrayLike,
    fingers: Sequence[str] | None = None,
) -> Ramp | None:
    """Return the fastest way to unload a finger when no force may change faster than ``rate``.

    From the forces of the grasp as it is to any forces of the others alone. What the limits allow
    is convex, so the straight line stays inside them; and no way is shorter than the component
    that has to change most. Rate limits of the problem itself do not count.

    Args:
        problem: of the grasp.
        finger: its index from 0, or its name.
        rate: the most by which a component of c may change in a second, shape (m,) or one number
            [N/s, N·m/s].
        fingers: names of the n contacts; default "finger 1", "finger 2", ….

    Returns:
        The ramp; None where the load is not held with the finger or without it, for which
        :func:`can_leave` has the proof.

    Raises:
        InvalidInputError: as :func:`can_leave`; a rate that is not positive.
    """
    i = _index(problem, finger, fingers)
    most = as_array(rate, "rate", (problem.m,), broadcast=True)
    if (most <= 0).any():
        raise InvalidInputError(f"rate: got {most.min():g}, expected more than 0")
    if problem.layout.rate_limits:
        problem = problem.replace(c_last=None, dc_max=None)
    now = solve(problem)
    away = can_leave(problem, i)
    if now.status is not Status.SOLVED or not away.possible:
        return None
    base = _engaged(problem, i, 0.0)
    own = slice(problem.starts[i], problem.starts[i + 1])
    alone = float((np.abs(now.c[own]) / most[own]).max())
    reach = float((np.abs(away.solution.c - now.c) / most).max())
    edge = find_edge(
        lambda x: base.replace(c_last=now.c, dc_max=x * most), 0.5 * reach, 1e-3, least=0.0,
        known=(reach * (1 + 1e-9), away.solution),
    )  # fmt: skip
    end = edge.solution.c
    duration = float((np.abs(end - now.c) / most).max())
    return Ramp(duration, min(max(edge.lower, alone), duration), now.c, end)


def _engaged(problem: ForceProblem, i: int, engagement: float) -> ForceProblem:
    """Return the problem with another engagement of contact i."""
    changes: dict[str, Any] = {}
    if not problem.layout.ceilings:  # so high that they count for nothing
        size = float(equations.force_size(problem.barriers, problem.f)) or 1.0
        changes["c_max"] = 1e4 * size
    values = np.where(np.arange(problem.n) == i, engagement, problem.engagement)
    return problem.replace(engagement=values, **changes)


def _index(problem: ForceProblem, finger: int | str, fingers: Sequence[str] | None) -> int:
    """Return a finger's index.

    Raises:
        InvalidInputError: there is no such finger; the text lists those there are.
    """
    require_instance(problem, "problem", ForceProblem)
    names = default_names(problem)[0] if fingers is None else as_tuple(fingers, "fingers", str)
    if len(names) != problem.n:
        raise InvalidInputError(f"fingers: got {len(names)} names, expected {problem.n}")
    if isinstance(finger, str) and finger in names:
        return names.index(finger)
    index = index_of(finger)
    if index is None or not 0 <= index < problem.n:
        raise InvalidInputError(
            f"finger: got {came(finger)}, expected 0 to {problem.n - 1} or one of "
            f"{', '.join(names)}"
        )
    return index
