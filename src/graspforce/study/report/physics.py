"""The paper's scenes in closed loop, in a physics simulator: the report's own evidence.

The paper computes forces along a motion that is taken for granted. Here the motion has to come
from the forces.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from graspforce import sim
from graspforce._engine.outcome import Status

# Scenes, and the time of each one's picture [s].
_SCENES: tuple[tuple[str, float], ...] = (("hold", 1.0), ("circle", 0.24), ("regrasp", 1.0))


def simulate(progress: Callable[[str, int, int], None]) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Run the paper's scenes in physics.

    Args:
        progress: called with the stage, how much of it is done and its total.

    Returns:
        Results of every scene by name, and the pictures as PNGs by file name. Where there is no
        OpenGL to draw with there are no pictures, and ``results["no pictures"]`` says why.

    Raises:
        MissingExtraError: imageio is not installed.
    """
    results: dict[str, Any] = {"scenes": {}, "no pictures": ""}
    pictures: dict[str, bytes] = {}
    for name, moment in _SCENES:
        (trial,) = sim.get(name)
        stage = f"physics: {name}"
        log = sim.run(trial, lambda tick, s=stage, n=trial.ticks: progress(s, tick + 1, n))
        results["scenes"][name] = _summary(trial, log)
        try:
            pictures[f"physics_{name}.png"] = _still(trial, log, moment)
        except sim.RenderError as error:
            results["no pictures"] = str(error)
    return results, pictures


def _summary(trial: sim.Trial, log: sim.Log) -> dict[str, Any]:
    return {
        "summary": trial.summary,
        "verdict": log.verdict,
        "message": log.message,
        "rate [Hz]": trial.rate,
        "alpha": trial.alpha,
        "ticks": len(log.t),
        "ticks_solved": int((log.status == Status.SOLVED).sum()),
        "largest position error [mm]": 1e3 * log.position_error.max(),
        "largest rotation error [deg]": np.degrees(log.rotation_error.max()),
        "largest slip [mm]": 1e3 * log.slip.max(),
        "largest share of a torque limit": log.torque_use,
        "mean newton_steps": log.newton_steps.mean(),
        "largest clearance of a fingertip [mm]": 1e3 * log.clearance.max(),
    }


def _still(trial: sim.Trial, log: sim.Log, moment: float) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "still.png"
        sim.save_still(trial, log, path, min(moment, float(log.t[-1])))
        return path.read_bytes()
