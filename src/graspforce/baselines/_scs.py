"""SCS, a first-order method: many cheap iterations, warm-started."""

from __future__ import annotations

from typing import Any

import numpy as np
import scs  # pyright: ignore[reportMissingTypeStubs]

from graspforce._engine.outcome import Status
from graspforce.baselines._conic import ConicResult, Pattern, Program, diagonal

_STATUS = {"solved": Status.SOLVED, "unbounded": Status.UNBOUNDED}


class Workspace:
    """See :class:`graspforce.baselines._conic.Workspace`.

    A new A needs a new factorisation, so only the answer before is kept, as the next start.
    """

    def __init__(self, program: Program, pattern: Pattern, tol: float, max_steps: int) -> None:
        shape = program.shape
        self._cones = {"z": shape.zeros, "l": shape.nonnegative, "q": list(shape.second_order)}
        self._settings = {"eps_abs": tol, "eps_rel": tol, "max_iters": max_steps, "verbose": False}
        self._P = diagonal(program.P)
        self._pattern = pattern
        self._last: dict[str, Any] | None = None
        self.update(program)

    def update(self, program: Program) -> None:
        """Take the numbers of the next program."""
        library: Any = scs
        data = {"P": self._P, "A": self._pattern.sparse(program.A), "b": program.b,
                "c": program.q}  # fmt: skip
        self._solver = library.SCS(data, self._cones, **self._settings)

    def solve(self) -> ConicResult:
        """Solve the program."""
        last = self._last
        if last is None:
            result = self._solver.solve(warm_start=False)
        else:
            result = self._solver.solve(warm_start=True, x=last["x"], y=last["y"], s=last["s"])
        status_text, steps = result["info"]["status"], int(result["info"]["iter"])
        status = _STATUS.get(status_text, Status.STALLED)
        if "inaccurate" in status_text:
            status = Status.MAX_STEPS
        self._last = result if status is Status.SOLVED else None
        return ConicResult(status, steps, np.array(result["x"]), np.array(result["y"]))
