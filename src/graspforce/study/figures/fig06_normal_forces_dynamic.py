"""Fig. 6: normal contact forces while four fingers carry the cube (Section IV-B.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce.scenarios import Log
from graspforce.study.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = 6
SOURCE = "dynamic"
TITLE = "Normal forces, four fingers carry the cube round a circle"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 6 shows.

    Attributes:
        t: shape (T,) [s].
        normal_forces: shape (T, 4) [N].
        newton_steps: shape (T,).
    """

    t: Array
    normal_forces: Array
    newton_steps: Array


def data(source: Log) -> Data:
    """Return the figure's arrays from the dynamic scenario."""
    return Data(source.t, source.normal_forces, source.newton_steps.astype(np.float64))


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    least, most = float(shown.normal_forces.min()), float(shown.normal_forces.max())
    change = float(np.abs(np.diff(shown.normal_forces, axis=0)).max())
    steps = shown.newton_steps
    return [
        Claim(
            paper="Every finger pushes throughout, with smooth and continuous force profiles.",
            measured=(
                f"Normal forces between {least:.2f} and {most:.2f} N; from one tick to the next "
                f"none changes by more than {change:.3f} N."
            ),
            numbers={
                "least normal [N]": least,
                "largest normal [N]": most,
                "largest change in a tick [N]": change,
            },
            holds=least > 0 and change < 0.05 * most,
        ),
        Claim(
            paper="Each computation takes a single Newton iteration.",
            measured=(
                f"{int((steps == 1).sum())} of {len(steps)} ticks take exactly one, certified. "
                f"The first has no past and takes {steps[0]:.0f}, the second has one optimum and "
                f"takes {steps[1]:.0f}; from the third on, with two optima to extrapolate, the "
                f"most is {steps[2:].max():.0f}."
            ),
            numbers={
                "ticks": len(steps),
                "ticks in one step": int((steps == 1).sum()),
                "most steps from the third tick on": float(steps[2:].max()),
            },
            holds=bool((steps[2:] == 1).all()),
        ),
    ]


def draw(shown: Data) -> Figure:
    """Draw the figure."""
    figure, axes = style.time_axes("normal force [N]", shown.t)
    style.plot_fingers(axes, shown.t, shown.normal_forces)
    return figure
