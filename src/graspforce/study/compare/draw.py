"""Pictures of a comparison: the forces over time, method by method, and the times."""

# matplotlib does not annotate its **kwargs.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from graspforce._util import plot
from graspforce.study.compare import Comparison
from graspforce.study.compare.measure import Measured

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Where only a part of the ticks was run, a line would show values of ticks that were not.
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 4}


def draw_forces(found: Comparison, task: str) -> Figure:
    """Draw the normal forces over time, one panel a method; jumps show as vertical strokes.

    Args:
        found: what to draw.
        task: the name of a scenario in it.
    """
    chosen = next(each for each in found.tasks if each.name == task)
    rows = [row for row in found.rows if row.task == task and row.normal_forces is not None]
    figure = plot.new_figure(height=1.6 * max(1, len(rows)) + 0.6)
    panels: Any = figure.subplots(max(1, len(rows)), 1, sharex=True, squeeze=False)
    for axes, row in zip(panels[:, 0], rows, strict=True):
        plot.style_axes(axes, "", "normal force [N]")
        _fingers(axes, row, chosen.t)
        jump = "" if row.largest_jump is None else f": largest jump {row.largest_jump:.3g} N"
        axes.set_title(f"{row.method}{jump}", loc="left", fontsize="medium", color=plot.INK)
    if rows:
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=4, frameon=False)
    panels[-1, 0].set_xlabel("time [s]", color=plot.INK)
    return figure


def _fingers(axes: Any, row: Measured, t: Any) -> None:
    """Draw a line a finger; only single ticks as dots where a part of them was run."""
    times, whole = t[row.ran], len(row.ran) == row.of
    for finger, forces in enumerate(np.asarray(row.normal_forces).T):
        # Fingers that carry the same do not hide one another.
        line = {"drawstyle": "steps-post", "linewidth": 1.2, "linestyle": plot.DASHES[finger % 4]}
        look = line if whole else _DOTS
        axes.plot(
            times, forces, color=plot.FINGERS[finger % 4], label=f"finger {finger + 1}", **look
        )
    if row.largest_normal is not None:
        lowest = float(np.nanmin(np.asarray(row.normal_forces)))  # below zero a finger pulls
        axes.set_ylim(min(0.0, 1.08 * lowest), 1.08 * row.largest_normal)


def draw_times(found: Comparison, task: str) -> Figure:
    """Draw the median time of a cold and a warm solve of each method, on a logarithmic axis."""
    rows = [row for row in found.rows if row.task == task and len(row.ran)]
    figure = plot.new_figure(height=0.42 * len(rows) + 1.2)
    axes = figure.add_subplot()
    plot.style_axes(axes, "median time of a solve [µs]", "")
    axes.set_xscale("log")
    axes.margins(x=0.05)
    place = np.arange(len(rows))[::-1]
    axes.plot(
        [np.median(row.cold_us) for row in rows], place, "o", color=plot.FINGERS[0],
        label="from scratch",
    )  # fmt: skip
    warm = [(np.median(row.warm_us), y) for row, y in zip(rows, place, strict=True)
            if row.warm_us is not None]  # fmt: skip
    if warm:
        axes.plot(*zip(*warm, strict=True), "D", color=plot.FINGERS[1], mfc="none", label="warm")
    axes.set_yticks(place, [row.method for row in rows])
    plot.legend_above(axes)
    return figure
