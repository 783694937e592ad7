"""
Three fingers on a ball
=======================

*For beginners.* Contacts, a problem, the forces, and a picture of them with their friction cones.
"""

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

radius = 0.04  # [m]
angles = np.radians([0, 120, 240])
outwards = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
contacts = [gf.Contact(radius * out, -out, gf.PCWF(mu=0.6)) for out in outwards]

# %%
# The ball weighs 250 g. The fingers have to give it that, upwards:

weight = 0.25 * 9.81
sol = gf.solve(gf.Grasp(contacts).problem(f=[0, 0, weight, 0, 0, 0], c_max=20), check=True)
print(sol.forces_world.round(2))

# %%
# An arrow is a finger's force on the ball, its head at the contact. It stays inside the cone around
# the normal.

figure = plt.figure(figsize=(6, 5))
axes = figure.add_subplot(projection="3d")
u, v = np.mgrid[0 : 2 * np.pi : 40j, 0 : np.pi : 20j]
ball = radius * np.array([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
axes.plot_surface(*ball, color="#dfe7ee", alpha=0.5, linewidth=0)

turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 30), [0.0, 0.03])
for contact, force in zip(contacts, sol.forces_world, strict=True):
    out = -np.asarray(contact.normal)
    side = np.cross(out, (0, 0, 1))
    ring = np.multiply.outer(np.cos(turn), side) + np.multiply.outer(np.sin(turn), (0, 0, 1))
    cone = np.asarray(contact.point) + height[..., None] * (out + contact.model.mu * ring)
    axes.plot_surface(*np.moveaxis(cone, -1, 0), color="#0072b2", alpha=0.2, linewidth=0)
    scale = 0.008  # [m/N]
    axes.quiver(*(contact.point - scale * force), *(scale * force), color="#d55e00", linewidth=2)
axes.set_box_aspect((1, 1, 0.6))
axes.set(xlim=(-0.08, 0.08), ylim=(-0.08, 0.08), zlim=(-0.048, 0.048))
axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
axes.locator_params(nbins=5)
