"""
How far can a quadruped lean?
=============================

*For people with legged robots.* The ground pushes on feet as fingers push on an object. For every
place of the centre of mass above four feet on uneven ground: can the feet hold it, and how much
room have they before one slips?
"""

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

# %%
# One foot stands on a ramp, whose normal leans inwards.

tilted = np.array([-0.4, -0.3, 1.0])
normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), tilted / np.linalg.norm(tilted)]
places = [(-0.3, -0.15, 0), (-0.3, 0.15, 0), (0.3, -0.15, 0), (0.3, 0.15, 0.05)]
feet = [gf.Contact(p, n, gf.PCWF(mu=0.5)) for p, n in zip(places, normals, strict=True)]

# %%
# Only f changes from place to place: the wrench about one origin of the weight at the centre of
# mass. A Servo solves one after the other.

weight = 30 * 9.81
x, y = np.linspace(-0.36, 0.36, 49), np.linspace(-0.21, 0.21, 29)
problem = gf.Grasp(feet).problem(f=[0, 0, weight, 0, 0, 0], c_max=300)
servo = gf.Servo(problem)
room = np.full((len(y), len(x)), np.nan)
for i, j in np.ndindex(room.shape):
    sol = servo.step(f=np.array([0, 0, weight, y[i] * weight, -x[j] * weight, 0]))
    if sol.status is gf.Status.SOLVED:
        room[i, j] = sol.friction_margins.min()

figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
mesh = axes.pcolormesh(x, y, room, cmap="viridis")
figure.colorbar(mesh, label="least friction margin [N]")
axes.plot(*np.array(places)[:, :2].T, "s", color="#d55e00", markersize=9, label="feet")
axes.set(xlabel="x of the centre of mass [m]", ylabel="y [m]", aspect="equal")
axes.legend(loc="upper center")

# %%
# White is proved impossible: each of those ticks has a certificate.

sol = gf.solve(problem.replace(f=[0, 0, weight, 0.2 * weight, 0, 0]))
print(sol.status, sol.certificate.proves_infeasible(sol.problem))
