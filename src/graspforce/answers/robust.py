"""Forces that hold although friction, contacts and load are not known exactly.

:func:`tighten` turns a problem and what is uncertain in it into a problem for ``solve`` and a
``Servo``. Friction and normals only make the cones narrower. A wrench that may be any of an
ellipsoid, and points that may be elsewhere, need forces that respond: for a wrench f + w the grasp
makes c + G w with the fixed response G of :func:`response`, and the tightened limits leave it room.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspforce import equations
from graspforce._util.arrays import Array, as_array, require_instance
from graspforce.contact import model_of
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem

__all__ = ["response", "tighten"]

# Where forces have to respond, the cones are narrowed by this part of the friction, and what that
# leaves free, in proportion to the normal force, has to be enough for the response.
_FOR_RESPONSE = 0.3


def response(problem: ForceProblem) -> Array:
    """Return G, shape (m, k): the least further forces G w that make a further wrench w, W G w = w.

    Least in the sum of squares of all components, a torsion over gamma/mu; contacts that are out of
    the grasp do not respond.

    Raises:
        InvalidInputError: no problem.
    """
    require_instance(problem, "problem", ForceProblem)
    dims = problem.layout.dims
    unit = equations.stacked(1 / problem.cones.scaling, dims)
    unit = np.where(np.isin(np.arange(problem.m), problem.starts[:-1]), 1.0, unit)
    unit = unit * problem.active_components
    return np.asarray(unit[:, None] * np.linalg.pinv(problem.W * unit), dtype=np.float64)


def tighten(
    problem: ForceProblem,
    friction: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    point: ArrayLike | None = None,
    wrench: ArrayLike | None = None,
) -> ForceProblem:
    """Return a problem whose answers hold for all of the given sets at once.

    How much each costs, and what it promises:

    * ``friction`` is exact: the answer holds if and only if it does with the lowest friction.
    * ``normal`` is exact for point contacts with friction, whose cones narrow to the friction angle
      less this angle; for soft fingers it is conservative, exact for forces at the cone's edge:
      gamma falls by the square root of mu's factor. The forces are taken to stay in space.
    * ``wrench`` is exact in every linear limit for the response G. In the cones it is
      conservative: they are narrowed by 30 % of the friction, and that part has to be enough for
      the largest step of the response towards the edge, which is bounded within a factor of 1.42.
    * ``point`` is conservative like ``wrench``: the torques that all the forces' displacements make
      are added up as if they were parallel, and the response makes up for them. A joint is taken
      to feel the displacements of all the contacts that it moves.

    Ceilings and floors hold for normal forces along the assumed normals; rate limits for the
    answer, not for the response.

    Args:
        problem: with the assumed friction, contacts and wrench.
        friction: the share by which the coefficients may be lower, 0 to below 1, shape (n,) or one.
        normal: how far each normal may be off [rad], shape (n,) or one.
        point: how far each contact may be off in any direction [m], shape (n,) or one.
        wrench: positive definite matrix E, shape (k, k): the wrench may be any f + w with
            w·E⁻¹w ≤ 1 [N², …].

    Raises:
        InvalidInputError: an argument of the wrong shape or range; a normal's angle as large as the
            friction angle; a wrench that the contacts cannot make; contacts that pull with anything
            but friction, internal forces of motors with point or wrench.
    """
    require_instance(problem, "problem", ForceProblem)
    n, k, dims = problem.n, len(problem.f), problem.layout.dims
    lower = _each(friction, "friction", n)
    if (lower >= 1).any():
        raise InvalidInputError(f"friction: got {lower.max():g}, expected less than 1")
    rubs = np.array(dims) > 1
    factor = np.where(rubs, 1 - lower, 1.0)
    mu, gamma = factor * problem.mu, factor * problem.gamma
    angle = _each(normal, "normal", n)
    for i in np.flatnonzero(angle > 0):
        most = np.arctan(mu[i]) if rubs[i] else 0.0
        if angle[i] >= most:
            raise InvalidInputError(
                f"normal[{i}]: got {angle[i]:g} rad, expected less than {most:.4g} rad, the angle "
                "of the lowest friction"
            )
    narrowed = np.where(angle > 0, np.tan(np.arctan(mu) - angle), mu)
    gamma = gamma * np.sqrt(narrowed / mu)
    radius = _each(point, "point", n)
    axes = _axes(wrench, problem)
    if problem.layout.pulls and (axes is not None or radius.any() or angle.any()):
        raise InvalidInputError(
            "problem: got contacts that pull, expected none with normal, point or wrench: only "
            "friction is known to be bounded with them"
        )
    if problem.layout.internals and (axes is not None or radius.any()):
        raise InvalidInputError(
            "problem: got internal forces of motors, expected none with point or wrench"
        )
    changes: dict[str, Any] = {}
    if axes is not None or radius.any():
        rows, bounds = _room(
            problem, narrowed, gamma, radius, np.zeros((k, 0)) if axes is None else axes
        )
        changes["A"] = np.vstack((problem.A, rows))
        changes["b"] = np.append(problem.b, bounds)
        narrowed = np.where(rubs, (1 - _FOR_RESPONSE) * narrowed, narrowed)
        gamma = np.where(rubs, (1 - _FOR_RESPONSE) * gamma, gamma)
    numbers = narrowed.tolist(), gamma.tolist(), [model.pull for model in problem.models]
    models = [model_of(*each) for each in zip(dims, *numbers, strict=True)]
    return problem.replace(models=models, **changes)


def _each(value: ArrayLike | None, name: str, n: int) -> Array:
    """Return a size a contact, not negative."""
    sizes = np.zeros(n) if value is None else as_array(value, name, (n,), broadcast=True)
    if (sizes < 0).any():
        raise InvalidInputError(f"{name}: got {sizes.min():g}, expected 0 or more")
    return sizes


def _axes(wrench: ArrayLike | None, problem: ForceProblem) -> Array | None:
    """Return L with w = L u, ‖u‖ ≤ 1, for the ellipsoid; None where there is none."""
    if wrench is None:
        return None
    k = len(problem.f)
    E = as_array(wrench, "wrench", (k, k))
    if np.abs(E - E.T).max() > 1e-9 * np.abs(E).max():
        raise InvalidInputError("wrench: got a matrix that is not symmetric, expected E = E.T")
    values, vectors = np.linalg.eigh((E + E.T) / 2)
    if values[0] <= 0:
        raise InvalidInputError(
            f"wrench: got a matrix with the eigenvalue {values[0]:.4g}, expected a positive "
            "definite one"
        )
    L = vectors * np.sqrt(values)
    lost = L - problem.W @ (response(problem) @ L)
    if np.abs(lost).max() > 1e-9 * np.abs(L).max():
        raise InvalidInputError("wrench: got wrenches that these contacts cannot make")
    return L


def _room(
    problem: ForceProblem, mu: Array, gamma: Array, radius: Array, L: Array
) -> tuple[Array, Array]:
    """Return the rows A c ≤ b that leave the response room within limits and cones.

    A response is G L u for the ellipsoid, ‖u‖ ≤ 1, and G of a torque of size R for displaced
    points. With the response itself displaced, too, R ≤ (Σ radius_i ‖F_i‖ + Σ radius_i ‖G_i L‖) /
    (1 − Σ radius_i ‖G_i T‖), where ‖F_i‖ ≤ n_i sqrt(1 + mu²): so R ≤ fixed + slope·c.
    """
    n, m, k, dims = problem.n, problem.m, len(problem.f), problem.layout.dims
    starts, active = np.array(problem.starts[:-1]), problem.active
    G = response(problem)
    turns = G[:, 3:6] if k >= 6 else G[:, 2:3]
    shaken = G @ L
    forces = [slice(s, s + min(d, 3)) for s, d in zip(problem.starts[:-1], dims, strict=True)]
    by_load, by_turn = (
        np.array([np.linalg.norm(part[each], 2) if part.size else 0.0 for each in forces])
        for part in (shaken, turns)
    )
    loss = 1 - float(radius @ by_turn)
    if loss <= 0:
        raise InvalidInputError(
            f"point: got {radius.max():g} m, so far off that no response makes up for it"
        )
    reach = np.sqrt(1 + np.where(np.array(dims) > 1, mu, 0.0) ** 2) * active
    fixed = float(radius @ by_load) / loss
    slope = np.zeros(m)
    slope[starts] = radius * reach / loss

    # Linear limits, but those of the rates.
    steady = problem.replace(c_last=None, dc_max=None) if problem.layout.rate_limits else problem
    A, b = steady.linear_limits()
    turn_size = np.linalg.norm(A @ turns, axis=1)
    rows = A + turn_size[:, None] * slope
    bounds = b - np.linalg.norm(A @ shaken, axis=1) - turn_size * fixed
    # What displaced forces do to the joints that move their contacts.
    counted = int(problem.counted_limits()[: problem.layout.joints].sum())
    for r in range(2 * counted):
        moved = np.array([(A[r, each] != 0).any() for each in forces])
        rows[r, starts] += radius * moved * reach
        size = by_load + by_turn * fixed
        bounds[r] -= float((radius * moved) @ size)
        rows[r] += float((radius * moved) @ by_turn) * slope

    # Cones: (mu − mu') n ≥ the largest step of the response towards the edge.
    scaling = equations.Cones.of(dims, mu, gamma).scaling
    along = np.zeros((n, m))
    least = np.zeros(n)
    for i in np.flatnonzero(active):
        own, s = slice(starts[i], starts[i] + dims[i]), scaling[i, : dims[i]]
        steps = [_largest(s[:, None] * part[own]) for part in (shaken, turns)]
        along[i] = steps[1] * slope
        along[i, starts[i]] -= (_FOR_RESPONSE if dims[i] > 1 else 1.0) * s[0]
        least[i] = -steps[0] - steps[1] * fixed
    return np.vstack((rows, along[active])), np.concatenate((bounds, least[active]))


def _largest(M: Array) -> float:
    """Return a bound on ‖(M u)_1…‖ − (M u)_0 over ‖u‖ ≤ 1, within a factor of √2."""
    if not M.size:
        return 0.0
    apart = float(np.linalg.norm(M[0]))
    if len(M) > 1:
        apart += float(np.linalg.norm(M[1:], 2))
    return min(apart, float(2**0.5 * np.linalg.norm(M, 2)))
