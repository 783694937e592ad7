"""The input and output of every method: the contacts in the grasp, and the Solution made of c.

A removed contact leaves with its cone, its limits and its columns of W; its force is zero in the
answer. A wrench outside the range of W is the same verdict for every method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from graspforce import equations
from graspforce._engine.outcome import PlainOutcome, Status
from graspforce._util.arrays import Array, as_integer, require_instance
from graspforce.contact import ContactModel
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution


@dataclass(frozen=True, slots=True)
class Active:
    """A problem without its removed contacts; m now counts the components that are left.

    Attributes:
        problem: the whole problem.
        inner: it without them.
        A: its linear limits A c ≤ b, shape (v, m).
        b: shape (v,).
    """

    problem: ForceProblem
    inner: ForceProblem
    A: Array
    b: Array

    @classmethod
    def of(cls, problem: ForceProblem) -> Active:
        """Take the removed contacts out."""
        inner = problem.restricted()
        return cls(problem, inner, *inner.linear_limits())

    @property
    def models(self) -> tuple[ContactModel, ...]:
        """The contacts' models, n of them."""
        return self.inner.models

    @property
    def W(self) -> Array:
        """Grasp map, shape (k, m)."""
        return self.inner.W

    @property
    def starts(self) -> list[int]:
        """Where each contact starts in c; entry n is m."""
        return self.inner.starts

    @property
    def cone_weights(self) -> Array:
        """The weights v with which a cone is v_0 n ≥ ‖(v_1 x, …)‖, shape (m,)."""
        cones = self.inner.cones
        return equations.stacked(cones.scaling, cones.dims)

    @property
    def normals(self) -> Array:
        """The weights of the sum of normal forces, shape (m,): normals·c."""
        weights = np.zeros(self.inner.m)
        weights[self.starts[:-1]] = 1.0
        return weights

    def violation(self, c: Array) -> float:
        """Return the largest relative violation of a cone or limit at c, at least 0."""
        scales = self.inner.violation_scales()
        return max(0.0, float(equations.relative_violation(c, self.inner.barriers, scales)))


def as_steps(max_steps: int) -> int:
    """Return ``max_steps``, which must be an integer of at least 1.

    Raises:
        InvalidInputError: it is not.
    """
    return as_integer(max_steps, "max_steps", 1)


def run(problem: ForceProblem, method: Callable[[Active], Solution]) -> Solution:
    """Return a method's solution, or the verdict that needs no method; overflow is a status.

    No method is needed for a wrench outside the range of W, nor when no contact is left.
    """
    trivial = trivial_verdict(problem)
    if trivial is not None:
        return trivial
    if not equations.wrench_reachable(problem.restricted().W, problem.f):
        return empty_solution(problem, Status.WRENCH_UNREACHABLE)
    with np.errstate(all="ignore"):
        try:
            return method(Active.of(problem))
        except np.linalg.LinAlgError:
            return empty_solution(problem, Status.INVALID_NUMBERS)


def trivial_verdict(problem: ForceProblem) -> Solution | None:
    """Return the answer to a problem that would overflow or has no contact left; else None.

    Raises:
        InvalidInputError: no problem, or one with a soft wrench, contacts that pull, internal
            forces of motors or weights of its cones.
    """
    require_instance(problem, "problem", ForceProblem)
    if problem.layout.soft_wrench:
        raise InvalidInputError(
            "f_soft: got a soft wrench, expected none: this method keeps W c = f"
        )
    if problem.layout.pulls:
        raise InvalidInputError(
            "models: got contacts that pull, expected none: this method's contacts only push"
        )
    if problem.layout.internals:
        raise InvalidInputError(
            "internal: got internal forces of motors, expected none: this method knows c alone"
        )
    if problem.layout.cone_weights:
        raise InvalidInputError("cone_weight: got weights, expected none: this method has none")
    if np.abs(problem.packed).max() > equations.LARGEST:
        return empty_solution(problem, Status.INVALID_NUMBERS)
    if problem.active.any():
        return None
    return empty_solution(problem, Status.WRENCH_UNREACHABLE if problem.f.any() else Status.SOLVED)


def empty_solution(problem: ForceProblem, status: Status) -> Solution:
    """Return a verdict that has no forces."""
    decrement = 0.0 if status is Status.SOLVED else math.inf
    zeros = np.zeros(problem.m), np.zeros(len(problem.f))
    return Solution(PlainOutcome(status, 0, *zeros, decrement), problem)


def solution_from_gradient(
    view: Active, status: Status, steps: int, c: Array, gradient: Array
) -> Solution:
    """Return a method's result as a Solution; INVALID_NUMBERS where a number is not finite.

    Args:
        view: the problem that it solved.
        status: its verdict.
        steps: iterations of the method.
        c: contact forces, shape (m,).
        gradient: of the method's Lagrangian without the term of W c = f, shape (m,): W.T nu.
    """
    if not (np.isfinite(c).all() and np.isfinite(gradient).all()):
        return empty_solution(view.problem, Status.INVALID_NUMBERS)
    return make_solution(view, status, steps, c, equations.least_squares(view.W.T, gradient))


def make_solution(view: Active, status: Status, steps: int, c: Array, nu: Array) -> Solution:
    """As :func:`solution_from_gradient`, by the multipliers of W c = f, shape (k,)."""
    if not (np.isfinite(c).all() and np.isfinite(nu).all()):
        return empty_solution(view.problem, Status.INVALID_NUMBERS)
    return Solution(PlainOutcome(status, steps, view.problem.scatter(c), nu), view.problem)
