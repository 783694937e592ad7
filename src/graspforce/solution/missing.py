"""What contact forces lack of a wrench, in words."""

from __future__ import annotations

import numpy as np

from graspforce._util.arrays import Array
from graspforce.problem import ForceProblem, row_kinds

# A component below this share of the largest, by the scales of the rows, is not named.
_LEAST = 1e-3
# Nor is what is below this share of the wrenches that add up to f.
_ROUNDING = 1e-9


def in_words(problem: ForceProblem, c: Array, nearest: bool) -> str:
    """Name the missing components with their units, the scale of torques, and what would help.

    Args:
        problem: what was solved.
        c: forces that do not make its wrench, or violate a limit, shape (m,) [N, N·m].
        nearest: whether no forces within the limits lack less of the wrench.

    Returns:
        The end of a sentence.
    """
    missing, scales = problem.f - problem.W @ c, problem.wrench_scales()
    sizes = np.abs(missing) / scales * problem.exact
    parts_of_f = (np.abs(problem.f) + np.abs(problem.W) @ np.abs(c)) / scales
    if sizes.max() <= _ROUNDING * parts_of_f.max():
        return "; c makes the wrench and violates them least"
    _, torques = row_kinds(len(missing))
    counts = f" (a torque counts by {scales[torques][0]:.3g} m)" if scales[torques].size else ""
    what = f"the nearest wrench{counts}, which" if nearest else "a wrench that"
    twisted = (sizes[torques] > _LEAST * sizes.max()).any()
    soft = 4 in problem.layout.dims
    helps = ["soft fingers"] if twisted and not soft else []
    helps.append("another contact")
    if not problem.layout.soft_wrench:
        helps.append("a soft wrench (f_soft)")
    return (
        f"; c makes {what} lacks {components(problem, missing)}; {_listed(helps, 'or')} would help"
    )


def components(problem: ForceProblem, missing: Array) -> str:
    """Return the components of a missing wrench that count, with their units.

    Args:
        problem: whose wrench it is missing of.
        missing: f − W c, shape (k,) [N, N·m].
    """
    sizes = np.abs(missing) / problem.wrench_scales() * problem.exact
    return _listed(
        [
            f"{missing[row]:.3g} {_words(len(missing), row)}"
            for row in range(len(missing))
            if sizes[row] > _LEAST * sizes.max()
        ],
        "and",
    )


def _words(k: int, row: int) -> str:
    """A row's unit and what it is."""
    forces, torques = row_kinds(k)
    if row < forces.stop:
        return f"N along {'xyz'[row]}"
    if row < torques.stop:
        return f"N·m about {'xyz'[row - forces.stop] if forces.stop == 3 else 'z'}"
    return f"in row {row} of W c = f"


def _listed(parts: list[str], last: str) -> str:
    if len(parts) < 2:
        return "".join(parts)
    return f"{', '.join(parts[:-1])} {last} {parts[-1]}"
