"""Friction cones and limits as one block-diagonal linear matrix inequality P(x) ≻ 0.

Buss, Hashimoto and Moore [4] saw that a contact force is inside its friction cone exactly where
a symmetric matrix that is linear in it is positive definite. With s = mu n and the tangential
force t (the torsion of a soft finger measured in units of gamma/mu)::

    FPC: P = [n]      PCWF: P = ⎡s    t_x⎤      SFC: P = ⎡s        t_x⎤
                                ⎢  s  t_y⎥               ⎢  s      t_y⎥
                                ⎣t_x t_y s⎦              ⎢    s    t_o⎥
                                                         ⎣t_x t_y t_o s⎦

with det P = s^(d−1)·(s² − ‖t‖²) for d tangential components. Every linear limit, the joint torques
first of all, is a block of one entry, its slack b − a·c (Han, Trinkle and Li [12]).

The barrier of these methods is −ln det P. Its Hessian is the metric ⟨X, Y⟩ = tr(P⁻¹X P⁻¹Y) in
which Dikin's ellipsoid {‖X‖ < 1} around P stays inside the cone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.baselines._active import Active
from graspforce.contact import ContactModel


def friction_matrices(model: ContactModel) -> Array:
    """Return the matrices M of P = Σ_k M_k c_k, shape (dim, dim, dim): M[k] belongs to c_k."""
    d, scaling = model.dim, model.cone_scaling
    M = np.zeros((d, d, d))
    M[0] = scaling[0] * np.eye(d)
    for k in range(1, d):
        M[k, k - 1, d - 1] = M[k, d - 1, k - 1] = scaling[k]
    return M


@dataclass(frozen=True, slots=True)
class Blocks:
    """The g blocks of one size p of P(x) = F0 + Σ_j x_j F_j.

    Attributes:
        members: which contacts, or which rows of the limits, shape (g,).
        F0: shape (g, p, p).
        F: shape (q, g, p, p).
    """

    members: NDArray[np.int64]
    F0: Array
    F: Array


@dataclass(frozen=True, slots=True)
class Lmi:
    """P(x) ≻ 0, its blocks gathered by size.

    Attributes:
        blocks: the friction matrices of 1, 3 and 4 rows as far as there are any, and last the
            linear limits, as blocks of one row.
    """

    blocks: tuple[Blocks, ...]

    @classmethod
    def of(cls, view: Active) -> Lmi:
        """Return the cones and limits with x = c, shape (m,)."""
        m = len(view.W.T)
        parts: list[Blocks] = []
        dims = np.array([model.dim for model in view.models])
        for size in sorted(set(dims.tolist())):
            members = np.flatnonzero(dims == size)
            F = np.zeros((m, len(members), size, size))
            for position, i in enumerate(members):
                start = view.starts[i]
                F[start : start + size, position] = friction_matrices(view.models[i])
            parts.append(Blocks(members, np.zeros(F.shape[1:]), F))
        rows = np.arange(len(view.b))
        parts.append(Blocks(rows, view.b[:, None, None], -view.A.T[:, :, None, None]))
        return cls(tuple(parts))

    @property
    def rows(self) -> int:
        """The number of rows of P."""
        return sum(part.F0.shape[0] * part.F0.shape[1] for part in self.blocks)

    def substitute(self, x0: Array, B: Array) -> Lmi:
        """Return the inequality in y where x = x0 + B y."""
        return Lmi(
            tuple(
                Blocks(
                    part.members,
                    part.F0 + np.tensordot(x0, part.F, 1),
                    np.tensordot(B.T, part.F, 1),
                )
                for part in self.blocks
            )
        )

    def widen(self, of_contacts: Array, of_limits: Array) -> Lmi:
        """Return the inequality in (x, sigma): each block moved by sigma times its unit.

        A last row, 1 + sigma > 0, keeps sigma finite where nothing limits the grip.

        Args:
            of_contacts: the units of the contacts' blocks, shape (n,).
            of_limits: the units of the limits, shape (v,).
        """
        *cones, limits = self.blocks
        limits = Blocks(
            np.append(limits.members, -1),
            np.append(limits.F0, [[[1.0]]], axis=0),
            np.pad(limits.F, ((0, 0), (0, 1), (0, 0), (0, 0))),
        )
        units = [of_contacts[part.members] for part in cones] + [np.append(of_limits, 1.0)]
        parts: list[Blocks] = []
        for part, unit in zip((*cones, limits), units, strict=True):
            shift = unit[:, None, None] * np.eye(part.F0.shape[-1])
            parts.append(Blocks(part.members, part.F0, np.concatenate((part.F, shift[None]))))
        return Lmi(tuple(parts))

    def at(self, x: Array) -> Point:
        """Return P at x, decomposed."""
        return Point(self, x)

    def gram(self) -> Array:
        """Return tr(F_i F_j), shape (q, q): the metric of plain matrix entries."""
        total = np.zeros((len(self.blocks[0].F),) * 2)
        for part in self.blocks:
            total += np.einsum("iabc,jabc->ij", part.F, part.F)
        return total


class Point:
    """P(x) at one x by its eigenvalues, with the barrier −ln det P there."""

    __slots__ = ("_inverse", "_values", "_vectors", "lmi", "x")

    def __init__(self, lmi: Lmi, x: Array) -> None:
        self.lmi, self.x = lmi, x
        pairs = [np.linalg.eigh(part.F0 + np.tensordot(x, part.F, 1)) for part in lmi.blocks]
        self._values = [pair.eigenvalues for pair in pairs]
        self._vectors = [pair.eigenvectors for pair in pairs]
        self._inverse = [
            (V / e[:, None, :]) @ V.swapaxes(1, 2)
            for e, V in zip(self._values, self._vectors, strict=True)
        ]

    @property
    def inside(self) -> bool:
        """Whether P is positive definite."""
        return all(bool((values > 0).all()) for values in self._values)

    @property
    def barrier(self) -> float:
        """−ln det P."""
        return -sum(float(np.log(values).sum()) for values in self._values)

    @property
    def gradient(self) -> Array:
        """Of the barrier in x: −tr(P⁻¹ F_j), shape (q,)."""
        total = np.zeros(len(self.x))
        for inverse, part in zip(self._inverse, self.lmi.blocks, strict=True):
            total -= np.einsum("abc,jacb->j", inverse, part.F)
        return total

    @property
    def metric_root(self) -> Array:
        """M of the barrier's Hessian M.T M, shape (·, q): columns of P^(−1/2) F_j P^(−1/2)."""
        columns = [self._congruent(part.F, k) for k, part in enumerate(self.lmi.blocks)]
        return np.concatenate([each.reshape(len(each), -1) for each in columns], axis=1).T

    def spectrum(self, d: Array) -> Array:
        """Return the eigenvalues of P^(−1/2) D P^(−1/2) with D = Σ_j d_j F_j.

        P(x + t d) has the determinant det P(x) · Π (1 + t·eigenvalue).
        """
        values: list[Array] = []
        for k, part in enumerate(self.lmi.blocks):
            D = self._congruent(np.tensordot(d, part.F, 1), k)
            values.append(np.asarray(np.linalg.eigvalsh(D), dtype=np.float64).ravel())
        return np.concatenate(values)

    def _congruent(self, F: Array, k: int) -> Array:
        """P^(−1/2) F P^(−1/2) for the blocks of part k, in the axes of P's eigenvectors."""
        root = self._vectors[k] / np.sqrt(self._values[k])[:, None, :]
        return root.swapaxes(1, 2) @ F @ root

    def multipliers(self, d: Array) -> list[Array]:
        """Return Z = P⁻¹ − P⁻¹ D P⁻¹ of each part of the blocks, shapes (g, p, p).

        Where d is the Newton step of w·x − ln det P, tr(Z F_j) = w_j to rounding; and Z ≻ 0
        where ‖d‖ < 1 in the metric. So Z is dual feasible, and a certificate
        where its gap is positive.
        """
        return [
            inverse - inverse @ np.tensordot(d, part.F, 1) @ inverse
            for inverse, part in zip(self._inverse, self.lmi.blocks, strict=True)
        ]


def dikin_direction(point: Point, gradient: Array) -> Array:
    """Return the steepest descent in the metric of Dikin's ellipsoid, −metric⁻¹ gradient."""
    M = point.metric_root
    scale = 1 / np.linalg.norm(M, axis=0)
    # QR of the root: forming the metric would square its condition number.
    R = np.asarray(np.linalg.qr(M * scale)[1], dtype=np.float64)
    inner = np.asarray(np.linalg.solve(R.T, scale * gradient), dtype=np.float64)
    return np.asarray(-scale * np.linalg.solve(R, inner), dtype=np.float64)


def half_square_decrement(point: Point, gradient: Array) -> float:
    """Half the squared Newton decrement of a function with the barrier's Hessian.

    Such a function is standard self-concordant: below 1e-3 or so this bounds how far it is
    above its minimum, but for a third-order term.
    """
    if not len(gradient):
        return 0.0
    return max(0.0, -float(gradient @ dikin_direction(point, gradient))) / 2


def line_search(spectrum: Array, slope: float, weight: float) -> float:
    """Return the exact minimiser t > 0 of slope·t − weight·Σ ln(1 + t·spectrum).

    The function is convex with a pole where P turns singular, so its derivative has one root
    before it: Newton steps, and bisection where one leaves the bracket.

    Args:
        spectrum: of :meth:`Point.spectrum` for the direction.
        slope: of the linear objective along the direction.
        weight: of the barrier.
    """
    steepest = -float(spectrum.min())
    high = 1 / steepest if steepest > 0 else 1e12
    low, t = 0.0, min(1.0, high / 2)
    for _ in range(60):
        ratio = spectrum / (1 + t * spectrum)
        derivative = slope - weight * float(ratio.sum())
        if derivative < 0:
            low = t
        else:
            high = t
        curvature = weight * float(ratio @ ratio)
        if curvature == 0:  # the direction is zero, and every t the same
            break
        step = derivative / curvature
        if abs(step) <= 1e-12 * t:
            break
        t = t - step if low < t - step < high else (low + high) / 2
    return t
