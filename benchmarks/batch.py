"""How many problems a second ``solve_batch`` solves, and what its derivatives take.

Random feasible grasps of four fingers with three joints each, with W, f, J, mu and alpha a row
each. One by one they are solved from problems that were made beforehand, and from the rows of the
arrays that a batch takes, which are checked and copied then as in a batch. What is compared is run
in turns, and the least of some rounds counts; times of one thread are those of the processor, so
that a busy machine shows less. ``python benchmarks/batch.py --save benchmarks/results/batch.txt``
takes a minute.

Where Moreau is installed (``pip install moreau``), a solver of batches of cone programs, it solves
the same grasps as `baselines.socp` puts them, least norm of c within the exact cones and limits, in
one call, set up beforehand; its threads count as one processor each.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec

import numpy as np
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.baselines import socp
from graspforce.baselines._active import Active
from graspforce.baselines._conic import Pattern
from graspforce.cli.process import as_command
from graspforce.scenarios.random import grasps

Task = Callable[[], object]


def rows(count: int, different: int = 1024) -> tuple[dict[str, np.ndarray], list[gf.ForceProblem]]:
    """Return the fields of feasible problems, and the different ones that they are made of."""
    problems = grasps(different)
    rng = np.random.default_rng(1)
    fields = {}
    for name in ("W", "f", "J", "mu", "alpha"):
        distinct = np.array([getattr(problem, name) for problem in problems])
        fields[name] = np.resize(distinct, (count, *distinct.shape[1:]))
    fields["f"] *= rng.uniform(0.95, 1, (count, 1))
    return fields, problems


def least_times(
    tasks: dict[str, Task], rounds: int, clock: Callable[[], float]
) -> dict[str, float]:
    """Return the least time of each task [s]; they are run in turns."""
    least = dict.fromkeys(tasks, np.inf)
    for _ in range(rounds):
        for name, task in tasks.items():
            start = clock()
            task()
            least[name] = min(least[name], clock() - start)
    return least


def with_moreau(problems: Sequence[gf.ForceProblem]) -> Task:
    """Return what solves the problems as one batch of cone programs, tested against Clarabel."""
    import moreau

    prepared = socp.Prepared(problems[0], objective="norm")
    programs = [prepared.program(Active.of(problem), 1.0) for problem in problems]
    shape, squares = programs[0].shape, np.flatnonzero(programs[0].P)
    by_row = Pattern(np.any([program.A != 0 for program in programs], axis=0).T)
    precision = moreau.IPMSettings(tol_gap_abs=1e-9, tol_gap_rel=1e-9, tol_feas=1e-9)
    solver = moreau.CompiledSolver(
        n=shape.variables, m=len(programs[0].b),
        P_row_offsets=np.concatenate(([0], np.cumsum(programs[0].P != 0))), P_col_indices=squares,
        A_row_offsets=by_row.pointers, A_col_indices=by_row.indices,
        cones=moreau.Cones(
            num_zero_cones=shape.zeros, num_nonneg_cones=shape.nonnegative,
            so_cone_dims=list(shape.second_order),
        ),
        settings=moreau.Settings(
            solver="ipm", device="cpu", batch_size=len(problems), ipm_settings=precision
        ),
    )  # fmt: skip
    values = [by_row.values(np.ascontiguousarray(program.A.T)) for program in programs]
    solver.setup(np.array([program.P[squares] for program in programs]), np.array(values))
    vectors = [np.array([getattr(program, name) for program in programs]) for name in "qb"]
    found = np.asarray(solver.solve(*vectors).x)
    expected = [socp.solve(problem, objective="norm").c for problem in problems[:20]]
    np.testing.assert_allclose(found[:20, : len(expected[0])], expected, atol=1e-4)
    return lambda: solver.solve(*vectors)


def measure(count: int, rounds: int) -> Table:
    fields, problems = rows(count)
    limits = {"models": gf.PCWF(0.5), "tau_lo": -0.5, "tau_hi": 0.5}

    def solve(threads: int = 1, **options: object) -> gf.Batch:
        return gf.solve_batch(**fields, **limits, threads=threads, **options)

    batch = solve()
    start = 1.0002 * batch.c
    out = solve(start=start)
    weights = np.random.default_rng(2).normal(size=batch.c.shape)
    part = batch[: min(count, 2048)]
    given = [fields[name][: len(problems)] for name in ("W", "f", "J", "mu", "alpha")]

    def from_arrays() -> list[gf.Solution]:
        return [
            gf.solve(
                gf.ForceProblem(
                    W, f, [gf.PCWF(each) for each in mu], J=J, alpha=alpha, tau_lo=-0.5, tau_hi=0.5
                )
            )
            for W, f, J, mu, alpha in zip(*given, strict=True)
        ]

    tasks: dict[str, Task] = {
        "solve, one by one from Python": lambda: [gf.solve(problem) for problem in problems],
        "solve, one by one from arrays": from_arrays,
        "solve_batch, cold": lambda: solve(out=out),
        "solve_batch, warm": lambda: solve(start=start, out=out),
        "vjp by every field": lambda: gf.sensitivity(part).vjp(c=weights[: len(part)]),
        "vjp by f": lambda: gf.sensitivity(part).vjp(c=weights[: len(part)], wrt=("f",)),
    }
    sizes = [len(problems), len(problems), count, count, len(part), len(part)]
    if find_spec("moreau"):
        tasks["Moreau, a batch of cone programs"] = with_moreau(problems)
        sizes.append(len(problems))
    of_processor = least_times(tasks, rounds, time.process_time)
    wall = least_times(
        {"1": lambda: solve(out=out), "2": lambda: solve(threads=2, out=out)},
        rounds, time.perf_counter,
    )  # fmt: skip
    warm = solve(start=start)
    table = Table(title=f"{count:,} grasps of four fingers, {batch.solved.mean():.1%} solved")
    for heading in ("", "µs a problem", "million a second", "Newton steps", "× one by one"):
        table.add_column(heading, justify="right" if heading else "left")
    steps = {
        "solve_batch, cold": batch.newton_steps.mean(),
        "solve_batch, warm": warm.newton_steps.mean(),
    }
    each = {name: of_processor[name] / size for name, size in zip(tasks, sizes, strict=True)}
    single = each["solve, one by one from Python"]
    for name, seconds in each.items():
        shown = f"{steps[name]:.2f}" if name in steps else ""
        ratio = "" if name.startswith("vjp") else f"{single / seconds:.3g}"
        table.add_row(name, f"{1e6 * seconds:.3f}", f"{1e-6 / seconds:.2f}", shown, ratio)
    table.add_row(
        "two threads against one, by the clock", "", "", "", f"{wall['1'] / wall['2']:.2f}"
    )
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=16384, help="problems")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    load = os.getloadavg()[0]
    note = f"load of the machine by others while this ran, about {load:.0f} processes"
    show(measure(options.count, options.rounds), note, save=options.save, width=100)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
