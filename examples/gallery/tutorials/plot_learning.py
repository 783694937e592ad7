r"""
A policy that learns how firmly to grip
=======================================

*For people who train policies and want the contact forces inside.* Needs NumPy and Matplotlib
alone. A small network sees a load and chooses :math:`\alpha`, how firmly three fingers hold a ball;
the forces come from the solver, and what they cost is led back through it, exactly. In PyTorch and
JAX the solver is a layer: :doc:`../../do/learn`.

The task
--------

The ball's weight and a load from the side vary. Whatever they are, the largest normal force shall
be near 4 N: enough for what one does not know, and no bruise.
"""

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf

rng = np.random.default_rng(0)
angles = np.radians([0, 120, 240])
outwards = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
soft = gf.PCWF(mu=0.8)
W = gf.grasp_map([gf.Contact(0.04 * out, -out, soft) for out in outwards])


def loads(count):
    """Return wrenches to exert, shape (count, 6) [N, N·m]."""
    f = np.zeros((count, 6))
    f[:, 2] = rng.uniform(1, 3, count)
    f[:, 0] = rng.normal(0, 0.25, count)
    return f


# %%
# No single alpha does it: what is firm for a light ball is light for a heavy one.

f = loads(400)
figure, axes = plt.subplots(figsize=(7, 3.4), layout="constrained")
for alpha in (0.3, 1.0, 3.0):
    batch = gf.solve_batch(W, f, soft, c_max=10, alpha=alpha)
    axes.plot(f[:, 2], batch.normal_forces.max(axis=1), ".", markersize=3, label=f"alpha {alpha}")
axes.axhline(4, color="#b3261e", linestyle="--")
axes.set(xlabel="weight [N]", ylabel="largest normal force [N]")
axes.legend()

# %%
# A layer that is a solver
# ------------------------
#
# Forward: all rows at once by ``solve_batch``. Backward: ``sensitivity(batch).vjp`` takes the
# gradient of the loss by the forces and returns it by any argument, here by alpha. Against a
# difference quotient:


def grip(f, alpha):
    """Return the largest normal forces, shape (B,), and a function for the way back."""
    batch = gf.solve_batch(W, f, soft, c_max=10, alpha=alpha)
    assert batch.solved.all()
    finger = batch.normal_forces.argmax(axis=1)
    rows = np.arange(len(f))

    def back(gradient):
        by_c = np.zeros_like(batch.c)
        by_c[rows, 3 * finger] = gradient
        return gf.sensitivity(batch).vjp(c=by_c)["alpha"]

    return batch.normal_forces[rows, finger], back


some, at = f[:5], np.full(5, 2.0)
exact = grip(some, at)[1](np.ones(5))
quotient = (grip(some, at + 1e-3)[0] - grip(some, at - 1e-3)[0]) / 2e-3
print("largest difference:", f"{np.abs(exact - quotient).max():.0e} N")

# %%
# Training
# --------
#
# A network with one hidden layer gives the logarithm of alpha. Its gradient is the chain rule; Adam
# does the rest.

weights = {
    "A": rng.normal(0, 0.5, (2, 16)),
    "a": np.zeros(16),
    "B": np.zeros((16, 1)),
    "b": np.zeros(1),
}
moments = {name: (np.zeros_like(w), np.zeros_like(w)) for name, w in weights.items()}
losses = []
for step in range(1, 151):
    seen = f[:, [2, 0]] - [2.0, 0.0]
    hidden = np.tanh(seen @ weights["A"] + weights["a"])
    alpha = np.exp(hidden @ weights["B"] + weights["b"])[:, 0]
    largest, back = grip(f, alpha)
    losses.append(np.mean((largest - 4) ** 2))
    by_log_alpha = (back(2 * (largest - 4) / len(f)) * alpha)[:, None]
    by_hidden = by_log_alpha @ weights["B"].T * (1 - hidden**2)
    gradient = {
        "A": seen.T @ by_hidden, "a": by_hidden.sum(axis=0),
        "B": hidden.T @ by_log_alpha, "b": by_log_alpha.sum(axis=0),
    }  # fmt: skip
    for name, (m, v) in moments.items():
        m += 0.1 * (gradient[name] - m)
        v += 0.001 * (gradient[name] ** 2 - v)
        scaled = np.sqrt(v / (1 - 0.999**step)) + 1e-8
        weights[name] -= 0.03 * m / (1 - 0.9**step) / scaled
print(f"loss {losses[0]:.2f} -> {losses[-1]:.4f} N²")

# %%
# What it has learned, on loads that it has not seen:

f = loads(400)
hidden = np.tanh((f[:, [2, 0]] - [2.0, 0.0]) @ weights["A"] + weights["a"])
alpha = np.exp(hidden @ weights["B"] + weights["b"])[:, 0]
largest, _ = grip(f, alpha)
print(f"off by {np.sqrt(np.mean((largest - 4) ** 2)):.3f} N (root mean square)")
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
left.semilogy(losses, color="#1f5a92")
left.set(xlabel="step", ylabel="loss [N²]")
right.plot(f[:, 2], largest, ".", markersize=3, color="#1f5a92")
right.axhline(4, color="#b3261e", linestyle="--")
right.set(xlabel="weight [N]", ylabel="largest normal force [N]", ylim=(3, 5))
