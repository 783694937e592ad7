"""The descent that gradient flow and Dikin recursion share; they differ in the metric.

Both minimise Σ normal forces − barrier·ln det P(c) with W c = f in the null-space coordinates of
Eq. (17), from a start inside, along a direction of descent with an exact line search.
"""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_array, as_positive, require_instance
from graspforce.baselines._active import Active, as_steps, run, solution_from_gradient
from graspforce.baselines._lmi import Lmi, Point, half_square_decrement, line_search
from graspforce.baselines._start import feasible_start
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# From a point and the gradient there: the direction, shape (q,).
Direction = Callable[[Point, Array], Array]


def descend(
    problem: ForceProblem,
    make_direction: Callable[[Lmi], Direction],
    *,
    barrier: float,
    tol: float,
    max_steps: int,
    start: ArrayLike | None,
    decrement_every: int,
) -> Solution:
    """Minimise the SDP objective by steps along a direction of descent.

    Args:
        problem: what to solve.
        make_direction: from the inequality P(x) ≻ 0 to the direction's function.
        barrier: weight of −ln det P [N].
        tol: bound on the Newton decrement's half square of the objective / barrier at return.
        max_steps: the most steps after the start is found.
        start: contact forces to start from, shape (m,); one outside the limits is ignored.
        decrement_every: steps between two evaluations of the decrement, which cost the Hessian.

    Raises:
        InvalidInputError: an option out of range, a start of the wrong shape.
    """
    require_instance(problem, "problem", ForceProblem)
    as_positive(barrier, "barrier", "N")
    as_positive(tol, "tol")
    most = as_steps(max_steps)
    guess = None if start is None else as_array(start, "start", (problem.m,))

    def method(view: Active) -> Solution:
        c_p, N = equations.particular_and_nullspace(view.W, problem.f)
        in_c = Lmi.of(view)
        lmi = in_c.substitute(c_p, N)
        steps = 0
        x = N.T @ ((c_p if guess is None else guess[problem.active_components]) - c_p)
        if guess is None or not lmi.at(x).inside:
            found = feasible_start(view)
            if isinstance(found, Solution):
                return found
            x, steps = N.T @ (found[0] - c_p), found[1]
        direction = make_direction(lmi)
        effort = N.T @ view.normals
        status, last = Status.MAX_STEPS, steps + most
        while True:
            point = lmi.at(x)
            gradient = effort + barrier * point.gradient
            if (
                steps % decrement_every == 0
                and half_square_decrement(point, gradient / barrier) <= tol
            ):
                status = Status.SOLVED
                break
            if steps == last:
                break
            d = direction(point, gradient)
            x = x + line_search(point.spectrum(d), float(effort @ d), barrier) * d
            steps += 1
        c = c_p + N @ x
        return solution_from_gradient(
            view, status, steps, c, view.normals + barrier * in_c.at(c).gradient
        )

    return run(problem, method)
