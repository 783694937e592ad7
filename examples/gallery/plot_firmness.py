"""
Firm or light
=============

*For people who have to choose alpha.* The paper's grasp of a cube (Section IV-A), for every alpha
from 0.01 to 100: what a firm grip costs the motors, and what a light one costs in safety.
"""

import matplotlib.pyplot as plt

import graspforce as gf

sweep = gf.scenarios.sweep_alpha()

figure, axes = plt.subplots(figsize=(7, 3.4), layout="constrained")
axes.semilogx(sweep.alpha, sweep.normal_forces)
axes.set(xlabel="alpha", ylabel="normal force [N]")
axes.legend([f"finger {i}" for i in range(1, 5)])

# %%
# The reserve against slipping falls with alpha, and that of the motors rises (Fig. 5 of the paper).

figure, axes = plt.subplots(figsize=(7, 3.4), layout="constrained")
slip, torque = sweep.friction_residual, sweep.torque_residual
axes.semilogx(sweep.alpha, slip / slip.max(), label="slipping")
axes.semilogx(sweep.alpha, torque / torque.max(), label="torque")
axes.set(xlabel="alpha", ylabel="reserve, share of the largest")
axes.legend()
