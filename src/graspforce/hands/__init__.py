"""Hands: what turns contacts and joint angles into a Jacobian and torque limits."""

from __future__ import annotations

from graspforce.hands.hand import (
    ActuatedHand,
    Hand,
    LoadedHand,
    RedundantHand,
    UnderactuatedHand,
)
from graspforce.hands.imported import ImportedHand
from graspforce.hands.mujoco.grasp import MujocoGrasp
from graspforce.hands.mujoco.hand import from_mjcf
from graspforce.hands.paper import PaperHand
from graspforce.hands.pinocchio.grasp import PinocchioGrasp
from graspforce.hands.pinocchio.hand import from_urdf

__all__ = [
    "ActuatedHand",
    "Hand",
    "ImportedHand",
    "LoadedHand",
    "MujocoGrasp",
    "PaperHand",
    "PinocchioGrasp",
    "RedundantHand",
    "UnderactuatedHand",
    "from_mjcf",
    "from_urdf",
]
