"""``graspforce reproduce``: Section IV of the paper, with a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from graspforce.cli.terminal import show, stage_bars

EXAMPLES = (
    "graspforce reproduce",
    "graspforce reproduce --out results",
)


def reproduce(
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where the figures, numbers and report go.")
    ] = Path("results"),
) -> None:
    """Run Section IV of the paper, also in physics: figures 4 to 12, results.json, report.html.

    Needs the extras 'figures' and 'sim': in a checkout, pip install '.[figures,sim]'.
    """
    from graspforce.study import report

    with stage_bars() as progress:
        page = report.reproduce(out, progress)
    show(f"The report is {page}", wrap=False)
