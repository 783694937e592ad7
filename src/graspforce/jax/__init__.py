"""Force problems on JAX arrays, with derivatives: :func:`gf.solve_batch` inside ``jax.jit``.

``graspforce.jax.solve`` is row by row what :func:`graspforce.solve` is, on the host's processor: a
callback that ``vmap`` turns into one batch, with its own derivative (``custom_vjp``, first order).
Arrays of float32 are computed in float64 and come back as float32.

Needs JAX: ``pip install 'graspforce[jax]'``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from graspforce._engine.layout import FIELDS
from graspforce._engine.outcome import Status
from graspforce._engine.settings import DEFAULT, Settings
from graspforce._util.arrays import require_instance
from graspforce.contact import ContactModel
from graspforce.errors import InvalidInputError, MissingExtraError

try:
    import jax
except ModuleNotFoundError as error:
    raise MissingExtraError("graspforce.jax", "jax", "jax") from error

from graspforce._array_solve import axes_of, gather, pull_back, solve_fields

_jax: Any = jax


class Forces(NamedTuple):
    """What :func:`solve` returns.

    Attributes:
        c: contact forces, shape (B, m) [N, N·m], or (m,) where no argument has a leading axis.
        tau: joint torques, shape (B, n_joints) [N·m], likewise.
        status: values of :class:`graspforce.Status`, shape (B,), int32, likewise.
    """

    c: Any
    tau: Any
    status: Any


class _Static(NamedTuple):
    """What a trace is made for."""

    names: tuple[str, ...]
    dims: tuple[int, ...]
    settings: Settings


def solve(
    W: Any,
    f: Any,
    models: ContactModel | Sequence[ContactModel],
    *,
    settings: Settings | None = None,
    **options: Any,
) -> Forces:
    """Find the contact forces of B problems, with derivatives by every array.

    Args:
        W: grasp maps, shape (B, k, m) or (k, m).
        f: wrenches, shape (B, k) or (k,) [N, N·m].
        models: the contacts' models, the same in all rows.
        settings: tolerance and step limit. Derivatives are as exact as the forces.
        options: any other field of the problem that :func:`graspforce.solve_batch` takes,
            ``mu`` and ``gamma`` among them: arrays or numbers.

    Raises:
        InvalidInputError: as solve_batch.
    """
    settings = DEFAULT if settings is None else settings
    require_instance(settings, "settings", Settings)
    fields, dims = gather(W, f, models, options)
    kind = _jax.numpy.result_type(W, f)
    if not _jax.numpy.issubdtype(kind, _jax.numpy.floating):
        kind = _jax.numpy.result_type(float)
    sizes = {"k": W.shape[-2], "m": W.shape[-1], "n": len(dims)}
    sizes |= {"n_joints": np.shape(fields["J"])[-1]} if "J" in fields else {}
    sizes |= {"p": np.shape(fields["A"])[-2]} if "A" in fields else {}
    arrays = [
        _whole(_jax.numpy.asarray(value, dtype=kind), name, sizes) for name, value in fields.items()
    ]
    static = _Static(tuple(fields), dims, settings)
    over = [value.ndim > axes_of(name) for name, value in zip(fields, arrays, strict=True)]
    if not any(over):
        return Forces(*_solve(static, *arrays))
    lengths = {len(value) for value, has in zip(arrays, over, strict=True) if has} - {1}
    if len(lengths) > 1:
        shapes = {name: value.shape for name, value in zip(fields, arrays, strict=True)}
        raise InvalidInputError(f"{', '.join(fields)}: got shapes {shapes}, expected one length B")
    length = lengths.pop() if lengths else 1
    arrays = [
        value[0] if has and len(value) == 1 != length else value
        for value, has in zip(arrays, over, strict=True)
    ]
    axes = [
        0 if value.ndim > axes_of(name) else None
        for name, value in zip(fields, arrays, strict=True)
    ]
    return Forces(*_jax.vmap(partial(_solve, static), in_axes=axes)(*arrays))


def _whole(value: Any, name: str, sizes: Mapping[str, int]) -> Any:
    """A field with all its entries, where one number stands for them or for those of a row."""
    if not FIELDS[name].broadcast and name not in ("mu", "gamma"):
        return value
    shape = tuple(sizes[axis] for axis in FIELDS[name].shape)
    if value.ndim == 0:
        return _jax.numpy.broadcast_to(value, shape)
    if value.shape[1:] == (1,):
        return _jax.numpy.broadcast_to(value, (len(value), *shape))
    return value


@partial(_jax.custom_vjp, nondiff_argnums=(0,))
def _solve(static: _Static, *arrays: Any) -> tuple[Any, Any, Any]:
    """c, tau and status of one problem."""
    c, tau, _, status = _call(static, arrays)
    return c, tau, status


def _forward(static: _Static, *arrays: Any) -> tuple[tuple[Any, Any, Any], tuple[Any, ...]]:
    c, tau, nu, status = _call(static, arrays)
    return (c, tau, status), (c, nu, status, *arrays)


def _backward(static: _Static, kept: tuple[Any, ...], gradients: tuple[Any, ...]) -> Any:
    arrays = kept[3:]
    shapes = [_jax.ShapeDtypeStruct(value.shape, value.dtype) for value in arrays]
    host = partial(_pull_back_on_host, static)
    return tuple(_jax.pure_callback(host, shapes, *gradients[:2], *kept, vmap_method="expand_dims"))


_solve.defvjp(_forward, _backward)


def _call(static: _Static, arrays: Sequence[Any]) -> tuple[Any, Any, Any, Any]:
    by_name = dict(zip(static.names, arrays, strict=True))
    k, m = by_name["W"].shape
    joints = by_name["J"].shape[1] if "J" in by_name else 0
    kind = by_name["W"].dtype
    shapes = [_jax.ShapeDtypeStruct((size,), kind) for size in (m, joints, k)]
    shapes.append(_jax.ShapeDtypeStruct((), np.int32))
    return _jax.pure_callback(
        partial(_solve_on_host, static), tuple(shapes), *arrays, vmap_method="expand_dims"
    )


# ---- on the host: each array with the same number of axes in front, some of length 1 -----------


def _solve_on_host(static: _Static, *arrays: Any) -> tuple[Any, ...]:
    fields, lead = _flattened(static.names, arrays)
    kind = np.asarray(arrays[0]).dtype
    c, tau, nu, status = solve_fields(fields, static.dims, static.settings)
    return tuple(
        np.asarray(each if each is status else each.astype(kind)).reshape(lead + each.shape[1:])
        for each in (c, tau, nu, status)
    )


def _pull_back_on_host(static: _Static, *arrays: Any) -> list[Any]:
    plain: list[Any] = [np.asarray(each) for each in arrays]
    status, own = plain[4], plain[5:]
    fields, lead = _flattened(static.names, own)
    count = math.prod(lead)
    rows: list[Any] = [
        np.broadcast_to(each, lead + each.shape[len(lead) :]).reshape(count, -1).astype(float)
        for each in plain[:4]
    ]
    solved = np.broadcast_to(status, lead).reshape(count) == Status.SOLVED
    by_row = {  # a gradient for each row: JAX adds up those of what rows share
        name: np.broadcast_to(value, (count, *value.shape[value.ndim - axes_of(name) :]))
        for name, value in fields.items()
    }
    found = pull_back(
        by_row, static.dims, (rows[2], rows[3], solved), {"c": rows[0], "tau": rows[1]},
        static.names,
    )  # fmt: skip
    return [
        found[name].reshape(lead + found[name].shape[1:]).astype(value.dtype)
        for name, value in zip(static.names, own, strict=True)
    ]


def _flattened(names: Sequence[str], arrays: Sequence[Any]) -> tuple[dict[str, Any], Any]:
    """The fields with one leading axis, or none where rows share one; and the axes in front."""
    values = [np.asarray(value) for value in arrays]
    W = values[names.index("W")]
    front = W.ndim - axes_of("W")
    lead = np.broadcast_shapes(*(value.shape[:front] for value in values))
    fields: dict[str, Any] = {}
    for name, value in zip(names, values, strict=True):
        own = value.shape[front:]
        if all(size == 1 for size in value.shape[:front]):
            fields[name] = value.reshape(own)
        else:
            fields[name] = np.broadcast_to(value, lead + own).reshape(-1, *own)
    count = math.prod(lead)
    if front and all(value.ndim <= axes_of(name) for name, value in fields.items()):
        fields["f"] = np.broadcast_to(fields["f"], (count, *fields["f"].shape))
    return fields, lead
