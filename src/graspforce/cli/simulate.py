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
    "graspforce simulate --model scene.xml --object cube --move 0,0,.02 --turn 20",
    "graspforce simulate --model scene.xml --object cube --disturbance all",
)


def simulate(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="hold, circle, regrasp, allegro, bulb, disturbance or quadruped; or leave it out "
            "and give --model.",
        ),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="A scene of your own: an MJCF file with hand and object.")
    ] = None,
    body: Annotated[
        str | None, typer.Option("--object", metavar="BODY", help="Its body that is held.")
    ] = None,
    move: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Move the object by this [m].")
    ] = None,
    turn: Annotated[
        float | None, typer.Option(help="Turn the object about the vertical by this [°].")
    ] = None,
    shake: Annotated[
        float | None, typer.Option(help="Shake the ground by so many g at 2 Hz, sideways.")
    ] = None,
    disturbance: Annotated[
        str | None,
        typer.Option(help="none, push, payload, friction, noise, delay, dropout, or all in turn."),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change an option of the scene; with --model alpha, mu, rate or duration.",
        ),
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

    With --model it is a scene of your own: the hand closes on the object, whatever its joints,
    motors and fingertips are, and holds it.

    The table shows, for each trial, how it ended, the largest errors of the object's pose, the
    farthest way that a fingertip slipped, the largest share of its limit that a joint torque
    took, the mean number of Newton steps, and of how many ticks without an answer the last
    torques were kept. Dropped objects are listed as such, and are no
    error. Needs the extra 'sim': in a checkout, pip install '.[sim]'.
    """
    from graspforce import sim

    settings = dict(_setting(each) for each in changes or ())
    own = {"object": body, "move": move, "turn": turn, "shake": shake, "disturbance": disturbance}
    given = {key: value for key, value in own.items() if value is not None}
    if (name is None) == (model is None):
        raise InvalidInputError(
            f"NAME: got {name or 'none'} and --model {model or 'none'}, expected one of the two"
        )
    if model is not None:
        trials = _own_trials(model, given, settings)
    else:
        if given:
            raise InvalidInputError(f"--{next(iter(given))}: goes with --model only")
        trials = sim.get(str(name), **settings)
    if len(trials) > 1 and (log or video):
        raise InvalidInputError(
            f"{'--log' if log else '--video'}: {name or 'all'} makes {len(trials)} trials, "
            "expected one; choose it with --set"
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


def _own_trials(path: Path, given: dict[str, Any], settings: dict[str, Any]) -> tuple[Trial, ...]:
    """Return the trials of a user's own scene."""
    from graspforce import sim

    if "object" not in given:
        raise InvalidInputError("--object: missing; --model came without it")
    for key, value in settings.items():
        if key not in ("alpha", "mu", "rate", "duration"):
            raise InvalidInputError(
                f"{key}: not an option with --model; expected one of alpha, mu, rate, duration"
            )
        if not isinstance(value, int | float):
            raise InvalidInputError(f"{key}: got {value!r}, expected a number")
    if "move" in given:
        given["move"] = _numbers(given["move"], "--move")
    body = given.pop("object")
    return sim.own(sim.load(path), body, name=path.stem, **given, **settings)


def _numbers(text: str, option: str) -> list[float]:
    try:
        return [float(each) for each in text.split(",")]
    except ValueError:
        raise InvalidInputError(f"{option}: got {text!r}, expected numbers like 0,0,.02") from None


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
        "position\n[mm]", "rotation\n[°]", "slip\n[mm]", "torque\n[%]", "Newton\nsteps", "regrasps",
        "kept",
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
            str(int(log.kept.sum())),
        )
    show(
        *dict.fromkeys(trial.summary for trial, _ in results),
        table,
        *(f"{t.name}: {log.ending.value} {log.message}" for t, log in results if not log.held),
    )
