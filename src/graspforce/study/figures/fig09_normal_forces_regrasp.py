"""Fig. 9: normal contact forces while finger 1 lets go and comes back (Section IV-B.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce.regrasp import is_removed
from graspforce.scenarios import Log
from graspforce.study.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = 9
SOURCE = "regrasp"
TITLE = "Normal forces, finger 1 away from 0.5 to 1.5 s"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 9 shows.

    Attributes:
        t: shape (T,) [s].
        normal_forces: shape (T, 4) [N].
        engagement: of finger 1, w_1, shape (T,).
    """

    t: Array
    normal_forces: Array
    engagement: Array


def data(source: Log) -> Data:
    """Return the figure's arrays from the regrasp scenario."""
    return Data(source.t, source.normal_forces, source.engagement[:, 0])


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    away, whole = is_removed(shown.engagement), shown.engagement == 1
    with_it = shown.normal_forces[whole].mean(axis=0)
    without = shown.normal_forces[away].mean(axis=0)
    leaving, returning = (jump(shown, int(k)) for k in np.flatnonzero(np.diff(away)) + 1)
    return [
        Claim(
            paper="Forces are continuous, also while finger 1 is removed and re-engaged.",
            measured=(
                f"In the tick in which finger 1 leaves, the forces change {leaving:.1f} times as "
                "much as in the neighbouring ticks at most; in the tick in which it is back, "
                f"{returning:.1f} times."
            ),
            numbers={
                "change when leaving, relative": leaving,
                "change at return, relative": returning,
            },
            holds=max(leaving, returning) <= 5,
        ),
        Claim(
            paper="Without finger 1, finger 3, which opposes it, reduces its force.",
            measured=f"Mean {with_it[2]:.2f} N with finger 1, {without[2]:.2f} N without.",
            numbers={
                "finger 3, mean with [N]": float(with_it[2]),
                "finger 3, mean without [N]": float(without[2]),
            },
            holds=bool(without[2] < with_it[2]),
        ),
        Claim(
            paper="The other two fingers grip harder to keep the grasp stable.",
            measured=(
                f"Finger 2: mean {with_it[1]:.2f} N with finger 1, {without[1]:.2f} N without. "
                f"Finger 4: {with_it[3]:.2f} N and {without[3]:.2f} N."
            ),
            numbers={
                "finger 2, mean with [N]": float(with_it[1]),
                "finger 2, mean without [N]": float(without[1]),
                "finger 4, mean with [N]": float(with_it[3]),
                "finger 4, mean without [N]": float(without[3]),
            },
            holds=bool(without[1] > with_it[1] and without[3] > with_it[3]),
        ),
    ]


def jump(shown: Data, k: int) -> float:
    """Return the change of the normal forces at tick k over the largest among its neighbours.

    The neighbours are the three changes before and the three after; 1 is perfectly smooth.
    """
    change = np.linalg.norm(np.diff(shown.normal_forces, axis=0), axis=1)  # [i]: tick i to i + 1
    around = np.concatenate((change[k - 4 : k - 1], change[k : k + 3]))
    return float(change[k - 1] / around.max())


def draw(shown: Data) -> Figure:
    """Draw the figure."""
    figure, axes = style.time_axes("normal force [N]", shown.t)
    style.plot_fingers(axes, shown.t, shown.normal_forces)
    style.shade_absence(axes, shown.t, shown.engagement, "finger 1 away")
    return figure
