"""What the figures of the paper are drawn with, beside the look that all plots share."""

# matplotlib does not annotate its **kwargs.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce._util.plot import DASHES, FINGERS, GREY, INK, legend_above, new_figure, style_axes
from graspforce.regrasp import is_removed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WARNING = "#b3261e"


def new_axes(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes, labelled and dressed."""
    figure = new_figure()
    axes = figure.add_subplot()
    style_axes(axes, x_label, y_label)
    return figure, axes


def alpha_axis(axes: Axes) -> None:
    """Make the horizontal axis logarithmic, its decades written out as numbers."""
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def time_axes(y_label: str, t: Array) -> tuple[Figure, Axes]:
    """Return a figure whose horizontal axis is the time, to the end of the last tick."""
    figure, axes = new_axes("time [s]", y_label)
    until_end(axes, t)
    return figure, axes


def until_end(axes: Axes, t: Array) -> None:
    """Let the time axis begin at the first of the ticks t [s] and end with the last one."""
    axes.set_xlim(float(t[0]), float(2 * t[-1] - t[-2]))


def plot_line(
    axes: Axes, x: Array, y: Array, colour: str = INK, dash: Any = "-", label: str = ""
) -> None:
    """Draw y over x, shapes (T,), with a name for the legend."""
    axes.plot(x, y, color=colour, linestyle=dash, linewidth=1.9, label=label)


def plot_fingers(axes: Axes, x: Array, normal_forces: Array) -> None:
    """Draw one line a finger, always in its own colour and dash, with the legend above.

    Args:
        axes: where.
        x: shape (T,).
        normal_forces: shape (T, n) with n at most 4 [N].
    """
    for finger, (forces, colour, dash) in enumerate(
        zip(normal_forces.T, FINGERS, DASHES, strict=True), 1
    ):
        plot_line(axes, x, forces, colour, dash, f"finger {finger}")
    axes.set_ylim(0, 1.08 * float(normal_forces.max()))
    legend_above(axes)


def plot_against_limit(axes: Axes, t: Array, max_torque: Array, limit: float) -> None:
    """Draw the largest joint torque over time below its limit.

    Args:
        axes: where.
        t: shape (T,) [s].
        max_torque: shape (T,) [N·m].
        limit: of every joint [N·m].
    """
    plot_line(axes, t, max_torque)
    axes.axhline(limit, color=WARNING, linewidth=1.2, linestyle=(0, (5, 2)))
    axes.annotate(
        "torque limit", (1, limit), (-4, -4), xycoords=("axes fraction", "data"),
        textcoords="offset points", ha="right", va="top", color=WARNING,
    )  # fmt: skip
    axes.set_ylim(0, 1.12 * limit)


def plot_residual(axes: Axes, t: Array, friction_residual: Array) -> None:
    """Draw the friction residual over time above zero, where a contact would slip.

    Args:
        axes: where.
        t: shape (T,) [s].
        friction_residual: shape (T,) [N²].
    """
    plot_line(axes, t, friction_residual)
    least, most = min(0.0, float(friction_residual.min())), float(friction_residual.max())
    axes.set_ylim(least - 0.07 * (most - least), 1.12 * most)
    axes.axhline(0, color=WARNING, linewidth=1.2, linestyle=(0, (5, 2)))
    axes.annotate(
        "slip", (1, 0), (-4, 4), xycoords=("axes fraction", "data"),
        textcoords="offset points", ha="right", va="bottom", color=WARNING,
    )  # fmt: skip


def shade_absence(axes: Axes, t: Array, engagement: Array, label: str = "") -> None:
    """Shade the times without a finger, and more lightly those when it lets go or comes back.

    Args:
        axes: where.
        t: shape (T,) [s].
        engagement: of that finger, shape (T,).
        label: written over the time without it; room is made above the data.
    """
    away = is_removed(engagement)
    for when, opacity in (((engagement < 1) & ~away, 0.45), (away, 1.0)):
        for start, end in _intervals(t, when):
            axes.axvspan(start, end, color="#e6eaef", alpha=opacity, linewidth=0, zorder=0)
    if label and away.any():
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.09 * (high - low))
        axes.text(
            float(t[away].mean()), 0.975, label, transform=axes.get_xaxis_transform(),
            ha="center", va="top", color=GREY,
        )  # fmt: skip


def _intervals(t: Array, when: np.ndarray[Any, np.dtype[np.bool_]]) -> list[tuple[float, float]]:
    """Return the stretches of t where ``when`` is true, each up to the tick that ends it."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], when, [False])).astype(int)))
    last = len(t) - 1
    return [
        (float(t[start]), float(t[min(end, last)]))
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]


def set_ticks(axes: Axes, ticks: Sequence[float]) -> None:
    """Put the vertical axis's ticks where they are wanted, all of them labelled."""
    axes.set_yticks(list(ticks), [f"{tick:g}" for tick in ticks])
