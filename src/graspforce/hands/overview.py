"""A hand from a file of either kind, without being told its fingertips, and a picture of it."""

# matplotlib does not annotate its **kwargs, nor its 3-D toolkit at all.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspforce._util import plot
from graspforce.errors import ModelImportError
from graspforce.hands.imported import ImportedHand
from graspforce.hands.mujoco import hand as mjcf
from graspforce.hands.pinocchio import hand as urdf

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read_hand(
    path: str | Path,
    fingertips: Sequence[str] = (),
    tau_max: float | Mapping[str, float] | None = None,
) -> ImportedHand:
    """Read a hand from an MJCF file or a URDF, which its root element tells.

    Args:
        path: the file.
        fingertips: its fingertips; by default the last links of the chains that motors move.
        tau_max: as for :func:`graspforce.hands.from_mjcf`.

    Raises:
        ModelImportError: as the two readers; or nothing in the file moves.
        InvalidInputError: as the two readers.
    """
    if _root(path) == "robot":
        tips = tuple(fingertips) or urdf.default_fingertips(path)
        return urdf.from_urdf(path, _some(tips, path), tau_max)
    tips = tuple(fingertips) or mjcf.default_fingertips(path, tau_max)
    return mjcf.from_mjcf(path, _some(tips, path), tau_max)


def _root(path: str | Path) -> str:
    """Return the tag of a file's root element; empty where it is no XML, as the readers say."""
    try:
        for _, element in ElementTree.iterparse(path, events=("start",)):
            return element.tag
    except (OSError, ElementTree.ParseError):
        pass
    return ""


def _some(tips: Sequence[str], path: str | Path) -> Sequence[str]:
    if not tips:
        raise ModelImportError(
            f"{path}: nothing in it is moved by a motor; tau_max gives motors to joints"
        )
    return tips


def draw(hand: ImportedHand) -> Figure:
    """Draw the chains of joints to the fingertips with all angles 0, a line a finger.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure = plot.new_figure(height=4.8, width=6.4)
    axes: Any = figure.add_subplot(projection="3d")
    configuration = hand.robot.configuration(np.zeros(len(hand.q_names)))
    chains = {name: configuration.chain(link) for name, link in hand.fingertips.items()}
    for i, (name, chain) in enumerate(chains.items()):
        colour = plot.FINGERS[i % len(plot.FINGERS)]
        axes.plot(*chain.T, color=colour, linewidth=2)
        axes.scatter(*chain[:-1].T, color=plot.INK, s=14, depthshade=False)
        axes.scatter(*chain[-1:].T, color=colour, s=36, depthshade=False)
        axes.text(*chain[-1], f" {name}", color=colour)
    bases = np.array([chain[0] for chain in chains.values()])
    for base in bases:  # the palm, whose shape nobody here knows
        axes.plot(*np.array([bases.mean(axis=0), base]).T, color=plot.GREY, linewidth=1)
    places = np.vstack(list(chains.values()))
    low, high = places.min(axis=0), places.max(axis=0)
    room = max(0.1 * float((high - low).max()), 1e-3)
    axes.set(**{f"{axis}lim": (low[i] - room, high[i] + room) for i, axis in enumerate("xyz")})
    axes.set_box_aspect(high - low + 2 * room)
    axes.locator_params(nbins=4)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    return figure
