"""A picture of how far a grasp's forces use up its limits, finger by finger and joint by joint."""

# matplotlib does not annotate its **kwargs.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from graspforce._util import plot
from graspforce._util.arrays import Array
from graspforce.answers.wishes import slip_reserves, torque_reserves
from graspforce.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BAR = 0.26  # height of a bar [inch]
_MOST = 2.0  # where a bar is cut off


def usage(
    solution: Solution, fingers: tuple[str, ...], joints: tuple[str, ...]
) -> list[tuple[str, float]]:
    """Return how much of each limit is used, 1 for all of it: names and shares.

    Args:
        solution: any with forces; those for the nearest wrench use some limits up.
        fingers: names of the n contacts.
        joints: names of the n_joints joints.
    """
    problem = solution.problem
    parts = [(f"friction, {each}" for each in fingers)]
    shares: list[Array] = [1 - slip_reserves(problem, solution.c)]
    if problem.layout.ceilings:
        with np.errstate(divide="ignore", invalid="ignore"):
            shares.append(solution.normal_forces / (problem.engagement * problem.c_max))
        parts.append(f"ceiling, {each}" for each in fingers)
    shares.append(1 - torque_reserves(problem, solution.tau))
    parts.append(f"torque, {each}" for each in joints)
    names = [name for part in parts for name in part]
    values = np.concatenate(shares)
    return [(n, float(v)) for n, v in zip(names, values, strict=True) if np.isfinite(v)]


def draw(solution: Solution, fingers: tuple[str, ...], joints: tuple[str, ...]) -> Figure:
    """Draw the shares as bars, those above 100 % in another colour."""
    names, shares = zip(*usage(solution, fingers, joints), strict=True)
    figure = plot.new_figure(height=_BAR * len(names) + 0.8)
    axes: Any = figure.subplots()
    plot.style_axes(axes, "used of the limit [%]", "")
    colours = [plot.FINGERS[1] if share > 1 else plot.FINGERS[0] for share in shares]
    shown = np.clip(shares, 0, _MOST)
    axes.barh(names, 100 * shown, color=colours, height=0.7)
    axes.axvline(100, color=plot.INK, linewidth=1)
    axes.set_xlim(0, max(110.0, 105 * float(shown.max())))
    axes.invert_yaxis()
    return figure
