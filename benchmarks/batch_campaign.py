"""What ``solve_batch`` promises, on a million problems: what ``solve`` says, whatever the threads.

Each chunk of rows has a layout of its own: three to nine contacts of one kind or mixed, with
joints, ceilings, both or neither. Weights are 0.01 to 1000; among the rows are overloaded grasps,
doubled contacts that leave W without its rank, joints without an arm and numbers that make no
problem. Measured beside it: the memory for ten million problems from an iterator of chunks, and
how long Ctrl-C takes. ``make batch-campaign``, some 15 minutes.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from memory import peak_memory
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.batch import BatchProblems
from graspforce.cli.process import as_command
from graspforce.contact import any_tangent
from graspforce.grasp_map import stacked_maps

CHUNK = 25_000
FOUND = ("c", "nu", "status", "newton_steps", "start", "nearest", "decrement", "violation")
# Models, and whether there are joints with torque limits, and ceilings.
KINDS = (
    ([gf.PCWF(0.5)] * 4, True, False),
    ([gf.PCWF(0.5)] * 3, True, True),
    ([gf.SFC(0.5, 0.01)] * 4, True, False),
    ([gf.PCWF(0.5), gf.SFC(0.5, 0.01), gf.FPC(), gf.PCWF(0.5), gf.FPC()], False, True),
    ([gf.PCWF(0.5)] * 8, True, False),
    ([gf.PCWF(0.5)] * 9, True, False),
    ([gf.PCWF(0.5)] * 4, False, False),
)


def chunk(number: int, count: int) -> dict[str, Any]:
    """Return arguments of solve_batch for random rows of a layout."""
    rng = np.random.default_rng(number)
    models, joints, ceilings = KINDS[number % len(KINDS)]
    n = len(models)
    out = rng.normal(size=(count, n, 3))
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    normals = -out + 0.2 * rng.normal(size=out.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    points = 0.04 * out
    doubled = rng.random(count) < 0.03  # on two points: no torque about the line between them
    for each in range(2, n):
        points[doubled, each], normals[doubled, each] = points[doubled, 0], normals[doubled, 0]
    frames = stacked_maps(np.zeros((count, 1, 3)), points, normals, any_tangent(normals))
    W = np.zeros((count, 6, sum(model.dim for model in models)))
    first = 0
    for i, model in enumerate(models):
        own = frames[:, :, 3 * i : 3 * i + min(model.dim, 3)]
        W[:, :, first : first + own.shape[2]] = own
        if model.dim == 4:
            W[:, 3:, first + 3] = normals[:, i]
        first += model.dim
    f = np.concatenate((rng.normal(size=(count, 3)), 0.02 * rng.normal(size=(count, 3))), axis=1)
    f *= 10 ** rng.uniform(-2, 1.5, (count, 1))
    f[rng.random(count) < 0.005, 2] = np.nan
    given: dict[str, Any] = {
        "W": W, "f": f, "models": models, "alpha": 10 ** rng.uniform(-2, 3, count),
        "mu": np.array([model.mu for model in models]) * rng.uniform(0.4, 2, (count, n)),
    }  # fmt: skip
    if joints:
        J = np.zeros((count, W.shape[2], 3 * n))
        first = 0
        for i, model in enumerate(models):
            size = (count, model.dim, 3)
            J[:, first : first + model.dim, 3 * i : 3 * i + 3] = 0.03 * rng.normal(size=size)
            first += model.dim
        J[rng.random(count) < 0.01] = 0  # torques that say nothing
        given |= {"J": J, "tau_lo": -0.5, "tau_hi": 0.5}
    if ceilings:
        given["c_max"] = rng.uniform(2, 40, (count, n))
    return given


def picked(given: dict[str, Any], rows: np.ndarray) -> dict[str, Any]:
    """Return some rows of them."""
    return {
        name: value[rows] if isinstance(value, np.ndarray) and name != "models" else value
        for name, value in given.items()
    }


class Tally:
    """What was seen of all rows."""

    def __init__(self) -> None:
        self.rows = self.other_status = self.other_bits = 0
        self.statuses: Counter[str] = Counter()
        self.largest = 0.0

    def add(self, number: int, count: int, settings: gf.Settings) -> None:
        """Solve a chunk one by one, by any number of threads and in another order."""
        given = chunk(number, count)
        batch = gf.solve_batch(**given, settings=settings, threads=1)
        order = np.random.default_rng(~number & 0xFFFFFFFF).permutation(count)
        others = [gf.solve_batch(**given, settings=settings, threads=n) for n in (2, 7)]
        shuffled = gf.solve_batch(**picked(given, order), settings=settings)
        for name in FOUND:
            own = getattr(batch, name)
            for each in others:
                self.other_bits += getattr(each, name).tobytes() != own.tobytes()
            self.other_bits += getattr(shuffled, name).tobytes() != own[order].tobytes()
        models = given.pop("models")
        invalid = np.isnan(given["f"]).any(axis=1)
        for row, problem in enumerate(BatchProblems.of(models, given)):
            if invalid[row]:
                self.other_status += batch.status[row] != gf.Status.INVALID_NUMBERS
                continue
            solution = gf.solve(problem, settings)
            self.other_status += batch.status[row] != solution.status
            if solution.status is gf.Status.SOLVED == batch.status[row]:
                c = solution.c
                difference = np.abs(batch.c[row] - c).max() / np.abs(c).max()
                self.largest = max(self.largest, float(difference))
        self.rows += count
        for status, times in zip(*np.unique(batch.status, return_counts=True), strict=True):
            self.statuses[gf.Status(status).name] += int(times)


def table(tally: Tally) -> Table:
    shown = Table(title=f"{tally.rows:,} random problems")
    shown.add_column("")
    shown.add_column("", justify="right")
    for name, count in tally.statuses.most_common():
        shown.add_row(name, f"{count:,}")
    shown.add_row("rows whose status solve does not share", str(tally.other_status))
    shown.add_row("largest difference of c from solve's, of its largest", f"{tally.largest:.1e}")
    shown.add_row("arrays that 2 or 7 threads, or another order, change", str(tally.other_bits))
    return shown


def many_chunks(count: int, size: int = 20_000) -> Iterator[dict[str, Any]]:
    """Yield arguments for so many rows of the first layout, each chunk of them with new loads."""
    given = chunk(0, size)
    rng = np.random.default_rng(1)
    for first in range(0, count, size):
        rows = np.arange(min(size, count - first))
        yield picked(given, rows) | {"f": given["f"][rows] * rng.uniform(0.5, 1, (len(rows), 1))}


def memory(count: int) -> None:
    """Print the peak memory of this process once so many rows are solved [MB], and the time [s]."""
    start, solved = time.perf_counter(), 0
    for given in many_chunks(count):
        solved += int(gf.solve_batch(**given).solved.sum())
    print(peak_memory(), time.perf_counter() - start, solved)


STOPPED = """
import signal, time
import batch_campaign, graspforce as gf
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a shell's background
given = batch_campaign.chunk({kind}, 200_000)
print("ready", flush=True)
try:
    while True:
        gf.solve_batch(**given)
except KeyboardInterrupt:
    print(time.clock_gettime(time.CLOCK_MONOTONIC))
"""


def time_to_stop(kind: int) -> float:
    """Return how long solve_batch goes on after a signal [s]."""
    command = [sys.executable, "-c", STOPPED.format(kind=kind)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, cwd=os.path.dirname(__file__) or "."
    ) as run:
        assert run.stdout is not None
        run.stdout.readline()
        time.sleep(0.3 + 0.05 * kind)
        sent = time.clock_gettime(time.CLOCK_MONOTONIC)
        os.kill(run.pid, signal.SIGINT)
        return float(run.stdout.read()) - sent


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--streamed", type=int, default=10_000_000, help="rows of the iterator")
    parser.add_argument("--memory", action="store_true", help="measure nothing but the memory")
    parser.add_argument("--tol", type=float, default=1e-9)
    parser.add_argument("--save", type=writable, help="write the tables to this file")
    options = parser.parse_args()
    if options.memory:
        memory(options.streamed)
        return 0
    began, tally = time.process_time(), Tally()
    for number, first in enumerate(range(0, options.rows, CHUNK)):
        tally.add(number, min(CHUNK, options.rows - first), gf.Settings(tol=options.tol))
    seconds = time.process_time() - began
    done = subprocess.run(
        [sys.executable, __file__, "--memory", "--streamed", str(options.streamed)],
        stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    peak, took, solved = map(float, done.stdout.split())
    stops = [time_to_stop(kind) for kind in range(len(KINDS)) for _ in range(2)]
    show(
        table(tally),
        f"tol = {options.tol:g}; {seconds:.0f} s of the processor",
        f"{options.streamed:,} problems of an iterator, {solved:,.0f} of them solved, in "
        f"{took:.0f} s: at most {peak:.0f} MB in memory, Python and NumPy included",
        f"Ctrl-C: {max(stops):.3f} s at most, {np.median(stops):.3f} s in the middle, of "
        f"{len(stops)} times",
        save=options.save, width=100,
    )  # fmt: skip
    return 0 if not (tally.other_status or tally.other_bits or tally.largest > 1e-9) else 1


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
