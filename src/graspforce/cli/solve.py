"""``graspforce solve``: the grasps in a file."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich import box
from rich.table import Table
from rich.text import Text

from graspforce._engine import native
from graspforce._engine.outcome import Status
from graspforce.cli.process import keep_freed_memory
from graspforce.cli.terminal import counts, printable, progress_bar, reporting, show, status_words
from graspforce.errors import InvalidInputError, error_context

if TYPE_CHECKING:
    from graspforce.columns import Columns
    from graspforce.files import NamedProblems, NamedSolutions
    from graspforce.solution import Solution


# Grasps without an answer whose message is printed below the table; all are in --out.
MESSAGES = 5
# More grasps than this get a summary in place of a row each.
SCREENFUL = 40
# Grasps with the least margins that a summary names.
TIGHTEST = 10
HEADINGS = ("largest\nnormal\n[N]", "slip\nmargin\n[N]", "torque\nmargin\n[N·m]", "steps")

EXAMPLES = (
    "graspforce solve examples/nose_cone.json",
    "graspforce solve examples/several_grasps.json --out forces.json",
    "graspforce solve grasps.npz --alpha 1 --out forces.npz",
    "graspforce solve grasps.npz --c-max 20 --out forces.csv",
)


def solve(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="Grasps: .json or .npz, see docs/file_formats.md."),
    ],
    alpha: Annotated[
        float | None,
        typer.Option(help="Weight of the limits for every grasp: small is firm, large is light."),
    ] = None,
    c_max: Annotated[
        float | None, typer.Option(help="Ceiling of every normal force of every grasp [N].")
    ] = None,
    tol: Annotated[float, typer.Option(help="Certified bound on decrement²/2 at the end.")] = 1e-9,
    out: Annotated[
        Path | None,
        typer.Option(help="Write everything to this .json, .npz or .csv; replaces a file."),
    ] = None,
    rows: Annotated[
        bool, typer.Option("--rows", help="Print a row for each grasp, however many there are.")
    ] = False,
) -> None:
    """Solve the grasps in FILE.

    The table shows, for each grasp that is solved, the largest normal force, the smallest
    distance to slipping, mu n − |tangential force|, the smallest distance of a joint torque to
    its limit, and the Newton steps. Infeasible grasps are listed as such, and are no error. Of more
    than 40 grasps it shows quantiles and the ten tightest instead.
    """
    from graspforce import files
    from graspforce._engine.settings import Settings
    from graspforce._util.arrays import as_positive

    given = {"alpha": alpha, "c_max": c_max}
    changes = {
        key: as_positive(value, "--" + key.replace("_", "-"))
        for key, value in given.items()
        if value is not None
    }
    settings = Settings(tol=tol)
    keep_freed_memory()
    if out is not None:
        files.check_output(out)
        if os.path.realpath(out) == os.path.realpath(file):
            raise InvalidInputError(f"--out: got {out}, the file of grasps itself")
    content = files.load(file)
    grasps = _changed(content.grasps, changes, file)
    with progress_bar(len(grasps), "solving") as advance:
        columns = grasps.problems.solve(settings, advance)
    results = files.NamedSolutions(grasps.names, columns)

    def report() -> None:
        _report(results, rows or len(results) <= SCREENFUL)
        if content.unused_keys:
            show(f"Keys of {file} that were not read: {', '.join(content.unused_keys)}")

    with reporting(report) as tell:
        if out is not None:
            files.write(out, results)
            tell(f"Everything about them is in {out}")


def _changed(grasps: NamedProblems, changes: dict[str, Any], file: Path) -> NamedProblems:
    """Return the grasps with the options of the command line in place of the file's."""
    from graspforce.files import NamedProblems

    if not changes:
        return grasps
    changed = NamedProblems(grasps.names, grasps.problems.replace(**changes))
    found = changed.problems.first_flaw()
    if found is not None:
        index, flaw = found
        with error_context(f"{file}: grasp {index} {changed.names[index]!r}"):
            native.refuse(flaw)
    return changed


def _report(results: NamedSolutions, rows: bool) -> None:
    """Print tables, the messages of grasps without an answer, and the counts."""
    columns = results.columns
    failed = np.flatnonzero(~columns.solved).tolist()
    lines = [
        f"{name if rows else f'{index} {name}'}: {solution.message}{_help(solution)}"
        for index, (name, solution) in ((each, results[each]) for each in failed[:MESSAGES])
    ]
    if len(failed) > MESSAGES:
        lines.append(f"… and {len(failed) - MESSAGES} more without an answer")
    numbers = _numbers(columns)
    if rows:
        tables = [_table(results, range(len(results)), columns, numbers)]
    else:
        slips = np.where(columns.solved, numbers[:, 1], np.inf)
        tightest = np.argsort(slips, kind="stable")[:TIGHTEST]
        tightest = tightest[columns.solved[tightest]].tolist()
        tables = [_quantiles(numbers), f"The {len(tightest)} that are nearest to slipping:",
                  _table(results, tightest, columns, numbers)] if tightest else []  # fmt: skip
    show(*tables, *lines, counts("grasp", columns.status.tolist()))


def _numbers(columns: Columns) -> NDArray[np.float64]:
    """Largest normal force, least slip margin, least torque margin, steps; NaN where not solved."""
    normals, margins = columns.normal_forces, columns.friction_margins
    shown = np.empty((len(columns), 4))
    shown[:, 0] = np.nanmax(normals, axis=1)
    shown[:, 1] = np.nanmin(margins, axis=1)
    shown[:, 2] = columns.torque_residual
    shown[:, 3] = columns.newton_steps
    shown[~columns.solved, :3] = np.nan
    return shown


def _help(solution: Solution) -> str:
    """Return what would help a grasp without an answer, to be added to its message."""
    from graspforce.answers.diagnosis import diagnose

    said = diagnose(solution).line
    return f"; {said}" if said else ""


def _quantiles(numbers: NDArray[np.float64]) -> Table:
    """What grasps that are solved have, from the least to the most."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("of the solved")
    for heading in HEADINGS:
        table.add_column(Text(heading), justify="right", overflow="fold")
    solved = numbers[np.isfinite(numbers[:, 0])]
    for share, name in ((0, "least"), (0.01, "1 %"), (0.5, "median"), (0.99, "99 %"), (1, "most")):
        # One of the numbers: there is no mean of a finite margin and an infinite one.
        row = np.quantile(solved, share, axis=0, method="inverted_cdf")
        table.add_row(name, *map(_written, row.tolist()))
    return table


def _written(number: float) -> str:
    return f"{number:.4g}" if np.isfinite(number) else "–"


def _table(
    results: NamedSolutions,
    indices: Iterable[int],
    columns: Columns,
    numbers: NDArray[np.float64],
) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("#", justify="right")
    table.add_column("grasp", overflow="fold")
    table.add_column("status", no_wrap=True)
    for heading in HEADINGS:
        table.add_column(Text(heading), justify="right", overflow="fold")
    for index in indices:
        status = Status(columns.status[index])
        *shown, steps = numbers[index].tolist()
        table.add_row(
            str(index),
            Text(printable(results.names[index])),
            Text(status_words(status), style="green" if status == Status.SOLVED else "red"),
            *map(_written, shown),
            str(int(steps)),
        )
    return table
