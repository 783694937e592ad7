"""A run of the benchmark as a picture: medians and 99th percentiles on a logarithmic axis."""

# matplotlib does not annotate its **kwargs.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from pathlib import Path
from typing import Any

from graspforce._util import plot
from graspforce._util.atomic import atomic_write
from graspforce.study.bench import peers
from graspforce.study.bench.measurement import Run

_ROW, _REST = 0.24, 1.2  # [inch]


def draw(run: Run, path: Path) -> None:
    """Write the picture; the suffix of the path decides on its kind.

    Raises:
        MissingExtraError: matplotlib is missing.
        OSError: the file cannot be written; what it held before is still there.
    """
    lines: list[tuple[str, float, float, str] | str] = []
    group = None
    for row in run.rows:
        if row.group != group:
            lines.append(row.group)
            group = row.group
        others = row.group == peers.GROUP and row.name != peers.OWN
        lines.append((row.name, row.p50, row.p99, plot.GREY if others else plot.FINGERS[0]))
    figure = plot.new_figure(height=_ROW * len(lines) + _REST, width=9.0)
    axes = figure.add_subplot()
    for index, line in enumerate(lines):
        if isinstance(line, str):
            continue
        _, p50, p99, colour = line
        axes.plot([p50, max(p99, p50)], [index, index], color=colour, linewidth=1.2)
        axes.plot(p50, index, "o", color=colour, markersize=4.5)
        digits = f"{p50:.0f}" if p50 >= 100 else f"{p50:.3g}"
        axes.text(1.15 * max(p99, p50), index, digits, va="center", fontsize=7, color=colour)
    axes.set_yticks(
        range(len(lines)), [line if isinstance(line, str) else line[0] for line in lines]
    )
    for label, line in zip(axes.get_yticklabels(), lines, strict=True):
        label.set_fontsize(7.5)
        label.set_fontweight("bold" if isinstance(line, str) else "normal")
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlabel("time [µs]: dot p50, line to p99")
    axes.grid(axis="x", which="major", color=plot.LIGHT)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    kind: Any = path.suffix[1:].lower()
    with atomic_write(path) as temporary:
        temporary.write_bytes(plot.render(figure, kind))
