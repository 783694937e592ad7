"""
Two hands on one box
====================

*For people with such a hand.* Needs ``pip install '.[sim]'``.

Two flat hands on gantries, with velocity servos along the slides and torque motors at the
wrists, press on a box from both sides.

The hand closes on 0.2 kg, holds it, moves it, and holds it again.
"""

import matplotlib.pyplot as plt

from graspforce import sim

model = sim.hand_model("two_hands")  # or sim.load("your_scene.xml")
(trial,) = sim.own(model, "object", move=(0, 0, 0.02), turn=20, duration=1.2)
log = sim.run(trial)
print(
    log.verdict,
    f"within {1e3 * log.position_error.max():.2f} mm, slip {1e3 * log.slip.max():.2f} mm",
)

largest = log.normal_force.max(axis=1)  # of the contacts in each tick
print(f"largest normal force {largest[-1]:.1f} N, torque {100 * log.torque_use:.0f} % of the limit")
plt.figure(figsize=(6.4, 4.8), layout="constrained")
plt.imshow(sim.picture(trial, log, 1.0))
plt.axis("off")
