"""A closed loop in physics that goes on while one plays with it.

It is the loop of :mod:`graspforce.sim`, a tick at a time: the page pushes the object, lifts a
finger, lowers the friction or changes alpha between two ticks.
"""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np

from graspforce._util.arrays import Array
from graspforce.contact import Contact
from graspforce.problem import ForceProblem
from graspforce.regrasp import Release
from graspforce.sim import FingerSwing, Trial
from graspforce.sim.controller import Controller
from graspforce.sim.loop import DROPPED_DISTANCE
from graspforce.sim.mujoco_import import silenced_warnings
from graspforce.sim.world import World

# A lifted finger is off the object for this long, with ramps of a quarter [s], this high [m].
_AWAY, _RAMP, _LIFT = 1.0, 0.25, 0.012
# Where the trial has no ceiling, which a finger needs to leave [N].
_CEILING = 20.0


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What one control tick came to.

    Attributes:
        t: [s].
        qpos: the model's joint positions, shape (nq,).
        contacts: where the forces act, world axes, one a finger.
        origin: the object's centre of mass, shape (3,) [m].
        problem: the force problem of the controller.
        force: that the physics gave, world axes, shape (n, 3) [N].
    """

    t: float
    qpos: Array
    contacts: tuple[Contact, ...]
    origin: Array
    problem: ForceProblem
    force: Array


class Loop:
    """A trial that is under way.

    Args:
        trial: the scene; its own disturbances are left out.

    Attributes:
        ended: why it goes no further; empty while it does.
        tick: the last one.
    """

    def __init__(self, trial: Trial) -> None:
        self._start = trial
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self._trial = trial = self._start
        self._world = World(trial)
        self._friction: Array = self._world.model.geom_friction.copy()
        self._controller = Controller(trial, self._world)
        self._pose, self._touches = self._world.pose(), self._world.touches()
        self._ticks, self.ended = 0, ""
        self.step()

    def step(self) -> None:
        """Run one control tick."""
        world, trial = self._world, self._trial
        t = self._ticks / trial.rate
        command = self._controller.step(t, self._pose, self._touches)
        qpos, origin = world.data.qpos.copy(), self._pose.position
        for _ in range(trial.substeps):
            world.step(command.tau)
            if world.failure():
                self.ended = world.failure()
                break
            self._pose, self._touches = world.pose(), world.touches()
        self._ticks += 1
        self.tick = Tick(
            t, qpos, command.contacts, origin, command.solution.problem, world.forces.copy()
        )  # fmt: skip
        assert trial.motion is not None  # as of named fingers
        off = float(np.linalg.norm(self._pose.position - trial.motion.at(t).position))
        if not self.ended and off > DROPPED_DISTANCE:
            self.ended = "the object was dropped"

    def advance(self, seconds: float, budget: float) -> float:
        """Run for a time, or for as much of it as a budget of computing allows [s].

        Returns:
            The time that was simulated [s].
        """
        begun, first = time.monotonic(), self._ticks
        with silenced_warnings():
            while (self._ticks - first) / self._trial.rate < seconds and not self.ended:
                self.step()
                if time.monotonic() - begun > budget:
                    break
        return (self._ticks - first) / self._trial.rate

    def set(self, alpha: float, friction: float, push: Array) -> None:
        """Set what the page can change between ticks.

        Args:
            alpha: of the controller.
            friction: factor on the friction of the physics, which the controller does not know.
            push: force on the object's centre, shape (3,) [N].
        """
        world: Any = self._world
        world.model.geom_friction[:, 0] = friction * self._friction[:, 0]
        world.push(push)
        if alpha != self._trial.alpha:
            self._change(alpha=alpha)

    def lift(self, finger: int) -> None:
        """Let a finger leave the object and come back, beginning soon."""
        trial = self._trial
        leave = self._ticks / trial.rate + _RAMP + 0.05
        if any(
            leave < s.release.back + 2 * _RAMP for s in trial.steps if s.release.finger == finger
        ):
            return  # it is on its way already
        grip = trial.grips[finger]
        swing = FingerSwing(Release(finger, leave, leave + _AWAY, _RAMP), grip, grip, _LIFT)
        self._change(steps=(*trial.steps, swing), c_max=trial.c_max or _CEILING)

    def _change(self, **changes: Any) -> None:
        """Go on with another controller, which starts from what it measures."""
        self._trial = dataclasses.replace(self._trial, **changes)
        self._controller = Controller(self._trial, self._world)
