"""``graspforce explain``: why a grasp has no answer, and what would help."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from graspforce._engine.outcome import Status
from graspforce.cli.terminal import reporting, show
from graspforce.errors import InvalidInputError

if TYPE_CHECKING:
    from rich.table import Table

    from graspforce.answers.diagnosis import Diagnosis

EXAMPLES = (
    "graspforce explain examples/several_grasps.json",
    "graspforce explain grasps.npz --grasp 7",
    "graspforce explain grasps.npz --grasp 7 --picture why.png",
)


def explain(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="Grasps: .json or .npz, see docs/file_formats.md."),
    ],
    grasp: Annotated[
        int | None,
        typer.Option(
            help="Its number in the table of graspforce solve.  [default: the first without an "
            "answer, or the first]"
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Draw how much of each limit is used, to this .png, .svg or .pdf; replaces a file."
        ),
    ] = None,
) -> None:
    """Say why a grasp in FILE has no answer, and what would help.

    Of a grasp that has one: how near its limits it is, and what it could spare. Each change that is
    named was tried, and is the least of its kind to a part in a hundred.
    """
    from graspforce import files
    from graspforce._util import plot
    from graspforce.answers import picture as pictures
    from graspforce.answers.diagnosis import default_names, diagnose
    from graspforce.solve import solve

    if picture is not None:
        files.check_output(picture, (".png", ".svg", ".pdf"))
    grasps = files.load(file).grasps
    if grasp is None:
        statuses = [solve(each.problem).status for each in grasps]
        grasp = next((i for i, s in enumerate(statuses) if s is not Status.SOLVED), 0)
    if not 0 <= grasp < len(grasps):
        raise InvalidInputError(
            f"--grasp: got {grasp}, expected 0 to {len(grasps) - 1}: {file} has {len(grasps)}"
        )
    name, problem = grasps[grasp]
    found = diagnose(problem)

    def report() -> None:
        show(f"{grasp} {name}: {found}")
        if found.binding:
            show(_table(found))

    with reporting(report) as tell:
        if picture is not None:
            figure = pictures.draw(found.solution, *default_names(problem))
            suffix = picture.suffix.lower().removeprefix(".")
            with files.atomic_write(picture) as temporary:
                temporary.write_bytes(plot.render(figure, suffix))  # pyright: ignore[reportArgumentType]
            tell(f"The picture is {picture}")


def _table(found: Diagnosis) -> Table:
    """Return every limit that binds, with a bar."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    spare = found.status is Status.SOLVED
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("nearly used up" if spare else "in conflict", overflow="fold")
    table.add_column("[%]", justify="right")
    table.add_column("", no_wrap=True)
    for each in found.binding:
        share = 100 * each.share
        table.add_row(Text(each.name), f"{share:.0f}", "█" * max(1, round(share / 4)))
    return table
