"""
The workspace of a cable robot
==============================

*For people with cable-driven robots.* Eight cables hold a platform; a cable pulls with at least 5 N
and at most 300 N. Where can the platform be, and how far from slack and from the limit are the
cables there?
"""

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

# %%
# A cable is a frictionless contact whose normal points the way it pulls.

winches = np.array([(x, y, z) for x in (-2, 2) for y in (-1.5, 1.5) for z in (0, 2)], float)
corners = 0.1 * np.sign(winches - [0, 0, 1]) * [1, 1, -1]  # crossed, so they can also turn it


def cable_map(centre):
    """Return W of all cables with the platform's centre there."""
    pulls = winches - (centre + corners)
    pulls /= np.linalg.norm(pulls, axis=1)[:, None]
    cables = [gf.Contact(centre + a, p, gf.FPC()) for a, p in zip(corners, pulls, strict=True)]
    return gf.grasp_map(cables, origin=centre)


weight = [0, 0, 10 * 9.81, 0, 0, 0]
x, z = np.linspace(-1.9, 1.9, 51), np.linspace(0.1, 2.2, 31)
problem = gf.ForceProblem(cable_map(np.array([0, 0, 1.0])), weight, gf.FPC(), c_min=5, c_max=300)
servo = gf.Servo(problem)
reserve = np.full((len(z), len(x)), np.nan)
for i, j in np.ndindex(reserve.shape):
    sol = servo.step(W=cable_map(np.array([x[j], 0, z[i]])))
    if sol.status is gf.Status.SOLVED:
        reserve[i, j] = min((sol.c - 5).min(), (300 - sol.c).min())

figure, axes = plt.subplots(figsize=(7, 4.4), layout="constrained")
mesh = axes.pcolormesh(x, z, reserve, cmap="viridis")
figure.colorbar(mesh, label="distance to slack or limit [N]")
axes.plot(*winches[:, [0, 2]].T, "s", color="#d55e00", label="winches")
axes.set(xlabel="x of the platform [m]", ylabel="z [m]", aspect="equal")
axes.legend(loc="upper left", bbox_to_anchor=(0, -0.15))
