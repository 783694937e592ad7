r"""
The paper in one notebook
=========================

*For readers of the paper*, "Weighted Barrier Functions for Computation of Force Distributions with
Friction Cone Constraints" (Borgstrom, Batalin, Sukhatme, Kaiser). Its sections, in code.

II. The problem
---------------

Contact forces :math:`c` give the object the wrench :math:`f`, :math:`W c = f` (1), within torque
limits :math:`\tau^L \le J^T c \le \tau^U` (2) and friction cones
:math:`\mu c_{norm} \ge \sqrt{c_x^2 + c_y^2}` (3). Here is the paper's: a hand of four fingers with
three joints each, ±0.5 N·m, holding a cube of 250 g, :math:`\mu = 0.5`.
"""

# sphinx_gallery_thumbnail_number = 3
import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf
from graspforce import equations as eq

scenario = gf.scenarios.get("static")
problem = scenario.problem(0.0)
print(problem)

# %%
# III-A, III-B. Two barriers
# --------------------------
#
# :math:`\Phi_{lin}(x) = -\sum \ln(b - A x)_i` (6) goes to infinity at every linear limit, and
# :math:`\Phi_{soc}(c) = -\sum \ln(\mu_i^2 c_{i,norm}^2 - c_{i,x}^2 - c_{i,y}^2)` (9) at the
# friction cones. Along a straight line from the best forces to slipping:

sol = gf.solve(problem)
A, b = problem.linear_limits()
inwards = np.tile([-1.0, 0, 0], 4)  # every finger presses less
s = np.linspace(0, sol.friction_margins.min() / 0.5, 200)[:-1]
c = sol.c + s[:, None] * inwards
figure, axes = plt.subplots(figsize=(7, 3.4), layout="constrained")
axes.plot(s, eq.phi_soc(c, problem.cones), label="Phi_soc, Eq. (9)")
axes.plot(s, eq.phi_lin(c, A, b), label="Phi_lin, Eq. (6)")
axes.set(xlabel="every finger presses less by [N]", ylabel="barrier")
axes.legend()

# %%
# III-C. The weighted sum, and Newton's method
# --------------------------------------------
#
# :math:`\Phi = \Phi_{soc} + \alpha \Phi_{lin}` (16), over :math:`c = W^+ f + N \lambda` (17), by
# Newton's steps (21) with the derivatives (19). Each line below is one equation.

c_p, N = eq.particular_and_nullspace(problem.W, problem.f)  # (17)
lam = N.T @ (gf.solve(problem.replace(alpha=50.0)).c - c_p)  # a start inside the limits
decrements = []
for _ in range(7):
    gradient, hessian = eq.reduced_derivatives(c_p + N @ lam, N, problem.barriers)  # (19)
    step = eq.newton_step(gradient, hessian)  # (21)
    decrements.append(np.sqrt(-gradient @ step))
    lam = lam + step
print("decrements", " ".join(f"{d:.0e}" for d in decrements[:6]))
print("the core's forces:", np.abs(c_p + N @ lam - sol.c).max() < 1e-6)

# %%
# IV-A. A static grasp: what alpha does (Fig. 4)
# ----------------------------------------------

sweep = gf.scenarios.sweep_alpha()
figure, axes = plt.subplots(figsize=(7, 3.4), layout="constrained")
axes.semilogx(sweep.alpha, sweep.normal_forces)
axes.set(xlabel="alpha", ylabel="normal force [N]")
axes.legend([f"finger {i}" for i in range(1, 5)])

# %%
# IV-B. A circle, and a finger that lets go (Fig. 6, 9, 12)
# ---------------------------------------------------------
#
# The cube goes round a circle in 2 s, at 250 Hz. With the last two optima extrapolated (III-C.5) a
# tick takes one Newton step; only while finger 1 leaves and comes back it takes more.

figure, panes = plt.subplots(3, sharex=True, figsize=(7, 7), layout="constrained")
for name, axes in zip(("dynamic", "regrasp"), panes, strict=False):
    log = gf.scenarios.run(gf.scenarios.get(name))
    axes.plot(log.t, log.normal_forces)
    axes.set(ylabel="normal force [N]", title=name)
panes[2].step(log.t, log.newton_steps, color="#1f2933")
panes[2].set(xlabel="time [s]", ylabel="Newton steps", title="regrasp")

# %%
# All figures of the paper, with its claims about them checked: ``graspforce reproduce``.
