r"""
A thousand grasps, refined by gradients through the forces
==========================================================

*For people who plan or learn grasps.* Needs ``pip install '.[sim]'``.

The fingertips of an Allegro hand touch ellipsoids of a thousand shapes, somewhere. They slide, and
the joints follow them, so that the smallest slip margin of the best forces rises. How forces and
margins follow the grasp maps W and the Jacobians J, :func:`graspforce.sensitivity` says exactly,
for all grasps at once; how W and J follow the fingertips is geometry.
"""

import matplotlib.pyplot as plt
import numpy as np

import graspforce as gf
from graspforce import sim

FINGERS = ("index", "middle", "ring", "thumb")
COUNT, MU, LIMIT, MASS = 1000, 0.6, 0.7, 0.2  # grasps, friction, [N·m], [kg]

# %%
# The hand: the chains of its four fingers, from its model in MuJoCo, in the palm's axes. A column
# of J is a joint's axis times the arm from the joint to the contact.

model = sim.hand_model("allegro")
tips = [model.geom(f"{finger}_tip") for finger in FINGERS]
TIP = np.array([tip.pos for tip in tips])
RADIUS = tips[0].size[0]
joints = [[model.joint(f"{finger}_{i}") for i in range(4)] for finger in FINGERS]
AXES = np.array([[joint.axis for joint in finger] for finger in joints])
RANGE = np.array([[joint.range for joint in finger] for finger in joints])
BASE = np.array([model.body(f"{finger}_base").pos for finger in FINGERS])
LINKS = np.array([[model.body(int(joint.bodyid[0])).pos for joint in finger] for finger in joints])
TURNED = np.array([np.eye(3)] * 3 + [[[0, 0, 1], [0, 1, 0], [-1, 0, 0]]])  # the thumb's base


def turns(axis, angle):
    """Rotation matrices about unit axes, shape (…, 3, 3)."""
    K = np.cross(np.eye(3), axis[..., None, :])
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + s * K + (1 - c) * (K @ K)


def kinematics(q):
    """Tips' centres (B, 4, 3), and places and axes of the joints (B, 4, 4, 3), at angles q."""
    R, p = np.broadcast_to(TURNED, (len(q), 4, 3, 3)), np.broadcast_to(BASE, (len(q), 4, 3))
    places, axes = np.empty((2, len(q), 4, 4, 3))
    for i in range(4):
        p = p + (R @ LINKS[:, i, :, None])[..., 0]
        places[:, :, i], axes[:, :, i] = p, (R @ AXES[:, i, :, None])[..., 0]
        R = R @ turns(AXES[:, i], q[..., i])
    return p + (R @ TIP[..., None])[..., 0], places, axes


def columns(at, places, axes):
    """How points at the tips move with the joints, shape (B, 4, 3, 4)."""
    return np.swapaxes(np.cross(axes, at[:, :, None] - places), -1, -2)


# %%
# The objects: x = centre + half·s for unit vectors s. A tip's centre is one radius off the surface;
# the joints follow it there by Newton's method, the shortest way.


def surface(s, half):
    """Contact points relative to the centre, and normals inwards, each (B, 4, 3)."""
    inwards = -s / half
    return half * s, inwards / np.linalg.norm(inwards, axis=-1, keepdims=True)


def follow(s, half, q, steps):
    """Joint angles whose tips touch the surface at s, and how far off they are [m]."""
    x, normal = surface(s, half)
    for _ in range(steps):
        centre, places, axes = kinematics(q)
        missing = (CENTRE + x - RADIUS * normal - centre)[..., None]
        Jt = columns(centre, places, axes)
        weight = Jt @ np.swapaxes(Jt, -1, -2) + 1e-9 * np.eye(3)
        q = q + (np.swapaxes(Jt, -1, -2) @ np.linalg.solve(weight, missing))[..., 0]
    off = CENTRE + x - RADIUS * normal - kinematics(q)[0]
    return q, np.abs(off).max(axis=(1, 2))


def frames(normal):
    """Contact frames [normal, x, y], whose x turns with the normal as little as it can."""
    x = np.cross(normal, [0.0, 1.0, 0.0]) + 1e-3 * np.cross(normal, [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack((normal, x, np.cross(normal, x)), axis=-1)  # (B, 4, 3, 3)


def grasp(s, half, q):
    """W (B, 6, 12) about the object's centre, and J (B, 12, 16)."""
    x, normal = surface(s, half)
    R = frames(normal)
    torque = np.cross(x[..., None], R, axis=-2)
    W = np.concatenate((R, torque), axis=-2).transpose(0, 2, 1, 3).reshape(len(s), 6, 12)
    _, places, axes = kinematics(q)
    by_finger = np.swapaxes(R, -1, -2) @ columns(CENTRE + x, places, axes)
    J = np.zeros((len(s), 4, 3, 4, 4))
    for i in range(4):
        J[:, i, :, i] = by_finger[:, i]
    return W, J.reshape(len(s), 12, 16)


# %%
# The forces of all grasps, and the smallest of their slip margins. Its gradient by W and J comes
# back from the forces; that of one finger by its two ways to slide is a difference of W and J, of
# which only this finger's columns change: all fingers are moved together.

WEIGHT = np.array([0, 0, 9.81 * MASS, 0, 0, 0])
OPTIONS = {"models": gf.PCWF(MU), "tau_lo": -LIMIT, "tau_hi": LIMIT}


def slip(s, half, q):
    """Solve all; return the batch and each grasp's smallest slip margin [N], 0 for a failure."""
    W, J = grasp(s, half, q)
    batch = gf.solve_batch(W, WEIGHT, J=J, **OPTIONS)
    return batch, np.where(batch.solved, batch.friction_margins.min(axis=1), 0.0)


def slopes(s, half, q, batch, step=1e-5):
    """Change of a smooth least margin with the two ways of each fingertip, (B, 4, 2), and those."""
    margins = np.where(batch.solved[:, None], batch.friction_margins, 0.0)
    soft = np.exp(-8 * (margins - margins.min(axis=1, keepdims=True)))
    back = gf.sensitivity(batch).vjp(
        wrt=("W", "J"), friction_margins=soft / soft.sum(axis=1, keepdims=True)
    )
    ways = frames(s)[..., 1:]  # (B, 4, 3, 2), across s
    result = np.empty((*s.shape[:2], 2))
    for k in range(2):
        change = {"W": 0.0, "J": 0.0}
        for sign in (1, -1):
            there = s + sign * step * ways[..., k]
            there /= np.linalg.norm(there, axis=-1, keepdims=True)
            moved = grasp(there, half, follow(there, half, q, 1)[0])
            for name, value in zip(("W", "J"), moved, strict=True):
                change[name] = change[name] + sign * value / (2 * step)
        by_W = (back["W"] * change["W"]).sum(axis=1)
        by_J = (back["J"] * change["J"]).sum(axis=2)
        result[..., k] = (by_W + by_J).reshape(len(s), 4, 3).sum(axis=2)
    return result, ways


# %%
# Random ellipsoids, and fingertips anywhere near where the hand would close. The first thousand
# grasps that the fingers can reach and that hold are those to refine.

rng = np.random.default_rng(0)
STANCE = np.array([[0, 0.35, 1.0, 0.95]] * 3 + [[0, 0, -0.1, 0.7]])
around = kinematics(STANCE[None])[0][0]
CENTRE = (around[:3].mean(axis=0) + around[3]) / 2
half = np.array([0.026, 0.055, 0.024]) * rng.uniform(0.85, 1.15, (3 * COUNT, 1, 3))
s = (around - CENTRE) / half
s = s / np.linalg.norm(s, axis=-1, keepdims=True) + 0.25 * rng.normal(size=s.shape)
s /= np.linalg.norm(s, axis=-1, keepdims=True)


def reached(q, off):
    """Whether all tips touch, with the joints inside their ranges."""
    return (off < 1e-9) & ((q > RANGE[..., 0]) & (q < RANGE[..., 1])).all(axis=(1, 2))


q, off = follow(s, half, np.tile(STANCE, (len(s), 1, 1)), 12)
batch, margin = slip(s, half, q)
chosen = np.flatnonzero(reached(q, off) & batch.solved)[:COUNT]
s, half, q = s[chosen], half[chosen], q[chosen]
batch, margin = slip(s, half, q)
before = s, q, batch, margin

# %%
# Every grasp climbs with a step of its own: longer after a gain, half after none. What does not
# hold, cannot be reached or gains nothing is not taken.

length = np.full((len(s), 1, 1), 0.1)  # of a step on the unit sphere
history = [margin]
for _ in range(25):
    slope, ways = slopes(s, half, q, batch)
    size = np.linalg.norm(slope, axis=(1, 2), keepdims=True)
    there = s + (ways @ (length * slope / (size + 1e-12))[..., None])[..., 0]
    there /= np.linalg.norm(there, axis=-1, keepdims=True)
    moved, off = follow(there, half, q, 4)
    _, now = slip(there, half, moved)
    better = (reached(moved, off) & (now > margin))[:, None, None]
    s, q = np.where(better, there, s), np.where(better, moved, q)
    length = np.where(better, 1.3, 0.5) * length
    batch, margin = slip(s, half, q)
    history.append(margin)


# %%
# Another judge: what the grasps could carry, by bisection over all at once; each "no" is proved.


def payload(s, q):
    """Largest load along the weight that torques and friction bear, shape (B,) [N]."""
    W, J = grasp(s, half, q)
    low, high = np.zeros((len(s), 1)), np.full((len(s), 1), 60.0)
    for _ in range(10):
        load = (low + high) / 2
        held = gf.solve_batch(W, load * WEIGHT / WEIGHT[2], J=J, **OPTIONS).solved[:, None]
        low, high = np.where(held, load, low), np.where(held, high, load)
    return low[:, 0]


carried = payload(*before[:2]), payload(s, q)
for name, (old, new) in {"slip margin": (history[0], margin), "payload": carried}.items():
    print(
        f"{name}, median: {np.median(old):.2f} -> {np.median(new):.2f} N; "
        f"larger in {np.mean(new > old):.0%} of {len(s)} grasps"
    )

# %%
# Before and after: how the margins have moved, and the grasp that gained most.

figure = plt.figure(figsize=(10, 7.5), layout="constrained")
top, bottom = figure.subfigures(2, 1, height_ratios=(1, 1.7))
left, right = top.subplots(1, 2)
bins = np.linspace(0, np.quantile(margin, 0.999), 40)
left.hist(history[0], bins, alpha=0.8, color="#b3261e", label="before")
left.hist(margin, bins, alpha=0.6, color="#1f5a92", label="after")
left.set(xlabel="smallest slip margin [N]", ylabel="grasps")
left.legend()
for share in (0.1, 0.5, 0.9):
    right.plot(np.quantile(history, share, axis=1), label=f"{share:.0%} of the grasps are below")
right.set(xlabel="step", ylabel="smallest slip margin [N]")
right.legend()

most = int(np.argmax(margin - history[0]))
u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 40), np.linspace(0, np.pi, 20))
ball = np.stack((np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)))
skin = CENTRE[:, None, None] + half[most, 0][:, None, None] * ball
pictures = bottom.subplots(1, 2, subplot_kw={"projection": "3d"})
for axes, (at, angles, forces, least), name in zip(
    pictures, (before, (s, q, batch, margin)), ("before", "after"), strict=True
):
    axes.plot_surface(*skin, color="#6b7785", alpha=0.25, linewidth=0)
    x, normal = surface(at, half)
    tip, places, _ = kinematics(angles)
    world = frames(normal)[most] @ forces.c[most].reshape(4, 3, 1)
    for i in range(4):
        chain = np.concatenate((places[most, i], tip[most, i][None]))
        axes.plot(*chain.T, "o-", color="#1f5a92", markersize=3)
        start = CENTRE + x[most, i]
        axes.plot(*np.transpose([start - 0.004 * world[i, :, 0], start]), color="#b3261e")
    axes.set(title=f"{name}: smallest slip margin {least[most]:.2f} N", xlabel="x [m]")
    axes.set_box_aspect((1, 1, 1))
    axes.locator_params(nbins=4)
    axes.set(xlim=(-0.02, 0.14), ylim=(-0.08, 0.08), zlim=(-0.07, 0.09))
    axes.view_init(elev=15, azim=-65)
