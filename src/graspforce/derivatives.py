"""Exact derivatives of an optimum with respect to everything in its problem.

At an optimum ∇Phi(c) = W.T nu and W c = f. By the implicit function theorem a change of the problem
by a parameter p moves it by the solution of the KKT system there, factored once
(``cpp/include/graspforce/factor.hpp``):

    H dc + W.T ν = −∂(∇Phi − W.T nu)/∂p,    W dc = ∂(f − W c)/∂p.

This module writes the right-hand sides down for the fields; all linear limits are rows A c ≤ b of
one kind (:func:`graspforce.problem.all_limits`), whose change is written down once. The matrix is
symmetric, so the adjoint solves the same system for the gradient of a number L by c; that way
round, which learning goes millions of times, is the core's
(``cpp/include/graspforce/adjoint.hpp``).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce import equations
from graspforce._engine import native
from graspforce._engine.layout import FIELDS
from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_array, require_instance, require_keywords
from graspforce.batch import Batch, BatchProblems, available_cores
from graspforce.equations import by_contact, stacked
from graspforce.problem import SQUEEZE, all_limits, preload, with_bands, without_pulls
from graspforce.solution import Solution

# Rows whose derivatives are computed together; bounds the memory for their limits.
_ROWS_AT_ONCE = 2048

_SIGNS = np.array([1.0, -1.0, -1.0, -1.0])  # of D in g = Σ ± D_i y_i², Eq. (11)

# Quantities that have derivatives, by the axis of a row.
QUANTITIES = {
    "c": ("m",), "internal_forces": ("r",), "tau": ("n_joints",), "phi": (),
    "friction_margins": ("n",), "torque_margins": ("n_joints",),
}  # fmt: skip


class Sensitivity:
    """Derivatives of one answer, or of every row of a batch; made by :func:`sensitivity`.

    Quantities that are differentiated: ``c``, ``internal_forces``, ``tau``, ``phi``,
    ``friction_margins``, ``torque_margins``. Parameters: the fields of a
    :class:`graspforce.ForceProblem`, and ``mu`` and ``gamma``, of which frictionless contacts have
    none. Where a row is not SOLVED its derivatives are zero.

    Where W has dependent rows, the derivatives by f and W are those for changes that leave f in the
    range of W.

    Attributes:
        solved: which rows have derivatives, shape (B,), or a truth value for a single answer.
    """

    def __init__(
        self,
        problems: BatchProblems,
        forces: Array,
        nu: Array,
        solved: NDArray[np.bool_],
        single: bool = False,
    ) -> None:
        self._nu, self._solved, self._single = nu, solved, single
        self._layout = layout = problems.layout
        # The formulas are those of ordinary cones.
        self._pulls = _Pulls(problems, forces, solved) if layout.pulls else None
        self._problems, self._forces = (
            (problems, forces)
            if self._pulls is None
            else (self._pulls.problems, self._pulls.forces)
        )

    @property
    def solved(self) -> Any:
        """Which rows have derivatives."""
        return bool(self._solved[0]) if self._single else self._solved

    # ---- the three forms ----------------------------------------------------------------------

    def jvp(self, *, of: tuple[str, ...] = ("c", "tau"), **changes: ArrayLike) -> tuple[Any, ...]:
        """Return how the answer changes, to first order, when the problem does.

        Args:
            of: the quantities wanted.
            changes: dp for each field p that changes, of its shape, or of a row's for all rows.

        Returns:
            The change of each quantity: by default dc, shape (B, m), and dtau, (B, n_joints).

        Raises:
            InvalidInputError: an unknown quantity or field, a wrong shape.
        """
        require_keywords(of, QUANTITIES, "sensitivity")
        tangents = {name: self._rows(changes[name], name) for name in self._names(changes)}
        moved = None
        if self._pulls is not None:
            tangents, moved = self._pulls.push_forward(tangents, self._solved)
        parts = [
            self._part(part).push_forward({n: v[part] for n, v in tangents.items()}, of)
            for part in self._parts()
        ]
        found = {name: np.concatenate(each) for name, *each in zip(of, *parts, strict=True)}
        if moved is not None and "c" in found:
            found["c"] = found["c"] - moved
        return tuple(self._out(found[name]) for name in of)

    def vjp(
        self, *, wrt: tuple[str, ...] | None = None, **gradients: ArrayLike
    ) -> dict[str, Array]:
        """Return the gradients of a number L by the problem's fields, from those by the answer.

        Args:
            wrt: the fields wanted; default all that the problem has.
            gradients: dL/dq for each quantity q that L depends on, of its shape: ``c=…``,
                ``tau=…``, ``phi=…``, ``friction_margins=…``, ``torque_margins=…``.

        Returns:
            The gradient by each field, a row for each problem.

        Raises:
            InvalidInputError: an unknown quantity or field, a wrong shape.
        """
        require_keywords(gradients, QUANTITIES, "sensitivity.vjp")
        names = self._names(wrt) if wrt is not None else self._names(None)
        sizes = self._layout.sizes
        given = {
            name: np.ascontiguousarray(
                self._of_shape(value, name, tuple(sizes[axis] for axis in QUANTITIES[name]))
            )
            for name, value in gradients.items()
        }
        problems = self._problems
        layout, inner = problems.layout, names
        if self._pulls is not None:
            inner = self._pulls.needed(names)
        out = {name: np.empty((len(problems), *layout.slots[name].shape)) for name in inner}
        native.module.pull_back_batch(
            layout, len(problems), _in_place(problems), np.ascontiguousarray(self._forces),
            np.ascontiguousarray(self._nu), self._solved.copy(),
            [given.get(name) for name in QUANTITIES], [out.get(name) for name in layout.slots],
            available_cores(),
        )  # fmt: skip
        if self._pulls is not None:
            out = self._pulls.pull_back(out, given.get("c"), self._solved)
        return {name: self._out(out[name]) for name in names}

    def jacobian(self, wrt: str, of: str = "c") -> Array:
        """Return the derivative of one quantity by one field, shape ``(B, *quantity, *field)``.

        Raises:
            InvalidInputError: an unknown quantity or field.
        """
        require_keywords((of,), QUANTITIES, "sensitivity")
        (name,) = self._names((wrt,))
        shape = tuple(self._layout.sizes[axis] for axis in QUANTITIES[of])
        B = len(self._solved)
        columns: list[Array] = []
        for entry in np.ndindex(shape):
            unit = np.zeros((B, *shape))
            unit[(slice(None), *entry)] = 1
            one = unit[0] if self._single else unit
            columns.append(np.asarray(self.vjp(wrt=(name,), **{of: one})[name]))
        field = self._layout.slots[name].shape
        axis = 0 if self._single else 1
        lead = () if self._single else (B,)
        return (
            np.stack(columns, axis=axis).reshape(lead + shape + field)
            if columns
            else np.zeros(lead + shape + field)
        )

    # ---- rows ---------------------------------------------------------------------------------

    def _parts(self) -> list[slice]:
        starts = range(0, max(1, len(self._solved)), _ROWS_AT_ONCE)
        return [slice(first, first + _ROWS_AT_ONCE) for first in starts]

    def _part(self, part: slice) -> _Rows:
        return _Rows(self._problems[part], self._forces[part], self._nu[part], self._solved[part])

    def _names(self, given: Any) -> tuple[str, ...]:
        valid = [
            name
            for name, slot in self._layout.slots.items()
            if slot.stop > slot.start and (name != "engagement" or self._layout.ceilings)
        ]
        if given is None:
            return tuple(valid)
        require_keywords(given, valid, "this problem's sensitivity")
        return tuple(given)

    def _rows(self, value: ArrayLike, name: str) -> Array:
        return self._of_shape(value, name, self._layout.slots[name].shape)

    def _of_shape(self, value: ArrayLike, name: str, shape: tuple[int, ...]) -> Array:
        """Return an array with the leading axis; a single answer's has none."""
        B = len(self._solved)
        full = (B, *shape)
        if self._single or np.ndim(cast("Any", value)) == len(shape):
            return np.broadcast_to(as_array(value, name, shape), full)
        return as_array(value, name, full)

    def _out(self, value: Array) -> Any:
        return value[0] if self._single else value


class _Pulls:
    """A batch whose contacts pull, as one of ordinary cones: in c + p along every normal.

    p is engagement·pull where a contact is in the grasp. With it ``W c' = f + W p`` and so on, see
    :func:`graspforce.problem.without_pulls`.

    Attributes:
        problems: the ordinary ones.
        forces: theirs, c + p, and the internal ones, shape (B, m + r).
    """

    def __init__(self, problems: BatchProblems, forces: Array, solved: NDArray[np.bool_]) -> None:
        layout, self._data = problems.layout, _harmless(problems.data(), solved)
        self._normals = np.cumsum((0, *layout.dims[:-1]))
        self._there = problems.active
        shift = preload(layout, self._data)
        self._shift = shift[:, : sum(layout.dims)]  # p
        inner, fields = without_pulls(layout, self._data)
        self.problems = BatchProblems(inner, fields, len(problems))
        self.forces = forces + shift

    def needed(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """The fields of the ordinary problem by which gradients are needed for those by `names`."""
        by_pull = {"pull", "engagement"} & set(names)
        follow = set(names) - {"pull"}
        follow |= {"f"} if by_pull or "W" in names else set()
        follow |= {"tau_bias"} if by_pull or "J" in names else set()
        follow |= {"b"} if by_pull or "A" in names else set()
        follow |= {"c_max", "c_min", "c_last"} if by_pull else set()
        slots = self.problems.layout.slots
        return tuple(name for name in slots if name in follow and 0 not in slots[name].shape)

    def pull_back(
        self, inner: dict[str, Array], to_c: Array | None, solved: NDArray[np.bool_]
    ) -> dict[str, Array]:
        """Return the gradients by the fields from those by the ordinary problem's."""
        out, p, data = dict(inner), self._shift, self._data
        zero = {name: np.zeros(data[name].shape) for name in ("f", "tau_bias", "b", "c_last")}
        f, tau_bias, b, c_last = (inner.get(name, zero[name]) for name in zero)
        if "W" in out:
            out["W"] = out["W"] + f[..., None] * p[:, None]
        if "J" in out:
            out["J"] = out["J"] - p[..., None] * tau_bias[:, None]
        if "A" in out:
            out["A"] = out["A"] + b[..., None] * p[:, None]
        by_p = _times(np.swapaxes(data["W"], 1, 2), f) - _times(data["J"], tau_bias)
        by_p = by_p + _times(np.swapaxes(data["A"], 1, 2), b)
        if c_last.size:
            by_p = by_p + c_last
        if to_c is not None:
            by_p = by_p - to_c
        by_p = np.where(self._there & solved[:, None], by_p[:, self._normals], 0.0)
        out["pull"] = data["engagement"] * by_p
        for name in ("c_max", "c_min"):
            out["pull"] = out["pull"] + inner.get(name, 0.0)
        if "engagement" in out:
            out["engagement"] = out["engagement"] + data["pull"] * by_p
        return {name: np.where(_as(solved, value), value, 0.0) for name, value in out.items()}

    def push_forward(
        self, change: dict[str, Array], solved: NDArray[np.bool_]
    ) -> tuple[dict[str, Array], Array]:
        """Return what changes of fields are to the ordinary problem, and the change of p."""
        data, p = self._data, self._shift
        d = {name: change.get(name, np.zeros(value.shape)) for name, value in data.items()}
        by_contact = d["engagement"] * data["pull"] + data["engagement"] * d["pull"]
        dp = np.zeros(p.shape)
        dp[:, self._normals] = np.where(self._there & solved[:, None], by_contact, 0.0)
        moved = {name: value for name, value in d.items() if name != "pull"}
        moved["f"] = d["f"] + _times(d["W"], p) + _times(data["W"], dp)
        arms = [np.swapaxes(each, 1, 2) for each in (d["J"], data["J"])]
        moved["tau_bias"] = d["tau_bias"] - _times(arms[0], p) - _times(arms[1], dp)
        moved["b"] = d["b"] + _times(d["A"], p) + _times(data["A"], dp)
        for name in ("c_max", "c_min"):
            if d[name].size:
                moved[name] = d[name] + d["pull"]
        if d["c_last"].size:
            moved["c_last"] = d["c_last"] + dp
        slots = self.problems.layout.slots
        return {n: value for n, value in moved.items() if 0 not in slots[n].shape}, dp


class _Rows:
    """G rows with all that the formulas share."""

    def __init__(
        self, problems: BatchProblems, forces: Array, nu: Array, solved: NDArray[np.bool_]
    ) -> None:
        self.problems, self.forces, self.nu, self.solved = problems, forces, nu, solved
        self.layout = problems.layout
        self.c = forces[:, : sum(self.layout.dims)]
        self.data = _harmless(self.problems.data(), self.solved)
        if not self.solved.all():
            self.nu = np.where(self.solved[:, None], self.nu, 0.0)
        given, self.data = self.data, dict(with_bands(self.layout, self.data))
        # Where a set squeeze moves a bound away from the other, that other is what it follows.
        self.raised = self.data["c_max"] > given["c_max"]
        self.lowered = self.data["c_min"] < given["c_min"]
        self.A, self.b = all_limits(self.layout, self.data)
        slack = equations.slacks(self.forces, self.A, self.b)
        counted = np.ones(slack.shape, dtype=bool)
        for row in np.flatnonzero(~self.problems.active.all(axis=1)).tolist():
            counted[row] = self.problems[row].counted_limits()
        counted &= self.solved[:, None]
        self.inverse = np.where(counted, 1.0, 0.0) / np.where(counted, slack, 1.0)
        self.alpha = self.data["alpha"][:, None]
        self.D = (
            equations.Cones.of(self.layout.dims, self.data["mu"], self.data["gamma"]).scaling ** 2
            * _SIGNS
        )
        self.in_grasp = self.problems.active & self.solved[:, None]
        self.y = by_contact(self.c, self.layout.dims)
        g = (self.D * self.y**2).sum(axis=-1)
        self.g = np.where(self.in_grasp, g, 1.0)
        self.over_g = np.where(self.in_grasp, 1.0, 0.0) / self.g
        weights = self.layout.cone_weights
        self.cone_weight = self.data["cone_weight"] if weights else np.ones(g.shape)
        self.exact = np.ones(self.nu.shape)
        if self.layout.soft_wrench:
            self.exact = np.where(self.data["f_soft"] > 0, 0.0, 1.0)

    @property
    def _has_mu(self) -> Array:
        """1 for contacts with coefficients, 0 for frictionless ones, shape (n,)."""
        return (np.array(self.layout.dims) > 1).astype(float)

    def solve_kkt(self, top: Array, bottom: Array) -> tuple[Array, Array]:
        """Solve H x + W.T y = top, W x − F² y = bottom; zeros in rows without derivatives."""
        forces = top.shape[1]
        x = np.concatenate((top, bottom), axis=1)
        native.module.kkt_solve_batch(
            self.layout, len(x), _in_place(self.problems), np.ascontiguousarray(self.forces),
            self.solved.copy(), x, available_cores(),
        )  # fmt: skip
        return x[:, :forces], x[:, forces:]

    # ---- what follows from the answer and the data --------------------------------------------

    def _margin_parts(self) -> tuple[Array, Array]:
        """The contacts' tangential forces, scaled, and their lengths."""
        weight = -self.D[..., 1:]  # 1, 1, (mu/gamma)²
        radius = np.sqrt((weight * self.y[..., 1:] ** 2).sum(axis=-1))
        safe = np.where(radius > 0, radius, 1.0)
        return weight * self.y[..., 1:] / safe[..., None], safe

    def _upper_side(self) -> NDArray[np.bool_]:
        """Whether the upper limit is each joint torque's nearer one."""
        arms = np.concatenate((self.data["J"], self.data["internal"]), axis=1)
        tau = equations.joint_torques(self.forces, arms, self.data["tau_bias"])
        return self.data["tau_hi"] - tau < tau - self.data["tau_lo"]

    def push_forward(self, change: Mapping[str, Array], of: tuple[str, ...]) -> list[Array]:
        """Return the changes of the quantities that changes of fields make."""
        d = {name: change.get(name, np.zeros(self.data[name].shape)) for name in FIELDS}
        dA, db = self._limit_changes(d)
        dD = self._cone_changes(d)
        i = self.inverse
        rows = np.swapaxes(self.A, 1, 2)
        slack_change = db - _times(dA, self.forces)
        # ∂∇Phi, at fixed c
        top = d["alpha"][:, None] * _times(rows, i)
        top += self.alpha * (_times(np.swapaxes(dA, 1, 2), i) - _times(rows, i**2 * slack_change))
        dg = (dD * self.y**2).sum(axis=-1)
        bend = -2 * self.over_g[..., None] * self.y
        of_cones = self.cone_weight[..., None] * (dD - self.D * (dg * self.over_g)[..., None])
        if self.layout.cone_weights:
            of_cones = of_cones + d["cone_weight"][..., None] * self.D
        m = self.c.shape[1]
        top[:, :m] += stacked(bend * of_cones, self.layout.dims)
        top[:, :m] -= _times(np.swapaxes(d["W"], 1, 2), self.nu)
        bottom = d["f"] - _times(d["W"], self.c)
        if self.layout.soft_wrench:
            bottom = bottom - 2 * self.data["f_soft"] * d["f_soft"] * self.nu
        moved, _ = self.solve_kkt(-top, bottom)
        dc, dv = moved[:, :m], moved[:, m:]
        data, zero = self.data, ~self.solved
        dtau = d["tau_bias"]
        for name, v, change_of_v in (("J", self.c, dc), ("internal", self.forces[:, m:], dv)):
            dtau = dtau + _times(np.swapaxes(data[name], 1, 2), change_of_v)
            dtau = dtau + _times(np.swapaxes(d[name], 1, 2), v)
        found: list[Array] = []
        for name in of:
            if name == "c":
                value = dc
            elif name == "internal_forces":
                value = dv
            elif name == "tau":
                value = dtau
            elif name == "phi":
                # ∇Phi·dc = nu·(W dc), of which what softness adds takes back the soft rows
                value = (self.exact * self.nu * _times(data["W"], dc)).sum(axis=1)
                value = value + self._phi_change(d, dD, slack_change)
            elif name == "friction_margins":
                unit, radius = self._margin_parts()
                dy = by_contact(dc, self.layout.dims)
                stretch = (-dD[..., 1:] * self.y[..., 1:] ** 2).sum(axis=-1) / (2 * radius)
                value = self.data["mu"] * dy[..., 0] + self._has_mu * d["mu"] * self.y[..., 0]
                value = value - (unit * dy[..., 1:]).sum(axis=-1) - stretch
                value = np.where(self.in_grasp, value, 0.0)
            else:
                up = self._upper_side()
                value = np.where(up, d["tau_hi"] - dtau, dtau - d["tau_lo"])
            found.append(np.where(_as(zero, value), 0.0, value))
        return found

    def _phi_change(self, d: Mapping[str, Array], dD: Array, slack_change: Array) -> Array:
        """The change of Phi at fixed forces."""
        i = self.inverse
        logs = -np.log(np.where(i > 0, i, 1.0)).sum(axis=1)  # Σ ln r
        value = -d["alpha"] * logs - (self.alpha * i * slack_change).sum(axis=1)
        dg = (dD * self.y**2).sum(axis=-1)
        value = value - (self.cone_weight * self.over_g * dg).sum(axis=1)
        if self.layout.cone_weights:
            value = value - (d["cone_weight"] * np.log(self.g)).sum(axis=1)
        if self.layout.soft_wrench:
            soft = (1 - self.exact) * self.nu
            value = value + (soft * (d["f"] - _times(d["W"], self.c))).sum(axis=1)
            value = value - (self.data["f_soft"] * d["f_soft"] * soft**2).sum(axis=1)
        return value

    def _limit_changes(self, d: Mapping[str, Array]) -> tuple[Array, Array]:
        """Changes of all_limits: linear in every field but engagement times its partners."""
        data = self.data
        zero = {name: np.zeros(value.shape) for name, value in data.items()}
        fields = zero | {
            name: d[name]
            for name in (
                "J",
                "internal",
                "tau_lo",
                "tau_hi",
                "tau_bias",
                "c_last",
                "dc_max",
                "A",
                "b",
            )
        }
        bounds = {name: d[name] for name in ("c_max", "c_min")}
        if self.layout.ceilings and self.layout.floors:
            bounds["c_max"] = np.where(self.raised, (1 + SQUEEZE) * d["c_min"], d["c_max"])
            bounds["c_min"] = np.where(self.lowered, (1 - SQUEEZE) * d["c_max"], d["c_min"])
        A, b = all_limits(self.layout, fields | {"engagement": data["engagement"]} | bounds)
        # the rows of normal and rate limits do not depend on any field
        constant, _ = all_limits(self.layout, zero)
        _, of_engagement = all_limits(
            self.layout,
            zero | {name: data[name] for name in ("c_max", "c_min")}
            | {"engagement": d["engagement"]},
        )  # fmt: skip
        return A - constant, b + of_engagement

    def _cone_changes(self, d: Mapping[str, Array]) -> Array:
        """Changes of ±(mu², 1, 1, (mu/gamma)²); frictionless contacts have no coefficients."""
        mu, gamma = self.data["mu"], self.data["gamma"]
        has = self._has_mu
        dD = np.zeros((*mu.shape, 4))
        dD[..., 0] = 2 * mu * d["mu"] * has
        dD[..., 3] = -(2 * mu / gamma**2 * d["mu"] - 2 * mu**2 / gamma**3 * d["gamma"]) * has
        return dD


def _in_place(problems: BatchProblems) -> list[Array]:
    """Return the fields as the core reads them, copied only where it cannot."""
    return [
        value if problems.read_in_place(name) else np.ascontiguousarray(value, dtype=np.float64)
        for name, value in problems.fields.items()
    ]


def _harmless(data: dict[str, Array], solved: NDArray[np.bool_]) -> dict[str, Array]:
    """Return fields without the numbers of rows that are not solved, which may be anything."""
    if solved.all():
        return data
    return {name: np.where(_as(solved, value), value, 1.0) for name, value in data.items()}


def _times(A: Array, x: Array) -> Array:
    return (A @ x[..., None])[..., 0]


def _as(rows: NDArray[np.bool_], value: Array) -> NDArray[np.bool_]:
    """Return a truth value a row, to broadcast against an array of rows."""
    return rows.reshape(-1, *[1] * (value.ndim - 1))


def sensitivity(answer: Solution | Batch) -> Sensitivity:
    """Return the derivatives of an answer with respect to everything in its problem.

    They are as exact as the answer: solve with ``Settings(tol=1e-14)`` where it matters.

    Args:
        answer: what :func:`graspforce.solve` or :func:`graspforce.solve_batch` returned.

    Raises:
        InvalidInputError: something else.
    """
    require_instance(answer, "answer", Solution | Batch, "a Solution or a Batch")
    if isinstance(answer, Batch):
        return Sensitivity(answer.problems, answer.found.forces, answer.nu, answer.solved)
    problem = answer.problem
    fields = {name: view[None] for name, view in problem.layout.views(problem.packed).items()}
    problems = BatchProblems(problem.layout, fields, 1)
    solved = np.array([answer.status is Status.SOLVED])
    forces = np.append(answer.c, answer.internal_forces)[None]
    return Sensitivity(problems, forces, answer.nu[None], solved, single=True)
