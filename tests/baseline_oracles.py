"""Other solvers for the objectives of the baselines, on cones and limits written down again."""

import clarabel
import numpy as np
from grasps import components, cone_matrix, plant
from scipy import optimize, sparse

import graspforce as gf


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


def socp(problem, objective):
    """Least Σ normal forces ("normals") or ‖c‖²/2 ("norm") by Clarabel's second-order cones."""
    parts = components(problem.models)
    A, b = limits(problem)
    out = removed_columns(problem)
    cones = []
    for model, part, here in zip(problem.models, parts, problem.engagement > 1e-6, strict=True):
        if here:
            M = np.zeros((model.dim, problem.m))
            M[:, part] = cone_matrix(model)
            cones.append(M)
    q, P = np.zeros(problem.m), np.zeros((problem.m, problem.m))
    if objective == "normals":
        q[[part.start for part in parts]] = 1.0
    else:
        P = np.eye(problem.m)
    rows = np.vstack([problem.W, out, A, *[-M for M in cones]])
    zeros = np.zeros(sum(len(M) for M in cones))
    right = np.concatenate([problem.f, np.zeros(len(out)), b, zeros])
    kinds = [clarabel.ZeroConeT(len(problem.f) + len(out)), clarabel.NonnegativeConeT(len(b))]
    kinds += [clarabel.SecondOrderConeT(len(M)) for M in cones]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(P), q, sparse.csc_matrix(rows), right, kinds, settings
    )
    found = solver.solve()
    assert str(found.status) == "Solved"
    return found.obj_val, np.array(found.x)


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
            det = s if d == 0 else s ** (d - 1) * (s**2 - sum(x**2 for x in t))
            total = total + c[part][0] - barrier * np.log(det)
    return total


def least_effort_and_barrier(problem, barrier):
    """The least of the above by SciPy's BFGS in the null space of W, from the WBF forces."""
    start = gf.solve(problem.replace(alpha=1.0), check=True).c
    fixed = np.vstack((problem.W, removed_columns(problem)))
    _, s, Vt = np.linalg.svd(fixed)
    N = Vt[(s > 1e-10 * s[0]).sum() :].T

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
