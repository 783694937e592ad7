"""Fig. 7: the largest joint torque while four fingers carry the cube (Section IV-B.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce.scenarios import Log
from graspforce.study.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = 7
SOURCE = "dynamic"
TITLE = "Largest joint torque, four fingers carry the cube round a circle"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 7 shows.

    Attributes:
        t: shape (T,) [s].
        max_torque: the largest joint torque's size, shape (T,) [N·m].
        limit: of every joint [N·m].
    """

    t: Array
    max_torque: Array
    limit: float


def data(source: Log) -> Data:
    """Return the figure's arrays from the dynamic scenario."""
    return Data(source.t, source.max_torque, source.scenario.hand.tau_max)


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    least, most = float(shown.max_torque.min()), float(shown.max_torque.max())
    return [
        Claim(
            paper="All joints remain well below their torque limits.",
            measured=(
                f"The largest torque is between {least:.3f} and {most:.3f} N·m, at most "
                f"{most / shown.limit:.0%} of the limit of {shown.limit:g} N·m."
            ),
            numbers={"least [N m]": least, "most [N m]": most, "limit [N m]": shown.limit},
            holds=most < 0.75 * shown.limit,
        )
    ]


def draw(shown: Data) -> Figure:
    """Draw the figure."""
    figure, axes = style.time_axes("largest joint torque [N·m]", shown.t)
    style.plot_against_limit(axes, shown.t, shown.max_torque, shown.limit)
    return figure
