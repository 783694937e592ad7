"""What a step of learning takes: forces and their gradients in PyTorch and JAX, on one core.

Random feasible grasps of four fingers with three joints each, with W, f, J, mu and alpha a row
each; the gradients are those of a sum of the forces by W, f, J and mu. Calls of 1, 64 and 4096
problems, beside `solve_batch` and `sensitivity` on NumPy's arrays.

Where qpth is installed (``pip install qpth``), the layer for quadratic programs that learners use,
it takes the same tensors: least norm of c within pyramids of 8 facets in the cones and within the
torque limits. ``python benchmarks/learning.py --save benchmarks/results/learning.txt`` takes a few
minutes.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from importlib.util import find_spec
from typing import Any

import numpy as np
from batch import Task, rows
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.cli.process import as_command

BATCHES = (1, 64, 4096)
FACETS, LIMIT = 8, 0.5
MODEL = gf.PCWF(0.5)
LIMITS = {"tau_lo": -LIMIT, "tau_hi": LIMIT}
BY = ("W", "f", "J", "mu")


def with_numpy(fields: dict[str, np.ndarray]) -> dict[str, Task]:
    weights = np.ones((len(fields["f"]), 12))

    def solve() -> gf.Batch:
        return gf.solve_batch(**fields, **LIMITS, models=MODEL)

    return {
        "NumPy: solve_batch": solve,
        "and its gradients": lambda: gf.sensitivity(solve()).vjp(c=weights, wrt=BY),
    }


def with_torch(fields: dict[str, np.ndarray]) -> dict[str, Task]:
    import torch

    import graspforce.torch as gt

    given = {name: torch.tensor(value) for name, value in fields.items()}

    def solve() -> Any:
        return gt.solve(**given, **LIMITS, models=MODEL).c

    def learn() -> None:
        for name in BY:
            given[name].grad = None
            given[name].requires_grad_()
        solve().sum().backward()
        for name in BY:
            given[name].requires_grad_(requires_grad=False)

    return {"PyTorch: forward": solve, "forward and backward": learn}


def with_jax(fields: dict[str, np.ndarray]) -> dict[str, Task]:
    import jax

    import graspforce.jax as gj

    given = {name: jax.numpy.asarray(value) for name, value in fields.items()}

    def total(by: dict[str, Any], rest: dict[str, Any]) -> Any:
        return gj.solve(**by, **rest, **LIMITS, models=MODEL).c.sum()

    by = {name: given.pop(name) for name in BY}
    value, learn = jax.jit(total), jax.jit(jax.value_and_grad(total))
    return {
        "JAX: forward": lambda: jax.block_until_ready(value(by, given)),
        "forward and backward ": lambda: jax.block_until_ready(learn(by, given)),
    }


def with_qpth(fields: dict[str, np.ndarray]) -> dict[str, Task]:
    """The quadratic programs of the least norm, from the same tensors; tested against DAQP."""
    import torch
    from qpth.qp import QPFunction

    from graspforce.baselines import qp

    tensors = {name: torch.tensor(fields[name], requires_grad=True) for name in BY}
    W, f, J, mu = tensors.values()
    around = torch.arange(FACETS, dtype=torch.float64) * (2 * np.pi / FACETS)
    sides = torch.stack((-torch.ones(FACETS), around.cos(), around.sin()), dim=1).double()
    inward = np.cos(np.pi / FACETS)  # so that the pyramid's edges are on the cone

    def solve() -> Any:
        scale = torch.stack((mu * inward, torch.ones_like(mu), torch.ones_like(mu)), dim=-1)
        by_contact = sides * scale[:, :, None]  # (B, 4, facets, 3)
        cones = torch.zeros(len(f), 4, FACETS, 12, dtype=torch.float64)
        for i in range(4):
            cones[:, i, :, 3 * i : 3 * i + 3] = by_contact[:, i]
        arms = J.transpose(1, 2)
        G = torch.cat((cones.flatten(1, 2), arms, -arms), dim=1)
        h = torch.cat((torch.zeros(4 * FACETS), LIMIT * torch.ones(2 * J.shape[2]))).double()
        Q, p = torch.eye(12, dtype=torch.float64), torch.zeros(12, dtype=torch.float64)
        return QPFunction(verbose=-1, check_Q_spd=False)(Q, p, G, h, W, f)

    def learn() -> None:
        for each in tensors.values():
            each.grad = None
        solve().sum().backward()

    found = solve().detach().numpy()
    for i in range(min(5, len(found))):
        problem = gf.ForceProblem(
            fields["W"][i], fields["f"][i], [gf.PCWF(each) for each in fields["mu"][i].tolist()],
            J=fields["J"][i], **LIMITS,
        )  # fmt: skip
        expected = qp.solve(problem, facets=FACETS).c
        np.testing.assert_allclose(found[i], expected, atol=1e-4)
    return {f"qpth, {FACETS} facets: forward": solve, " forward and backward": learn}


def median_time(task: Task, patience: float) -> float:
    """Return the median of a task's times [s], of as many as there is time for."""
    task()
    times = []
    while not times or (sum(times) < patience and len(times) < 1000):
        start = time.perf_counter()
        task()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def measure(patience: float) -> tuple[Table, list[str]]:
    """Return the table, and in words how far qpth is."""
    taken: dict[str, dict[int, float]] = {}
    for count in BATCHES:
        fields, _ = rows(count)
        tasks = with_numpy(fields) | with_torch(fields) | with_jax(fields)
        tasks |= with_qpth(fields) if find_spec("qpth") else {}
        for name, task in tasks.items():
            taken.setdefault(name, {})[count] = median_time(task, patience)
    table = Table(title="µs a problem, by problems a call; one core, medians")
    table.add_column("")
    for count in BATCHES:
        table.add_column(f"{count:,}", justify="right")
    for name, times in taken.items():
        table.add_row(name, *(f"{1e6 * times[count] / count:.3g}" for count in BATCHES))
    words = []
    if find_spec("qpth"):
        ratio = {
            count: taken[" forward and backward"][count] / taken["forward and backward"][count]
            for count in BATCHES
        }
        said = ", ".join(f"{value:.0f} at {count:,}" for count, value in ratio.items())
        words.append(f"qpth's forward and backward over that of graspforce.torch: {said}")
    return table, words


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--patience", type=float, default=3.0, help="seconds for each number")
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    load = os.getloadavg()[0]
    import jax
    import torch

    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    torch.set_num_threads(1)
    jax.config.update("jax_enable_x64", True)
    table, words = measure(options.patience)
    load_told = f"load of the machine by others while this ran, about {load:.0f} processes"
    show(table, *words, load_told, save=options.save, width=100)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
