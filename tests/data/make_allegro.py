"""Make allegro.npz: a few grasps of the data set that README.md names, with new references.

The references are made without graspforce's solvers: by Clarabel, and by Newton's method in the
null space of W. ``python tests/data/make_allegro.py ALL.npz`` from the project's root.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from baseline_oracles import limits, socp

import graspforce as gf

# The two that cannot be held, those that pyramids in the cones' place lose in some direction, the
# heaviest and the lightest object, firm and light grips.
KEPT = [0, 5, 6, 8, 27, 35, 89, 106, 116, 145, 148, 187]
MU = 0.5


def least_barrier(problem, c):
    """The minimiser of Phi from a point inside all limits; point contacts of friction MU."""
    N = np.linalg.svd(problem.W)[2][np.linalg.matrix_rank(problem.W) :].T
    A, b = limits(problem)
    signs = np.array([MU**2, -1.0, -1.0])

    def cones(c):
        return (signs * c.reshape(-1, 3) ** 2).sum(axis=1)

    def phi(c):
        inside = (cones(c) > 0).all() and (c[::3] > 0).all() and (b - A @ c > 0).all()
        barrier = -np.log(cones(c)).sum() - problem.alpha * np.log(b - A @ c).sum() if inside else 0
        return barrier if inside else np.inf

    for _ in range(200):
        r = 1 / (b - A @ c)
        gradient = problem.alpha * A.T @ r
        hessian = problem.alpha * (A.T * r**2) @ A
        for i, g in enumerate(cones(c)):
            part = slice(3 * i, 3 * i + 3)
            Dc = signs * c[part]
            gradient[part] -= 2 * Dc / g
            hessian[part, part] += 4 * np.outer(Dc, Dc) / g**2 - 2 * np.diag(signs) / g
        step = -N @ np.linalg.solve(N.T @ hessian @ N, N.T @ gradient)
        if np.abs(step).max() < 1e-10:
            return c + step
        share = 1.0
        while phi(c + share * step) > phi(c) + 0.1 * share * gradient @ step:
            share /= 2
            if share < 1e-12:
                raise ArithmeticError(f"no descent along a step of {np.abs(step).max()} N")
        c = c + share * step
    raise ArithmeticError("Newton's method does not end")


def main(source):
    with np.load(source) as data:
        found = {name: data[name][KEPT] for name in ("object", "W", "J", "f", "mu")}
        found["tau_limit"] = data["tau_limit"]
    assert (found["mu"] == MU).all()
    status, least, minimisers = [], [], {1: [], 5: []}
    for W, J, f in zip(found["W"], found["J"], found["f"], strict=True):
        limit = found["tau_limit"]
        problem = gf.ForceProblem(W, f, gf.PCWF(MU), J=J, tau_lo=-limit, tau_hi=limit)
        distance, inside = socp(problem, "distance")
        feasible = distance > 0
        status.append("Solved" if feasible else "PrimalInfeasible")
        least.append(socp(problem, "normal")[0] if feasible else np.nan)
        for alpha, forces in minimisers.items():
            given = problem.replace(alpha=alpha)
            forces.append(least_barrier(given, inside) if feasible else np.full(problem.m, np.nan))
    found |= {"ref_status": status, "ref_min_max_normal": least}
    found |= {f"wbf_c_alpha{alpha}": forces for alpha, forces in minimisers.items()}
    np.savez_compressed(Path(__file__).with_name("allegro.npz"), **found)


if __name__ == "__main__":
    main(sys.argv[1])
