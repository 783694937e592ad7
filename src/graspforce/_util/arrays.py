"""The one checker of type, shape and finiteness.

Every argument passes here, so that every complaint reads alike: which argument, what came, what
was expected. Arrays come back as new, read-only, C-contiguous float64.
"""

from __future__ import annotations

import math
import operator
import reprlib
import sys
from collections.abc import Collection, Sequence
from contextlib import suppress
from types import UnionType
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce.errors import InvalidInputError

Array: TypeAlias = NDArray[np.float64]
_T = TypeVar("_T")

# The compiled core counts in int.
LARGEST_INT = 2**31 - 1

# What an error shows as it is; a container only where it is empty.
_PLAIN: tuple[type, ...] = (type(None), bool, int, float, complex, str, bytes)
_CONTAINERS: tuple[type, ...] = (list, tuple, dict, set)


def came(value: object) -> str:
    """Return what an error says of what came: a plain value itself, of anything else its type."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, _PLAIN) or (isinstance(value, _CONTAINERS) and not value):
        with suppress(ValueError):  # Python writes no integer of thousands of digits
            return reprlib.repr(value)
    return f"type {type(value).__name__}"


def require_instance(
    value: object, name: str, kind: type | UnionType, expected: str | None = None
) -> None:
    """Raise unless ``value`` is an instance of ``kind``; a class is none of its instances.

    Raises:
        InvalidInputError: it is not; the text says what was ``expected``, by default a ``kind``.
    """
    if isinstance(value, type) or not isinstance(value, kind):
        wanted = expected or f"a {getattr(kind, '__name__', kind)}"
        raise InvalidInputError(f"{name}: got {came(value)}, expected {wanted}")


def require_choice(value: object, name: str, choices: Sequence[str]) -> None:
    """Raise unless ``value`` is one of the words ``choices``.

    Raises:
        InvalidInputError: it is not.
    """
    if not isinstance(value, str) or value not in choices:
        wanted = " or ".join(map(repr, choices))
        raise InvalidInputError(f"{name}: got {came(value)}, expected {wanted}")


def require_keywords(given: Collection[str], valid: Collection[str], owner: str) -> None:
    """Raise unless every keyword is one of ``valid``; ``owner`` is what takes them.

    Raises:
        InvalidInputError: one is not; the text lists the valid ones.
    """
    for name in given:
        if name not in valid:
            raise InvalidInputError(
                f"{name}: not an option of {owner}; expected one of {', '.join(valid)}"
            )


def as_tuple(values: object, name: str, kind: type[_T]) -> tuple[_T, ...]:
    """Return a list or other sequence of instances of ``kind`` as a tuple.

    Raises:
        InvalidInputError: no sequence (a set, a generator, an array), or something else in it.
    """
    if isinstance(values, str):  # a sequence, but of letters
        raise InvalidInputError(f"{name}: got {came(values)}, expected a list of {kind.__name__}")
    require_instance(values, name, Sequence, f"a list of {kind.__name__}")
    items = tuple(cast("Sequence[Any]", values))
    for index, item in enumerate(items):
        require_instance(item, f"{name}[{index}]", kind)
    return items


def as_array(
    value: ArrayLike,
    name: str,
    shape: tuple[int | str, ...] | None,
    *,
    broadcast: bool = False,
    finite: bool = True,
) -> Array:
    """Return ``value`` as a read-only float64 array of the wanted shape.

    A masked array is refused, whatever its mask: there is no number to take for a masked one.

    Args:
        value: what the caller gave.
        name: the argument's name, for the error text.
        shape: the wanted shape; a string stands for any length of at least one, None for any
            shape.
        broadcast: also accept a scalar and repeat it (``shape`` must then be all numbers).
        finite: refuse NaN and infinity.

    Raises:
        InvalidInputError: not numeric, masked, of a wrong shape, NaN or infinite.
    """
    # What was expected is put into words only where that did not come: loops pass here.
    raw = _as_numbers(value, name, shape, _OR_SCALAR if broadcast else "")
    if shape is not None:
        if broadcast and raw.ndim == 0:
            raw = np.full(tuple(int(n) for n in shape), raw)
        if raw.shape != shape and not _fits(raw.shape, shape):
            expected = _written(shape, _OR_SCALAR if broadcast else "")
            raise InvalidInputError(f"{name}: got shape {raw.shape}, expected {expected}")
    array = np.array(raw, dtype=np.float64, order="C")
    if finite and not (good := np.isfinite(array)).all():
        index = tuple(int(i) for i in np.argwhere(~good)[0])
        where = f"[{', '.join(map(str, index))}]" if index else ""
        raise InvalidInputError(
            f"{name}{where}: got {array[index]}, expected finite numbers everywhere"
        )
    array.flags.writeable = False
    return array


def as_rows(
    value: Any, name: str, shape: tuple[int | str, ...], *, broadcast: bool = False
) -> NDArray[Any]:
    """Return ``value`` as an array of real numbers of the wanted shape, or with one axis more.

    It is the caller's own array where that is one: neither copied, converted nor looked into.

    Args:
        value: what the caller gave.
        name: the argument's name, for the error text.
        shape: the wanted shape of a row; a string stands for any length of at least one.
        broadcast: also accept a scalar, or one number a row, shape (B, 1), for all entries.

    Raises:
        InvalidInputError: not numeric, masked, of a wrong shape.
    """
    raw = _as_numbers(value, name, shape, _OR_ROWS)
    if broadcast and (raw.ndim == 0 or raw.shape[1:] == (1,) != shape):
        sizes = tuple(int(n) for n in shape)
        raw = np.broadcast_to(raw, sizes if raw.ndim == 0 else (len(raw), *sizes))
    own = raw.shape[max(0, raw.ndim - len(shape)) :]
    if raw.ndim - len(shape) not in (0, 1) or not _fits(own, shape):
        raise InvalidInputError(
            f"{name}: got shape {raw.shape}, expected {_written(shape, _OR_ROWS)}"
        )
    return raw


def _as_numbers(
    value: Any, name: str, shape: tuple[int | str, ...] | None, more: str
) -> NDArray[Any]:
    """Return ``value`` as an array of real numbers of any shape, without a copy where it is one.

    Raises:
        InvalidInputError: not numeric, or masked; the text has the expected shape, and ``more``.
    """
    if type(value) is not np.ndarray and _is_masked(value):
        raise InvalidInputError(
            f"{name}: got a masked array, expected real numbers of {_written(shape, more)}; fill "
            "it first"
        )
    try:
        raw = np.asarray(value)
    except Exception as error:  # whatever the caller's __array__ may raise
        raise InvalidInputError(
            f"{name}: not a regular array of numbers ({str(error).partition(chr(10))[0]}); "
            f"expected {_written(shape, more)}"
        ) from None
    if raw.dtype.kind not in "fiu":
        single = raw.dtype.kind == "O" and raw.ndim == 0
        got = came(value) if single else f"type {raw.dtype.name}"
        raise InvalidInputError(
            f"{name}: got {got}, expected real numbers of {_written(shape, more)}"
        )
    return raw


_OR_SCALAR, _OR_ROWS = " or a scalar", ", or with a leading axis"


def _fits(got: tuple[int, ...], wanted: tuple[int | str, ...]) -> bool:
    return len(got) == len(wanted) and all(
        size == want if isinstance(want, int) else size >= 1
        for size, want in zip(got, wanted, strict=True)
    )


def _written(shape: tuple[int | str, ...] | None, more: str) -> str:
    if shape is None:
        return f"any shape{more}"
    return "shape (" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")" + more


def _is_masked(value: object) -> bool:
    """Tell whether NumPy would drop a mask: of the array itself, or of the rows of a list."""
    # NumPy imports it at first use. Until another thread that does so is through, there are none.
    masked = getattr(sys.modules.get("numpy.ma"), "MaskedArray", None)
    if masked is None:
        return False
    rows = cast("Sequence[object]", value) if isinstance(value, list | tuple) else (value,)
    return any(isinstance(row, masked) for row in rows)


def as_number(value: float, name: str) -> float:
    """Return ``value`` as a float, which must be finite.

    Raises:
        InvalidInputError: not a real number, or not finite.
    """
    if isinstance(value, float) and math.isfinite(value):  # NumPy's own is one, too
        return float(value)
    return float(as_array(value, name, ()))


def as_positive(value: float, name: str, unit: str = "") -> float:
    """Return ``value`` as a float, which must be positive and finite.

    Raises:
        InvalidInputError: not a real number, not finite, or not above zero.
    """
    number = as_number(value, name)
    if number <= 0:
        raise InvalidInputError(f"{name}: got {number}{unit and f' {unit}'}, expected more than 0")
    return number


def as_not_negative(value: float, name: str, unit: str = "") -> float:
    """Return ``value`` as a float, which must be finite and 0 or more.

    Raises:
        InvalidInputError: not a real number, not finite, or below zero.
    """
    number = as_number(value, name)
    if number < 0:
        raise InvalidInputError(f"{name}: got {number}{unit and f' {unit}'}, expected 0 or more")
    return number


def index_of(value: Any) -> int | None:
    """Return an integer of any type as an int; None for everything else, True and False too."""
    if isinstance(value, bool | np.bool_):  # NumPy's own is an index before 2.3, with a warning
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None


def as_integer(value: Any, name: str, least: int) -> int:
    """Return ``value`` as an int, from ``least`` to the most that the compiled core counts to.

    Raises:
        InvalidInputError: no integer, or out of range.
    """
    number = index_of(value)
    if number is None or not least <= number <= LARGEST_INT:
        raise InvalidInputError(
            f"{name}: got {came(value)}, expected an integer in {least}…{LARGEST_INT}"
        )
    return number


def hash_bytes(array: Array) -> bytes:
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
