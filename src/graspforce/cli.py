"""The command ``graspforce``: the library's main jobs from a terminal.

Thin: every command reads its arguments, calls the library, and prints a table. Exit codes: 0
when the job was done, infeasible grasps included; 2 when an argument or a file is wrong, with
one line on stderr that says which.

A new command is one more function below, under ``@app.command()``.
"""

from __future__ import annotations

import io
import sys
from collections import Counter
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from graspforce.files import NamedProblem, NamedSolution
    from graspforce.solution import Solution

Item = TypeVar("Item")

# Grasps without an answer whose message is printed below the table; all are in --out.
MESSAGES = 5

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    # Plain help and errors: they stay whole in a pipe, in a log and in a narrow terminal.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line; what ``graspforce`` and ``python -m graspforce`` call."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A name that the terminal's encoding lacks must not cost the table.
        sys.stdout.reconfigure(errors="replace")
    app(prog_name="graspforce")


def _version(wanted: bool) -> None:
    if wanted:
        import graspforce

        typer.echo(f"graspforce {graspforce.__version__}")
        raise typer.Exit


@app.callback()
def _graspforce(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print and exit.")
    ] = False,
) -> None:
    """Grasp forces for multi-fingered hands, by the Weighted Barrier Function method.

    \b
    Examples:
      graspforce solve examples/nose_cone.json
      graspforce solve grasps.npz --alpha 1 --out forces.csv
      graspforce scenario dynamic
    """


@app.command()
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
    """Solve every grasp in FILE: contact forces, or the verdict that there are none.

    The table shows, for each grasp that is solved, the largest normal force, the smallest
    distance to slipping, mu n − |tangential force|, the smallest distance of a joint torque to
    its limit, and the Newton steps. Infeasible grasps are listed as such, and are no error.

    \b
    Examples:
      graspforce solve examples/nose_cone.json
      graspforce solve examples/several_grasps.json --out forces.json
      graspforce solve grasps.npz --alpha 1 --out forces.npz
      graspforce solve grasps.npz --c-max 20 --out forces.csv
    """
    with _one_line_errors():
        from graspforce import _arrays, files
        from graspforce.settings import Settings
        from graspforce.solve import solve as solve_problem

        given = {"alpha": alpha, "c_max": c_max}
        changes = {
            key: _arrays.as_positive(value, "--" + key.replace("_", "-"))
            for key, value in given.items()
            if value is not None
        }
        settings = Settings(tol=tol)
        if out is not None:
            files.check_output(out)
        grasps = _changed(files.read(file), changes, file)
        results = [
            files.NamedSolution(name, solve_problem(problem, settings))
            for name, problem in _progress(grasps, "solving")
        ]
        try:
            if out is not None:
                files.write(out, results)
        finally:
            _report(results)
        unused = files.unused_keys(file)
        if unused:
            typer.echo(f"Keys of {file} that were not read: {', '.join(unused)}")
        if out is not None:
            typer.echo(f"Everything about them is in {out}")


@contextmanager
def _one_line_errors() -> Generator[None]:
    """Turn what the caller can put right into one line on stderr and exit code 2."""
    from graspforce.errors import GraspForceError

    try:
        yield
    except (GraspForceError, OSError) as error:
        typer.echo(f"graspforce: {error}", err=True)
        raise typer.Exit(2) from error


def _changed(
    grasps: list[NamedProblem], changes: dict[str, float], file: Path
) -> list[NamedProblem]:
    """Return the grasps with the options of the command line in place of the file's."""
    from graspforce.files import NamedProblem
    from graspforce.files.named import place

    changed: list[NamedProblem] = []
    for index, (name, problem) in enumerate(grasps):
        with place(f"{file}: grasp {index} {name!r}"):
            changed.append(NamedProblem(name, problem.replace(**changes)))
    return changed


# ---- what is printed ---------------------------------------------------------------------------


def _console() -> Console:
    """Return stdout's console; in a pipe nothing is wrapped or cut to a width."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 10_000)


def _progress(items: Sequence[Item], what: str) -> Iterable[Item]:
    """Go through the items with a progress bar on stderr, shown only on a terminal."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(items, what, console=console, transient=True, disable=not console.is_terminal)


def _report(results: list[NamedSolution]) -> None:
    """Print the table, the messages of grasps without an answer, and the counts."""
    from rich.text import Text

    console = _console()
    console.print(_table(results))
    failed = [(name, solution) for name, solution in results if solution.status != 0]
    for name, solution in failed[:MESSAGES]:
        console.print(Text(f"{_printable(name)}: {solution.message}"))
    if len(failed) > MESSAGES:
        console.print(f"… and {len(failed) - MESSAGES} more without an answer")
    counts = Counter(_words(solution) for _, solution in results)
    grasps = "1 grasp" if len(results) == 1 else f"{len(results)} grasps"
    console.print(f"{grasps}: {', '.join(f'{n} {what}' for what, n in counts.most_common())}")


def _table(results: list[NamedSolution]) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("#", justify="right")
    table.add_column("grasp", overflow="fold")
    table.add_column("status", overflow="fold")
    for heading in ("largest\nnormal [N]", "slip\nmargin [N]", "torque\nmargin [N·m]", "steps"):
        table.add_column(Text(heading), justify="right", overflow="fold")
    for index, (name, solution) in enumerate(results):
        solved = solution.status == 0
        numbers = ["–", "–", "–"]
        if solved:
            numbers = [
                f"{solution.normal_forces.max():.4g}",
                f"{solution.friction_margins.min():.4g}",
                f"{solution.torque_residual:.4g}" if solution.problem.layout.joints else "–",
            ]
        table.add_row(
            str(index),
            Text(_printable(name)),
            Text(_words(solution), style="green" if solved else "red"),
            *numbers,
            str(solution.newton_steps),
        )
    return table


def _words(solution: Solution) -> str:
    return solution.status.name.lower().replace("_", " ")


def _printable(name: str) -> str:
    """Return a name on one line, without characters that steer a terminal."""
    return "".join(each if each.isprintable() else "�" for each in name)
