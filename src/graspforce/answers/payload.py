"""How much more a grasp can carry: along one wrench, in every direction, by the classical measures.

What the contacts can do to the object within cones, torque limits and ceilings is a convex set of
wrenches. :func:`along` encloses where a ray leaves it, :func:`ball` the largest ball around f in
it: an inner polytope of wrenches that are made, grown at its nearest facet, bounds the radius
from below, the planes beyond which no wrench can be made bound it from above. :func:`classic` gives
the measures of the literature, which know no torque limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_array, as_number, as_positive, require_instance
from graspforce.answers.edge import find_edge
from graspforce.certificate import Certificate, most_internal
from graspforce.errors import InvalidInputError, MissingExtraError
from graspforce.grasp import Grasp
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.solve import solve

__all__ = ["Ball", "Classic", "Payload", "along", "ball", "classic"]


@dataclass(frozen=True, slots=True)
class Payload:
    """How far a load can grow along a direction.

    Attributes:
        lower: f + lower·direction is held, by ``solution``; -inf where f itself is not. 0 where f
            is on the edge of what can be held and the direction leads out of it or along it.
        upper: no factor above it can be held, other than on the edge; inf where nothing bounds it,
            -inf where f itself is not held.
        solution: the forces at ``lower``; where there are none, the answer for f.
        certificate: proof for ``upper``; None where rounding allows none.
        solves: how many problems were solved.
    """

    lower: float
    upper: float
    solution: Solution
    certificate: Certificate | None
    solves: int


def along(problem: ForceProblem, direction: ArrayLike, rtol: float = 1e-4) -> Payload:
    """Enclose the largest s for which the wrench f + s·direction can be held.

    Every load between is held, too: what can be held is convex.

    Args:
        problem: of the grasp with the load f from which to start.
        direction: wrench that is added, shape (k,) [N, N·m].
        rtol: wanted width of the interval over s.

    Raises:
        InvalidInputError: an argument of a wrong kind or shape, a direction of zeros.
    """
    require_instance(problem, "problem", ForceProblem)
    d = as_array(direction, "direction", (len(problem.f),))
    share = _share(rtol)
    size = float(np.abs(d).max())
    if not size:
        raise InvalidInputError("direction: got zeros only, expected a wrench")
    here = solve(problem)
    if here.status not in (Status.SOLVED, Status.ON_EDGE):
        end = math.inf if here.status is Status.UNBOUNDED else -math.inf
        return Payload(-math.inf, end, here, here.certificate, 1)
    start = (float(np.abs(problem.f).max()) or _size(problem)) / size
    near = solve(problem.replace(f=problem.f + start * d))
    if near.status is Status.WRENCH_UNREACHABLE:
        return Payload(0.0, 0.0, here, None, 2)
    edge = find_edge(
        lambda x: problem.replace(f=problem.f - x * d), -start, share, known=(0.0, here)
    )
    return Payload(
        0.0 - edge.upper, 0.0 - edge.lower, edge.solution, edge.certificate, 1 + edge.solves
    )


def _share(rtol: float) -> float:
    share = as_number(rtol, "rtol")
    if not 0 < share < 1:
        raise InvalidInputError(f"rtol: got {share:g}, expected more than 0 and less than 1")
    return share


def _size(problem: ForceProblem) -> float:
    """Return the size of force that the limits are made for [N]."""
    return float(equations.force_size(problem.restricted().barriers, problem.f)) or 1.0


# ---- the ball -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Ball:
    """The largest ball of further wrenches that can be held around f.

    A further wrench [F; T] is as large as sqrt(‖F‖² + ‖T/length‖²) [N].

    Attributes:
        lower: every further wrench up to this size can be held [N].
        upper: some wrench hardly larger than this cannot [N].
        weakest: that wrench, of size 1, shape (k,) [N, N·m].
        length: by which torques are divided [m].
        wrenches: corners of the inner polytope, shape (B, k) [N, N·m]: wrenches that can be made.
        forces: contact forces that make them, shape (B, m); none for the classical measures.
    """

    lower: float
    upper: float
    weakest: Array
    length: float
    wrenches: Array
    forces: Array


class _Support(NamedTuple):
    """A wrench at the boundary of what is possible, and a plane beyond which nothing is."""

    point: Array  # shape (k,), scaled
    c: Array
    normal: Array  # of the plane, of length 1
    offset: float  # every possible wrench w has normal·w ≤ offset


def ball(problem: ForceProblem, length: float | None = None, rtol: float = 0.01) -> Ball:
    """Enclose the largest ball of wrenches around f that the grasp can make.

    Exact friction cones, torque limits, ceilings and all other limits of the problem.

    Args:
        problem: of a body in space (6 rows of W and f) or in the plane (3).
        length: by which torques are divided to compare them with forces [m]; default: the root
            mean square lever of the contacts, as far as W knows them.
        rtol: wanted (upper − lower)/upper.

    Returns:
        The bounds; both 0 where f itself cannot be held, or W does not reach all wrenches.

    Raises:
        InvalidInputError: an argument of a wrong kind, another number of rows.
        MissingExtraError: SciPy is not installed.
    """
    require_instance(problem, "problem", ForceProblem)
    k, m = len(problem.f), problem.m
    share, scaling, lever = _share(rtol), *_scaling(problem.W, length)
    here = solve(problem)
    W = scaling[:, None] * problem.W
    rank = np.linalg.matrix_rank(W[:, problem.active_components], tol=1e-10)
    if here.status is not Status.SOLVED or rank < k:
        return _nothing(k, m, lever)
    ordinary, forces = here.without_pulls()  # whose forces are those of the contacts and the pull
    size = _size(ordinary)
    inner = ordinary.replace(W=W, f=np.zeros(k), f_soft=1.0, alpha=_ALPHA)
    (A, b), most = inner.linear_limits(), most_internal(inner)
    count = 2 * problem.n + _ALPHA * len(b)  # nu·(wrench on the plane − wrench that is made)
    start = forces[:m]

    def support(u: Array, gap: float, above: Array) -> _Support:
        # Drawn to a point far out, c stops at the boundary of what is possible; the pull nu, a
        # certificate's multipliers, tells the plane, and the gap between both is count/‖nu‖. The
        # plane is across u as far as the point is straight above where c stops.
        target = above + (_FAR * size - u @ above) * u
        soft = math.sqrt(_FAR * size * min(gap, 0.01 * size) / count)
        found = solve(inner.replace(f=target, f_soft=soft), start=start)
        if found.status is not Status.SOLVED:
            return _Support(W @ start, start, u, math.inf)
        nu, z = found.nu, _ALPHA / (b - A @ np.append(found.c, found.internal_forces))
        length, e = float(np.linalg.norm(nu)), A.T @ z
        margins = equations.dual_margins(e[:m] - W.T @ nu, inner.cones)
        left = np.abs(e[m:])  # no cone bounds what motors do against each other; their limits do
        offset = float(z @ b + left[left > 0] @ most[left > 0]) / length
        if (margins[inner.active] < 0).any() or offset == math.inf:  # rounding: no proof
            return _Support(W @ found.c, found.c, u, math.inf)
        return _Support(W @ found.c, found.c, nu / length, offset)

    grown = _enclosed(support, scaling * ordinary.f, share, scaling, lever)
    pulled = problem.preload[:m]
    return replace(
        grown, wrenches=grown.wrenches - problem.W @ pulled, forces=grown.forces - pulled
    )


# Weight of the limits in a search for supports, and how far out a support's target lies, in sizes
# of force.
_ALPHA, _FAR = 0.1, 30.0
# A support's gap over the wanted width of the bounds; facets that are grown at once.
_GAP, _AT_ONCE = 0.2, 12
_ROUNDS, _IDLE = 200, 5  # at most, and at most without progress


def _scaling(W: Array, length: float | None) -> tuple[Array, float]:
    """Return the scales of a wrench's entries, shape (k,), and the length in them."""
    k = len(W)
    if k not in (3, 6):
        raise InvalidInputError(
            f"W: got {k} rows, expected the 6 of a body in space or 3 in a plane"
        )
    forces = 3 if k == 6 else 2
    if length is None:
        pushes = np.linalg.norm(W[:forces], axis=0) > 1e-9  # not a torsion
        lever = float(np.linalg.norm(W[forces:, pushes]) / np.linalg.norm(W[:forces, pushes]))
        lever = lever or 1.0
    else:
        lever = as_positive(length, "length", "m")
    return np.where(np.arange(k) < forces, 1.0, 1 / lever), lever


def _nothing(k: int, m: int, lever: float) -> Ball:
    none = np.zeros((0, k))
    return Ball(0.0, 0.0, np.zeros(k), lever, none, np.zeros((0, m)))


def _enclosed(
    support: Callable[[Array, float, Array], _Support],
    centre: Array,
    rtol: float,
    scaling: Array,
    lever: float,
) -> Ball:
    """Grow an inner polytope at its nearest facets until both bounds agree."""
    ConvexHull, QhullError = _qhull()
    k = len(centre)
    # Along the axes alone the points of a symmetric grasp may be flat.
    skew = np.random.default_rng(0).normal(size=(2 * k, k))
    axes = [*np.eye(k), *-np.eye(k), *(skew / np.linalg.norm(skew, axis=1, keepdims=True))]
    found = [support(u, math.inf, centre) for u in axes]
    upper, weakest, lower, idle = math.inf, np.zeros(k), 0.0, 0

    def lowest(some: list[_Support]) -> None:
        nonlocal upper, weakest
        for each in some:
            reach = each.offset - float(each.normal @ centre)
            if reach < upper:
                upper, weakest = reach, each.normal

    lowest(found)
    found = [
        support(u, _GAP * rtol * upper, each.point) for u, each in zip(axes, found, strict=True)
    ]
    lowest(found)
    try:
        hull: Any = ConvexHull(np.array([each.point for each in found]), incremental=True)
        for _ in range(_ROUNDS):
            planes = np.asarray(hull.equations)
            reach = -(planes[:, :k] @ centre + planes[:, k])
            before, lower = (lower, upper), max(float(reach.min()), 0.0)
            if lower >= (1 - rtol) * upper or idle == _IDLE:
                break
            near = np.argsort(reach)[: 8 * _AT_ONCE]
            near = near[reach[near] < (1 - rtol) * upper]
            new: list[_Support] = []
            tried: list[Array] = []
            for i in near:  # not two that look the same way
                u = planes[i, :k]
                if len(new) < _AT_ONCE and all(u @ v < 0.98 for v in tried):
                    tried.append(u)
                    facet = np.asarray(hull.points)[hull.simplices[i]]
                    new.append(support(u, _GAP * rtol * upper, facet.mean(axis=0)))
            lowest(new)
            idle = idle + 1 if before == (lower, upper) else 0
            found += new
            hull.add_points(np.array([each.point for each in new]))
        hull.close()
    except QhullError:  # the points are flat to rounding
        lower = 0.0
    return Ball(
        lower, max(upper, lower), weakest / scaling, lever,
        np.array([each.point / scaling for each in found]), np.array([each.c for each in found]),
    )  # fmt: skip


def _qhull() -> tuple[Any, Any]:
    try:
        from scipy.spatial import ConvexHull, QhullError  # pyright: ignore[reportMissingTypeStubs]
    except ImportError:
        raise MissingExtraError("a ball of wrenches", "scipy", "baselines") from None
    return ConvexHull, QhullError


# ---- the classical measures ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Classic:
    """Measures of the literature, with exact cones and torques divided by ``length``.

    Attributes:
        epsilon_l1: Ferrari and Canny's: bounds of the largest ball of wrenches around 0 by
            contacts whose normal forces add up to at most 1.
        epsilon_linf: likewise by contacts whose normal forces are each at most 1.
        volume: of the wrenches of epsilon_l1, with 24-sided cones, which keeps 97 % or more of it.
        smallest_singular_value: of the scaled W.
        length: [m].
    """

    epsilon_l1: tuple[float, float]
    epsilon_linf: tuple[float, float]
    volume: float
    smallest_singular_value: float
    length: float


_SIDES = 24


def classic(grasp: Grasp, length: float | None = None, rtol: float = 0.01) -> Classic:
    """Return the classical measures of a grasp; they know its contacts and nothing of the hand.

    Args:
        grasp: the grasp; torques are about its ``origin``.
        length: by which torques are divided [m]; default: the contacts' root mean square lever.
        rtol: wanted width of the bounds.

    Raises:
        InvalidInputError: no grasp, or a number out of range.
        MissingExtraError: SciPy is not installed.
    """
    require_instance(grasp, "grasp", Grasp)
    share, scaling, lever = _share(rtol), *_scaling(grasp.W, length)
    W = scaling[:, None] * grasp.W
    cones = equations.Cones.of_models(grasp.models)
    smallest = float(np.linalg.svd(W, compute_uv=False)[-1]) if W.shape[1] >= 6 else 0.0
    if np.linalg.matrix_rank(W, tol=1e-10) < 6:
        return Classic((0.0, 0.0), (0.0, 0.0), 0.0, smallest, lever)

    def radius(together: bool) -> tuple[float, float]:
        def support(u: Array, *_: object) -> _Support:
            c, gains = _best_pushes(W.T @ u, cones)
            kept = gains > 0
            if together:
                kept &= np.arange(len(gains)) == gains.argmax()
            c = equations.stacked(c * kept[:, None], cones.dims)
            return _Support(W @ c, c, u, float(u @ W @ c))

        found = _enclosed(support, np.zeros(6), share, scaling, lever)
        return found.lower, found.upper

    ConvexHull, QhullError = _qhull()
    try:
        volume = float(ConvexHull(_corners(W, cones)).volume)
    except QhullError:
        volume = 0.0
    return Classic(radius(True), radius(False), volume, smallest, lever)


def _best_pushes(gradient: Array, cones: equations.Cones) -> tuple[Array, Array]:
    """Return each contact's force of normal force 1 that goes farthest, (n, 4), and how far."""
    y = equations.by_contact(gradient, cones.dims) / cones.scaling
    tangential = y[:, 1:]
    size = np.linalg.norm(tangential, axis=1, keepdims=True)
    mu = cones.scaling[:, :1]
    s = np.hstack((mu, mu * tangential / np.where(size > 0, size, 1.0)))
    return s / cones.scaling, (y * s).sum(axis=1)


def _corners(W: Array, cones: equations.Cones) -> Array:
    """Return 0 and the wrenches of normal force 1 on the edges of pyramids in the cones."""
    around = 2 * np.pi * np.arange(_SIDES) / _SIDES
    corners = [np.zeros(len(W))]
    starts = np.cumsum((0, *cones.dims))
    for i, dim in enumerate(cones.dims):
        mu = cones.scaling[i, 0]
        edges = np.zeros((1, 3))
        if dim == 3:
            edges = np.column_stack((np.cos(around), np.sin(around), 0 * around))
        elif dim == 4:  # rings of latitude of a sphere, and its poles
            rings = [(math.cos(t), math.sin(t)) for t in np.pi * (np.arange(1, 6) / 6 - 0.5)]
            edges = np.concatenate([
                np.column_stack((r * np.cos(around), r * np.sin(around), h + 0 * around))
                for r, h in rings
            ] + [np.array([[0, 0, 1.0], [0, 0, -1.0]])])  # fmt: skip
        s = np.column_stack((np.full(len(edges), mu), mu * edges))
        c = (s / cones.scaling[i])[:, :dim]
        corners += list(c @ W[:, starts[i] : starts[i + 1]].T)
    return np.array(corners)
