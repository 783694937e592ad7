"""Many force problems of one layout at once, as arrays in and arrays out.

:func:`solve_batch` means row by row what :func:`graspforce.solve` means, to the same statuses and
certificates. Rows that the core can solve four or eight at a time in the lanes of a register it
does, the others one by one; what a row comes to depends on that row alone.

Arrays of float64 whose rows lie side by side are read where they stand. A :class:`Batch` keeps
views of them, from which it computes torques, margins and residuals when asked for: do not change
them while it is in use.
"""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce import equations
from graspforce._engine import dispatch, native
from graspforce._engine.layout import FIELDS, Layout
from graspforce._engine.outcome import PlainOutcome, Status
from graspforce._engine.settings import DEFAULT, Settings
from graspforce._util.arrays import Array, as_integer, as_rows, index_of, require_instance
from graspforce.contact import ContactModel, model_of, models_for
from graspforce.errors import InvalidInputError
from graspforce.problem import (
    REMOVAL_THRESHOLD,
    ForceProblem,
    layout_of,
    require_groups,
    require_known,
)
from graspforce.solution import (
    UNREACHABLE_IN_WORDS,
    Solution,
    infeasible_in_words,
    solved_in_words,
)
from graspforce.solution.missing import Lack, lack_in_words
from graspforce.solution.rows import FROM_DATA, ROWS_AT_ONCE, ProblemRows
from graspforce.solution.verification import BOUND_TOLERANCE, WRENCH_TOLERANCE

# Rows solved together where an array is not float64 with its rows side by side, and converted, or
# where somebody waits to be told.
_PART = 16384

# Rows packed together, so few that they stay in the cache.
_PACKED = 512

# Problems of a stream that are held at once.
_SOLVED_AT_ONCE = 8192

# Fields that another bounds from above.
_LOWER_LIMITS = ("tau_lo", "c_min")

# What a row whose numbers make no problem gets for what is computed from its data.
_OF_INVALID = {
    "tau": 0.0, "normal_forces": 0.0, "friction_margins": -np.inf, "friction_residual": -np.inf,
    "torque_margins": -np.inf, "torque_residual": -np.inf, "wrench_error": np.inf,
    "missing": np.inf, "phi": np.inf,
}  # fmt: skip


def solve_batch(
    W: ArrayLike,
    f: ArrayLike,
    models: ContactModel | Sequence[ContactModel],
    J: ArrayLike | None = None,
    tau_lo: ArrayLike | None = None,
    tau_hi: ArrayLike | None = None,
    tau_bias: ArrayLike | None = None,
    c_max: ArrayLike | None = None,
    c_min: ArrayLike | None = None,
    engagement: ArrayLike | None = None,
    A: ArrayLike | None = None,
    b: ArrayLike | None = None,
    alpha: ArrayLike = 5.0,
    *,
    mu: ArrayLike | None = None,
    gamma: ArrayLike | None = None,
    start: Batch | ArrayLike | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    out: Batch | None = None,
    **further: Any,
) -> Batch:
    """Find the contact forces of B problems, each as :func:`graspforce.solve` does.

    Every argument may have a leading axis of length B, a row for each problem, or be what
    :class:`graspforce.ForceProblem` takes, for all of them; one model may stand for all contacts.
    The Python interpreter's lock is released while the core works, and Ctrl-C stops it.

    A row whose numbers make no problem (NaN, a limit that excludes another) gets INVALID_NUMBERS,
    forces of zero and a reason, :meth:`Batch.reason`; the others are not touched by it.

    Args:
        W: grasp maps, shape (k, m) or (B, k, m).
        f: wrenches, shape (k,) or (B, k) [N, N·m].
        models: the contacts' models, the same in all rows.
        J: hand Jacobians, shape (m, n_joints) or (B, m, n_joints) [m].
        tau_lo: lower torque limits [N·m].
        tau_hi: upper torque limits [N·m].
        tau_bias: torques that the fingers need for themselves [N·m].
        c_max: ceilings of the normal forces [N].
        c_min: floors of the normal forces [N].
        engagement: the paper's w_i.
        A: further inequalities' matrices.
        b: their right-hand sides.
        alpha: weights of the linear limits, a number or shape (B,).
        mu: coefficients of friction in place of the models', shape (n,) or (B, n).
        gamma: coefficients of torsional friction in place of the models', likewise [m].
        start: forces to start from, shape (m,) or (B, m), or a batch whose forces they are; in rows
            where they are outside the limits, or not finite, they are ignored.
        settings: tolerance and step limit, for each row; with ``budget_us`` every row is solved by
            itself.
        threads: how many; None for all cores that the process may use.
        out: a batch of as many rows and the same layout, whose arrays are written again.
        further: any other argument of ForceProblem, with or without the leading axis.

    Returns:
        B answers, with their statuses; an empty batch where B is 0.

    Raises:
        InvalidInputError: an argument of the wrong kind or type, shapes that do not fit each other.
    """
    given = {
        "W": W, "f": f, "J": J, "tau_lo": tau_lo, "tau_hi": tau_hi, "tau_bias": tau_bias,
        "c_max": c_max, "c_min": c_min, "engagement": engagement, "A": A, "b": b, "alpha": alpha,
        "mu": mu, "gamma": gamma,
    }  # fmt: skip
    require_known(further)
    rows = BatchProblems.of(models, given | further)
    if out is not None:
        require_instance(out, "out", Batch)
        if len(out) != len(rows) or out.problems.layout != rows.layout:
            raise InvalidInputError(
                f"out: got a batch of {len(out)} rows, expected {len(rows)} of the same layout"
            )
    guess = None
    if start is not None:
        if isinstance(start, Batch) and start.c.shape != (len(rows), rows.layout.sizes["m"]):
            raise InvalidInputError(
                f"start: got a batch with forces of shape {start.c.shape}, expected "
                f"({len(rows)}, {rows.layout.sizes['m']})"
            )
        guess = as_rows(
            start.c if isinstance(start, Batch) else start, "start", (rows.layout.sizes["m"],)
        )
        guess = _fit_rows(guess, 1, len(rows), "start", f"the problems' {len(rows)} rows")
    return solve_rows(rows, guess, settings, threads, out)


def solve_rows(
    rows: BatchProblems,
    start: Array | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    out: Batch | None = None,
    advance: Callable[[int], None] | None = None,
) -> Batch:
    """Solve problems whose shapes were checked, as :func:`solve_batch` does.

    Args:
        rows: the problems.
        start: forces to start from, shape (m,) or (B, m).
        settings: as of solve_batch.
        threads: likewise.
        out: likewise.
        advance: called with the number of rows that are done, now and then.
    """
    settings = DEFAULT if settings is None else settings
    require_instance(settings, "settings", Settings)
    most = available_cores() if threads is None else as_integer(threads, "threads", 1)
    found = _Found.empty(len(rows), rows.layout) if out is None else out.found
    by_backend = _solve_by_reference if settings.backend == "reference" else _solve_by_core
    return Batch(rows, found, by_backend(rows, start, found, settings, most, advance))


def available_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class BatchProblems(Sequence[ForceProblem]):
    """B problems of one layout: each field an array that all rows share, or of a row for each."""

    def __init__(self, layout: Layout, fields: Mapping[str, NDArray[Any]], count: int) -> None:
        self.layout, self.fields, self._count = layout, fields, count

    @classmethod
    def stacked(cls, packed: ArrayLike, layout: Layout) -> BatchProblems:
        """Return problems whose numbers are the rows of an array, as of ``ForceProblem.packed``."""
        whole = np.asarray(packed, dtype=np.float64)
        return cls(layout, layout.views(whole), len(whole))

    @classmethod
    def of(
        cls, models: ContactModel | Sequence[ContactModel], given: Mapping[str, Any]
    ) -> BatchProblems:
        """Check types and shapes of arguments, None where not given, and find B.

        Raises:
            InvalidInputError: one does not fit.
        """
        given = dict.fromkeys(FIELDS) | dict(given)
        maps = as_rows(given["W"], "W", ("k", "m"))
        k, m = maps.shape[-2:]
        each = models_for(models, m)
        require_groups(given)
        joints = inequalities = internals = 0
        if given["J"] is not None:
            joints = as_rows(given["J"], "J", (m, "n_joints")).shape[-1]
        if given["internal"] is not None:
            internals = as_rows(given["internal"], "internal", ("r", joints)).shape[-2]
        if given["A"] is not None:
            inequalities = as_rows(given["A"], "A", ("p", m)).shape[-2]
        layout = layout_of(given, each, k, joints, inequalities, internals)
        of_models = ("mu", "gamma", "pull")
        defaults = {name: [getattr(model, name) for model in each] for name in of_models}
        fields: dict[str, NDArray[Any]] = {}
        for name, slot in layout.slots.items():
            value, field = given[name], FIELDS[name]
            if value is None and name not in ("f", "alpha"):
                value = np.full(slot.shape, field.default)
                if name in defaults and value.size:
                    value[:] = defaults[name]
            scalar = field.broadcast or name in defaults
            fields[name] = as_rows(value, name, slot.shape, broadcast=scalar)
        count, source = 1, None
        for name, value in fields.items():
            length = len(value) if value.ndim > len(layout.slots[name].shape) else 1
            if length != 1 and source is None:
                count, source = length, name
        for name, value in fields.items():
            axes = len(layout.slots[name].shape)
            other = "" if source is None else f"{source} of shape {fields[source].shape}"
            fields[name] = _fit_rows(value, axes, count, name, other)
        return cls(layout, fields, count)

    @classmethod
    def like(
        cls, first: ForceProblem, stacks: Mapping[str, NDArray[Any]], count: int
    ) -> BatchProblems:
        """Return problems of the layout of the first of them; their numbers are not looked into.

        Args:
            first: what all of them have where there is no stack.
            stacks: fields by name: a number for all, a number for each problem, shape (B,), or
                shape (B, …) with the entries of the field, one of which may stand for all.
            count: B.
        """
        slots = first.layout.slots

        def whole(value: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
            if value.ndim == 0:
                return np.full(shape, value, dtype=np.float64)
            missing = (1,) * (1 + len(shape) - value.ndim)
            every = np.broadcast_to(value.reshape(value.shape + missing), (count, *shape))
            return np.ascontiguousarray(every, dtype=np.float64)

        fields: dict[str, NDArray[Any]] = first.layout.views(first.packed)
        fields |= {name: whole(value, slots[name].shape) for name, value in stacks.items()}
        return cls(first.layout, fields, count)

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> ForceProblem: ...
    @overload
    def __getitem__(self, index: slice) -> BatchProblems: ...
    def __getitem__(self, index: int | slice) -> ForceProblem | BatchProblems:
        if isinstance(index, slice):
            count = len(range(*index.indices(len(self))))
            return BatchProblems(self.layout, self._each(lambda rows: rows[index]), count)
        return ForceProblem.from_packed(self.layout, self.packed(index))

    def __iter__(self) -> Iterator[ForceProblem]:
        """Yield the problems, whose numbers are the rows of arrays."""
        for packed in self._all_packed():
            yield ForceProblem.from_packed(self.layout, packed)

    def _all_packed(self) -> Iterator[Array]:
        """Yield the numbers of every row."""
        for first in range(0, len(self), _PACKED):
            part = self[first : first + _PACKED]
            whole = np.empty((len(part), self.layout.slots["alpha"].stop))
            for name, view in self.layout.views(whole).items():
                view[...] = part.fields[name]
            yield from whole

    def packed(self, row: int) -> Array:
        """Return a row's numbers in one buffer, as the core reads them; not checked."""
        one = self._each(lambda rows: rows[row])
        return np.concatenate([np.ravel(value) for value in one.values()]).astype(np.float64)

    def replace(self, **changes: Any) -> BatchProblems:
        """Return the problems with some arguments changed, for all or a row each.

        Raises:
            InvalidInputError: as :func:`solve_batch`.
        """
        layout = self.layout
        given = {name: v for name, v in self.fields.items() if 0 not in layout.slots[name].shape}
        if not layout.ceilings:
            del given["engagement"]
        models = [model_of(dim, 1.0, 1.0, float(layout.pulls)) for dim in layout.dims]
        return BatchProblems.of(models, given | changes)

    def first_flaw(self) -> tuple[int, native.Flaw] | None:
        """Return the first row whose numbers make no problem, and why."""
        find = native.module.find_flaw
        if len(self) > 1 and all(
            find(self.layout, extreme) is None for extreme in self._extremes()
        ):
            return None
        for row, packed in enumerate(self._all_packed()):
            flaw = find(self.layout, packed)
            if flaw is not None:
                return row, flaw
        return None

    def _extremes(self) -> Iterator[Array]:
        """Yield two rows of the least and the most of each number, which flaws show in, if any.

        In the first, lower limits are as high as in any row, and upper ones as low.
        """
        for lowest in (True, False):
            ends: list[Array] = []
            for name, value in self.fields.items():
                least = lowest != (name in _LOWER_LIMITS)
                if self.has_rows(name):
                    value = value.min(axis=0) if least else value.max(axis=0)
                ends.append(np.ravel(value))
            yield np.concatenate(ends, dtype=np.float64)

    def undetermined(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return ``ForceProblem.undetermined`` of some rows, all of them with finite numbers."""
        counts = np.zeros(len(rows), dtype=np.intp)
        if not self.layout.joints:
            return counts
        whole = self.active[rows].all(axis=1)
        data = self.data()
        for first in range(0, len(rows), ROWS_AT_ONCE):
            some = slice(first, first + ROWS_AT_ONCE)
            at = rows[some]
            counts[some] = equations.undetermined(data["W"][at], data["J"][at])
        for place in np.flatnonzero(~whole).tolist():
            counts[place] = self[int(rows[place])].undetermined
        return counts

    def has_rows(self, name: str) -> bool:
        """Whether a field has a row for each problem."""
        return self.fields[name].ndim > len(self.layout.slots[name].shape)

    def data(self) -> dict[str, Array]:
        """Return all fields with a leading axis of length B, in float64."""
        return {
            name: np.broadcast_to(
                np.asarray(value, dtype=np.float64), (len(self), *self.layout.slots[name].shape)
            )
            for name, value in self.fields.items()
        }

    @property
    def active(self) -> NDArray[np.bool_]:
        """Which contacts are in the grasp, shape (B, n)."""
        engaged = self.fields["engagement"] > REMOVAL_THRESHOLD
        return np.broadcast_to(engaged, (len(self), self.layout.sizes["n"]))

    def read_in_place(self, name: str) -> bool:
        """Whether the core can read a field where it stands."""
        return not self.has_rows(name) or _lies_side_by_side(self.fields[name])

    def _each(self, of_rows: Callable[[NDArray[Any]], Any]) -> dict[str, Any]:
        return {
            name: of_rows(value) if self.has_rows(name) else value
            for name, value in self.fields.items()
        }


def _lies_side_by_side(value: NDArray[Any]) -> bool:
    """Whether rows are float64, aligned, and each contiguous; they may be any distance apart."""
    if value.dtype != np.float64 or not value.flags.aligned or value.strides[0] % 8:
        return False
    return len(value) == 0 or value[0].flags.c_contiguous


def _fit_rows(value: NDArray[Any], axes: int, count: int, name: str, other: str) -> NDArray[Any]:
    """Return a field for `count` rows: with a row for each, or shared and contiguous float64.

    Raises:
        InvalidInputError: it has another number of rows.
    """
    if value.ndim > axes and len(value) == 1 != count:
        value = value[0]
    if value.ndim == axes:
        return np.asarray(value, dtype=np.float64, order="C")
    if len(value) != count:
        raise InvalidInputError(
            f"{name}: got shape {value.shape}, expected as many rows as {other}, or none"
        )
    return value


@dataclass
class _Found:
    """The arrays that the solver writes."""

    forces: Array  # of the contacts, and the internal ones behind them, shape (B, m + r)
    nu: Array
    status: NDArray[np.int32]
    newton_steps: NDArray[np.int32]
    start: NDArray[np.int32]
    nearest: NDArray[np.int32]
    decrement: Array
    violation: Array

    @classmethod
    def empty(cls, count: int, layout: Layout) -> _Found:
        sizes = layout.sizes
        return cls(
            np.empty((count, sizes["m"] + sizes["r"])),
            np.empty((count, sizes["k"])),
            np.empty(count, dtype=np.int32),
            np.empty(count, dtype=np.int32),
            np.empty(count, dtype=np.int32),
            np.empty(count, dtype=np.int32),
            np.empty(count),
            np.empty(count),
        )

    def __getitem__(self, rows: slice) -> _Found:
        return _Found(*(value[rows] for value in vars(self).values()))


# y and z of the certificate of each infeasible row.
_Proofs = dict[int, tuple[Array, Array]]


def _solve_by_core(
    rows: BatchProblems,
    start: Array | None,
    found: _Found,
    settings: Settings,
    threads: int,
    advance: Callable[[int], None] | None,
) -> _Proofs:
    names = list(rows.layout.slots)
    converted = [name for name in names if not rows.read_in_place(name)]
    if start is not None and start.ndim > 1 and not _lies_side_by_side(start):
        converted.append("start")
    size = _PART if converted or advance else max(1, len(rows))
    budget_us = math.inf if settings.budget_us is None else settings.budget_us
    k, proofs = rows.layout.wrench_rows, _Proofs()
    for first in range(0, len(rows), size):
        part, to = rows[first : first + size], found[first : first + size]
        fields = [
            np.ascontiguousarray(part.fields[name], dtype=np.float64)
            if name in converted
            else part.fields[name]
            for name in names
        ]
        guess = start if start is None or start.ndim < 2 else start[first : first + size]
        if "start" in converted:
            guess = np.ascontiguousarray(guess, dtype=np.float64)
        indices, certificates = native.module.solve_batch(
            rows.layout, len(part), fields, guess, to.forces, to.nu, to.status, to.newton_steps,
            to.start, to.nearest, to.decrement, to.violation, settings.tol, settings.max_steps,
            budget_us, threads,
        )  # fmt: skip
        for index, line in zip(indices.tolist(), certificates, strict=True):
            proofs[first + index] = line[:k], line[k:]
        if advance is not None:
            advance(first + len(part))
    return proofs


def _solve_by_reference(
    rows: BatchProblems,
    start: Array | None,
    found: _Found,
    settings: Settings,
    threads: int,
    advance: Callable[[int], None] | None,
) -> _Proofs:
    """Solve row by row with the NumPy transcription of the paper."""
    proofs = _Proofs()
    for i in range(len(rows)):
        packed = rows.packed(i)
        if native.module.find_flaw(rows.layout, packed) is not None:
            shape = rows.layout.sizes
            outcome = PlainOutcome(
                Status.INVALID_NUMBERS, 0, np.zeros(shape["m"]), np.zeros(shape["k"]),
                internal_forces=np.zeros(shape["r"]),
            )  # fmt: skip
        else:
            guess = start if start is None or start.ndim < 2 else start[i]
            if guess is not None and not np.isfinite(guess).all():
                guess = None
            problem = ForceProblem.from_packed(rows.layout, packed)
            outcome = dispatch.solve(problem, settings, guess, lambda outcome, _: outcome)
        found.forces[i] = np.append(outcome.c, outcome.internal_forces)
        for name, value in vars(found).items():
            if name != "forces":
                value[i] = getattr(outcome, name)
        if outcome.y is not None and outcome.z is not None:
            proofs[i] = outcome.y, outcome.z
        if advance is not None:
            advance(i + 1)
    return proofs


def solve_many(
    problems: Iterable[ForceProblem],
    settings: Settings | None = None,
    threads: int | None = None,
) -> list[Solution]:
    """Solve problems of any layouts, mixed; those of one layout together.

    A generator of problems is read as they are solved; what is kept is the list that is returned.
    For a stream without end see :func:`iterate_many`.

    Args:
        problems: what to solve.
        settings: as of :func:`graspforce.solve`.
        threads: as of :func:`solve_batch`.

    Returns:
        Their solutions, in the same order.

    Raises:
        InvalidInputError: something that is no ForceProblem.
    """
    return list(iterate_many(problems, settings, threads))


def iterate_many(
    problems: Iterable[ForceProblem],
    settings: Settings | None = None,
    threads: int | None = None,
) -> Iterator[Solution]:
    """Yield the solutions of :func:`solve_many` one by one, in bounded memory.

    Raises:
        InvalidInputError: something that is no ForceProblem.
    """
    require_instance(problems, "problems", Iterable, "ForceProblems")
    source = iter(problems)
    while window := list(islice(source, _SOLVED_AT_ONCE)):
        groups: defaultdict[Layout, list[int]] = defaultdict(list)
        for i, problem in enumerate(window):
            require_instance(problem, "problems", ForceProblem, "ForceProblems")
            groups[problem.layout].append(i)
        solutions: dict[int, Solution] = {}
        for layout, rows in groups.items():
            packed = np.array([window[i].packed for i in rows])
            batch = solve_rows(BatchProblems.stacked(packed, layout), None, settings, threads)
            for place, i in enumerate(rows):
                solutions[i] = Solution(batch.outcome(place), window[i])
        for i in range(len(window)):
            yield solutions.pop(i)


class Batch(Sequence[Solution]):
    """The contact forces of B problems with their verdicts; what :func:`solve_batch` returns.

    ``batch[i]`` is row i as a :class:`graspforce.Solution`, ``batch[i:j]`` a batch of views.
    """

    def __init__(self, problems: BatchProblems, found: _Found, proofs: _Proofs) -> None:
        self.problems, self.found = problems, found
        self._proofs = proofs

    @classmethod
    def of(cls, solutions: Sequence[Solution], layout: Layout) -> Batch:
        """Return solutions of problems of one layout as a batch."""
        problems = BatchProblems.stacked([each.problem.packed for each in solutions], layout)
        found = _Found.empty(len(solutions), layout)
        proofs = _Proofs()
        for row, each in enumerate(solutions):
            found.forces[row] = np.append(each.c, each.internal_forces)
            for name, values in vars(found).items():
                if name != "forces":
                    values[row] = getattr(each, name)
            proof = each.certificate
            if proof is not None:
                counted = each.problem.counted_limits()
                z = np.zeros(len(counted))
                z[counted] = proof.z
                proofs[row] = proof.y, z
        return cls(problems, found, proofs)

    # ---- what the solver found ----------------------------------------------------------------

    @property
    def c(self) -> Array:
        """Contact forces in the contact frames, shape (B, m) [N, N·m]."""
        return self.found.forces[:, : self.problems.layout.sizes["m"]]

    @property
    def internal_forces(self) -> Array:
        """Internal forces of the motors, shape (B, r); see ``internal`` of a ForceProblem."""
        return self.found.forces[:, self.problems.layout.sizes["m"] :]

    @property
    def nu(self) -> Array:
        """Multipliers of W c = f, shape (B, k)."""
        return self.found.nu

    @property
    def status(self) -> NDArray[np.int32]:
        """Values of :class:`graspforce.Status`, shape (B,)."""
        return self.found.status

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which rows are SOLVED, shape (B,)."""
        return self.status == Status.SOLVED

    @property
    def newton_steps(self) -> NDArray[np.int32]:
        """Newton steps taken, shape (B,)."""
        return self.found.newton_steps

    @property
    def start(self) -> NDArray[np.int32]:
        """Values of :class:`graspforce.Start`, shape (B,): COLD or GIVEN."""
        return self.found.start

    @property
    def decrement(self) -> Array:
        """Certified bounds on the Newton decrement, shape (B,); inf without one."""
        return self.found.decrement

    @property
    def violation(self) -> Array:
        """Least relative violations of the limits where INFEASIBLE, else 0, shape (B,)."""
        return self.found.violation

    @property
    def nearest(self) -> NDArray[np.bool_]:
        """Which rows' c is for the nearest wrench, see :attr:`Solution.nearest`, shape (B,)."""
        return self.found.nearest.astype(bool)

    @cached_property
    def missing(self) -> Array:
        """What c lacks of the wrenches, f − W c, shape (B, k) [N, N·m]."""
        return self._from_data("missing")

    @property
    def suboptimality(self) -> Array:
        """Certified bounds on Phi(c) − Phi*, shape (B,); inf without one."""
        units = np.minimum(1.0, self.problems.fields["alpha"])
        if self.problems.layout.cone_weights:
            weights = np.where(self.problems.active, self.problems.fields["cone_weight"], 1.0)
            units = np.minimum(units, weights.min(axis=1, initial=1.0))
        return units * equations.suboptimality(self.decrement)

    @property
    def proved(self) -> list[int]:
        """The rows with a certificate of infeasibility."""
        return sorted(self._proofs)

    # ---- what follows from the problems' data -------------------------------------------------

    @cached_property
    def tau(self) -> Array:
        """Joint torques J.T c + tau_bias, shape (B, n_joints) [N·m]."""
        return self._from_data("tau")

    @cached_property
    def normal_forces(self) -> Array:
        """Normal forces, shape (B, n) [N]."""
        return self._from_data("normal_forces")

    @cached_property
    def friction_margins(self) -> Array:
        """Margins mu n − ‖tangential force‖, shape (B, n) [N]; inf out of the grasp."""
        return self._from_data("friction_margins")

    @cached_property
    def friction_residual(self) -> Array:
        """r_f of Eq. (22), shape (B,) [N²]."""
        return self._from_data("friction_residual")

    @cached_property
    def torque_margins(self) -> Array:
        """Distances of the joint torques to their nearer limits, shape (B, n_joints) [N·m]."""
        return self._from_data("torque_margins")

    @cached_property
    def torque_residual(self) -> Array:
        """r_tau, the smallest torque margins, shape (B,) [N·m]."""
        return self._from_data("torque_residual")

    @cached_property
    def wrench_error(self) -> Array:
        """Largest |W c − f|, shape (B,) [N, N·m]."""
        return self._from_data("wrench_error")

    @cached_property
    def phi(self) -> Array:
        """The objective Phi(c) of Eq. (16), shape (B,); inf outside the limits."""
        return self._from_data("phi")

    def reason(self, row: int) -> str:
        """Return a row's verdict in words; for numbers that make no problem, which and why.

        Raises:
            IndexError: there is no such row.
        """
        row = self._row(row)
        flaw = native.module.find_flaw(self.problems.layout, self.problems.packed(row))
        return self[row].message if flaw is None else native.describe(flaw)

    def messages(self) -> list[str]:
        """Return the verdicts in words, those of :attr:`Solution.message`."""
        return [text for part in self._parts for text in part._messages()]

    def certificates(self) -> dict[int, tuple[Array, Array]]:
        """Return y and z of the certificate of each row that has one."""
        proofs = dict(self._proofs)
        for row in self.proved:
            if self._by_themselves[row]:
                proof = self[row].certificate
                assert proof is not None
                proofs[row] = proof.y, proof.z
        return proofs

    def verify(self) -> BatchVerification:
        """Recompute every residual from the problems' data, as :meth:`Solution.verify` does.

        A row whose numbers make no problem is confirmed where its status says so.
        """
        parts = [part._verification() for part in self._parts]
        return BatchVerification(
            *(np.concatenate([part[i] for part in parts]) if parts else np.empty(0, kind)
              for i, kind in enumerate((bool, float, float, float, float, object)))
        )  # fmt: skip

    # ---- rows ---------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self.problems)

    @overload
    def __getitem__(self, index: int) -> Solution: ...
    @overload
    def __getitem__(self, index: slice) -> Batch: ...
    def __getitem__(self, index: int | slice) -> Solution | Batch:
        if isinstance(index, slice):
            rows = range(*index.indices(len(self)))
            if self._proofs:
                places = {row: i for i, row in enumerate(rows) if row in self._proofs}
                proofs = {i: self._proofs[row] for row, i in places.items()}
            else:
                proofs = _Proofs()
            return Batch(self.problems[index], self.found[index], proofs)
        row = self._row(index)
        return Solution(self.outcome(row), self.problems[row])

    def outcome(self, row: int) -> PlainOutcome:
        """Return the solver's numbers of a row."""
        y, z = self._proofs.get(row, (None, None))
        found = self.found
        return PlainOutcome(
            int(found.status[row]), int(found.newton_steps[row]), np.array(self.c[row]),
            np.array(found.nu[row]), float(found.decrement[row]), float(found.violation[row]), y, z,
            int(found.start[row]), internal_forces=np.array(self.internal_forces[row]),
            nearest=bool(found.nearest[row]),
        )  # fmt: skip

    def _row(self, index: int) -> int:
        row = index_of(index)
        if row is None:
            require_instance(index, "row", int)
        assert row is not None
        if not -len(self) <= row < len(self):
            raise IndexError(f"row: got {row}, expected less than {len(self)}")
        return row % len(self)

    def __repr__(self) -> str:
        return f"Batch({len(self)} rows, {int(self.solved.sum())} solved)"

    @cached_property
    def _parts(self) -> list[Batch]:
        """So few rows each that what is computed for all of them at once stays small."""
        firsts = range(0, len(self), ROWS_AT_ONCE)
        return [self[first : first + ROWS_AT_ONCE] for first in firsts]

    @cached_property
    def _by_themselves(self) -> NDArray[np.bool_]:
        """Rows with a contact out of the grasp, whose quantities their own Solution defines."""
        flawed = np.zeros(len(self), dtype=bool)
        flawed[self._flawed] = True
        return ~(flawed | self.problems.active.all(axis=1))

    @cached_property
    def _flawed(self) -> list[int]:
        """Rows whose numbers make no problem; others of INVALID_NUMBERS overflow."""
        find, layout = native.module.find_flaw, self.problems.layout
        return [
            row
            for row in np.flatnonzero(self.status == Status.INVALID_NUMBERS).tolist()
            if find(layout, self.problems.packed(row)) is not None
        ]

    def _from_data(self, name: str) -> Array:
        if self._parts:
            return np.concatenate([part._compute(name) for part in self._parts])
        return FROM_DATA[name](self._together)

    @cached_property
    def _together(self) -> ProblemRows:
        return ProblemRows(self.problems.layout, self.found.forces, self.problems.data())

    def _compute(self, name: str) -> Array:
        with np.errstate(all="ignore"):
            values = np.array(FROM_DATA[name](self._together))
        for row in np.flatnonzero(self._by_themselves).tolist():
            values[row] = getattr(self[row], name)
        values[self._flawed] = _OF_INVALID[name]
        return values

    def _messages(self) -> list[str]:
        solved = np.flatnonzero(self.solved)
        texts = [""] * len(self)
        rows = zip(
            solved.tolist(), self.newton_steps[solved].tolist(),
            self.suboptimality[solved].tolist(), self.problems.undetermined(solved).tolist(),
            strict=True,
        )  # fmt: skip
        m = self.problems.layout.sizes["m"]
        for row, steps, bound, free in rows:
            texts[row] = solved_in_words(steps, bound, free, m)
        lacking = np.isin(self.status, (Status.INFEASIBLE, Status.WRENCH_UNREACHABLE))
        lacking &= ~self._by_themselves
        for row, words in self._lacks(np.flatnonzero(lacking)):
            if self.status[row] == Status.INFEASIBLE:
                texts[row] = infeasible_in_words(self.violation[row], words)
            else:
                texts[row] = UNREACHABLE_IN_WORDS + words
        for row in np.flatnonzero(~(self.solved | lacking)).tolist():
            texts[row] = self[row].message
        return texts

    def _lacks(self, rows: NDArray[np.intp]) -> Iterator[tuple[int, str]]:
        """Yield rows without contacts out of the grasp, and what their forces lack in words."""
        layout, nearest = self.problems.layout, self.nearest.tolist()
        data = {name: value[rows] for name, value in self.problems.data().items()}
        lacks = ProblemRows(layout, self.found.forces[rows], data).lack
        for row, *lack in zip(rows.tolist(), *lacks, strict=True):
            yield row, lack_in_words(layout, Lack(*lack), nearest[row])

    def _verification(self) -> tuple[NDArray[Any], ...]:
        """The columns of :class:`BatchVerification`."""
        rows = self._together
        barriers = rows.barriers
        W, f = rows.equalities
        with np.errstate(all="ignore"):
            friction = rows.friction_margins().min(axis=1, initial=np.inf)
            limits = equations.slacks(rows.loaded, barriers.A, barriers.b).min(
                axis=1, initial=np.inf
            )
            wrench_error = np.array(rows.wrench_error())
            decrement, error = equations.decrements_and_errors(rows.loaded, W, barriers)
            balanced = equations.relative_wrench_error(rows.loaded, W, f) <= WRENCH_TOLERANCE
            bounded = decrement <= (1 + BOUND_TOLERANCE) * self.decrement + error
        finite = np.isfinite(rows.forces).all(axis=1) & np.isfinite(self.nu).all(axis=1)
        ok = self.solved & (friction > 0) & (limits > 0) & balanced & bounded & finite
        holds = np.full(len(self), None, dtype=object)
        others = ~self.solved | self._by_themselves
        for row in np.flatnonzero(others).tolist():
            packed = self.problems.packed(row)
            if native.module.find_flaw(self.problems.layout, packed) is not None:
                ok[row] = self.status[row] == Status.INVALID_NUMBERS and not rows.forces[row].any()
                wrench_error[row] = np.inf
                friction[row] = limits[row] = -np.inf
                decrement[row] = np.inf
                continue
            one = self[row].verify()
            ok[row], wrench_error[row] = one.ok, one.wrench_error
            friction[row], limits[row] = one.friction_margin, one.limit_margin
            decrement[row], holds[row] = one.decrement, one.certificate_holds
        return ok, wrench_error, friction, limits, decrement, holds


@dataclass(frozen=True, slots=True)
class BatchVerification:
    """What :meth:`Batch.verify` recomputed; the columns of :class:`graspforce.Verification`.

    Attributes:
        ok: the numbers below confirm the status, shape (B,).
        wrench_error: largest |W c − f|, shape (B,) [N, N·m].
        friction_margin: smallest of the friction margins, shape (B,) [N].
        limit_margin: smallest slack of the linear limits, shape (B,), in each limit's own unit.
        decrement: Newton decrements at c, from NumPy, shape (B,); inf outside.
        certificate_holds: the certificate proves infeasibility, shape (B,), objects; None where
            there is none.
    """

    ok: NDArray[np.bool_]
    wrench_error: Array
    friction_margin: Array
    limit_margin: Array
    decrement: Array
    certificate_holds: NDArray[Any]
