"""How many instructions a tick of each method executes, counted by Valgrind.

Formulas (``graspforce.study.compare.flops``) count arithmetic; this counts everything that the
machine does, Python's part included, on the paper's dynamic task. Hardware counters are often
closed to virtual machines, so Callgrind simulates: a child process runs a method a few times,
another one some times more, and the difference of their totals is what the further ticks took.
Needs ``valgrind`` (apt-get install valgrind), some minutes: ``python benchmarks/instructions.py``.
"""

from __future__ import annotations

import argparse
import gc
import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from saving import show, writable

from graspforce import _core, _engine, scenarios
from graspforce.cli.process import as_command
from graspforce.study.compare import methods

FIRST = 2  # ticks that warm up, in a stream and otherwise
TICKS = {"wbf": 200, "gradient_flow": 1, "neural_network": 2}  # to count; of the others MANY
MANY = 10

CORE, SOFT = "wbf, C++ alone", "wbf, C++ alone, soft wrench"
# What the core may take with AVX2, which is what Valgrind offers it at most; from scratch or not.
MOST = {True: 6_687, False: 2_244}
# What a warm tick may take with a soft wrench, of what it takes without.
MOST_SOFT = 1.03

# A name, how many ticks to count, and what makes a function that runs so many.
Work = tuple[str, int, Callable[[], Callable[[int], object]]]


def works() -> list[Work]:
    """Everything to count, cold and warm."""
    problems = list(scenarios.dynamic().problems())
    soft = [problem.replace(f_soft=1e-3) for problem in problems]

    def ticks(make: Callable[[], Callable[..., object]]) -> Callable[[], Callable[[int], object]]:
        def prepare() -> Callable[[int], object]:
            call = make()
            for problem in problems[:FIRST]:
                call(problem)
            return lambda count: [call(problem) for problem in problems[FIRST : FIRST + count]]

        return prepare

    found: list[Work] = []
    for cold in (True, False):
        found.append((f"{CORE}|{cold}", len(problems), lambda cold=cold: _native(problems, cold)))
        found.append((f"{SOFT}|{cold}", len(problems), lambda cold=cold: _native(soft, cold)))
    for name in methods.NAMES:
        if name == "socp_norm_moreau":  # its threads do not survive a fork
            continue
        if name == "socp_norm_ecos" and importlib.util.find_spec("ecos") is None:
            continue
        method, count = methods.method(name), TICKS.get(name, MANY)
        found.append((f"{name}|True", count, ticks(lambda method=method: method.cold)))
        if method.warm is not None:
            found.append((f"{name}|False", count, ticks(method.warm)))
    return found


def _native(problems: list, cold: bool) -> Callable[[int], object]:
    """Whole rounds of the stream, whose first one does not count in the difference."""
    stream, module = np.stack([problem.packed for problem in problems]), _engine.module
    return lambda count: module.time_ticks(
        problems[0].layout, stream, count // len(problems), 1e-9, 100, cold
    )


def count_all(core_alone: bool) -> None:
    """Fork a child for every count; runs under Valgrind, one output file a process."""
    gc.disable()
    for name, count, prepare in works():
        if core_alone and not name.startswith(CORE):
            continue
        run = prepare()
        for ticks in (count, 2 * count):
            child = os.fork()
            if child == 0:
                run(ticks)
                os._exit(0)
            os.waitpid(child, 0)
            print(f"{child}|{name}|{ticks}", flush=True)


def measure(tell: Callable[[str], None], core_alone: bool = False) -> dict[tuple[str, bool], float]:
    """Return instructions a tick by name and whether from scratch."""
    quiet = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
    with tempfile.TemporaryDirectory() as folder:
        command = ["valgrind", "--quiet", "--tool=callgrind", f"--callgrind-out-file={folder}/%p",
                   sys.executable, __file__, "--inside", *["--gate"] * core_alone]  # fmt: skip
        run = subprocess.Popen(command, env=os.environ | quiet, stdout=subprocess.PIPE, text=True)
        totals: dict[tuple[str, bool], list[tuple[int, int]]] = {}
        assert run.stdout is not None
        for line in run.stdout:
            child, name, cold, ticks = line.strip().split("|")
            tell(name)
            key = (name, cold == "True")
            totals.setdefault(key, []).append((int(ticks), read_total(Path(folder) / child)))
        if run.wait():
            raise SystemExit("valgrind, or what it ran, failed")
    return {
        key: (more - less) / (many - few) for key, [(few, less), (many, more)] in totals.items()
    }


def read_total(path: Path) -> int:
    """Return the instructions that a Callgrind file sums up to."""
    lines = [line for line in path.read_text().splitlines() if line.startswith("totals:")]
    return int(lines[-1].split()[1])


def table(found: dict[tuple[str, bool], float]) -> Table:
    result = Table(title="thousand instructions a tick by Callgrind, the paper's dynamic task")
    for heading in ("method", "from scratch", "from the tick before"):
        result.add_column(heading, justify="left" if heading == "method" else "right")
    for name in dict.fromkeys(name for name, _ in found):
        values = [found.get((name, cold)) for cold in (True, False)]
        result.add_row(name, *("–" if v is None else f"{v / 1e3:,.1f}" for v in values))
    return result


def gate() -> int:
    """Count the core alone and compare it with MOST; 1 where it takes more."""
    if not {"avx2", "avx512"} & set(_core.instruction_sets()):
        print("this processor has no AVX2, for which the limits are made")
        return 0
    found = measure(lambda _: None, core_alone=True)
    for cold, most in MOST.items():
        words = "cold solve" if cold else "warm tick"
        print(f"{words}: {found[CORE, cold]:,.0f} instructions, {most:,} at most")
    ratio = found[SOFT, False] / found[CORE, False]
    print(f"warm tick with a soft wrench: {ratio:.3f} of that, {MOST_SOFT} at most")
    return int(ratio > MOST_SOFT or any(found[CORE, cold] > most for cold, most in MOST.items()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--save", type=writable, help="write the table to this file")
    parser.add_argument(
        "--gate", action="store_true", help="count the core alone, and fail where it takes more"
    )
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:
        count_all(options.gate)
        return 0
    if options.gate:
        return gate()
    console = Console()
    with console.status("counting") as status:
        found = measure(lambda name: status.update(f"counted {name}"))
    show(table(found), save=options.save, width=90)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
