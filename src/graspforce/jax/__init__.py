"""Force problems on JAX arrays, with derivatives, inside ``jax.jit``, on the CPU and on a GPU.

``graspforce.jax.solve`` is row by row what :func:`graspforce.solve` is: a call that ``vmap`` turns
into one batch, with its own derivative (``custom_vjp``, first order). On the CPU it calls
:func:`graspforce.solve_batch`, on a CUDA device the kernels of :mod:`graspforce.warp`, with the
arrays where they are. Arrays of float32 are computed in float64 and come back as float32.

Needs JAX: ``pip install 'graspforce[jax]'``; for a GPU the extra ``gpu`` besides.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._engine.settings import DEFAULT, Settings
from graspforce._util.arrays import require_instance
from graspforce.contact import ContactModel
from graspforce.errors import InvalidInputError, MissingExtraError

try:
    import jax
except ModuleNotFoundError as error:
    raise MissingExtraError("graspforce.jax", "jax", "jax") from error

from graspforce._array_solve import (
    axes_of,
    gather,
    internals,
    one_for_all,
    pull_back,
    shapes_of,
    solve_fields,
)

_jax: Any = jax
_BY_KERNELS = "cuda"  # the platform on which they do the work


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

    On a CUDA device the kernels of :mod:`graspforce.warp` do it. They take up to eight contacts,
    none of which pulls, six rows of W, and joints that each are felt by one contact, at most four a
    contact; neither ``f_soft``, rate limits nor ``A c <= b``. Rows that they do not solve have the
    status MAX_STEPS or STALLED, which proves nothing. The gradient by ``J`` has zeros for joints
    that a contact does not feel.

    Args:
        W: grasp maps, shape (B, k, m) or (k, m).
        f: wrenches, shape (B, k) or (k,) [N, N·m].
        models: the contacts' models, the same in all rows.
        settings: tolerance and step limit. Derivatives are as exact as the forces.
        options: any other field of the problem that :func:`graspforce.solve_batch` takes,
            ``mu`` and ``gamma`` among them: arrays or numbers.

    Raises:
        InvalidInputError: as solve_batch; or arrays of different types of floating point, or on
            different devices.
        MissingExtraError: JAX has a CUDA device, and Warp is not installed.
        jax.errors.JaxRuntimeError: while it runs on a CUDA device, what the kernels do not take;
            its text ends with the reason.
    """
    settings = DEFAULT if settings is None else settings
    require_instance(settings, "settings", Settings)
    fields, dims = gather(W, f, models, options)
    _require_one_kind(fields)
    kind = _jax.numpy.result_type(W, f)
    if not _jax.numpy.issubdtype(kind, _jax.numpy.floating):
        kind = _jax.numpy.result_type(float)
    shapes = shapes_of(fields, dims)
    arrays = [
        _whole(_jax.numpy.asarray(value, dtype=kind), name, shapes[name])
        for name, value in fields.items()
    ]
    static = _Static(tuple(fields), dims, settings)
    over = [value.ndim > axes_of(name) for name, value in zip(fields, arrays, strict=True)]
    if not any(over):
        return _of_contacts(static, _solve(static, *arrays))
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
    return _of_contacts(static, _jax.vmap(partial(_solve, static), in_axes=axes)(*arrays))


def _of_contacts(static: _Static, found: tuple[Any, Any, Any]) -> Forces:
    """Leave out the internal forces behind c."""
    forces, tau, status = found
    m = sum(static.dims)
    return Forces(forces if forces.shape[-1] == m else forces[..., :m], tau, status)


def _require_one_kind(fields: Mapping[str, Any]) -> None:
    """Look whether the arrays that are JAX's are of one type and on one device."""
    kinds: dict[str, Any] = {}
    devices: dict[str, Any] = {}
    for name, value in fields.items():
        if not isinstance(value, _jax.Array):
            continue
        if _jax.numpy.issubdtype(value.dtype, _jax.numpy.floating) and not value.weak_type:
            kinds[name] = value.dtype
        if not isinstance(value, _jax.core.Tracer) and value.committed:
            devices[name] = value.sharding.device_set
    for found, what in ((kinds, "an array of"), (devices, "an array on")):
        for name, one in found.items():
            first, expected = next(iter(found.items()))
            if one != expected:
                raise InvalidInputError(
                    f"{name}: got {what} {one}, expected {expected} as of {first}"
                )


def _whole(value: Any, name: str, shape: tuple[int, ...]) -> Any:
    """A field with all its entries, where one number stands for them or for those of a row."""
    if not one_for_all(name):
        return value
    if value.ndim == 0:
        return _jax.numpy.broadcast_to(value, shape)
    if value.shape[1:] == (1,):
        return _jax.numpy.broadcast_to(value, (len(value), *shape))
    return value


@partial(_jax.custom_vjp, nondiff_argnums=(0,))
def _solve(static: _Static, *arrays: Any) -> tuple[Any, Any, Any]:
    """Forces, the internal ones behind c, tau and status of one problem."""
    c, tau, _, status = _call(static, arrays)
    return c, tau, status


def _forward(static: _Static, *arrays: Any) -> tuple[tuple[Any, Any, Any], tuple[Any, ...]]:
    c, tau, nu, status = _call(static, arrays)
    return (c, tau, status), (c, nu, status, *arrays)


def _backward(static: _Static, kept: tuple[Any, ...], gradients: tuple[Any, ...]) -> Any:
    arrays = kept[3:]
    shapes = [_jax.ShapeDtypeStruct(value.shape, value.dtype) for value in arrays]
    found = (*gradients[:2], *kept[:3])

    def on_host(*each: Any) -> tuple[Any, ...]:
        host = partial(_pull_back_on_host, static)
        return tuple(_jax.pure_callback(host, shapes, *each, vmap_method="expand_dims"))

    def on_device(*each: Any) -> tuple[Any, ...]:
        from graspforce.jax import kernels

        return kernels.pull_back(static.names, static.dims, each[5:], each[:5])

    return _dispatched(on_host, on_device, *found, *arrays)


_solve.defvjp(_forward, _backward)


def _call(static: _Static, arrays: Sequence[Any]) -> tuple[Any, Any, Any, Any]:
    by_name = dict(zip(static.names, arrays, strict=True))
    k, m = by_name["W"].shape
    forces = m + internals(by_name)
    joints = by_name["J"].shape[1] if "J" in by_name else 0
    kind = by_name["W"].dtype
    shapes = [_jax.ShapeDtypeStruct((size,), kind) for size in (forces, joints, k)]
    shapes.append(_jax.ShapeDtypeStruct((), np.int32))

    def on_host(*each: Any) -> tuple[Any, ...]:
        host = partial(_solve_on_host, static)
        return tuple(_jax.pure_callback(host, tuple(shapes), *each, vmap_method="expand_dims"))

    def on_device(*each: Any) -> tuple[Any, ...]:
        from graspforce.jax import kernels

        settings = static.settings
        return kernels.solve(static.names, static.dims, settings.tol, settings.max_steps, each)

    return _dispatched(on_host, on_device, *arrays)


def _dispatched(on_host: Any, on_device: Any, *arrays: Any) -> Any:
    """Return what one of two functions does, chosen when it is compiled for a platform."""
    if not _has_kernels():
        return on_host(*arrays)
    branches = {_BY_KERNELS: on_device}
    return _jax.lax.platform_dependent(*arrays, default=on_host, **branches)


def _has_kernels() -> bool:
    try:
        return bool(_jax.devices(_BY_KERNELS))
    except RuntimeError:  # JAX has no such platform here
        return False


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
        by_row, static.dims, (rows[2], rows[3], solved), (rows[0], rows[1]),
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
