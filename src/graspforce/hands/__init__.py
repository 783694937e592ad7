"""Hands: what turns contacts and joint angles into a Jacobian and torque limits."""

from __future__ import annotations

from graspforce.hands.hand import Hand
from graspforce.hands.paper import PaperHand

__all__ = ["Hand", "PaperHand"]
