"""The page's colours, the same as in the figures: a finger has its own, red is at a limit."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from graspforce._util.arrays import Array
from graspforce._util.plot import FINGERS, GREY, INK

__all__ = ["FINGERS", "GREY", "INK"]

OBJECT, PALM, LINK, JOINT, GROUND = "#f2c14e", "#d5dae1", "#8d99a8", "#4d5966", "#e6eaef"
WANTED, OTHER, PUSH, RED, GREEN = INK, "#12b5cb", "#7a3db8", "#b3261e", "#1b7f4b"

# How much of a limit is used: from blue, which nobody confuses with red, to the figures' red.
_SHARES = (0.0, 0.45, 0.6, 0.8, 1.0)
_RAMP = ("#1f5fbf", "#3fa0e0", "#f5c518", "#ef7d14", "#b3261e")


def rgb(colour: str) -> tuple[int, int, int]:
    """Return the three channels of ``#rrggbb``, 0 to 255."""
    r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return r, g, b


def lightened(colour: str) -> str:
    """Return a colour of a file, so light that its shape can be seen."""
    channels = [round(60 + (255 - 60) * each / 255) for each in rgb(colour)]
    return "#" + "".join(f"{each:02x}" for each in channels)


def of_share(share: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return the colours of shares of limits, shape (k, 3); those of above 1 are red, too."""
    ramp = np.array([rgb(each) for each in _RAMP], dtype=float)
    channels = [np.interp(np.nan_to_num(share), _SHARES, ramp[:, i]) for i in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def css_ramp() -> str:
    """Return the colours of shares as a gradient of CSS."""
    stops = ", ".join(f"{c} {100 * s:.0f}%" for s, c in zip(_SHARES, _RAMP, strict=True))
    return f"linear-gradient(90deg, {stops})"


def finger_of(contact: str) -> str:
    """Return what makes a contact: its name, without the number where a link makes several."""
    return re.sub(r" \(\d+\)$", "", contact)


def of_fingers(contacts: Sequence[str]) -> list[str]:
    """Return each contact's colour as ``#rrggbb``, one a finger, repeating after the last."""
    fingers = list(map(finger_of, contacts))
    first = list(dict.fromkeys(fingers))
    return [FINGERS[first.index(each) % len(FINGERS)] for each in fingers]
