"""A comparison as a table in the terminal and as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspforce.compare import Comparison
from graspforce.compare.draw import draw_forces, draw_times
from graspforce.compare.measure import Measured
from graspforce.errors import InvalidInputError
from graspforce.figures import style
from graspforce.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

HEADINGS = (
    "ran", "cold\n[µs]", "warm\n[µs]", "iterations\ncold, warm", "kflop\na step", "kflop\na solve",
    "slip\nmargin\n[N]", "torque\nmargin\n[N·m]", "largest\nnormal\n[N]", "largest\njump\n[N]",
    "infeasible,\nunbounded", "fail-\nures",
)  # fmt: skip


def table(found: Comparison, task: str) -> Table:
    """Return the rows of a task as a table for the terminal."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    # Text is printed as it stands; brackets in a plain string would be taken for markup.
    shown = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title=Text(task),
                  title_justify="left", caption_justify="left")  # fmt: skip
    shown.add_column("method", no_wrap=True)
    for heading in HEADINGS:
        shown.add_column(Text(heading), justify="right", overflow="fold")
    missing: list[str] = []
    for row in found.rows:
        if row.task == task and row.missing is None:
            shown.add_row(row.method, *cells(row))
        elif row.task == task:
            missing.append(f"{row.method}: {row.missing}")
    shown.caption = Text("\n".join(missing)) if missing else None
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
        InvalidInputError: it is no folder to write into.
        MissingExtraError: matplotlib is not installed.
    """
    style.new_figure()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(
            f"out: got {folder}, expected a folder to write into ({error.strerror})"
        ) from error


def write(found: Comparison, folder: Path, about: dict[str, Any]) -> None:
    """Write ``comparison.json`` and, for each task, its plots, into a folder that exists.

    Args:
        found: what to write.
        folder: where to.
        about: date, machine and versions, for the head of the JSON.
    """
    with replacing(folder / "comparison.json") as temporary:
        temporary.write_text(found.to_json(about), encoding="utf-8")
    for stem, picture in pictures(found).items():
        with replacing(folder / f"{stem}.png") as temporary:
            temporary.write_bytes(style.render(picture, "png"))


def pictures(found: Comparison) -> dict[str, Figure]:
    """Return the plots by the stems of their files' names."""
    drawn: dict[str, Figure] = {}
    for task in found.tasks:
        stem = Path(task.name).stem
        drawn[f"times_{stem}"] = draw_times(found, task.name)
        if task.t is not None:
            drawn[f"forces_{stem}"] = draw_forces(found, task.name)
    return drawn
