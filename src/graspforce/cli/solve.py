"""``graspforce solve``: the grasps in a file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graspforce._engine.outcome import Status
from graspforce.cli.terminal import counts, printable, progress_bar, reporting, show, status_words
from graspforce.errors import InvalidInputError, error_context

if TYPE_CHECKING:
    from rich.table import Table

    from graspforce.files import NamedProblem, NamedSolution
    from graspforce.solution import Solution


# Grasps without an answer whose message is printed below the table; all are in --out.
MESSAGES = 5

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
) -> None:
    """Solve the grasps in FILE.

    The table shows, for each grasp that is solved, the largest normal force, the smallest
    distance to slipping, mu n − |tangential force|, the smallest distance of a joint torque to
    its limit, and the Newton steps. Infeasible grasps are listed as such, and are no error.
    """
    from graspforce import files
    from graspforce._engine.settings import Settings
    from graspforce._util.arrays import as_positive
    from graspforce.solve import solve as solve_problem

    given = {"alpha": alpha, "c_max": c_max}
    changes = {
        key: as_positive(value, "--" + key.replace("_", "-"))
        for key, value in given.items()
        if value is not None
    }
    settings = Settings(tol=tol)
    if out is not None:
        files.check_output(out)
        if os.path.realpath(out) == os.path.realpath(file):
            raise InvalidInputError(f"--out: got {out}, the file of grasps itself")
    content = files.load(file)
    grasps = _changed(content.grasps, changes, file)
    results: list[NamedSolution] = []
    with progress_bar(len(grasps), "solving") as advance:
        for index, (name, problem) in enumerate(grasps):
            results.append(files.NamedSolution(name, solve_problem(problem, settings)))
            advance(index)

    def report() -> None:
        _report(results)
        if content.unused_keys:
            show(f"Keys of {file} that were not read: {', '.join(content.unused_keys)}")

    with reporting(report) as tell:
        if out is not None:
            files.write(out, results)
            tell(f"Everything about them is in {out}")


def _changed(grasps: list[NamedProblem], changes: dict[str, Any], file: Path) -> list[NamedProblem]:
    """Return the grasps with the options of the command line in place of the file's."""
    from graspforce.files import NamedProblem

    if not changes:
        return grasps
    changed: list[NamedProblem] = []
    for index, (name, problem) in enumerate(grasps):
        with error_context(f"{file}: grasp {index} {name!r}"):
            changed.append(NamedProblem(name, problem.replace(**changes)))
    return changed


def _report(results: list[NamedSolution]) -> None:
    """Print the table, the messages of grasps without an answer, and the counts."""
    failed = [
        (name, solution) for name, solution in results if solution.status is not Status.SOLVED
    ]
    lines = [f"{name}: {solution.message}{_help(solution)}" for name, solution in failed[:MESSAGES]]
    if len(failed) > MESSAGES:
        lines.append(f"… and {len(failed) - MESSAGES} more without an answer")
    show(_table(results), *lines, counts("grasp", (solution.status for _, solution in results)))


def _help(solution: Solution) -> str:
    """Return what would help a grasp without an answer, to be added to its message."""
    from graspforce.answers.diagnosis import diagnose

    said = diagnose(solution).line
    return f"; {said}" if said else ""


def _table(results: list[NamedSolution]) -> Table:
    import numpy as np
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from graspforce.solution.columns import Columns

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("#", justify="right")
    table.add_column("grasp", overflow="fold")
    table.add_column("status", no_wrap=True)
    for heading in ("largest\nnormal\n[N]", "slip\nmargin\n[N]", "torque\nmargin\n[N·m]", "steps"):
        table.add_column(Text(heading), justify="right", overflow="fold")
    columns = Columns(solution for _, solution in results)
    shown = np.column_stack(
        (
            np.nanmax(columns.normal_forces, axis=1),
            np.nanmin(columns.friction_margins, axis=1),
            columns.torque_residual,
        )
    )
    shown[~columns.solved] = np.nan
    rows = zip(results, columns.status, shown, columns.newton_steps, strict=True)
    for index, ((name, _), status, numbers, steps) in enumerate(rows):
        table.add_row(
            str(index),
            Text(printable(name)),
            Text(status_words(Status(status)), style="green" if status == Status.SOLVED else "red"),
            *(f"{number:.4g}" if np.isfinite(number) else "–" for number in numbers),
            str(steps),
        )
    return table
