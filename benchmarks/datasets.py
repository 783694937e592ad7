"""How many rows a second ``graspforce batch`` reads, solves and writes, and in how much memory.

Matrices are random feasible grasps of four fingers with three joints each, W, f, J, mu and alpha a
row each (1.8 kB); geometry is four contacts on a ball with a mass. Each run is a process of its
own, whose peak of memory is told; of the engine ray it is the driver's alone. ``python
benchmarks/datasets.py --save benchmarks/results/datasets.txt`` takes some ten minutes and 30 GB of
disk, less with ``--rows 100000``.
"""

from __future__ import annotations

import argparse
import filecmp
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from batch import rows
from memory import peak_memory
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.cli.process import as_command
from graspforce.datasets.ragged import as_lists

LIMITS = {"tau_lo": -0.5, "tau_hi": 0.5}
# Rows that are in memory at once while a source is made, and those of a row group.
MADE_AT_ONCE = 131072
KILLS = 10


def write_matrices(path: Path, count: int) -> None:
    fields, _ = rows(min(count, MADE_AT_ONCE))
    columns = {
        name: pa.array(value) if value.ndim == 1 else as_lists(value.reshape(len(value), -1))
        for name, value in fields.items()
    }
    write_repeated(path, pa.table(columns), count)


def write_geometry(path: Path, count: int) -> None:
    rng, some = np.random.default_rng(0), min(count, MADE_AT_ONCE)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5
    out = corners + 0.2 * rng.normal(size=(some, 4, 3))
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    columns = {
        "points": as_lists((0.04 * out).reshape(some, -1)),
        "normals": as_lists(-out.reshape(some, -1)),
        "mu": as_lists(rng.uniform(0.4, 0.9, (some, 4))),
        "mass": pa.array(rng.uniform(0.05, 0.5, some)),
    }
    write_repeated(path, pa.table(columns), count)


def write_repeated(path: Path, table: Any, count: int) -> None:
    options = {"compression": "none", "use_dictionary": False}
    with pq.ParquetWriter(path, table.schema, **options) as writer:
        for first in range(0, count, len(table)):
            writer.write_table(table.slice(0, min(len(table), count - first)), MADE_AT_ONCE)


def run(source: Path, target: Path, **options: Any) -> dict[str, float]:
    """Solve a source in a process of its own; return rows, seconds, processor time and memory."""
    given = json.dumps([str(source), str(target), options])
    command = [sys.executable, __file__, "--run", given]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def run_here(source: str, target: str, options: dict[str, Any]) -> None:
    before = time.process_time()
    summary = gf.datasets.solve_dataset(source, target, **options)
    used = {
        "rows": summary.counts.rows,
        "solved": summary.counts.solved,
        "seconds": summary.seconds,
        "processor": time.process_time() - before,
        "memory": peak_memory(),
    }
    print(json.dumps(used))


def kill_and_resume(source: Path, whole: Path, target: Path) -> str:
    """Kill a run at random moments, let the last one end, and compare it with an unbroken one."""
    rng = np.random.default_rng(0)
    command = [sys.executable, "-m", "graspforce", "batch", str(source), str(target)]
    command += [f"--set={name}={value}" for name, value in LIMITS.items()]
    parts = len(list(whole.glob("part-*")))
    killed = 0
    for i in range(KILLS):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        wanted = (i + rng.random()) / KILLS * parts
        while process.poll() is None and len(list(target.glob("part-*"))) < wanted:
            time.sleep(0.001)
        time.sleep(0.2 * rng.random())
        killed += process.poll() is None
        process.send_signal(signal.SIGKILL)
        process.wait()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    names = [path.name for path in whole.iterdir()]
    same = filecmp.cmpfiles(whole, target, names, shallow=False)[0]
    equal = sorted(same) == sorted(names) == sorted(path.name for path in target.iterdir())
    said = "equal to" if equal else "NOT equal to"
    return f"killed {killed} times with SIGKILL and gone on with: {said} an unbroken run"


def measure(folder: Path, count: int, many: int) -> tuple[Table, list[str]]:
    matrices, geometry = folder / "matrices.parquet", folder / "geometry.parquet"
    write_matrices(matrices, count)
    write_geometry(geometry, count)
    (folder / "many").mkdir()
    for i in range(many):
        (folder / "many" / f"{i}.parquet").symlink_to(matrices)
    target = folder / "out"
    runs: dict[str, tuple[Path, dict[str, Any]]] = {
        "matrices, local": (matrices, LIMITS),
        "matrices, local, slip reserve": (matrices, LIMITS | {"slip_reserve": 0.02}),
        "geometry, local": (geometry, {"c_max": 20}),
        "geometry, local, six directions": (geometry, {"c_max": 20, "gravity": "sphere"}),
        f"matrices, local, {many} files": (folder / "many", LIMITS),
    }
    if find_spec("ray"):
        runs["matrices, ray"] = matrices, LIMITS | {"engine": "ray"}
    table = Table(title="rows of the source, read, solved and written")
    for heading in ("", "rows", "rows/s", "µs of processor a row", "peak memory [MB]"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, (source, options) in runs.items():
        used = run(source, target, **options)
        of_processor = "" if "ray" in name else f"{1e6 * used['processor'] / used['rows']:.2f}"
        table.add_row(
            name, f"{used['rows']:,}", f"{used['rows'] / used['seconds']:,.0f}", of_processor,
            f"{used['memory']:.0f}",
        )  # fmt: skip
        if name == "matrices, local":
            target.rename(folder / "whole")
        else:
            shutil.rmtree(target)
    return table, [kill_and_resume(matrices, folder / "whole", target)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--rows", type=int, default=1_000_000, help="of each source")
    parser.add_argument("--files", type=int, default=10, help="of the source of many files")
    parser.add_argument("--folder", type=Path, help="where sources and targets are made")
    parser.add_argument("--save", type=writable, help="write the table to this file")
    parser.add_argument("--run", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.run:
        run_here(*json.loads(options.run))
        return 0
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        table, notes = measure(Path(folder), options.rows, options.files)
    notes.append(f"load of the machine by others before this ran, about {load:.0f} processes")
    show(table, *notes, save=options.save, width=100)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
