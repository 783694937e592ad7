"""A conic program, and the solvers for it.

    minimise  ½ x.T diag(P) x + q·x   with A x + s = b, s in a product of cones

in this order: zeros (equations), nonnegative numbers, second-order cones ‖s_1…‖ ≤ s_0, and
exponential cones s_1 exp(s_0/s_1) ≤ s_2. The multipliers z satisfy P x + q + A.T z = 0 and lie in
the dual cones.

Each solver is a module of this package with a class ``Workspace`` that is set up with one program
and updated with the numbers of the next; ``Pattern`` says which entries of A it stores.
"""

from __future__ import annotations

import importlib
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.baselines._active import Active
from graspforce.baselines._stream import SolverResult, Stream
from graspforce.errors import InvalidInputError, MissingExtraError
from graspforce.problem import ForceProblem


class Shape(NamedTuple):
    """How many variables and which cones; only Clarabel takes exponential ones."""

    variables: int
    zeros: int
    nonnegative: int
    second_order: tuple[int, ...]
    exponential: int


@dataclass(frozen=True, slots=True)
class Program:
    """The numbers of a program.

    Attributes:
        shape: of it.
        P: diagonal of the quadratic term, shape (N,); the same in all programs of a workspace.
        q: shape (N,).
        A: shape (M, N).
        b: shape (M,).
    """

    shape: Shape
    P: Array
    q: Array
    A: Array
    b: Array


class Pattern:
    """The entries of A that a solver stores, column by column.

    Args:
        mask: shape (M, N), true where an entry may be nonzero.
    """

    def __init__(self, mask: NDArray[np.bool_]) -> None:
        columns, rows = np.nonzero(mask.T)
        self.mask = mask
        # Solvers take whole numbers of this width.
        self.indices = rows.astype(np.int32)
        self.pointers = np.append(0, np.count_nonzero(mask, axis=0).cumsum()).astype(np.int32)
        self._flat = rows * mask.shape[1] + columns

    def values(self, A: Array) -> Array:
        """Return the entries of a matrix, column by column."""
        return A.ravel()[self._flat]

    def contains(self, A: Array) -> bool:
        """Whether a matrix has no entry elsewhere."""
        return np.count_nonzero(A) == np.count_nonzero(self.values(A))

    def sparse(self, A: Array) -> Any:
        """Return a matrix as SciPy's array of compressed columns, zeros of the pattern included."""
        from scipy.sparse import csc_array  # pyright: ignore[reportMissingTypeStubs]

        return csc_array((self.values(A), self.indices, self.pointers), shape=A.shape)


def diagonal(P: Array) -> Any:
    """Return diag(P) as SciPy's array of compressed columns, without its zeros."""
    matrix = np.diag(P)
    return Pattern(matrix != 0).sparse(matrix)


class ConicResult(NamedTuple):
    """A solver's result: status as in ``SolverResult``, iterations, x and the multipliers z."""

    status: Status
    steps: int
    x: Array
    z: Array


class Workspace(Protocol):
    """A solver that was set up with a program.

    Args:
        program: the first one.
        pattern: the entries of its A that may change.
        tol: relative and absolute tolerance of feasibility and optimality.
        max_steps: the most iterations.
    """

    def __init__(self, program: Program, pattern: Pattern, tol: float, max_steps: int) -> None: ...

    def update(self, program: Program) -> None:
        """Take the numbers of the next program, of the same shape and pattern."""
        ...

    def solve(self) -> ConicResult:
        """Solve the program."""
        ...


# Each solver's package, and the extra that brings it.
SOLVERS: dict[str, str | None] = {
    "clarabel": "baselines", "qoco": "solvers", "scs": "solvers", "ecos": None, "moreau": None,
}  # fmt: skip


def load(solver: str) -> type[Workspace]:
    """Return a solver's ``Workspace``.

    Raises:
        InvalidInputError: an unknown name.
        MissingExtraError: it, or SciPy, is not installed.
    """
    if solver not in SOLVERS:
        raise InvalidInputError(f"solver: got {solver!r}, expected one of {', '.join(SOLVERS)}")
    for package, extra in (("scipy", "baselines"), (solver, SOLVERS[solver])):
        try:
            importlib.import_module("scipy.sparse" if package == "scipy" else package)
        except ImportError:
            raise MissingExtraError("the conic program", package, extra) from None
    workspace: type[Workspace] = importlib.import_module(f"{__package__}._{solver}").Workspace
    return workspace


class Conic(Stream):
    """A method that is a conic program in c and further variables.

    Args:
        problem: the first problem of the stream.
        solver: its name.
        tol: the solver's tolerance.
        max_steps: the most iterations.
    """

    # The power of the unit of force in the objective: multipliers are in its derivative's unit.
    degree: int = 0

    def __init__(self, problem: ForceProblem, solver: str, tol: float, max_steps: int) -> None:
        self._workspace_type, self._tol, self._max_steps = load(solver), tol, max_steps
        self._shape: Shape | None = None
        super().__init__(problem)

    @abstractmethod
    def program(self, view: Active, unit: float) -> Program:
        """Return the program: c first among the variables, W c = f first among the rows.

        Args:
            view: the problem.
            unit: of force in the program [N].
        """

    def _load(self, view: Active, unit: float) -> None:
        program = self.program(view, unit)
        mask = program.A != 0
        if self._shape == program.shape and self._pattern.contains(program.A):
            self._workspace.update(program)
            return
        if self._shape == program.shape:
            mask |= self._pattern.mask
        pattern = Pattern(mask)
        self._workspace = self._workspace_type(program, pattern, self._tol, self._max_steps)
        self._shape, self._pattern = program.shape, pattern

    def _run(self, view: Active, unit: float) -> SolverResult:
        result = self._workspace.solve()
        k, m = view.W.shape
        # Row for row, W c = f has the multiplier −nu.
        nu = -result.z[:k] * unit ** (self.degree - 1)
        return SolverResult(result.status, result.steps, result.x[:m] * unit, nu)
