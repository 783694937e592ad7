"""Closed loops in physics: hands and legs in MuJoCo, driven by the force distribution.

>>> from graspforce import sim
>>> (trial,) = sim.get("hold", duration=0.1)
>>> log = sim.run(trial)
>>> log.held
True

The physics is independent of the model behind the forces: it has bodies, motors, and contacts that
stick or slide. A :class:`Trial` holds model, fingers and motion as data; :func:`run` closes the
loop and returns a :class:`Log`. ``sim.NAMES`` are the scenes that come with graspforce; :func:`get`
returns their trials. A hand of any kind closes by :func:`close` and holds by :class:`HandLoop`, or
by :func:`own`, which makes trials of it; ``sim.HANDS`` are models of hands to try.

Needs the extra ``sim``: in a checkout, ``pip install '.[sim]'``.
"""

from __future__ import annotations

import warnings
from typing import Any

from graspforce.errors import RenderError
from graspforce.sim.closing import close
from graspforce.sim.hand_loop import HandLoop
from graspforce.sim.hand_models import HANDS, hand_model
from graspforce.sim.log import Ending, Log, check_log_file
from graspforce.sim.loop import run
from graspforce.sim.render import check_video_file, picture, save_still, save_video
from graspforce.sim.scenes import NAMES, get
from graspforce.sim.scenes.own import load, own
from graspforce.sim.trial import Disturbance, Finger, FingerSwing, Gains, Grip, Push, Trial

__all__ = [
    "HANDS",
    "NAMES",
    "Disturbance",
    "Ending",
    "Finger",
    "FingerSwing",
    "Gains",
    "Grip",
    "HandLoop",
    "Log",
    "Push",
    "RenderError",
    "Trial",
    "check_log_file",
    "check_video_file",
    "close",
    "get",
    "hand_model",
    "load",
    "own",
    "picture",
    "run",
    "save_still",
    "save_video",
]


def __getattr__(name: str) -> Any:
    if name == "Step":
        warnings.warn(
            "graspforce.sim.Step is now graspforce.sim.FingerSwing",
            DeprecationWarning,
            stacklevel=2,
        )
        return FingerSwing
    raise AttributeError(f"module 'graspforce.sim' has no attribute {name!r}")
