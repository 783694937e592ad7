"""Recurrent neural network with exact friction cones: Xia, Wang and Fok [10].

    minimise  ‖c‖²/2   with W c = f, A c ≤ b and every c_i in its cone K_i

by a differential equation whose equilibria are the optima, meant to run on analogue hardware:
neurons that add, and one nonlinearity a constraint. The WBF paper says of [10] only that it
minimises a quadratic objective under the nonlinear cones. Chosen here is the projection network of
that school, in the forces c and the multipliers u (cones), w (limits) and z (wrench)::

    dc/dt = −( c − L.T p_u + A.T p_w − W.T (z + f − W c) )     p_u = Π(u − L c)
    du/dt = p_u − u                                             p_w = max(0, w + A c − b)
    dw/dt = p_w − w
    dz/dt = f − W c

where L c stacks each contact's (mu n, tangential forces) and Π projects onto their cones
‖t‖ ≤ s, all with the same formula. It is the saddle flow of the augmented Lagrangian: globally
convergent, because ‖c‖² is strictly convex. Projecting keeps the cones exact at their tips and
axes, where ‖t‖ ≤ mu n written with one multiplier has no derivative. The rows of W and A are scaled
to length 1, the network's choice of gains. SciPy integrates by its BDF method, as multipliers and
forces move at different rates, until all rates are below the tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspforce import equations
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_array, as_positive, require_instance
from graspforce.baselines._active import Active, as_steps, run, solution_from_gradient
from graspforce.baselines._start import infeasible, infeasible_or
from graspforce.errors import MissingExtraError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# Tolerances of the integrator, in units of the wrench's size; the end is judged by the rates.
RELATIVE, ABSOLUTE = 1e-4, 1e-7
# At multipliers of this size, in the same unit, or after this many steps feasibility is checked:
# the flow of an infeasible problem has no equilibrium. A feasible one takes 60 to 750 steps.
LARGE_MULTIPLIER = 1e3
FEASIBILITY_CHECK_STEP = 200
# The widest contact, to which the others are padded with zero tangents.
MAX_DIM = 4


def solve(
    problem: ForceProblem,
    *,
    tol: float = 1e-9,
    max_steps: int = 5000,
    start: ArrayLike | None = None,
) -> Solution:
    """Minimise ‖c‖²/2 with W c = f under exact cones and all limits by the network's flow.

    Args:
        problem: what to solve; its alpha has no part in this objective.
        tol: the largest rate of any neuron at return, relative to the wrench.
        max_steps: the most steps of the integrator.
        start: contact forces to start from, shape (m,) [N, N·m]; default zero, as for all
            multipliers.

    Returns:
        The forces, projected onto W c = f; ``newton_steps`` counts the integrator's steps.
        Where the multipliers grow very large, after 200 steps, or where there is no other end,
        INFEASIBLE if ``_start`` finds the certificate.

    Raises:
        InvalidInputError: an option out of range, a start of the wrong shape.
        MissingExtraError: SciPy is not installed.
    """
    require_instance(problem, "problem", ForceProblem)
    as_positive(tol, "tol")
    most = as_steps(max_steps)
    guess = np.zeros(problem.m) if start is None else as_array(start, "start", (problem.m,))
    BDF = _integrator()

    def method(view: Active) -> Solution:
        network = _Network.of(view)
        scale = float(np.abs(network.f).max()) or 1.0
        at_start = np.zeros(network.neurons)
        at_start[: len(network.L.T)] = guess[problem.active_components]
        path = BDF(network.rates, 0.0, at_start, np.inf, rtol=RELATIVE, atol=ABSOLUTE * scale)
        steps, status, checked = 0, Status.MAX_STEPS, False
        while steps < most:
            path.step()
            steps += 1
            if path.status == "failed":
                status = Status.STALLED
                break
            if not checked and (
                steps == FEASIBILITY_CHECK_STEP or np.abs(path.y).max() > LARGE_MULTIPLIER * scale
            ):
                checked = True
                proof = infeasible(view)
                if proof is not None:
                    return proof
            if np.abs(network.rates(path.t, path.y)).max() <= tol * scale:
                status = Status.SOLVED
                break
        c, constraint_force = network.read(path.y)
        c = c + equations.particular_and_nullspace(view.W, problem.f - view.W @ c)[0]
        solution = solution_from_gradient(view, status, steps, c, c + constraint_force)
        return solution if status is Status.SOLVED else infeasible_or(view, solution)

    return run(problem, method)


def _integrator() -> Any:
    try:
        from scipy.integrate import BDF  # pyright: ignore[reportMissingTypeStubs]
    except ImportError:
        raise MissingExtraError("the neural network", "scipy", "baselines") from None
    return BDF


@dataclass(frozen=True, slots=True)
class _Network:
    """The constraints, scaled for the network.

    Attributes:
        L: contacts' cone coordinates (mu n, tangents), each padded to 4, shape (4 n, m).
        W: shape (k, m), rows of length 1.
        f: shape (k,).
        A: shape (v, m), rows of length 1.
        b: shape (v,).
    """

    L: Array
    W: Array
    f: Array
    A: Array
    b: Array

    @classmethod
    def of(cls, view: Active) -> _Network:
        L = np.zeros((len(view.models), MAX_DIM, len(view.W.T)))
        for i, (start, end) in enumerate(pairwise(view.starts)):
            L[i, : end - start, start:end] = np.diag(view.models[i].cone_scaling)
        of_W, of_A = (np.linalg.norm(rows, axis=1) for rows in (view.W, view.A))
        of_W[of_W == 0], of_A[of_A == 0] = 1.0, 1.0
        return cls(
            L.reshape(-1, len(view.W.T)),
            view.W / of_W[:, None],
            view.problem.f / of_W,
            view.A / of_A[:, None],
            view.b / of_A,
        )

    @property
    def neurons(self) -> int:
        """The length of the state (c, u, w, z)."""
        return len(self.L.T) + len(self.L) + len(self.b) + len(self.f)

    def rates(self, t: float, state: Array) -> Array:
        """The right-hand side of the differential equation."""
        c, u, w, z = self._split(state)
        p_u, p_w = self._projections(c, u, w)
        error = self.f - self.W @ c
        constraint_force = self.A.T @ p_w - self.L.T @ p_u
        return np.concatenate(
            (self.W.T @ (z + error) - c - constraint_force, p_u - u, p_w - w, error)
        )

    def read(self, state: Array) -> tuple[Array, Array]:
        """Return the forces and the forces of cones and limits on them, both of shape (m,)."""
        c, u, w, _ = self._split(state)
        p_u, p_w = self._projections(c, u, w)
        return c, self.A.T @ p_w - self.L.T @ p_u

    def _split(self, state: Array) -> list[Array]:
        return np.split(state, np.cumsum([len(self.L.T), len(self.L), len(self.b)]))

    def _projections(self, c: Array, u: Array, w: Array) -> tuple[Array, Array]:
        onto_cones = project(np.reshape(u - self.L @ c, (-1, MAX_DIM)))
        return onto_cones.ravel(), np.maximum(0.0, w + self.A @ c - self.b)


def project(y: Array) -> Array:
    """Project each row (s, t) onto the cone ‖t‖ ≤ s, shape (n, d)."""
    s, t = y[:, 0], y[:, 1:]
    size = np.linalg.norm(t, axis=1)
    # Inside: kept. In the dual cone's opposite: the tip. Between: onto the nearest generator.
    height = np.where(size <= s, s, np.maximum(0.0, (s + size) / 2))
    share = np.where(size <= s, 1.0, height / np.where(size > 0, size, 1.0))
    return np.column_stack((height, share[:, None] * t))
