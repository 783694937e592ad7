"""What ``graspforce.warp`` does on a GPU: rates, times of small batches, agreement with the CPU.

One run of a few minutes measures everything: ``python benchmarks/gpu.py --save``. The grasps are
random: four point contacts with friction, three joints a finger, every number of a problem its own
(147 of them). Set A are those of the drawn ones that are solved within 100 steps, B has 10 % of the
others among them. The large batches are timed by CUDA events, the small ones by the host's clock
from the call to the end of its work; all with ``out=``, medians of several.

Besides: ``graspforce.torch`` and ``graspforce.jax`` on tensors of the device, where they are
installed; the example of a thousand hands, where MuJoCo Warp is; and with ``--yardsticks FOLDER``
other ways to the same forces, on the same data: ``wbf.cu`` in CUDA C++, ``wbf_jax.py`` in
natural JAX, ``wbf_torch.py`` in eager PyTorch. A part that fails says so and harms no
other.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp
from rich.table import Table
from saving import show, writable

import graspforce as gf
import graspforce.warp as gw
from graspforce.cli.process import as_command
from graspforce.contact import contact_starts

os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")  # the memory is for all
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from warp_problems import random_batch

wp: Any = warp
RESULTS = Path(__file__).parent / "results" / "gpu.txt"
HANDS = Path(__file__).parents[1] / "examples" / "warp" / "thousand_hands.py"
SEED, CONTACTS, JOINTS, COMPARED = 20101, 4, 3, 1000
MODELS = [gf.PCWF(0.5)] * CONTACTS
# What a solve of one problem moves at least: its numbers, c, nu, status and steps; and what vjp
# does: the same, dL/dc and all gradients.
SOLVE_BYTES = 147 * 8 + (12 + 6) * 8 + 2 * 4
VJP_BYTES = SOLVE_BYTES + (12 + 147) * 8
LAYOUTS = (
    ("PCWF",) * 2,
    ("PCWF",) * 3,
    ("SFC",) * 4,
    ("SFC", "PCWF", "FPC", "PCWF", "FPC"),
    ("PCWF",) * 8,
)

Arrays = dict[str, Any]  # by the names of the arguments of graspforce.warp


# ---- problems ----------------------------------------------------------------------------------


def random_grasps(rng: np.random.Generator, B: int) -> Arrays:
    """Fingertips around an object of 8 cm under 0.1 to 8 N; one in eight cannot hold it."""
    angles = np.arange(CONTACTS) * np.pi / 2 + 0.3 * rng.normal(size=(B, CONTACTS))
    heights = 0.4 * rng.normal(size=angles.shape)
    outwards = unit(np.stack((np.cos(angles), np.sin(angles), heights), axis=-1))
    points = 0.04 * rng.uniform(0.8, 1.2, (B, CONTACTS, 1)) * outwards
    normals = unit(-outwards + 0.25 * rng.normal(size=outwards.shape))
    across = np.array([1.2, 2.3, 3.4])
    x = unit(across - (normals @ across)[..., np.newaxis] * normals)
    axes = np.stack((normals, x, np.cross(normals, x)), axis=-1)  # columns
    torques = np.cross(points[..., np.newaxis, :], axes.swapaxes(-1, -2)).swapaxes(-1, -2)
    W = np.concatenate((axes, torques), axis=-2)  # (B, n, 6, 3)
    levers = np.exp(rng.uniform(np.log(0.02), np.log(0.12), (B, CONTACTS, 1, 3)))
    world = (rotations(rng, (B, CONTACTS)) * levers) @ rotations(rng, (B, CONTACTS))
    load = np.exp(rng.uniform(np.log(0.1), np.log(8), (B, 1)))
    force = unit(rng.normal(size=(B, 3)))
    return {
        "W": W.swapaxes(1, 2).reshape(B, 6, 3 * CONTACTS),
        "f": load * np.hstack((force, 0.02 * rng.normal(size=(B, 3)))),
        "mu": rng.uniform(0.25, 1, (B, CONTACTS)),
        "J": (world @ axes).swapaxes(-1, -2).reshape(B, 3 * CONTACTS, JOINTS),
        "tau_lo": -rng.uniform(0.2, 0.8, (B, CONTACTS * JOINTS)),
        "tau_hi": rng.uniform(0.2, 0.8, (B, CONTACTS * JOINTS)),
        "c_max": np.full((B, CONTACTS), 20.0),
        "alpha": np.full(B, 5.0),
    }


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def rotations(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    a, b = unit(rng.normal(size=(*shape, 3))), rng.normal(size=(*shape, 3))
    b = unit(b - (a * b).sum(-1, keepdims=True) * a)
    return np.stack((a, b, np.cross(a, b)), axis=-2)


def rows(arrays: Arrays, which: np.ndarray) -> Arrays:
    return {name: array[which] for name, array in arrays.items()}


def disturbed(arrays: Arrays) -> Arrays:
    """The same problems with every component of f changed by some .3 %."""
    rng = np.random.default_rng(SEED)
    return arrays | {"f": arrays["f"] * (1 + 0.003 * rng.normal(size=arrays["f"].shape))}


def on_device(arrays: Arrays, device: str, real: Any = np.float64) -> Arrays:
    return {name: wp.array(array.astype(real), device=device) for name, array in arrays.items()}


def turned(array: Any) -> Any:
    """The same array with the numbers of one kind of all problems side by side in memory."""
    memory = np.moveaxis(array.numpy(), 0, -1).copy()
    axes = (memory.ndim - 1, *range(memory.ndim - 1))
    return wp.array(memory, device=array.device).transpose(axes)


def bind(arrays: Arrays, **options: Any) -> gw.Problems:
    return gw.Problems(models=MODELS, **arrays, **options)


def solved(forces: gw.Forces) -> np.ndarray:
    return forces.status.numpy() == gf.Status.SOLVED


# ---- measuring ---------------------------------------------------------------------------------


class Clock:
    """Times work on a device."""

    def __init__(self, device: str) -> None:
        self.device = wp.get_device(device)

    def seconds(self, work: Callable[[], Any]) -> float:
        """Return the median time that the device takes, of seven after one that does not count."""
        if not self.device.is_cuda:
            return self.host_seconds(work, 3)
        times = []
        for _ in range(8):
            start, end = (wp.Event(self.device, enable_timing=True) for _ in range(2))
            wp.record_event(start)
            work()
            wp.record_event(end)
            times.append(wp.get_event_elapsed_time(start, end) / 1e3)
        return float(np.median(times[1:]))

    def host_seconds(self, work: Callable[[], Any], repeats: int = 100) -> float:
        """Return the median time from the call to the end of its work, by the host's clock."""
        times = []
        for _ in range(repeats):
            wp.synchronize_device(self.device)
            start = time.perf_counter()
            work()
            wp.synchronize_device(self.device)
            times.append(time.perf_counter() - start)
        return float(np.median(times))


def mega(count: int, seconds: float) -> str:
    return f"{count / seconds / 1e6:,.0f}"


def time_solve(
    clock: Clock, table: Table, what: str, problems: gw.Problems, start: Any = None
) -> gw.Forces:
    """Time one kind of solve, write it down, and return what was found."""
    forces = problems.solve(start)
    out = forces._replace(tau=None)  # not asked for
    seconds, count = clock.seconds(partial(problems.solve, start, out=out)), len(problems)
    good, steps = solved(forces), forces.newton_steps.numpy()
    text = f"{good.mean():.3%} solved, {steps[good].mean():.2f} steps"
    if start is not None and forces.c.dtype == wp.float64:
        text += f", {SOLVE_BYTES * count / seconds / 1e9:,.0f} GB/s"
    table.add_row(what, mega(count, seconds), text)
    return forces


def measure_copy(clock: Clock, table: Table) -> None:
    size = 1 << (30 if clock.device.is_cuda else 20)
    source, target = (wp.zeros(size, dtype=wp.uint8, device=clock.device) for _ in range(2))
    seconds = clock.seconds(partial(wp.copy, target, source))
    table.add_row("copy on the device", "", f"{2 * size / seconds / 1e9:,.0f} GB/s")


def measure_solve(clock: Clock, name: str, A: Arrays, B: Arrays, table: Table) -> None:
    """Double precision: cold, warm, with infeasible rows, with shared arrays, turned arrays."""
    arrays = on_device(A, name)
    forces = time_solve(clock, table, "cold", bind(arrays))
    moved = on_device({"f": disturbed(A)["f"]}, name)
    time_solve(clock, table, "warm, f changed by .3 %", bind(arrays | moved), forces.c)
    time_solve(clock, table, "cold, 10 % infeasible", bind(on_device(B, name)))
    one = on_device({key: A[key][0] for key in A if key not in ("f", "alpha")}, name)
    many = on_device({"f": 0.2 * A["f"]}, name)
    time_solve(clock, table, "cold, one grasp under all the wrenches", bind(one | many))
    other = {key: turned(array) for key, array in (arrays | moved).items()}
    problems = bind(other)
    time_solve(clock, table, "cold, numbers of one kind side by side", problems)
    time_solve(clock, table, "warm, numbers of one kind side by side", problems, forces.c)


def measure_vjp(clock: Clock, name: str, A: Arrays, table: Table) -> None:
    problems = bind(on_device(A, name))
    forces = problems.solve()
    by_c = np.random.default_rng(SEED).normal(size=forces.c.shape)
    work = partial(problems.vjp, forces, c=wp.array(by_c, device=name))
    everything = work()
    plain = {key: wp.empty(g.shape, dtype=g.dtype, device=name) for key, g in everything.items()}
    for what, out in (
        ("backward, all gradients", everything),
        ("backward, a problem's gradients side by side", plain),
        ("backward, by f and mu", {key: everything[key] for key in ("f", "mu")}),
    ):
        seconds = clock.seconds(partial(work, out=out))
        rate = f"{VJP_BYTES * len(problems) / seconds / 1e9:,.0f} GB/s" if len(out) > 2 else ""
        table.add_row(what, mega(len(problems), seconds), rate)


def measure_single(clock: Clock, name: str, A: Arrays, table: Table) -> None:
    """Single precision: rates, and its error beside double precision."""
    exact = bind(on_device(A, name)).solve()
    arrays = on_device(A, name, np.float32)
    problems = bind(arrays, precision="single")
    found = time_solve(clock, table, "single precision, cold", problems)
    moved = on_device({"f": disturbed(A)["f"]}, name, np.float32)
    problems = bind(arrays | moved, precision="single")
    time_solve(clock, table, "single precision, warm", problems, found.c)
    both = solved(exact) & solved(found)
    c = exact.c.numpy()[both]
    errors = np.abs(found.c.numpy()[both] - c).max(axis=1) / np.abs(c).max(axis=1)
    median, most, nearly_all = np.quantile(errors, (0.5, 0.99, 0.9999))
    table.add_row(
        "single precision, error of c relative to c", "",
        f"median {median:.0e}, 99 % {most:.0e}, 99.99 % {nearly_all:.0e}, largest "
        f"{errors.max():.0e}",
    )  # fmt: skip


def measure_layouts(clock: Clock, name: str, count: int, table: Table) -> None:
    """Other numbers and models of contacts, cold."""
    rng = np.random.default_rng(SEED)
    for kinds in LAYOUTS:
        arrays, models = random_batch(rng, kinds, 1024)
        many = {key: np.resize(array, (count, *array.shape[1:])) for key, array in arrays.items()}
        problems = gw.Problems(models=models, **on_device(many, name))
        counts = Counter(kinds)
        what = " + ".join(f"{counts[kind]} {kind}" for kind in counts)
        time_solve(clock, table, f"cold, {what}", problems)


def measure_agreement(name: str, A: Arrays, others: Arrays, table: Table) -> None:
    """``graspforce.solve`` on the same rows, at the same tolerance."""
    problems = bind(on_device(rows(A, np.arange(COMPARED)), name))
    forces = problems.solve()
    solutions = [gf.solve(problems[row]) for row in range(COMPARED)]
    equal = forces.status.numpy() == [solution.status for solution in solutions]
    off = np.abs(forces.c.numpy() - [solution.c for solution in solutions]).max(axis=1)
    table.add_row(
        f"{COMPARED} of A beside graspforce.solve", "",
        f"{equal.sum()} statuses equal, c differs by {off[equal].max():.1e} N at most",
    )  # fmt: skip
    problems = bind(on_device(rows(others, np.arange(min(COMPARED, len(others["f"])))), name))
    here = solved(problems.solve())
    there = [gf.solve(problems[row]).status == gf.Status.SOLVED for row in range(len(problems))]
    table.add_row(
        f"{len(problems)} of the others", "",
        f"{sum(there)} solved by graspforce.solve, {here.sum()} here, "
        f"{(here & ~np.array(there)).sum()} of these wrongly",
    )  # fmt: skip


def measure_first_call(device: str, table: Table) -> None:
    """The first call of a process, its kernels compiled and then from Warp's cache."""
    with tempfile.TemporaryDirectory() as cache:
        for what in ("first call of a process, compiling", "first call of a later process"):
            run = subprocess.run(
                [sys.executable, __file__, "--device", device, "--first-call"], text=True,
                env=os.environ | {"WARP_CACHE_PATH": cache}, check=True, stdout=subprocess.PIPE,
            )  # fmt: skip
            table.add_row(what, "", f"{float(run.stdout):.1f} s")


def first_call(device: str) -> None:
    arrays = on_device(random_grasps(np.random.default_rng(SEED), 256), device)
    wp.synchronize_device(device)
    start = time.perf_counter()
    bind(arrays).solve()
    wp.synchronize_device(device)
    print(time.perf_counter() - start)


def measure_small(clock: Clock, name: str, A: Arrays, table: Table) -> None:
    """Small batches by the host's clock: from Python, and as a CUDA graph."""
    for count in (256, 1024, 4096, 16384, 65536, 262144):
        if count > len(A["f"]):
            break
        some = rows(A, np.arange(count))
        arrays = on_device(some, name)
        problems, moved = bind(arrays), bind(on_device(disturbed(some), name))
        forces = problems.solve()
        start, out = wp.clone(forces.c), forces._replace(tau=None)
        gradients = problems.vjp(forces, c=start)
        works: list[Callable[[], Any]] = [
            partial(gw.solve, models=MODELS, out=out, **arrays),
            partial(problems.solve, out=out),
            partial(moved.solve, start, out=out),
            partial(problems.vjp, forces, c=start, out=gradients),
        ]
        if clock.device.is_cuda:
            with wp.ScopedCapture(name) as capture:
                problems.solve(out=out)
            works.append(partial(wp.capture_launch, capture.graph))
        table.add_row(f"{count:,}", *(f"{clock.host_seconds(w) * 1e6:,.0f}" for w in works))


# ---- torch and JAX -----------------------------------------------------------------------------


def dense(arrays: Arrays) -> Arrays:
    """The same with the J of a ForceProblem, (B, m, n_joints)."""
    J = np.zeros((*arrays["J"].shape[:2], CONTACTS * JOINTS))
    starts = contact_starts(MODELS)
    for i in range(CONTACTS):
        part = slice(starts[i], starts[i + 1])
        J[:, part, JOINTS * i : JOINTS * (i + 1)] = arrays["J"][:, part]
    return arrays | {"J": J}


def torch_works(A: Arrays, device: str) -> tuple[Callable[[], Any], Callable[[], Any]]:
    """Functions that solve, and solve and go back to all tensors, with c and gradients in NumPy."""
    import torch

    import graspforce.torch as gt

    device = device.partition(":")[0]
    leaves = {
        key: torch.tensor(value, device=device, requires_grad=True) for key, value in A.items()
    }
    v = torch.tensor(weights(A), device=device)

    def forward() -> Any:
        with torch.no_grad():
            return gt.solve(models=MODELS, **leaves).c.detach()

    def both() -> Any:
        c = gt.solve(models=MODELS, **leaves).c
        found = torch.autograd.grad((c * v).sum(), list(leaves.values()))
        return dict(zip(leaves, found, strict=True))

    return forward, both


def jax_works(A: Arrays, device: str) -> tuple[Callable[[], Any], Callable[[], Any]]:
    """The same in JAX, inside jit."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import graspforce.jax as gj

    place = jax.devices(device.partition(":")[0])[0]
    arrays = {key: jax.device_put(value, place) for key, value in A.items()}
    v = jax.device_put(weights(A), place)
    solve = jax.jit(lambda arrays: gj.solve(models=MODELS, **arrays).c)
    slope = jax.jit(jax.grad(lambda arrays: (gj.solve(models=MODELS, **arrays).c * v).sum()))
    return (
        lambda: jax.block_until_ready(solve(arrays)),
        lambda: jax.block_until_ready(slope(arrays)),
    )


def weights(A: Arrays) -> np.ndarray:
    return np.random.default_rng(SEED).normal(size=(len(A["f"]), 3 * CONTACTS))


def in_numpy(value: Any) -> np.ndarray:
    return np.asarray(value.cpu() if hasattr(value, "cpu") else value)


def measure_tensors(clock: Clock, name: str, A: Arrays, table: Table) -> None:
    """The front ends: correctness beside the CPU, and times by the host's clock."""
    for library, works_of in (("torch", torch_works), ("jax", jax_works)):
        if importlib.util.find_spec(library) is None:
            continue
        try:
            for count in (4096, 262144):
                if count > len(A["f"]):
                    break
                some = dense(rows(A, np.arange(count)))
                forward, both = works_of(some, name)
                first = time.perf_counter()
                c, gradients = in_numpy(forward()), both()
                first = time.perf_counter() - first
                seconds = [clock.host_seconds(work, 30) for work in (forward, both)]
                said = compare(some, c, gradients) if count == 4096 else f"first {first:.1f} s"
                times = (f"{each * 1e6:,.0f}" for each in seconds)
                rates = ", ".join(mega(count, each) + " M/s" for each in seconds)
                table.add_row(f"graspforce.{library}, {count:,}", *times, f"{rates}; {said}")
        except Exception as error:
            table.add_row(f"graspforce.{library}", "failed", "", short(error))


def compare(A: Arrays, c: np.ndarray, gradients: Arrays) -> str:
    """How far c and the gradients are from graspforce's on the CPU, in a hundred rows."""
    some = rows(A, np.arange(100))
    batch = gf.solve_batch(models=MODELS, **some)
    expected = gf.sensitivity(batch).vjp(c=weights(A)[:100], wrt=tuple(some))
    off = np.abs(c[:100] - batch.c)[batch.solved].max()
    errors = []
    for key, wanted in expected.items():
        found = in_numpy(gradients[key])[:100]
        if key == "J":  # the kernels know none by joints that a contact does not feel
            found, wanted = (each * (some["J"] != 0) for each in (found, wanted))
        size = np.abs(wanted).reshape(100, -1).max(axis=1) + 1e-9
        errors.append(np.abs(found - wanted).reshape(100, -1).max(axis=1) / size)
    return f"c off by {off:.0e} N at most, gradients by {np.quantile(errors, 0.99):.0e} (99 %)"


def short(error: Exception) -> str:
    return f"{type(error).__name__}: {str(error)[-300:]}"


# ---- yardsticks --------------------------------------------------------------------------------


class Yardsticks:
    """Other ways to the same forces, in a folder: compiled while other things are measured."""

    def __init__(self, folder: Path, scratch: Path) -> None:
        self.folder, self.scratch = folder, scratch
        self.data = scratch / "set.bin"
        self.compiler = shutil.which("nvcc")
        if self.compiler:
            command = [self.compiler, "-O3", "-std=c++17", "-arch=native", "-o", scratch / "wbf"]
            with (scratch / "nvcc.txt").open("w") as log:
                self.build = subprocess.Popen(
                    [*command, folder / "wbf.cu"], stdout=log, stderr=subprocess.STDOUT
                )

    def measure(self, clock: Clock, name: str, count: int, table: Table) -> None:
        """Time them, and graspforce.warp on their data."""
        if not self.compiler or self.build.wait(timeout=240):
            said = (self.scratch / "nvcc.txt").read_text()[-300:] if self.compiler else "no nvcc"
            table.add_row("wbf.cu", "failed", "", said)
            return
        text = self.run([self.scratch / "wbf", str(count)])
        cpp = {}
        for kind in ("cold", "warm"):
            # The first of each name is double precision on grasps that can hold.
            lines = re.search(r"--- fp64, feasible(.*?)---", text, re.S)
            found = re.findall(
                rf"^four lanes.*?{kind}\s+[\d.]+ ms\s+([\d.]+) M/s", lines[1] if lines else "", re.M
            )
            cpp[kind] = max(map(float, found), default=np.nan)
        backward = re.search(r"back, four lanes [\d.]+ ms ([\d.]+)", text)
        cpp["backward"] = float(backward[1]) if backward else np.nan
        own = self.own(clock, name, count)
        for kind, rate in cpp.items():
            table.add_row(
                f"wbf.cu, {kind}", f"{rate:,.0f}", f"{own[kind]:,.0f}", f"{own[kind] / rate:.2f}"
            )
        for program, words, line in (
            ("wbf_jax.py", ["natural"], r"jax natural float64 B=\d+: .*? ms ([\d.]+) M/s"),
            ("wbf_torch.py", [], r"torch eager torch.float64 B=\d+: .*? ms ([\d.]+) M/s"),
        ):
            sizes = str(min(count, 1_000_000))
            text = self.run([sys.executable, self.folder / program, self.data, sizes, *words])
            rates = [float(rate) for rate in re.findall(line, text)]
            rate = max(rates, default=np.nan)
            table.add_row(
                f"{program}, cold", f"{rate:,.2f}", f"{own['cold']:,.0f}",
                f"{own['cold'] / rate:,.0f}",
            )  # fmt: skip

    def run(self, command: list[Any]) -> str:
        """Return what a program printed; what it said of an error goes along."""
        wp.synchronize()
        settings = {"OUT": str(self.scratch), "SETFILE": str(self.data)}
        done = subprocess.run(
            command, text=True, timeout=150, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env=os.environ | settings, check=False,
        )  # fmt: skip
        print(done.stdout[-6000:], flush=True)
        return done.stdout

    def own(self, clock: Clock, name: str, count: int) -> dict[str, float]:
        """The rates of graspforce.warp on the yardsticks' data [M/s]."""
        columns = np.fromfile(self.data).reshape(165, -1)
        columns = np.resize(columns.T, (count, 165))
        W, f, J, mu, lo, hi, most, alpha = np.split(
            columns[:, :147], np.cumsum((72, 6, 36, 4, 12, 12, 4)), axis=1
        )
        arrays = {
            "W": W.reshape(count, 6, 12), "f": f, "J": J.reshape(count, 12, 3), "mu": mu,
            "tau_lo": lo, "tau_hi": hi, "c_max": most, "alpha": alpha[:, 0],
        }  # fmt: skip
        problems = bind(on_device(arrays, name))
        forces = problems.solve()
        out = forces._replace(tau=None)
        moved = bind(on_device(disturbed(arrays), name))
        start, by_c = wp.clone(forces.c), wp.clone(forces.c)
        gradients = problems.vjp(forces, c=by_c)
        seconds = {
            "cold": clock.seconds(partial(problems.solve, out=out)),
            "warm": clock.seconds(partial(moved.solve, start, out=out)),
        }
        problems.solve(out=forces)
        seconds["backward"] = clock.seconds(partial(problems.vjp, forces, c=by_c, out=gradients))
        return {kind: count / each / 1e6 for kind, each in seconds.items()}


# ---- a thousand hands --------------------------------------------------------------------------


def measure_hands(name: str, table: Table) -> None:
    """The example, whose last line is its rate."""
    for count in (1024, 16384) if name.startswith("cuda") else (4,):
        seconds = "1" if name.startswith("cuda") else ".1"
        done = subprocess.run(
            [sys.executable, HANDS, "--hands", str(count), "--seconds", seconds, "--device", name],
            text=True, timeout=240, capture_output=True, check=False,
        )  # fmt: skip
        said = done.stdout.splitlines()[-3:] if done.returncode == 0 else [done.stderr[-300:]]
        table.add_row(f"{count:,} hands in MuJoCo Warp", "", "", "; ".join(said))


# ---- the run -----------------------------------------------------------------------------------


def new_table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for index, column in enumerate(columns):
        table.add_column(column, justify="right" if index and column else "left")
    return table


def measure(name: str, count: int, save: Path | None, folder: Path | None) -> None:
    clock = Clock(name)
    card = clock.device
    memory = f", {card.total_memory / 2**30:.0f} GiB" if card.is_cuda else ""
    parts: list[Any] = [f"{card.name}{memory}, Warp {wp.config.version}"]
    with tempfile.TemporaryDirectory() as scratch:
        yardsticks = Yardsticks(folder.resolve(), Path(scratch)) if folder else None
        large = new_table(f"{count:,} problems", "M/s", "")
        small = new_table(
            "problems, µs a call", "solve", "Problems.solve", "the same, warm", "vjp",
            "solve, as a graph",
        )  # fmt: skip
        tensors = new_table("tensors, µs a call", "solve", "and gradients", "")
        others = new_table("yardsticks, M/s", "theirs", "graspforce.warp", "ratio")
        hands = new_table("simulation", "", "", "")
        A, B, out_of_A = draw(name, count, large)
        works: list[tuple[Table, list[Callable[[], None]]]] = [
            (large, [
                partial(measure_first_call, name, large),
                partial(measure_agreement, name, A, out_of_A, large),
                partial(measure_copy, clock, large),
                partial(measure_solve, clock, name, A, B, large),
                partial(measure_vjp, clock, name, A, large),
                partial(measure_single, clock, name, A, large),
                partial(measure_layouts, clock, name, count, large),
            ]),
            (small, [partial(measure_small, clock, name, A, small)]),
            (tensors, [partial(measure_tensors, clock, name, A, tensors)]),
        ]  # fmt: skip
        if yardsticks:
            work = partial(yardsticks.measure, clock, name, count, others)
            works.append((others, [work]))
        if importlib.util.find_spec("mujoco_warp"):
            works.append((hands, [partial(measure_hands, name, hands)]))
        try:
            for table, steps in works:
                parts += ["", table]
                for step in steps:
                    attempt(step, table)
        finally:  # what there is when it is interrupted
            show(*parts, save=save, width=140)


def attempt(step: Callable[[], None], table: Table) -> None:
    """Measure something; what fails is written down."""
    try:
        step()
    except Exception as error:
        table.add_row("failed", *[""] * (len(table.columns) - 2), short(error))


def draw(name: str, count: int, table: Table) -> tuple[Arrays, Arrays, Arrays]:
    """Sets A and B, and those that were drawn and are not in A."""
    # An eighth of the problems is drawn; the sets repeat them.
    drawn = random_grasps(np.random.default_rng(SEED), max(2 * COMPARED, count // 8 * 5 // 4))
    good = solved(bind(on_device(drawn, name)).solve(max_steps=100))
    table.add_row("drawn", "", f"{good.mean():.2%} solved within 100 steps")
    in_A, out_of_A = np.flatnonzero(good), np.flatnonzero(~good)
    which = np.resize(in_A, count)
    A, tenth = rows(drawn, which), np.random.default_rng(SEED).random(count) < 0.1
    which[tenth] = np.resize(out_of_A, tenth.sum())
    return A, rows(drawn, which), rows(drawn, out_of_A)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0", help="where to measure")
    parser.add_argument("--problems", type=int, default=1 << 20, help="of the large batches")
    parser.add_argument(
        "--save", type=writable, nargs="?", const=RESULTS, help="a file for the tables"
    )
    parser.add_argument(
        "--yardsticks", type=Path, help="a folder with wbf.cu, wbf_jax.py and wbf_torch.py"
    )
    parser.add_argument("--first-call", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    if arguments.first_call:
        first_call(arguments.device)
    else:
        measure(arguments.device, arguments.problems, arguments.save, arguments.yardsticks)


if __name__ == "__main__":
    with as_command():
        main()
