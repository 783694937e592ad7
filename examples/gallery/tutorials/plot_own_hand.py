"""
Your own hand, from a URDF to a table of payloads
=================================================

*For people with a robot hand.* Needs ``pip install '.[pinocchio]' example-robot-data``. The Allegro
hand is read from its URDF, four fingers close around an object, and the forces show which joints
work hardest and how much the grasp can carry in each direction.
"""

from importlib import metadata

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

files = metadata.files("example-robot-data")
urdf = next(str(file.locate()) for file in files if file.name == "allegro_right_hand.urdf")
tips = [f"link_{k}.0_tip" for k in (3, 7, 11, 15)]
hand = gf.hands.from_urdf(urdf, fingertips=tips, tau_max=0.7)

# %%
# Joint angles go in by the names that the hand gives. The fingers flex, the thumb opposes them.

angle = {f"joint_{first + k}.0": a for first in (0, 4, 8) for k, a in enumerate((0, 0.9, 0.4, 0.4))}
angle |= {"joint_12.0": 1.35, "joint_13.0": 0.0, "joint_14.0": 0.7, "joint_15.0": 0.4}
q = [angle[name] for name in hand.joint_names]

points = hand.fingertip_positions(q)
centre = (points[:3].mean(axis=0) + points[3]) / 2
contacts = [
    gf.Contact(p, (centre - p) / np.linalg.norm(centre - p), gf.PCWF(mu=0.6)) for p in points
]
grasp = gf.Grasp(contacts, hand, q, origin=centre)

# %%
# The torques for a 200 g object, against the limit of 0.7 N·m. Grey is what the fingers take for
# their own weight.

sol = gf.solve(grasp.problem(f=[0, 0, 0.2 * 9.81, 0, 0, 0]), check=True)
figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
axes.bar(grasp.joint_names, sol.tau, color="#0072b2", label="to send")
axes.bar(grasp.joint_names, grasp.tau_bias, color="#b8c2cc", width=0.4, label="of its own weight")
axes.axhline(0.7, color="#b3261e", linestyle="--")
axes.axhline(-0.7, color="#b3261e", linestyle="--")
axes.tick_params(axis="x", rotation=90)
axes.set(ylabel="torque [N·m]")
axes.legend()

# %%
# How much can it carry in each direction? Bisect on the load; each "no" is proved.


def payload(direction):
    """Return the largest force along the direction that the grasp can give [N]."""
    low, high = 0.0, 100.0
    while high - low > 0.01:
        load = (low + high) / 2
        now = gf.solve(grasp.problem(f=[*(load * direction), 0, 0, 0]))
        low, high = (load, high) if now.status is gf.Status.SOLVED else (low, load)
    return low


turn = np.linspace(0, 2 * np.pi, 49)
figure, axes = plt.subplots(subplot_kw={"projection": "polar"}, figsize=(5, 5))
for names, (a, b) in {"x, y": (0, 1), "x, z": (0, 2), "y, z": (1, 2)}.items():
    directions = np.zeros((len(turn), 3))
    directions[:, a], directions[:, b] = np.cos(turn), np.sin(turn)
    axes.plot(turn, [payload(each) for each in directions], label=f"plane {names}")
axes.set_title("largest load [N]")
axes.legend(loc="lower left", bbox_to_anchor=(-0.15, -0.12))
