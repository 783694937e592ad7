"""One look for all figures: sizes, colours, axes, and how a figure becomes bytes.

The only place, with the draw functions that call it, where matplotlib is touched, and through its
objects alone: no pyplot, no global state, no display. The colours are Okabe and Ito's, which
people with any colour vision tell apart; the dashes tell the fingers apart in black and white.
"""

# matplotlib does not annotate its **kwargs.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from graspforce._arrays import Array
from graspforce.errors import MissingExtraError
from graspforce.regrasp import is_removed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FINGERS = ("#0072b2", "#d55e00", "#009e73", "#b0569a")
INK, GREY, LIGHT = "#1f2933", "#6b7785", "#dde2e8"
WARNING = "#b3261e"

DASHES: tuple[Any, ...] = ("-", (0, (6, 1.6)), (0, (5, 1.5, 1.2, 1.5)), (0, (1.6, 1.2)))
_WIDTH, _HEIGHT = 7.0, 3.7  # [inch]


def new_figure(height: float = _HEIGHT, width: float = _WIDTH) -> Figure:
    """Return an empty figure with a canvas of its own.

    Args:
        height: [inch].
        width: [inch].

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("drawing figures", "matplotlib", "figures") from error
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def new_axes(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes, labelled and dressed."""
    figure = new_figure()
    axes = figure.add_subplot()
    dress(axes, x_label, y_label)
    return figure, axes


def dress(axes: Axes, x_label: str, y_label: str) -> None:
    """Label the axes and take away what carries no information."""
    axes.set_xlabel(x_label, color=INK)
    axes.set_ylabel(y_label, color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.tick_params(colors=INK, which="both")
    axes.grid(color=LIGHT, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.margins(x=0)


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


def legend_above(axes: Axes) -> None:
    """Put the legend in one row above the axes, where it covers no data."""
    axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1), ncols=4, frameon=False, handlelength=3,
        borderaxespad=0.2, labelcolor=INK,
    )  # fmt: skip


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
        for start, end in _spans(t, when):
            axes.axvspan(start, end, color="#e6eaef", alpha=opacity, linewidth=0, zorder=0)
    if label and away.any():
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.09 * (high - low))
        axes.text(
            float(t[away].mean()), 0.975, label, transform=axes.get_xaxis_transform(),
            ha="center", va="top", color=GREY,
        )  # fmt: skip


def _spans(t: Array, when: np.ndarray[Any, np.dtype[np.bool_]]) -> list[tuple[float, float]]:
    """Return the stretches of t where ``when`` is true, each up to the tick that ends it."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], when, [False])).astype(int)))
    last = len(t) - 1
    return [
        (float(t[start]), float(t[min(end, last)]))
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]


def render(figure: Figure, kind: Literal["png", "svg", "pdf"]) -> bytes:
    """Return the figure as a file's bytes; the same figure gives the same bytes."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    # An SVG's ids are hashes of its content and this salt, instead of random numbers.
    with mpl.rc_context({"svg.hashsalt": "graspforce"}):
        metadata = {"Date": None} if kind == "svg" else {}
        figure.savefig(buffer, format=kind, dpi=200, metadata=metadata)
    return buffer.getvalue()


def set_ticks(axes: Axes, ticks: Sequence[float]) -> None:
    """Put the vertical axis's ticks where they are wanted, all of them labelled."""
    axes.set_yticks(list(ticks), [f"{tick:g}" for tick in ticks])
