"""Closed loops in physics: hands and legs in MuJoCo, driven by the force distribution.

>>> from graspforce import sim
>>> (trial,) = sim.get("hold", duration=0.1)
>>> log = sim.run(trial)
>>> log.held
True

The physics knows nothing of the model behind the forces: it has bodies, motors, and contacts that
stick or slide. A scene is a :class:`Trial`, data that says who is to do what; :func:`run` closes
the loop and returns a :class:`Log`. ``sim.NAMES`` are the scenes that come with graspforce.

Needs the extra ``sim``: in a checkout, ``pip install '.[sim]'``.
"""

from __future__ import annotations

from graspforce.errors import RenderError
from graspforce.sim.disturbance import Disturbance, Push
from graspforce.sim.log import Ending, Log, check_log_file
from graspforce.sim.loop import run
from graspforce.sim.render import check_video_file, save_still, save_video
from graspforce.sim.scenes import NAMES, get
from graspforce.sim.trial import Finger, Gains, Grip, Step, Trial

__all__ = [
    "NAMES",
    "Disturbance",
    "Ending",
    "Finger",
    "Gains",
    "Grip",
    "Log",
    "Push",
    "RenderError",
    "Step",
    "Trial",
    "check_log_file",
    "check_video_file",
    "get",
    "run",
    "save_still",
    "save_video",
]
