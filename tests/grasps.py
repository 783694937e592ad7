"""Grasps for the tests: random geometry, and problems whose exact optimum is known beforehand.

Nothing here calls graspforce for its mathematics: cones, gradients and grasp maps are written
down a second time, so that an error in the library cannot hide behind itself.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

import graspforce as gf

KINDS = ("FPC", "PCWF", "SFC")
SIZES = {"FPC": 1, "PCWF": 3, "SFC": 4}


# ---- geometry ----------------------------------------------------------------------------------


def random_model(rng, kind):
    """A contact model of the given kind with mu in .3…1 and gamma in 3…10 mm."""
    mu = rng.uniform(0.3, 1.0)
    return {"FPC": gf.FPC(), "PCWF": gf.PCWF(mu), "SFC": gf.SFC(mu, rng.uniform(0.003, 0.01))}[kind]


def random_contacts(rng, models, radius=0.04):
    """Contacts spread over a ball, their normals tilted by up to some 20° from its centre."""
    n = len(models)
    k = np.arange(n) + 0.5
    height, around = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - height**2)
    spread = np.column_stack((flat * np.cos(around), flat * np.sin(around), height))
    directions = unit(Rotation.random(random_state=rng).apply(spread) + rng.normal(0, 0.15, (n, 3)))
    normals = unit(-directions + rng.normal(0, 0.15, (n, 3)))
    return [
        gf.Contact(radius * p, v, model, tangent=np.cross(v, rng.normal(size=3)))
        for p, v, model in zip(directions, normals, models, strict=True)
    ]


def nose_cone(n):
    """Points and inward normals, shape (n, 3), on the paraboloid z = x² + y² of Lobo et al."""
    angles = 2 * np.pi * np.arange(1, n + 1) / n
    x, y = 0.3 + np.cos(angles), np.sin(angles)
    points = np.column_stack((x, y, x**2 + y**2))
    return points, unit(np.column_stack((-2 * x, -2 * y, np.ones(n))))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def finger_jacobian(rng, sizes, fingers, spare=0):
    """A Jacobian of full row rank whose blocks are the fingers' contacts and joints [m].

    Args:
        sizes: components of each contact; the torsion of a soft finger is its fourth.
        fingers: the contacts of each finger, lists that cover 0…n-1 in order.
        spare: joints of each finger beyond the least number.
    """
    blocks = []
    for contacts in fingers:
        m = sum(sizes[i] for i in contacts)
        Q, _ = np.linalg.qr(rng.normal(size=(m + spare, m)))
        lever = 0.07 * np.exp(rng.uniform(-0.7, 0.7, m))
        row_units = np.concatenate([[1, 1, 1, 20][: sizes[i]] for i in contacts])
        blocks.append((Q * lever * row_units).T)
    return block_diag(*blocks)


def random_fingers(rng, n, shared):
    """Contacts 0…n-1 dealt to fingers: one each, or up to three where ``shared``."""
    if not shared:
        return [[i] for i in range(n)]
    cuts = np.flatnonzero(np.append(rng.random(n - 1) < 0.5, True)) + 1
    return [part.tolist() for part in np.split(np.arange(n), cuts[:-1])]


# ---- the mathematics, a second time ------------------------------------------------------------


def components(models):
    """The slice of each contact's components in c."""
    ends = np.cumsum([model.dim for model in models])
    return [slice(int(end) - model.dim, int(end)) for end, model in zip(ends, models, strict=True)]


def cone_matrix(model):
    """The matrix L with cone {y : (L y)_0 > ‖(L y)_1…‖}; g = (L y)_0² − ‖…‖²."""
    mu, gamma = getattr(model, "mu", 1.0), getattr(model, "gamma", 1.0)
    return np.diag([mu, 1.0, 1.0, mu / gamma][: model.dim])


def cone_margins(c, models):
    """mu n − ‖t‖ of every contact."""
    rolled = [cone_matrix(m) @ c[part] for m, part in zip(models, components(models), strict=True)]
    return np.array([y[0] - np.linalg.norm(y[1:]) for y in rolled])


def cone_gradient(c, models):
    """∇Phi_soc, from g written out."""
    gradient = np.zeros(len(c))
    for model, part in zip(models, components(models), strict=True):
        L = cone_matrix(model)
        y = L @ c[part]
        signs = np.where(np.arange(model.dim) == 0, 1.0, -1.0)
        gradient[part] = -2 / (signs @ y**2) * (L @ (signs * y))
    return gradient


def inside_forces(rng, models, firmness=3.0):
    """Contact forces strictly inside their cones, using up to 85 % of the friction [N]."""
    c = []
    for model in models:
        push = firmness * np.exp(rng.uniform(-0.7, 0.7))
        tangent = unit(rng.normal(size=model.dim - 1)) if model.dim > 1 else np.empty(0)
        y = np.append(1.0, rng.uniform(0, 0.85) * tangent)
        c.append(np.linalg.solve(cone_matrix(model), y * push * cone_matrix(model)[0, 0]))
    return np.concatenate(c)


# ---- planted optima ----------------------------------------------------------------------------


@dataclass
class Planted:
    """A problem with its exact optimum: ``contacts`` for the tests that move the geometry."""

    problem: gf.ForceProblem
    c: np.ndarray
    nu: np.ndarray
    contacts: list = field(default_factory=list)

    @property
    def nu_is_unique(self):
        kept = np.repeat(self.problem.active, [model.dim for model in self.problem.models])
        return np.linalg.matrix_rank(self.problem.W[:, kept]) == len(self.nu)


def plant(
    rng,
    kinds,
    alpha=5.0,
    *,
    shared=False,
    spare=0,
    ceilings=False,
    floors=False,
    inequalities=0,
    bias=False,
    rates=False,
    removed=None,
    hand=True,
    W=None,
):
    """Choose an optimum, then make the limits that put it there.

    Where limits A c ≤ b, the cones and nu satisfy ∇Phi_soc(c*) + alpha·Σ a_i/r_i = W.T nu at a
    point inside them all, c* is *the* optimum of the strictly convex Phi. The ceilings, floors
    and inequalities get slacks of a natural size; what is then missing of the gradient,
    alpha·J δ, is made by the torque limits: a slack of 1/(s + max(δ, 0)) to the upper and
    1/(s + max(−δ, 0)) to the lower one contributes exactly J δ.

    Args:
        kinds: contact kinds, names of ``KINDS``.
        alpha: weight of the linear limits.
        shared: let contacts share the joints of a finger.
        spare: joints of each finger beyond the least number.
        ceilings: add normal ceilings with engagements below 1.
        floors: add normal floors.
        inequalities: number of further random rows A c ≤ b.
        bias: give the joints torques of their own.
        rates: limit the change of every component from forces nearby.
        removed: index of a contact that has left the grasp.
        hand: False writes the torque limits as rows of A.
        W: another grasp map than that of the random contacts.
    """
    n, sizes = len(kinds), [SIZES[kind] for kind in kinds]
    models = [random_model(rng, kind) for kind in kinds]
    contacts = random_contacts(rng, models)
    W = gf.grasp_map(contacts) if W is None else W
    k, m = W.shape
    there = np.ones(n, dtype=bool)
    if removed is not None:
        there[removed] = False
        ceilings = True
    kept = np.repeat(there, sizes)
    normals = np.array([part.start for part in components(models)])

    everywhere = inside_forces(rng, models)
    c = np.where(kept, everywhere, 0.0)
    nu = np.append(rng.normal(size=min(k, 3)), rng.normal(size=max(0, k - 3)) / 0.04)
    target = (W.T @ nu - cone_gradient(everywhere, models)) / alpha

    options = {"alpha": alpha}
    if ceilings:
        slack = np.exp(rng.uniform(0, 3, n))
        engagement = np.where(there, rng.uniform(0.3, 1.0, n), 0.0)
        options["engagement"] = engagement
        options["c_max"] = np.where(
            there, (c[normals] + slack) / np.where(there, engagement, 1), 9.0
        )
        target[normals] -= 1 / slack
    if floors:
        slack = np.where(there, c[normals] * rng.uniform(0.2, 0.9, n), 1.0)
        scale = options.get("engagement", np.ones(n))
        options["c_min"] = np.where(there, (c[normals] - slack) / np.where(there, scale, 1), 0.5)
        target[normals] += 1 / slack
    if rates:
        change = rng.uniform(-1, 1, m)
        most = np.abs(change) + np.exp(rng.uniform(-1, 2, m))
        options |= {"c_last": c - change, "dc_max": most}
        target -= 1 / (most - change) - 1 / (most + change)
    rows, bounds = np.empty((0, m)), np.empty(0)
    if inequalities:
        slack = np.exp(rng.uniform(0, 2, inequalities))
        rows = rng.normal(size=(inequalities, m))
        bounds = rows @ c + slack
        target -= rows.T @ (1 / slack)

    J = finger_jacobian(rng, sizes, random_fingers(rng, n, shared), spare)
    delta = np.linalg.lstsq(J[kept], target[kept], rcond=None)[0]
    s = np.exp(rng.uniform(-1, 2, J.shape[1]))
    tau = J.T @ c
    tau_hi = tau + 1 / (s + np.maximum(delta, 0))
    tau_lo = tau - 1 / (s + np.maximum(-delta, 0))
    if hand:
        tau_bias = rng.normal(0, 0.2, len(tau)) if bias else np.zeros(len(tau))
        options |= {"J": J, "tau_lo": tau_lo + tau_bias, "tau_hi": tau_hi + tau_bias}
        options |= {"tau_bias": tau_bias} if bias else {}
    else:
        rows = np.vstack((rows, J.T, -J.T))
        bounds = np.concatenate((bounds, tau_hi, -tau_lo))
    if len(rows):
        options |= {"A": rows, "b": bounds}
    return Planted(gf.ForceProblem(W, W @ c, models, **options), c, nu, contacts)
