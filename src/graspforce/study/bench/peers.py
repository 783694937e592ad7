"""Times of other solvers on the same problems in the same run.

Each keeps its workspace and takes the new numbers of every problem, as in a control loop.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from graspforce import baselines, scenarios
from graspforce._util.clock import Pair, hot, no_op
from graspforce.problem import ForceProblem
from graspforce.solve import solve
from graspforce.study.bench.measurement import Measurement

GROUP = "update and solve, the paper's dynamic task"
OWN = "graspforce, cold: solve(problem)"
EVERY = 10  # of the ticks

Solve = Callable[[ForceProblem], object]


def _baseline(method: str, **options: Any) -> Callable[[ForceProblem], Solve]:
    def prepare(problem: ForceProblem) -> Solve:
        module = importlib.import_module(baselines.METHODS[method])
        return module.Prepared(problem, **options).solve

    return prepare


def _cvxpy(problem: ForceProblem) -> Solve:
    """The least-norm SOCP as users of cvxpy write it, with W, J and f as parameters."""
    cp: Any = importlib.import_module("cvxpy")
    W, J, f = (cp.Parameter(getattr(problem, name).shape) for name in "WJf")
    c = cp.Variable(problem.m)
    tau = J.T @ c + problem.tau_bias
    limits = [W @ c == f, tau <= problem.tau_hi, tau >= problem.tau_lo]
    for start, mu in zip(problem.starts[:-1], problem.mu, strict=True):
        limits.append(cp.SOC(mu * c[start], c[start + 1 : start + 3]))
    program = cp.Problem(cp.Minimize(cp.sum_squares(c)), limits)

    def solve_next(now: ForceProblem) -> object:
        W.value, J.value, f.value = now.W, now.J, now.f
        return program.solve(solver=cp.CLARABEL)

    return solve_next


PEERS: dict[str, Callable[[ForceProblem], Solve]] = {
    "QOCO, SOCP of least norm": _baseline("socp", solver="qoco", objective="norm"),
    "Clarabel, SOCP of least norm": _baseline("socp", solver="clarabel", objective="norm"),
    "ECOS, SOCP of least norm": _baseline("socp", solver="ecos", objective="norm"),
    "SCS to 1e-6, SOCP of least norm": _baseline("socp", solver="scs", objective="norm", tol=1e-6),
    "Moreau, SOCP of least norm": _baseline("socp", solver="moreau", objective="norm"),
    "DAQP, least norm, 8 facets a cone": _baseline("qp", facets=8),
    "HiGHS, LP of Kerr and Roth, 8 facets a cone": _baseline("lp", facets=8),
    "cvxpy and Clarabel, SOCP of least norm": _cvxpy,
    "Clarabel, the WBF objective by exponential cones": _baseline("wbf_conic"),
}


def peer_times(effort: int) -> Iterator[Measurement]:
    """Time graspforce cold and every solver that is installed."""
    problems = list(scenarios.dynamic().problems())[::EVERY]
    yield Measurement(GROUP, OWN, _times(solve, problems, EVERY * effort))
    for name, prepare in PEERS.items():
        try:
            solve_next = prepare(problems[0])
        except ImportError:  # not installed
            continue
        yield Measurement(GROUP, name, _times(solve_next, problems, max(1, effort // 4)))


def _times(solve_next: Solve, problems: list[ForceProblem], rounds: int) -> np.ndarray:
    calls: list[Pair] = [(no_op, partial(solve_next, problem)) for problem in problems]
    return hot(calls, rounds)
