"""The command ``graspforce``: the library's main jobs from a terminal.

Thin: every command reads its arguments, calls the library, and prints a table. Exit codes: 0
when the job was done, infeasible grasps included; 2 when an argument or a file is wrong, or when
something cannot be written, standard output included, with one line on stderr that says which; 1
when nobody reads the output any more; 130, 143, … when a signal ended it.

A command is a file here, with its function, its EXAMPLES and what it prints, and a line below.
"""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from graspforce.cli import bench, compare, explain, hand, reproduce, scenario, simulate, solve
from graspforce.cli.process import as_command
from graspforce.cli.terminal import one_line_errors, show


class _Commands(TyperGroup):
    """The commands, whose errors are one line each."""

    def invoke(self, ctx: Any) -> Any:
        """Parse the arguments of a command and run it."""
        with one_line_errors():
            return super().invoke(ctx)


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    # Plain help and errors: they stay whole in a pipe, in a log and in a narrow terminal.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line; what ``graspforce`` and ``python -m graspforce`` call."""
    with as_command():
        app(prog_name="graspforce")


def _examples(*lines: str) -> str:
    """Return the end of a help text; the backspace keeps the lines from being joined."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


def _version(wanted: bool) -> None:
    if wanted:
        import graspforce

        show(f"graspforce {graspforce.__version__}")
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
    (explain.explain, explain.EXAMPLES),
    (hand.hand, hand.EXAMPLES),
    (scenario.scenario, scenario.EXAMPLES),
    (simulate.simulate, simulate.EXAMPLES),
    (reproduce.reproduce, reproduce.EXAMPLES),
    (bench.bench, bench.EXAMPLES),
    (compare.compare, compare.EXAMPLES),
):
    app.command(epilog=_examples(*examples))(command)
