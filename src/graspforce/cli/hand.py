"""``graspforce hand``: what is understood of a hand."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from graspforce.cli.terminal import printable, reporting, show
from graspforce.errors import GraspForceWarning, InvalidInputError

if TYPE_CHECKING:
    from rich.table import Table

    from graspforce.hands import ImportedHand

EXAMPLES = (
    "graspforce hand hand.xml",
    "graspforce hand hand.urdf --tip pad1 --tip pad2 --tau-max 0.7",
    "graspforce hand hand.xml --out hand.png",
)
PICTURES = (".png", ".svg", ".pdf")


def hand(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A hand: MJCF or URDF.")],
    tip: Annotated[
        list[str] | None,
        typer.Option(
            help="A fingertip's link; may be given several times.  [default: the last link of "
            "every chain that motors move]"
        ),
    ] = None,
    tau_max: Annotated[
        float | None, typer.Option(help="Limit of every motor in place of the file's [N·m, N].")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Draw it to this .png, .svg or .pdf; replaces a file."),
    ] = None,
) -> None:
    """Print what is understood of a hand: fingers, motors, limits, couplings, what is left out.

    Limits are those of the file, with the attribute that they come from, or of --tau-max. Below the
    tables each remark is a line: joints that follow others, limits that may be placeholders,
    motions that no motor controls.
    """
    from graspforce._util import plot
    from graspforce._util.atomic import atomic_write, check_writable
    from graspforce.hands import overview

    if out is not None:
        if out.suffix not in PICTURES:
            raise InvalidInputError(f"--out: got {out}, expected one of {', '.join(PICTURES)}")
        check_writable(out)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GraspForceWarning)  # they are among the notes
        read = overview.read_hand(file, tip or (), tau_max)
    with reporting(lambda: _report(read, file, tau_max)) as tell:
        if out is not None:
            kind = cast(Literal["png", "svg", "pdf"], out.suffix[1:])
            with atomic_write(out) as temporary:
                temporary.write_bytes(plot.render(overview.draw(read), kind))
            tell(f"The picture is in {out}")


def _report(read: ImportedHand, file: Path, tau_max: float | None) -> None:
    show(
        f"{file}: {len(read.fingers)} fingers, {len(read.joint_names)} motors; q holds "
        f"{len(read.q_names)} angles: {', '.join(read.q_names)}",
        _fingers(read), _motors(read, tau_max),
        *(read.notes or ("Nothing to remark: a motor a joint.",)),
    )  # fmt: skip


def _empty(*headings: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table


def _fingers(read: ImportedHand) -> Table:
    table = _empty("finger", "fingertip", "moved by")
    for name, motors in read.fingers.items():
        row = (name, read.fingertips[name], ", ".join(motors))
        table.add_row(*map(printable, row))
    return table


def _motors(read: ImportedHand, tau_max: float | None) -> Table:
    table = _empty("motor", "least", "most", "", "limit from")
    rows = zip(read.joint_names, read.tau_lo, read.tau_hi, read.robot.limits, strict=True)
    for name, lo, hi, (limit, source) in rows:
        told = source if tau_max is None else "--tau-max"
        table.add_row(printable(name), f"{lo:.4g}", f"{hi:.4g}", limit.unit, told or "the file")
    return table
