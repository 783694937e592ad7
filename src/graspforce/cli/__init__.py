"""The command ``graspforce``: the library's main jobs from a terminal.

Thin: every command reads its arguments, calls the library, and prints a table. Exit codes: 0
when the job was done, infeasible grasps included; 2 when an argument or a file is wrong, with
one line on stderr that says which.

A command is a file here, with its function, its EXAMPLES and what it prints, and a line below.
"""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer

from graspforce.cli import bench, compare, reproduce, scenario, simulate, solve

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    # Plain help and errors: they stay whole in a pipe, in a log and in a narrow terminal.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line; what ``graspforce`` and ``python -m graspforce`` call."""
    reconfigure: Any = getattr(sys.stdout, "reconfigure", None)
    if reconfigure is not None:
        # A character that the terminal's encoding lacks must not cost the table.
        reconfigure(errors="replace")
    app(prog_name="graspforce")


def _examples(*lines: str) -> str:
    """Return the end of a help text; the backspace keeps the lines from being joined."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


def _version(wanted: bool) -> None:
    if wanted:
        import graspforce

        typer.echo(f"graspforce {graspforce.__version__}")
        raise typer.Exit


@app.callback(
    epilog=_examples(
        "graspforce solve examples/nose_cone.json",
        "graspforce solve grasps.npz --alpha 1 --out forces.csv",
        "graspforce scenario dynamic",
    )
)
def _graspforce(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print and exit.")
    ] = False,
) -> None:
    """Grasp forces for multi-fingered hands, by the Weighted Barrier Function method."""


for command, examples in (
    (solve.solve, solve.EXAMPLES),
    (scenario.scenario, scenario.EXAMPLES),
    (simulate.simulate, simulate.EXAMPLES),
    (reproduce.reproduce, reproduce.EXAMPLES),
    (bench.bench, bench.EXAMPLES),
    (compare.compare, compare.EXAMPLES),
):
    app.command(epilog=_examples(*examples))(command)
