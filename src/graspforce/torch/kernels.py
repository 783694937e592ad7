"""The operator's work on a CUDA device: tensors as Warp arrays, on the stream that torch uses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
import warp

from graspforce.warp.fields import Fields
from graspforce.warp.problems import Forces, quiet

_torch: Any = torch  # whose stubs leave out what custom operators need
wp: Any = warp


def solve(
    fields: Mapping[str, Any],
    dims: Sequence[int],
    outputs: tuple[Any, Any, Any, Any],
    tol: float,
    max_steps: int,
) -> None:
    """Write c, tau, nu and status."""
    with _stream_of(outputs[0]):
        _bound(fields, dims).solve(_forces(*outputs), tol, max_steps)


def pull_back(
    fields: Mapping[str, Any],
    dims: Sequence[int],
    found: tuple[Any, Any, Any],
    gradients: tuple[Any, Any],
    out: Mapping[str, Any],
) -> None:
    """Write the gradients by fields, from c, nu and status and the gradients by c and tau."""
    c, nu, status = found
    to_c, to_tau = map(_array, gradients)
    with _stream_of(c):
        forces = _forces(c, gradients[1], nu, status)
        written = {name: _array(value) for name, value in out.items()}
        _bound(fields, dims).vjp(forces, to_c, to_tau, written)


def _bound(fields: Mapping[str, Any], dims: Sequence[int]) -> Fields:
    device = fields["f"].device

    def empty(shape: tuple[int, ...], kind: Any) -> Any:
        # PyTorch keeps memory until the work on its stream is done, whichever that is.
        return _array(_torch.empty(shape, dtype=wp.dtype_to_torch(kind), device=device))

    return Fields({name: _array(value) for name, value in fields.items()}, dims, empty)


def _forces(c: Any, tau: Any, nu: Any, status: Any) -> Forces:
    steps = _torch.empty_like(status)
    return Forces(*(_array(each) for each in (c, tau, nu, status, steps)))


def _array(tensor: Any) -> Any:
    return wp.from_torch(tensor.detach(), requires_grad=False)


def _stream_of(tensor: Any) -> AbstractContextManager[Any]:
    if not tensor.is_cuda:
        return nullcontext()
    return wp.ScopedStream(wp.stream_from_torch(tensor.device), sync_enter=False)


with quiet():
    wp.init()
