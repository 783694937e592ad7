"""``graspforce scenario``: a scenario of the paper, tick by tick."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from graspforce._engine.outcome import Status
from graspforce.cli.terminal import counts, progress_bar, reporting, show
from graspforce.errors import InvalidInputError

if TYPE_CHECKING:
    from graspforce.scenarios import Log

EXAMPLES = (
    "graspforce scenario dynamic",
    "graspforce scenario static --alpha 100 --out light.csv",
    "graspforce scenario regrasp --out results/regrasp.csv",
)


def scenario(
    name: Annotated[str, typer.Argument(metavar="NAME", help="static, dynamic or regrasp.")],
    alpha: Annotated[
        float | None,
        typer.Option(help="Weight of the limits: small is firm, large is light.  [default: 5]"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The CSV to write; replaces a file.  [default: NAME.csv in the current "
            "directory, which must not exist]"
        ),
    ] = None,
) -> None:
    """Run a scenario of the paper and write every tick to a CSV.

    Each holds the cube of Section IV with the paper's hand for 2 s at 250 Hz: at rest (static),
    round a circle (dynamic), round the circle with one finger away for a while (regrasp).
    """
    from graspforce import files, scenarios

    chosen = scenarios.get(name) if alpha is None else scenarios.get(name, alpha=alpha)
    path = out or Path(f"{name}.csv")
    files.check_output(path, (".csv",))
    if out is None and os.path.lexists(path):
        raise InvalidInputError(f"{path}: exists already; name it with --out to replace it")
    with progress_bar(len(chosen.times), name) as advance:
        log = scenarios.run(chosen, progress=lambda tick: advance(tick + 1))
    with reporting(lambda: _report_log(log)) as tell:
        log.write_csv(path)
        tell(f"Every tick is in {path}")


def _report_log(log: Log) -> None:
    """Print what a scenario's solved ticks have in common, and the counts."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("")
    table.add_column("least", justify="right", overflow="fold")
    table.add_column("most", justify="right", overflow="fold")
    solved = log.status == Status.SOLVED
    for what, values in (
        ("normal force [N]", log.normal_forces),
        ("largest joint torque [N·m]", log.max_torque),
        ("friction residual r_f [N²]", log.friction_residual),
        ("torque residual r_tau [N·m]", log.torque_residual),
        ("Newton steps", log.newton_steps),
    ):
        kept = values[solved]
        ends = [f"{kept.min():.4g}", f"{kept.max():.4g}"] if kept.size else ["–", "–"]
        table.add_row(what, *ends)
    one = int((log.newton_steps[solved] == 1).sum())
    ticks = counts("tick", (Status(each) for each in log.status))
    show(
        f"{log.scenario.name}: {log.scenario.summary}",
        table,
        f"{ticks}; {one} in one Newton step",
    )
