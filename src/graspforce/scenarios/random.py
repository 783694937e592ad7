"""Random grasps for tests, benchmarks and comparisons: the same ones for the same generator.

:func:`grasps` and :func:`stream` are four and more fingers around a ball, each with three joints.
:func:`geometry` mixes contact models, limits and fingers that share joints, up to what double
precision just resolves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_integer, require_instance
from graspforce.contact import FPC, PCWF, SFC, Contact, ContactModel
from graspforce.grasp_map import grasp_map
from graspforce.problem import ForceProblem
from graspforce.solve import solve

RADIUS = 0.04  # of the ball that is held [m]


def grasps(count: int, seed: int = 1) -> list[ForceProblem]:
    """Return feasible grasps of four fingers with three joints each, alpha from 0.01 to 1000.

    Args:
        count: how many.
        seed: of the random numbers.

    Raises:
        InvalidInputError: no whole number, or one out of range.
    """
    count, seed = as_integer(count, "count", 0), as_integer(seed, "seed", 0)
    rng = np.random.default_rng(seed)
    found: list[ForceProblem] = []
    while len(found) < count:
        f = np.concatenate((rng.normal(size=3), 0.02 * rng.normal(size=3))) * rng.uniform(0.1, 5)
        problem = _fingers(rng, 4, f, float(10 ** rng.uniform(-2, 3)))
        if solve(problem).status is Status.SOLVED:
            found.append(problem)
    return found


def stream(contacts: int, ticks: int = 40) -> list[ForceProblem]:
    """Return the problems of one grasp whose load and Jacobian swing a little from tick to tick.

    Args:
        contacts: how many; they also seed the random numbers.
        ticks: of one swing.

    Raises:
        InvalidInputError: no whole number, or one out of range.
    """
    contacts, ticks = as_integer(contacts, "contacts", 1), as_integer(ticks, "ticks", 1)
    rng = np.random.default_rng(contacts)
    f = np.array([0, 0, 0.9 * contacts, 0, 0, 0.01])
    problem = _fingers(rng, contacts, f, 5.0)
    swings = np.sin(2 * np.pi * np.arange(ticks) / ticks)
    return [
        problem.replace(f=f * (1 + 0.1 * swing), J=problem.J * (1 + 0.01 * swing))
        for swing in swings
    ]


def _fingers(rng: np.random.Generator, contacts: int, f: Array, alpha: float) -> ForceProblem:
    """Fingers of three joints and ±.5 N·m spread over a ball, their normals tilted a little."""
    k = np.arange(contacts) + 0.5
    height, around = 1 - 2 * k / contacts, np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - height**2)
    spread = np.column_stack((flat * np.cos(around), flat * np.sin(around), height))
    points = unit(spread + rng.normal(0, 0.15, (contacts, 3)))
    normals = unit(rng.normal(0, 0.15, (contacts, 3)) - points)
    models = [PCWF(mu) for mu in rng.uniform(0.3, 1, contacts)]
    J = np.zeros((3 * contacts, 3 * contacts))
    for i in range(0, 3 * contacts, 3):
        rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        J[i : i + 3, i : i + 3] = rotation * rng.uniform(0.03, 0.1)
    placed = [
        Contact(RADIUS * p, v, model) for p, v, model in zip(points, normals, models, strict=True)
    ]
    return ForceProblem(grasp_map(placed), f, models, J=J, tau_lo=-0.5, tau_hi=0.5, alpha=alpha)


def unit(vectors: Array) -> Array:
    """Return vectors divided by their lengths; the last axis holds their components."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def random_models(rng: np.random.Generator, n: int, hard: bool) -> list[ContactModel]:
    """Return n contact models; mu in 0.1…1.5 [-], in 0.01…5 where ``hard``, gamma in 1…20 mm."""
    kinds = rng.choice(["mixed", "PCWF", "FPC", "SFC"], p=[0.45, 0.4, 0.05, 0.1])
    names = rng.choice(["FPC", "PCWF", "SFC"], n) if kinds == "mixed" else [kinds] * n
    low, high = (0.01, 5.0) if hard else (0.1, 1.5)
    mus = np.exp(rng.uniform(np.log(low), np.log(high), n))
    gammas = rng.uniform(0.001, 0.02, n)
    return [
        {"FPC": FPC(), "PCWF": PCWF(mu), "SFC": SFC(mu, gamma)}[name]
        for name, mu, gamma in zip(names, mus, gammas, strict=True)
    ]


def random_contacts(
    rng: np.random.Generator, models: list[ContactModel], hard: bool
) -> list[Contact]:
    """Return contacts on a ball of 4 cm, sometimes in one plane, one beside another if ``hard``."""
    n = len(models)
    points = unit(rng.normal(size=(n, 3)))
    flat = rng.random() < 0.1
    tilt = rng.normal(0, 0.2, (n, 3))
    if flat:
        points[:, 2] = tilt[:, 2] = 0
        points = unit(points)
    normals = unit(tilt - points)
    if hard and n > 1 and rng.random() < 0.2:
        points[1] = points[0] + 10 ** rng.uniform(-9, -3) * rng.normal(size=3)
        normals[1] = normals[0]
    tangents = np.cross(normals, rng.normal(size=(n, 3)))
    return [
        Contact(RADIUS * p, v, model, tangent=t)
        for p, v, model, t in zip(points, normals, models, tangents, strict=True)
    ]


def random_jacobian(rng: np.random.Generator, dims: NDArray[np.int64]) -> Array:
    """Return J, shape (m, n_joints) [m], of fingers of one to three contacts, of full row rank.

    Now and then a finger has a joint to spare.

    Args:
        rng: the source of randomness.
        dims: components of each contact, shape (n,).
    """
    n, starts = len(dims), np.concatenate(([0], np.cumsum(dims)))
    shared = rng.random() < 0.3
    cuts = (
        np.flatnonzero(np.append(rng.random(n - 1) < 0.5, True)) + 1 if shared else range(1, n + 1)
    )
    blocks: list[Array] = []
    first = 0
    for last in cuts:
        if last - first > 3:
            last = first + 3
        rows = int(starts[last] - starts[first])
        joints = rows + (rng.random() < 0.2)
        Q, _ = np.linalg.qr(rng.normal(size=(joints, rows)))
        block = (Q * 0.07 * np.exp(rng.uniform(-0.7, 0.7, rows))).T
        for i in range(first, last):  # a torsion is a torque already
            if dims[i] == 4:
                block[starts[i] - starts[first] + 3] *= 15
        blocks.append(block)
        first = last
    blocks += [np.diag(np.full(int(dim), 0.07)) for dim in dims[first:]]
    J = np.zeros([sum(block.shape[axis] for block in blocks) for axis in (0, 1)])
    row = column = 0
    for block in blocks:
        J[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return J


def _forces(rng: np.random.Generator, models: Sequence[ContactModel]) -> Array:
    """Contact forces that use up to 90 % of the friction [N, N·m]."""
    parts: list[Array] = []
    for model in models:
        normal = np.exp(rng.normal(1, 0.5))
        parts.append(np.array([normal]))
        if model.dim > 1:
            most = np.array([model.mu, model.mu, model.gamma])[: model.dim - 1]
            share = rng.uniform(0, 0.9) * unit(rng.normal(size=model.dim - 1))
            parts.append(normal * share * most)
    return np.concatenate(parts)


def geometry(rng: np.random.Generator, hard: bool = False) -> tuple[ForceProblem, Array]:
    """Return a problem of 2 to 64 contacts of mixed models, and a direction of further loads.

    Its wrench f0 can be held; f0 + s f1 can be held for the loads s of an interval around 0.

    Args:
        rng: the source of randomness.
        hard: frictions of 0.01 to 5, contacts that nearly coincide or are nearly out of the grasp.

    Returns:
        The problem, and f1, shape (6,) [N, N·m].

    Raises:
        InvalidInputError: an argument of the wrong kind.
    """
    require_instance(rng, "rng", np.random.Generator, "a numpy.random.Generator")
    require_instance(hard, "hard", bool | np.bool_, "True or False")
    most = int(rng.choice(np.array([4, 8, 16, 64]), p=[0.5, 0.35, 0.12, 0.03]))
    n = int(rng.integers(2, most + 1))
    models = random_models(rng, n, hard)
    contacts = random_contacts(rng, models, hard)
    W = grasp_map(contacts)
    dims = np.array([model.dim for model in models])
    starts = np.concatenate(([0], np.cumsum(dims)[:-1]))
    m = int(dims.sum())
    c0 = _forces(rng, models)
    fields: dict[str, Any] = {}
    hand = rng.random() < 0.85
    removed = np.zeros(n, bool)
    if not hand or rng.random() < 0.4:
        engagement = np.where(rng.random(n) < 0.8, 1.0, rng.uniform(0.05, 1, n))
        if n > 3 and rng.random() < 0.3:
            removed[rng.integers(n)] = True
        if hard and rng.random() < 0.3:  # only just in the grasp
            engagement[rng.integers(n)] = 10 ** rng.uniform(-5.9, -3)
        engagement[removed] = 0
        c0 = c0 * np.repeat(np.where(removed, 0, np.minimum(1, engagement)), dims)
        room = np.exp(rng.uniform(0.1, 2, n))
        fields["c_max"] = np.where(removed, 10, room * c0[starts] / np.maximum(engagement, 1e-9))
        fields["engagement"] = engagement
        if rng.random() < 0.3:
            floor = rng.uniform(0, 0.9, n) * c0[starts] / np.maximum(engagement, 1e-9)
            fields["c_min"] = np.where(removed, 0, floor)
    loaded = rng.random() < 0.5  # whether anything is held at load 0
    if hand:
        J = random_jacobian(rng, dims)
        tau0 = J.T @ c0
        size = np.abs(tau0) + 0.1 * np.abs(tau0).max() + 0.02
        up, down = (size * np.exp(rng.uniform(-2, 2, len(tau0))) for _ in range(2))
        bias = rng.normal(size=len(tau0)) * size * (rng.random() < 0.3)
        fields |= {"J": J, "tau_bias": bias}
        if loaded:
            fields |= {"tau_lo": tau0 - down + bias, "tau_hi": tau0 + up + bias}
        else:
            fields |= {"tau_lo": -size - down + bias, "tau_hi": size + up + bias}
    if rng.random() < 0.2:
        A = rng.normal(size=(2, m)) * (rng.random((2, m)) < 0.5)
        fields |= {"A": A, "b": A @ c0 + np.exp(rng.uniform(-1, 2, 2))}
    loaded = loaded or "c_min" in fields or "A" in fields
    f0 = W @ c0 if loaded else np.zeros(6)
    f1 = W @ (_forces(rng, models) * np.repeat(~removed, dims))
    return ForceProblem(W, f0, models, **fields), f1
