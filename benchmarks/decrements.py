"""Is the certified bound on the decrement one? Random servo ticks against NumPy.

Streams of ticks over the grasps of :mod:`graspforce.scenarios.random`, with tolerances from 1e-12
to 1e-2 and alpha from 0.03 to 100: the load wanders, the object turns, J wobbles. After every tick
that is SOLVED, :func:`graspforce.equations.decrement_and_error` computes the decrement at the
forces and how far the rounding of c and W may have moved that number. Where rounding cannot be the
cause, the bound may not be passed by more than 1e-6 of itself; elsewhere not by more than rounding
besides.

``make decrements`` runs a hundred thousand ticks.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from saving import show, writable
from scipy.spatial.transform import Rotation

import graspforce as gf
from graspforce import reference
from graspforce.cli.process import as_command
from graspforce.scenarios import random
from graspforce.solution.verification import BOUND_TOLERANCE

STREAM = 50  # ticks


class Tick(NamedTuple):
    """What a tick claims, and what NumPy finds.

    Attributes:
        tol: of the settings.
        solved: whether it is SOLVED; the rest is NaN otherwise.
        bound: the certified bound on the decrement.
        measured: the decrement.
        error: how far rounding may have moved that.
    """

    tol: float
    solved: bool
    bound: float
    measured: float
    error: float

    @property
    def blurred(self) -> bool:
        """Whether rounding could pass the bound."""
        return self.error > BOUND_TOLERANCE * self.bound

    @property
    def passes(self) -> bool:
        """Whether the bound is passed, rounding or not."""
        return self.measured > (1 + BOUND_TOLERANCE) * self.bound

    @property
    def faulty(self) -> bool:
        """Whether the bound is none."""
        return self.passes and self.measured > (1 + BOUND_TOLERANCE) * self.bound + self.error


def stream(seed: int, index: int) -> list[Tick]:
    """One Servo's ticks."""
    rng = np.random.default_rng([seed, index])
    geometry, f1 = random.geometry(rng)
    tol = 10 ** rng.uniform(-12, -2)
    problem = geometry.replace(alpha=10 ** rng.uniform(-1.5, 2))
    servo = gf.Servo(problem, gf.Settings(tol=tol))
    load, step, ticks = 0.1, 10 ** rng.uniform(-4, -1), list[Tick]()
    turn, axis = 0.0, rng.normal(size=3)
    for _ in range(STREAM):
        load += step * rng.normal()
        turn += 0.1 * step
        R = np.kron(np.eye(2), Rotation.from_rotvec(turn * axis).as_matrix())
        changes = {"W": R @ problem.W, "f": R @ (problem.f + load * f1)}
        if problem.layout.joints:
            changes["J"] = problem.J * (1 + 0.1 * step * rng.normal(size=problem.J.shape))
        solution = servo.step(**changes)
        solved = solution.status is gf.Status.SOLVED
        found = (np.nan, np.nan)
        if solved:
            found = reference.decrement_and_error(solution.c, solution.problem)
        ticks.append(Tick(tol, solved, solution.decrement if solved else np.nan, *found))
    return ticks


def run(seed: int, ticks: int, jobs: int = 1) -> list[Tick]:
    """All ticks of as many streams as it takes."""
    count = -(-ticks // STREAM)
    with multiprocessing.Pool(jobs) as pool:
        streams = pool.imap(partial(stream, seed), range(count), chunksize=4)
        console = Console(stderr=True)
        return [tick for each in track(streams, "ticks", count, console=console) for tick in each]


def table(ticks: Sequence[Tick], seed: int) -> Table:
    """Ticks by tolerance."""
    result = Table(title=f"decrement over its certified bound, seed {seed}, {len(ticks):,} ticks")
    for heading in (
        "tol", "solved", "rounding out of question", "largest ratio there", "rounding possible",
        "bound passed there", "by more than rounding",
    ):  # fmt: skip
        result.add_column(heading, justify="right")
    for low in (-12, -10, -8, -6, -4):
        solved = [t for t in ticks if t.solved and 10.0**low <= t.tol < 10.0 ** (low + 2)]
        clear = [t for t in solved if not t.blurred]
        blurred = [t for t in solved if t.blurred]
        largest = max((t.measured / t.bound for t in clear if t.bound > 0), default=np.nan)
        result.add_row(
            f"1e{low}…1e{low + 2}", f"{len(solved):,}", f"{len(clear):,}", f"{largest:.9f}",
            f"{len(blurred):,}", str(sum(t.passes for t in blurred)),
            str(sum(t.faulty for t in solved)),
        )  # fmt: skip
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ticks", type=int, default=10_000)
    parser.add_argument("--jobs", type=int, default=multiprocessing.cpu_count())
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    ticks = run(options.seed, options.ticks, options.jobs)
    show(table(ticks, options.seed), save=options.save, width=120)
    return int(any(tick.faulty for tick in ticks))


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
