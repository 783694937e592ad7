"""A proof that no contact force does the job, which anyone can check with NumPy.

Let A c ≤ b be every linear limit of the problem. If a wrench direction y and multipliers z ≥ 0
make ``e = A.T z − W.T y`` lie, contact by contact, in the dual of the friction cone, then every
admissible c has y·f = y·W c = z·A c − e·c ≤ z·b. So ``y·f > z·b`` proves that there is none.

Contacts that pull have this in c + preload, where their cones are the ordinary ones. For an
internal force v of the motors, which no cone bounds, e has to vanish: what rounding leaves of it
counts with the most that v can be, by a motor that feels it alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspforce._util.arrays import Array, as_array, hash_bytes, require_instance
from graspforce.equations import dual_margins
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Multipliers that prove a grasp infeasible.

    Attributes:
        y: wrench direction, shape (k,): the grasp cannot push the object hard enough along it.
        z: multipliers of the rows of ``problem.linear_limits()``, shape (v,), none negative.

    Raises:
        InvalidInputError: y or z is no array of real numbers.
    """

    y: Array
    z: Array

    def __post_init__(self) -> None:
        for name in ("y", "z"):  # no number is no proof, but may be asked about
            value = as_array(getattr(self, name), name, None, finite=False)
            object.__setattr__(self, name, value)

    def excess(self, problem: ForceProblem) -> float:
        """Return y·f − z·b: by how much the wanted wrench exceeds the most that is possible.

        Raises:
            InvalidInputError: no problem, or the certificate's sizes are not its.
        """
        problem, _, b = _limits_for(problem, self)
        return float(self.y @ problem.f - self.z @ b)

    def proves_infeasible(self, problem: ForceProblem) -> bool:
        """Check the proof from the problem's data alone; see :func:`check_certificate`."""
        return check_certificate(problem, self)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Certificate):
            return NotImplemented
        return np.array_equal(self.y, other.y) and np.array_equal(self.z, other.z)

    def __hash__(self) -> int:
        return hash((hash_bytes(self.y), hash_bytes(self.z)))


def check_certificate(problem: ForceProblem, certificate: Certificate) -> bool:
    """Confirm that ``certificate`` proves ``problem`` infeasible, rounding accounted for.

    Each sum of p products is off by at most about p·2⁻⁵³ of its absolute terms; the check asks
    for more than 1e-14·p of them on the safe side.

    Raises:
        InvalidInputError: an argument of the wrong kind, or the certificate's sizes are not the
            problem's.
    """
    problem, A, b = _limits_for(problem, certificate)
    y, z, (W, f), m = certificate.y, certificate.z, problem.equalities, problem.m
    if y[~problem.exact].any():  # a soft row asks for nothing
        return False
    unit = 1e-14 * (len(y) + len(z))
    e = A.T @ z - W.T @ y
    off = unit * (np.abs(A.T) @ np.abs(z) + np.abs(W.T) @ np.abs(y))
    # Rounding may have raised the normal part of e and shortened its tangential part by as much.
    left = np.abs(e[m:]) + off[m:]
    e, off = e[:m], off[:m]
    most = 2 * off[problem.starts[:-1]] - dual_margins(off, problem.cones)
    safe = dual_margins(e, problem.cones) >= most
    gap = y @ f - z @ b - left[left > 0] @ most_internal(problem)[left > 0]
    rounding = unit * (np.abs(y) @ np.abs(f) + z @ np.abs(b))
    # Every comparison with NaN is False: NaN is no proof.
    return bool(safe[problem.active].all() and (z >= 0).all() and gap > rounding)


def most_internal(problem: ForceProblem) -> Array:
    """Return the most that each internal force can be, by motors that feel it alone; or inf."""
    most = np.full(problem.layout.internals, np.inf)
    arms = np.concatenate((problem.J, problem.internal))
    for joint in np.flatnonzero((arms != 0).sum(axis=0) == 1):
        for v in np.flatnonzero(problem.internal[:, joint]):
            ends = np.array([problem.tau_lo[joint], problem.tau_hi[joint]])
            reach = np.abs(ends - problem.tau_bias[joint]).max()
            most[v] = min(most[v], reach / abs(problem.internal[v, joint]))
    return most


def _limits_for(
    problem: ForceProblem, certificate: Certificate
) -> tuple[ForceProblem, Array, Array]:
    """Return the problem without pulls and its linear limits, whose multipliers z has to hold."""
    require_instance(problem, "problem", ForceProblem)
    require_instance(certificate, "certificate", Certificate)
    problem = problem.without_pulls()
    A, b = problem.linear_limits()
    y, z = certificate.y, certificate.z
    if y.shape != problem.f.shape or z.shape != b.shape:
        raise InvalidInputError(
            f"certificate: got y of shape {y.shape} and z of shape {z.shape}, expected "
            f"{problem.f.shape} and {b.shape}, the problem's rows of W and linear limits"
        )
    return problem, A, b
