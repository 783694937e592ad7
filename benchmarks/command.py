"""What ``graspforce solve FILE --out FILE`` takes for many grasps, start and results included.

Grasps of an Allegro hand on scanned objects, repeated: 100,000 from NPZ with results to NPZ,
20,000 from JSON with their W, and as many of four contacts on a ball with their points and normals,
each with results to JSON. Each run is a process of its own: time by the clock and of the processor,
by itself and for the system on its behalf, and the peak of its memory. ``python
benchmarks/command.py --save benchmarks/results/command.txt`` takes a minute or two.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.table import Table
from saving import show, writable

from graspforce.cli.process import as_command

ROOT = Path(__file__).parents[1]
# All 193 grasps where they are, twelve of them elsewhere.
GRASPS = (ROOT.parent / "shared" / "data" / "allegro_ycb.npz", ROOT / "tests/data/allegro.npz")


def write_npz(path: Path, source: Path, count: int) -> None:
    with np.load(source) as data:
        given = {name: np.asarray(data[name]) for name in ("W", "J", "f", "mu", "tau_limit")}
    stacks = {
        name: value if value.ndim == 0 else value[np.arange(count) % len(value)]
        for name, value in given.items()
    }
    np.savez(path, **stacks)


def write_maps(path: Path, source: Path, count: int) -> None:
    with np.load(source) as data:
        given = {name: np.asarray(data[name]) for name in ("W", "J", "f", "mu", "tau_limit")}
    size = len(given["W"])
    limits = np.broadcast_to(given["tau_limit"].reshape(-1, 1), (size, given["J"].shape[2]))
    mu = np.broadcast_to(given["mu"], size)
    each = [
        {
            "W": given["W"][i].tolist(), "f": given["f"][i].tolist(), "J": given["J"][i].tolist(),
            "tau_lo": (-limits[i]).tolist(), "tau_hi": limits[i].tolist(),
            "models": 4 * [{"model": "PCWF", "mu": float(mu[i])}],
        }
        for i in range(size)
    ]  # fmt: skip
    path.write_text(json.dumps({"grasps": [each[i % size] for i in range(count)]}))


def write_contacts(path: Path, count: int) -> None:
    rng = np.random.default_rng(0)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5
    out = corners + 0.2 * rng.normal(size=(count, 4, 3))
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    each = [
        {
            "contacts": [
                {"point": p, "normal": n, "model": "PCWF", "mu": 0.6}
                for p, n in zip(points, normals, strict=True)
            ],
            "f": [0, 0, 2, 0, 0, 0], "c_max": 20,
        }
        for points, normals in zip((0.04 * out).tolist(), (-out).tolist(), strict=True)
    ]  # fmt: skip
    path.write_text(json.dumps({"grasps": each}))


def run(source: Path, target: Path) -> tuple[float, float, float, float]:
    """Seconds by the clock, of the processor and of the system, and the peak of memory [MB]."""
    command = [sys.executable, "-m", "graspforce", "solve", str(source), "--out", str(target)]
    start = time.perf_counter()
    silent = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    child = os.posix_spawn(sys.executable, command, os.environ, file_actions=silent)
    _, status, used = os.wait4(child, 0)
    if status:
        sys.exit(f"{' '.join(command)} failed")
    return time.perf_counter() - start, used.ru_utime, used.ru_stime, used.ru_maxrss / 1024


def measure(folder: Path, grasps: Path, rounds: int, share: float) -> Table:
    many, fewer = int(100_000 * share), int(20_000 * share)
    sources = {name: folder / name for name in ("many.npz", "maps.json", "contacts.json")}
    write_npz(sources["many.npz"], grasps, many)
    write_maps(sources["maps.json"], grasps, fewer)
    write_contacts(sources["contacts.json"], fewer)
    told = {
        "NPZ to NPZ": ("many.npz", "out.npz", many),
        "JSON with W to JSON": ("maps.json", "out.json", fewer),
        "JSON with contacts to JSON": ("contacts.json", "out.json", fewer),
    }
    table = Table(title="graspforce solve FILE --out FILE, the quickest of some runs")
    for heading in ("", "grasps", "s", "grasps a second", "processor [s]", "system [s]", "MB"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, (source, target, count) in told.items():
        runs = [run(sources[source], folder / target) for _ in range(rounds)]
        wall, user, system, memory = (min(each) for each in zip(*runs, strict=True))
        table.add_row(
            name, f"{count:,}", f"{wall:.2f}", f"{count / wall:,.0f}", f"{user:.2f}",
            f"{system:.2f}", f"{memory:.0f}",
        )  # fmt: skip
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--grasps", type=Path, help="an NPZ file of grasps of four fingers")
    parser.add_argument("--share", type=float, default=1.0, help="of the grasps")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    grasps = options.grasps or next(path for path in GRASPS if path.is_file())
    load = (
        f"load of the machine by others before this ran, about {os.getloadavg()[0]:.0f} processes"
    )
    with tempfile.TemporaryDirectory() as folder:
        table = measure(Path(folder), grasps, options.rounds, options.share)
    show(table, f"grasps of {grasps.name}; {load}", save=options.save, width=110)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
