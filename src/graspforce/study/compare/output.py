"""A comparison as a table in the terminal and as files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspforce._util import plot
from graspforce._util.atomic import atomic_write, check_writable, make_folder
from graspforce.study.compare import Comparison
from graspforce.study.compare.draw import draw_forces, draw_times
from graspforce.study.compare.measure import Measured

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console, ConsoleOptions, RenderResult
    from rich.table import Table

NAME = "comparison.json"

HEADINGS = (
    "ran", "cold\n[µs]", "warm\n[µs]", "iterations\ncold, warm", "kflop\na step", "kflop\na solve",
    "slip\nmargin\n[N]", "torque\nmargin\n[N·m]", "largest\nnormal\n[N]", "largest\njump\n[N]",
    "infeasible,\nunbounded", "fail-\nures",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class TaskTable:
    """The rows of a task for a terminal, in as many tables as it is too narrow for one.

    Args:
        found: what was measured.
        task: the task's name.
    """

    found: Comparison
    task: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the title, tables of as many columns as fit side by side, what is missing."""
        from rich.text import Text

        # Text is printed as it stands; brackets in a plain string would be taken for markup.
        yield Text(self.task, style="italic")
        wide = options.update(max_width=10_000)
        left = 0
        while left < len(HEADINGS):
            right = left + 1
            while right < len(HEADINGS):
                wider = self._columns(left, right + 1)
                if console.measure(wider, options=wide).maximum > options.max_width:
                    break
                right += 1
            yield self._columns(left, right)
            left = right
        for row in self._rows():
            if row.missing is not None:
                yield Text(f"{row.method}: {row.missing}", style="dim italic")

    def _rows(self) -> list[Measured]:
        return [row for row in self.found.rows if row.task == self.task]

    def _columns(self, left: int, right: int) -> Table:
        """Return a table of the methods and some of the columns under ``HEADINGS``."""
        from rich import box
        from rich.table import Table
        from rich.text import Text

        shown = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
        shown.add_column("method", no_wrap=True)
        for heading in HEADINGS[left:right]:
            shown.add_column(Text(heading), justify="right", overflow="fold")
        for row in self._rows():
            if row.missing is None:
                shown.add_row(row.method, *cells(row)[left:right])
        return shown


def cells(row: Measured) -> list[str]:
    """Return what stands under ``HEADINGS``; nothing for a method that is not installed."""
    if row.missing is not None:
        return []
    warm = None if row.warm_us is None else float(np.median(row.warm_us))
    steps = f"{row.iterations.mean():.1f}"
    if row.warm_iterations is not None:
        steps += f", {row.warm_iterations.mean():.1f}"
    return [
        f"{len(row.ran)} of {row.of}",
        _number(float(np.median(row.cold_us))),
        _number(warm),
        steps,
        _number(None if row.step_flops is None else row.step_flops / 1e3),
        _number(None if row.solve_flops is None else row.solve_flops / 1e3),
        _number(row.slip_margin, 2),
        _number(row.torque_margin, 2),
        _number(row.largest_normal),
        _number(row.largest_jump, 2),
        f"{row.infeasible}, {row.unbounded}",
        str(row.failures),
    ]


def _number(value: float | None, digits: int = 3) -> str:
    """Return a few digits; a dash for none, and no more than three zeros before them."""
    if value is None:
        return "–"
    if abs(value) >= 1000:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def prepare(folder: Path) -> None:
    """Make the folder, and find a missing matplotlib, before the work.

    Raises:
        InvalidInputError: it is no folder to write into, or holds something else by the name of the
            comparison.
        MissingExtraError: matplotlib is not installed.
    """
    plot.new_figure()
    check_writable(make_folder(folder, "out") / NAME)


def write(found: Comparison, folder: Path, about: dict[str, Any]) -> None:
    """Write ``comparison.json`` and, for each task, its plots, into a folder that exists.

    Args:
        found: what to write.
        folder: where to.
        about: date, machine and versions, for the head of the JSON.

    Raises:
        OSError: a file cannot be written; what it held before is still there.
    """
    with atomic_write(folder / NAME) as temporary:
        text = found.to_json(about)  # a file name may hold what UTF-8 has no bytes for
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
    for stem, picture in pictures(found).items():
        with atomic_write(folder / f"{stem}.png") as temporary:
            temporary.write_bytes(plot.render(picture, "png"))


def pictures(found: Comparison) -> dict[str, Figure]:
    """Return the plots by the stems of their files' names."""
    drawn: dict[str, Figure] = {}
    for task in found.tasks:
        # A name has at most 255 bytes, and this one gets longer.
        stem = os.fsdecode(os.fsencode(Path(task.name).stem)[:240])
        drawn[f"times_{stem}"] = draw_times(found, task.name)
        if task.t is not None:
            drawn[f"forces_{stem}"] = draw_forces(found, task.name)
    return drawn
