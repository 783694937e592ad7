"""What the simulated scenes measure, and which grips hold against which disturbance.

Every scene that comes with graspforce is run to its end in MuJoCo: how far the object was off, how
far a fingertip slid on it, how hard the joints worked. Less than a minute:
``python benchmarks/simulation.py``.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table
from saving import show, writable

from graspforce import sim
from graspforce.sim.scenes.disturbance import KINDS

SCENES = {
    "hold": ("hold", {}),
    "circle": ("circle", {}),
    "circle, without feed-forward of the fingers' inertia": ("circle", {"feed_forward": False}),
    "circle, joints damped by 0.03 N·m·s/rad": ("circle", {"damping": 0.03}),
    "regrasp (finger 1 lifted by 12 mm)": ("regrasp", {}),
    "allegro, worst of 15": ("allegro", {}),
    "bulb": ("bulb", {}),
    "quadruped": ("quadruped", {}),
}
VERDICTS = {"held": "holds", "held, but slipped": "slips", "dropped": "drops"}


def measured(logs: Sequence[sim.Log]) -> list[str]:
    """Return the cells of a scene: the worst of its trials over the whole run."""
    if any(log.verdict != "held" for log in logs):
        return ["not held", "", "", "", ""]
    worst = np.max(
        [
            (1e3 * log.position_error.max(), np.degrees(log.rotation_error.max()),
             1e3 * log.slip.max(), 100 * log.torque_use, log.newton_steps.mean())
            for log in logs
        ],
        axis=0,
    )  # fmt: skip
    words = ("{:.3f} mm", "{:.3g}°", "{:.2f} mm", "{:.0f} %", "{:.3f}")
    return [text.format(value) for text, value in zip(words, worst, strict=True)]


def scenes() -> Table:
    version = importlib.metadata.version("mujoco")
    result = Table(title=f"largest values over the whole run, MuJoCo {version}")
    result.add_column("scene")
    for heading in ("position", "rotation", "slip", "torque", "Newton steps, mean"):
        result.add_column(heading, justify="right")
    for words, (name, options) in SCENES.items():
        result.add_row(words, *measured([sim.run(trial) for trial in trials(name, **options)]))
    return result


def trials(name: str, damping: float = 0.0, **options: Any) -> tuple[sim.Trial, ...]:
    """Return a scene's trials, with every joint of the fingers damped [N·m·s/rad]."""
    made = sim.get(name, **options)
    for trial in made:
        for joint in (joint for finger in trial.fingers for joint in finger.joints):
            trial.model.dof_damping[trial.model.joint(joint).dofadr] += damping
    return made


def disturbances() -> Table:
    grips = ("alpha 0.1", "alpha 1", "alpha 5", "alpha 100", "SOCP", "SOCP 80 %")
    result = Table(title="verdict, and slip of the worst fingertip [mm]")
    for heading in ("", *grips):
        result.add_column(heading)
    logs = {kind: [sim.run(trial) for trial in sim.get("disturbance", kind=kind)] for kind in KINDS}
    for kind, (words, _) in KINDS.items():
        result.add_row(words, *map(cell, logs[kind]))
    used = (f"{100 * log.torque_use:.0f} %" for log in logs["none"])
    result.add_row("largest torque of the limit, nothing wrong", *used)
    return result


def cell(log: sim.Log) -> str:
    """Return the verdict, and the slip of what did not drop."""
    return VERDICTS[log.verdict] + (f" {1e3 * log.slip.max():.2f}" if log.held else "")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--save", type=writable, help="write the tables to this file")
    options = parser.parse_args()
    show(scenes(), disturbances(), save=options.save, width=140)
    return 0


if __name__ == "__main__":
    sys.exit(main())
