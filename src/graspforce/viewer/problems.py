"""What the knobs make of a force problem, and the answer to it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.answers import firmness
from graspforce.answers.wishes import slip_reserves, with_friction
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.solve import solve
from graspforce.viewer.knobs import Knobs


def turn_knobs(
    problem: ForceProblem,
    knobs: Knobs,
    engagement: Array,
    c_max: float | Array | None,
    default_ceiling: float,
) -> ForceProblem:
    """Return a problem with the knobs' friction, limits, engagement and alpha.

    Args:
        problem: with the knobs' load, and without ceilings.
        knobs: where they stand.
        engagement: of every contact as planned, which a knob can only lower, shape (n,).
        c_max: ceilings as planned [N]; None for none.
        default_ceiling: which every contact gets where a finger is to leave and has none [N].
    """
    changes: dict[str, Any] = {"alpha": knobs.alpha}
    if knobs.friction != 1:
        changes["models"] = with_friction(problem, knobs.friction)
    if knobs.torque != 1 and problem.layout.joints:
        lo, hi = problem.tau_lo, problem.tau_hi
        # A limit on the far side of zero is no strength: it stays, as in the remedies.
        changes["tau_lo"] = np.where(lo < 0, knobs.torque * lo, lo)
        changes["tau_hi"] = np.where(hi > 0, knobs.torque * hi, hi)
    wanted = np.minimum(knobs.engagements(problem.n), engagement)
    if knobs.ceiling > 0:
        c_max = knobs.ceiling
    elif c_max is None and (wanted < 1).any():
        c_max = default_ceiling
    if c_max is not None:
        changes |= {"c_max": c_max * np.ones(problem.n), "engagement": wanted}
    return problem.replace(**changes)


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """The forces for a moment, and how they came.

    Attributes:
        solution: of the problem, hard wishes included.
        problem: the problem without them, by which shares are measured.
        alpha: that made the forces.
        microseconds: how long the solve took, all solves of a wish together.
        solves: how many there were.
        message: what a wish came to; empty where alpha is given.
    """

    solution: Solution
    problem: ForceProblem
    alpha: float
    microseconds: float
    solves: int = 1
    message: str = ""

    @property
    def solved(self) -> bool:
        """Whether there are forces."""
        return self.solution.status is Status.SOLVED

    @property
    def missed(self) -> tuple[float, float]:
        """How large the force is that the forces miss, and the one that is wanted [N]."""
        rows = slice(2 if len(self.problem.f) == 3 else 3)
        wanted = self.problem.f[rows]
        missed = self.problem.W[rows] @ self.solution.c - wanted
        return float(np.linalg.norm(missed)), float(np.linalg.norm(wanted))

    @property
    def cone_use(self) -> Array:
        """How much of its friction each contact uses, shape (n,); NaN without friction."""
        left = slip_reserves(self.problem, self.solution.c)
        return np.where(np.isfinite(left), 1 - left, np.nan)

    @property
    def torque_use(self) -> Array:
        """How much of its limit each joint's torque takes, on its side, shape (n_joints,)."""
        tau = self.solution.tau
        limit = np.where(tau >= 0, self.problem.tau_hi, -self.problem.tau_lo)
        with np.errstate(divide="ignore", invalid="ignore"):
            use = np.abs(tau) / limit
        return np.where(limit > 0, use, np.where(tau == 0, 0.0, 1.0))


def answer(problem: ForceProblem, knobs: Knobs) -> Answer:
    """Solve a problem as the knobs say how firm the grip is.

    Raises:
        InvalidInputError: a wish out of its range, or one about what the problem has not.
    """
    if knobs.firmness == "alpha":
        start = time.perf_counter()
        solution = solve(problem)
        return Answer(solution, problem, problem.alpha, 1e6 * (time.perf_counter() - start))
    start = time.perf_counter()
    wishes: dict[str, float] = {knobs.firmness: knobs.wish}
    grip = firmness.choose(problem, **wishes)
    took = 1e6 * (time.perf_counter() - start)
    return Answer(grip.solution, problem, grip.alpha, took, grip.solves, grip.message)
