"""Targets: a folder of Parquet files that is whole, or can be gone on with, at every moment.

Each part of the source becomes one file that takes its place in one rename; the part is done when
it is there. ``rejects/`` has the part's rejected rows, and is written before it. ``_manifest.json``
tells of what and by what the parts are made, and a run goes on only where that is the same.
``_summary.json`` is written last, from what the parts hold.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from graspforce._util.atomic import atomic_write, make_folder
from graspforce.datasets.arrow import pa, pq
from graspforce.errors import GraspForceError, InvalidInputError

# Names that begin with an underscore are no data to Arrow, Spark and DuckDB: the folder can be read
# as one table.
MANIFEST, SUMMARY, REJECTS = "_manifest.json", "_summary.json", "rejects"


class UnfinishedError(GraspForceError):
    """A run ended early; what is written is whole, and the same call goes on from there.

    Attributes:
        exit_code: of the command.
    """

    exit_code = 3


@dataclass
class Counts:
    """How many rows of a target are of each kind.

    Attributes:
        rows: rows of the source that are done, the rejected ones among them.
        rejected: those that make no problem.
        statuses: rows of the target by their status; with directions of gravity several for each
            row of the source.
        held: grasps that are SOLVED for every direction of gravity.
    """

    rows: int = 0
    rejected: int = 0
    statuses: Counter[str] = field(default_factory=Counter[str])
    held: int = 0

    @property
    def solved(self) -> int:
        """Rows of the target that are SOLVED."""
        return self.statuses["SOLVED"]

    def add(self, other: Counts) -> None:
        """Count more rows."""
        self.rows += other.rows
        self.rejected += other.rejected
        self.statuses.update(other.statuses)
        self.held += other.held


@dataclass(frozen=True)
class Summary:
    """What :func:`graspforce.datasets.solve_dataset` has done.

    Attributes:
        target: the folder.
        counts: of all rows of the target.
        parts: how many files there are.
        resumed: parts that an earlier run had written.
        seconds: the time this run took.
        solved_here: rows of the source that this run did.
        directions: of gravity, for each row.
    """

    target: Path
    counts: Counts
    parts: int
    resumed: int
    seconds: float
    solved_here: int
    directions: int = 1

    @property
    def rows_per_second(self) -> float:
        """Rows of the source a second in this run."""
        return self.solved_here / self.seconds if self.seconds > 0 else 0.0

    def __str__(self) -> str:
        counts = self.counts
        each = [
            f"{number:,} {name.lower().replace('_', ' ')}"
            for name, number in counts.statuses.most_common()
        ]
        lines = [
            f"{counts.rows:,} rows: {', '.join([*each, f'{counts.rejected:,} rejected'])}",
            f"{self.parts} part{'' if self.parts == 1 else 's'} in {self.target}"
            + (f", {self.resumed} of them from an earlier run" if self.resumed else ""),
            f"{self.solved_here:,} rows in {self.seconds:.1f} s, "
            f"{self.rows_per_second:,.0f} a second",
        ]
        if self.directions > 1:
            lines.insert(1, f"{counts.held:,} grasps hold for all {self.directions} directions")
        if counts.rejected:
            lines.append(f"Rejected rows, with reasons: {self.target / REJECTS}")
        return "\n".join(lines)


@dataclass(frozen=True)
class Part:
    """Consecutive rows of one source file, which become one file of the target."""

    number: int
    file: int
    start: int
    stop: int


class Target:
    """The folder that is written.

    Args:
        folder: where.
        schema: of its files.
        directions: of gravity, for each row.
    """

    def __init__(self, folder: Path, schema: Any, directions: int) -> None:
        self.folder, self.schema, self._directions = folder, schema, directions
        self._lock: Any = None

    def close(self) -> None:
        """Let others write the target."""
        if self._lock is not None:
            self._lock.close()

    def begin(self, manifest: Mapping[str, Any]) -> None:
        """Make the folder, or confirm that it was begun by the same manifest, and clean it up.

        Raises:
            InvalidInputError: it is something else, or begun otherwise.
        """
        # As JSON gives it back.
        manifest = json.loads(json.dumps(manifest))
        path = self.folder / MANIFEST
        if path.is_file():
            try:
                begun = json.loads(path.read_text(encoding="utf-8"))
            except ValueError as error:
                raise InvalidInputError(f"target: {path} is no manifest: {error}") from error
            self._require_same(begun, manifest)
            self._claim()
            for left in self.folder.rglob(".graspforce-*"):  # of a run that was killed
                shutil.rmtree(left, ignore_errors=True)
            return
        if self.folder.is_dir() and any(
            not each.name.startswith(".graspforce-") for each in self.folder.iterdir()
        ):
            raise InvalidInputError(
                f"target: {self.folder} is not empty and was not begun by this command; expected a "
                "new folder"
            )
        make_folder(self.folder, "target")
        _write_json(path, manifest)
        self._claim()

    def _claim(self) -> None:
        """Keep other runs on this machine from the target, until the end of this process at most.

        Raises:
            InvalidInputError: another run writes it.
        """
        try:
            import fcntl
        except ModuleNotFoundError:  # Windows
            return
        self._lock = (self.folder / MANIFEST).open("rb")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self.close()
            raise InvalidInputError(
                f"target: another run is writing to {self.folder}; wait until it has ended"
            ) from error
        except OSError:  # a file system without locks
            self.close()

    def _require_same(
        self, begun: Mapping[str, Any], now: Mapping[str, Any], where: str = ""
    ) -> None:
        for key in {**begun, **now}:
            before, after, name = begun.get(key), now.get(key), f"{where}{key}"
            if before == after:
                continue
            if isinstance(before, dict) and isinstance(after, dict):
                one, other = cast("tuple[dict[str, Any], dict[str, Any]]", (before, after))
                self._require_same(one, other, f"{name}: ")
                continue
            raise InvalidInputError(
                f"target: {self.folder} was begun with {name}: {_short(before)}, now "
                f"{_short(after)}; expected the same, or another folder"
            )

    def path(self, number: int) -> Path:
        """Return where a part is."""
        return self.folder / f"part-{number:06d}.parquet"

    def rejects_path(self, number: int) -> Path:
        """Return where the rejected rows of a part are, if there are any."""
        return self.folder / REJECTS / f"_part-{number:06d}.jsonl"

    def write(
        self, part: Part, file: str, table: Any, rejects: Sequence[tuple[int, str]]
    ) -> Counts:
        """Write a part, its rejects first, and return what it counts.

        Raises:
            OSError: it cannot be written; nothing of it is there.
        """
        if rejects:
            make_folder(self.folder / REJECTS, "target")
            lines = [
                json.dumps({"file": file, "row": row, "reason": reason}, ensure_ascii=False)
                for row, reason in rejects
            ]
            with atomic_write(self.rejects_path(part.number)) as path:
                path.write_text("\n".join(lines) + "\n", "utf-8", "backslashreplace")
        with atomic_write(self.path(part.number)) as path:
            # Forces have no two values alike, so that neither dictionaries nor compression gain.
            pq.write_table(
                table, path, compression="none", use_dictionary=["file", "status"],
                write_statistics=["file", "row", "status"],
            )  # fmt: skip
        return self._counts(table, len(rejects))

    def counts(self, number: int) -> Counts | None:
        """Return what a part counts; None where it is not done.

        Raises:
            InvalidInputError: the file cannot be read.
        """
        path = self.path(number)
        if not path.is_file():
            return None
        try:
            table = pq.read_table(path, columns=["status"], partitioning=None)
        except (OSError, pa.ArrowException) as error:
            raise InvalidInputError(
                f"target: cannot read {path}: {error}; delete it to have it made again"
            ) from error
        rejects = self.rejects_path(number)
        rejected = rejects.read_bytes().count(b"\n") if rejects.is_file() else 0
        return self._counts(table, rejected)

    def _counts(self, table: Any, rejected: int) -> Counts:
        status = table["status"].combine_chunks()
        found = {each["values"]: each["counts"] for each in status.value_counts().to_pylist()}
        held = 0
        if len(table):
            solved = status.cast(pa.string()).to_numpy(zero_copy_only=False) == "SOLVED"
            held = int(solved.reshape(-1, self._directions).all(axis=1).sum())
        rows = len(table) // self._directions + rejected
        return Counts(rows, rejected, Counter(found), held)

    def finish(self, counts: Counts) -> None:
        """Write the summary."""
        _write_json(
            self.folder / SUMMARY,
            {
                "rows": counts.rows,
                "rejected": counts.rejected,
                "statuses": dict(sorted(counts.statuses.items())),
                "held": counts.held,
            },
        )


def parts_of(rows: Sequence[int], size: int) -> Iterator[Part]:
    """Cut files of so many rows into parts of ``size``."""
    number = 0
    for file, count in enumerate(rows):
        for start in range(0, count, size):
            yield Part(number, file, start, min(start + size, count))
            number += 1


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", "utf-8")


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}…"
