"""What there is to do, and the worker that does it part after part, the same in every engine."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from graspforce.datasets.arrow import pa
from graspforce.datasets.recipe import Recipe
from graspforce.datasets.schema import KNOWN
from graspforce.datasets.solving import PartSolver
from graspforce.datasets.sources import Chunk, Reader, SourceFile
from graspforce.datasets.target import Counts, Part, Target
from graspforce.errors import InvalidInputError


@dataclass(frozen=True)
class Work:
    """A data set to be solved; goes to workers on other machines.

    Attributes:
        files: of the source, as every machine reaches them.
        recipe: what to do with each row.
        target: the folder to write to, likewise.
        schema: of the target, a ``pyarrow.Schema``.
    """

    files: list[SourceFile]
    recipe: Recipe
    target: Path
    schema: Any

    @property
    def directions(self) -> int:
        """How many directions of gravity there are, for each row."""
        return 1 if self.recipe.directions is None else len(self.recipe.directions)

    def open_target(self) -> Target:
        """Return the target."""
        return Target(self.target, self.schema, self.directions)


class Failure(NamedTuple):
    """Why a part is not done.

    Attributes:
        text: what happened.
        unreadable: the source file cannot be read there; other files may be.
    """

    text: str
    unreadable: bool


class Worker:
    """Does parts, keeping the file that it reads open.

    Args:
        work: of which they are parts.
        threads: of each batch.
    """

    def __init__(self, work: Work, threads: int = 1) -> None:
        self._work, self._target = work, work.open_target()
        self._solver = PartSolver(work.recipe, work.schema, threads)
        self._file, self._reader = -1, None

    def read(self, part: Part) -> Chunk | Failure:
        """Return a part's rows; not to be called from two threads at once."""
        file = self._work.files[part.file]
        try:
            if self._reader is None or self._file != part.file:
                self.close()
                self._file, self._reader = part.file, file.open()
            return _read(self._reader, file, part, self._work.recipe)
        except (InvalidInputError, OSError) as error:
            self.close()
            return Failure(f"{file.path}: {' '.join(str(error).split())}", unreadable=True)

    def close(self) -> None:
        """Close the file that is open."""
        if self._reader is not None:
            self._reader.close()
        self._reader = None

    def finish(self, part: Part, chunk: Chunk) -> Counts | Failure:
        """Solve and write a part; from any thread."""
        name = self._work.files[part.file].name
        table, rejects = self._solver.solve(chunk, name)
        try:
            return self._target.write(part, name, table, rejects)
        except OSError as error:
            text = f"{error.filename}: {error.strerror}" if error.filename else str(error)
            return Failure(text, unreadable=False)

    def do_if_missing(self, part: Part) -> Counts | Failure:
        """Read, solve and write a part, unless it is there."""
        found = self._target.counts(part.number)
        if found is not None:
            return found
        chunk = self.read(part)
        return chunk if isinstance(chunk, Failure) else self.finish(part, chunk)


def _read(reader: Reader, file: SourceFile, part: Part, recipe: Recipe) -> Chunk:
    there = reader.schema.names
    wanted = [
        name
        for name in there
        if name in recipe.keys or (name in KNOWN and name not in recipe.values)
    ]
    chunk = reader.read(part.start, part.stop, wanted)
    table = chunk.table
    for name in recipe.keys:
        if name in file.partition:
            value = pa.scalar(file.partition[name], pa.string())
            table = table.append_column(name, pa.repeat(value, len(chunk.rows)))
    return Chunk(table, chunk.rows, chunk.rejects)
