"""The compiled core of graspforce; see graspforce._engine."""

from collections.abc import Sequence
from typing import Annotated

import numpy
from numpy.typing import NDArray


def has_avx2() -> bool:
    """Whether this processor runs the module built for AVX2 and FMA."""

class Outcome:
    @property
    def status(self) -> int: ...

    @property
    def newton_steps(self) -> int: ...

    @property
    def decrement(self) -> float: ...

    @property
    def violation(self) -> float: ...

    @property
    def c(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...

    @property
    def nu(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...

    @property
    def y(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)] | None: ...

    @property
    def z(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)] | None: ...

    @property
    def packed(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...

class Solver:
    def __init__(self, wrench_rows: int, dims: Sequence[int], joints: int, inequalities: int, ceilings: bool, floors: bool) -> None: ...

    def solve(self, packed: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], tol: float, max_steps: int, start: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)] | None) -> Outcome: ...

class Servo:
    def __init__(self, wrench_rows: int, dims: Sequence[int], joints: int, inequalities: int, ceilings: bool, floors: bool, packed: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], tol: float, max_steps: int) -> None: ...

    def step(self, f: object | None, W: object | None, J: object | None, tau_lo: object | None, tau_hi: object | None, tau_bias: object | None, c_max: object | None, c_min: object | None, engagement: object | None, A: object | None, b: object | None, alpha: object | None) -> Outcome | None: ...

    def step_problem(self, packed: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> Outcome: ...

    def reset(self) -> None: ...

    @property
    def packed(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...
