"""Other solvers for the objectives of the baselines, on cones and limits written down again."""

import clarabel
import numpy as np
from grasps import components, cone_matrix, plant
from scipy import optimize, sparse

import graspforce as gf
from graspforce.baselines._pyramids import facet_rows


def limits(problem):
    """Every linear limit of the contacts in the grasp as rows A c ≤ b, from the definitions."""
    starts = [part.start for part in components(problem.models)]
    normals = np.eye(problem.m)[starts]
    there = problem.engagement > 1e-6
    rows = [problem.J.T, -problem.J.T]
    bounds = [problem.tau_hi - problem.tau_bias, problem.tau_bias - problem.tau_lo]
    if problem.c_max.size:
        rows.append(normals)
        bounds.append(problem.engagement * problem.c_max)
    if problem.c_min.size:
        rows.append(-normals)
        bounds.append(-problem.engagement * problem.c_min)
    A, b = np.vstack([*rows, problem.A]), np.concatenate([*bounds, problem.b])
    kept = np.repeat(there, [model.dim for model in problem.models])
    felt = (A[:, kept] != 0).any(axis=1)
    return A[felt] * kept, b[felt]


def removed_columns(problem):
    kept = np.repeat(problem.engagement > 1e-6, [model.dim for model in problem.models])
    return np.eye(problem.m)[~kept]


def socp(problem, objective, facets=None, inner=True):
    """The optimum of an objective under cones and limits, by Clarabel.

    Args:
        problem: what to solve.
        objective: Σ normal forces ("normals"), the largest one ("normal") or ‖c‖²/2 ("norm"), to
            be least; or the smallest distance to all limits ("distance"), to be most.
        facets: of pyramids in the cones' place.
        inner: pyramids inscribed in the cones rather than around them.

    Returns:
        its value, and the forces.
    """
    parts = components(problem.models)
    A, b = limits(problem)
    out = removed_columns(problem)
    m, there = problem.m, problem.engagement > 1e-6
    # Torsions count in units of gamma/mu in the length of a row.
    units = np.ones(m)
    flat, round_cones = [A], []
    for model, part, here in zip(problem.models, parts, there, strict=True):
        if not here:
            continue
        L = cone_matrix(model)
        units[part] = np.diag(L) / np.where(np.arange(model.dim) == 0, L[0, 0], 1)
        if facets is None:
            M = np.zeros((model.dim, m))
            M[:, part] = L
            round_cones.append((M, np.hypot(1, L[0, 0]) if model.dim > 1 else 1.0))
        else:
            rows = np.unique(facet_rows(model, facets, inner).round(12), axis=0)  # poles repeat
            M = np.zeros((len(rows), m))
            M[:, part] = rows
            flat.append(M)
    flat = np.vstack(flat)
    right = np.concatenate([b, np.zeros(len(flat) - len(b))])
    # One variable more, the largest normal force or the distance.
    q, P, last = np.zeros(m + 1), np.zeros((m + 1, m + 1)), np.zeros(len(flat))
    starts = np.array([part.start for part in parts])
    if objective == "normals":
        q[starts] = 1.0
    elif objective == "norm":
        P[:m, :m] = np.eye(m)
    elif objective == "distance":
        q[m], last = -1.0, np.linalg.norm(flat / units, axis=1)
    else:
        q[m] = 1.0
        flat, right = np.vstack([flat, np.eye(m)[starts]]), np.append(right, np.zeros(len(starts)))
        last = np.append(last, -np.ones(len(starts)))
    cones = []
    for M, length in round_cones:
        top = np.where(np.arange(len(M)) == 0, length if objective == "distance" else 0.0, 0.0)
        cones.append(np.column_stack([-M, top]))
    equations = np.vstack([problem.W, out, *([] if q[m] else [np.zeros((1, m))])])
    own = np.zeros(len(equations))
    if not q[m]:
        own[-1] = 1.0  # the variable has no part: zero
    rows = np.vstack([
        np.column_stack([equations, own]), np.column_stack([flat, last]), *cones,
    ])  # fmt: skip
    bounds = np.concatenate([
        problem.f, np.zeros(len(equations) - len(problem.f)), right,
        np.zeros(sum(map(len, cones))),
    ])  # fmt: skip
    kinds = [clarabel.ZeroConeT(len(equations)), clarabel.NonnegativeConeT(len(flat))]
    kinds += [clarabel.SecondOrderConeT(len(M)) for M in cones]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    for tol in (1e-10, 1e-9, 1e-8):  # a degenerate linear program ends a digit or two earlier
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tol
        found = clarabel.DefaultSolver(
            sparse.csc_array(P), q, sparse.csc_array(rows), bounds, kinds, settings
        ).solve()
        if str(found.status) == "Solved":
            break
    assert str(found.status) == "Solved"
    value = -found.obj_val if objective == "distance" else found.obj_val
    return value, np.array(found.x)[:m]


def lp_distance(solution, facets, cones):
    """The smallest distance of an answer to facets and limits, from the definitions."""
    problem, c = solution.problem, solution.c
    A, b = limits(problem)
    units = np.ones(problem.m)
    slacks = []
    for model, part, here in zip(
        problem.models, components(problem.models), problem.active, strict=True
    ):
        scale = np.diag(cone_matrix(model)).copy()
        scale[0] = 1.0
        units[part] = scale
        if here:
            rows = facet_rows(model, facets, cones == "inner")
            slacks.append(-rows @ c[part] / np.linalg.norm(rows / scale, axis=1))
    slacks.append((b - A @ c) / np.linalg.norm(A / units, axis=1))
    return np.concatenate(slacks).min()


def effort_and_barrier(problem, c, barrier):
    """Σ normal forces − barrier·ln det P, det P from its closed form s^(d−1)(s² − ‖t‖²)."""
    A, b = limits(problem)
    total = -barrier * np.log(b - A @ c).sum()
    for model, part, here in zip(
        problem.models, components(problem.models), problem.engagement > 1e-6, strict=True
    ):
        if here:
            s, *t = cone_matrix(model) @ c[part]
            d = len(t)
            if np.real(s) <= np.linalg.norm(np.real(t)):
                return np.inf  # two negative factors have a positive product
            det = s if d == 0 else s ** (d - 1) * (s**2 - sum(x**2 for x in t))
            total = total + c[part][0] - barrier * np.log(det)
    return total


def least_effort_and_barrier(problem, barrier):
    """The least of the above by SciPy's BFGS in the null space of W, from the WBF forces."""
    start = gf.solve(problem.replace(alpha=1.0), check=True).c
    fixed = np.vstack((problem.W, removed_columns(problem)))
    _, s, Vt = np.linalg.svd(fixed)
    N = Vt[(s > 1e-10 * s[0]).sum() :].T
    if not N.size:
        return effort_and_barrier(problem, start, barrier), start

    def value(x):
        with np.errstate(all="ignore"):
            found = effort_and_barrier(problem, start + N @ x, barrier)
        return found if np.isfinite(found) else np.inf

    def gradient(x):
        step = 1e-30j
        return np.array(
            [effort_and_barrier(problem, start + N @ (x + step * e), barrier).imag / 1e-30
             for e in np.eye(len(x))]
        )  # fmt: skip

    x = np.zeros(N.shape[1])
    for _ in range(3):  # BFGS stops where its line search meets the wall; start it again
        x = optimize.minimize(value, x, jac=gradient, method="BFGS", options={"gtol": 1e-9}).x
    return value(x), start + N @ x


def random_problems(rng, count):
    """Planted problems of all kinds: every contact model, ceilings, floors, removed contacts."""
    for i in range(count):
        kinds = rng.choice(["PCWF", "SFC", "FPC"], size=rng.integers(3, 7), p=[0.6, 0.3, 0.1])
        yield plant(
            rng,
            list(kinds),
            ceilings=bool(i % 2),
            floors=i % 5 == 0,
            inequalities=i % 3,
            bias=bool(i % 2),
            shared=i % 7 == 0,
            removed=0 if i % 6 == 5 else None,
        ).problem
