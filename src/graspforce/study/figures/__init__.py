"""Figures 4 to 12 of the paper, one file a figure, and a picture of its grasp.

Each file has ``data`` (a scenario's log or the sweep of alpha in, arrays out), ``claims`` (what
the paper says of the figure beside what came out) and ``draw`` (only draws). One run of a
scenario serves every figure whose ``SOURCE`` it is:

>>> import graspforce as gf
>>> shown = gf.figures.fig04_normal_forces_alpha.data(gf.scenarios.sweep_alpha())
>>> figure = gf.figures.fig04_normal_forces_alpha.draw(shown)

Only ``draw`` needs matplotlib, of the extra ``figures``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from graspforce._util.claim import Claim
from graspforce.study.figures import (
    fig04_normal_forces_alpha,
    fig05_residuals_alpha,
    fig06_normal_forces_dynamic,
    fig07_max_torque_dynamic,
    fig08_friction_residual_dynamic,
    fig09_normal_forces_regrasp,
    fig10_max_torque_regrasp,
    fig11_friction_residual_regrasp,
    fig12_newton_steps,
    grasp_picture,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "FIGURES",
    "Claim",
    "PaperFigure",
    "fig04_normal_forces_alpha",
    "fig05_residuals_alpha",
    "fig06_normal_forces_dynamic",
    "fig07_max_torque_dynamic",
    "fig08_friction_residual_dynamic",
    "fig09_normal_forces_regrasp",
    "fig10_max_torque_regrasp",
    "fig11_friction_residual_regrasp",
    "fig12_newton_steps",
    "grasp_picture",
]


class PaperFigure(Protocol):
    """What the module of a figure offers."""

    @property
    def __name__(self) -> str:
        """The module's name; its last part names the figure's files."""
        ...

    @property
    def NUMBER(self) -> int:
        """The paper's number of the figure."""
        ...

    @property
    def SOURCE(self) -> str:
        """What ``data`` takes: the log of "dynamic" or "regrasp", or the "sweep" of alpha."""
        ...

    @property
    def TITLE(self) -> str:
        """One line."""
        ...

    def data(self, source: Any) -> Any:
        """Return the figure's arrays, a dataclass, from a log or the sweep of alpha."""
        ...

    def claims(self, shown: Any) -> list[Claim]:
        """Return what the paper says of the figure beside what ``data`` returned."""
        ...

    def draw(self, shown: Any) -> Figure:
        """Draw what ``data`` returned."""
        ...


FIGURES: tuple[PaperFigure, ...] = (
    fig04_normal_forces_alpha,
    fig05_residuals_alpha,
    fig06_normal_forces_dynamic,
    fig07_max_torque_dynamic,
    fig08_friction_residual_dynamic,
    fig09_normal_forces_regrasp,
    fig10_max_torque_regrasp,
    fig11_friction_residual_regrasp,
    fig12_newton_steps,
)
"""The modules of the figures, in the paper's order."""
