"""What would make an infeasible grasp feasible: the least change of each kind.

Each remedy is the edge of a family of problems (:mod:`graspforce.answers.edge`), solved, and within
a part in a hundred of the least that helps. For a grasp with an answer the same families say what
it could spare.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.answers.edge import Edge, Family, find_edge
from graspforce.answers.wishes import with_friction
from graspforce.contact import SFC, cross
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.solve import solve

_RTOL = 5e-3
# Beyond these nobody would call it a remedy; below the least nothing is left of what is spared.
_MOST_FACTOR, _LEAST_FACTOR = 20.0, 1e-3
_AXES = 16  # about which a turn is tried, before the best is refined


@dataclass(frozen=True, slots=True)
class Remedy:
    """The least change of one kind that helps; or, where there is an answer, the most to spare.

    Attributes:
        kind: "friction", "torque", "ceiling", "rate", "load", "support", "finger" or "turn".
        value: the change: a factor on all friction coefficients, torque limits, ceilings or rate
            limits, or on the load; the force of a further contact [N]; the engagement of a finger;
            an angle.
        unit: of the value: "times", "N", "" or "rad".
        bound: no value beyond it is needed or possible: less does not help (more than it, of a
            load). Within 1 % of the value.
        text: it in words.
        problem: the changed problem.
        solution: its solution, SOLVED.
    """

    kind: str
    value: float
    unit: str
    bound: float
    text: str
    problem: ForceProblem
    solution: Solution


def remedies(given: Solution, fingers: tuple[str, ...]) -> tuple[Remedy, ...]:
    """Return the remedies of every kind that helps.

    Args:
        given: the solution of the problem; SOLVED for what there is to spare.
        fingers: names of the contacts.
    """
    finders: tuple[Callable[[Solution], Iterator[Remedy]], ...] = (
        _friction, _torque, _ceiling, _rate, _load, _support, lambda given: _finger(given, fingers),
        _turn,
    )  # fmt: skip
    return tuple(remedy for find in finders for remedy in find(given))


def _factor(given: Solution, family: Family, affine: bool = True) -> Edge | None:
    """Return the edge of a family that scales limits, 1 being as they are."""
    if given.status is Status.SOLVED:
        edge = find_edge(family, 0.5, _RTOL, affine=affine, least=_LEAST_FACTOR, known=(1.0, given))
    else:
        edge = find_edge(family, 1.5, _RTOL, affine=affine, least=1.0, most=_MOST_FACTOR)
    return edge if edge.found else None


def _friction(given: Solution) -> Iterator[Remedy]:
    problem = given.problem
    dims = np.array(problem.layout.dims)
    rubs = problem.active & (dims > 1)
    if not rubs.any():
        return

    def family(x: float) -> ForceProblem:
        return problem.replace(models=with_friction(problem, x))

    if (edge := _factor(given, family, affine=False)) is not None:
        text = _change(given, edge.upper, "friction", problem.mu[rubs], "mu", "")
        yield _made("friction", edge, "times", text)


def _torque(given: Solution) -> Iterator[Remedy]:
    problem = given.problem
    if not problem.layout.joints:
        return
    lo, hi = problem.tau_lo, problem.tau_hi

    def family(x: float) -> ForceProblem:
        # A limit on the far side of zero is no strength: it stays.
        return problem.replace(
            tau_lo=np.where(lo < 0, x * lo, lo), tau_hi=np.where(hi > 0, x * hi, hi)
        )

    if given.status is Status.SOLVED and ((lo > 0) | (hi < 0)).any():
        return  # limits that cross before they are used up
    if (edge := _factor(given, family)) is not None:
        sizes = np.concatenate((hi[hi > 0], -lo[lo < 0]))
        text = _change(given, edge.upper, "torque limits", sizes, "", "N·m")
        yield _made("torque", edge, "times", text)


def _ceiling(given: Solution) -> Iterator[Remedy]:
    problem = given.problem
    if not problem.layout.ceilings:
        return
    floors = problem.c_min if problem.layout.floors else np.zeros(problem.n)
    c_max = problem.c_max
    if given.status is Status.SOLVED and (floors > 0).any():
        return  # floors and ceilings would cross

    def family(x: float) -> ForceProblem:
        return problem.replace(c_max=x * c_max)

    if (edge := _factor(given, family)) is not None:
        text = _change(given, edge.upper, "ceilings", c_max[problem.active], "", "N")
        yield _made("ceiling", edge, "times", text)


def _rate(given: Solution) -> Iterator[Remedy]:
    problem = given.problem
    if given.status is Status.SOLVED or not problem.layout.rate_limits:
        return
    dc_max = problem.dc_max
    if (edge := _factor(given, lambda x: problem.replace(dc_max=x * dc_max))) is not None:
        yield _made(
            "rate", edge, "times", _change(given, edge.upper, "rate limits", dc_max, "", "N")
        )


def _change(given: Solution, x: float, what: str, values: Array, symbol: str, unit: str) -> str:
    """Write a factor, with the number itself where all the values are the same one."""
    size = float(values[0]) if values.size else 0.0
    same = values.size and np.allclose(values, size, rtol=1e-9)
    unit = f" {unit}" if unit else ""
    now = f" ({symbol}{' = ' if symbol else ''}{x * size:.3g}{unit} in place of {size:.3g}{unit})"
    if given.status is Status.SOLVED:
        return f"{what} down to {100 * x:.3g} %{now if same else ''}"
    return f"{what} {x:.3g} times as high{now if same else ''}"


def _made(kind: str, edge: Edge, unit: str, text: str) -> Remedy:
    solution = edge.solution
    return Remedy(kind, edge.upper, unit, edge.lower, text, solution.problem, solution)


def _load(given: Solution) -> Iterator[Remedy]:
    problem = given.problem
    if not problem.f[:6].any():
        return
    share = np.where(np.arange(len(problem.f)) < 6, problem.f, 0.0)
    rest = problem.f - share

    def family(x: float) -> ForceProblem:
        return problem.replace(f=rest - x * share)

    if given.status is Status.SOLVED:
        edge = find_edge(family, -2.0, _RTOL, least=-1e6, known=(-1.0, given))
    else:
        edge = find_edge(family, -0.5, _RTOL, least=-1.0, most=0.0)
    if edge.found and edge.upper < -_LEAST_FACTOR:
        size = -edge.upper
        text = f"{size:.3g} times this load" if size > 1 else f"{100 * size:.3g} % of this load"
        solution = edge.solution
        yield Remedy("load", size, "times", -edge.lower, text, solution.problem, solution)


def _support(given: Solution) -> Iterator[Remedy]:
    """A further contact whose force goes through the point about which torques are taken."""
    problem = given.problem
    if given.status is Status.SOLVED or len(problem.f) < 6:
        return
    # The cone n > ‖(x, y, torsion)‖ of a soft finger with mu = gamma = 1 is a ball of any force up
    # to n, whose three last components push along the axes; n itself does nothing but be limited.
    k, m = problem.W.shape
    push = np.zeros((k, 4))
    push[:3, 1:] = np.eye(3)
    row = np.zeros((1, m + 4))
    row[0, m] = 1.0
    size = float(np.abs(problem.f).max()) or 1.0
    changes: dict[str, Any] = {
        "W": np.hstack((problem.W, push)),
        "models": (*problem.models, SFC(1.0, 1.0)),
        "A": np.vstack((np.pad(problem.A, ((0, 0), (0, 4))), row)),
    }
    layout = problem.layout
    if layout.joints:
        changes["J"] = np.pad(problem.J, ((0, 4), (0, 0)))
    if layout.ceilings:
        changes["c_max"] = np.append(problem.c_max, 1e6 * size)
        changes["engagement"] = np.append(problem.engagement, 1.0)
    if layout.floors:
        changes["c_min"] = np.append(problem.c_min, 0.0)
    if layout.cone_weights:
        changes["cone_weight"] = np.append(problem.cone_weight, 1.0)
    if layout.rate_limits:
        changes["c_last"] = np.append(problem.c_last, np.zeros(4))
        changes["dc_max"] = np.append(problem.dc_max, np.full(4, 1e6 * size))
    changes["b"] = np.append(problem.b, size)
    base = problem.replace(**changes)

    def family(x: float) -> ForceProblem:
        return base.replace(b=np.append(problem.b, x))

    edge = find_edge(family, size, _RTOL, least=0.0, most=100 * size)
    if edge.found:
        force = edge.solution.c[-3:]
        along = ", ".join(f"{part:g}" for part in np.round(force / np.linalg.norm(force), 3) + 0.0)
        text = (
            f"a further contact that pushes with {edge.upper:.3g} N along ({along}) through the "
            "origin of the torques"
        )
        yield _made("support", edge, "N", text)


def _finger(given: Solution, fingers: tuple[str, ...]) -> Iterator[Remedy]:
    """The finger that has to come back least."""
    problem = given.problem
    if given.status is Status.SOLVED or not problem.layout.ceilings:
        return
    best: tuple[float, Remedy] | None = None
    for i in np.flatnonzero(problem.engagement < 1):
        now = float(problem.engagement[i])

        def family(x: float, i: int = int(i)) -> ForceProblem:
            return problem.replace(
                engagement=np.where(np.arange(problem.n) == i, x, problem.engagement)
            )

        whole = solve(family(1.0))
        if whole.status is not Status.SOLVED:
            continue
        edge = find_edge(
            family, now + 0.5 * (1 - now), _RTOL, affine=False, least=now, known=(1.0, whole)
        )
        text = f"{fingers[i]} back at an engagement of {edge.upper:.3g} in place of {now:.3g}"
        if best is None or edge.upper - now < best[0]:
            best = edge.upper - now, _made("finger", edge, "", text)
    if best is not None:
        yield best[1]


def _turn(given: Solution) -> Iterator[Remedy]:
    """The smallest turn of the load, as when hand and object turn together under gravity."""
    problem = given.problem
    force = problem.f[:3]
    size = float(np.linalg.norm(force))
    if given.status is Status.SOLVED or len(problem.f) != 6 or not size:
        return
    down = force / size
    side = cross(down, np.eye(3)[int(np.abs(down).argmin())])
    side /= np.linalg.norm(side)
    other = cross(down, side)

    def turned(azimuth: float, angle: float) -> ForceProblem:
        axis = math.cos(azimuth) * side + math.sin(azimuth) * other
        rotated = [_rotated(part, axis, angle) for part in (force, problem.f[3:])]
        return problem.replace(f=np.concatenate(rotated))

    def holds(azimuth: float, angle: float) -> bool:
        return solve(turned(azimuth, angle)).status is Status.SOLVED

    # The smallest angle on a grid, axis by axis, then finer grids around the best.
    steps = np.radians(np.arange(6, 181, 6.0))
    best_angle, best_azimuth = math.inf, 0.0

    def try_axis(azimuth: float) -> None:
        nonlocal best_angle, best_azimuth
        if math.isinf(best_angle):
            angle = next((float(a) for a in steps if holds(azimuth, float(a))), math.inf)
        else:
            angle = best_angle if holds(azimuth, best_angle) else math.inf
        if math.isinf(angle):
            return
        low, high = 0.0, angle
        while high - low > _RTOL / 2 * high:
            middle = (low + high) / 2
            low, high = (low, middle) if holds(azimuth, middle) else (middle, high)
        if high < best_angle:
            best_angle, best_azimuth = high, azimuth

    for azimuth in 2 * math.pi * np.arange(_AXES) / _AXES:
        try_axis(float(azimuth))
    width = math.pi / _AXES
    while math.isfinite(best_angle) and width > 0.01:
        centre = best_azimuth
        for azimuth in (centre - width, centre + width):
            try_axis(azimuth)
        width /= 1.6
    if math.isfinite(best_angle):
        changed = turned(best_azimuth, best_angle)
        text = f"the load turned by {math.degrees(best_angle):.3g}°, as hand and object together"
        yield Remedy(
            "turn", best_angle, "rad", (1 - _RTOL) * best_angle, text, changed, solve(changed)
        )


def _rotated(vector: Array, axis: Array, angle: float) -> Array:
    """Return a vector turned about a unit axis (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    return c * vector + s * cross(axis, vector) + (1 - c) * (axis @ vector) * axis
