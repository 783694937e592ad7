"""Random hands of more motors than motions, and Clarabel's word on what they can hold.

A hand is written as MJCF: fingers of two or three hinges around an object, each driven in one of
the ways of :data:`DRIVES`. Clarabel has the force of every single motor, and those of the
couplings, as unknowns: nothing of ``graspforce.hands.transmission`` is in its problem. Tests and
``benchmarks/redundant_motors.py`` judge by it.
"""

from typing import NamedTuple

import clarabel
import mujoco
import numpy as np
from scipy import sparse

import graspforce as gf

# Below this share of a motor's half range, or of 1 N in a cone, nobody can tell which side of the
# edge a grasp is on.
EDGE = 1e-6


def antagonists(rng, joints):
    """A flexor and an extensor at every joint, which only pull."""
    arms = rng.uniform(0.004, 0.015, len(joints))
    rows = [np.eye(len(joints))[i] * arm for i, arm in enumerate(arms)]
    rows += [-np.eye(len(joints))[i] * arm * rng.uniform(0.5, 1) for i, arm in enumerate(arms)]
    return [(row, -rng.uniform(20, 80), 0.0) for row in rows], []


def n_plus_one(rng, joints):
    """One tendon more than joints, as in hands of the Stanford/JPL kind."""
    n = len(joints)
    while True:
        rows = rng.normal(size=(n, n)) * 0.008
        if np.linalg.cond(rows) < 20:
            break
    rows = [*rows, -rows.sum(axis=0) * rng.uniform(0.3, 1)]
    return [(row, -rng.uniform(20, 80), 0.0) for row in rows], []


def muscles(rng, joints):
    """Twice as many tendons as joints, any of them over any joints, which only pull."""
    n = len(joints)
    rows = rng.normal(size=(2 * n, n)) * 0.008 * (rng.random((2 * n, n)) < 0.7)
    rows[:n] += np.diag(np.full(n, 0.006))
    return [
        (row, -rng.uniform(20, 80), -rng.uniform(0, 1) * (rng.random() < 0.3)) for row in rows
    ], []


def two_motors(rng, joints):
    """A motor at every joint, and a tendon over all of them."""
    n = len(joints)
    torque = rng.uniform(0.05, 0.4)
    motors = [(np.eye(n)[i], -torque, torque) for i in range(n)]
    return [*motors, (rng.normal(size=n) * 0.01, -rng.uniform(2, 20), rng.uniform(2, 20))], []


def coupled(rng, joints):
    """The last joint follows the first, and both have a motor."""
    n = len(joints)
    motors = [(np.eye(n)[i], -rng.uniform(0.05, 0.3), rng.uniform(0.05, 0.3)) for i in range(n)]
    ratio = rng.uniform(0.5, 1.2)
    row = np.eye(n)[-1] - ratio * np.eye(n)[0]
    return motors, [(row, (joints[-1], joints[0], ratio))]


def plain(rng, joints):
    """A motor at every joint."""
    n, torque = len(joints), rng.uniform(0.05, 0.4)
    return [(np.eye(n)[i], -torque, torque) for i in range(n)], []


DRIVES = (antagonists, n_plus_one, muscles, two_motors, coupled, plain)


class RedundantHand(NamedTuple):
    """A hand's MJCF, and what holds for it beside what a reader makes of it."""

    xml: str
    tips: list[str]
    q: dict[str, float]
    R: np.ndarray
    """Torque of each joint by the force of each motor, shape (n_dofs, n_motors)."""
    lo: np.ndarray
    hi: np.ndarray
    couplings: np.ndarray
    """Joint motions with ``couplings @ dq != 0`` are impossible, shape (p, n_dofs)."""
    mu: float
    pulls: np.ndarray
    """What each contact pulls with, shape (n,) [N]."""


def random_hand(rng) -> RedundantHand:
    """Return a hand of three or four fingers, some of whose contacts may pull."""
    n = int(rng.integers(3, 5))
    bodies, tendons, actuators, equalities = [], [], [], []
    q, columns, los, his, couplings = {}, [], [], [], []
    sizes = [int(rng.integers(2, 4)) for _ in range(n)]
    dofs, first = sum(sizes), 0
    for i, size in enumerate(sizes):
        turn = 2 * np.pi * i / n + rng.normal() * 0.15
        joints = [f"j{i}{k}" for k in range(size)]
        axes = ["0 1 0", "0 1 0", "1 0 0"][:size]
        chain = f'<site name="tip{i}" pos="0 0 .04"/>'
        for name, axis in zip(reversed(joints), reversed(axes), strict=True):
            chain = (
                f'<body pos="0 0 .03"><joint name="{name}" axis="{axis}"/><geom type="capsule" '
                f'fromto="0 0 0 0 0 .03" size=".004" mass=".02"/>{chain}</body>'
            )
        bodies.append(
            f'<body pos="{0.06 * np.cos(turn)} {0.06 * np.sin(turn)} -.06" '
            f'euler="0 0 {np.degrees(turn) + 180}">{chain}</body>'
        )
        angles = dict(zip(joints, rng.uniform(0.05, 0.4, size), strict=True))
        motors, bonds = DRIVES[rng.integers(len(DRIVES))](rng, joints)
        for k, (row, lo, hi) in enumerate(motors):
            gear = float(rng.choice([-1, 1]) * rng.uniform(0.5, 3))
            ends = sorted((lo / gear, hi / gear))
            alone = np.flatnonzero(row)
            where = (
                f'joint="{joints[alone[0]]}"' if list(row[alone]) == [1.0] else f'tendon="t{i}{k}"'
            )
            if where.startswith("tendon"):
                parts = "".join(
                    f'<joint joint="{joint}" coef="{arm!r}"/>'
                    for joint, arm in zip(joints, row.tolist(), strict=True)
                    if arm
                )
                if not parts:
                    continue
                tendons.append(f'<fixed name="t{i}{k}">{parts}</fixed>')
            actuators.append(
                f'<motor {where} gear="{gear!r}" ctrllimited="true" '
                f'ctrlrange="{ends[0]!r} {ends[1]!r}"/>'
            )
            columns.append(np.concatenate((np.zeros(first), row, np.zeros(dofs - first - size))))
            los.append(lo)
            his.append(hi)
        for row, (follower, leader, ratio) in bonds:
            equalities.append(
                f'<joint joint1="{follower}" joint2="{leader}" polycoef="0 {ratio!r} 0 0 0"/>'
            )
            angles[follower] = ratio * angles[leader]
            couplings.append(np.concatenate((np.zeros(first), row, np.zeros(dofs - first - size))))
        q |= angles
        first += size
    xml = (
        f"<mujoco><worldbody>{''.join(bodies)}</worldbody><tendon>{''.join(tendons)}</tendon>"
        f"<equality>{''.join(equalities)}</equality><actuator>{''.join(actuators)}</actuator></mujoco>"
    )
    pulls = rng.uniform(0, 4, n) * (rng.random(n) < 0.3)
    return RedundantHand(
        xml, [f"tip{i}" for i in range(n)], q, np.array(columns).T, np.array(los), np.array(his),
        np.array(couplings).reshape(-1, dofs), float(rng.uniform(0.3, 0.9)), pulls,
    )  # fmt: skip


class Case(NamedTuple):
    """A hand's grasp with a wanted wrench."""

    hand: RedundantHand
    grasp: gf.Grasp
    f: np.ndarray
    torques: np.ndarray
    """What all joints must give: torques by c, shape (m, n_dofs)."""
    bias: np.ndarray
    """And besides, shape (n_dofs,)."""


def random_case(rng) -> Case:
    """Return a random hand around an object, and a wrench, of about half of which it can give."""
    hand = random_hand(rng)
    model = mujoco.MjModel.from_xml_string(hand.xml)
    read = gf.hands.from_mjcf(model, hand.tips)
    angles = [hand.q[name] for name in read.q_names]
    points = read.fingertip_positions(angles)
    centre = points.mean(axis=0)
    contacts = []
    for point, pull in zip(points, hand.pulls.tolist(), strict=True):
        inward = (centre - point) / np.linalg.norm(centre - point) + 0.1 * rng.normal(size=3)
        normal = inward / np.linalg.norm(inward)
        contacts.append(gf.Contact(point, normal, gf.PCWF(hand.mu, pull)))
    grasp = gf.Grasp(contacts, read, angles, origin=centre)
    c = np.concatenate(
        [
            [push, *(0.5 * hand.mu * push * rng.uniform(-1, 1, 2) / np.sqrt(2))]
            for push in rng.uniform(0, 10 ** rng.uniform(-0.5, 1.2), len(contacts))
        ]
    )
    data = mujoco.MjData(model)
    for name, angle in hand.q.items():
        data.joint(name).qpos = angle
    mujoco.mj_forward(model, data)
    torques = []
    for contact, tip in zip(contacts, hand.tips, strict=True):
        linear = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, linear, None, model.site(tip).id)
        torques.append(contact.frame.T @ linear)
    return Case(hand, grasp, grasp.W @ c, np.vstack(torques), np.array(data.qfrc_bias))


def margin(case: Case) -> float:
    """Return by how much all limits can be kept at once, by Clarabel; negative if they cannot be.

    In units of half a motor's range, and of 1 N in the normal force of a contact. The unknowns are
    c, every motor's force, those of the couplings, and the margin.
    """
    hand, W, f = case.hand, case.grasp.W, case.f
    m, motors, p = W.shape[1], hand.R.shape[1], len(hand.couplings)
    half = (hand.hi - hand.lo) / 2
    E = np.block(
        [
            [W, np.zeros((6, motors + p + 1))],
            [case.torques.T, -hand.R, -hand.couplings.T, np.zeros((len(hand.R), 1))],
        ]
    )
    e = np.concatenate((f, -case.bias))
    G = np.zeros((2 * motors + 1, m + motors + p + 1))
    G[:motors, m : m + motors], G[motors : 2 * motors, m : m + motors] = (
        np.eye(motors),
        -np.eye(motors),
    )
    G[: 2 * motors, -1] = np.concatenate((half, half))
    G[-1, -1] = 1.0  # as deep as that is all the same
    h = np.concatenate((hand.hi, -hand.lo, [0.5]))
    cones = []
    for i, pull in enumerate(hand.pulls.tolist()):
        M = np.zeros((3, G.shape[1]))
        M[0, 3 * i], M[0, -1], M[1, 3 * i + 1], M[2, 3 * i + 2] = hand.mu, -hand.mu, 1.0, 1.0
        cones.append((M, np.array([hand.mu * pull, 0.0, 0.0])))
    A = np.vstack((E, G, *[-M for M, _ in cones]))
    b = np.concatenate((e, h, *[v for _, v in cones]))
    kinds = [clarabel.ZeroConeT(len(e)), clarabel.NonnegativeConeT(len(h))]
    kinds += [clarabel.SecondOrderConeT(3)] * len(cones)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    settings.max_threads = 1
    q = np.zeros(G.shape[1])
    q[-1] = -1.0
    nothing = sparse.csc_array((len(q), len(q)))
    answer = clarabel.DefaultSolver(nothing, q, sparse.csc_array(A), b, kinds, settings).solve()
    if "PrimalInfeasible" in str(answer.status):
        return -np.inf  # whatever the margin: the passive motions cannot be kept
    assert "Solved" in str(answer.status), str(answer.status)
    return float(answer.x[-1])
