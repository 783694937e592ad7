"""What the wrench and the torques guarantee of the contacts, whatever the physics chooses.

Palms, patches and power grasps have force components that neither W c = f nor the torques
determine (``problem.undetermined``). Of the margins to slipping of the forces asked for,
:attr:`Solution.friction_margins`, only a part is then sure to come about: the least over all forces
inside the friction cones that make the same wrench by the same torques.
"""

from __future__ import annotations

import numpy as np

from graspforce._util.arrays import Array, require_instance
from graspforce.baselines._conic import Pattern, Program, Shape, load
from graspforce.equations import UNDETERMINED
from graspforce.errors import InvalidInputError
from graspforce.solution import Solution

_TOLERANCE = 1e-9
_MAX_STEPS = 200
_IN_PLANE, _IN_SPACE = 16, 64  # directions of slipping that are looked at


def friction_margins(solution: Solution) -> Array:
    """Return lower bounds on the friction margins that wrench and torques guarantee.

    Of a contact the margin mu n − ‖t‖ is the least for forces within all cones; ‖t‖ is taken as the
    largest of its components in 16 directions (PCWF) or 64 (SFC) over the cosine of the farthest
    direction from one of these, at most 2 % and 7 % more, so the bound is on the safe side. 0 means
    that the contact may be about to slip, or carry nothing, for all that the motors can tell.

    Args:
        solution: forces inside the cones, as of a SOLVED one.

    Returns:
        shape (n,) [N], at most :attr:`Solution.friction_margins`; inf for contacts that have left.

    Raises:
        InvalidInputError: no solution, or one whose forces are outside the cones.
        MissingExtraError: Clarabel, or SciPy, is not installed.
    """
    require_instance(solution, "solution", Solution)
    problem = solution.problem
    there, kept = problem.active, problem.active_components
    asked = np.array(solution.friction_margins)
    if not (asked[there] > 0).all():
        raise InvalidInputError("solution: got forces outside the cones, expected a SOLVED one")
    workspace_type = load("clarabel")
    _, forces = solution.without_pulls()
    c = forces[: problem.m][kept]
    rows = _independent(np.vstack((problem.W[:, kept], problem.J[kept].T)))
    inner = problem.restricted()
    dims, unit = inner.layout.dims, float(np.abs(c).max(initial=0.0)) or 1.0
    scales = np.concatenate([s[:dim] for s, dim in zip(inner.cones.scaling, dims, strict=True)])
    # A cone of one component is a second-order cone, too.
    A = np.vstack((rows, -np.diag(scales)))
    b = np.concatenate((rows @ c / unit, np.zeros(len(c))))
    shape = Shape(len(c), len(rows), 0, tuple(dims), 0)
    nothing = np.zeros(len(c))
    first = Program(shape, nothing, nothing, A, b)
    workspace = workspace_type(first, Pattern(A != 0), _TOLERANCE, _MAX_STEPS)
    least = np.full(len(dims), np.inf)
    for i, start in enumerate(inner.starts[:-1]):
        own = slice(start, start + dims[i])
        for direction in _directions(dims[i] - 1):
            q = np.zeros(len(c))
            q[own] = scales[own] * np.concatenate(([1.0], -direction))
            workspace.update(Program(shape, nothing, q, A, b))
            found = workspace.solve()
            # Below the minimum whatever is left of the gap; without a minimum, the cone's own 0.
            value = min(float(q @ found.x), float(-b @ found.z)) - 10 * _TOLERANCE
            least[i] = min(least[i], value if found.status.name == "SOLVED" else 0.0)
    bounds = np.full(problem.n, np.inf)
    bounds[there] = np.clip(unit * least, 0.0, asked[there])
    return bounds


def _independent(rows: Array) -> Array:
    """Return an orthonormal basis of the rows."""
    _, sizes, right = np.linalg.svd(rows, full_matrices=False)
    return right[sizes > UNDETERMINED * sizes.max(initial=0.0)]


def _directions(axes: int) -> Array:
    """Return vectors u with max u·t ≥ ‖t‖ for every t of so many axes."""
    if axes == 0:
        return np.zeros((1, 0))
    if axes == 2:
        angle = 2 * np.pi * np.arange(_IN_PLANE) / _IN_PLANE
        return np.column_stack((np.cos(angle), np.sin(angle))) / np.cos(np.pi / _IN_PLANE)
    from scipy.spatial import ConvexHull  # pyright: ignore[reportMissingTypeStubs]

    z = 1 - (2 * np.arange(_IN_SPACE) + 1) / _IN_SPACE  # evenly, along a spiral
    angle = np.pi * (3 - 5**0.5) * np.arange(_IN_SPACE)
    radius = np.sqrt(1 - z**2)
    points = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), z))
    return points / float(-ConvexHull(points).equations[:, -1].max())
