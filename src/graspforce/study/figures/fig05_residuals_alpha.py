"""Fig. 5: torque and friction residuals of the grasp at rest, against alpha (Section IV-A).

Both are normalised by their largest value over the range of alpha.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from graspforce._util import plot
from graspforce._util.arrays import Array
from graspforce._util.claim import Claim
from graspforce.scenarios import AlphaSweep
from graspforce.study.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = 5
SOURCE = "sweep"
TITLE = "Torque and friction residuals against α, the cube at rest"


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """What Fig. 5 shows.

    Attributes:
        alpha: shape (A,), ascending.
        torque_residual: r_tau, shape (A,) [N·m].
        friction_residual: r_f of Eq. (22), shape (A,) [N²].
        torque_normalised: r_tau by its largest value, shape (A,).
        friction_normalised: r_f by its largest value, shape (A,).
    """

    alpha: Array
    torque_residual: Array
    friction_residual: Array
    torque_normalised: Array
    friction_normalised: Array


def data(source: AlphaSweep) -> Data:
    """Return the figure's arrays from the sweep of alpha."""
    r_tau, r_f = source.torque_residual, source.friction_residual
    return Data(source.alpha, r_tau, r_f, r_tau / r_tau.max(), r_f / r_f.max())


def claims(shown: Data) -> list[Claim]:
    """Compare with what the paper says of this figure."""
    alpha, r_tau, r_f = shown.alpha, shown.torque_residual, shown.friction_residual
    share_tau, share_f = (_share_in_the_middle(alpha, r) for r in (r_tau, r_f))
    return [
        Claim(
            paper=(
                "Small α: large friction residual and small torque residual, a firm grasp "
                "with high torques."
            ),
            measured=f"At α = {alpha[0]:g}: r_f = {r_f[0]:.2f} N², r_τ = {r_tau[0]:.4f} N·m.",
            numbers={"r_f, firmest [N^2]": float(r_f[0]), "r_tau, firmest [N m]": float(r_tau[0])},
            holds=bool(r_f.argmax() == 0 and r_tau.argmin() == 0),
        ),
        Claim(
            paper="Large α: the torque residual rises at the cost of the friction residual.",
            measured=(
                f"At α = {alpha[-1]:g}: r_τ = {r_tau[-1]:.3f} N·m, r_f = {r_f[-1]:.3f} N². "
                "Both change in one direction throughout."
            ),
            numbers={
                "r_f, lightest [N^2]": float(r_f[-1]),
                "r_tau, lightest [N m]": float(r_tau[-1]),
            },
            holds=bool((np.diff(r_tau) > 0).all() and (np.diff(r_f) < 0).all()),
        ),
        Claim(
            paper="Most of the variation lies between α = 0.1 and α = 10.",
            measured=(
                f"{share_f:.0%} of the change of r_f and {share_tau:.0%} of that of r_τ lie there."
            ),
            numbers={"share of r_f's change": share_f, "share of r_tau's change": share_tau},
            holds=min(share_f, share_tau) > 0.5,
        ),
    ]


def _share_in_the_middle(alpha: Array, residual: Array) -> float:
    """Return the part of a monotone residual's whole change that is between 0.1 and 10."""
    inner = np.interp(np.log([0.1, 10.0]), np.log(alpha), residual)
    return float((inner[1] - inner[0]) / (residual[-1] - residual[0]))


def draw(shown: Data) -> Figure:
    """Draw the figure."""
    figure, axes = style.new_axes(
        "weight α of the limits against the cones", "residual / its largest value"
    )
    style.alpha_axis(axes)
    for i, (values, label) in enumerate(
        (
            (shown.torque_normalised, "torque residual r$_τ$"),
            (shown.friction_normalised, "friction residual r$_f$"),
        )
    ):
        style.plot_line(axes, shown.alpha, values, plot.FINGERS[i], plot.DASHES[i], label)
    axes.set_ylim(0, 1.05)
    plot.legend_above(axes)
    return figure
