"""Fig. 12: Newton iterations beside w_1(t) while finger 1 lets go and returns (Section IV-B.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from graspforce._util import plot
from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce.scenarios import Log
from graspforce.study.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = 12
SOURCE = "regrasp"
TITLE = "Newton iterations beside w₁, finger 1 away from 0.5 to 1.5 s"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 12 shows.

    Attributes:
        t: shape (T,) [s].
        newton_steps: shape (T,).
        engagement: of finger 1, w_1, shape (T,).
    """

    t: Array
    newton_steps: Array
    engagement: Array


def data(source: Log) -> Data:
    """Return the figure's arrays from the regrasp scenario."""
    return Data(source.t, source.newton_steps.astype(np.float64), source.engagement[:, 0])


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    steps, engagement = shown.newton_steps, shown.engagement
    ticks, one = len(steps), int((steps == 1).sum())
    # The cold start is not of the servo's doing; its two ticks are left out of the second claim.
    ramp = (engagement > 0) & (engagement < 1)
    low, high = (float(steps[ramp & part].mean()) for part in (engagement < 0.3, engagement >= 0.3))
    most = int(steps[2:].max())
    return [
        Claim(
            paper="In typical operation one Newton iteration is enough.",
            measured=(
                f"{one} of {ticks} ticks take one, {int((steps == 2).sum())} take two and "
                f"{int((steps > 2).sum())} more."
            ),
            numbers={
                "ticks": ticks,
                "ticks in one step": one,
                "ticks in two steps": int((steps == 2).sum()),
            },
            holds=one >= 0.9 * ticks,
        ),
        Claim(
            paper=(
                "When w_1 is very close to 0 the feasible region is small and more iterations are "
                "needed."
            ),
            measured=(
                f"During the ramps the mean is {low:.2f} steps below w_1 = 0.3 and {high:.2f} "
                f"above; the most is {most}; the cold start takes {steps[0]:.0f}."
            ),
            numbers={
                "mean steps, w_1 below 0.3": low,
                "mean steps, w_1 above 0.3": high,
                "most steps from the third tick on": most,
            },
            holds=low > high,
        ),
    ]


def draw(shown: Data) -> Figure:
    """Draw the figure: w_1 above, iterations below, one time axis."""
    figure = plot.new_figure(height=4.3)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1, 1.6))
    plot.style_axes(above, "", "w₁")
    style.plot_line(above, shown.t, shown.engagement, plot.FINGERS[0])
    above.set_ylim(-0.08, 1.12)
    style.set_ticks(above, (0, 0.5, 1))
    plot.style_axes(below, "time [s]", "Newton iterations")
    # The cold start is the first tick: its dot must not be cut by the axis.
    style.until_end(below, shown.t)
    below.set_xlim(left=-0.015)
    below.plot(
        shown.t, shown.newton_steps, color=plot.FINGERS[1], marker=".", markersize=4.5,
        linewidth=0.6,
    )  # fmt: skip
    most = int(shown.newton_steps.max())
    below.set_ylim(0, most + 0.6)
    style.set_ticks(below, range(most + 1))
    for axes in (above, below):
        style.shade_absence(axes, shown.t, shown.engagement)
    above.text(1.0, 0.5, "finger 1 away", ha="center", va="center", color=plot.GREY)
    return figure
