"""The operator's work on a CUDA device: XLA calls the kernels with its own buffers and stream."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from typing import Any

import jax
import warp

from graspforce._array_solve import axes_of
from graspforce.warp.fields import Fields
from graspforce.warp.problems import Forces, quiet

_jax: Any = jax
wp: Any = warp

OUTPUTS = ("c", "tau", "nu", "status", "steps")


def solve(
    names: Sequence[str], dims: Sequence[int], tol: float, max_steps: int, arrays: Sequence[Any]
) -> tuple[Any, Any, Any, Any]:
    """Return c, tau, nu and status of one problem; vmap makes a batch of it."""
    by_name = dict(zip(names, arrays, strict=True))
    k, m = by_name["W"].shape
    joints = by_name["J"].shape[1] if "J" in by_name else 0
    call = _solve_call(tuple(names), tuple(dims), tol, max_steps, by_name["W"].dtype.name)
    lengths = dict(zip(OUTPUTS, ((m,), (joints,), (k,), (), ()), strict=True))
    found = _called(call, arrays, lengths)
    return found[0], found[1], found[2], found[3]


def pull_back(
    names: Sequence[str], dims: Sequence[int], arrays: Sequence[Any], found: Sequence[Any]
) -> tuple[Any, ...]:
    """Return the gradients of one problem by its arrays, from those by c and tau, c, nu, status."""
    call = _vjp_call(tuple(names), tuple(dims), arrays[0].dtype.name)
    lengths = {f"by_{name}": value.shape for name, value in zip(names, arrays, strict=True)}
    return tuple(_called(call, (*arrays, *found), lengths))


def _called(call: Any, arrays: Sequence[Any], lengths: dict[str, tuple[int, ...]]) -> list[Any]:
    """Give every array the axis along which vmap lays its rows."""
    shapes = {name: (1, *shape) for name, shape in lengths.items()}
    rows = [_jax.numpy.expand_dims(value, 0) for value in arrays]
    return [value[0] for value in call(*rows, output_dims=shapes)]


@functools.cache
def _solve_call(
    names: tuple[str, ...], dims: tuple[int, ...], tol: float, max_steps: int, kind: str
) -> Any:
    def run(*arrays: Any) -> None:
        work = _Work(arrays[0].device)
        fields = work.fields(names, dims, arrays[: len(names)])
        c, tau, nu, status, steps = arrays[len(names) :]
        forces = Forces(*map(work.for_result, (c, tau, nu)), status, steps)
        fields.solve(forces, tol, max_steps)
        work.end()

    inputs = {name: _rows_of(axes_of(name), kind) for name in names}
    outputs = {name: _rows_of(1, kind) for name in OUTPUTS[:3]}
    outputs |= dict.fromkeys(OUTPUTS[3:], wp.array(dtype=wp.int32))
    return _jax_callable(run, inputs, outputs)


@functools.cache
def _vjp_call(names: tuple[str, ...], dims: tuple[int, ...], kind: str) -> Any:
    count = len(names)

    def run(*arrays: Any) -> None:
        work = _Work(arrays[0].device)
        fields = work.fields(names, dims, arrays[:count])
        to_c, to_tau, c, nu = map(work.doubled, arrays[count : count + 4])
        status = arrays[count + 4]
        results = map(work.for_result, arrays[count + 5 :])
        forces = Forces(c, to_tau, nu, status, status)
        fields.vjp(forces, to_c, to_tau, dict(zip(names, results, strict=True)))
        work.end()

    inputs = {name: _rows_of(axes_of(name), kind) for name in names}
    inputs |= {name: _rows_of(1, kind) for name in ("to_c", "to_tau", "c", "nu")}
    inputs["status"] = wp.array(dtype=wp.int32)
    outputs = {f"by_{name}": _rows_of(axes_of(name), kind) for name in names}
    return _jax_callable(run, inputs, outputs)


class _Work:
    """One call: its memory, and its arrays of float32 in float64."""

    def __init__(self, device: Any) -> None:
        self._device, self._results = device, []
        self._kept: list[Any] = []

    def fields(self, names: Sequence[str], dims: Sequence[int], arrays: Sequence[Any]) -> Fields:
        given = dict(zip(names, map(self.doubled, arrays), strict=True))
        return Fields(given, dims, self._empty)

    def doubled(self, array: Any) -> Any:
        if array.dtype == wp.float64:
            return array
        double = self._empty(array.shape, wp.float64)
        wp.utils.array_cast(array, double)
        return double

    def for_result(self, array: Any) -> Any:
        """Return an array of float64 to write to, itself or in its place until the end."""
        if array.dtype == wp.float64:
            return array
        double = self._empty(array.shape, wp.float64)
        self._results.append((double, array))
        return double

    def end(self) -> None:
        for double, array in self._results:
            wp.utils.array_cast(double, array)
        if self._kept and self._device.is_cuda:
            # Warp takes memory back at once, and does not know of XLA's stream.
            wp.synchronize_stream(self._device)

    def _empty(self, shape: tuple[int, ...], kind: Any) -> Any:
        array = wp.empty(shape, dtype=kind, device=self._device)
        self._kept.append(array)
        return array


def _rows_of(axes: int, kind: str) -> Any:
    return wp.array(dtype=getattr(wp, kind), ndim=axes + 1)


def _jax_callable(run: Callable[..., None], inputs: dict[str, Any], outputs: dict[str, Any]) -> Any:
    """Make a function of arrays one of JAX, by arguments that it has only now.

    The shape of J's blocks depends on its numbers, so XLA must not record a graph of this.
    """

    def named(*arrays: Any) -> None:
        run(*arrays)

    arguments: Any = {f"to_{name}" if name in inputs else name: v for name, v in outputs.items()}
    arguments = inputs | outputs
    places = inspect.Parameter.POSITIONAL_OR_KEYWORD
    named.__signature__ = inspect.Signature(  # pyright: ignore[reportFunctionMemberAccess]
        [inspect.Parameter(name, places, annotation=kind) for name, kind in arguments.items()]
    )
    named.__annotations__ = arguments
    named.__module__ = Fields.__module__  # whose kernels are loaded along with it
    return wp.jax_callable(named, num_outputs=len(outputs), graph_mode=wp.JaxCallableGraphMode.NONE)


with quiet():
    wp.init()
