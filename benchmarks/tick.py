"""Time a warm tick, a cold solve and the import on this machine: the paper's dynamic task.

Run with ``make bench``; ``--save FILE`` writes the table with machine and date beside the others in
``benchmarks/results/``.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import graspforce as gf
from graspforce import scenarios


def cpu() -> str:
    """Return the processor's name as the system gives it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]} ({len(names)} cores)" if names else platform.processor()


def timed(calls: list[Callable[[], object]], rounds: int) -> np.ndarray:
    """Return the time of every call over all rounds, less the clock's own, in µs."""
    clock = time.perf_counter_ns
    times = np.empty((rounds, len(calls)))
    for i in range(rounds):
        for j, call in enumerate(calls):
            start = clock()
            call()
            times[i, j] = clock() - start
    empty = [-(clock() - clock()) for _ in range(1000)]
    return (times[1:].ravel() - np.median(empty)) / 1000


def import_time() -> float:
    """Return the least time that importing graspforce takes after NumPy, in ms.

    In fresh interpreters with cached bytecode, as after an installation; the cache is a folder of
    the benchmark's own, so that a setting against writing bytecode does not count.
    """
    code = (
        "import time, numpy; t = time.perf_counter(); import graspforce; "
        "print(time.perf_counter() - t)"
    )
    with tempfile.TemporaryDirectory() as cache:
        settings = {key: v for key, v in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        settings["PYTHONPYCACHEPREFIX"] = cache
        command = [sys.executable, "-c", code]
        runs = [
            subprocess.run(command, capture_output=True, check=True, env=settings).stdout
            for _ in range(10)
        ]
    return 1000 * min(map(float, runs))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, help="also write the table to this file")
    options = parser.parse_args()

    problems = list(scenarios.dynamic().problems())
    servo = gf.Servo(problems[0])
    ticks = [
        partial(servo.step, f=np.array(p.f), W=np.array(p.W), J=np.array(p.J)) for p in problems
    ]
    warm = timed(ticks, rounds=20)
    cold = timed([partial(gf.solve, p) for p in problems], rounds=10)
    rows = [
        ("warm tick, servo.step(f=, W=, J=)", *np.percentile(warm, [50, 99]), "µs"),
        ("cold solve(problem)", *np.percentile(cold, [50, 99]), "µs"),
        ("import graspforce, beyond NumPy's", import_time(), np.nan, "ms"),
    ]
    lines = [
        f"{cpu()}, Python {platform.python_version()}, NumPy {np.__version__}, "
        f"graspforce {gf.__version__}, {datetime.date.today()}",
        "the paper's dynamic task: 4 fingers, 12 joints, alpha 5, tol 1e-9",
        f"{'':36} {'p50':>8} {'p99':>8}",
    ]
    lines += [f"{name:36} {p50:8.2f} {p99:8.2f} {unit}" for name, p50, p99, unit in rows]
    text = "\n".join(lines).replace("     nan", "        ")
    print(text)
    if options.save:
        options.save.write_text(text + "\n")


if __name__ == "__main__":
    main()
