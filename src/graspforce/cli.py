"""The command ``graspforce``: the library's main jobs from a terminal.

Thin: every command reads its arguments, calls the library, and prints a table. Exit codes: 0
when the job was done, infeasible grasps included; 2 when an argument or a file is wrong, with
one line on stderr that says which.

A new command is one more function below, under ``@app.command()``.
"""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graspforce.errors import GraspForceError, InvalidInputError
from graspforce.outcome import Status

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from graspforce.bench import Run
    from graspforce.files import NamedProblem, NamedSolution
    from graspforce.scenarios import Log
    from graspforce.sim import Log as SimLog
    from graspforce.sim import Trial

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


@app.command(
    epilog=_examples(
        "graspforce solve examples/nose_cone.json",
        "graspforce solve examples/several_grasps.json --out forces.json",
        "graspforce solve grasps.npz --alpha 1 --out forces.npz",
        "graspforce solve grasps.npz --c-max 20 --out forces.csv",
    )
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
            if out.resolve() == file.resolve():
                raise InvalidInputError(f"--out: got {out}, the file of grasps itself")
        grasps = _changed(files.read(file), changes, file)
        results: list[NamedSolution] = []
        with _progress_bar(len(grasps), "solving") as advance:
            for index, (name, problem) in enumerate(grasps):
                results.append(files.NamedSolution(name, solve_problem(problem, settings)))
                advance(index)
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


@app.command(
    epilog=_examples(
        "graspforce scenario dynamic",
        "graspforce scenario static --alpha 100 --out light.csv",
        "graspforce scenario regrasp --out results/regrasp.csv",
    )
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
    with _one_line_errors():
        from graspforce import files, scenarios

        chosen = scenarios.get(name, **({} if alpha is None else {"alpha": alpha}))
        path = out or Path(f"{name}.csv")
        files.check_output(path, (".csv",))
        if out is None and path.exists():
            raise InvalidInputError(f"{path}: exists already; name it with --out to replace it")
        with _progress_bar(len(chosen.times), name) as advance:
            log = scenarios.run(chosen, progress=advance)
        with files.replacing(path) as temporary:
            log.write_csv(temporary)
        _report_log(log)
        typer.echo(f"Every tick is in {path}")


@app.command(
    epilog=_examples(
        "graspforce simulate regrasp --video regrasp.mp4",
        "graspforce simulate hold --set alpha=100 --set mu=0.8 --log hold.parquet",
        "graspforce simulate allegro --set shape=sphere --set gravity=palm_down --video ball.gif",
        "graspforce simulate disturbance",
    )
)
def simulate(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="hold, circle, regrasp, allegro, bulb, disturbance or quadruped.",
        ),
    ],
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change an option of the scene."),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(help="Write every tick to this .npz, .parquet or .csv; replaces a file."),
    ] = None,
    video: Annotated[
        Path | None, typer.Option(help="Write a film to this .mp4 or .gif; replaces a file.")
    ] = None,
) -> None:
    """Run a scene in physics, in closed loop with the force distribution.

    The table shows, for each trial, how it ended, the largest errors of the object's pose, the
    farthest way that a fingertip slipped, the largest share of its limit that a joint torque
    took, and the mean number of Newton steps. Dropped objects are listed as such, and are no
    error. Needs the extra: pip install 'graspforce[sim]'.
    """
    with _one_line_errors():
        from graspforce import sim

        trials = sim.get(name, **dict(_setting(each) for each in changes or ()))
        if len(trials) > 1 and (log or video):
            raise InvalidInputError(
                f"{'--log' if log else '--video'}: {name} makes {len(trials)} trials, expected "
                "one; choose it with --set"
            )
        if log is not None:
            sim.check_log_file(log)
        if video is not None:
            sim.check_video_file(video)
        results: list[tuple[Trial, SimLog]] = []
        with _stage_bars() as progress:
            for trial in trials:
                run = sim.run(trial, lambda tick, t=trial: progress(t.name, tick + 1, t.ticks))
                results.append((trial, run))
        _report_trials(results)  # before the files, which may fail to come about
        first, run = results[0]
        if log is not None:
            run.save(log)
            typer.echo(f"Every tick is in {log}")
        if video is not None:
            with _stage_bars() as progress:
                sim.save_video(first, run, video, lambda done, total: progress("film", done, total))
            typer.echo(f"The film is in {video}")


@app.command(epilog=_examples("graspforce reproduce", "graspforce reproduce --out results"))
def reproduce(
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where the figures, numbers and report go.")
    ] = Path("results"),
) -> None:
    """Run Section IV of the paper, also in physics: figures 4 to 12, results.json, report.html.

    Needs the extras: pip install 'graspforce[figures,sim]'.
    """
    with _one_line_errors():
        from graspforce import report

        with _stage_bars() as progress:
            page = report.reproduce(out, progress)
        typer.echo(f"The report is {page}")


@app.command(
    epilog=_examples(
        "graspforce bench",
        "graspforce bench --save before.json",
        "graspforce bench --compare before.json --plot bench.png",
    )
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
    with _one_line_errors():
        from graspforce import bench as benchmarks
        from graspforce import files

        before = None if compare is None else benchmarks.Run.load(compare)
        for path, suffixes in ((save, (".json",)), (plot, (".png", ".svg", ".pdf"))):
            if path is not None:
                files.check_output(path, suffixes)
        with _status("timing") as tell:
            run = benchmarks.measure(effort, lambda done: tell(f"timed: {done.group}, {done.name}"))
        _report_run(run, before)
        if save is not None:
            run.save(save)
            typer.echo(f"The run is in {save}")
        if plot is not None:
            from graspforce.bench.plot import draw

            draw(run, plot)
            typer.echo(f"The picture is {plot}")


@app.command(
    epilog=_examples(
        "graspforce compare regrasp --method wbf --method compact_dual",
        "graspforce compare grasps.npz --whole --out comparison",
        "graspforce compare",
    )
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
    with _one_line_errors():
        from graspforce import compare as comparing
        from graspforce.compare import output

        if out is not None:
            output.prepare(out)
        tasks = comparing.SCENARIOS if task is None else (task,)
        with _stage_bars() as progress:
            found = comparing.compare(tasks, method, whole, progress)
        console = _console()
        for each in found.tasks:
            console.print(output.table(found, each.name))
        for claim in found.claims():
            console.print(f"The paper: {claim.paper}\nMeasured:  {claim.measured}\n")
        if out is not None:
            output.write(found, out)
            typer.echo(f"Everything about it is in {out}")


@contextmanager
def _one_line_errors() -> Generator[None]:
    """Turn what the caller can put right into one line on stderr and exit code 2."""
    try:
        yield
    except BrokenPipeError:
        raise  # the reader of our output has had enough; Typer ends quietly
    except GraspForceError as error:
        typer.echo(f"graspforce: {error}", err=True)
        raise typer.Exit(2) from error
    except OSError as error:
        typer.echo(f"graspforce: {error.filename}: cannot write it: {error.strerror}", err=True)
        raise typer.Exit(2) from error


def _changed(
    grasps: list[NamedProblem], changes: dict[str, float], file: Path
) -> list[NamedProblem]:
    """Return the grasps with the options of the command line in place of the file's."""
    from graspforce.files import NamedProblem
    from graspforce.files.named import place

    if not changes:
        return grasps
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


@contextmanager
def _progress_bar(total: int, what: str) -> Generator[Callable[[int], None]]:
    """Show a progress bar on stderr, if that is a terminal; call what it gives after each item."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=total)
        yield lambda index: progress.update(task, completed=index + 1)


@contextmanager
def _stage_bars() -> Generator[Callable[[str, int, int], None]]:
    """Show a progress bar a stage on stderr, if that is a terminal."""
    from rich.console import Console
    from rich.progress import Progress, TaskID

    console = Console(stderr=True)
    tasks: dict[str, TaskID] = {}
    with Progress(console=console, disable=not console.is_terminal) as bars:

        def progress(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done)

        yield progress


@contextmanager
def _status(what: str) -> Generator[Callable[[str], None]]:
    """Show a line on stderr, if that is a terminal; call what it gives to change the line."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda _: None
        return
    with console.status(what) as status:
        yield status.update


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
    console = _console()
    console.print(table)
    machine = run.machine
    console.print(
        f"{machine['cpu']}, {machine['cores']} cores, Python {machine['python']}, "
        f"NumPy {machine['numpy']}, {run.date}"
    )


def _report(results: list[NamedSolution]) -> None:
    """Print the table, the messages of grasps without an answer, and the counts."""
    from rich.text import Text

    console = _console()
    console.print(_table(results))
    failed = [
        (name, solution) for name, solution in results if solution.status is not Status.SOLVED
    ]
    for name, solution in failed[:MESSAGES]:
        console.print(Text(f"{_printable(name)}: {solution.message}"))
    if len(failed) > MESSAGES:
        console.print(f"… and {len(failed) - MESSAGES} more without an answer")
    console.print(_counts("grasp", (solution.status for _, solution in results)))


def _table(results: list[NamedSolution]) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("#", justify="right")
    table.add_column("grasp", overflow="fold")
    table.add_column("status", no_wrap=True)
    for heading in ("largest\nnormal\n[N]", "slip\nmargin\n[N]", "torque\nmargin\n[N·m]", "steps"):
        table.add_column(Text(heading), justify="right", overflow="fold")
    for index, (name, solution) in enumerate(results):
        solved = solution.status is Status.SOLVED
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
            Text(_words(solution.status), style="green" if solved else "red"),
            *numbers,
            str(solution.newton_steps),
        )
    return table


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
    console = _console()
    console.print(f"{log.scenario.name}: {log.scenario.summary}")
    console.print(table)
    one = int((log.newton_steps[solved] == 1).sum())
    ticks = _counts("tick", (Status(each) for each in log.status))
    console.print(f"{ticks}; {one} in one Newton step")


def _setting(text: str) -> tuple[str, Any]:
    """Return key and value of ``key=value``: a number where it is one, else text."""
    key, found, value = text.partition("=")
    if not (key and found):
        raise InvalidInputError(f"--set: got {text!r}, expected KEY=VALUE")
    readers: tuple[Callable[[str], Any], ...] = (json.loads, float)
    for read in readers:  # JSON has true and false, but no .5
        with suppress(ValueError):
            return key, read(value)
    return key, value


def _report_trials(results: Sequence[tuple[Trial, SimLog]]) -> None:
    """Print a row a trial, and below why some did not end well."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("trial", no_wrap=True)
    table.add_column("ending", no_wrap=True)
    for heading in (
        "position\n[mm]", "rotation\n[°]", "slip\n[mm]", "torque\n[%]", "Newton\nsteps", "regrasps"
    ):  # fmt: skip
        table.add_column(Text(heading), justify="right")
    for trial, log in results:
        table.add_row(
            trial.name,
            Text(log.verdict, style="green" if log.verdict == "held" else "red"),
            f"{1e3 * log.position_error.max():.3f}",
            f"{math.degrees(log.rotation_error.max()):.2f}",
            f"{1e3 * log.slip.max():.3f}",
            f"{100 * log.torque_use:.0f}",
            f"{log.newton_steps.mean():.2f}",
            str(log.regrasps),
        )
    console = _console()
    for words in dict.fromkeys(trial.summary for trial, _ in results):
        console.print(words)
    console.print(table)
    for trial, log in results:
        if not log.held:
            console.print(Text(f"{trial.name}: {log.ending.value} {log.message}"))


def _counts(what: str, statuses: Iterable[Status]) -> str:
    """Return how many there are and how many of each status, as in ``3 grasps: 3 solved``."""
    counts = Counter(_words(status) for status in statuses)
    total = counts.total()
    each = ", ".join(f"{count} {words}" for words, count in counts.most_common())
    return f"{total} {what}{'' if total == 1 else 's'}: {each}"


def _words(status: Status) -> str:
    return status.name.lower().replace("_", " ")


def _printable(name: str) -> str:
    """Return a name on one line, without characters that steer a terminal."""
    return "".join(each if each.isprintable() else "�" for each in name)
