"""What follows from the data and the forces of many problems of one layout, as arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import accumulate

import numpy as np

from graspforce import equations
from graspforce._engine.layout import Layout
from graspforce._util.arrays import Array
from graspforce.equations import Barriers, Cones
from graspforce.problem import (
    all_limits,
    preload,
    soft_rows,
    with_bands,
    without_pulls,
    wrench_scales,
)
from graspforce.solution.missing import Lack

# Most problems computed together; bounds the memory for their limits.
ROWS_AT_ONCE = 1024


class ProblemRows:
    """The data and forces of G problems of one layout with all their contacts in the grasp.

    Args:
        layout: of the problems.
        forces: theirs, and the internal ones of the motors behind them, shape (G, m + r) [N, N·m].
        data: their fields by name, each with a leading axis of length G; see
            :meth:`graspforce._engine.layout.Layout.views`.
    """

    def __init__(self, layout: Layout, forces: Array, data: Mapping[str, Array]) -> None:
        self.layout, self.forces, self.data = layout, forces, data
        self.c = forces[:, : sum(layout.dims)]
        # What the ordinary cones and limits hold.
        self.loaded = forces + preload(layout, data) if layout.pulls else forces

    @property
    def cones(self) -> Cones:
        """The friction cones; made when asked for, as rows are kept and these are no views."""
        data, layout = self.data, self.layout
        weight = data["cone_weight"] if layout.cone_weights else None
        return Cones.of(layout.dims, data["mu"], data["gamma"], weight)

    @property
    def barriers(self) -> Barriers:
        """The terms of Eq. (16), of the forces ``loaded``."""
        layout, data = without_pulls(self.layout, self.data)
        A, b = all_limits(layout, with_bands(layout, data))
        soft = soft_rows(data) if layout.soft_wrench else ()
        return Barriers(self.cones, A, b, data["alpha"], *soft)

    @property
    def equalities(self) -> tuple[Array, Array]:
        """W, shape (G, k, m + r), and f of W loaded = f, with zeros for the soft rows."""
        _, data = without_pulls(self.layout, self.data)
        W, f = data["W"], data["f"]
        W = np.concatenate((W, np.zeros((*f.shape, self.layout.internals))), axis=-1)
        if not self.layout.soft_wrench:
            return W, f
        exact = data["f_soft"] == 0
        return W * exact[..., None], f * exact

    @property
    def lack(self) -> Lack:
        """What the forces lack of the wrenches, as messages say it."""
        W, f = self.data["W"], self.data["f"]
        exact = self.data["f_soft"] == 0 if self.layout.soft_wrench else np.ones(f.shape, bool)
        return Lack.of(W, f, exact, self.c, wrench_scales(self.layout.dims, W))

    def tau(self) -> Array:
        """Joint torques."""
        arms = self.data["J"]
        if self.layout.internals:
            arms = np.concatenate((arms, self.data["internal"]), axis=1)
        return equations.joint_torques(self.forces, arms, self.data["tau_bias"])

    def normal_forces(self) -> Array:
        """Normal forces."""
        return self.c[:, list(accumulate(self.layout.dims, initial=0))[:-1]]

    def torque_margins(self) -> Array:
        """Distances of the joint torques to their nearer limits."""
        return equations.torque_margins(self.tau(), self.data["tau_lo"], self.data["tau_hi"])

    def torque_residual(self) -> Array:
        """The smallest of them."""
        return self.torque_margins().min(axis=1, initial=np.inf)

    def wrench_error(self) -> Array:
        """Largest |W c − f|."""
        return equations.wrench_error(self.c, self.data["W"], self.data["f"])

    def missing(self) -> Array:
        """What c lacks of the wrenches, f − W c."""
        return self.data["f"] - (self.data["W"] @ self.c[..., None])[..., 0]

    def friction_margins(self) -> Array:
        """Margins to slipping."""
        return equations.friction_margins(self.loaded[:, : self.c.shape[1]], self.cones)

    def friction_residual(self) -> Array:
        """r_f of Eq. (22)."""
        return equations.friction_residual(self.loaded[:, : self.c.shape[1]], self.cones)

    def phi(self) -> Array:
        """The objective, Eq. (16)."""
        return equations.objective(self.loaded, self.barriers)


FROM_DATA: dict[str, Callable[[ProblemRows], Array]] = {
    "tau": ProblemRows.tau,
    "normal_forces": ProblemRows.normal_forces,
    "friction_margins": ProblemRows.friction_margins,
    "friction_residual": ProblemRows.friction_residual,
    "torque_margins": ProblemRows.torque_margins,
    "torque_residual": ProblemRows.torque_residual,
    "wrench_error": ProblemRows.wrench_error,
    "missing": ProblemRows.missing,
    "phi": ProblemRows.phi,
}
