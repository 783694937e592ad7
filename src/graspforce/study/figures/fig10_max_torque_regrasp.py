"""Fig. 10: the largest joint torque while finger 1 lets go and comes back (Section IV-B.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce.regrasp import is_removed
from graspforce.scenarios import Log
from graspforce.study.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = 10
SOURCE = "regrasp"
TITLE = "Largest joint torque, finger 1 away from 0.5 to 1.5 s"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 10 shows.

    Attributes:
        t: shape (T,) [s].
        max_torque: the largest joint torque's size, shape (T,) [N·m].
        limit: of every joint [N·m].
        engagement: of finger 1, w_1, shape (T,).
    """

    t: Array
    max_torque: Array
    limit: float
    engagement: Array


def data(source: Log) -> Data:
    """Return the figure's arrays from the regrasp scenario."""
    return Data(source.t, source.max_torque, source.scenario.hand.tau_max, source.engagement[:, 0])


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    with_it = float(shown.max_torque[shown.engagement == 1].mean())
    without = float(shown.max_torque[is_removed(shown.engagement)].mean())
    most = float(shown.max_torque.max())
    return [
        Claim(
            paper="Without finger 1, from 0.5 to 1.5 s, the largest joint torque is higher.",
            measured=(
                f"Mean {with_it:.3f} N·m with finger 1, {without:.3f} N·m without. "
                f"The peak is {most:.3f} N·m, {most / shown.limit:.0%} of the limit."
            ),
            numbers={
                "mean with [N m]": with_it,
                "mean without [N m]": without,
                "most [N m]": most,
            },
            holds=without > with_it and most < shown.limit,
        )
    ]


def draw(shown: Data) -> Figure:
    """Draw the figure."""
    figure, axes = style.time_axes("largest joint torque [N·m]", shown.t)
    style.plot_against_limit(axes, shown.t, shown.max_torque, shown.limit)
    style.shade_absence(axes, shown.t, shown.engagement, "finger 1 away")
    return figure
