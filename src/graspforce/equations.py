"""The paper's equations and the residuals by which answers are judged: functions of arrays alone.

Each equation has one function here, and every other part of the package calls it: the problem
makes its limits by Eq. (15) and (20), the NumPy solver steps by Eq. (18), (19) and (21), a
:class:`graspforce.Solution` is judged by Eq. (9), (16) and (22). :mod:`graspforce.reference` gives
them once more with contact models and problems as arguments, beside a table of their numbers.

Axes: n contacts, m force components, v linear limits, k rows of W. Any argument may have leading
axes in front of those named, a batch of problems of one shape; they broadcast. Where a function is
for one problem only, because the rank of W decides the shape of what it returns, it says so.
Nothing is written in place.

The contacts' forces y_1 … y_n of Eq. (8) are kept as an array (n, 4), padded with zeros, and a
contact model is its scaling (:func:`graspforce.contact.cone_scalings`): with s = scaling·y every
cone is the same one, s_0 > ‖(s_1, s_2, s_3)‖.

The barriers accept complex arguments, so that complex-step differentiation can check the
derivatives to the last digit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce._util.arrays import Array
from graspforce.contact import ContactModel, cone_scalings

# A slack of this part of the numbers that it is the difference of is nothing but their rounding.
ROUNDING = 2e-15
# A direction of the wrench that W, in rows of unit length, reaches by less than this is out of
# reach to rounding; fainter ones than 1e-10 may be counted either way.
RANK_TOLERANCE = 1e-13
# Singular values of W and J below this share of the largest are of contact points that differ by
# rounding: a row of it alone must not be scaled up.
UNDETERMINED = 1e-9
# That none are, a Gram matrix says whose trace times the norm of its inverse is below this; and the
# share of the trace that keeps a singular one from having none.
_SURELY_REGULAR, _RIDGE = 1e12, 1e-13
# Forces this many times as large as what the limits are made for mean that nothing holds them.
RUNAWAY = 1e6

# Products of a few numbers above this, or below its inverse, leave double precision.
LARGEST = 1e60

_WIDTH = 4  # components of the widest contact
_METRIC = np.array([1.0, -1.0, -1.0, -1.0])  # of the Lorentz cone: s·(metric s) > 0


def _times(A: Array, x: Array) -> Array:
    """Return A x for matrices (…, i, j) and vectors (…, j)."""
    return (A @ x[..., None])[..., 0]


def _diagonal(x: Array) -> Array:
    """Return diag(x), shape (…, i, i), of vectors (…, i)."""
    return x[..., None] * np.eye(x.shape[-1])


# ---- III-A  polyhedral barrier ----------------------------------------------------------------


def slacks(x: Array, A: Array, b: Array) -> Array:
    """Slacks r = b − A x of Eq. (5): positive inside the polyhedron Q.

    Args:
        x: the variable, shape (m,); contact forces, as a rule [N, N·m].
        A: matrix of A x ≤ b, shape (v, m).
        b: right-hand sides, shape (v,), in each row's own unit.

    Returns:
        r, shape (v,), in the units of b.
    """
    return b - _times(A, x)


def phi_lin(x: Array, A: Array, b: Array) -> Any:
    """Barrier of the polyhedron, Eq. (6): −Σ ln r_i, with natural logarithms.

    Args:
        x: a point strictly inside, shape (m,).
        A: matrix of A x ≤ b, shape (v, m).
        b: right-hand sides, shape (v,).

    Returns:
        The barrier's value, a number [-]; 0 where there are no rows.
    """
    return -np.log(slacks(x, A, b)).sum(axis=-1)


def grad_phi_lin(x: Array, A: Array, b: Array) -> Array:
    """Gradient of Eq. (6), the first line of Eq. (7): A.T d with d_i = 1/r_i.

    Args:
        x: a point strictly inside, shape (m,).
        A: matrix of A x ≤ b, shape (v, m).
        b: right-hand sides, shape (v,).

    Returns:
        Shape (m,) [1/N, 1/(N·m)].
    """
    return _times(np.swapaxes(A, -1, -2), 1 / slacks(x, A, b))


def hess_phi_lin(x: Array, A: Array, b: Array) -> Array:
    """Hessian of Eq. (6), the second line of Eq. (7): A.T diag(d)² A with d_i = 1/r_i.

    Args:
        x: a point strictly inside, shape (m,).
        A: matrix of A x ≤ b, shape (v, m).
        b: right-hand sides, shape (v,).

    Returns:
        Shape (m, m) [1/N², …].
    """
    d = 1 / slacks(x, A, b)
    return np.swapaxes(A, -1, -2) @ (d[..., None] ** 2 * A)


# ---- III-B  second-order cone barrier ---------------------------------------------------------


class Cones(NamedTuple):
    """The friction cones of n contacts.

    Attributes:
        dims: components of each contact, n of 1, 3 or 4; the same for a whole batch.
        scaling: of normal force, x, y and torsion, shape (n, 4); see
            :func:`graspforce.contact.cone_scalings`.
        weight: of each cone's barrier, shape (n,) [-]; None where all are 1.
    """

    dims: tuple[int, ...]
    scaling: Array
    weight: Array | None = None

    @classmethod
    def of(
        cls, dims: tuple[int, ...], mu: Array, gamma: Array, weight: Array | None = None
    ) -> Cones:
        """Make the cones from coefficients of shape (n,), mu [-] and gamma [m], and weights."""
        return cls(dims, cone_scalings(mu, gamma), weight)

    def weigh(self, parts: Array, axes: int) -> Array:
        """Return each contact's part of a barrier, which has ``axes`` axes, times its weight."""
        return parts if self.weight is None else self.weight[(..., *[None] * axes)] * parts

    @classmethod
    def of_models(cls, models: Sequence[ContactModel]) -> Cones:
        """Make the cones of n contact models."""
        mu, gamma = ([getattr(model, name) for model in models] for name in ("mu", "gamma"))
        return cls.of(tuple(model.dim for model in models), np.array(mu), np.array(gamma))


class _Places(NamedTuple):
    """How a stacked vector and the contacts' padded forces go into each other."""

    into_c: NDArray[np.int64]  # (n, 4)
    present: NDArray[np.bool_]  # (n, 4)
    back: NDArray[np.int64]  # (m,), into the flat (4 n,)


@lru_cache(maxsize=256)
def _places(dims: tuple[int, ...]) -> _Places:
    sizes, components = np.array(dims, dtype=np.int64), np.arange(_WIDTH)
    first = np.cumsum(sizes) - sizes
    present = components < sizes[:, None]
    into_c = np.where(present, first[:, None] + components, 0)
    return _Places(into_c, present, np.flatnonzero(present))


def split(c: Array, dims: Sequence[int]) -> list[Array]:
    """Eq. (8) read backwards: the stacked vector's contacts y_1 … y_n.

    Args:
        c: contact forces, shape (m,), or any array with the components on its last axis.
        dims: components of each contact, n of them.

    Returns:
        n views of c, the i-th with dims[i] components.
    """
    return np.split(c, np.cumsum(dims)[:-1], axis=-1) if len(dims) else []


def by_contact(c: Array, dims: tuple[int, ...]) -> Array:
    """Return the contacts' forces of Eq. (8) as an array (n, 4), padded with zeros."""
    places = _places(dims)
    return np.where(places.present, c[..., places.into_c], 0.0)


def stacked(y: Array, dims: tuple[int, ...]) -> Array:
    """Undo :func:`by_contact`: shape (n, 4) to (m,)."""
    return y.reshape(*y.shape[:-2], -1)[..., _places(dims).back]


def R_mu(scaling: Array) -> Array:
    """Matrix of a cone, Eq. (10): diag(−mu², 1, …, 1), so that the cone is y.T R y < 0.

    FPC is the cone without tangents and mu = 1. The elliptic cone of SFC measures its torsion
    in units of gamma/mu, so the last entry is (mu/gamma)².

    Args:
        scaling: ``cone_scaling`` of a contact model, shape (d,).

    Returns:
        Shape (d, d).
    """
    return _diagonal(-_METRIC[: scaling.shape[-1]] * scaling**2)


def g(y: Array, scaling: Array) -> Any:
    """g_i = mu² y_0² − ‖ŷ‖² = −y.T R y of Eq. (11): positive inside the cone and its mirror image.

    It is the product of mu y_0 − ‖ŷ‖ and mu y_0 + ‖ŷ‖, which near the boundary keeps the digits
    that a difference of squares loses.

    Args:
        y: force of one contact, shape (d,) [N, N·m].
        scaling: ``cone_scaling`` of its model, shape (d,).

    Returns:
        A number [N²].
    """
    s = scaling * y
    radius = np.sqrt((s[..., 1:] ** 2).sum(axis=-1))
    return (s[..., 0] - radius) * (s[..., 0] + radius)


def phi_soc(c: Array, cones: Cones) -> Any:
    """Barrier of the friction cones, Eq. (9): −Σ ln g_i, with natural logarithms and the weights.

    Args:
        c: contact forces strictly inside the cones, shape (m,) [N, N·m].
        cones: the n cones.

    Returns:
        The barrier's value, a number [-].
    """
    return -cones.weigh(np.log(g(by_contact(c, cones.dims), cones.scaling)), 0).sum(axis=-1)


def grad_phi_soc_contact(y: Array, scaling: Array) -> Array:
    """Gradient of one contact's barrier −ln g, Eq. (11): (2/g) R_mu y.

    Args:
        y: force of one contact, strictly inside its cone, shape (d,) [N, N·m].
        scaling: ``cone_scaling`` of its model, shape (d,).

    Returns:
        Shape (d,) [1/N, 1/(N·m)].
    """
    return (2 / g(y, scaling))[..., None] * _times(R_mu(scaling), y)


def grad_phi_soc(c: Array, cones: Cones) -> Array:
    """Gradient of Eq. (9), Eq. (12): the contacts' gradients, stacked.

    Args:
        c: contact forces strictly inside the cones, shape (m,) [N, N·m].
        cones: the n cones.

    Returns:
        Shape (m,) [1/N, 1/(N·m)].
    """
    y = by_contact(c, cones.dims)
    gradient = cones.weigh(grad_phi_soc_contact(y, cones.scaling), 1)
    return _widened(stacked(gradient, cones.dims), c.shape[-1])


def hess_phi_soc_contact(y: Array, scaling: Array) -> Array:
    """Hessian of one contact's barrier −ln g, Eq. (13): ∇Phi ∇Phi.T + (2/g) R_mu.

    Args:
        y: force of one contact, strictly inside its cone, shape (d,) [N, N·m].
        scaling: ``cone_scaling`` of its model, shape (d,).

    Returns:
        Shape (d, d) [1/N², …].
    """
    gradient = grad_phi_soc_contact(y, scaling)
    curvature = (2 / g(y, scaling))[..., None, None] * R_mu(scaling)
    return gradient[..., :, None] * gradient[..., None, :] + curvature


def hess_phi_soc(c: Array, cones: Cones) -> Array:
    """Hessian of Eq. (9), Eq. (14): block diagonal, a block a contact.

    Args:
        c: contact forces strictly inside the cones, shape (m,) [N, N·m].
        cones: the n cones.

    Returns:
        Shape (m, m) [1/N², …].
    """
    y = by_contact(c, cones.dims)
    blocks = cones.weigh(hess_phi_soc_contact(y, cones.scaling), 2)
    rows = _block_diagonal(blocks, cones.dims)
    hessian = _widened(rows[..., _places(cones.dims).back, :], c.shape[-1])
    return np.swapaxes(_widened(np.swapaxes(hessian, -1, -2), c.shape[-1]), -1, -2)


def _widened(x: Array, width: int) -> Array:
    """Return x with zeros up to a last axis of that width: for variables that no cone bounds."""
    missing = width - x.shape[-1]
    return np.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, missing)]) if missing else x


def _block_diagonal(blocks: Array, dims: tuple[int, ...]) -> Array:
    """Return blocks (n, 4, 4) in a matrix (4 n, m), the padding's rows kept."""
    n = len(dims)
    spread = blocks[..., :, :, None, :] * np.eye(n)[:, None, :, None]
    return spread.reshape(*blocks.shape[:-3], _WIDTH * n, _WIDTH * n)[..., _places(dims).back]


# ---- III-C  force distribution by weighted barrier functions ----------------------------------


class Barriers(NamedTuple):
    """The barriers of Phi, Eq. (16): everything but the equations W c = f.

    Attributes:
        cones: the n friction cones.
        A: matrix of the linear limits A c ≤ b, shape (v, m).
        b: their right-hand sides, shape (v,).
        alpha: weight of the linear limits, a number, or shape (…,).
        S: rows of W over their softness, zero for exact ones, shape (k, m); None without softness.
        t: entries of f over it, likewise, shape (k,): ½‖S c − t‖² is added to Phi.

    A and S may have further columns, for variables behind c that no cone bounds: the internal
    forces of motors. c then stands for all of them.
    """

    cones: Cones
    A: Array
    b: Array
    alpha: Any
    S: Array | None = None
    t: Array | None = None

    @property
    def unit(self) -> Any:
        """The least weight of a term, at most 1: over it, Phi is standard self-concordant."""
        unit = np.minimum(1.0, self.alpha)
        if self.cones.weight is None:
            return unit
        return np.minimum(unit, self.cones.weight.min(axis=-1, initial=1.0))

    def lack(self, c: Array) -> Any:
        """S c − t: what soft rows lack, in units of their softness, shape (k,); 0 without any."""
        return 0.0 if self.S is None or self.t is None else _times(self.S, c) - self.t


def joint_torques(c: Array, J: Array, tau_bias: Array | float) -> Array:
    """Torques that the joints have to give, Eq. (2): J.T c + tau_bias.

    Args:
        c: contact forces, shape (m,) [N, N·m].
        J: hand Jacobian in contact frames, shape (m, n_joints).
        tau_bias: what the joints need for themselves, shape (n_joints,) [N·m].

    Returns:
        Shape (n_joints,) [N·m].
    """
    return _times(np.swapaxes(J, -1, -2), c) + tau_bias


def torque_limits(J: Array, tau_lo: Array, tau_hi: Array) -> tuple[Array, Array]:
    """Joint torque limits tau_lo ≤ J.T c ≤ tau_hi as A c ≤ b, Eq. (15).

    Args:
        J: hand Jacobian in contact frames, shape (m, n_joints).
        tau_lo: lower limits, shape (n_joints,) [N·m].
        tau_hi: upper limits, shape (n_joints,) [N·m].

    Returns:
        A, shape (2 n_joints, m), and b, shape (2 n_joints,): first the upper limits of all joints.
    """
    rows = np.swapaxes(J, -1, -2)
    return np.concatenate((rows, -rows), axis=-2), np.concatenate((tau_hi, -tau_lo), axis=-1)


def ceilings(dims: Sequence[int], engagement: Array, c_max: Array) -> tuple[Array, Array]:
    """Ceilings of the normal forces, c_norm,i ≤ w_i c_max,i, as A c ≤ b, Eq. (20).

    Args:
        dims: components of each contact, n of them.
        engagement: the paper's w_i, 0 to 1, shape (n,) [-].
        c_max: ceilings of contacts that are fully engaged, shape (n,) [N].

    Returns:
        A, shape (n, m), which picks the normal forces; and b, shape (n,) [N].
    """
    sizes = np.array(dims, dtype=np.int64)
    starts = np.cumsum(sizes) - sizes
    return np.eye(sizes.sum())[starts], engagement * c_max


def inside_cones(c: Array, cones: Cones, rounding: float = 0.0) -> NDArray[np.bool_]:
    """Tell whether every contact pushes and its g is positive; see :func:`strictly_inside`."""
    y = by_contact(c, cones.dims)
    pushes = (cones.scaling * y)[..., 0]
    return ((pushes > 0) & (g(y, cones.scaling) > rounding * pushes**2)).all(axis=-1)


def strictly_inside(c: Array, barriers: Barriers, rounding: float = 0.0) -> NDArray[np.bool_]:
    """Tell whether every slack and every cone's g is positive.

    Args:
        c: contact forces, shape (m,) [N, N·m].
        barriers: cones and limits.
        rounding: by more than this part of the numbers that it is the difference of.

    Returns:
        A truth value; False where c holds NaN.
    """
    cones, A, b = barriers[:3]
    least = rounding * (np.abs(b) + _times(np.abs(A), np.abs(c))) if rounding else 0.0
    return (slacks(c, A, b) > least).all(axis=-1) & inside_cones(c, cones, rounding)


def objective(c: Array, barriers: Barriers) -> Any:
    """The weighted objective, Eq. (16): Phi_soc(c) + alpha·Phi_lin(c), and what softness adds.

    Args:
        c: contact forces, shape (m,) [N, N·m].
        barriers: cones, limits, alpha and softness.

    Returns:
        A number [-]; inf outside the cones or the limits.
    """
    cones, A, b, alpha = barriers[:4]
    with np.errstate(divide="ignore", invalid="ignore"):
        value = phi_soc(c, cones) + alpha * phi_lin(c, A, b)
        if barriers.S is not None:
            value = value + np.square(barriers.lack(c)).sum(axis=-1) / 2
    return np.where(strictly_inside(c, barriers), value, np.inf)


def derivatives(c: Array, barriers: Barriers) -> tuple[Array, Array]:
    """Gradient and Hessian in c of Phi, Eq. (16).

    Args:
        c: contact forces strictly inside, shape (m,) [N, N·m].
        barriers: cones, limits, alpha and softness.

    Returns:
        Shapes (m,) and (m, m) [1/N, 1/N², …].
    """
    cones, A, b, alpha = barriers[:4]
    weight = np.asarray(alpha)[..., None]
    gradient = grad_phi_soc(c, cones) + weight * grad_phi_lin(c, A, b)
    hessian = hess_phi_soc(c, cones) + weight[..., None] * hess_phi_lin(c, A, b)
    if barriers.S is None:
        return gradient, hessian
    columns = np.swapaxes(barriers.S, -1, -2)
    return gradient + _times(columns, barriers.lack(c)), hessian + columns @ barriers.S


def particular_and_nullspace(W: Array, f: Array) -> tuple[Array, Array]:
    """Particular solution c_p = W⁺ f and null space N of W, Eq. (17), by the SVD.

    W may have any rank; the rank is judged after scaling its rows to equal length, because
    forces and torques have different units.

    Args:
        W: grasp map of one problem, shape (k, m).
        f: wanted wrench, shape (k,) [N, N·m].

    Returns:
        c_p, shape (m,) [N, N·m], the least-norm minimiser of the scaled rows of W c − f; and N,
        shape (m, m − rank W), orthonormal columns with W N = 0. Every c with W c = f is
        c_p + N lam.
    """
    size = np.linalg.norm(W, axis=1)
    size = np.where(size == 0, 1.0, size)
    U, s, Vt = np.linalg.svd(W / size[:, None])
    rank = int((s > 1e-10 * s[0]).sum()) if s.size else 0
    c_p = Vt[:rank].T @ ((U[:, :rank].T @ (f / size)) / s[:rank])
    return c_p, Vt[rank:].T


def reduced_objective(lam: Array, c_p: Array, N: Array, barriers: Barriers) -> Any:
    """Phi in the reduced variables, Eq. (18): Phi(c_p + N lam).

    Args:
        lam: reduced variables, shape (q,).
        c_p: particular solution of W c = f, shape (m,) [N, N·m].
        N: null space of W, shape (m, q).
        barriers: cones, limits, alpha and softness.

    Returns:
        A number [-]; inf outside the cones or the limits.
    """
    return objective(c_p + _times(N, lam), barriers)


def reduced_derivatives(c: Array, N: Array, barriers: Barriers) -> tuple[Array, Array]:
    """Derivatives in lam of Eq. (18), Eq. (19): N.T ∇Phi(c) and N.T ∇²Phi(c) N.

    Args:
        c: contact forces c_p + N lam strictly inside, shape (m,) [N, N·m].
        N: null space of W, shape (m, q).
        barriers: cones, limits, alpha and softness.

    Returns:
        Gradient, shape (q,), and Hessian, shape (q, q).
    """
    gradient, hessian = derivatives(c, barriers)
    rows = np.swapaxes(N, -1, -2)
    return _times(rows, gradient), rows @ hessian @ N


def newton_step(gradient: Array, hessian: Array) -> Array:
    """Newton step of Eq. (21) with gamma = 1: −(∇²Phi)⁻¹ ∇Phi, scaled to a unit diagonal first.

    Args:
        gradient: shape (q,).
        hessian: positive definite, shape (q, q).

    Returns:
        The step, shape (q,).

    Raises:
        LinAlgError: the Hessian is singular.
    """
    scale = 1 / np.sqrt(np.diagonal(hessian, axis1=-2, axis2=-1))
    scaled = hessian * scale[..., :, None] * scale[..., None, :]
    return -scale * np.linalg.solve(scaled, (scale * gradient)[..., None])[..., 0]


def backtrack(
    lam: Array, d: Array, slope: float, c_p: Array, N: Array, barriers: Barriers
) -> float:
    """γ of Eq. (21): halve until the step stays inside and the objective falls (Armijo).

    Args:
        lam: reduced variables, shape (q,).
        d: the step, likewise.
        slope: of the objective along d, below 0.
        c_p: particular solution of W c = f, shape (m,) [N, N·m].
        N: null space of W, shape (m, q).
        barriers: cones, limits, alpha and softness; of one problem.

    Returns:
        γ; 0 where rounding leaves none.
    """
    gamma, before = 1.0, reduced_objective(lam, c_p, N, barriers)
    while gamma > 1e-16:
        after = reduced_objective(lam + gamma * d, c_p, N, barriers)
        if after <= before + 0.1 * gamma * slope:
            return gamma
        gamma /= 2
    return 0.0


def friction_residual(c: Array, cones: Cones) -> Any:
    """Smallest squared distance of the contact forces to slipping, r_f of Eq. (22).

    Args:
        c: contact forces, shape (m,), contact-major, each ``[n, x, y(, torsion)]`` [N, N·m].
        cones: the n cones.

    Returns:
        min_i (mu_i² n_i² − ‖t_i‖²) [N²]; negative when some contact slips, inf without contacts.
    """
    return g(by_contact(c, cones.dims), cones.scaling).min(axis=-1, initial=np.inf)


# ---- margins and violations -------------------------------------------------------------------


def friction_margins(c: Array, cones: Cones) -> Array:
    """Margins mu n − ‖tangential force‖ of the contacts to slipping.

    Args:
        c: contact forces, shape (m,) [N, N·m].
        cones: the n cones.

    Returns:
        Shape (n,) [N]; negative where a contact slips. FPC: the normal force. SFC: the torsion
        counts as (mu/gamma)·torsion.
    """
    s = cones.scaling * by_contact(c, cones.dims)
    return s[..., 0] - _radius(s)


def dual_margins(e: Array, cones: Cones) -> Array:
    """Margins e_n − mu ‖(e_x, e_y, (gamma/mu) e_torsion)‖ to the duals of the cones.

    Args:
        e: one entry for each force component, shape (m,).
        cones: the n cones.

    Returns:
        Shape (n,), in the unit of e; not negative where e·c_i ≥ 0 for all c_i in the cone.
    """
    y = by_contact(e, cones.dims)
    return y[..., 0] - cones.scaling[..., 0] * _radius(y / cones.scaling)


def _radius(s: Array) -> Array:
    """Return ‖(s_1, s_2, s_3)‖ of s (…, 4); not by squares, which vanish for small numbers."""
    return np.hypot(np.hypot(s[..., 1], s[..., 2]), s[..., 3])


def torque_margins(tau: Array, tau_lo: Array, tau_hi: Array) -> Array:
    """Distance of every joint torque to its nearer limit, shape (n_joints,) [N·m]."""
    return np.minimum(tau_hi - tau, tau - tau_lo)


def relative_violation(c: Array, barriers: Barriers, scales: tuple[Array, Array]) -> Any:
    """Largest violation of a cone or limit, each in units of its scale.

    Args:
        c: contact forces, shape (m,) [N, N·m].
        barriers: cones and limits.
        scales: of the limits, shape (v,), and of the cones, shape (n,) [N]; see
            :meth:`graspforce.ForceProblem.violation_scales`.

    Returns:
        A number [-]; negative strictly inside.
    """
    of_rows, of_cones = scales
    rows = (-slacks(c, barriers.A, barriers.b) / of_rows).max(axis=-1, initial=-np.inf)
    cones = (-friction_margins(c, barriers.cones) / of_cones).max(axis=-1, initial=-np.inf)
    return np.maximum(rows, cones)


def force_size(barriers: Barriers, f: Array) -> Any:
    """Size of force that the limits are made for, by the largest of them, or of the wrench.

    Args:
        barriers: the limits.
        f: wanted wrench, shape (k,) [N, N·m].

    Returns:
        The largest of |f| and, over the rows of A c ≤ b, of |b| over the row's largest entry [N].
    """
    entries = np.abs(barriers.A).max(axis=-1, initial=0.0)
    rows = np.where(entries > 0, np.abs(barriers.b) / np.where(entries > 0, entries, 1.0), 0.0)
    return np.maximum(np.abs(f).max(axis=-1), rows.max(axis=-1, initial=0.0))


def wrench_error(c: Array, W: Array, f: Array) -> Any:
    """Largest |W c − f| of the rows of Eq. (1).

    Args:
        c: contact forces, shape (m,) [N, N·m].
        W: grasp map, shape (k, m).
        f: wanted wrench, shape (k,) [N, N·m].

    Returns:
        A number [N, N·m].
    """
    return np.abs(_times(W, c) - f).max(axis=-1)


def relative_wrench_error(c: Array, W: Array, f: Array) -> Any:
    """:func:`wrench_error` over the largest of |f| and the rows of |W|·|c|; 0 where both are."""
    parts = _times(np.abs(W), np.abs(c)).max(axis=-1)
    scale = np.maximum(np.abs(f).max(axis=-1), parts)
    return wrench_error(c, W, f) / np.where(scale == 0, 1.0, scale)


def undetermined(W: Array, J: Array) -> Any:
    """How many components of c neither W c nor J.T c determines.

    Args:
        W: grasp map, shape (…, k, m).
        J: hand Jacobian, shape (…, m, n_joints).

    Returns:
        A number for each problem, shape (…); an int for one alone.
    """
    M = np.concatenate((W, np.swapaxes(J, -1, -2)), axis=-2)
    counts = np.zeros(M.shape[:-2], dtype=np.intp)
    rest = np.ones(counts.shape, dtype=bool)
    if rest.size > 1:
        # Most matrices are far from losing rank, and Cholesky's factors say so sooner.
        rest = ~_surely_regular(np.swapaxes(M, -1, -2) @ M)
    sizes = np.linalg.svd(M[rest], compute_uv=False)
    ranks = (sizes > UNDETERMINED * sizes.max(axis=-1, initial=0.0, keepdims=True)).sum(axis=-1)
    counts[rest] = M.shape[-1] - ranks
    return counts if counts.ndim else int(counts)


def _surely_regular(G: Array) -> NDArray[np.bool_]:
    """Tell which symmetric matrices, none negative, have full rank beyond doubt; overwrites them.

    With G = L L.T the inverse of L is, entry by entry, no larger than that of the matrix with the
    diagonal of L and −|l_ij| below it, whose rows' sums follow from one substitution.
    """
    i = G.shape[-1]
    diagonal = np.einsum("...ii->...i", G)
    trace = diagonal.sum(axis=-1)
    known = (trace > 0) & np.isfinite(trace)
    if not known.all():
        G[~known] = np.eye(i)
    diagonal += _RIDGE * np.where(known, trace, 1.0)[..., None]
    L = np.linalg.cholesky(G)
    L = np.abs(np.ascontiguousarray(np.moveaxis(L, (-2, -1), (0, 1))))
    sums = np.ones(L.shape[1:])
    for k in range(i):
        sums[k] /= L[k, k]
        sums[k + 1 :] += L[k + 1 :, k] * sums[k]
    return known & (i * trace * np.square(sums.max(axis=0)) < _SURELY_REGULAR)


def wrench_reachable(W: Array, f: Array) -> bool:
    """Tell whether f is in the range of W, so that some contact force makes it (Eq. 17).

    Args:
        W: grasp map of one problem, shape (k, m).
        f: wanted wrench, shape (k,) [N, N·m].

    Returns:
        Whether |W c_p − f| is at most 1e-9 of the wrenches that add up to f.
    """
    c_p, _ = particular_and_nullspace(W, f)
    return bool(relative_wrench_error(c_p, W, f) <= 1e-9)


# ---- how near the minimum ---------------------------------------------------------------------


def decrement_after(step: float) -> float:
    """Bound on the decrement after a full Newton step whose own decrement is ``step``."""
    return (step / (1 - step)) ** 2 if step < 1 else math.inf


def suboptimality(decrement: ArrayLike) -> Array:
    """Bound on how far a standard self-concordant function is above its minimum.

    Args:
        decrement: bound on the Newton decrement λ at the point, of any shape.

    Returns:
        −λ − ln(1 − λ); inf where λ is not below 1.
    """
    inside = np.less(decrement, 1)
    bound = np.where(inside, decrement, 0.0)
    return np.where(inside, -bound - np.log1p(-bound), np.inf)


def decrement_and_error(c: Array, W: Array, barriers: Barriers) -> tuple[float, float]:
    """:func:`decrements_and_errors` of one problem, as two numbers."""
    dims, scaling, weight = barriers.cones
    batch = Barriers(
        Cones(dims, scaling[None], None if weight is None else weight[None]),
        barriers.A[None], barriers.b[None], np.asarray(barriers.alpha)[None],
        *(() if barriers.S is None or barriers.t is None else (barriers.S[None], barriers.t[None])),
    )  # fmt: skip
    decrement, error = decrements_and_errors(c[None], W[None], batch)
    return float(decrement[0]), float(error[0])


def decrements_and_errors(c: Array, W: Array, barriers: Barriers) -> tuple[Array, Array]:
    """Newton decrements at c of Phi over its unit on {W c = f}, and what rounding may do to them.

    It is the length of what projecting onto W d = 0 leaves of the scaled gradient γ, where
    ``∇Phi = G.T γ`` and ``∇²Phi = G.T G``: the Hessian itself, which holds squares, is not formed.

    Near the boundary the last digit of c counts. And contacts that nearly coincide leave W with
    faint directions: a relative change of W by 1e-16 turns the directions with W d = 0 by as much
    times its condition, and the decrement follows.

    Args:
        c: contact forces of B problems, shape (B, m) [N, N·m].
        W: grasp maps, shape (B, k, m).
        barriers: cones, limits, alpha and softness, each with the leading axis.

    Returns:
        The decrements [-], shape (B,), inf outside, and on the boundary as far as rounding can
        tell; and how far the rounding of c and W may have moved them.
    """
    decrement, error = np.full(len(c), np.inf), np.zeros(len(c))
    if not c.shape[-1]:
        return error, error
    with np.errstate(all="ignore"):
        inside = strictly_inside(c, barriers, ROUNDING)
        size = np.linalg.norm(W, axis=-1, keepdims=True)
        scaled = W / np.where(size > 0, size, 1)
        inside &= np.isfinite(scaled).all(axis=(-1, -2)) & np.isfinite(c).all(axis=-1)
        if not inside.any():
            return decrement, error
        G, gamma = factored_derivatives(c, barriers)
        inside &= np.isfinite(G).all(axis=(-1, -2)) & np.isfinite(gamma).all(axis=-1)
        _, strengths, directions = np.linalg.svd(scaled[inside], full_matrices=False)
        rank = (strengths > RANK_TOLERANCE * strengths.max(axis=-1, initial=0)[:, None]).sum(axis=1)
        for each in np.unique(rank).tolist():  # the rank decides the shapes
            rows = np.flatnonzero(inside)[rank == each]
            of_rank = rank == each
            lengths, errors = _projected_lengths(
                c[rows], strengths[of_rank], directions[of_rank], G[rows], gamma[rows], each
            )
            decrement[rows] = np.where(np.isfinite(lengths), lengths, np.inf)
            error[rows] = np.where(np.isfinite(lengths), errors, 0.0)
    return decrement, error


def _projected_lengths(
    c: Array, strengths: Array, directions: Array, G: Array, gamma: Array, rank: int
) -> tuple[Array, Array]:
    """Lengths of what projecting onto W d = 0 leaves of γ, and what rounding may do to them.

    Args:
        c: forces, shape (B, m).
        strengths: singular values of W in rows of unit length, shape (B, r).
        directions: its right singular vectors, shape (B, r, m).
        G: see :func:`factored_derivatives`, shape (B, v, m).
        gamma: likewise, shape (B, v).
        rank: of W in all rows.
    """
    m = c.shape[1]
    if rank == m:  # W c = f has one solution
        return np.zeros(len(c)), np.zeros(len(c))
    order = np.argsort(-np.abs(G).max(axis=-1))  # what rounding does to the large rows stays there
    Q, R = np.linalg.qr(np.take_along_axis(G, order[..., None], axis=1))
    along = _times(np.swapaxes(Q, 1, 2), np.take_along_axis(gamma, order, axis=1))
    broken = (np.diagonal(R, axis1=1, axis2=2) == 0).any(axis=1)  # rounding has the last word
    R[broken] = np.eye(m)
    Z = np.linalg.solve(np.swapaxes(R, 1, 2), np.swapaxes(directions[:, :rank], 1, 2))
    Z = Z / np.linalg.norm(Z, axis=1, keepdims=True)
    broken |= ~np.isfinite(Z).all(axis=(1, 2)) | ~np.isfinite(along).all(axis=1)
    Z[broken] = np.eye(m)[:, :rank]
    basis, _ = np.linalg.qr(Z)
    left = along
    for _ in range(2):  # once more for what cancellation leaves
        left = left - _times(basis, _times(np.swapaxes(basis, 1, 2), left))
    condition: Any = np.ones(len(c))
    if rank:
        condition = np.linalg.cond(Z) * strengths[:, 0] / strengths[:, rank - 1]
    turned = 16 * m * condition * np.linalg.norm(along, axis=1)
    moved = 64 * (
        np.linalg.norm(_times(np.abs(G), np.abs(c)), axis=1) + np.linalg.norm(gamma, axis=1)
    )
    lengths = np.where(broken, np.inf, np.linalg.norm(left, axis=1))
    return lengths, np.spacing(1.0) * (turned + moved)


def factored_derivatives(c: Array, barriers: Barriers) -> tuple[Array, Array]:
    """Return G and γ with ∇Phi = G.T γ and ∇²Phi = G.T G, of Phi over its unit.

    In s = scaling·y the Hessian of −ln det s, det s = s_0² − ‖ŝ‖², is 2 B²/det s, where B is the
    boost that takes the cone's axis to (s_0, −ŝ)/√det s, and the gradient is
    −√(2/det s)·√2 B e_0.

    Args:
        c: contact forces strictly inside, shape (m,) [N, N·m].
        barriers: cones, limits, alpha and softness.

    Returns:
        G, shape (v + 4 n, m), with rows of zeros for components that a contact does not have;
        and γ, shape (v + 4 n,); with k rows more where there is softness.
    """
    cones, A, b, alpha = barriers[:4]
    dims, scaling, of_cone = cones
    weight = np.asarray(alpha / barriers.unit)[..., None]
    of_limits = np.sqrt(weight)[..., None] * A / slacks(c, A, b)[..., None]
    s = scaling * by_contact(c, dims)
    radius = _radius(s)
    det = (s[..., 0] - radius) * (s[..., 0] + radius)
    w = _METRIC * s / np.sqrt(det)[..., None]
    axis = np.eye(_WIDTH)[0]
    u = w + axis
    B = u[..., :, None] * u[..., None, :] / u[..., :1, None] - np.diag(_METRIC)
    doubled = np.sqrt(2 / np.asarray(barriers.unit))[..., None]
    if of_cone is not None:
        doubled = doubled * np.sqrt(of_cone)
    blocks = (doubled / np.sqrt(det))[..., None, None] * B * scaling[..., None, :]
    of_cones = _widened(_block_diagonal(blocks, dims), c.shape[-1])
    pulls = (-doubled[..., None] * np.ones((len(dims), 1)) * axis).reshape(*c.shape[:-1], -1)
    ones = np.ones(slacks(c, A, b).shape)
    G, gamma = [of_limits, of_cones], [np.sqrt(weight) * ones, pulls]
    if barriers.S is not None:
        root = np.sqrt(np.asarray(barriers.unit))[..., None]
        G.append(barriers.S / root[..., None])
        gamma.append(barriers.lack(c) / root)
    return np.concatenate(G, axis=-2), np.concatenate(gamma, axis=-1)


# ---- numbers ----------------------------------------------------------------------------------


def may_overflow(numbers: Array) -> bool:
    """Tell whether some number is so large, or so near zero, that products may not be finite."""
    sizes = np.abs(numbers[numbers != 0])
    return bool((sizes > LARGEST).any() or (sizes < 1 / LARGEST).any())


def least_squares(A: Array, b: Array) -> Array:
    """Return the least-norm minimiser of ‖A x − b‖; for one matrix, shapes (i, j) and (i,)."""
    return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], dtype=np.float64)
