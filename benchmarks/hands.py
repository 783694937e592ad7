"""Hands of eight kinds in physics: what they hold, and against what people do today.

Minutes: ``python benchmarks/hands.py``. The first table is the loop's: hold, move by 2 cm, turn
by 20°, shake at 1 g. The second puts other ways to choose the forces into the same loop, with the
same closing, law and motors, under disturbances:

- constant squeeze: every contact's normal force is what it was at first, whatever the object needs;
- position servo with an offset: the joints' positions at first, held by PD laws, and the torques at
  first as the offset, no force control;
- LP, 4 facets: the least largest normal force in friction pyramids with four facets (HiGHS).
"""

from __future__ import annotations

import argparse
import sys
import time

import mujoco
import numpy as np
from rich.table import Table
from saving import show, writable

from graspforce import sim
from graspforce.baselines import lp
from graspforce.problem import ForceProblem
from graspforce.sim import loop as running
from graspforce.sim.hand_loop import HandLoop

MOVE, TURN = (0.0, 0.0, 0.02), 20.0
STUDIED = ("panda", "palm")
KINDS = ("none", "push", "friction")
TICKS = 5100


class ConstantSqueeze(HandLoop):
    """The forces of the first tick, for ever."""

    def decide(self, t, pose, seen):
        """Return the tick's torques."""
        if t == 0:
            self._first = super().decide(t, pose, seen)
            self._given = self._first.solution
            return self._first
        now = super().decide(t, pose, seen)
        _, hand = self.reader.maps(self.book.points, self.book.axes, self._dims, self._bodies)
        tau = hand.tau_bias + hand.J.T @ self._given.c
        return now._replace(tau=np.clip(tau, self.tau_lo, self.tau_hi))


class PositionServo(HandLoop):
    """The positions of the first tick, by PD laws, with its torques as an offset."""

    def decide(self, t, pose, seen):
        """Return the tick's torques."""
        now = super().decide(t, pose, seen)
        dofs, driven = self.reader.motion
        M = np.diag(self._inertia_of_motors(dofs, driven)[0])
        if t == 0:
            self._offset = now.tau
        off = self.motors.lengths(self._data) - self._lengths
        tau = self._offset - M * (900.0 * off + 60.0 * self.motors.rates(self._data))
        return now._replace(tau=np.clip(tau, self.tau_lo, self.tau_hi), kept=False)


class FourFacets(HandLoop):
    """The least largest normal force in pyramids."""

    def _distribute(self, f, W, hand, bias):
        ours = super()._distribute(f, W, hand, bias).problem
        fields = ("J", "tau_lo", "tau_hi", "tau_bias", "c_max", "engagement")
        exact = ForceProblem(
            ours.W, ours.f, ours.models, **{name: getattr(ours, name) for name in fields}
        )
        return lp.solve(exact, facets=4, objective="normal")


WAYS = {
    "graspforce": HandLoop,
    "constant squeeze": ConstantSqueeze,
    "position servo": PositionServo,
    "LP, 4 facets": FourFacets,
}


def run(trial: sim.Trial, way: type[HandLoop] = HandLoop) -> sim.Log:
    """Run a trial with another way to choose the forces."""
    ours, running.HandLoop = running.HandLoop, way
    try:
        return sim.run(trial)
    finally:
        running.HandLoop = ours


def holding() -> Table:
    table = Table(title=f"0.2 kg for 2 s, largest values of the run, MuJoCo {mujoco.__version__}")
    for heading in (
        "hand", "motion", "ending", "position", "rotation", "slip", "normal force", "torque",
        "torque step", "kept", "close",
    ):  # fmt: skip
        table.add_column(heading, justify="left" if heading in ("hand", "motion") else "right")
    for name in sim.HANDS:
        model = sim.hand_model(name)
        options = {
            "hold": {},
            f"{1e3 * np.linalg.norm(MOVE):.0f} mm, {TURN:g}°": {"move": MOVE, "turn": TURN},
            "shaken at 1 g, 2 Hz": {"shake": 1.0},
            "10 % of contacts unseen": {"disturbance": "dropout"},
        }  # fmt: skip
        for motion, option in options.items():
            begin = time.perf_counter()
            (trial,) = sim.own(model, "object", duration=2.0, **option)
            closing = time.perf_counter() - begin
            log = run(trial)
            steps = np.abs(np.diff(log.tau[1:], axis=0)).max()
            table.add_row(
                name, motion, log.verdict, f"{1e3 * log.position_error.max():.3f} mm",
                f"{np.degrees(log.rotation_error.max()):.2f}°", f"{1e3 * log.slip.max():.3f} mm",
                f"{log.normal_force.max():.1f} N", f"{100 * log.torque_use:.0f} %",
                f"{steps:.3f}", str(int(log.kept.sum())), f"{closing:.1f} s",
            )  # fmt: skip
    return table


def cell(log: sim.Log) -> str:
    """Return how far the object was off at most, the slip and the largest normal force."""
    if not log.held:
        return "drops"
    off, slip = 1e3 * log.position_error.max(), 1e3 * log.slip.max()
    return f"off {off:.2f}, slip {slip:.2f}, {log.normal_force.max():.1f} N"


def against() -> Table:
    table = Table(
        title="moved by 20 mm in other ways: off its target and slip in mm, largest force"
    )
    for heading in ("hand", "disturbance", *WAYS):
        table.add_column(heading)
    for name in STUDIED:
        model = sim.hand_model(name)
        for kind in KINDS:
            (trial,) = sim.own(model, "object", move=(0, 0, 0.02), duration=0.8, disturbance=kind)
            table.add_row(name, kind, *(cell(run(trial, way)) for way in WAYS.values()))
    return table


def pace(name: str) -> tuple[int, np.ndarray, np.ndarray]:
    """Return contacts, and times of ticks paced at 1 kHz [µs]: of the loop, and of the physics."""
    model = sim.hand_model(name)
    data = mujoco.MjData(model)
    data.qpos[:] = sim.close(model, "object")
    mujoco.mj_forward(model, data)
    loop = sim.HandLoop(model, data, "object")
    times, due = np.empty((TICKS, 2)), time.perf_counter()
    for tick in times:
        begin = time.perf_counter()
        mujoco.mj_step1(model, data)
        seen = time.perf_counter()
        loop.step(data.time)
        sent = time.perf_counter()
        mujoco.mj_step2(model, data)
        end = time.perf_counter()
        tick[:] = 1e6 * (sent - seen), 1e6 * (seen - begin + end - sent)
        due = max(due + 1e-3, time.perf_counter())
        time.sleep(max(0.0, due - time.perf_counter()))
    return int(loop.book.present.sum()), *times[100:].T


def paced() -> Table:
    table = Table(title="a tick of the whole loop in Python, paced at 1 kHz, and physics [µs]")
    shares = (10, 50, 99, 99.9)
    table.add_column("hand")
    for heading in ("contacts", *(f"p{share:g}" for share in shares), "physics, p50", "both, p99"):
        table.add_column(heading, justify="right")
    for name in sim.HANDS:
        contacts, times, physics = pace(name)
        numbers = (*np.percentile(times, shares), np.median(physics))
        both = np.percentile(times + physics, 99)
        table.add_row(name, str(contacts), *(f"{each:.0f}" for each in (*numbers, both)))
    return table


TABLES = {"holding": holding, "against": against, "paced": paced}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--table", choices=TABLES, help="one of the tables; else all")
    parser.add_argument("--save", type=writable, help="write the tables to this file")
    options = parser.parse_args()
    for i, (name, table) in enumerate(TABLES.items()):
        if options.table in (None, name):
            later = i > 0 or options.table is not None
            show(table(), save=options.save, width=150, append=later)
    return 0


if __name__ == "__main__":
    sys.exit(main())
