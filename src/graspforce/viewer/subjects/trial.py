"""Simulated scenes as subjects: run once for all pages, or live for one of them."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np

from graspforce import sim
from graspforce._util.arrays import Array
from graspforce.sim import Trial
from graspforce.sim.mujoco_import import mj, silenced_warnings
from graspforce.viewer.knobs import Knobs, turned_down
from graspforce.viewer.moment import Body, Moment
from graspforce.viewer.physics import Loop, Tick
from graspforce.viewer.problems import turn_knobs
from graspforce.viewer.subjects import mujoco_bodies

SCENES = sim.NAMES
# Of scenes that make many trials, the one that is shown where nothing else is asked for.
_CHOICES: dict[str, dict[str, Any]] = {"allegro": {"shape": "sphere", "gravity": "fingers_up"}}
_CEILING = 20.0  # of a contact that is to leave and has none [N]


def open_trial(name: str, **options: Any) -> TrialSubject:
    """Return a scene of ``graspforce.sim``, its first trial.

    Args:
        name: one of ``sim.NAMES``.
        **options: of the scene, as for :func:`graspforce.sim.get`.
    """
    trials = sim.get(name, **(_CHOICES.get(name, {}) | options))
    return TrialSubject(trials[0])


class TrialSubject:
    """A simulated scene.

    Args:
        trial: the scene; it is run when the time of a page first leaves 0.
    """

    items: tuple[str, ...] = ()
    load_unit = "kg"
    controls = frozenset({"push", "tilt", "heading", "physics"})

    def __init__(self, trial: Trial) -> None:
        assert trial.alpha is not None  # as of named fingers
        assert trial.motion is not None
        self.trial = trial
        self.title, self.summary = trial.name, trial.summary
        self.times: Array = np.arange(trial.ticks) / trial.rate
        model, body = trial.model, trial.model.body(trial.body).id
        self._mass = float(model.body_subtreemass[body])
        self._data = mj.MjData(model)
        held = body if trial.ground is None else -1
        self._drawn: dict[int, Body] = mujoco_bodies.bodies(model, held)
        self._bodies = tuple(self._drawn.values())
        points = np.array([grip.point for grip in trial.grips])
        self.size = float(np.linalg.norm(points[:, None] - points, axis=-1).max())
        self.knobs = Knobs(alpha=trial.alpha, load=self._mass)
        self._lock, self._working, self._wanted = threading.Lock(), threading.Lock(), False
        self.fingers = tuple(f"finger {i + 1}" for i in range(len(trial.fingers)))
        self._joints = tuple(name for finger in trial.fingers for name in finger.joints)
        self.centre: Array = trial.motion.at(0.0).position.copy()
        with silenced_warnings():
            self._loop = Loop(trial)
        self._ticks: list[Tick] = [self._loop.tick]
        self.failed = ""

    @property
    def busy(self) -> bool:
        """Whether the scene is being run."""
        return self._wanted and len(self._ticks) < len(self.times) and not self.failed

    def bodies(self, knobs: Knobs) -> tuple[Body, ...]:
        """Return the model's geoms."""
        return self._bodies

    def moment(self, knobs: Knobs) -> Moment:
        """Return a tick of the run, as far as it has come, with the knobs' changes."""
        self._wanted = self._wanted or knobs.time > 0
        wanted = round(knobs.time * self.trial.rate)
        tick = self._ticks[min(wanted, len(self._ticks) - 1)]
        given = tick.problem
        f = given.f * (knobs.load / self._mass)
        weight = knobs.load * np.array(self.trial.model.opt.gravity)
        f[:3] += weight - turned_down(knobs.tilt, knobs.heading) @ weight - np.array(knobs.push)
        ceilings = given.layout.ceilings
        problem = turn_knobs(
            given.replace(f=f), knobs, given.engagement if ceilings else np.ones(given.n),
            given.c_max if ceilings else None, _CEILING,
        )  # fmt: skip
        note = self.failed
        if self.busy:
            note = f"the scene is being run: {len(self._ticks) / len(self.times):.0%}"
        return self._drawn_at(tick, problem, note)

    def work(self, seconds: float) -> None:
        """Go on with the run for about that time; one page does it for all."""
        if not self._working.acquire(blocking=False):
            time.sleep(seconds)
            return
        try:
            end = time.monotonic() + seconds
            with silenced_warnings():
                while self.busy and time.monotonic() < end:
                    self._loop.step()
                    self._ticks.append(self._loop.tick)
                    if self._loop.ended:
                        self.failed = f"at {self._loop.tick.t:.2f} s {self._loop.ended}"
        finally:
            self._working.release()

    def live(self) -> Loop:
        """Return the scene from its beginning, to play with."""
        with silenced_warnings():
            return Loop(self.trial)

    def live_moment(self, loop: Loop) -> Moment:
        """Return where a live loop stands."""
        return self._drawn_at(loop.tick, loop.tick.problem, loop.ended)

    def _drawn_at(self, tick: Tick, problem: Any, note: str) -> Moment:
        with self._lock:  # several pages draw from the same data
            self._data.qpos[:] = tick.qpos
            mj.mj_kinematics(self.trial.model, self._data)
            poses = mujoco_bodies.poses(self._data, self._drawn)
            joints = mujoco_bodies.joint_points(self.trial.model, self._data, self._joints)
        return Moment(
            poses, tick.contacts, tick.origin, problem, self.fingers, self._joints, joints, note,
            tick.force,
        )  # fmt: skip
