r"""
Learning where to touch
=======================

*For people who learn or plan grasps.* Phi at its minimum says how good a grasp is: large where it
is near slipping or near its limits. Its gradient by *any* number of the problem costs no further
solve. Where W depends on parameters p,

.. math:: \frac{\partial \Phi^*}{\partial p} = -\nu^T \frac{\partial W}{\partial p} c ,

since :math:`\nabla\Phi = W^T \nu` at the optimum. Here the parameters are the places of three
fingers on an ellipse, and gradient descent finds better ones.
"""

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

soft = gf.SFC(mu=0.5, gamma=0.01)
half = np.array([0.06, 0.03])  # of the ellipse's axes [m]


def contacts(angles):
    """Return fingers at those angles on the ellipse, normals inwards."""
    found = []
    for angle in angles:
        out = np.array([np.cos(angle), np.sin(angle)])
        normal = -(out / half) / np.linalg.norm(out / half)
        found.append(gf.Contact((*(half * out), 0), (*normal, 0), soft, tangent=(0, 0, 1)))
    return found


# %%
# The wrench: its weight upwards, and a twist. ``tangent`` keeps the contact frames from jumping.

f = [0, 0, 2.0, 0, 0, 0.02]
angles = np.radians([10.0, 100.0, 230.0])
start = angles.copy()
history = []
for _ in range(60):
    sol = gf.solve(gf.ForceProblem(gf.grasp_map(contacts(angles)), f, soft, c_max=10))
    sol.raise_if_failed()
    history.append(sol.phi)
    gradient = np.empty(3)
    for finger in range(3):
        step = 1e-6 * np.eye(3)[finger]
        dW = (gf.grasp_map(contacts(angles + step)) - gf.grasp_map(contacts(angles - step))) / 2e-6
        gradient[finger] = -sol.nu @ dW @ sol.c
    angles -= 0.02 * gradient / max(1.0, np.linalg.norm(gradient))
print(f"Phi* {history[0]:.2f} -> {history[-1]:.2f}; fingers at {np.degrees(angles).round(0)}°")

# %%
# The fingers have spread, and the two that were on one side no longer crowd.

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
around = np.linspace(0, 2 * np.pi, 200)
left.plot(half[0] * np.cos(around), half[1] * np.sin(around), color="#6b7785")
for where, colour, label in ((start, "#b3261e", "before"), (angles, "#1f5a92", "after")):
    left.plot(half[0] * np.cos(where), half[1] * np.sin(where), "o", color=colour, label=label)
    for contact in contacts(where):
        tail = np.subtract(contact.point, 0.02 * np.asarray(contact.normal))
        left.annotate(
            "", contact.point[:2], tail[:2], arrowprops={"arrowstyle": "->", "color": colour}
        )
left.set(xlim=(-0.085, 0.085), ylim=(-0.055, 0.055), aspect="equal", xlabel="x [m]", ylabel="y [m]")
left.legend()
right.plot(history, color="#1f5a92")
right.set(xlabel="step", ylabel="Phi at its minimum")
