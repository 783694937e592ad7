"""The look of all plots: sizes, colours, axes, and how a figure becomes bytes.

The only place, with the functions that draw, where matplotlib is touched, and through its objects
alone: no pyplot, no global state, no display. The colours are Okabe and Ito's, which people with
any colour vision tell apart; the dashes tell the fingers apart in black and white.
"""

# matplotlib does not annotate its **kwargs.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

from graspforce.errors import MissingExtraError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FINGERS = ("#0072b2", "#d55e00", "#009e73", "#b0569a")
INK, GREY, LIGHT = "#1f2933", "#6b7785", "#dde2e8"

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


def style_axes(axes: Axes, x_label: str, y_label: str) -> None:
    """Label the axes and take away what carries no information."""
    axes.set_xlabel(x_label, color=INK)
    axes.set_ylabel(y_label, color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.tick_params(colors=INK, which="both")
    axes.grid(color=LIGHT, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.margins(x=0)


def legend_above(axes: Axes) -> None:
    """Put the legend in one row above the axes, where it covers no data."""
    axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1), ncols=4, frameon=False, handlelength=3,
        borderaxespad=0.2, labelcolor=INK,
    )  # fmt: skip


def render(figure: Figure, kind: Literal["png", "svg", "pdf"]) -> bytes:
    """Return the figure as a file's bytes; the same figure gives the same bytes."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    # An SVG's ids are hashes of its content and this salt, instead of random numbers.
    with mpl.rc_context({"svg.hashsalt": "graspforce"}):
        metadata = {"Date": None} if kind == "svg" else {}
        figure.savefig(buffer, format=kind, dpi=200, metadata=metadata)
    return buffer.getvalue()
