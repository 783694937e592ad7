"""Infeasible grasps by Clarabel: least violations, supports, critical loads, from first principles.

Clarabel solves Phase 1's question as a second-order cone program: the least sigma that relaxes
every limit by sigma of its scale. Also the random grasps, about half of them infeasible, that the
tests of verdicts and ``benchmarks/every_core.py`` judge by it.
"""

import clarabel
import numpy as np
from grasps import (
    KINDS,
    components,
    cone_matrix,
    finger_jacobian,
    random_contacts,
    random_fingers,
    random_model,
)
from scipy import sparse

import graspforce as gf

# ---- the other solver --------------------------------------------------------------------------


def socp(q, equalities, inequalities, cones):
    """Minimise q·x with E x = e, G x ≤ h, M x + v in Lorentz cones; return status, value, x."""
    (E, e), (G, h) = equalities, inequalities
    A = np.vstack((E, G, *[-M for M, _ in cones]))
    b = np.concatenate((e, h, *[v for _, v in cones]))
    kinds = [clarabel.ZeroConeT(len(e)), clarabel.NonnegativeConeT(len(h))]
    kinds += [clarabel.SecondOrderConeT(len(v)) for _, v in cones]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    settings.max_threads = 1
    nothing = sparse.csc_array((len(q), len(q)))
    answer = clarabel.DefaultSolver(nothing, q, sparse.csc_array(A), b, kinds, settings).solve()
    return str(answer.status), answer.obj_val, np.array(answer.x)


def limits_by_hand(problem):
    """Rows A c ≤ b and what one unit of relative violation of each means, and each cone's unit.

    From the words of reference.violation_scales: a contact's reach is the normal force that
    alone would use up the tightest range among its joints' torques and its ceiling.
    """
    models, m = problem.models, problem.m
    parts = components(models)
    reach = []
    for i, part in enumerate(parts):
        lever = np.abs(problem.J[part.start])
        ranges = problem.tau_hi - problem.tau_lo
        candidates = [r / a for r, a in zip(ranges, lever, strict=True) if a > 0]
        if problem.c_max.size:
            candidates.append(problem.engagement[i] * problem.c_max[i])
        reach.append(min(candidates))
    rows, bounds, scales = [], [], []
    for j in range(problem.J.shape[1]):
        half = (problem.tau_hi[j] - problem.tau_lo[j]) / 2
        rows += [problem.J[:, j], -problem.J[:, j]]
        bounds += [problem.tau_hi[j] - problem.tau_bias[j], problem.tau_bias[j] - problem.tau_lo[j]]
        scales += [half, half]
    for i, part in enumerate(parts):
        if problem.c_max.size:
            rows.append(np.eye(m)[part.start])
            bounds.append(problem.engagement[i] * problem.c_max[i])
            scales.append(reach[i])
        if problem.c_min.size:
            rows.append(-np.eye(m)[part.start])
            bounds.append(-problem.engagement[i] * problem.c_min[i])
            scales.append(reach[i])
    for i in range(len(problem.dc_max)):
        for side in (1, -1):
            rows.append(side * np.eye(m)[i])
            bounds.append(problem.dc_max[i] + side * problem.c_last[i])
            scales.append(problem.dc_max[i])
    each = np.repeat(reach, [model.dim for model in models])
    for a, b in zip(problem.A, problem.b, strict=True):
        rows.append(a)
        bounds.append(b)
        scales.append(np.abs(a) @ each)
    cone_scales = [getattr(x, "mu", 1.0) * r for x, r in zip(models, reach, strict=True)]
    return np.array(rows), np.array(bounds), np.array(scales), cone_scales


def least_violation(problem):
    """Least sigma such that c exists with W c = f and every limit relaxed by sigma·scale."""
    A, b, scales, cone_scales = limits_by_hand(problem)
    m = problem.m
    cones = []
    parts = components(problem.models)
    for model, part, scale in zip(problem.models, parts, cone_scales, strict=True):
        M = np.zeros((model.dim, m + 1))
        M[:, part] = cone_matrix(model)
        M[0, m] = scale
        cones.append((M, np.zeros(model.dim)))
    E = np.column_stack((problem.W, np.zeros(len(problem.f))))
    status, sigma, _ = socp(
        np.eye(m + 1)[m], (E, problem.f), (np.column_stack((A, -scales)), b), cones
    )
    assert status in ("Solved", "AlmostSolved"), status
    return sigma


def most_along(problem, y):
    """The largest y·W c over all c in the cones and limits: the support of what is possible."""
    A, b, _, _ = limits_by_hand(problem)
    parts = components(problem.models)
    cones = []
    for model, part in zip(problem.models, parts, strict=True):
        M = np.zeros((model.dim, problem.m))
        M[:, part] = cone_matrix(model)
        cones.append((M, np.zeros(model.dim)))
    none = (np.empty((0, problem.m)), np.empty(0))
    status, value, _ = socp(-(problem.W.T @ y), none, (A, b), cones)
    assert status in ("Solved", "AlmostSolved"), status
    return -value


def critical_load(problem):
    """The largest k for which the wrench k·f is possible."""
    A, b, _, _ = limits_by_hand(problem)
    m = problem.m
    parts = components(problem.models)
    cones = []
    for model, part in zip(problem.models, parts, strict=True):
        M = np.zeros((model.dim, m + 1))
        M[:, part] = cone_matrix(model)
        cones.append((M, np.zeros(model.dim)))
    E = np.column_stack((problem.W, -problem.f))
    status, value, _ = socp(
        -np.eye(m + 1)[m], (E, np.zeros(len(problem.f))), (np.pad(A, ((0, 0), (0, 1))), b), cones
    )
    assert status == "Solved", status
    return -value


def violation_of(problem, c):
    """The relative violation of c, by hand."""
    A, b, scales, cone_scales = limits_by_hand(problem)
    rows = ((A @ c - b) / scales).max()
    parts = components(problem.models)
    slips = []
    for model, part, scale in zip(problem.models, parts, cone_scales, strict=True):
        y = cone_matrix(model) @ c[part]
        slips.append((np.linalg.norm(y[1:]) - y[0]) / scale)
    return max(rows, *slips)


def scales_by_hand(problem):
    """1 N for forces; for torques the root mean square torque per newton of contact force."""
    pushes = [
        i
        for part in components(problem.models)
        for i in range(part.start, min(part.stop, part.start + 3))
    ]
    W = problem.W[:, pushes]
    size = np.sqrt((W[3:] ** 2).sum() / (W[:3] ** 2).sum())
    return np.array([1, 1, 1, size, size, size])


def nearest_by_clarabel(problem):
    """What the wrench nearest to f lacks of it: min ½‖s‖², (W c + s = f)/scale, c within limits."""
    A, b, _, _ = limits_by_hand(problem)
    scales, m, k = scales_by_hand(problem), problem.m, len(problem.f)
    rows = [np.column_stack((problem.W / scales[:, None], np.eye(k)))]
    rows += [np.column_stack((A, np.zeros((len(b), k))))]
    right = [problem.f / scales, b]
    kinds = [clarabel.ZeroConeT(k), clarabel.NonnegativeConeT(len(b))]
    for model, part in zip(problem.models, components(problem.models), strict=True):
        M = np.zeros((model.dim, m + k))
        M[:, part] = -cone_matrix(model)
        rows.append(M)
        right.append(np.zeros(model.dim))
        kinds.append(clarabel.SecondOrderConeT(model.dim))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    settings.max_threads = 1
    cost = sparse.csc_array(np.diag(np.r_[np.zeros(m), np.ones(k)]))
    found = clarabel.DefaultSolver(
        cost, np.zeros(m + k), sparse.csc_array(np.vstack(rows)), np.concatenate(right), kinds,
        settings,
    ).solve()  # fmt: skip
    return str(found.status), np.array(found.x)[m:]


# ---- random grasps, about half of which can do it ------------------------------------------------


def random_problem(rng):
    n = int(rng.integers(3, 7))
    kinds = rng.choice(KINDS[1:], n) if rng.random() < 0.7 else rng.choice(KINDS, n)
    models = [random_model(rng, str(kind)) for kind in kinds]
    contacts = random_contacts(rng, models)
    W = gf.grasp_map(contacts)
    if np.linalg.matrix_rank(W) < 6:  # out of reach is another verdict
        return random_problem(rng)
    J = finger_jacobian(
        rng,
        [model.dim for model in models],
        random_fingers(rng, n, rng.random() < 0.3),
        int(rng.integers(0, 2)),
    )
    strength = rng.uniform(0.2, 0.8, J.shape[1])
    options = {"J": J, "tau_lo": -strength, "tau_hi": strength * rng.uniform(0.5, 1.5)}
    if rng.random() < 0.3:
        options["tau_bias"] = 0.5 * strength * rng.uniform(-1, 1, len(strength))
    if rng.random() < 0.4:
        options |= {"c_max": rng.uniform(3, 12, n), "engagement": rng.uniform(0.3, 1, n)}
    if rng.random() < 0.2:
        options["c_min"] = rng.uniform(0.05, 0.6, n)
    if rng.random() < 0.2:
        dims = [model.dim for model in models]
        options["c_last"] = np.concatenate([np.eye(dim)[0] * rng.uniform(1, 5) for dim in dims])
        options["dc_max"] = rng.uniform(0.5, 5, W.shape[1])
    if rng.random() < 0.2:
        options |= {"A": rng.normal(size=(2, W.shape[1])), "b": rng.uniform(-1, 10, 2)}
    direction = rng.normal(size=6) * [1, 1, 1, 0.02, 0.02, 0.02]
    f = np.exp(rng.uniform(0, 4)) * direction
    return gf.ForceProblem(W, f, models, alpha=10 ** rng.uniform(-1, 2), **options)
