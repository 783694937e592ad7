"""What contact forces lack of a wrench, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.layout import Layout
from graspforce._util.arrays import Array
from graspforce.problem import ForceProblem, row_kinds

# A component below this share of the largest, by the scales of the rows, is not named.
_LEAST = 1e-3
# Nor is what is below this share of the wrenches that add up to f.
_ROUNDING = 1e-9


class Lack(NamedTuple):
    """What contact forces lack of a wrench, or those of many problems.

    Attributes:
        missing: f − W c, shape (…, k) [N, N·m].
        scales: of its rows, shape (…, k), see :meth:`ForceProblem.wrench_scales`.
        sizes: by these scales, shape (…, k); 0 of rows that need not hold.
        whole: the largest of the wrenches that add up to f, by these scales, shape (…).
    """

    missing: Array
    scales: Array
    sizes: Array
    whole: Array

    @classmethod
    def of(cls, W: Array, f: Array, exact: NDArray[np.bool_], c: Array, scales: Array) -> Lack:
        """Return what forces c lack, shape (…, m) [N, N·m]; the others are the problems'."""
        missing = f - (W @ c[..., None])[..., 0]
        parts = np.abs(f) + (np.abs(W) @ np.abs(c)[..., None])[..., 0]
        return cls(missing, scales, np.abs(missing) / scales * exact, (parts / scales).max(axis=-1))


def in_words(problem: ForceProblem, c: Array, nearest: bool) -> str:
    """Name the missing components with their units, the scale of torques, and what would help.

    Args:
        problem: what was solved.
        c: forces that do not make its wrench, or violate a limit, shape (m,) [N, N·m].
        nearest: whether no forces within the limits lack less of the wrench.

    Returns:
        The end of a sentence.
    """
    lack = Lack.of(problem.W, problem.f, problem.exact, c, problem.wrench_scales())
    return lack_in_words(problem.layout, lack, nearest)


def lack_in_words(layout: Layout, lack: Lack, nearest: bool) -> str:
    """Return :func:`in_words` of a problem of this layout."""
    missing, scales, sizes = (each.tolist() for each in lack[:3])
    largest = max(sizes)
    if largest <= _ROUNDING * lack.whole:
        return "; c makes the wrench and violates them least"
    _, torques = row_kinds(len(missing))
    counts = f" (a torque counts by {scales[torques][0]:.3g} m)" if scales[torques] else ""
    what = f"the nearest wrench{counts}, which" if nearest else "a wrench that"
    twisted = any(size > _LEAST * largest for size in sizes[torques])
    soft = 4 in layout.dims
    helps = ["soft fingers"] if twisted and not soft else []
    helps.append("another contact")
    if not layout.soft_wrench:
        helps.append("a soft wrench (f_soft)")
    return f"; c makes {what} lacks {_named(missing, sizes)}; {_listed(helps, 'or')} would help"


def components(problem: ForceProblem, missing: Array) -> str:
    """Return the components of a missing wrench that count, with their units.

    Args:
        problem: whose wrench it is missing of.
        missing: f − W c, shape (k,) [N, N·m].
    """
    sizes = np.abs(missing) / problem.wrench_scales() * problem.exact
    return _named(missing.tolist(), sizes.tolist())


def _named(missing: Sequence[float], sizes: Sequence[float]) -> str:
    return _listed(
        [
            f"{missing[row]:.3g} {_words(len(missing), row)}"
            for row in range(len(missing))
            if sizes[row] > _LEAST * max(sizes)
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
