"""Force problems on PyTorch tensors: an operator with autograd over :func:`gf.solve_batch`.

``graspforce.torch.solve`` is row by row what :func:`graspforce.solve` is, on the CPU. Tensors of
float64 are read where they stand; float32 is computed in float64 and comes back as float32. The
gradient by every tensor that requires one is exact (:func:`graspforce.sensitivity`); where a row is
not SOLVED it is zero. There is no second derivative.

Needs PyTorch: ``pip install 'graspforce[torch]'``.
"""

from __future__ import annotations

from collections.abc import Sequence
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

from graspforce._array_solve import axes_of, gather, pull_back, solve_fields

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

    Args:
        W: grasp maps, shape (B, k, m) or (k, m).
        f: wrenches, shape (B, k) or (k,) [N, N·m].
        models: the contacts' models, the same in all rows.
        settings: tolerance and step limit. Derivatives are as exact as the forces.
        options: any other field of the problem that :func:`graspforce.solve_batch` takes,
            ``mu`` and ``gamma`` among them: tensors, arrays or numbers.

    Raises:
        InvalidInputError: as solve_batch; or a tensor that is not on the CPU, or no real number.
    """
    settings = DEFAULT if settings is None else settings
    require_instance(settings, "settings", Settings)
    fields, dims = gather(W, f, models, options)
    given = {name: isinstance(value, _torch.Tensor) for name, value in fields.items()}
    kinds = {fields[name].dtype for name, own in given.items() if own}
    for name, value in fields.items():
        if given[name] and value.device.type != "cpu":
            raise InvalidInputError(f"{name}: got a tensor on {value.device}, expected the CPU")
        if given[name] and not (value.is_floating_point() or value.dtype in _INTEGERS):
            raise InvalidInputError(f"{name}: got {value.dtype}, expected real numbers")
    single = _torch.float32 in kinds and _torch.float64 not in kinds
    kind = _torch.float32 if single else _torch.float64
    tensors = [_torch.as_tensor(value, dtype=kind) for value in fields.values()]
    c, tau, _, status = _solve_op(
        tensors, ",".join(fields), list(dims), settings.tol, settings.max_steps
    )
    if all(value.ndim <= axes_of(name) for name, value in zip(fields, tensors, strict=True)):
        return Forces(c[0], tau[0], status[0])
    return Forces(c, tau, status)


_INTEGERS = (_torch.int8, _torch.int16, _torch.int32, _torch.int64, _torch.uint8)


@_torch.library.custom_op("graspforce::solve", mutates_args=())
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
        W.new_empty((B, W.shape[-1])), W.new_empty((B, joints)), W.new_empty((B, W.shape[-2])),
        W.new_empty((B,), dtype=_torch.int32),
    )  # fmt: skip


@_torch.library.custom_op("graspforce::solve_backward", mutates_args=())
def _backward_op(
    fields: Sequence[torch.Tensor],
    names: str,
    dims: Sequence[int],
    c: torch.Tensor,
    nu: torch.Tensor,
    status: torch.Tensor,
    to_c: torch.Tensor,
    to_tau: torch.Tensor,
) -> list[torch.Tensor]:
    arrays = {
        name: value.detach().numpy() for name, value in zip(names.split(","), fields, strict=True)
    }
    forces, multipliers, by_c, by_tau = (
        each.detach().to(_torch.float64).numpy() for each in (c, nu, to_c, to_tau)
    )
    found = pull_back(
        arrays,
        dims,
        (forces, multipliers, status.numpy() == Status.SOLVED),
        {"c": by_c, "tau": by_tau},
        tuple(arrays),
    )
    return [
        _torch.tensor(found[name]).to(value.dtype)
        for name, value in zip(arrays, fields, strict=True)
    ]


@_backward_op.register_fake
def _backward_shapes(
    fields: Sequence[torch.Tensor], names: str, dims: Sequence[int], *others: Any
) -> list[torch.Tensor]:
    return [_torch.empty_like(value) for value in fields]


def _setup(ctx: Any, inputs: tuple[Any, ...], output: tuple[torch.Tensor, ...]) -> None:
    fields, names, dims, _, _ = inputs
    c, _, nu, status = output
    ctx.save_for_backward(c, nu, status, *fields)
    ctx.names, ctx.dims = names, dims
    ctx.mark_non_differentiable(nu, status)


def _backward(ctx: Any, to_c: Any, to_tau: Any, *unused: Any) -> tuple[Any, ...]:
    c, nu, status, *fields = ctx.saved_tensors
    found = _backward_op(fields, ctx.names, ctx.dims, c, nu, status, to_c, to_tau)
    return found, None, None, None, None


def _no_second(ctx: Any, *gradients: Any) -> Any:
    raise NotImplementedError("graspforce.torch.solve has first derivatives only")


_solve_op.register_autograd(_backward, setup_context=_setup)
_backward_op.register_autograd(_no_second)
