"""Random grasps by the million, each verdict judged by another solver and by NumPy.

A *geometry* is a set of contacts, joints and limits with a wrench ``f0`` that it can hold and a
direction ``f1``. The loads ``s`` for which ``f0 + s f1`` can be held form an interval, and Clarabel
finds its ends to 1e-9. Each geometry is then asked for forces at loads on either side of an end, at
a known margin, with random weights alpha and in random units of force. A verdict is

- *decided* if it is SOLVED or INFEASIBLE (or WRENCH_UNREACHABLE where f is put outside W's range),
- *wrong* if it is decided otherwise than the interval says, or if ``Solution.verify``, which
  recomputes everything in NumPy, does not bear it out.

``make campaign`` runs the long version; ``--replay 1234.5`` shows case 5 of geometry 1234.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import clarabel
import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from saving import show, writable
from scipy import sparse

import graspforce as gf
from graspforce.cli.process import as_command
from graspforce.scenarios import random

CASES = 10  # of a geometry


class Case(NamedTuple):
    """One problem and what is known of it."""

    name: str  # "geometry.case"
    problem: gf.ForceProblem
    expected: gf.Status
    margin: float


class Verdict(NamedTuple):
    """What became of a case; small enough to come back from a worker process."""

    name: str
    kind: str  # which table row it counts for
    expected: gf.Status
    status: gf.Status
    steps: int
    confirmed: bool  # by Solution.verify

    @property
    def decided(self) -> bool:
        """Whether there is a verdict at all."""
        return self.status in (
            gf.Status.SOLVED,
            gf.Status.INFEASIBLE,
            gf.Status.WRENCH_UNREACHABLE,
        )

    @property
    def wrong(self) -> bool:
        """Whether the verdict is another than the truth, or not borne out."""
        also = self.expected is gf.Status.WRENCH_UNREACHABLE and self.status is gf.Status.INFEASIBLE
        return self.decided and not ((self.status is self.expected or also) and self.confirmed)


# ---- the truth ---------------------------------------------------------------------------------


def load_interval(problem: gf.ForceProblem, f1: np.ndarray) -> tuple[float, float] | None:
    """The loads s for which W c = f0 + s f1 can be held, by Clarabel; None where it is unsure."""
    m = problem.m
    dims = problem.layout.dims
    out = np.repeat(~problem.active, dims)
    rows, bounds = problem.linear_limits()
    lifted, cones = [], []
    for i, (start, model) in enumerate(zip(problem.starts[:-1], problem.models, strict=True)):
        if not problem.active[i]:
            continue
        weights = [problem.mu[i], 1, 1, problem.mu[i] / problem.gamma[i]][: model.dim]
        row = np.zeros((model.dim, m))
        row[np.arange(model.dim), start + np.arange(model.dim)] = weights
        lifted.append(-row)
        cones.append(clarabel.SecondOrderConeT(model.dim))
    still = np.eye(m)[out]
    A = np.vstack((problem.W, still, rows, *lifted))
    s_column = np.concatenate((-f1, np.zeros(len(A) - len(f1))))
    A = sparse.csc_array(np.column_stack((A, s_column)))
    b = np.concatenate(
        (
            problem.f,
            np.zeros(len(still)),
            bounds,
            np.zeros(A.shape[0] - len(problem.f) - len(still) - len(bounds)),
        )
    )
    kinds = [
        clarabel.ZeroConeT(len(problem.f) + len(still)),
        clarabel.NonnegativeConeT(len(bounds)),
        *cones,
    ]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    nothing = sparse.csc_array((m + 1, m + 1))
    ends = []
    for sign in (1.0, -1.0):
        q = np.zeros(m + 1)
        q[-1] = sign
        answer = clarabel.DefaultSolver(nothing, q, A, b, kinds, settings).solve()
        if answer.status != clarabel.SolverStatus.Solved:
            return None
        ends.append(answer.x[-1])
    return ends[0], ends[1]


def faint(sizes: np.ndarray) -> bool:
    """Whether any of the singular values is small and yet not zero."""
    return bool(((sizes > 1e-13 * sizes[0]) & (sizes < 1e-6 * sizes[0])).any())


def cases(seed: int, index: int, margin: float | None, hard: bool) -> Iterator[Case | None]:
    """The cases of one geometry; None for each whose truth is not known well enough."""
    rng = np.random.default_rng([seed, index])
    geometry, f1 = random.geometry(rng, hard)
    held = geometry.W * np.repeat(geometry.active, geometry.layout.dims)
    _, sizes, right = np.linalg.svd(held.T)
    beyond = right[(sizes > 1e-9 * sizes[0]).sum() :]  # directions of f that no force makes
    # Whether a direction this faint counts among those that W reaches is a matter of opinion, and
    # wrenches this much smaller than the others are below what Clarabel's 1e-9 resolves.
    reach = gf.reference.violation_scales(geometry)[1] / geometry.mu
    strong = held * np.repeat(reach, geometry.layout.dims)
    clear = not any(map(faint, (sizes, np.linalg.svd(strong, compute_uv=False))))
    ends = load_interval(geometry, f1) if clear else None
    for k in range(CASES):
        scale = 10 ** rng.uniform(-6, 3) if hard else 10 ** rng.uniform(-1, 1)
        alpha = 10 ** (rng.uniform(-4, 6) if hard else rng.uniform(-2, 3))
        far = margin if margin is not None else 10 ** rng.uniform(-3, 0)
        side, feasible = rng.integers(2), rng.random() < 0.7
        if ends is None:
            yield None
            continue
        end, other = ends[side], ends[1 - side]
        # A margin counts in the wrench as a whole; in the interval where that ends at no wrench.
        whole, width = max(abs(end), np.abs(geometry.f).max() / np.abs(f1).max()), ends[1] - ends[0]
        step = far * (whole if whole > 1e-3 * width else width)
        outward = 1 if side else -1
        s = end - outward * step if feasible else end + outward * step
        if feasible and outward * (s - other) < step:  # the interval is shorter than that
            yield None
            continue
        f, expected = geometry.f + s * f1, gf.Status.SOLVED if feasible else gf.Status.INFEASIBLE
        if len(beyond) and rng.random() < 0.2:
            f = f + far * max(np.abs(f).max(), 1e-3) * random.unit(
                rng.normal(size=len(beyond)) @ beyond
            )
            expected = gf.Status.WRENCH_UNREACHABLE
        problem = geometry.replace(
            f=scale * f,
            alpha=alpha,
            **{
                name: scale * getattr(geometry, name)
                for name in ("tau_lo", "tau_hi", "tau_bias", "c_max", "c_min", "b")
                if getattr(geometry, name).size
            },
        )
        yield Case(f"{index}.{k}", problem, expected, far)


# ---- the run -----------------------------------------------------------------------------------


def judge(case: Case) -> Verdict:
    solution = gf.solve(case.problem)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        confirmed = solution.verify().ok
    kinds = {type(model).__name__ for model in case.problem.models}
    kind = f"{'mixed' if len(kinds) > 1 else kinds.pop()}"
    return Verdict(
        case.name, kind, case.expected, solution.status, solution.newton_steps, confirmed
    )


def judge_geometry(task: tuple[int, int, float | None, bool]) -> list[Verdict | None]:
    return [case and judge(case) for case in cases(*task)]


def run(
    seed: int, grasps: int, margin: float | None = None, hard: bool = False, jobs: int = 1
) -> tuple[list[Verdict], int]:
    """Judge that many grasps; returns the verdicts and how many cases were left out."""
    tasks = ((seed, index, margin, hard) for index in range(-(-grasps // CASES)))
    verdicts: list[Verdict] = []
    left_out = 0
    with Progress(console=Console(stderr=True)) as progress, multiprocessing.Pool(jobs) as pool:
        bar = progress.add_task("grasps", total=grasps)
        for geometry in pool.imap_unordered(judge_geometry, tasks, chunksize=8):
            known = [verdict for verdict in geometry if verdict is not None]
            left_out += len(geometry) - len(known)
            verdicts += known
            progress.advance(bar, len(geometry))
    return verdicts, left_out


def table(verdicts: list[Verdict], left_out: int, title: str) -> Table:
    result = Table(title=f"{title}; {left_out} left out, their truth not being sure")
    for heading in ("grasps", "", "decided", "wrong", "steps p50", "p99", "most"):
        result.add_column(heading, justify="left" if heading == "grasps" else "right")

    def row(name: str, part: list[Verdict]) -> None:
        if not part:
            return
        decided = sum(verdict.decided for verdict in part)
        steps = np.percentile([verdict.steps for verdict in part], [50, 99, 100])
        result.add_row(
            name,
            f"{len(part):,}",
            f"{100 * decided / len(part):.4f} %",
            str(sum(verdict.wrong for verdict in part)),
            *(f"{step:.0f}" for step in steps),
        )

    for status in (gf.Status.SOLVED, gf.Status.INFEASIBLE, gf.Status.WRENCH_UNREACHABLE):
        row(status.name.lower(), [v for v in verdicts if v.expected is status])
    result.add_section()
    for kind in sorted({verdict.kind for verdict in verdicts}):
        row(f"{kind} contacts", [v for v in verdicts if v.kind == kind])
    result.add_section()
    row("all", verdicts)
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--grasps", type=int, default=10_000)
    parser.add_argument("--margin", type=float, help="exactly this; else from 1e-3 to 1, at random")
    parser.add_argument("--hard", action="store_true", help="alpha 1e-4…1e6, frictions .01…5, …")
    parser.add_argument("--jobs", type=int, default=multiprocessing.cpu_count())
    parser.add_argument("--replay", metavar="GEOMETRY.CASE", help="solve one case and show it")
    parser.add_argument("--save", type=writable, help="append the table to this file")
    options = parser.parse_args()
    if options.replay is not None:
        index, k = map(int, options.replay.split("."))
        case = list(cases(options.seed, index, options.margin, options.hard))[k]
        if case is None:
            print("the truth of this case is not known well enough")
            return 1
        solution = gf.solve(case.problem)
        print(case.problem, case.expected.name, solution, solution.message, solution.verify())
        return 0
    verdicts, left_out = run(
        options.seed, options.grasps, options.margin, options.hard, options.jobs
    )
    margin = "1e-3…1" if options.margin is None else f"{options.margin:g}"
    ends = "hard ends" if options.hard else "alpha 1e-2…1e3"
    title = f"seed {options.seed}, {ends}, margin {margin}"
    doubtful = [
        f"{verdict.name}: {verdict.status.name}, expected {verdict.expected.name},"
        f" {'confirmed' if verdict.confirmed else 'not confirmed'}"
        for verdict in verdicts
        if verdict.wrong or not verdict.decided
    ]
    found = table(verdicts, left_out, title)
    show(found, *doubtful, save=options.save, width=110, append=True)
    return int(any(verdict.wrong for verdict in verdicts))


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
