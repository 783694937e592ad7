"""What is timed: the paper's dynamic task, random grasps of four fingers, grasps of any size."""

from __future__ import annotations

import numpy as np

from graspforce import scenarios
from graspforce._arrays import Array
from graspforce.contact import PCWF, Contact
from graspforce.grasp_map import grasp_map
from graspforce.outcome import Status
from graspforce.problem import ForceProblem
from graspforce.solve import solve

CUBE = 0.04  # m


def dynamic_task() -> list[ForceProblem]:
    """Return the 500 problems of the paper's circle: four fingers, twelve joints, alpha 5."""
    return list(scenarios.dynamic().problems())


def random_grasps(count: int, seed: int = 1) -> list[ForceProblem]:
    """Return feasible grasps of four fingers with three joints each, alpha from .01 to 1000."""
    rng = np.random.default_rng(seed)
    grasps: list[ForceProblem] = []
    while len(grasps) < count:
        f = np.concatenate((rng.normal(size=3), 0.02 * rng.normal(size=3))) * rng.uniform(0.1, 5)
        grasp = _grasp(rng, 4, f, float(10 ** rng.uniform(-2, 3)))
        if solve(grasp).status is Status.SOLVED:
            grasps.append(grasp)
    return grasps


def breathing_grasp(contacts: int, ticks: int = 40) -> list[ForceProblem]:
    """Return a stream of problems of one grasp whose load and Jacobian swing a little."""
    rng = np.random.default_rng(contacts)
    f = np.array([0, 0, 0.9 * contacts, 0, 0, 0.01])
    grasp = _grasp(rng, contacts, f, 5.0)
    swings = np.sin(2 * np.pi * np.arange(ticks) / ticks)
    return [
        grasp.replace(f=f * (1 + 0.1 * swing), J=grasp.J * (1 + 0.01 * swing)) for swing in swings
    ]


def _grasp(rng: np.random.Generator, contacts: int, f: Array, alpha: float) -> ForceProblem:
    """Fingers of three joints and ±.5 N·m spread over a ball, their normals tilted a little."""
    k = np.arange(contacts) + 0.5
    height, around = 1 - 2 * k / contacts, np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - height**2)
    spread = np.column_stack((flat * np.cos(around), flat * np.sin(around), height))
    points = _unit(spread + rng.normal(0, 0.15, (contacts, 3)))
    normals = _unit(rng.normal(0, 0.15, (contacts, 3)) - points)
    models = [PCWF(mu) for mu in rng.uniform(0.3, 1, contacts)]
    J = np.zeros((3 * contacts, 3 * contacts))
    for i in range(0, 3 * contacts, 3):
        rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        J[i : i + 3, i : i + 3] = rotation * rng.uniform(0.03, 0.1)
    placed = [
        Contact(CUBE * p, v, model) for p, v, model in zip(points, normals, models, strict=True)
    ]
    return ForceProblem(grasp_map(placed), f, models, J=J, tau_lo=-0.5, tau_hi=0.5, alpha=alpha)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
