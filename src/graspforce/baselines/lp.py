"""Linear program with linearised cones: Kerr and Roth [2].

    maximise  d   with W c = f, F c + d‖F‖ ≤ 0, A c + d‖A‖ ≤ b

F c ≤ 0 are the facets of all friction cones, A c ≤ b the joint torques and every other limit, ‖·‖
the length of each row: d is the smallest distance [N] of the forces to any of these planes, which
the program maximises over all limits at once. A torsion is divided by gamma/mu, which makes it a
force. The WBF paper says of [2] only that it linearises the cones and maximises the distance to the
constraints; the distance as the length in force space, the same for all limits, is chosen here.
With "normal" the same constraints serve another objective, the least largest normal force, which
brackets the exact one of ``socp``: inner pyramids from above, outer ones from below.

HiGHS solves it by its dual simplex method, which starts from the basis before. A linear program
sits on a vertex, and its forces jump when the vertex changes.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.baselines._active import Active, as_steps
from graspforce.baselines._pyramids import Cones, Pyramids
from graspforce.baselines._stream import SolverResult, Stream
from graspforce.errors import InvalidInputError, MissingExtraError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution

# Of feasibility and optimality: the smallest that HiGHS takes.
TOLERANCE = 1e-10

Objective: TypeAlias = Literal["distance", "normal"]


class Prepared(Stream):
    """The program with HiGHS and its last basis kept; arguments as :func:`solve`."""

    def __init__(
        self,
        problem: ForceProblem,
        *,
        facets: int = 8,
        cones: Cones = "inner",
        objective: Objective = "distance",
        max_steps: int = 10_000,
    ) -> None:
        self._pyramids = Pyramids.of(facets, cones)
        if objective not in ("distance", "normal"):
            raise InvalidInputError(
                f"objective: got {objective!r}, expected 'distance' or 'normal'"
            )
        self._distance = objective == "distance"
        most = as_steps(max_steps)
        self._library = _highs()
        self._solver = _silent_highs(self._library)
        options = {
            "threads": 1, "solver": "simplex", "presolve": "off",
            "simplex_iteration_limit": most, "primal_feasibility_tolerance": TOLERANCE,
            "dual_feasibility_tolerance": TOLERANCE,
        }  # fmt: skip
        for name, value in options.items():
            self._solver.setOptionValue(name, value)
        self._sizes = (0, 0)
        super().__init__(problem)

    def _load(self, view: Active, unit: float) -> None:
        m, k, n = len(view.W.T), len(view.W), len(view.models)
        facets = self._pyramids.rows(view)
        rows = np.vstack((view.W, view.A, facets))
        upper = np.concatenate((view.problem.f, view.b, np.zeros(len(facets)))) / unit
        lower = np.full(len(upper), -np.inf)
        lower[:k] = upper[:k]
        if self._distance:  # maximise d, the last variable
            units = view.cone_weights  # torsion in units of gamma/mu is a force, too
            units[view.starts[:-1]] = 1.0
            lengths = np.linalg.norm(rows / units, axis=1)
            lengths[:k] = 0.0
            rows = np.column_stack((rows, lengths))
            cost = -1.0
        else:  # minimise t, the last variable, with c_norm,i − t ≤ 0
            ceilings = np.zeros((n, m + 1))
            ceilings[np.arange(n), view.starts[:-1]], ceilings[:, m] = 1.0, -1.0
            rows = np.vstack((np.pad(rows, ((0, 0), (0, 1))), ceilings))
            upper = np.concatenate((upper, np.zeros(n)))
            lower = np.concatenate((lower, np.full(n, -np.inf)))
            cost = 1.0
        self._pass(rows, lower, upper, np.append(np.zeros(m), cost))

    def _pass(self, rows: Array, lower: Array, upper: Array, cost: Array) -> None:
        """Pass the program; a basis of the one before, if it has the same size, is kept."""
        library, solver = self._library, self._solver
        basis = solver.getBasis() if self._sizes == rows.shape else None
        program = library.HighsLp()
        program.num_row_, program.num_col_ = self._sizes = rows.shape
        program.col_cost_ = cost
        program.col_lower_ = np.full(len(cost), -np.inf)
        program.col_upper_ = np.full(len(cost), np.inf)
        program.row_lower_, program.row_upper_ = lower, upper
        nonzero = np.nonzero(rows)
        matrix = program.a_matrix_
        matrix.format_ = library.MatrixFormat.kRowwise
        matrix.start_ = np.concatenate(
            ([0], np.cumsum(np.bincount(nonzero[0], minlength=len(rows))))
        )
        matrix.index_, matrix.value_ = nonzero[1], rows[nonzero]
        solver.passModel(program)
        if basis is not None and basis.valid:
            solver.setBasis(basis)

    def _run(self, view: Active, unit: float) -> SolverResult:
        solver, model_status = self._solver, self._library.HighsModelStatus
        solver.run()
        statuses = {
            model_status.kOptimal: Status.SOLVED,
            model_status.kUnbounded: Status.UNBOUNDED,
            model_status.kUnboundedOrInfeasible: Status.UNBOUNDED,
            model_status.kIterationLimit: Status.MAX_STEPS,
        }
        status = statuses.get(solver.getModelStatus(), Status.STALLED)
        solution = solver.getSolution()
        x, duals = np.array(solution.col_value), np.array(solution.row_dual)
        m, k = len(view.W.T), len(view.W)
        if not len(x):
            x, duals = np.zeros(m + 1), np.zeros(k)
        if status is Status.SOLVED and self._distance and x[m] < 0:
            status = Status.STALLED  # infeasible: −d is the least violation
        return SolverResult(
            status, solver.getInfo().simplex_iteration_count, x[:m] * unit, duals[:k]
        )


def solve(
    problem: ForceProblem,
    *,
    facets: int = 8,
    cones: Cones = "inner",
    objective: Objective = "distance",
    max_steps: int = 10_000,
) -> Solution:
    """Maximise the smallest distance to all limits with facetted cones by HiGHS.

    Args:
        problem: what to solve; its alpha has no part in this objective.
        facets: of a cone with two tangents, even, 4 or more (``_pyramids``).
        cones: "inner" for pyramids inscribed in the true cones, "outer" for circumscribed ones,
            whose answers leave the true cones.
        objective: "distance" as in [2], "normal" for the least largest normal force.
        max_steps: the most pivots.

    Returns:
        The forces; ``newton_steps`` counts the pivots, ``nu`` belongs to −d or the largest
        normal force. Where the linear program has no answer the status is INFEASIBLE if the
        true cones have none either, with its proof, else STALLED: the facets are too few.
        UNBOUNDED where nothing limits the grip, so that d grows with it.

    Raises:
        InvalidInputError: an option out of range.
        MissingExtraError: HiGHS is not installed.
    """
    return Prepared(
        problem, facets=facets, cones=cones, objective=objective, max_steps=max_steps
    ).solve(problem)


def _highs() -> Any:
    """Import HiGHS, which comes without types."""
    try:
        import highspy  # pyright: ignore[reportMissingImports, reportMissingTypeStubs]
    except ImportError:
        raise MissingExtraError("the linear program", "highspy", "baselines") from None
    return highspy


def _silent_highs(library: Any) -> Any:
    """Return a HiGHS that never prints; its constructor prints before options can be set."""

    class SilentHighs(library.Highs):
        def enableCallbacks(self) -> None:
            self.silent()
            super().enableCallbacks()  # pyright: ignore[reportUnknownMemberType]

    return SilentHighs()
