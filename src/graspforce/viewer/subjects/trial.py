"""Simulated scenes as subjects: run once for all pages, live for one of them, or from a log."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from graspforce._util.arrays import Array
from graspforce.contact import model_of
from graspforce.errors import GraspForceError, GraspForceWarning, InvalidInputError
from graspforce.grasp import Grasp
from graspforce.problem import ForceProblem
from graspforce.sim import Log, Trial
from graspforce.sim.mujoco_import import mj, silenced_warnings
from graspforce.viewer.knobs import Knobs, turned_down
from graspforce.viewer.moment import Body, Moment
from graspforce.viewer.physics import Loop, Tick
from graspforce.viewer.problems import turn_knobs
from graspforce.viewer.subjects import mujoco_bodies

_CEILING = 20.0  # of a contact that is to leave and has none [N]
# How far a contact of a log may be from where the physics has it, and be the same [m].
_SAME = 2e-3
# How far joint positions at the start of a log may be from the scene's [rad, m].
_START = 0.02


class TrialSubject:
    """A simulated scene.

    Args:
        trials: at least one; each is run when the time of a page with it first leaves 0.
        title: of the page.
        log: of the only trial, which is played in place of a run.

    Raises:
        InvalidInputError: a log of another scene.
    """

    load_unit = "kg"

    def __init__(self, trials: Sequence[Trial], title: str, log: Log | None = None) -> None:
        self._trials = tuple(trials)
        self._scenes: dict[int, _Scene] = {}
        self._opening = threading.Lock()
        first = self._scene(0)
        tick, trial = first.loop.tick, first.trial
        assert tick.problem is not None  # as of a loop
        self.title, self.summary = title, trial.summary
        self.items = tuple(each.name for each in self._trials) if len(self._trials) > 1 else ()
        self.centre: Array = tick.origin.copy()
        self.fingers = tick.fingers
        points = tick.points[tick.problem.active]
        # Fingers that touch a long object side by side are no measure of it.
        self.size = min(
            float(np.linalg.norm(points[:, None] - points, axis=-1).max()),
            mujoco_bodies.smallest_extent(first.bodies, first.drawn_at(tick, None, "").poses),
        )
        self.knobs = Knobs(alpha=first.loop.alpha, load=first.loop.mass)
        self._free = first.loop.free
        controls = {"physics"}
        if self._free:
            controls |= {"push", "tilt", "heading"}
        if trial.fingers:
            controls |= {"lift"}
        self.controls = frozenset(controls)
        if log is not None:
            if len(self._trials) > 1:
                raise InvalidInputError(
                    f"log: got one to {len(self._trials)} trials, expected a scene that is one"
                )
            first.source = _Replay(trial, first.loop, log)
            self.title = f"{title}, a log"
        self.times: Array = first.source.times

    @property
    def busy(self) -> bool:
        """Whether a scene is being run."""
        return any(each.source.busy for each in tuple(self._scenes.values()))

    def work(self, seconds: float) -> None:
        """Go on with the runs for about that time; one page does it for all."""
        for each in tuple(self._scenes.values()):
            if each.source.busy:
                each.source.work(seconds)

    def alpha_of(self, item: int) -> float:
        """Return the alpha of a trial."""
        return self._scene(item).loop.alpha

    def bodies(self, knobs: Knobs) -> tuple[Body, ...]:
        """Return the model's geoms."""
        return self._scene(knobs.item).bodies

    def moment(self, knobs: Knobs) -> Moment:
        """Return a tick of the run, as far as it has come, with the knobs' changes."""
        scene = self._scene(knobs.item)
        tick = scene.source.at(knobs.time)
        given = tick.problem
        if given is None:
            return scene.drawn_at(tick, None, "Nothing touches the object.")
        f, mass = given.f.copy(), scene.loop.mass
        if self._free:
            f[:6] = tick.f * (knobs.load / mass)
            weight = knobs.load * np.array(scene.trial.model.opt.gravity)
            f[:3] += weight - turned_down(knobs.tilt, knobs.heading) @ weight
            f[:6] -= knobs.applied
        ceilings = given.layout.ceilings
        # Another load or grip than the loop's is no change from its last forces, and a load that
        # may be missed would always be held; what no motor controls still gives way.
        exact: dict[str, Any] = {"f": f, "c_last": None, "dc_max": None}
        if self._free and len(given.f_soft):
            exact["f_soft"] = np.append(np.zeros(6), given.f_soft[6:])
        given = given.replace(**exact)
        problem = turn_knobs(
            given, knobs, given.engagement if ceilings else np.ones(given.n),
            given.c_max if ceilings else None, _CEILING,
        )  # fmt: skip
        return scene.drawn_at(tick, problem, scene.source.note)

    def live(self, knobs: Knobs) -> Loop:
        """Return the scene from its beginning, without its disturbances, to play with."""
        return Loop(self._scene(knobs.item).trial, disturbed=False)

    def live_moment(self, loop: Loop, knobs: Knobs) -> Moment:
        """Return where a live loop stands."""
        return self._scene(knobs.item).drawn_at(loop.tick, loop.tick.problem, loop.ended)

    def _scene(self, item: int) -> _Scene:
        item = min(item, len(self._trials) - 1)
        with self._opening:
            if item not in self._scenes:
                self._scenes[item] = _Scene(self._trials[item])
            return self._scenes[item]


class _Source(Protocol):
    """Where the ticks of a scene come from."""

    times: Array

    @property
    def busy(self) -> bool: ...

    @property
    def note(self) -> str: ...

    def at(self, t: float) -> Tick: ...

    def work(self, seconds: float) -> None: ...


class _Scene:
    """A trial, and what is drawn of it."""

    def __init__(self, trial: Trial) -> None:
        self.trial, self.loop = trial, Loop(trial)
        self.source: _Source = _Run(trial, self.loop)
        self._data, self._drawing = mj.MjData(trial.model), threading.Lock()
        held = trial.model.body(trial.body).id if trial.ground is None else -1
        self._drawn: dict[int, Body] = mujoco_bodies.bodies(trial.model, held)
        self.bodies = tuple(self._drawn.values())

    def drawn_at(self, tick: Tick, problem: ForceProblem | None, note: str) -> Moment:
        """Return a tick, with a problem in place of its own."""
        with self._drawing:  # several pages draw from the same data
            self._data.qpos[:] = tick.qpos
            mj.mj_kinematics(self.trial.model, self._data)
            poses = mujoco_bodies.poses(self._data, self._drawn)
            points = mujoco_bodies.joint_points(self.trial.model, self._data, tick.joints)
        return Moment(
            poses, tick.contacts, tick.origin, problem, tick.fingers, tick.joints, points, note,
            tick.force,
        )  # fmt: skip


class _Run:
    """The ticks of a run that goes on while it is looked at."""

    def __init__(self, trial: Trial, loop: Loop) -> None:
        self.times: Array = np.arange(trial.ticks) / trial.rate
        self._rate, self._loop, self._ticks = trial.rate, loop, [loop.tick]
        self._working, self._wanted, self._failed = threading.Lock(), False, ""

    @property
    def busy(self) -> bool:
        """Whether it has been asked for and is not at its end."""
        return self._wanted and len(self._ticks) < len(self.times) and not self._failed

    @property
    def note(self) -> str:
        """How far it is, or how it failed."""
        share = len(self._ticks) / len(self.times)
        return f"the scene is being run: {share:.0%}" if self.busy else self._failed

    def at(self, t: float) -> Tick:
        """Return the tick at a time [s], the last where it has not come so far."""
        self._wanted = self._wanted or t > 0
        return self._ticks[min(round(t * self._rate), len(self._ticks) - 1)]

    def work(self, seconds: float) -> None:
        """Go on for about that time."""
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
                        self._failed = f"at {self._loop.tick.t:.2f} s {self._loop.ended}"
        finally:
            self._working.release()


class _Replay:
    """The ticks of a log.

    A log has the joints' positions and the wrench that was asked for; grasp and hand are read from
    the model there, as of joints at rest. A contact's engagement and the force that the physics
    gave it are those of the log's contact at its place.
    """

    def __init__(self, trial: Trial, loop: Loop, log: Log) -> None:
        first = loop.tick
        shape = (len(first.qpos), len(first.points))
        if (log.qpos.shape[1], log.point.shape[1]) != shape or not np.allclose(
            log.qpos[0], first.qpos, atol=_START
        ):
            raise InvalidInputError(
                f"log: got one that begins at other joint positions than {trial.name}, expected "
                "one of that scene"
            )
        self.times: Array = log.t
        self._trial, self._log, self._fingers = trial, log, first.fingers
        self._alpha = loop.alpha
        problem = first.problem
        assert problem is not None  # as of a loop
        self._c_max = float(problem.c_max.max()) if problem.layout.ceilings else None
        self._data, self._reading = mj.MjData(trial.model), threading.Lock()
        self._at = lru_cache(len(self.times))(self._read)

    @property
    def busy(self) -> bool:
        """Whether there is something to compute: never."""
        return False

    @property
    def note(self) -> str:
        """How the run ended, where it did before its time."""
        return self._log.message

    def work(self, seconds: float) -> None:
        """There is nothing to compute beforehand."""

    def at(self, t: float) -> Tick:
        """Return the tick at a time [s]."""
        return self._at(min(round(t * self._trial.rate), len(self.times) - 1))

    def _read(self, k: int) -> Tick:
        log, trial = self._log, self._trial
        t, qpos, origin, f = float(log.t[k]), log.qpos[k], log.position[k], log.f[k]
        with self._reading, silenced_warnings(), warnings.catch_warnings():
            warnings.simplefilter("ignore", GraspForceWarning)
            self._data.qpos[:] = qpos
            mj.mj_forward(trial.model, self._data)
            try:
                grasp = Grasp.from_mujoco(trial.model, self._data, trial.body)
            except GraspForceError:  # nothing that a motor moves touches any more
                nothing = np.zeros((0, 3))
                return Tick(t, qpos, nothing, nothing[:, None], (), (), origin, f, None, nothing)
            links = grasp.links
        points = np.array([each.point for each in grasp.contacts])
        frames = np.array([each.frame for each in grasp.contacts])
        apart = np.linalg.norm(points[:, None] - log.point[k], axis=2)
        nearest = apart.argmin(axis=1)
        known = apart.min(axis=1) < _SAME
        force = np.zeros((len(points), 3))
        for slot in np.flatnonzero(np.any(log.force[k], axis=1)).tolist():
            force[apart[:, slot].argmin()] += log.force[k, slot]
        options: dict[str, Any] = {"alpha": self._alpha}
        if self._c_max is not None:
            engagement = np.where(known, log.engagement[k][nearest], 1.0)
            options |= {"c_max": self._c_max, "engagement": engagement}
        problem = grasp.problem(f, **options)
        mu = trial.assumed_mu if trial.fingers else trial.mu
        if mu is not None:
            models = [model_of(m.dim, mu, getattr(m, "gamma", 1.0)) for m in problem.models]
            problem = problem.replace(models=models)
        slots: list[int] = np.where(known, nearest, -1).tolist()
        fingers = tuple(
            link if slot < 0 else self._fingers[slot]
            for slot, link in zip(slots, links, strict=True)
        )
        return Tick(t, qpos, points, frames, fingers, grasp.joint_names, origin, f, problem, force)
