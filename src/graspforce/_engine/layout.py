"""The fields of a force distribution problem, said once, and where each stands in a flat buffer.

Checks, attributes, defaults, a Servo's arrays and the keys of files follow from :data:`FIELDS`. Its
order is that of the buffer, which the compiled core reads; ``cpp/include/graspforce/fields.hpp`` is
the same list there, and a test holds the two together.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from graspforce._util.arrays import Array


class Field(NamedTuple):
    """What is known of a field.

    Attributes:
        shape: its axes by the names of :meth:`Layout.sizes`; empty for a number.
        doc: what it is, with its unit.
        broadcast: whether one number may stand for all entries.
        default: what its entries are where it is not given.
        flag: the attribute of :class:`Layout` that tells whether there is one; None: always, as
            far as its axes have a length.
    """

    shape: tuple[str, ...]
    doc: str
    broadcast: bool = False
    default: float = 0.0
    flag: str | None = None


FIELDS: dict[str, Field] = {
    "W": Field(("k", "m"), "Grasp map"),
    "f": Field(("k",), "Wanted wrench [N, N·m]"),
    "J": Field(("m", "n_joints"), "Hand Jacobian [m]"),
    "internal": Field(("r", "n_joints"), "Internal forces of the motors, by the motors"),
    "tau_lo": Field(("n_joints",), "Lower torque limits [N·m]", broadcast=True),
    "tau_hi": Field(("n_joints",), "Upper torque limits [N·m]", broadcast=True),
    "tau_bias": Field(("n_joints",), "Torques already taken [N·m]", broadcast=True),
    "c_max": Field(("n",), "Ceilings of the normal forces [N]", broadcast=True, flag="ceilings"),
    "c_min": Field(("n",), "Floors of the normal forces [N]", broadcast=True, flag="floors"),
    "engagement": Field(("n",), "Engagements, 0 to 1", broadcast=True, default=1.0),
    "pull": Field(("n",), "What contacts pull with at most [N]", broadcast=True, flag="pulls"),
    "f_soft": Field(("k",), "Softness of W c = f [N, N·m]", broadcast=True, flag="soft_wrench"),
    "c_last": Field(("m",), "Forces of the tick before [N, N·m]", flag="rate_limits"),
    "dc_max": Field(("m",), "Most change of each [N, N·m]", broadcast=True, flag="rate_limits"),
    "A": Field(("p", "m"), "Matrix of A c ≤ b"),
    "b": Field(("p",), "Right-hand sides of A c ≤ b"),
    "mu": Field(("n",), "Coefficients of friction", default=1.0),
    "gamma": Field(("n",), "Coefficients of torsional friction [m]", default=1.0),
    "cone_weight": Field(
        ("n",), "Weights of the cones", broadcast=True, default=1.0, flag="cone_weights"
    ),
    "alpha": Field((), "Weight of the limits", default=5.0),
}  # fmt: skip


class Slot(NamedTuple):
    """Where a field stands in the buffer of a layout."""

    start: int
    stop: int
    shape: tuple[int, ...]


class Layout(NamedTuple):
    """The sizes of a problem: what stays the same from tick to tick."""

    wrench_rows: int
    dims: tuple[int, ...]  # components of each contact: 1 FPC, 3 PCWF, 4 SFC
    joints: int
    inequalities: int
    ceilings: bool
    floors: bool
    rate_limits: bool
    soft_wrench: bool
    pulls: bool = False
    internals: int = 0
    cone_weights: bool = False

    @property
    def sizes(self) -> dict[str, int]:
        """The lengths of the axes that fields have."""
        return {
            "k": self.wrench_rows,
            "m": sum(self.dims),
            "n": len(self.dims),
            "n_joints": self.joints,
            "p": self.inequalities,
            "r": self.internals,
        }

    @property
    def slots(self) -> dict[str, Slot]:
        """Where every field stands, in the order of the buffer; a field not given has length 0."""
        return _slots(self)

    def views(self, packed: Array) -> dict[str, Array]:
        """Return every field as a view of a flat buffer, or of a stack of them, shape (B, size)."""
        return {
            name: packed[..., slot.start : slot.stop].reshape(packed.shape[:-1] + slot.shape)
            for name, slot in self.slots.items()
        }


@lru_cache(maxsize=1024)
def _slots(layout: Layout) -> dict[str, Slot]:
    sizes, start = layout.sizes, 0
    slots: dict[str, Slot] = {}
    for name, field in FIELDS.items():
        given = field.flag is None or getattr(layout, field.flag)
        shape = tuple(sizes[axis] if given else 0 for axis in field.shape)
        stop = start + math.prod(shape)
        slots[name] = Slot(start, stop, shape)
        start = stop
    return slots
