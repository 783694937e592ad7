"""A closed loop in physics that goes on while one plays with it.

It is the loop of :func:`graspforce.sim.run`, a tick at a time: the page pushes the object, lifts a
named finger, lowers the friction or changes alpha between two ticks.
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
from graspforce.sim import Disturbance, FingerSwing, Trial
from graspforce.sim.loop import DROPPED_DISTANCE, closed
from graspforce.sim.mujoco_import import silenced_warnings

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
        points: where the forces act, world axes, shape (n, 3) [m]; of places for contacts that
            there may be, too.
        frames: columns normal (into the object), x, y, shape (n, 3, 3).
        fingers: what makes each.
        joints: those of the force problem.
        origin: the object's centre of mass, shape (3,) [m].
        f: wrench that was asked for, about it, shape (6,) [N, N·m].
        problem: the force problem of the controller; None where a log has nothing that touches.
        force: that the physics gave, world axes, shape (n, 3) [N].
    """

    t: float
    qpos: Array
    points: Array
    frames: Array
    fingers: tuple[str, ...]
    joints: tuple[str, ...]
    origin: Array
    f: Array
    problem: ForceProblem | None
    force: Array

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Where the forces act, as contacts."""
        models = () if self.problem is None else self.problem.models
        return tuple(
            Contact(point, frame[:, 0], model, frame[:, 1])
            for point, frame, model in zip(self.points, self.frames, models, strict=True)
        )


class Loop:
    """A trial that is under way.

    Args:
        trial: the scene.
        disturbed: whether its own disturbances act.

    Attributes:
        mass: of the object at the start, or of the whole robot on its feet [kg].
        free: whether the object moves freely, its weight and pushes being rows of the problem.
        ended: why it goes no further; empty while it does.
        tick: the last one.
    """

    def __init__(self, trial: Trial, disturbed: bool = True) -> None:
        self._start = trial if disturbed else dataclasses.replace(trial, disturbance=Disturbance())
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self._trial, self._applied = self._start, np.zeros(6)
        with silenced_warnings():
            self._side = closed(self._trial)
            self._pose = self._side.world.pose()
            self._ticks, self.ended = 0, ""
            self.mass = self._side.world.mass
            self.free = self._side.free
            self.step()

    @property
    def alpha(self) -> float:
        """Weight of the linear limits."""
        alpha = self._side.alpha
        assert alpha is not None  # as of the first tick, which was done
        return alpha

    def step(self) -> None:
        """Run one control tick."""
        side, trial, world = self._side, self._trial, self._side.world
        t = self._ticks / trial.rate
        target, _ = side.target(t)
        command = side.decide(t, self._pose)
        qpos, origin = world.data.qpos.copy(), self._pose.position
        (points, frames), fingers, joints = side.decided, side.fingers, side.joints
        tau = side.disturbance.delayed(command.tau)
        for _ in range(trial.substeps):
            side.disturbance.apply(world.data.time)
            if not trial.disturbance.pushes:
                world.push(self._applied)
            side.step(tau)
            if world.failure():
                self.ended = world.failure()
                break
            self._pose = world.pose()
        self._ticks += 1
        self.tick = Tick(
            t, qpos, points, frames, fingers, joints, origin, command.f,
            command.solution.problem, side.forces.copy(),
        )  # fmt: skip
        if not self.ended and np.linalg.norm(self._pose.position - target) > DROPPED_DISTANCE:
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

    def set(self, alpha: float, friction: float, applied: Array) -> None:
        """Set what the page can change between ticks.

        Args:
            alpha: of the controller.
            friction: factor on the friction of the physics, which the controller does not know.
            applied: on the object's centre, [force; torque], shape (6,) [N, N·m].
        """
        self._applied = applied
        self._side.disturbance.set_friction(friction)
        if alpha != self.alpha:
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
        self._trial = dataclasses.replace(self._trial, **changes)
        self._side.plan(self._trial)
