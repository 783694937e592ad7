"""One row of a benchmark, and a whole run of it as a file."""

from __future__ import annotations

import datetime
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce._util.atomic import atomic_write
from graspforce._util.environment import describe_machine
from graspforce.errors import InvalidInputError

PERCENTILES = (50.0, 99.0, 99.9)


@dataclass(frozen=True)
class Measurement:
    """The times of one thing.

    Args:
        group: the heading that it stands under.
        name: what was timed.
        times: every time [µs].
    """

    group: str
    name: str
    times: Array

    @property
    def percentiles(self) -> tuple[float, float, float]:
        """p50, p99 and p99.9 [µs]."""
        p50, p99, p999 = np.percentile(self.times, PERCENTILES)
        return float(p50), float(p99), float(p999)


@dataclass(frozen=True)
class Row:
    """What is kept of a measurement: percentiles [µs] and how many times there were."""

    group: str
    name: str
    p50: float
    p99: float
    p999: float
    count: int


@dataclass(frozen=True)
class Run:
    """All rows of a run with machine and date."""

    rows: tuple[Row, ...]
    machine: dict[str, Any] = field(default_factory=describe_machine)
    date: str = field(default_factory=lambda: datetime.date.today().isoformat())

    @classmethod
    def of(cls, measurements: Sequence[Measurement]) -> Run:
        """Return the percentiles of measurements that were just made here."""
        return cls(tuple(Row(m.group, m.name, *m.percentiles, len(m.times)) for m in measurements))

    def p50(self, group: str, name: str) -> float | None:
        """The median of a row [µs], None where there is no such row."""
        return next((r.p50 for r in self.rows if (r.group, r.name) == (group, name)), None)

    def save(self, path: Path) -> None:
        """Write the run as JSON.

        Raises:
            OSError: the file cannot be written; what it held before is still there.
        """
        content = {
            "machine": self.machine,
            "date": self.date,
            "rows": [vars(row) for row in self.rows],
        }
        with atomic_write(path) as temporary:
            text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
            temporary.write_text(text, encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Run:
        """Read a run that :meth:`save` wrote.

        Raises:
            InvalidInputError: there is no such file, or it is another kind of file.
        """
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            rows = tuple(Row(**row) for row in content["rows"])
            if not all(row.p50 > 0 for row in rows):
                raise ValueError("a time that is not positive")
            return cls(rows, content["machine"], content["date"])
        except OSError as error:
            raise InvalidInputError(f"{path}: cannot read it: {error.strerror}") from error
        except (ValueError, KeyError, TypeError) as error:
            raise InvalidInputError(
                f"{path}: expected a file that graspforce bench --save wrote"
            ) from error
