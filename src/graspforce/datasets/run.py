"""The one function of data sets: look at the source, check everything, run what is left to do."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from graspforce._engine.layout import FIELDS
from graspforce._engine.settings import DEFAULT, Settings
from graspforce._util.arrays import as_integer, as_positive, require_choice, require_instance
from graspforce.batch import available_cores
from graspforce.datasets import local, on_ray
from graspforce.datasets.arrow import pa
from graspforce.datasets.hand import hand_of
from graspforce.datasets.layouts import LAYOUTS, WHERE
from graspforce.datasets.ragged import is_numeric, is_text
from graspforce.datasets.recipe import Recipe, as_values
from graspforce.datasets.schema import NUMBERS, RESULTS, TEXTS, ColumnInfo, choose_keys
from graspforce.datasets.sources import Hints, SourceFile, find_files, fingerprint
from graspforce.datasets.target import Counts, Part, Summary, UnfinishedError, parts_of
from graspforce.datasets.work import Work
from graspforce.errors import InvalidInputError

ENGINES = ("local", "ray")
ROWS_PER_PART = 16384


def solve_dataset(
    source: str | Path,
    target: str | Path,
    engine: str = "local",
    *,
    keys: Sequence[str] | None = None,
    gravity: str | None = None,
    largest_normal: float | None = None,
    times_least: float | None = None,
    slip_reserve: float | None = None,
    torque_reserve: float | None = None,
    sensitivities: Sequence[str] = (),
    hand: str | Path | None = None,
    fingertips: Sequence[str] | None = None,
    tau_max: float | None = None,
    layout: str | None = None,
    meshes: str | Path | None = None,
    contact_distance: float = 0.005,
    settings: Settings | None = None,
    rows_per_part: int = ROWS_PER_PART,
    threads: int | None = None,
    ray_address: str | None = None,
    progress: Callable[[Counts, int], None] | None = None,
    **values: Any,
) -> Summary:
    """Find the contact forces of every grasp in files, and write them as Parquet.

    Rows are matrices (``W``, ``f``, ``J``, ``mu``, …) or geometry (``points``, ``normals``, ``mu``,
    ``f`` or ``mass``, …); ``docs/datasets.md`` lists all columns. Columns that are no part of the
    format are carried through. A row that makes no problem goes to ``target/rejects`` with the
    reason.

    Killed at any moment and called again with the same arguments it goes on where it was; what it
    writes does not depend on that, on ``threads`` or on the engine.

    Args:
        source: a file that ends in .parquet, .npz, .h5 or .jsonl, or a folder of such, also
            partitioned as ``key=value/``.
        target: folder to write to: a new one, or one that the same call began.
        engine: "local" for the cores of this machine, "ray" for a Ray cluster (extra ``ray``).
        keys: columns that are carried through; by default all that are no part of the format.
        gravity: solve each row, which then has ``mass`` in place of ``f``, for several directions
            of gravity: "sphere" for both ways along the axes, "sphere20" for twenty.
        largest_normal: wish, as of :func:`graspforce.firmness.choose`, for every row [N].
        times_least: likewise.
        slip_reserve: likewise.
        torque_reserve: likewise.
        sensitivities: fields by which the derivatives of c are written, as ``f``.
        hand: an MJCF or URDF file that gives J and torque limits of geometry with joint angles q.
        fingertips: its links that make the contacts; by default the column of this name.
        tau_max: torque limit of all its motors in place of the file's [N·m].
        layout: of a published data set, "dexgraspnet" or "bodex", whose files end in .npy.
        meshes: folder of the objects' meshes, where the layout stores no contacts.
        contact_distance: how far a link may be from the mesh and touch it [m].
        settings: tolerance and step limit.
        rows_per_part: rows of the source in each file of the target; what is in memory a thread.
        threads: of the local engine; None for all cores that the process may use.
        ray_address: of the cluster to join; None starts Ray on this machine.
        progress: called with what is done and the number of all rows, at the beginning and after
            each part.
        values: columns of the format with one value for all rows, in place of the source's:
            ``mu=0.5``, ``c_max=20``, ``models="SFC"``.

    Returns:
        How many rows were solved, infeasible and rejected, and how fast.

    Raises:
        InvalidInputError: an argument, a column or the target is wrong; nothing was done.
        ModelImportError: ``hand`` is no model of a hand; nothing was done.
        MissingExtraError: HDF5 without h5py, engine "ray" without Ray.
        UnfinishedError: it ended early, by a full disk, a file that cannot be read, or a lost
            worker; call it again with the same arguments.
    """
    start = time.monotonic()
    require_choice(engine, "engine", ENGINES)
    if engine == "ray":
        on_ray.ray_module()
    size = as_integer(rows_per_part, "rows_per_part", 1)
    most = available_cores() if threads is None else as_integer(threads, "threads", 1)
    source, target = Path(os.path.abspath(source)), Path(target)
    _require_apart(source, target)
    settings = DEFAULT if settings is None else settings
    require_instance(settings, "settings", Settings)
    if settings.budget_us is not None or settings.backend != "native":
        raise InvalidInputError("settings: expected the native core without budget_us")
    if layout is not None:
        require_choice(layout, "layout", tuple(LAYOUTS))
    hints = Hints(
        None if hand is None else os.path.abspath(hand), tau_max,
        None if meshes is None else os.path.abspath(meshes),
        as_positive(contact_distance, "contact_distance", "m"),
    )  # fmt: skip
    if hints.hand is not None:
        hand_of(hints.hand, None, tau_max)  # which refuses a file that is none
    files = find_files(source, layout, hints)
    shared = as_values(values)
    chosen = choose_keys((name for file in files for name in file.columns.names), keys)
    if layout is not None:  # what the forces act on is not in the source as it is used
        chosen += [name for name in WHERE if name in files[0].columns.names and name not in chosen]
    recipe = Recipe(
        keys=tuple(chosen),
        values=shared, gravity=gravity, largest_normal=largest_normal, times_least=times_least,
        slip_reserve=slip_reserve, torque_reserve=torque_reserve,
        sensitivities=tuple(sensitivities), hand=hints.hand,
        fingertips=tuple(fingertips or ()), tau_max=tau_max, tol=settings.tol,
        max_steps=settings.max_steps,
    )  # fmt: skip
    recipe.check()
    for file in files:
        _check_columns(file, recipe)
    work = Work(files, recipe, target.absolute(), _schema(files, recipe))
    parts = list(parts_of([file.rows for file in files], size))
    writer = work.open_target()
    with closing(writer):
        writer.begin(_manifest(work, size, len(parts)))
        counts, pending = Counts(), list[Part]()
        for part in parts:
            found = writer.counts(part.number)
            if found is None:
                pending.append(part)
            else:
                counts.add(found)
        before, total = counts.rows, sum(file.rows for file in files)
        if progress is not None:
            progress(counts, total)

        def done(part: Part, found: Counts) -> None:
            counts.add(found)
            if progress is not None:
                progress(counts, total)

        if engine == "ray" and pending:
            failures = on_ray.run_parts(work, pending, ray_address, done)
        else:
            failures = local.run_parts(work, pending, min(most, max(1, len(pending))), done)
        if failures:
            there = sum(writer.path(part.number).is_file() for part in parts)
            raise UnfinishedError(
                f"{failures[0]}; {there} of {len(parts)} parts are done and stay; the same call "
                "goes on with the others"
            )
        writer.finish(counts)
    return Summary(
        target, counts, len(parts), len(parts) - len(pending), time.monotonic() - start,
        counts.rows - before, work.directions,
    )  # fmt: skip


def _require_apart(source: Path, target: Path) -> None:
    one, other = (Path(os.path.realpath(path)) for path in (source, target))
    if one == other or (one.is_dir() and one in other.parents):
        raise InvalidInputError(
            f"target: got {target}, which is in the source; expected a place of its own"
        )


def _check_columns(file: SourceFile, recipe: Recipe) -> None:
    """Raise where a file's columns make no problem, whatever is in its rows.

    Raises:
        InvalidInputError: a column is missing, or of a wrong type.
    """
    columns = {name: file.columns.field(name).type for name in file.columns.names}
    for name, kind in columns.items():
        fits = is_numeric if name in NUMBERS else is_text
        if (name in NUMBERS or name in TEXTS) and name not in recipe.values and not fits(kind):
            wanted = "numbers or lists of them" if name in NUMBERS else "texts"
            raise InvalidInputError(f"{file.path}: {name}: got type {kind}, expected {wanted}")
    there = {*columns, *recipe.values}

    def require(name: str, why: str) -> None:
        if name not in there:
            raise InvalidInputError(
                f"{file.path}: {name}: missing; {why}; it has {', '.join(columns) or 'no columns'}"
            )

    if "points" not in there:
        require("W", "expected matrices (W, f, mu, …) or geometry (points, normals, mu, …)")
        if recipe.hand is not None:
            raise InvalidInputError(f"{file.path}: hand: rows with W have their joints in J")
    else:
        require("normals", "points came without it")
        if "W" in there:
            raise InvalidInputError(f"{file.path}: W: given beside points, expected one or other")
    if recipe.hand is not None:
        require("q", "a hand needs its joint angles")
        if not recipe.fingertips:
            require("fingertips", "a hand needs the links that make the contacts")
    if recipe.directions is not None:
        require("mass", "gravity needs it")
    if "mass" not in there:
        require("f", "expected f, or the object's mass")
    elif "f" in there:
        raise InvalidInputError(f"{file.path}: f: given beside mass, expected one or the other")
    if recipe.values.get("models") != "FPC":
        require("mu", "contacts have friction; models='FPC' have none")
    if recipe.torque_reserve is not None and recipe.hand is None:
        require("J", "a torque_reserve is one of joints")
    if recipe.hand is None:
        limited = "tau_limit" in there
        for name in ("tau_lo", "tau_hi"):
            if "J" in there and not limited:
                require(name, "J came without it")
        if limited:
            require("J", "tau_limit came without it")
            for name in ("tau_lo", "tau_hi"):
                if name in there:
                    raise InvalidInputError(f"{file.path}: {name}: given beside tau_limit")


def _schema(files: Sequence[SourceFile], recipe: Recipe) -> Any:
    """Return the target's columns: their types, units and what they are.

    Raises:
        InvalidInputError: a key has types that do not go together.
    """
    fields: list[Any] = []
    f_written = any("mass" in {*file.columns.names, *recipe.values} for file in files)
    left_out = {
        "gravity_index": recipe.gravity is None,
        "gravity": not f_written,
        "f": not f_written,
        "met": not recipe.wished,
        "least": recipe.times_least is None,
    }
    for name, info in RESULTS.items():
        if not left_out.get(name):
            fields.append(_field(name, _TYPES.get(name, _NUMBERS[len(info.shape)]), info))
        if name == "row":
            fields += [_key(key, files) for key in recipe.keys]
    for name in recipe.sensitivities:
        axes = ("m", *FIELDS[name].shape)
        info = ColumnInfo(axes, f"Derivatives of c by {name}, row after row")
        fields.append(_field(f"dc_d{name}", _NUMBERS[1], info))
    return pa.schema(fields, metadata={"graspforce": metadata.version("graspforce")})


_TYPES: dict[str, Any] = {
    "file": pa.dictionary(pa.int32(), pa.string()),
    "row": pa.int64(),
    "gravity_index": pa.int8(),
    "status": pa.dictionary(pa.int32(), pa.string()),
    "newton_steps": pa.int32(),
    "met": pa.bool_(),
}
_NUMBERS: tuple[Any, ...] = (pa.float64(), pa.list_(pa.float64()))


def _field(name: str, kind: Any, info: ColumnInfo) -> Any:
    told = {"description": info.doc, "unit": info.unit, "shape": ", ".join(map(str, info.shape))}
    return pa.field(name, kind, metadata={key: text for key, text in told.items() if text})


def _key(name: str, files: Sequence[SourceFile]) -> Any:
    kinds = [file.columns.field(name) for file in files if name in file.columns.names]
    try:
        schemas = [pa.schema([field.remove_metadata()]) for field in kinds]
        return pa.unify_schemas(schemas, promote_options="permissive").field(name)
    except pa.ArrowException as error:
        raise InvalidInputError(
            f"keys: {name!r} has different types in the source's files: {error}"
        ) from error


def _manifest(work: Work, rows_per_part: int, parts: int) -> dict[str, Any]:
    hand = work.recipe.hand
    return {
        "graspforce": metadata.version("graspforce"),
        "rows_per_part": rows_per_part,
        "layout": [work.files[0].layout, work.files[0].hints.contact_distance],
        "recipe": asdict(work.recipe) | {"hand": hand and fingerprint(Path(hand))},
        "source": {
            file.name: {"rows": file.rows, "fingerprint": file.fingerprint} for file in work.files
        },
        "columns": {field.name: str(field.type) for field in work.schema},
        "parts": parts,
    }
