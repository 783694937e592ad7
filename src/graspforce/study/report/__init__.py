"""Section IV of the paper, end to end: ``graspforce reproduce``.

:func:`reproduce` runs the paper's three scenarios and its sweep of alpha, times the servo on this
machine, repeats the scenes in closed loop in a physics simulator, runs the paper's other methods
beside its own, draws figures 4 to 12, and writes them with ``results.json`` (every number) and
``report.html``: one page, without anything from a network, that sets each figure beside a table
"the paper says | measured here". Apart from the date, the machine and the times, two runs write
the same bytes.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

from graspforce import scenarios
from graspforce._engine.outcome import Status
from graspforce._engine.settings import Settings
from graspforce._util import plot
from graspforce._util.atomic import atomic_write, check_writable, make_folder
from graspforce._util.environment import describe_run
from graspforce.scenarios import Log
from graspforce.study import compare
from graspforce.study.compare import output
from graspforce.study.figures import FIGURES, PaperFigure, grasp_picture
from graspforce.study.report.page import EQUATIONS, template
from graspforce.study.report.timing import measure_times, time_claims

# The tasks on which the methods are compared.
COMPARED = scenarios.NAMES

# Called with a stage's name, how much of it is done, and its total.
Progress: TypeAlias = Callable[[str, int, int], None]


def reproduce(out: str | Path, progress: Progress | None = None) -> Path:
    """Run Section IV of the paper and write its figures, numbers and report.

    Args:
        out: folder for the results; made when it is not there. Files of the same names in it are
            replaced, each as a whole.
        progress: called as the work goes on with a stage's name, how much of it is done and its
            total; the stages come one after the other.

    Returns:
        The path of ``report.html``.

    Raises:
        InvalidInputError: ``out`` is no folder to write into, or holds something else by the name
            of the report or the numbers.
        OSError: a file cannot be written; what it held before is still there.
        MissingExtraError: matplotlib, jinja2, mujoco or imageio is not installed.
    """
    report = progress or _no_progress
    plot.new_figure()  # a missing extra is found before the work, and before a folder is made
    page = template()
    from graspforce.study.report import physics  # needs MuJoCo, which may be the next to be missing

    folder = make_folder(out, "out")
    for name in ("results.json", "report.html"):
        check_writable(folder / name)

    logs = {name: _run(name, report) for name in scenarios.NAMES}
    sweep = scenarios.sweep_alpha()
    times = measure_times(logs["dynamic"], logs["regrasp"], report)
    simulated, images = physics.simulate(report)
    sources: dict[str, Any] = {**logs, "sweep": sweep}
    compared = compare.compare(
        COMPARED, progress=lambda task, done, total: report(f"methods: {task}", done, total)
    )
    results: dict[str, Any] = {
        **describe_run(),
        "timing": times,
        "scenarios": {name: _summary(log) for name, log in logs.items()},
        "physics": simulated,
        "comparison": compared.as_dict(),
        "figures": {},
    }
    for name, image in images.items():
        _write_bytes(folder / name, image)
    total = len(FIGURES) + 1
    for done, figure in enumerate(FIGURES):
        report("figures", done, total)
        results["figures"][str(figure.NUMBER)] = _write_figure(figure, sources, folder, images)
    report("figures", total - 1, total)
    picture = grasp_picture.draw(grasp_picture.data(logs["static"].scenario))
    images["grasp.png"] = _write_bytes(folder / "grasp.png", plot.render(picture, "png"))

    for stem, picture in output.pictures(compared).items():
        name = f"methods_{stem}.svg"
        images[name] = _write_bytes(folder / name, plot.render(picture, "svg"))

    results = json_types(results)
    _write_bytes(folder / "results.json", json_text(results).encode())
    html = page.render(
        results=results,
        time_claims=time_claims(times),
        comparison_claims=compared.claims(),
        compared={
            task.name: [
                (row.method, row.missing, output.cells(row))
                for row in compared.rows
                if row.task == task.name
            ]
            for task in compared.tasks
        },
        headings=output.HEADINGS,
        images={name: base64.b64encode(image).decode() for name, image in images.items()},
        equations=EQUATIONS,
        c_max=logs["regrasp"].scenario.c_max,
        tol=Settings().tol,
    )
    _write_bytes(folder / "report.html", html.encode())
    report("figures", total, total)
    return folder / "report.html"


# ---- the runs ----------------------------------------------------------------------------------


def _run(name: str, progress: Progress) -> Log:
    scenario = scenarios.get(name)
    total = len(scenario.times)
    return scenarios.run(scenario, progress=lambda tick: progress(name, tick + 1, total))


def _summary(log: Log) -> dict[str, Any]:
    """Return what was run and the ranges of what came out."""
    scenario = log.scenario
    ranges = {
        "normal_forces [N]": log.normal_forces,
        "max_torque [N m]": log.max_torque,
        "torque_residual [N m]": log.torque_residual,
        "friction_residual [N^2]": log.friction_residual,
        "newton_steps": log.newton_steps,
        "suboptimality": log.suboptimality,
    }
    steps, counts = np.unique(log.newton_steps, return_counts=True)
    return {
        "summary": scenario.summary,
        "alpha": scenario.alpha,
        "c_max [N]": scenario.c_max,
        "rate [Hz]": scenario.rate,
        "duration [s]": scenario.duration,
        "base_axis": scenario.hand.base_axis,
        "elbow": scenario.hand.elbow,
        "ticks": len(log.t),
        "ticks_solved": int((log.status == Status.SOLVED).sum()),
        "ticks_by_newton_steps": dict(zip(map(str, steps), counts, strict=True)),
        "ranges": {name: [values.min(), values.max()] for name, values in ranges.items()},
    }


def _write_figure(
    figure: PaperFigure, sources: dict[str, Any], folder: Path, images: dict[str, bytes]
) -> dict[str, Any]:
    """Write a figure's files and return its entry of ``results.json``."""
    shown = figure.data(sources[figure.SOURCE])
    drawn = figure.draw(shown)
    stem = figure.__name__.rpartition(".")[2]
    _write_bytes(folder / f"{stem}.png", plot.render(drawn, "png"))
    images[f"{stem}.svg"] = _write_bytes(folder / f"{stem}.svg", plot.render(drawn, "svg"))
    return {
        "title": figure.TITLE,
        "source": figure.SOURCE,
        "files": [f"{stem}.png", f"{stem}.svg"],
        "claims": [dataclasses.asdict(claim) for claim in figure.claims(shown)],
        "arrays": {each.name: getattr(shown, each.name) for each in dataclasses.fields(shown)},
    }


# ---- what is written ---------------------------------------------------------------------------


def json_types(value: Any) -> Any:
    """Return ``value`` in JSON's types; a number that is not finite becomes None."""
    if isinstance(value, dict):
        return {name: json_types(each) for name, each in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [json_types(each) for each in cast("list[Any]", value)]
    if isinstance(value, np.ndarray | np.generic):
        return json_types(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_text(results: dict[str, Any]) -> str:
    """Return the results as JSON, indented, each innermost list on one line."""
    text = json.dumps(results, indent=1, ensure_ascii=False, allow_nan=False)
    return re.sub(r"\[\s+[^][{}\"]*\]", lambda found: " ".join(found[0].split()), text) + "\n"


def _write_bytes(path: Path, content: bytes) -> bytes:
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)
    return content


def _no_progress(stage: str, done: int, total: int) -> None:
    """Take the progress where nobody asked for it."""
