"""Fig. 4: normal contact forces of the grasp at rest, against alpha (Section IV-A)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce.scenarios import AlphaSweep
from graspforce.study.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = 4
SOURCE = "sweep"
TITLE = "Normal forces against α, the cube at rest"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 4 shows.

    Attributes:
        alpha: shape (A,), ascending.
        normal_forces: shape (A, 4) [N].
    """

    alpha: Array
    normal_forces: Array


def data(source: AlphaSweep) -> Data:
    """Return the figure's arrays from the sweep of alpha."""
    return Data(source.alpha, source.normal_forces)


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    largest = shown.normal_forces.max(axis=1)
    firm, light = float(largest[0]), float(largest[-1])
    return [
        Claim(
            paper="Increasing α lowers the normal forces significantly: a much lighter grip.",
            measured=(
                f"Each finger's normal force falls at every step of α. The largest goes from "
                f"{firm:.2f} N at α = {shown.alpha[0]:g} to {light:.2f} N at "
                f"α = {shown.alpha[-1]:g}."
            ),
            numbers={"largest normal, firmest [N]": firm, "largest normal, lightest [N]": light},
            holds=bool((np.diff(shown.normal_forces, axis=0) < 0).all()),
        )
    ]


def draw(shown: Data) -> Figure:
    """Draw the figure."""
    figure, axes = style.new_axes("weight α of the limits against the cones", "normal force [N]")
    style.alpha_axis(axes)
    style.plot_fingers(axes, shown.alpha, shown.normal_forces)
    return figure
