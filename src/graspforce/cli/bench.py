"""``graspforce bench``: how fast this machine is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from graspforce.cli.terminal import reporting, show, status_line

if TYPE_CHECKING:
    from graspforce.study.bench import Run

EXAMPLES = (
    "graspforce bench",
    "graspforce bench --save before.json",
    "graspforce bench --compare before.json --plot bench.png",
)


def bench(
    save: Annotated[
        Path | None, typer.Option(help="Keep the run in this .json; replaces a file.")
    ] = None,
    compare: Annotated[
        Path | None, typer.Option(help="Show the medians of a kept run beside this one's.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the run: .png, .svg or .pdf.")] = None,
    effort: Annotated[int, typer.Option(min=1, help="Rounds of every measurement.")] = 20,
) -> None:
    """Time this machine: ticks, cold solves, growth with the contacts, other solvers.

    Every solver of the extra 'solvers' that is installed is timed on the same problems, and ECOS,
    Moreau and cvxpy where they are. Times are in microseconds.
    """
    from graspforce import files
    from graspforce.study import bench as benchmarks

    before = None if compare is None else benchmarks.Run.load(compare)
    for path, suffixes in ((save, (".json",)), (plot, (".png", ".svg", ".pdf"))):
        if path is not None:
            files.check_output(path, suffixes)
    with status_line("timing") as update:
        run = benchmarks.measure(effort, lambda done: update(f"timed: {done.group}, {done.name}"))
    with reporting(lambda: _report_run(run, before)) as tell:
        if save is not None:
            run.save(save)
            tell(f"The run is in {save}")
        if plot is not None:
            from graspforce.study.bench.plot import draw

            draw(run, plot)
            tell(f"The picture is {plot}")


def _report_run(run: Run, before: Run | None) -> None:
    """Print a benchmark's table, with the ratios to a run before it."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("µs")
    headings = ["p50", "p99", "p99.9", *([] if before is None else ["p50 before", "now / before"])]
    for heading in headings:
        table.add_column(heading, justify="right")
    group = None
    for row in run.rows:
        if row.group != group:
            table.add_section()
            table.add_row(row.group, style="bold")
            group = row.group
        cells = [f"{time:.2f}" for time in (row.p50, row.p99, row.p999)]
        if before is not None:
            then = before.p50(row.group, row.name)
            cells += ["–", "–"] if then is None else [f"{then:.2f}", f"{row.p50 / then:.2f}"]
        table.add_row(f"  {row.name}", *cells)
    machine = run.machine
    show(
        table,
        f"{machine['cpu']}, {machine['cores']} cores, Python {machine['python']}, "
        f"NumPy {machine['numpy']}, {run.date}",
    )
