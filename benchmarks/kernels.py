"""What a Newton step costs by each kernel, and a servo tick by the number of contacts.

The engine takes the narrowest kernels that fit a grasp (``cpp/include/graspforce/kernels.hpp``);
here each grasp is forced through all of them that fit. A kernel that is not clearly better than
the next wider one on the grasps that it is for has no reason to be there. Instructions are counted
by Callgrind, as the difference of a long and a short run; they do not show how long operations
wait for one another, so times stand beside them. Needs a C++ compiler (``CXX``) and ``valgrind``:
``python benchmarks/kernels.py``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from instructions import read_total
from rich.console import Console
from rich.table import Table
from saving import show, writable

from graspforce import _core
from graspforce.cli.process import as_command

ROOT = Path(__file__).parents[1]
FLAGS = ["-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", "-Wno-psabi"]
INCLUDE = [f"-I{ROOT / 'cpp' / folder}" for folder in ("include", "tests")]
# As CMakeLists.txt builds the core, by the processor's names for them.
SETS = {
    "avx2": ["-mavx2", "-mfma"],
    "avx512": ["-mavx2", "-mfma", "-mavx512f", "-mavx512vl", "-mavx512dq",
               "-mprefer-vector-width=256"],
}  # fmt: skip

KERNELS = (
    "general", "lanes4", "lanes3", "lanes4-small", "lanes3-small", "lanes4-plain", "lanes3-plain",
)  # fmt: skip
# Contacts, components of each, and the kernels that fit; the engine takes the last.
TASKS: dict[str, tuple[int, int, tuple[str, ...]]] = {
    "4 point contacts": (4, 3, KERNELS),
    "4 soft fingers": (4, 4, ("general", "lanes4", "lanes4-small", "lanes4-plain")),
    "8 point contacts": (8, 3, ("general", "lanes4", "lanes3")),
    "8 soft fingers": (8, 4, ("general", "lanes4")),
    "64 point contacts": (64, 3, ("general", "lanes4", "lanes3")),
}
CONTACTS = (4, 8, 16, 32, 64)
SHORT, LONG = 200, 400  # steps to count
ROUNDS = 5  # of which the best median counts: other programs only add to it


class Program:
    """``kernels.cpp``, built for an instruction set."""

    def __init__(self, folder: str, name: str) -> None:
        self.path = Path(folder) / f"kernels-{name}"
        command = [os.environ.get("CXX", "c++"), *FLAGS, *SETS.get(name, []), *INCLUDE]
        source = ROOT / "benchmarks" / "kernels.cpp"
        subprocess.run([*command, str(source), "-o", str(self.path)], check=True)

    def time(self, *arguments: object, count: int = 20_000) -> float:
        """Return the time of one step or tick [ns]."""
        command = [str(self.path), *map(str, arguments), str(count)]
        runs = [subprocess.run(command, check=True, stdout=subprocess.PIPE) for _ in range(ROUNDS)]
        return min(float(run.stdout) for run in runs)

    def instructions(self, *arguments: object) -> float:
        """Return the instructions of one step or tick."""
        totals: list[int] = []
        for count in (SHORT, LONG):
            file = self.path.with_suffix(".callgrind")
            command = ["valgrind", "--quiet", "--tool=callgrind", f"--callgrind-out-file={file}",
                       str(self.path), *map(str, arguments), str(count)]  # fmt: skip
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            totals.append(read_total(file))
        return (totals[1] - totals[0]) / (LONG - SHORT)


def kernels_table(programs: dict[str, Program]) -> Table:
    """Measure a step of every task by every kernel that fits it."""
    sets = list(programs)
    table = Table(title="a Newton step with new W, f and J, by kernel; * is the engine's choice")
    table.add_column("task")
    table.add_column("kernel")
    for heading in (f"instructions, {sets[0]}", *(f"ns, {name}" for name in sets)):
        table.add_column(heading, justify="right")
    table.add_column("the next best takes", justify="right")
    for task, (contacts, components, kernels) in TASKS.items():
        rows: list[list[float]] = []
        for kernel in kernels:
            step = ("step", kernel, contacts, components)
            count = programs[sets[0]].instructions(*step)
            rows.append([count, *(program.time(*step) for program in programs.values())])
            chosen = kernel == kernels[-1]
            columns = list(zip(*rows, strict=True)) if chosen else []
            gains = [min(others) / own for *others, own in columns]
            table.add_row(
                task if len(rows) == 1 else "",
                f"{kernel} *" if chosen else kernel,
                *(f"{number:,.0f}" for number in rows[-1]),
                " / ".join(f"{gain:.2f}" for gain in gains) + " x" * chosen,
            )
    return table


def contacts_table(program: Program, name: str) -> Table:
    """Measure a step and a tick by the number of contacts."""
    table = Table(title=f"ticks of one step with new W, f and J, by contacts, {name}")
    for heading in (
        "contacts", "step, ns", "Engine, J kept, ns", "steps", "J, kB", "J read, ns", "Servo, ns",
        "steps", "instructions",
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for contacts in CONTACTS:
        kernel = TASKS["4 point contacts"][2][-1] if contacts == 4 else "lanes3"
        step = program.time("step", kernel, contacts, 3)
        engine, read = program.time("engine", contacts), program.time("read", contacts)
        servo, count = program.time("servo", contacts), program.instructions("servo", contacts)
        table.add_row(
            str(contacts), f"{step:,.0f}", f"{engine:,.0f}", f"{engine / step:.2f}",
            f"{72e-3 * contacts**2:,.1f}", f"{read:,.0f}", f"{servo:,.0f}", f"{servo / step:.2f}",
            f"{count:,.0f}",
        )  # fmt: skip
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--save", type=writable, help="write the tables to this file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, Console().status("measuring"):
        sets = _core.instruction_sets() or ["baseline"]
        programs = {name: Program(folder, name) for name in sets}
        tables = kernels_table(programs), contacts_table(programs[sets[0]], sets[0])
    show(*tables, save=options.save, width=120)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
