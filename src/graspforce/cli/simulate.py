"""``graspforce simulate``: a scene in physics, in closed loop."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graspforce.cli.terminal import reporting, show, stage_bars
from graspforce.errors import InvalidInputError

if TYPE_CHECKING:
    from graspforce.sim import Log, Trial

EXAMPLES = (
    "graspforce simulate regrasp --video regrasp.mp4",
    "graspforce simulate hold --set alpha=100 --set mu=0.8 --log hold.parquet",
    "graspforce simulate allegro --set shape=sphere --set gravity=palm_down --video ball.gif",
    "graspforce simulate disturbance",
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
    error. Needs the extra 'sim': in a checkout, pip install '.[sim]'.
    """
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
    results: list[tuple[Trial, Log]] = []
    with stage_bars() as progress:
        for trial in trials:
            run = sim.run(trial, lambda tick, t=trial: progress(t.name, tick + 1, t.ticks))
            results.append((trial, run))
    first, run = results[0]
    with reporting(lambda: _report_trials(results)) as tell:
        if log is not None:
            run.save(log)
            tell(f"Every tick is in {log}")
        if video is not None:
            with stage_bars() as progress:
                sim.save_video(first, run, video, lambda done, total: progress("film", done, total))
            tell(f"The film is in {video}")


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


def _report_trials(results: Sequence[tuple[Trial, Log]]) -> None:
    """Print a row a trial, and below why some did not end well."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("trial", overflow="fold")
    table.add_column("ending", no_wrap=True)
    for heading in (
        "position\n[mm]", "rotation\n[°]", "slip\n[mm]", "torque\n[%]", "Newton\nsteps", "regrasps"
    ):  # fmt: skip
        table.add_column(Text(heading), justify="right", no_wrap=True)
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
    show(
        *dict.fromkeys(trial.summary for trial, _ in results),
        table,
        *(f"{t.name}: {log.ending.value} {log.message}" for t, log in results if not log.held),
    )
