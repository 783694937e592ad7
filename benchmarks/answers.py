"""What the answers in the user's terms promise, on 193 Allegro grasps and 300 random ones.

Wishes, remedies and payloads are judged by Clarabel; balls and robust forces by drawing wrenches
and contacts. The Allegro grasps are those of ``../shared/data/allegro_ycb.npz`` where that is
present, else the twelve of ``tests/data``. Some ten minutes: ``python benchmarks/answers.py``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.progress import track
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.baselines import socp
from graspforce.cli.process import as_command
from graspforce.scenarios import paper

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests"))
import clarabel_oracle  # noqa: E402
import test_answers_diagnosis as remedies  # noqa: E402
import test_answers_robust as robust  # noqa: E402

WHOLE = ROOT.parent / "shared" / "data" / "allegro_ycb.npz"
WISHES: tuple[dict[str, float], ...] = (
    {"times_least": 1.5}, {"times_least": 4}, {"slip_reserve": 0.3}, {"torque_reserve": 0.2},
    {"times_least": 2, "slip_reserve": 0.2, "torque_reserve": 0.2},
)  # fmt: skip


def allegro() -> list[gf.ForceProblem]:
    """Return the Allegro grasps, all of them where they are present."""
    path = WHOLE if WHOLE.exists() else ROOT / "tests" / "data" / "allegro.npz"
    return [problem for _, problem in gf.files.read(path)]


def random_grasps(count: int, status: gf.Status) -> Iterator[gf.ForceProblem]:
    """Yield random grasps of three to six contacts, mixed models and all kinds of limits."""
    rng = np.random.default_rng(0)
    while count:
        problem = clarabel_oracle.random_problem(rng)
        if gf.solve(problem).status is status:
            count -= 1
            yield problem


def by_hand(problem: gf.ForceProblem, wishes: dict[str, float]) -> gf.ForceProblem:
    """Return the problem with the hard wishes in it, from their definition."""
    inset = wishes.get("torque_reserve", 0.0) * (problem.tau_hi - problem.tau_lo) / 2
    return problem.replace(
        models=remedies.scaled_models(problem, 1 - wishes.get("slip_reserve", 0.0)),
        tau_lo=problem.tau_lo + inset,
        tau_hi=problem.tau_hi - inset,
    )


def wishes(problems: list[gf.ForceProblem], name: str) -> Table:
    """Return how wishes are met or refused."""
    table = Table(title=f"gf.firmness.choose, {len(problems)} {name} grasps; solves: median, most")
    for column in ("wishes", "met", "refused", "wrongly", "worst error", "solves"):
        table.add_column(column, justify="right")
    for wanted in WISHES:
        met = refused = wrong = 0
        worst, costs = 0.0, []
        for problem in track(problems, str(wanted), transient=True):
            grip = gf.firmness.choose(problem, **wanted)
            costs.append(grip.solves)
            hard = by_hand(problem, wanted)
            least = socp.solve(hard)
            possible = least.status is gf.Status.SOLVED
            if grip.met:
                met += 1
                inside = gf.equations.strictly_inside(grip.c, hard.barriers)
                off = 0.0
                if "times_least" in wanted and possible:
                    times = grip.largest_normal / least.normal_forces.max()
                    off = abs(times / wanted["times_least"] - 1)
                worst = max(worst, off)
                wrong += not (inside and possible and off <= 0.01)
            else:
                refused += 1
                if "times_least" in wanted and possible:  # too firm for any alpha
                    firm = gf.solve(hard.replace(alpha=1e-3)).normal_forces.max()
                    wrong += firm > wanted["times_least"] * least.normal_forces.max() * 1.01
                else:
                    wrong += possible
        said = ", ".join(f"{key}={value:g}" for key, value in wanted.items())
        table.add_row(
            said, str(met), str(refused), str(wrong), f"{100 * worst:.2f} %",
            f"{np.median(costs):.0f}, {max(costs)}",
        )  # fmt: skip
    return table


def least_forces(problems: list[gf.ForceProblem]) -> str:
    """Return how well the least force is enclosed."""
    widths, off = [], []
    for problem in problems:
        edge = gf.firmness.least(problem)
        truth = socp.solve(problem).normal_forces.max()
        widths.append((edge.upper - edge.lower) / edge.upper)
        off.append(max(edge.lower / truth - 1, 1 - edge.upper / truth))
    return (
        f"gf.firmness.least, {len(problems)} grasps: bounds at most {max(widths):.1e} apart, "
        f"Clarabel's value outside them by at most {max(0.0, *off):.1e}"
    )


def all_remedies(problems: list[gf.ForceProblem]) -> Table:
    """Return how many remedies hold, and for how many a hundredth less is too little."""
    table = Table(title=f"gf.diagnose, {len(problems)} infeasible grasps")
    for column in ("remedy", "found", "verified", "1 % less is too little, by Clarabel"):
        table.add_column(column, justify="right")
    counts: dict[str, list[int]] = {}
    times = []
    for problem in track(problems, "remedies", transient=True):
        start = time.perf_counter()
        found = gf.diagnose(problem).remedies
        times.append(time.perf_counter() - start)
        for remedy in found:
            row = counts.setdefault(remedy.kind, [0, 0, 0])
            row[0] += 1
            row[1] += remedy.solution.status is gf.Status.SOLVED and remedy.solution.verify().ok
            less = remedies.a_little_less(problem, remedy, 0.01)
            row[2] += socp.solve(less).status is not gf.Status.SOLVED
    for kind, row in counts.items():
        table.add_row(kind, *map(str, row))
    table.caption = (
        f"{np.median(times):.2g} s a diagnosis in the median, {max(times):.2g} s at most"
    )
    return table


def payloads(problems: list[gf.ForceProblem]) -> str:
    """Return how well payloads along the load are enclosed."""
    widths, outside, undecided, times = [], 0, 0, []
    for problem in track(problems, "payloads", transient=True):
        start = time.perf_counter()
        found = gf.payload.along(problem, problem.f)
        times.append(time.perf_counter() - start)
        widths.append((found.upper - found.lower) / found.lower)
        try:
            truth = clarabel_oracle.critical_load(problem) - 1
        except AssertionError:  # AlmostSolved
            undecided += 1
            continue
        outside += not found.lower - 1e-7 <= truth <= found.upper + 1e-7
    return (
        f"gf.payload.along, {len(problems)} grasps: intervals at most {max(widths):.1e} wide, "
        f"Clarabel's value outside {outside} of them ({undecided} not solved by it), "
        f"{1e3 * np.median(times):.2g} ms in the median"
    )


def balls(problems: list[gf.ForceProblem], draws: int) -> str:
    """Return how well balls are enclosed, and whether what is drawn in them is held."""
    rng = np.random.default_rng(1)
    gaps, times, lost = [], [], 0
    each = draws // len(problems)
    for problem in track(problems, "balls", transient=True):
        start = time.perf_counter()
        found = gf.payload.ball(problem)
        times.append(time.perf_counter() - start)
        gaps.append(1 - found.lower / found.upper)
        sizes = np.array([1, 1, 1, *[found.length] * 3])
        for _ in range(each):
            u = rng.normal(size=6)
            w = found.lower * sizes * u / np.linalg.norm(u)
            lost += gf.solve(problem.replace(f=problem.f + w)).status is not gf.Status.SOLVED
    return (
        f"gf.payload.ball, {len(problems)} grasps of four fingers: bounds {100 * max(gaps):.2f} % "
        f"apart at most, {np.median(times):.2g} s in the median, {np.percentile(times, 95):.2g} s "
        f"in 19 of 20, {max(times):.2g} s at most; of {each * len(problems)} wrenches on the balls "
        f"{lost} cannot be held"
    )


def hulls(problems: list[gf.ForceProblem], facets: int = 512) -> str:
    """Return how balls agree with polytopes of many facets, by Clarabel."""
    rng = np.random.default_rng(4)
    nearest, below, above = [], 0, 0
    for problem in track(problems, "hulls", transient=True):
        found = gf.payload.ball(problem)
        sizes = np.array([1, 1, 1, *[found.length] * 3])
        u = rng.normal(size=(facets, 6)) * np.geomspace(1e-3, 1e3, facets)[:, None]
        u += found.weakest / sizes
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        reach = np.array([
            clarabel_oracle.most_along(problem, across) - across @ problem.f for across in u / sizes
        ])  # fmt: skip
        nearest.append(reach.min() / found.upper)
        below += bool((reach < found.lower * (1 - 1e-6)).any())
        across = found.weakest / sizes**2
        weakest = clarabel_oracle.most_along(problem, across) - across @ problem.f
        above += not found.lower * (1 - 1e-6) <= weakest <= found.upper * (1 + 1e-6)
    return (
        f"{len(problems)} of these balls in polytopes of {facets} planes that Clarabel finds by "
        f"directions near the weakest wrench and far from it: {below} reach beyond, the largest "
        f"balls of the polytopes are {min(nearest):.4g} to {max(nearest):.4g} times as large; of "
        f"the planes across the weakest wrench {above} lie outside the bounds"
    )


def sets(draws: int) -> Table:
    """Return what becomes of the lightest tightened grip inside its set and outside it."""
    table = Table(title=f"gf.robust.tighten, the least firm grip, {draws} draws on each set's rim")
    for column in ("set", "fails inside", "first fails in a set larger by"):
        table.add_column(column, justify="right")
    held, problem = robust.ball()
    rng = np.random.default_rng(2)
    for name, given in robust.SETS.items():
        c = gf.firmness.least(gf.robust.tighten(problem, **given)).solution.c
        worst = robust.worst(held, problem, c, rng, given, draws).min()
        factor = 1.0
        while factor < 20:
            factor *= 1.1
            larger = {k: v * (factor**2 if k == "wrench" else factor) for k, v in given.items()}
            if larger.get("friction", 0) >= 1:
                break
            if robust.worst(held, problem, c, rng, larger, 300).min() < 0:
                break
        table.add_row(name, "no" if worst > 0 else "yes", f"{factor:.2g}")
    return table


def rates(ticks: int) -> str:
    """Return whether rate limits are ever exceeded in a loop with a random load."""
    rng = np.random.default_rng(3)
    problem = next(paper.static().problems())
    most = 0.05
    servo = gf.Servo(problem.replace(c_last=gf.solve(problem).c, dc_max=most))
    last, exceeded, failed = np.array(servo.c_last), 0, 0
    load, pull = np.array(problem.f), np.zeros(6)
    noise = rng.normal(size=(ticks, 6)) * [0.05, 0.05, 0.05, 1e-3, 1e-3, 1e-3]
    for step in noise:
        pull = 0.9 * pull + step
        servo.f[:] = load + pull
        held = servo.tick() is gf.Status.SOLVED
        failed += not held
        if held or servo.solution.nearest:
            exceeded += bool(np.abs(servo.c - last).max() > most)
            last[:] = servo.c
    return f"rate limits: exceeded in {exceeded} of {ticks} random ticks; {failed} were infeasible"


def loop() -> Table:
    """Return how the wishes are kept on the paper's circle."""
    table = Table(title="gf.firmness.FirmServo on the paper's circle, 500 ticks")
    for column in ("times the least", "from", "to", "Newton steps", "jump over neighbours"):
        table.add_column(column, justify="right")
    problems = list(paper.dynamic().problems())
    for times in (1.5, 3.0):
        servo = gf.firmness.FirmServo(problems[0], times_least=times)
        grips = [servo.step(W=p.W, f=p.f, J=p.J) for p in problems]
        firm = [grip.times_least for grip in grips]
        moves = np.linalg.norm(np.diff([grip.c for grip in grips], axis=0), axis=1)
        jump = (moves[1:-1] / np.maximum(moves[:-2], moves[2:])).max()
        steps = max(grip.solution.newton_steps for grip in grips[1:])
        table.add_row(
            f"{times:g}", f"{min(firm):.3g}", f"{max(firm):.3g}", f"1 to {steps}", f"{jump:.2g}"
        )
    return table


def at_rest(problems: list[gf.ForceProblem], ticks: int = 150) -> Table:
    """Return how near to its wish a loop comes under a load that stays."""
    table = Table(title=f"gf.firmness.FirmServo at rest, {len(problems)} Allegro grasps")
    for column in ("times the least", "choose can", "within 1 %", "worst", "ms a tick"):
        table.add_column(column, justify="right")
    for times in (1.5, 2.0, 4.0):
        off, spans = [], []
        for problem in track(problems, f"at rest, {times:g}", transient=True):
            if not gf.firmness.choose(problem, times_least=times).met:
                continue
            servo = gf.firmness.FirmServo(problem, times_least=times)
            grip = servo.step(f=problem.f)
            for _ in range(ticks):
                start = time.perf_counter()
                grip = servo.step(f=problem.f)
                spans.append(time.perf_counter() - start)
            off.append(abs(grip.times_least / times - 1))
        table.add_row(
            f"{times:g}", str(len(off)), str(sum(each <= 0.01 for each in off)),
            f"{100 * max(off):.2f} %", f"{1e3 * np.median(spans):.2g}",
        )  # fmt: skip
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--random", type=int, default=300, help="random grasps")
    parser.add_argument("--draws", type=int, default=100_000, help="wrenches, and contacts")
    parser.add_argument("--ticks", type=int, default=1_000_000, help="of the loop with rate limits")
    parser.add_argument("--save", type=writable, help="write the tables to this file")
    options = parser.parse_args()
    hands = allegro()
    held = [p for p in hands if gf.solve(p).status is gf.Status.SOLVED]
    random = list(random_grasps(options.random, gf.Status.SOLVED))
    heavy = [p.replace(f=1.5 * gf.payload.along(p, p.f).upper * p.f) for p in held[::4]]
    broken = [p for p in hands if gf.solve(p).status is gf.Status.INFEASIBLE] + heavy
    broken += list(random_grasps(options.random // 2, gf.Status.INFEASIBLE))
    broken = [p for p in broken if gf.solve(p).status is gf.Status.INFEASIBLE]
    show(
        wishes(held, "Allegro"), wishes(random, "random"), least_forces(held + random),
        all_remedies(broken), payloads(held + random), balls(held, options.draws),
        hulls(held[::10]), sets(options.draws // len(robust.SETS)), loop(), at_rest(held[::4]),
        rates(options.ticks),
        save=options.save, width=110,
    )  # fmt: skip
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
