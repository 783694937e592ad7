"""Fig. 8: the friction residual while four fingers carry the cube (Section IV-B.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce.scenarios import Log
from graspforce.study.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = 8
SOURCE = "dynamic"
TITLE = "Friction residual, four fingers carry the cube round a circle"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 8 shows.

    Attributes:
        t: shape (T,) [s].
        friction_residual: r_f of Eq. (22), shape (T,) [N²].
    """

    t: Array
    friction_residual: Array


def data(source: Log) -> Data:
    """Return the figure's arrays from the dynamic scenario."""
    return Data(source.t, source.friction_residual)


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    least, most = float(shown.friction_residual.min()), float(shown.friction_residual.max())
    return [
        Claim(
            paper="The friction residual stays safely above 0: no contact comes near to slipping.",
            measured=f"r_f is between {least:.2f} and {most:.2f} N².",
            numbers={"least r_f [N^2]": least, "largest r_f [N^2]": most},
            holds=least > 0,
        )
    ]


def draw(shown: Data) -> Figure:
    """Draw the figure."""
    figure, axes = style.time_axes("friction residual r$_f$ [N²]", shown.t)
    style.plot_residual(axes, shown.t, shown.friction_residual)
    return figure
