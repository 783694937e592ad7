"""The decrement after a full Newton step: the bound, and what the paper's circle shows."""

from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

before, after = [], []
problems = list(gf.scenarios.get("dynamic", duration=0.4).problems())
for last, now in pairwise(problems):
    # Newton's step from the last tick's optimum, in the reduced variables of Eq. (18).
    c_p, N = gf.equations.particular_and_nullspace(now.W, now.f)
    c = c_p + N @ (N.T @ (gf.solve(last).c - c_p))
    gradient, hessian = gf.equations.reduced_derivatives(c, N, now.barriers)
    step = gf.equations.newton_step(gradient, hessian)
    before.append(np.sqrt(-gradient @ step))
    gradient, hessian = gf.equations.reduced_derivatives(c + N @ step, N, now.barriers)
    after.append(np.sqrt(-gradient @ gf.equations.newton_step(gradient, hessian)))

figure, axes = plt.subplots(layout="constrained")
step = np.geomspace(1e-3, 0.5)
axes.loglog(step, (step / (1 - step)) ** 2, color="#1f5a92", label="bound (λ/(1 − λ))²")
axes.loglog(before, after, ".", color="#b3261e", label="the paper's circle, from the last optimum")
axes.set(xlabel="decrement λ of the step", ylabel="decrement after it")
axes.legend()
