"""Fig. 11: the friction residual while finger 1 lets go and comes back (Section IV-B.2).

The minimum in r_f is over the fingers in the grasp. Finger 1 is one of them until it is removed,
and its part goes to zero with its force; that is not a contact about to slip under load.
"""

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

NUMBER = 11
SOURCE = "regrasp"
TITLE = "Friction residual, finger 1 away from 0.5 to 1.5 s"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 11 shows.

    Attributes:
        t: shape (T,) [s].
        friction_residual: r_f of Eq. (22), shape (T,) [N²].
        engagement: of finger 1, w_1, shape (T,).
    """

    t: Array
    friction_residual: Array
    engagement: Array


def data(source: Log) -> Data:
    """Return the figure's arrays from the regrasp scenario."""
    return Data(source.t, source.friction_residual, source.engagement[:, 0])


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    away = is_removed(shown.engagement)
    with_it = float(shown.friction_residual[shown.engagement == 1].mean())
    without = float(shown.friction_residual[away].mean())
    least_away = float(shown.friction_residual[away].min())
    least = float(shown.friction_residual.min())
    return [
        Claim(
            paper=(
                "The absence of finger 1 makes the grasp significantly less robust, whatever the "
                "other three do."
            ),
            measured=(
                f"Mean r_f is {with_it:.2f} N² with finger 1 and {without:.2f} N² without, "
                f"where the least is {least_away:.2f} N². In between it touches {least:.4f} N², "
                "because finger 1 counts until it is removed and its own part vanishes with its "
                "force."
            ),
            numbers={
                "mean r_f with [N^2]": with_it,
                "mean r_f without [N^2]": without,
                "least r_f without [N^2]": least_away,
                "least r_f [N^2]": least,
            },
            holds=without < 0.5 * with_it and least > 0,
        )
    ]


def draw(shown: Data) -> Figure:
    """Draw the figure."""
    figure, axes = style.time_axes("friction residual r$_f$ [N²]", shown.t)
    style.plot_residual(axes, shown.t, shown.friction_residual)
    style.shade_absence(axes, shown.t, shown.engagement, "finger 1 away")
    return figure
