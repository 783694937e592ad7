"""Force problems on PyTorch tensors: an operator with autograd, on the CPU and on a GPU.

``graspforce.torch.solve`` is row by row what :func:`graspforce.solve` is. Tensors on the CPU go
through :func:`graspforce.solve_batch`, those on a CUDA device through the kernels of
:mod:`graspforce.warp`, where they are. float64 is read where it stands; float32 is computed in
float64 and comes back as float32. The gradient by every tensor that requires one is exact
(:func:`graspforce.sensitivity`); where a row is not SOLVED it is zero. There is no second
derivative.

Needs PyTorch: ``pip install 'graspforce[torch]'``; for a GPU the extra ``gpu`` besides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from graspforce._engine.outcome import Status
from graspforce._engine.settings import DEFAULT, Settings
from graspforce._util.arrays import require_instance
from graspforce.contact import ContactModel
from graspforce.errors import InvalidInputError, MissingExtraError

try:
    import torch
except ModuleNotFoundError as error:
    raise MissingExtraError("graspforce.torch", "torch", "torch") from error

from graspforce._array_solve import (
    axes_of,
    gather,
    internals,
    one_for_all,
    pull_back,
    shapes_of,
    solve_fields,
)

_torch: Any = torch  # whose stubs leave out what custom operators need


class Forces(NamedTuple):
    """What :func:`solve` returns.

    Attributes:
        c: contact forces, shape (B, m) [N, N·m], or (m,) where no argument has a leading axis.
        tau: joint torques, shape (B, n_joints) [N·m], likewise.
        status: values of :class:`graspforce.Status`, shape (B,), int32, likewise.
    """

    c: torch.Tensor
    tau: torch.Tensor
    status: torch.Tensor


def solve(
    W: torch.Tensor,
    f: torch.Tensor,
    models: ContactModel | Sequence[ContactModel],
    *,
    settings: Settings | None = None,
    **options: Any,
) -> Forces:
    """Find the contact forces of B problems, with derivatives by every tensor.

    On a CUDA device the kernels of :mod:`graspforce.warp` do it. They take up to eight contacts,
    none of which pulls, six rows of W, and joints that each are felt by one contact, at most four a
    contact; neither ``f_soft``, rate limits nor ``A c <= b``. Rows that they do not solve have the
    status MAX_STEPS or STALLED, which proves nothing. Where ``J`` is given a call waits for the
    device once; the gradient by it has zeros for joints that a contact does not feel.

    Args:
        W: grasp maps, shape (B, k, m) or (k, m).
        f: wrenches, shape (B, k) or (k,) [N, N·m].
        models: the contacts' models, the same in all rows.
        settings: tolerance and step limit. Derivatives are as exact as the forces.
        options: any other field of the problem that :func:`graspforce.solve_batch` takes,
            ``mu`` and ``gamma`` among them: tensors, arrays or numbers.

    Raises:
        InvalidInputError: as solve_batch; or tensors on different devices, on a device that is
            neither the CPU nor CUDA, of different types on a CUDA device, of no real numbers; or
            what the kernels do not take.
        MissingExtraError: a tensor is on a CUDA device, and Warp is not installed.
    """
    settings = DEFAULT if settings is None else settings
    require_instance(settings, "settings", Settings)
    fields, dims = gather(W, f, models, options)
    device, kind = _device_and_kind(fields)
    by_kernels = device.type in _BY_KERNELS
    own = _torch.float64 if by_kernels else kind
    tensors = [_torch.as_tensor(value, dtype=own, device=device) for value in fields.values()]
    many = any(value.ndim > axes_of(name) for name, value in zip(fields, tensors, strict=True))
    if by_kernels:
        tensors = _expanded(dict(zip(fields, tensors, strict=True)), dims)
    c, tau, _, status = _solve_op(
        tensors, ",".join(fields), list(dims), settings.tol, settings.max_steps
    )
    c, tau = c[:, : W.shape[-1]].to(kind), tau.to(kind)
    return Forces(c, tau, status) if many else Forces(c[0], tau[0], status[0])


_BY_KERNELS = {"cuda"}  # types of devices
_INTEGERS = (_torch.int8, _torch.int16, _torch.int32, _torch.int64, _torch.uint8)


def _device_and_kind(fields: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return what device the tensors are on, and the type that is computed and answered in."""
    tensors = {name: value for name, value in fields.items() if isinstance(value, _torch.Tensor)}
    devices = {name: value.device for name, value in tensors.items()}
    for name, device in devices.items():
        first, expected = next(iter(devices.items()))
        if device != expected:
            raise InvalidInputError(
                f"{name}: got a tensor on {device}, expected {expected} as of {first}"
            )
        if device.type not in ("cpu", "cuda"):
            raise InvalidInputError(f"{name}: got a tensor on {device}, expected the CPU or CUDA")
        value = tensors[name]
        if not (value.is_floating_point() or value.dtype in _INTEGERS):
            raise InvalidInputError(f"{name}: got {value.dtype}, expected real numbers")
        if value.dtype != tensors[first].dtype and device.type in _BY_KERNELS:
            raise InvalidInputError(
                f"{name}: got {value.dtype}, expected {tensors[first].dtype} as of {first}"
            )
    kinds = {value.dtype for value in tensors.values()}
    single = _torch.float32 in kinds and _torch.float64 not in kinds
    device = next(iter(devices.values()), _torch.device("cpu"))
    return device, _torch.float32 if single else _torch.float64


def _expanded(fields: Mapping[str, Any], dims: Sequence[int]) -> list[Any]:
    """Return the fields with a row for each problem, without a copy."""
    rows, source = 1, "f"
    for name, value in fields.items():
        if value.ndim > axes_of(name) and len(value) != 1:
            rows, source = len(value), name
            break
    expanded: list[Any] = []
    for name, shape in shapes_of(fields, dims).items():
        value = fields[name]
        lead = value.shape[: max(0, value.ndim - len(shape))]
        own = value.shape[len(lead) :]
        alone = one_for_all(name) and (value.ndim == 0 or (len(lead) == 1 and own == (1,)))
        if len(lead) > 1 or not (alone or own == shape):
            raise InvalidInputError(
                f"{name}: got shape {tuple(value.shape)}, expected {shape}, or with a leading axis"
            )
        if lead and lead[0] not in (1, rows):
            raise InvalidInputError(
                f"{name}: got {lead[0]} rows, expected {rows} as of {source}, or one"
            )
        expanded.append(value.expand(rows, *shape))
    return expanded


# ---- the operator --------------------------------------------------------------------------------


@_torch.library.custom_op("graspforce::solve", mutates_args=(), device_types="cpu")
def _solve_op(
    fields: Sequence[torch.Tensor], names: str, dims: Sequence[int], tol: float, max_steps: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    arrays = {
        name: value.detach().numpy() for name, value in zip(names.split(","), fields, strict=True)
    }
    found = solve_fields(arrays, dims, Settings(tol=tol, max_steps=max_steps))
    c, tau, nu, status = (_torch.from_numpy(each) for each in found)
    kind = fields[0].dtype
    return c.to(kind), tau.to(kind), nu.to(kind), status


@_solve_op.register_fake
def _solve_shapes(
    fields: Sequence[torch.Tensor], names: str, dims: Sequence[int], tol: float, max_steps: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    by_name = dict(zip(names.split(","), fields, strict=True))
    B = 1
    for name, value in by_name.items():
        if value.ndim > axes_of(name):
            B = value.shape[0]
            break
    W = by_name["W"]
    joints = by_name["J"].shape[-1] if "J" in by_name else 0
    return (
        W.new_empty((B, W.shape[-1] + internals(by_name))), W.new_empty((B, joints)),
        W.new_empty((B, W.shape[-2])), W.new_empty((B,), dtype=_torch.int32),
    )  # fmt: skip


@_torch.library.custom_op("graspforce::solve_backward", mutates_args=(), device_types="cpu")
def _backward_op(
    fields: Sequence[torch.Tensor],
    names: str,
    wanted: str,
    dims: Sequence[int],
    c: torch.Tensor,
    nu: torch.Tensor,
    status: torch.Tensor,
    to_c: torch.Tensor,
    to_tau: torch.Tensor,
) -> list[torch.Tensor]:
    tensors = dict(zip(names.split(","), fields, strict=True))
    arrays = {name: value.detach().numpy() for name, value in tensors.items()}
    forces, multipliers, by_c, by_tau = (
        each.detach().to(_torch.float64).numpy() for each in (c, nu, to_c, to_tau)
    )
    found = pull_back(
        arrays,
        dims,
        (forces, multipliers, status.numpy() == Status.SOLVED),
        (by_c, by_tau),
        tuple(wanted.split(",")),
    )
    return [_torch.tensor(found[name]).to(tensors[name].dtype) for name in wanted.split(",")]


@_backward_op.register_fake
def _backward_shapes(
    fields: Sequence[torch.Tensor], names: str, wanted: str, dims: Sequence[int], *others: Any
) -> list[torch.Tensor]:
    by_name = dict(zip(names.split(","), fields, strict=True))
    return [by_name[name].new_empty(by_name[name].shape) for name in wanted.split(",")]


def _setup(ctx: Any, inputs: tuple[Any, ...], output: tuple[torch.Tensor, ...]) -> None:
    fields, names, dims, _, _ = inputs
    c, _, nu, status = output
    ctx.save_for_backward(c, nu, status, *fields)
    ctx.names, ctx.dims = names, dims
    ctx.mark_non_differentiable(nu, status)


def _backward(ctx: Any, to_c: Any, to_tau: Any, *unused: Any) -> tuple[Any, ...]:
    c, nu, status, *fields = ctx.saved_tensors
    needed = ctx.needs_input_grad[0]
    names = ctx.names.split(",")
    wanted = [name for name, needs in zip(names, needed, strict=True) if needs]
    found = iter(
        _backward_op(fields, ctx.names, ",".join(wanted), ctx.dims, c, nu, status, to_c, to_tau)
    )
    return [next(found) if needs else None for needs in needed], None, None, None, None


def _no_second(ctx: Any, *gradients: Any) -> Any:
    raise NotImplementedError("graspforce.torch.solve has first derivatives only")


_solve_op.register_autograd(_backward, setup_context=_setup)
_backward_op.register_autograd(_no_second)


# ---- on a CUDA device ----------------------------------------------------------------------------


@_solve_op.register_kernel("cuda")
def _solve_on_device(
    fields: Sequence[torch.Tensor], names: str, dims: Sequence[int], tol: float, max_steps: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    from graspforce.torch import kernels

    outputs = _solve_shapes(fields, names, dims, tol, max_steps)
    by_name = dict(zip(names.split(","), fields, strict=True))
    kernels.solve(by_name, dims, outputs, tol, max_steps)
    return outputs


@_backward_op.register_kernel("cuda")
def _backward_on_device(
    fields: Sequence[torch.Tensor],
    names: str,
    wanted: str,
    dims: Sequence[int],
    c: torch.Tensor,
    nu: torch.Tensor,
    status: torch.Tensor,
    to_c: torch.Tensor,
    to_tau: torch.Tensor,
) -> list[torch.Tensor]:
    from graspforce.torch import kernels

    gradients = _backward_shapes(fields, names, wanted, dims)
    by_name = dict(zip(names.split(","), fields, strict=True))
    out = dict(zip(wanted.split(","), gradients, strict=True))
    kernels.pull_back(by_name, dims, (c, nu, status), (to_c, to_tau), out)
    return gradients
