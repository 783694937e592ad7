"""The one checker of shape, type and finiteness.

Every number that enters graspforce passes here, so that every complaint reads alike: which
argument, what came, what was expected. Arrays come back as new, read-only, C-contiguous float64.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce.errors import InvalidInputError

Array: TypeAlias = NDArray[np.float64]


def as_array(
    value: ArrayLike, name: str, shape: tuple[int | str, ...], *, broadcast: bool = False
) -> Array:
    """Return ``value`` as a read-only float64 array of the wanted shape, all finite.

    Args:
        value: what the caller gave.
        name: the argument's name, for the error text.
        shape: the wanted shape; a string stands for any length of at least one.
        broadcast: also accept a scalar and repeat it (``shape`` must then be all numbers).

    Raises:
        InvalidInputError: not numeric, wrong shape, NaN or infinite.
    """
    wanted = "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
    expected = f"shape {wanted}" + (" or a scalar" if broadcast else "")
    try:
        raw = np.asarray(value)
    except ValueError as error:
        raise InvalidInputError(
            f"{name}: not a regular array of numbers ({error}); expected {expected}"
        ) from None
    if raw.dtype.kind not in "fiu":
        raise InvalidInputError(
            f"{name}: got type {raw.dtype.name}, expected real numbers of {expected}"
        )
    if broadcast and raw.ndim == 0:
        raw = np.broadcast_to(raw, tuple(int(n) for n in shape))
    fits = raw.ndim == len(shape) and all(
        got == want if isinstance(want, int) else got >= 1
        for got, want in zip(raw.shape, shape, strict=True)
    )
    if not fits:
        raise InvalidInputError(f"{name}: got shape {raw.shape}, expected {expected}")
    array = np.array(raw, dtype=np.float64, order="C")
    finite = np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        where = f"[{', '.join(map(str, index))}]" if index else ""
        raise InvalidInputError(
            f"{name}{where}: got {array[index]}, expected finite numbers everywhere"
        )
    array.flags.writeable = False
    return array


def as_positive(value: float, name: str, unit: str = "") -> float:
    """Return ``value`` as a float, which must be positive and finite.

    Raises:
        InvalidInputError: not a real number, not finite, or not above zero.
    """
    number = float(as_array(value, name, ()))
    if number <= 0:
        raise InvalidInputError(f"{name}: got {number}{unit and f' {unit}'}, expected more than 0")
    return number


def signless(array: Array) -> bytes:
    """Return an array's bytes with −0 as 0: equal arrays give equal bytes, for hashing."""
    return (array + 0.0).tobytes()


def require(ok: NDArray[np.bool_], name: str, values: Array, expected: str) -> None:
    """Raise unless every entry of ``ok`` holds; the text names the first entry that does not.

    Raises:
        InvalidInputError: some entry of ``ok`` is false.
    """
    if not ok.all():
        index = int(np.flatnonzero(~ok)[0])
        raise InvalidInputError(f"{name}[{index}]: got {values[index]:g}, expected {expected}")
