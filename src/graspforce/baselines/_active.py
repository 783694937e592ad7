"""What every method sees of a problem: the contacts that are in the grasp, and what it hands back.

A removed contact leaves with its cone, its limits and its columns of W; its force is zero in the
answer. A wrench outside the range of W is the same verdict for every method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspforce import reference
from graspforce._arrays import Array, as_integer, require_instance
from graspforce.contact import ContactModel, contact_starts
from graspforce.outcome import PlainOutcome, Status
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# Components of a soft finger's force, the torsion last.
SFC_DIM = 4
# Products of a few numbers above this overflow in double precision.
LARGEST = 1e60


@dataclass(frozen=True, slots=True)
class Active:
    """A problem without its removed contacts; m now counts the components that are left.

    Attributes:
        problem: the whole problem.
        kept: which components of the whole c are left.
        models: the contacts' models, n of them.
        W: grasp map, shape (k, m).
        A: every linear limit A c ≤ b, shape (v, m).
        b: shape (v,).
    """

    problem: ForceProblem
    kept: NDArray[np.bool_]
    models: tuple[ContactModel, ...]
    W: Array
    A: Array
    b: Array

    @classmethod
    def of(cls, problem: ForceProblem) -> Active:
        """Take the removed contacts out."""
        there = problem.active
        kept = np.repeat(there, problem.layout.dims)
        models = tuple(model for model, here in zip(problem.models, there, strict=True) if here)
        A, b = problem.linear_limits()
        return cls(problem, kept, models, problem.W[:, kept], A[:, kept], b)

    @property
    def cone_weights(self) -> Array:
        """The weights v with which a cone is v_0 n ≥ ‖(v_1 x, …)‖, contact by contact, shape (m,).

        1 or mu for the normal force, 1 for the tangential ones, mu/gamma for the torsion.
        """
        problem, starts = self.problem, np.array(self.problem.starts[:-1])
        weights = np.ones(problem.m)
        weights[starts] = problem.mu
        soft = np.array(problem.layout.dims) == SFC_DIM
        weights[starts[soft] + SFC_DIM - 1] = problem.mu[soft] / problem.gamma[soft]
        return weights[self.kept]

    @property
    def starts(self) -> list[int]:
        """Where each contact starts in c; entry n is m."""
        return contact_starts(self.models)

    @property
    def normals(self) -> Array:
        """The weights of the sum of normal forces, shape (m,): normals·c."""
        weights = np.zeros(len(self.W.T))
        weights[self.starts[:-1]] = 1.0
        return weights

    def spread(self, c: Array) -> Array:
        """Put the removed contacts back, with zero force."""
        whole = np.zeros(len(self.kept))
        whole[self.kept] = c
        return whole

    @property
    def violation_units(self) -> tuple[Array, Array]:
        """What violation 1 of a contact's cone [N] and of a linear limit is, shapes (n,), (v,)."""
        rows, cones = reference.violation_scales(self.problem)
        return cones[self.problem.active], rows

    def violation(self, c: Array) -> float:
        """Return the largest relative violation of a cone or limit at c, at least 0."""
        cones, rows = self.violation_units
        limits = (self.A @ c - self.b) / rows
        margins = reference.friction_margins(c, self.models) / cones
        return max(0.0, float(-margins.min()), float(limits.max(initial=-np.inf)))


def as_steps(max_steps: int) -> int:
    """Return ``max_steps``, which must be an integer of at least 1.

    Raises:
        InvalidInputError: it is not.
    """
    return as_integer(max_steps, "max_steps", 1)


def run(problem: ForceProblem, method: Callable[[Active], Solution]) -> Solution:
    """Run a method where one is needed, and turn an overflow into its status.

    No method is needed for a wrench outside the range of W, nor when no contact is left.
    """
    known = known_at_once(problem)
    if known is not None:
        return known
    if not reference.wrench_reachable(problem):
        return nothing(problem, Status.WRENCH_UNREACHABLE)
    with np.errstate(all="ignore"):
        try:
            return method(Active.of(problem))
        except np.linalg.LinAlgError:
            return nothing(problem, Status.INVALID_NUMBERS)


def known_at_once(problem: ForceProblem) -> Solution | None:
    """Return the answer to a problem that would overflow or has no contact left; else None.

    Raises:
        InvalidInputError: no problem.
    """
    require_instance(problem, "problem", ForceProblem)
    if np.abs(problem.packed).max() > LARGEST:
        return nothing(problem, Status.INVALID_NUMBERS)
    if problem.active.any():
        return None
    reachable = reference.wrench_reachable(problem)
    return nothing(problem, Status.SOLVED if reachable else Status.WRENCH_UNREACHABLE)


def nothing(problem: ForceProblem, status: Status) -> Solution:
    """Return a verdict that has no forces."""
    decrement = 0.0 if status is Status.SOLVED else math.inf
    zeros = np.zeros(problem.m), np.zeros(len(problem.f))
    return Solution(PlainOutcome(status, 0, *zeros, decrement), problem)


def answer(view: Active, status: Status, steps: int, c: Array, gradient: Array) -> Solution:
    """Wrap what a method found; INVALID_NUMBERS where a number is not finite.

    Args:
        view: what it worked on.
        status: its verdict.
        steps: iterations of the method.
        c: contact forces, shape (m,).
        gradient: of the method's Lagrangian without the term of W c = f, shape (m,): W.T nu.
    """
    if not (np.isfinite(c).all() and np.isfinite(gradient).all()):
        return nothing(view.problem, Status.INVALID_NUMBERS)
    return priced(view, status, steps, c, reference.least_squares(view.W.T, gradient))


def priced(view: Active, status: Status, steps: int, c: Array, nu: Array) -> Solution:
    """As :func:`answer`, for a method that knows the multipliers of W c = f, shape (k,)."""
    if not (np.isfinite(c).all() and np.isfinite(nu).all()):
        return nothing(view.problem, Status.INVALID_NUMBERS)
    return Solution(PlainOutcome(status, steps, view.spread(c), nu), view.problem)
