"""A section through a friction cone: forces that hold, and one that slips."""

import matplotlib.pyplot as plt
import numpy as np

MU = 0.6
figure, axes = plt.subplots(layout="constrained")
n = np.array([0.0, 7.0])
axes.fill_between(n, -MU * n, MU * n, color="#cfe3f5")
axes.plot(n, MU * n, n, -MU * n, color="#1f5a92")
for force, margin, colour in (
    ((4.0, 1.0), "1.4 N before it slips", "#1f5a92"),
    ((2.0, 2.0), "slips", "#b3261e"),
):
    axes.annotate("", force, (0, 0), arrowprops={"arrowstyle": "->", "color": colour, "lw": 2})
    axes.annotate(margin, force, (6, 3), textcoords="offset points", color=colour)
axes.annotate("µ · normal", (5, 5 * MU), (-60, 4), textcoords="offset points", color="#1f5a92")
axes.set(xlabel="normal force [N]", ylabel="tangential force [N]", xlim=(0, 7), ylim=(-3, 3.4))
