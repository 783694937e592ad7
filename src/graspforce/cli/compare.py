"""``graspforce compare``: every method of the paper on the same problems."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from graspforce.cli.terminal import reporting, show, stage_bars

EXAMPLES = (
    "graspforce compare regrasp --method wbf --method compact_dual",
    "graspforce compare grasps.npz --whole --out comparison",
    "graspforce compare",
)


def compare(
    task: Annotated[
        str | None,
        typer.Argument(
            metavar="[SCENARIO or FILE]",
            help="static, dynamic, regrasp or a file of grasps.  [default: the three scenarios]",
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(help="Run this method; may be given several times.  [default: all]"),
    ] = None,
    whole: Annotated[
        bool, typer.Option("--whole", help="Run the slow methods, too, on every problem.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write comparison.json and the plots there."),
    ] = None,
) -> None:
    """Run every method of the paper on the same problems and compare them.

    Times are medians of calls from Python on this machine, from scratch and, for methods that can,
    from the tick before. Slow methods run a part of the ticks. Methods whose package is not
    installed are listed with the pip line.
    """
    from graspforce._util.environment import describe_run
    from graspforce.study import compare as comparing
    from graspforce.study.compare import output

    if out is not None:
        output.prepare(out)
    tasks = comparing.SCENARIOS if task is None else (task,)
    with stage_bars() as progress:
        found = comparing.compare(tasks, method, whole, progress)

    def report() -> None:
        show(*(output.TaskTable(found, each.name) for each in found.tasks))
        for claim in found.claims():
            show(f"The paper: {claim.paper}", f"Measured:  {claim.measured}", "")

    with reporting(report) as tell:
        if out is not None:
            output.write(found, out, describe_run())
            tell(f"Everything about it is in {out}")
