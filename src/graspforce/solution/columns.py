"""Many solutions as columns: each quantity one array with a leading axis.

Logs, sweeps, comparisons, tables and files of results take their numbers from here. What a
:class:`Solution` computes from its problem's data is computed for all problems of one layout at
once; a problem with a contact out of the grasp is computed by its own Solution.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from itertools import accumulate
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from graspforce import equations
from graspforce._engine.layout import Layout
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.equations import Barriers, Cones
from graspforce.problem import all_limits, preload, soft_rows, with_bands, without_pulls
from graspforce.solution import Solution

# Most solutions computed together; bounds the memory for their limits.
ROWS_AT_ONCE = 4096


class Columns(Sequence[Solution]):
    """B solutions, each quantity in one array whose first axis has length B.

    A quantity is computed when it is first asked for, as :class:`Solution` defines it. Where the
    problems differ in their numbers of contacts, joints or wrench rows, the rows of fewer entries
    end in NaN.

    Args:
        solutions: B of them, in the order of the rows.
    """

    def __init__(self, solutions: Iterable[Solution]) -> None:
        self._solutions = tuple(solutions)
        self._rows: dict[str, list[Any]] = {}
        self._columns: dict[str, NDArray[Any]] = {}

    # ---- the solutions themselves -------------------------------------------------------------

    def __len__(self) -> int:
        return len(self._solutions)

    @overload
    def __getitem__(self, index: int) -> Solution: ...
    @overload
    def __getitem__(self, index: slice) -> Columns: ...
    def __getitem__(self, index: int | slice) -> Solution | Columns:
        if isinstance(index, slice):
            return Columns(self._solutions[index])
        return self._solutions[index]

    # ---- what the solver found ----------------------------------------------------------------

    @property
    def c(self) -> Array:
        """Contact forces in the contact frames, shape (B, m) [N, N·m]."""
        return self._column("c")

    @property
    def nu(self) -> Array:
        """Multipliers of W c = f, shape (B, k)."""
        return self._column("nu")

    @property
    def status(self) -> NDArray[np.int64]:
        """Values of :class:`graspforce.Status`, shape (B,)."""
        return self._column("status")

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which problems are SOLVED, shape (B,)."""
        return self.status == Status.SOLVED

    @property
    def newton_steps(self) -> NDArray[np.int64]:
        """Newton steps taken, shape (B,)."""
        return self._column("newton_steps")

    @property
    def decrement(self) -> Array:
        """Certified bounds on the Newton decrement, shape (B,); inf without one."""
        return self._column("decrement")

    @property
    def suboptimality(self) -> Array:
        """Certified bounds on Phi(c) − Phi*, shape (B,); inf without one."""
        return self._column("suboptimality")

    @property
    def violation(self) -> Array:
        """Least relative violations of the limits where INFEASIBLE, else 0, shape (B,)."""
        return self._column("violation")

    @property
    def nearest(self) -> NDArray[np.bool_]:
        """Which c are for the nearest wrench, see :attr:`Solution.nearest`, shape (B,)."""
        return self._column("nearest")

    @property
    def missing(self) -> Array:
        """What c lacks of the wrenches, f − W c, shape (B, k) [N, N·m]."""
        return self._column("missing")

    # ---- what follows from the problems' data -------------------------------------------------

    @property
    def tau(self) -> Array:
        """Joint torques, shape (B, n_joints) [N·m]."""
        return self._column("tau")

    @property
    def normal_forces(self) -> Array:
        """Normal forces, shape (B, n) [N]."""
        return self._column("normal_forces")

    @property
    def friction_margins(self) -> Array:
        """Margins mu n − ‖tangential force‖, shape (B, n) [N]."""
        return self._column("friction_margins")

    @property
    def friction_residual(self) -> Array:
        """r_f of Eq. (22), shape (B,) [N²]."""
        return self._column("friction_residual")

    @property
    def torque_margins(self) -> Array:
        """Distances of the joint torques to their nearer limits, shape (B, n_joints) [N·m]."""
        return self._column("torque_margins")

    @property
    def torque_residual(self) -> Array:
        """r_tau, the smallest torque margins, shape (B,) [N·m]."""
        return self._column("torque_residual")

    @property
    def wrench_error(self) -> Array:
        """Largest |W c − f|, shape (B,) [N, N·m]."""
        return self._column("wrench_error")

    @property
    def phi(self) -> Array:
        """The objective Phi(c) of Eq. (16), shape (B,); inf outside the limits."""
        return self._column("phi")

    @property
    def max_torque(self) -> Array:
        """The size of the largest joint torque, shape (B,) [N·m]; 0 without joints."""
        return np.nanmax(np.abs(self.tau), axis=1, initial=0.0)

    def field(self, name: str) -> Array:
        """Return a field of the problems, shape (B, …): ``field("alpha")``, ``field("f")``."""
        return stacked([getattr(each.problem, name) for each in self._solutions])

    def rows(self, name: str) -> list[Any]:
        """Return an attribute of every Solution, each of its own length."""
        if name not in self._rows:
            function = FROM_DATA.get(name)
            if function is None:
                values: list[Any] = [getattr(each, name) for each in self._solutions]
            else:
                values = self._computed(name, function)
            self._rows[name] = values
        return self._rows[name]

    def _computed(self, name: str, function: Callable[[ProblemRows], Array]) -> list[Any]:
        values: list[Any] = [None] * len(self)
        for indices, chunk in self._chunks:
            for index, value in zip(indices, function(chunk), strict=True):
                values[index] = value
        return [
            getattr(solution, name) if value is None else value
            for solution, value in zip(self._solutions, values, strict=True)
        ]

    def _column(self, name: str) -> NDArray[Any]:
        if name not in self._columns:
            self._columns[name] = stacked(self.rows(name))
        return self._columns[name]

    @cached_property
    def _chunks(self) -> list[tuple[list[int], ProblemRows]]:
        """Solutions of one layout with all contacts in the grasp, by their indices."""
        same: defaultdict[Layout, list[int]] = defaultdict(list)
        for index, solution in enumerate(self._solutions):
            if solution.problem.active.all():
                same[solution.problem.layout].append(index)
        return [
            (part, self._together(layout, [self._solutions[index] for index in part]))
            for layout, indices in same.items()
            for part in (
                indices[k : k + ROWS_AT_ONCE] for k in range(0, len(indices), ROWS_AT_ONCE)
            )
        ]

    @staticmethod
    def _together(layout: Layout, solutions: Sequence[Solution]) -> ProblemRows:
        packed = np.array([each.problem.packed for each in solutions])
        forces = np.array([np.append(each.c, each.internal_forces) for each in solutions])
        return ProblemRows(layout, forces, layout.views(packed))

    def __repr__(self) -> str:
        return f"Columns({len(self)} solutions, {int(self.solved.sum())} solved)"


def stacked(rows: Sequence[Any]) -> NDArray[Any]:
    """Return numbers, or vectors of any lengths, as one array; short vectors end in NaN."""
    shapes = {getattr(row, "shape", ()) for row in rows}
    if len(shapes) < 2:
        return np.array(rows)
    stack = np.full((len(rows), *max(shapes)), np.nan)
    for line, row in zip(stack, rows, strict=True):
        line[: len(row)] = row
    return stack


class ProblemRows:
    """The data and forces of G problems of one layout with all their contacts in the grasp.

    Args:
        layout: of the problems.
        forces: theirs, and the internal ones of the motors behind them, shape (G, m + r) [N, N·m].
        data: their fields by name, each with a leading axis of length G; see
            :meth:`graspforce._engine.layout.Layout.views`.
    """

    def __init__(self, layout: Layout, forces: Array, data: Mapping[str, Array]) -> None:
        self.layout, self.forces, self.data = layout, forces, data
        self.c = forces[:, : sum(layout.dims)]
        self.loaded = forces + preload(layout, data)  # what the ordinary cones and limits hold
        weight = data["cone_weight"] if layout.cone_weights else None
        self.cones = Cones.of(layout.dims, data["mu"], data["gamma"], weight)

    @property
    def barriers(self) -> Barriers:
        """The terms of Eq. (16), of the forces ``loaded``."""
        layout, data = without_pulls(self.layout, self.data)
        A, b = all_limits(layout, with_bands(layout, data))
        soft = soft_rows(data) if layout.soft_wrench else ()
        return Barriers(self.cones, A, b, data["alpha"], *soft)

    @property
    def equalities(self) -> tuple[Array, Array]:
        """W, shape (G, k, m + r), and f of W loaded = f, with zeros for the soft rows."""
        _, data = without_pulls(self.layout, self.data)
        W, f = data["W"], data["f"]
        W = np.concatenate((W, np.zeros((*f.shape, self.layout.internals))), axis=-1)
        if not self.layout.soft_wrench:
            return W, f
        exact = data["f_soft"] == 0
        return W * exact[..., None], f * exact

    def tau(self) -> Array:
        """Joint torques."""
        arms = self.data["J"]
        if self.layout.internals:
            arms = np.concatenate((arms, self.data["internal"]), axis=1)
        return equations.joint_torques(self.forces, arms, self.data["tau_bias"])

    def normal_forces(self) -> Array:
        """Normal forces."""
        return self.c[:, list(accumulate(self.layout.dims, initial=0))[:-1]]

    def torque_margins(self) -> Array:
        """Distances of the joint torques to their nearer limits."""
        return equations.torque_margins(self.tau(), self.data["tau_lo"], self.data["tau_hi"])

    def torque_residual(self) -> Array:
        """The smallest of them."""
        return self.torque_margins().min(axis=1, initial=np.inf)

    def wrench_error(self) -> Array:
        """Largest |W c − f|."""
        return equations.wrench_error(self.c, self.data["W"], self.data["f"])

    def missing(self) -> Array:
        """What c lacks of the wrenches, f − W c."""
        return self.data["f"] - (self.data["W"] @ self.c[..., None])[..., 0]

    def friction_margins(self) -> Array:
        """Margins to slipping."""
        return equations.friction_margins(self.loaded[:, : self.c.shape[1]], self.cones)

    def friction_residual(self) -> Array:
        """r_f of Eq. (22)."""
        return equations.friction_residual(self.loaded[:, : self.c.shape[1]], self.cones)

    def phi(self) -> Array:
        """The objective, Eq. (16)."""
        return equations.objective(self.loaded, self.barriers)


FROM_DATA: dict[str, Callable[[ProblemRows], Array]] = {
    "tau": ProblemRows.tau,
    "normal_forces": ProblemRows.normal_forces,
    "friction_margins": ProblemRows.friction_margins,
    "friction_residual": ProblemRows.friction_residual,
    "torque_margins": ProblemRows.torque_margins,
    "torque_residual": ProblemRows.torque_residual,
    "wrench_error": ProblemRows.wrench_error,
    "missing": ProblemRows.missing,
    "phi": ProblemRows.phi,
}
