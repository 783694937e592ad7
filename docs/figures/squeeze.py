"""Phi of a pinch over its squeeze, for three values of alpha, and where gf.solve ends up."""

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

WEIGHT, MU, C_MAX = 2.0, 0.5, 10.0
contacts = [gf.Contact((x, 0, 0), (-x, 0, 0), gf.PCWF(MU)) for x in (-1, 1)]
problem = gf.Grasp(contacts).problem(f=[0, 0, WEIGHT, 0, 0, 0], c_max=C_MAX)

figure, axes = plt.subplots(layout="constrained")
squeeze = np.linspace(WEIGHT / 2 / MU, C_MAX, 400)[1:-1]
c = np.tile(gf.solve(problem).c, (len(squeeze), 1))  # the squeeze is all that is free
c[:, [0, 3]] = squeeze[:, None]
for alpha, colour in ((0.3, "#b3261e"), (1.0, "#1f5a92"), (5.0, "#2e7d32")):
    now = problem.replace(alpha=alpha)
    phi, best = gf.equations.objective(c, now.barriers), gf.solve(now)
    axes.plot(squeeze, phi - best.phi, color=colour, label=f"alpha = {alpha:g}")
    axes.plot(best.normal_forces[0], 0, "o", color=colour)
axes.axvspan(0, squeeze[0], color="#eeeeee")
axes.axvspan(C_MAX, 11, color="#eeeeee")
axes.text(0.2, 5.2, "slips")
axes.text(10.05, 5.2, "crushes")
axes.set(xlabel="squeeze [N]", ylabel="Phi − its minimum", xlim=(0, 11), ylim=(-0.3, 6))
axes.legend(loc="upper center")
