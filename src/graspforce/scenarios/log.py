"""Run a scenario through a Servo and keep what came out, tick by tick."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.outcome import Status
from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array, came, require_instance
from graspforce._util.atomic import atomic_write
from graspforce.columns import Columns
from graspforce.contact import ContactModel
from graspforce.errors import InvalidInputError
from graspforce.scenarios.scenario import Scenario
from graspforce.servo import Servo
from graspforce.solution import Solution


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """What a scenario's T ticks gave.

    Attributes:
        scenario: what was run.
        t: times, shape (T,) [s].
        f: wrenches asked for, about the cube's centre, world axes, shape (T, 6) [N, N·m].
        engagement: of every contact, shape (T, n).
        c: contact forces in the contact frames, shape (T, m) [N, N·m].
        tau: joint torques, shape (T, n_joints) [N·m].
        normal_forces: shape (T, n) [N].
        friction_residual: r_f of Eq. (22), shape (T,) [N²].
        torque_residual: r_tau, the smallest torque margin, shape (T,) [N·m].
        max_torque: the largest joint torque's size, shape (T,) [N·m].
        newton_steps: shape (T,).
        suboptimality: certified bound on Phi(c) − Phi*, shape (T,).
        status: values of :class:`graspforce.Status`, shape (T,).
    """

    scenario: Scenario
    t: Array
    f: Array
    engagement: Array
    c: Array
    tau: Array
    normal_forces: Array
    friction_residual: Array
    torque_residual: Array
    max_torque: Array
    newton_steps: NDArray[np.int64]
    suboptimality: Array
    status: NDArray[np.int64]

    def table(self) -> dict[str, list[Any]]:
        """Return every column of the CSV by its header, units in brackets; T entries each."""
        contacts = range(1, len(self.scenario.contacts) + 1)
        columns: dict[str, list[Any]] = {"t [s]": self.t.tolist()}

        def add(names: list[str], values: Array) -> None:
            columns.update(zip(names, values.T.tolist(), strict=True))

        add([f"f_{axis} [N]" for axis in "xyz"], self.f[:, :3])
        add([f"m_{axis} [Nm]" for axis in "xyz"], self.f[:, 3:])
        add([f"engagement{i}" for i in contacts], self.engagement)
        add(force_names([contact.model for contact in self.scenario.contacts]), self.c)
        add([f"tau_{name} [Nm]" for name in self.scenario.hand.joint_names], self.tau)
        columns |= {
            "friction_residual [N^2]": self.friction_residual.tolist(),
            "torque_residual [Nm]": self.torque_residual.tolist(),
            "max_torque [Nm]": self.max_torque.tolist(),
            "newton_steps": self.newton_steps.tolist(),
            "suboptimality": self.suboptimality.tolist(),
            "status": [Status(each).name for each in self.status],
        }
        return columns

    def write_csv(self, path: str | Path) -> None:
        """Write a header with units and one row a tick; numbers in full precision.

        Args:
            path: file to write; one that exists is replaced as a whole.

        Raises:
            InvalidInputError: a directory, a socket or a block device.
            OSError: the file cannot be written; what it held before is still there.
        """
        columns = self.table()
        with (
            atomic_write(path) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))

    def __repr__(self) -> str:
        solved = int((self.status == Status.SOLVED).sum())
        return f"Log({self.scenario.name}: {len(self.t)} ticks, {solved} solved)"


def force_names(models: list[ContactModel]) -> list[str]:
    """Name each entry of c, with its unit: ``c1_normal [N]``, ``c1_x [N]``, and so on."""
    parts = ("normal [N]", "x [N]", "y [N]", "torsion [Nm]")
    return [f"c{i}_{part}" for i, model in enumerate(models, 1) for part in parts[: model.dim]]


def run(
    scenario: Scenario,
    settings: Settings | None = None,
    progress: Callable[[int], None] | None = None,
) -> Log:
    """Run every tick of a scenario through one :class:`graspforce.Servo`.

    Args:
        scenario: what to run.
        settings: of the Servo.
        progress: called with the index of every tick when it is done.

    Returns:
        The log. A tick that was not SOLVED is in it with its status.

    Raises:
        InvalidInputError: an argument of the wrong kind.
    """
    require_instance(scenario, "scenario", Scenario)
    if not (progress is None or callable(progress)):
        raise InvalidInputError(f"progress: got {came(progress)}, expected a function of an index")
    servo: Servo | None = None
    solutions: list[Solution] = []
    for k, problem in enumerate(scenario.problems()):
        servo = servo or Servo(problem, settings)
        solutions.append(servo.step_to(problem))
        if progress is not None:
            progress(k)
    columns = Columns(solutions)
    return Log(
        scenario=scenario,
        t=scenario.times,
        f=columns.field("f"),
        engagement=columns.field("engagement"),
        c=columns.c,
        tau=columns.tau,
        normal_forces=columns.normal_forces,
        friction_residual=columns.friction_residual,
        torque_residual=columns.torque_residual,
        max_torque=columns.max_torque,
        newton_steps=columns.newton_steps,
        suboptimality=columns.suboptimality,
        status=columns.status,
    )
