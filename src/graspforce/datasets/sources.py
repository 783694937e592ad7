"""Sources: which files there are, how many rows each has, and reading some of them.

Every file is read as Arrow tables of consecutive rows, front to back, in bounded memory: a
:class:`Reader` keeps its place, so that the next rows cost no second look at those before.
"""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Protocol, cast
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from graspforce.datasets.arrow import pa, pq
from graspforce.datasets.schema import NUMBERS
from graspforce.errors import InvalidInputError, MissingExtraError

# Of a file's ends, what its fingerprint is made of [bytes]. A Parquet file ends in the statistics
# of all its columns.
_ENDS = 65536
# Rows of JSON Lines by which the types of keys are told.
_SAMPLE = 1000
# The buffer of each column that is read [bytes].
_BUFFER = 1 << 20
# What a partition's folder is called where the key is null.
_NULL_PARTITION = "__HIVE_DEFAULT_PARTITION__"


@dataclass(frozen=True)
class Chunk:
    """Rows that were read.

    Attributes:
        table: the good ones, a ``pyarrow.Table``.
        rows: their numbers in the file, shape (len(table),).
        rejects: numbers of the others, and what is wrong with each.
    """

    table: Any
    rows: NDArray[np.int64]
    rejects: list[tuple[int, str]]


@dataclass(frozen=True)
class Hints:
    """What a published layout leaves open; see :mod:`graspforce.datasets.layouts`.

    Attributes:
        hand: the file of the hand.
        tau_max: torque limit of its motors, where the file has none [N·m].
        meshes: folder of the objects' meshes.
        contact_distance: how far a link may be from the object and touch it [m].
    """

    hand: str | None = None
    tau_max: float | None = None
    meshes: str | None = None
    contact_distance: float = 0.005


class Reader(Protocol):
    """An open file of rows."""

    @property
    def rows(self) -> int:
        """How many there are."""
        ...

    @property
    def schema(self) -> Any:
        """Their columns, a ``pyarrow.Schema``."""
        ...

    def read(self, start: int, stop: int, columns: Sequence[str]) -> Chunk:
        """Return rows ``start`` to ``stop``; cheapest where they follow those read before.

        Raises:
            InvalidInputError: the file cannot be read there.
        """
        ...

    def close(self) -> None:
        """Close the file."""
        ...


@dataclass(frozen=True)
class SourceFile:
    """A file of a source.

    Attributes:
        path: where it is.
        name: its path relative to the source.
        rows: how many it has.
        columns: their names and types, a ``pyarrow.Schema``, those of its partition included.
        partition: keys that its folders tell, as ``hand=allegro/``.
        fingerprint: of its size and ends.
        layout: how to read it: its ending, or the name of a published layout.
        hints: what that leaves open.
    """

    path: Path
    name: str
    rows: int
    columns: Any
    partition: dict[str, str | None]
    fingerprint: str
    layout: str
    hints: Hints

    def open(self) -> Reader:
        """Open it.

        Raises:
            InvalidInputError: it cannot be read.
        """
        return _open(self.path, self.layout, self.hints)


def find_files(source: Path, layout: str | None, hints: Hints) -> list[SourceFile]:
    """Return the files of a source, a file or a folder, in the order of their names.

    Files and folders whose names begin with a dot or an underscore are left alone.

    Raises:
        InvalidInputError: nothing there, a file that cannot be read, no file that is one of rows.
    """
    endings = (".npy",) if layout is not None else tuple(READERS)
    if source.is_file():
        paths = [source]
    elif source.is_dir():
        paths = sorted(
            path
            for path in source.rglob("*")
            if path.suffix.lower() in endings
            and not any(part[0] in "._" for part in path.relative_to(source).parts)
            and path.is_file()
        )
    else:
        raise InvalidInputError(f"source: {source} does not exist")
    if not paths:
        raise InvalidInputError(f"source: {source} holds no file ending in {', '.join(endings)}")
    if paths[0].suffix.lower() not in endings:
        bare = paths[0].suffix.lower() == ".npy"
        hint = "; name its layout, bodex or dexgraspnet" if bare else ""
        raise InvalidInputError(
            f"source: got a file name ending in {paths[0].suffix!r}, expected one in "
            f"{', '.join(endings)}{hint}"
        )
    root = source if source.is_dir() else source.parent
    return [_source_file(path, _name(path.relative_to(root)), layout, hints) for path in paths]


def _name(path: Path) -> str:
    """Return a path as a text that UTF-8 has bytes for."""
    return path.as_posix().encode("utf-8", "backslashreplace").decode()


def _source_file(path: Path, name: str, layout: str | None, hints: Hints) -> SourceFile:
    kind = layout or path.suffix.lower()
    with closing(_open(path, kind, hints)) as reader:
        columns, rows = reader.schema, reader.rows
    names: list[str] = columns.names
    for each in names:
        if names.count(each) > 1:
            raise InvalidInputError(f"{path}: column {each!r}: it is there twice")
    partition: dict[str, str | None] = {}
    for folder in Path(name).parent.parts:
        key, equals, value = folder.partition("=")
        if equals and key not in columns.names:
            partition[key] = None if value == _NULL_PARTITION else unquote(value)
            columns = columns.append(pa.field(key, pa.string()))
    return SourceFile(path, name, rows, columns, partition, fingerprint(path), kind, hints)


def fingerprint(path: Path) -> str:
    """Return a text that another content of the file has not: of its size and its ends."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        for place in (0, max(0, size - _ENDS)):
            file.seek(place)
            digest.update(file.read(_ENDS))
    return f"{size}:{digest.hexdigest()[:32]}"


def _open(path: Path, kind: str, hints: Hints) -> Reader:
    try:
        if kind in READERS:
            return READERS[kind](path)
        from graspforce.datasets.layouts import LAYOUTS

        return LAYOUTS[kind](path, hints)
    except (OSError, pa.ArrowException, zipfile.BadZipFile, ValueError, EOFError) as error:
        if isinstance(error, InvalidInputError):
            raise InvalidInputError(f"{path}: {error}") from error
        raise InvalidInputError(f"{path}: cannot read the file: {error}") from error


def _all_rows(table: Any, start: int) -> Chunk:
    return Chunk(table, np.arange(start, start + len(table)), [])


# ---- Parquet -----------------------------------------------------------------------------------


class ParquetRows:
    """A Parquet file, of which as many rows are decoded as are read, whatever its row groups."""

    def __init__(self, path: Path) -> None:
        self._file = pq.ParquetFile(
            path, buffer_size=_BUFFER, pre_buffer=False, page_checksum_verification=True
        )
        self.schema: Any = self._file.schema_arrow
        self.rows: int = self._file.metadata.num_rows
        sizes = [
            self._file.metadata.row_group(i).num_rows for i in range(self._file.num_row_groups)
        ]
        self._ends = np.cumsum(np.array(sizes, dtype=np.int64))
        self._next = -1  # the row that the stream gives next
        self._stream: Iterator[Any] = iter(())
        self._left: list[Any] = []  # batches that were decoded and not yet given

    def read(self, start: int, stop: int, columns: Sequence[str]) -> Chunk:
        """See :class:`Reader`."""
        try:
            self._seek(start, stop - start, columns)
            batches = list(self._take(stop - start))
        except (OSError, pa.ArrowException) as error:
            self._next = -1
            raise InvalidInputError(f"cannot read rows {start} to {stop}: {error}") from error
        return _all_rows(pa.Table.from_batches(batches), start)

    def close(self) -> None:
        """See :class:`Reader`."""
        self._stream, self._left = iter(()), []
        self._file.close()

    def _seek(self, start: int, size: int, columns: Sequence[str]) -> None:
        group = int(np.searchsorted(self._ends, start, side="right"))
        first = int(self._ends[group - 1]) if group else 0
        if not max(self._next, first) <= start or self._next < first:
            groups = list(range(group, len(self._ends)))
            self._stream = self._file.iter_batches(size, row_groups=groups, columns=list(columns))
            self._next, self._left = first, []
        for _ in self._take(start - self._next):
            pass

    def _take(self, count: int) -> Iterator[Any]:
        while count > 0:
            batch = self._left.pop() if self._left else next(self._stream)
            if len(batch) > count:
                self._left.append(batch.slice(count))
                batch = batch.slice(0, count)
            self._next += len(batch)
            count -= len(batch)
            yield batch


# ---- NPZ and HDF5 ------------------------------------------------------------------------------


class _Stack(Protocol):
    """An array in a file, whose first axis are the rows."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def dtype(self) -> Any: ...
    def __getitem__(self, rows: slice) -> Any: ...


class _Stacks:
    """Arrays of one length."""

    def __init__(self, stacks: dict[str, _Stack], close: Callable[[], None]) -> None:
        self._stacks, self.close = stacks, close
        lengths = {name: stack.shape[0] for name, stack in stacks.items() if stack.shape}
        if not lengths:
            raise InvalidInputError("it holds no stack of rows")
        leading = next((name for name in ("W", "points") if name in lengths), next(iter(lengths)))
        self.rows = lengths[leading]
        for name, length in lengths.items():
            if length != self.rows and name in NUMBERS:
                raise InvalidInputError(
                    f"{name}: got {length} entries, expected {self.rows}, one for each in {leading}"
                )
        empty = {name: self._arrow(name, slice(0, 0)) for name in self._names(lengths)}
        self.schema: Any = pa.table(empty).schema

    def _names(self, lengths: dict[str, int]) -> list[str]:
        """Return the stacks of as many rows, and numbers for all rows that are of the format."""
        return [
            name for name, stack in self._stacks.items()
            if lengths.get(name) == self.rows or (not stack.shape and name in NUMBERS)
        ]  # fmt: skip

    def read(self, start: int, stop: int, columns: Sequence[str]) -> Chunk:
        """See :class:`Reader`."""
        try:
            arrays = {name: self._arrow(name, slice(start, stop)) for name in columns}
        except Exception as error:  # zipfile, zlib, NumPy and HDF5 have each their own
            raise InvalidInputError(f"cannot read rows {start} to {stop}: {error}") from error
        return _all_rows(pa.table(arrays), start)

    def _arrow(self, name: str, rows: slice) -> Any:
        stack = self._stacks[name]
        if not stack.shape:
            value = np.asarray(cast("Any", stack)[()])
            array: NDArray[Any] = np.broadcast_to(value, (rows.stop - rows.start,))
        else:
            array = np.asarray(stack[rows])
        if array.dtype.kind in "OSU":
            texts = np.char.decode(array) if array.dtype.kind == "S" else array
            kind = pa.string()
            for _ in array.shape[1:]:
                kind = pa.list_(kind)
            return pa.array([_text(each) for each in texts.tolist()], kind)
        if not array.dtype.isnative:
            array = array.astype(array.dtype.newbyteorder("="))
        if array.ndim > 3:
            raise InvalidInputError(
                f"{name}: got shape {stack.shape}, expected a stack of at most matrices"
            )
        made = pa.array(np.ascontiguousarray(array).ravel())
        for size in array.shape[:0:-1]:
            made = pa.FixedSizeListArray.from_arrays(made, size)
        return made


def _text(value: Any) -> Any:
    if isinstance(value, list):
        return [_text(each) for each in cast("list[Any]", value)]
    return value.decode() if isinstance(value, bytes) else str(value)


class NpzRows(_Stacks):
    """Stacked arrays in an NPZ archive, each read as a stream."""

    def __init__(self, path: Path) -> None:
        if not zipfile.is_zipfile(path):
            raise InvalidInputError("not an NPZ archive: empty, cut short, or of another kind")
        archive = zipfile.ZipFile(path)
        super().__init__(
            {
                name.removesuffix(".npy"): _NpyStream(archive, name)
                for name in archive.namelist()
                if name.endswith(".npy")
            },
            archive.close,
        )


class _NpyStream:
    """An array in an archive, rows of which are read front to back."""

    def __init__(self, archive: zipfile.ZipFile, name: str) -> None:
        self._archive, self._name = archive, name
        with archive.open(name) as file:
            self.shape, self._fortran, self.dtype = npy_header(cast("BinaryIO", file))
            self._offset = file.tell()
        if self.dtype.hasobject:
            raise InvalidInputError(f"{name}: it holds Python objects, which are never unpickled")
        if self._fortran and len(self.shape) > 1:
            raise InvalidInputError(
                f"{name}: its rows do not lie one after the other; save np.ascontiguousarray of it"
            )
        self._file: Any = None

    def __getitem__(self, rows: Any) -> Any:
        if self._file is None:
            self._file = self._archive.open(self._name)
        size = int(np.prod(self.shape[1:], dtype=np.int64)) * self.dtype.itemsize
        first, count = (0, 1) if rows == () else (rows.start, rows.stop - rows.start)
        self._file.seek(self._offset + first * size)
        data = self._file.read(count * size)
        if len(data) < count * size:
            raise EOFError("the array is cut short")
        shape = () if rows == () else (count, *self.shape[1:])
        return np.frombuffer(data, self.dtype).reshape(shape)


def npy_header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, whether in Fortran's order, and type of an array in NumPy's format."""
    version = np.lib.format.read_magic(file)
    read = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    return read(file)


class Hdf5Rows(_Stacks):
    """Stacked datasets at the root of an HDF5 file."""

    def __init__(self, path: Path) -> None:
        try:
            import h5py  # pyright: ignore[reportMissingTypeStubs]
        except ModuleNotFoundError as error:
            raise MissingExtraError(f"reading {path}", "h5py", "data") from error
        module: Any = h5py
        self._file = module.File(path, "r")
        super().__init__(
            {name: each for name, each in self._file.items() if isinstance(each, module.Dataset)},
            self._file.close,
        )


# ---- JSON Lines --------------------------------------------------------------------------------


class JsonRows:
    """A JSON object a line; a line that is none is a rejected row."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        ends, last = 0, b"\n"
        while block := self._file.read(1 << 20):
            ends, last = ends + block.count(b"\n"), block[-1:]
        self.rows = ends + (last != b"\n")
        self._next = 0
        self._file.seek(0)
        self.schema: Any = self._sampled()

    def close(self) -> None:
        """See :class:`Reader`."""
        self._file.close()

    def _sampled(self) -> Any:
        """Return the columns of the first rows, and leave the file at its beginning."""
        documents = [each for _, each in self._documents(0, min(self.rows, _SAMPLE))]
        good = [each for each in documents if isinstance(each, dict)]
        names = dict.fromkeys(name for each in good for name in each)
        self._file.seek(0)
        self._next = 0
        return pa.schema([self._field(name, [each.get(name) for each in good]) for name in names])

    @staticmethod
    def _field(name: str, values: list[Any]) -> Any:
        if name in NUMBERS:
            levels = Counter(_level(value) for value in values if value is not None)
            level = levels.most_common(1)[0][0] if levels else 0
            kind = pa.float64()
            for _ in range(max(level, 1 if levels[1] else 0)):
                kind = pa.list_(kind)
            return pa.field(name, kind)
        try:
            kind = pa.infer_type(values)
        except pa.ArrowException:
            kind = pa.string()
        return pa.field(name, pa.string() if pa.types.is_null(kind) else kind)

    def read(self, start: int, stop: int, columns: Sequence[str]) -> Chunk:
        """See :class:`Reader`."""
        rows: list[int] = []
        rejects: list[tuple[int, str]] = []
        values: dict[str, list[Any]] = {name: [] for name in columns}
        for row, document in self._documents(start, stop):
            try:
                if not isinstance(document, dict):
                    raise InvalidInputError(document)
                line = [self._value(name, document.get(name)) for name in columns]
            except InvalidInputError as error:
                rejects.append((row, str(error)))
                continue
            rows.append(row)
            for name, value in zip(columns, line, strict=True):
                values[name].append(value)
        arrays = {
            name: pa.array(each, self.schema.field(name).type) for name, each in values.items()
        }
        return Chunk(pa.table(arrays), np.array(rows, dtype=np.int64), rejects)

    def _documents(self, start: int, stop: int) -> Iterator[tuple[int, dict[str, Any] | str]]:
        """Yield rows with their objects, or with what is wrong with the line."""
        if start < self._next:
            self._file.seek(0)
            self._next = 0
        while self._next < stop:
            line, row = self._file.readline(), self._next
            self._next += 1
            if row < start:
                continue
            try:
                document = json.loads(line)
            except (ValueError, RecursionError) as error:
                yield row, f"not JSON: {error}" if line.strip() else "an empty line"
                continue
            yield row, document if isinstance(document, dict) else "not a JSON object"

    def _value(self, name: str, value: Any) -> Any:
        """Return a value as its column's type has it.

        Raises:
            InvalidInputError: it does not fit.
        """
        field = self.schema.field(name)
        if value is None:
            return None
        if name not in NUMBERS:
            try:
                pa.array([value], field.type)
            except (pa.ArrowException, OverflowError) as error:
                raise InvalidInputError(f"{name}: expected {field.type}: {error}") from error
            return value
        level = _level(field.type)
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise InvalidInputError(f"{name}: got no regular list of numbers") from None
        if array.ndim > level or (array.ndim and array.ndim < level):
            raise InvalidInputError(
                f"{name}: got lists {array.ndim} deep, expected {level}, as in the first rows"
            )
        return array.tolist() if array.ndim == level else _wrapped(array.tolist(), level)


def _level(value: Any) -> int:
    """Return how many lists deep a value or an Arrow type is."""
    if isinstance(value, list):
        return 1 + max(map(_level, cast("list[Any]", value)), default=0)
    inner = getattr(value, "value_type", None)
    return 0 if inner is None else 1 + _level(inner)


def _wrapped(value: Any, level: int) -> Any:
    for _ in range(level):
        value = [value]
    return value


READERS: dict[str, Callable[[Path], Reader]] = {
    ".parquet": ParquetRows,
    ".pq": ParquetRows,
    ".npz": NpzRows,
    ".h5": Hdf5Rows,
    ".hdf5": Hdf5Rows,
    ".jsonl": JsonRows,
    ".ndjson": JsonRows,
}
