"""Many problems, and many solutions, as columns: each quantity one array with a leading axis.

Files, logs, sweeps, comparisons and tables take their numbers from here. Problems of any layouts
stand in some order; those of one layout are rows of one :class:`graspforce.batch.BatchProblems`,
which are solved, and whose quantities are computed, together.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from graspforce._engine import native
from graspforce._engine.layout import Layout
from graspforce._engine.outcome import Status
from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array
from graspforce.batch import Batch, BatchProblems, solve_rows
from graspforce.problem import ForceProblem
from graspforce.solution import Solution


class _Places(NamedTuple):
    """Where rows stand: group and row in it, of each index."""

    group: NDArray[np.intp]
    row: NDArray[np.intp]

    @classmethod
    def of(cls, count: int, indices: Sequence[NDArray[np.intp]]) -> _Places:
        places = cls(np.empty(count, dtype=np.intp), np.empty(count, dtype=np.intp))
        for number, own in enumerate(indices):
            places.group[own], places.row[own] = number, np.arange(len(own))
        return places


class ProblemColumns(Sequence[ForceProblem]):
    """B problems of any layouts, those of one layout in arrays.

    Args:
        groups: the problems of each layout, with their places in the order of all.
    """

    def __init__(self, groups: Sequence[tuple[NDArray[np.intp], BatchProblems]]) -> None:
        self.groups = list(groups)

    @classmethod
    def of(cls, problems: Sequence[ForceProblem]) -> ProblemColumns:
        """Put problems of any layouts into arrays."""
        groups: list[tuple[NDArray[np.intp], BatchProblems]] = []
        for layout, indices in _by_layout(problems):
            packed = [problems[i].packed for i in map(int, indices)]
            groups.append((indices, BatchProblems.stacked(packed, layout)))
        return cls(groups)

    def __len__(self) -> int:
        return sum(len(rows) for _, rows in self.groups)

    @overload
    def __getitem__(self, index: int) -> ForceProblem: ...
    @overload
    def __getitem__(self, index: slice) -> list[ForceProblem]: ...
    def __getitem__(self, index: int | slice) -> ForceProblem | list[ForceProblem]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        group, row = int(self._places.group[index]), int(self._places.row[index])
        return self.groups[group][1][row]

    def __iter__(self) -> Iterator[ForceProblem]:
        if len(self.groups) == 1:
            yield from self.groups[0][1]
        else:
            yield from (self[i] for i in range(len(self)))

    @cached_property
    def _places(self) -> _Places:
        return _Places.of(len(self), [indices for indices, _ in self.groups])

    def replace(self, **changes: Any) -> ProblemColumns:
        """Return the problems with some fields changed to what all of them shall have.

        Raises:
            InvalidInputError: as :func:`graspforce.solve_batch`; numbers are not looked into.
        """
        return ProblemColumns([(at, rows.replace(**changes)) for at, rows in self.groups])

    def first_flaw(self) -> tuple[int, native.Flaw] | None:
        """Return the index of the first problem whose numbers make none, and why."""
        found = [
            (int(indices[row]), flaw)
            for indices, rows in self.groups
            for row, flaw in [rows.first_flaw() or (None, None)]
            if row is not None and flaw is not None
        ]
        return min(found, key=lambda each: each[0], default=None)

    def solve(
        self, settings: Settings | None = None, advance: Callable[[int], None] | None = None
    ) -> Columns:
        """Solve them all.

        Args:
            settings: as of :func:`graspforce.solve`.
            advance: called with the number of rows that are done, now and then.
        """
        batches: list[tuple[NDArray[np.intp], Batch]] = []
        before = 0

        def tell(done: int) -> None:
            if advance is not None:
                advance(before + done)

        for indices, rows in self.groups:
            batches.append((indices, solve_rows(rows, settings=settings, advance=tell)))
            before += len(rows)
        return Columns.of_batches(batches)


class Columns(Sequence[Solution]):
    """B solutions, each quantity in one array whose first axis has length B.

    A quantity is computed when it is first asked for, as :class:`Solution` defines it. Where the
    problems differ in their numbers of contacts, joints or wrench rows, the rows of fewer entries
    end in NaN.

    Args:
        solutions: B of them, in the order of the rows.
    """

    def __init__(self, solutions: Iterable[Solution]) -> None:
        self._solutions: tuple[Solution, ...] | None = tuple(solutions)
        self._columns: dict[str, NDArray[Any]] = {}

    @classmethod
    def of_batches(cls, groups: Sequence[tuple[NDArray[np.intp], Batch]]) -> Columns:
        """Return the rows of batches, each with the places that they have among all."""
        columns = cls(())
        columns._solutions, columns.groups = None, list(groups)
        return columns

    @cached_property
    def groups(self) -> list[tuple[NDArray[np.intp], Batch]]:
        """The rows of each layout, with their places in the order of all."""
        solutions: Sequence[Solution] = self._solutions or ()
        problems = [each.problem for each in solutions]
        return [
            (indices, Batch.of([solutions[i] for i in map(int, indices)], layout))
            for layout, indices in _by_layout(problems)
        ]

    @cached_property
    def _places(self) -> _Places:
        return _Places.of(len(self), [indices for indices, _ in self.groups])

    # ---- the solutions themselves -------------------------------------------------------------

    def __len__(self) -> int:
        if self._solutions is not None:
            return len(self._solutions)
        return sum(len(batch) for _, batch in self.groups)

    @overload
    def __getitem__(self, index: int) -> Solution: ...
    @overload
    def __getitem__(self, index: slice) -> Columns: ...
    def __getitem__(self, index: int | slice) -> Solution | Columns:
        if isinstance(index, slice):
            return Columns(self[i] for i in range(*index.indices(len(self))))
        if self._solutions is not None:
            return self._solutions[index]
        group, row = int(self._places.group[index]), int(self._places.row[index])
        return self.groups[group][1][row]

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
        return self._column("status").astype(np.int64)

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which problems are SOLVED, shape (B,)."""
        return self.status == Status.SOLVED

    @property
    def newton_steps(self) -> NDArray[np.int64]:
        """Newton steps taken, shape (B,)."""
        return self._column("newton_steps").astype(np.int64)

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
        return self._gather([batch.problems.data()[name] for _, batch in self.groups])

    def messages(self) -> list[str]:
        """The verdicts in words."""
        return self._in_order([batch.messages() for _, batch in self.groups])

    def certificates(self) -> tuple[list[Array], list[Array]]:
        """The parts y and z of each row's certificate; empty for a row without one."""
        none = np.empty(0)
        y, z = [none] * len(self), [none] * len(self)
        for indices, batch in self.groups:
            for row, proof in batch.certificates().items():
                y[indices[row]], z[indices[row]] = proof
        return y, z

    def rows(self, name: str) -> list[Any]:
        """Return a quantity of every row, each of its own length."""
        return self._in_order([list(getattr(batch, name)) for _, batch in self.groups])

    def lengths(self, name: str) -> NDArray[np.int64]:
        """Return how many entries each row of a quantity has, shape (B,)."""
        lengths = np.empty(len(self), dtype=np.int64)
        for indices, batch in self.groups:
            lengths[indices] = getattr(batch, name).shape[1]
        return lengths

    def _in_order(self, parts: Sequence[Sequence[Any]]) -> list[Any]:
        """Put what each group has into the order of all rows."""
        values: list[Any] = [None] * len(self)
        for (indices, _), part in zip(self.groups, parts, strict=True):
            for index, value in zip(indices.tolist(), part, strict=True):
                values[index] = value
        return values

    def _column(self, name: str) -> NDArray[Any]:
        if name not in self._columns:
            self._columns[name] = self._gather([getattr(each, name) for _, each in self.groups])
        return self._columns[name]

    def _gather(self, parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Put arrays of the groups' rows into one, where rows that are shorter end in NaN."""
        if not parts:
            return np.empty(0)
        if len(parts) == 1:  # whose rows stand in their order
            return parts[0]
        shapes = {part.shape[1:] for part in parts}
        if len(shapes) == 1:
            stack = np.empty((len(self), *shapes.pop()), dtype=parts[0].dtype)
        else:
            stack = np.full((len(self), *np.max(list(shapes), axis=0)), np.nan)
        for (indices, _), part in zip(self.groups, parts, strict=True):
            stack[(indices, *(slice(size) for size in part.shape[1:]))] = part
        return stack

    def __repr__(self) -> str:
        return f"Columns({len(self)} solutions, {int(self.solved.sum())} solved)"


def _by_layout(problems: Sequence[ForceProblem]) -> list[tuple[Layout, NDArray[np.intp]]]:
    """Return which problems have each layout."""
    same: defaultdict[Layout, list[int]] = defaultdict(list)
    for index, problem in enumerate(problems):
        same[problem.layout].append(index)
    return [(layout, np.array(indices)) for layout, indices in same.items()]
