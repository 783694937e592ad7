"""
A finger lets go and comes back
===============================

*For people whose fingers step.* The paper's circle with finger 1 away from 0.5 s to 1.5 s (Section
IV-B.2), with the straight ramp of the paper and with a smooth one.
"""

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

figure, panes = plt.subplots(2, sharex=True, figsize=(7, 6), layout="constrained")
for axes, shape in zip(panes, ("linear", "smooth"), strict=True):
    scenario = gf.scenarios.get("regrasp", shape=shape)
    servo = gf.Servo(scenario.problem(0.0))
    sols = [servo.step_to(problem) for problem in scenario.problems()]
    assert all(sol.status is gf.Status.SOLVED for sol in sols)
    axes.plot(scenario.times, np.array([sol.normal_forces for sol in sols]))
    axes.set(ylabel="normal force [N]", title=f"{shape} ramp")
    print(f"{shape}: {np.mean([sol.newton_steps for sol in sols]):.2f} Newton steps a tick")
panes[0].legend([f"finger {i}" for i in range(1, 5)], ncols=4)
panes[1].set_xlabel("time [s]")
