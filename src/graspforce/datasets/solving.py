"""Solve the rows of one part: an Arrow table in, an Arrow table and the rejected rows out.

Rows of one shape and one set of contact models are one batch. What a row comes to depends on that
row alone, and how rows are grouped on the part alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.layout import FIELDS
from graspforce._engine.outcome import Status
from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array
from graspforce.answers import firmness
from graspforce.batch import Batch, BatchProblems, solve_batch
from graspforce.contact import Contact, ContactModel, any_tangent, model_of
from graspforce.datasets.arrow import pa
from graspforce.datasets.geometry import (
    DIMS,
    frame_flaws,
    grasp_maps,
    quaternion_flaws,
    rotations,
)
from graspforce.datasets.ragged import (
    NULL,
    UNEVEN,
    Ragged,
    as_lists,
    groups,
    ragged,
    texts_of,
)
from graspforce.datasets.recipe import GRAVITY, Recipe
from graspforce.datasets.schema import NUMBERS, TEXTS
from graspforce.datasets.sources import Chunk
from graspforce.derivatives import sensitivity
from graspforce.errors import InvalidInputError
from graspforce.grasp import Grasp
from graspforce.problem import ForceProblem

_STATUS = pa.array([status.name for status in Status])
_VECTORS = ("c", "tau", "normal_forces", "friction_margins", "torque_margins")


@dataclass(frozen=True)
class _Rows:
    """Rows of one layout, ready to be solved.

    Attributes:
        rows: their places in the part's table, shape (G,).
        models: the contacts' models; mu, gamma and pull may also be in ``fields``.
        fields: arguments of solve_batch but f, for each direction of gravity.
        loads: f for each direction, each (k,) or (G, k).
        directions: of gravity in the axes of the contacts, each (3,) or (G, 3); where f is from it.
        asked: what each load is in the axes of the contacts; a hand turns f and adds rows to it.
    """

    rows: NDArray[np.int64]
    models: list[ContactModel]
    fields: list[dict[str, Any]]
    loads: list[NDArray[Any]]
    directions: list[Array] | None
    asked: list[NDArray[Any]]


class PartSolver:
    """Solves parts of a data set by one recipe; knows nothing of files.

    Args:
        recipe: what to do with every row.
        schema: of the target.
        threads: of each batch.
    """

    def __init__(self, recipe: Recipe, schema: Any, threads: int) -> None:
        self._recipe, self._schema, self._threads = recipe, schema, threads
        self._settings = Settings(tol=recipe.tol, max_steps=recipe.max_steps)

    def solve(self, chunk: Chunk, file: str) -> tuple[Any, list[tuple[int, str]]]:
        """Return the target's rows, and the rejected ones with reasons, both in order.

        Args:
            chunk: rows of a source file; keys may be missing.
            file: its name.
        """
        table, rejects = chunk.table, dict[int, str]()
        numbers = {
            name: ragged(table[name])
            for name in table.column_names
            if name in NUMBERS and name not in self._recipe.values
        }
        texts = {
            name: texts_of(table[name], name)
            for name in table.column_names
            if name in TEXTS and name not in self._recipe.values
        }
        pieces: list[tuple[NDArray[np.int64], Any]] = []
        for rows in groups(numbers, list(texts.values()), len(table)):
            every = np.arange(len(table)) if rows is None else rows
            words = {name: str(text[every[0]]) for name, text in texts.items()}
            solved: list[tuple[NDArray[np.int64], Any]] = []
            try:
                group = _Group(self._recipe, numbers, words, rows, every)
                solved += [self._solve(one, rejects) for one in group.ready()]
            except InvalidInputError as error:
                rejects |= dict.fromkeys(every.tolist(), str(error))
                continue
            rejects |= group.rejects
            pieces += solved
        out = self._assembled(chunk, file, pieces)
        found = [(int(chunk.rows[place]), reason) for place, reason in rejects.items()]
        return out, sorted(chunk.rejects + found)

    def _solve(self, ready: _Rows, rejects: dict[int, str]) -> tuple[NDArray[np.int64], Any]:
        """Return places and results of rows, d for each; rows that make no problem are rejected."""
        recipe, answers = self._recipe, list[_Answers]()
        invalid = np.zeros(len(ready.rows), dtype=bool)
        for index in range(len(ready.loads)):
            answer = _Answers(recipe, ready, index, self._settings, self._threads)
            answers.append(answer)
            bad = answer.batch.status == Status.INVALID_NUMBERS
            for place in np.flatnonzero(bad & ~invalid).tolist():
                rejects[int(ready.rows[place])] = answer.batch.reason(place)
            invalid |= bad
        keep = None if not invalid.any() else np.flatnonzero(~invalid)
        tables = [answer.table(self._schema, keep) for answer in answers]
        rows = ready.rows if keep is None else ready.rows[keep]
        return np.tile(rows, len(tables)), pa.concat_tables(tables)

    def _assembled(
        self, chunk: Chunk, file: str, pieces: list[tuple[NDArray[np.int64], Any]]
    ) -> Any:
        """Return the pieces in the order of their rows, with file, row and keys."""
        if not pieces:
            return self._schema.empty_table()
        places = np.concatenate([rows for rows, _ in pieces])
        results = pa.concat_tables([table for _, table in pieces])
        order = np.argsort(places, kind="stable")
        if (np.diff(places) < 0).any():
            results, places = results.take(pa.array(order)), places[order]
        columns: dict[str, Any] = {
            "file": pa.DictionaryArray.from_arrays(
                pa.array(np.zeros(len(places), dtype=np.int32)), pa.array([file])
            ),
            "row": pa.array(chunk.rows[places]),
        }
        whole = len(places) == len(chunk.table) and self._recipe.gravity is None
        for name in self._recipe.keys:
            if name in chunk.table.column_names:
                column = chunk.table[name]
                columns[name] = column if whole else column.take(pa.array(places))
        columns |= {name: results[name] for name in results.column_names}
        for name in self._schema.names:  # which other files of the source have
            if name not in columns:
                columns[name] = pa.nulls(len(places), self._schema.field(name).type)
        return pa.table([columns[name] for name in self._schema.names], self._schema.names).cast(
            self._schema
        )


class _Group:
    """Rows of one shape and one text in each column, made into arguments of solve_batch."""

    def __init__(
        self,
        recipe: Recipe,
        numbers: Mapping[str, Ragged],
        words: Mapping[str, str],
        some: NDArray[np.int64] | None,
        rows: NDArray[np.int64],
    ) -> None:
        self._recipe, self._words, self._rows = recipe, words, rows
        self.rejects: dict[int, str] = {}
        # Each column as (rows or 1, size), and how many lists a row of it is.
        self._flat: dict[str, tuple[NDArray[Any], int]] = {}
        for name, value in recipe.values.items():
            if name in NUMBERS:
                array = np.asarray(value, dtype=float)
                self._flat[name] = array.reshape(1, -1), len(array) if array.ndim > 1 else 0
        for name, column in numbers.items():
            size = int(column.sizes[rows[0]])
            if size == NULL:
                raise InvalidInputError(f"{name}: got null")
            if size == UNEVEN:
                raise InvalidInputError(f"{name}: got lists of different lengths in one row")
            self._flat[name] = column.take(some), int(column.outer[rows[0]])

    def ready(self) -> Iterator[_Rows]:
        """Yield the rows in batches of one layout.

        Raises:
            InvalidInputError: rows of this shape make no problem.
        """
        if "points" not in self._flat:
            yield self._of_matrices()
        elif self._recipe.hand is None:
            yield from self._of_geometry()
        else:
            yield from self._of_hand()

    # ---- sizes --------------------------------------------------------------------------------

    @cached_property
    def kinds(self) -> list[str]:
        """The models of the contacts by name."""
        said = self._recipe.values.get("models", self._words.get("models"))
        default = "SFC" if "gamma" in self._flat else "PCWF"
        names = said.split(",") if isinstance(said, str) else list(said or [default])
        for name in names:
            if name not in DIMS:
                raise InvalidInputError(f"models: got {name!r}, expected FPC, PCWF or SFC")
        return names if len(names) > 1 else names * self._contacts(names[0])

    def _contacts(self, kind: str) -> int:
        """Return how many contacts of one kind the rows have."""
        if "points" in self._flat:
            size = self._size("points")
            if size % 3 or not size:
                raise InvalidInputError(f"points: got {size} numbers, expected 3 for each contact")
            return size // 3
        maps, lists = self._flat["W"]
        of_load = self._size("f") if "f" in self._flat and self._size("f") > 1 else 6
        if lists and "f" in self._flat and self._size("f") > 1 and lists != of_load:
            raise InvalidInputError(
                f"W: got {lists} × {maps.shape[1] // lists} numbers, expected a row for each of "
                f"the {of_load} numbers of f"
            )
        columns, rest = divmod(maps.shape[1], lists or of_load)
        if rest or columns % DIMS[kind] or not columns:
            raise InvalidInputError(
                f"W: got {maps.shape[1]} numbers, expected {DIMS[kind]} columns for each {kind} "
                f"contact in each of {lists or of_load} rows"
            )
        return columns // DIMS[kind]

    def _size(self, name: str) -> int:
        return self._flat[name][0].shape[1]

    @cached_property
    def sizes(self) -> dict[str, int]:
        """The lengths of the axes that columns have."""
        sizes = {"n": len(self.kinds), "m": sum(DIMS[kind] for kind in self.kinds)}
        for axis, name, other in (
            ("k", "W", "m"), ("n_joints", "J", "m"), ("p", "A", "m"), ("r", "internal", "n_joints")
        ):  # fmt: skip
            if name in self._flat and sizes.get(other):
                sizes[axis] = self._size(name) // sizes[other]
        for axis, name in (("n_q", "q"), ("k", "f")):
            if name in self._flat:
                sizes.setdefault(axis, self._size(name))
        if "points" in self._flat:
            sizes["k"] = 6
        return sizes

    def _column(self, name: str) -> NDArray[Any]:
        """Return a column of shape (rows, *shape), or of ``shape`` where all rows share it.

        Raises:
            InvalidInputError: its rows have other sizes.
        """
        flat, lists = self._flat[name]
        shape = tuple(
            self.sizes.get(axis, 0) if isinstance(axis, str) else axis
            for axis in NUMBERS[name].shape
        )
        size = int(np.prod(shape))
        spread = name in ("mu", "gamma", "tau_limit") or (name in FIELDS and FIELDS[name].broadcast)
        if spread and flat.shape[1] == 1 != size:
            flat = np.broadcast_to(flat, (len(flat), size))
        if flat.shape[1] != size or (lists and len(shape) > 1 and lists != shape[0]):
            got = f"{lists} × {flat.shape[1] // lists}" if lists else str(flat.shape[1])
            wanted = " × ".join(map(str, shape)) or "1"
            axes = ", ".join(map(str, NUMBERS[name].shape)) or "a number"
            raise InvalidInputError(
                f"{name}: got {got} numbers, expected {wanted} ({axes}) beside the other columns"
            )
        shared = name in self._recipe.values
        return flat.reshape(shape if shared else (len(flat), *shape))

    def _each(self, name: str, default: Any = None) -> NDArray[np.float64]:
        """Return a column with a row for each row, as float64."""
        value = self._column(name) if name in self._flat else np.asarray(default, dtype=float)
        shape = NUMBERS[name].shape
        if value.ndim == len(shape):
            value = np.broadcast_to(value, (len(self._rows), *value.shape))
        return np.asarray(value, dtype=np.float64)

    # ---- the three kinds of rows --------------------------------------------------------------

    def _of_matrices(self) -> _Rows:
        fields = self._fields() | {"W": self._column("W")}
        loads, directions = self._loads(None)
        same = [fields] * len(loads)
        return _Rows(self._rows, self._models(), same, loads, directions, loads)

    def _of_geometry(self) -> Iterator[_Rows]:
        points, normals, tangents, origins = self._contact_geometry()
        good = self._without(frame_flaws(normals, tangents) | self._pose_flaws())
        if not len(good):
            return
        W = grasp_maps(self.kinds, *(each[good] for each in (points, normals, tangents, origins)))
        count = len(self._rows)
        fields = {
            name: value[good] if value.ndim > len(NUMBERS[name].shape) else value
            for name, value in self._fields().items()
        }
        loads, directions = self._loads(good)
        rows = self._rows[good] if len(good) < count else self._rows
        same = [fields | {"W": W}] * len(loads)
        yield _Rows(rows, self._models(), same, loads, directions, loads)

    def _of_hand(self) -> Iterator[_Rows]:
        """Yield rows whose J and limits a hand gives, row by row, together by their layouts."""
        from graspforce.datasets.hand import IN_USE, hand_of

        points, normals, tangents, origins = self._contact_geometry()
        flaws = frame_flaws(normals, tangents) | self._pose_flaws()
        good = self._without(flaws)
        loads, directions = self._loads(None)
        poses = self._each("hand_pose", (0.0, 0, 0, 1, 0, 0, 0))
        turns = rotations(poses[:, 3:])
        points, origins = (
            np.einsum("bji,b...j->b...i", turns, each - poses[:, :3].reshape(shape))
            for each, shape in ((points, (-1, 1, 3)), (origins, (-1, 3)))
        )
        normals, tangents = (np.einsum("bji,bnj->bni", turns, each) for each in (normals, tangents))
        angles = self._each("q")
        tips = self._recipe.fingertips or tuple(self._words.get("fingertips", "").split(","))
        hand = hand_of(self._recipe.hand or "", tips, self._recipe.tau_max)
        options = {name: self._each(name) for name in self._fields() if name not in ("mu", "gamma")}
        mu = self._each("mu", np.ones(self.sizes["n"]))
        gamma = self._each("gamma", np.ones(self.sizes["n"]))
        problems: dict[int, list[ForceProblem]] = {}
        with IN_USE:
            for place in good.tolist():
                try:
                    models = [
                        model_of(DIMS[kind], float(mu[place, i]), float(gamma[place, i]))
                        for i, kind in enumerate(self.kinds)
                    ]
                    contacts = [
                        Contact(points[place, i], normals[place, i], model, tangents[place, i])
                        for i, model in enumerate(models)
                    ]
                    grasp = Grasp(contacts, hand, angles[place], origins[place])
                    own: Any = {name: value[place] for name, value in options.items()}
                    problems[place] = [
                        grasp.problem(_turned(load, turns, place), **own) for load in loads
                    ]
                except InvalidInputError as error:
                    self.rejects[int(self._rows[place])] = str(error)
        same: defaultdict[Any, list[int]] = defaultdict(list)
        for place, each in problems.items():
            same[tuple(problem.layout for problem in each)].append(place)
        for layouts, places in same.items():
            packed = [
                np.array([problems[i][d].packed for i in places]) for d in range(len(layouts))
            ]
            views = [layout.views(rows) for layout, rows in zip(layouts, packed, strict=True)]
            fields = [
                {
                    name: value
                    for name, value in view.items()
                    if value.size and name != "f" and (name != "engagement" or layout.ceilings)
                }
                for layout, view in zip(layouts, views, strict=True)
            ]
            shown = directions and [_some(each, places) for each in directions]
            yield _Rows(
                self._rows[places], self._models(), fields, [each["f"] for each in views], shown,
                [_some(each, places) for each in loads],
            )  # fmt: skip

    def _contact_geometry(self) -> tuple[Array, Array, Array, Array]:
        normals = self._each("normals")
        tangents = self._each("tangents") if "tangents" in self._flat else any_tangent(normals)
        return self._each("points"), normals, tangents, self._each("origin", np.zeros(3))

    def _pose_flaws(self) -> dict[int, str]:
        flaws: dict[int, str] = {}
        for name in ("object_pose", "hand_pose"):
            if name in self._flat:
                flaws |= quaternion_flaws(self._each(name), name)
        return flaws

    def _without(self, flaws: dict[int, str]) -> NDArray[np.int64]:
        """Reject rows, and return the others' places in the group."""
        self.rejects |= {int(self._rows[place]): text for place, text in flaws.items()}
        return np.setdiff1d(np.arange(len(self._rows)), list(flaws))

    def _fields(self) -> dict[str, NDArray[Any]]:
        """Return the fields of a problem that the rows have as they are, but W and f."""
        fields = {
            name: self._column(name)
            for name in self._flat
            if name in FIELDS and name not in ("W", "f")
        }
        if "tau_limit" in self._flat:
            limit = self._column("tau_limit")
            fields |= {"tau_lo": -limit, "tau_hi": limit}
        return fields

    def _models(self) -> list[ContactModel]:
        """Return models whose coefficients ``fields`` has."""
        pull = 1.0 if "pull" in self._flat else 0.0
        return [model_of(DIMS[kind], 1.0, 1.0, pull) for kind in self.kinds]

    # ---- wrenches -----------------------------------------------------------------------------

    def _loads(
        self, good: NDArray[np.int64] | None
    ) -> tuple[list[NDArray[Any]], list[Array] | None]:
        """Return f for each direction of gravity, and the directions where f comes of a mass."""
        if "mass" not in self._flat:
            load = self._column("f")
            return [load if good is None or load.ndim == 1 else load[good]], None
        if self.sizes["k"] != 6:
            raise InvalidInputError(f"mass: W has {self.sizes['k']} rows, expected 6 with a mass")
        mass = self._each("mass")
        if good is not None:
            mass = mass[good]
        loads: list[NDArray[Any]] = []
        directions = self._directions(good)
        for direction in directions:
            load = np.zeros((len(mass), 6))
            load[:, :3] = -GRAVITY * mass[:, None] * direction
            loads.append(load)
        return loads, directions

    def _directions(self, good: NDArray[np.int64] | None) -> list[Array]:
        """Return directions of gravity in the axes of the contacts, each (3,) or (rows, 3)."""
        if self._recipe.directions is not None:
            return list(self._recipe.directions)
        down = self._each("gravity_direction", (0.0, 0.0, -1.0))
        with np.errstate(all="ignore"):
            down = down / np.linalg.norm(down, axis=-1, keepdims=True)
            if "object_pose" in self._flat:
                turns = rotations(self._each("object_pose")[:, 3:])
                down = np.einsum("bji,bj->bi", turns, down)
        return [down if good is None else down[good]]


def _some(rows: NDArray[Any], places: list[int]) -> NDArray[Any]:
    return rows[places] if rows.ndim > 1 else rows


def _turned(load: NDArray[Any], turns: Array, place: int) -> Array:
    """Return a row's wrench in the axes of its hand."""
    own = load if load.ndim == 1 else load[place]
    return np.concatenate((turns[place].T @ own[:3], turns[place].T @ own[3:]))


class _Answers:
    """The answers of rows under one load, with what the wishes make of them."""

    def __init__(
        self,
        recipe: Recipe,
        ready: _Rows,
        index: int,
        settings: Settings,
        threads: int,
    ) -> None:
        self._recipe, self._ready, self._index = recipe, ready, index
        load = ready.loads[index]
        f = np.ascontiguousarray(np.broadcast_to(load, (len(ready.rows), load.shape[-1])))
        given = {"alpha": FIELDS["alpha"].default} | ready.fields[index] | {"f": f}
        wished = _with_wishes(recipe, given)
        hard = solve_batch(models=ready.models, settings=settings, threads=threads, **wished)
        self._hard = hard
        # As the rows came: torques and margins are against their own friction and limits.
        self.batch = hard
        if wished is not given:
            own = BatchProblems.of(ready.models, given)
            self.batch = Batch(own, hard.found, {})
        self._alpha = np.broadcast_to(
            np.asarray(hard.problems.fields["alpha"], dtype=np.float64), (len(hard),)
        )
        self._suboptimality, self._met = hard.suboptimality, hard.solved
        self._least = np.full(len(hard), np.nan)
        if recipe.times_least is not None:
            self._choose_firmness(recipe.times_least)

    def _choose_firmness(self, times: float) -> None:
        """Put in the forces that are so many times the least, where the hard wishes can be met."""
        self._alpha, self._met = self._alpha.copy(), self._met.copy()
        problems, found = self.batch.problems, self.batch.found
        for row in np.flatnonzero(self._hard.solved).tolist():
            grip = firmness.choose(problems[row], times_least=times, **self._recipe.wishes.given)
            one = grip.solution
            found.forces[row] = np.append(grip.c, one.internal_forces)
            found.status[row], found.newton_steps[row] = one.status, one.newton_steps
            self._suboptimality[row] = one.suboptimality
            self._alpha[row], self._met[row], self._least[row] = grip.alpha, grip.met, grip.least

    def table(self, schema: Any, keep: NDArray[np.int64] | None) -> Any:
        """Return the result columns of the schema.

        Args:
            schema: of the target.
            keep: rows to keep; None for all.
        """
        batch, count = self.batch, len(self.batch)
        directions, index = self._ready.directions, self._index

        def rows(value: Any) -> Any:
            value = np.asarray(value)
            return value if keep is None else value[keep]

        columns: dict[str, Any] = {
            "status": pa.DictionaryArray.from_arrays(pa.array(rows(batch.status)), _STATUS),
            "newton_steps": pa.array(rows(batch.newton_steps)),
            "alpha": pa.array(rows(self._alpha)),
            "wrench_error": pa.array(rows(batch.wrench_error)),
            "suboptimality": pa.array(rows(self._suboptimality)),
            "violation": pa.array(rows(batch.violation)),
            "met": pa.array(rows(self._met)),
            "least": pa.array(rows(self._least)),
            "gravity_index": pa.array(np.full(count, index, dtype=np.int8)[: len(rows(self._met))]),
        }
        columns |= {name: as_lists(rows(getattr(batch, name))) for name in _VECTORS}
        if directions is not None:
            spread = np.broadcast_to(directions[index], (count, 3))
            columns["gravity"] = as_lists(rows(spread))
            asked = np.broadcast_to(self._ready.asked[index], (count, 6))
            columns["f"] = as_lists(rows(asked))
        if self._recipe.sensitivities:
            derivatives = sensitivity(self._hard)
            for name in self._recipe.sensitivities:
                value = derivatives.jacobian(name).reshape(count, -1)
                columns[f"dc_d{name}"] = as_lists(rows(value))
        names = [name for name in schema.names if name in columns]
        return pa.table([columns[name] for name in names], names)


def _with_wishes(recipe: Recipe, given: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of the problems all of whose answers meet the hard wishes."""
    wishes = recipe.wishes
    if not wishes.given:
        return given
    changed = dict(given)
    if wishes.slip_reserve:
        for name in ("mu", "gamma"):
            if name in given:
                changed[name] = (1 - wishes.slip_reserve) * np.asarray(given[name])
    if wishes.torque_reserve:
        if "J" not in given:
            raise InvalidInputError("torque_reserve: the rows have no joints")
        lo, hi = (np.asarray(given[name], dtype=float) for name in ("tau_lo", "tau_hi"))
        inset = wishes.torque_reserve * (hi - lo) / 2
        changed |= {"tau_lo": lo + inset, "tau_hi": hi - inset}
    if wishes.largest_normal is not None:
        force: Any = wishes.largest_normal
        with np.errstate(divide="ignore"):
            lifted = force / np.asarray(given.get("engagement", 1.0), dtype=float)
        ceiling = np.minimum(np.asarray(given.get("c_max", np.inf), dtype=float), lifted)
        changed["c_max"] = np.where(np.isfinite(ceiling), ceiling, 1.0)
    return changed
