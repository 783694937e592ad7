"""What the front ends of other array libraries share: fields by name in, NumPy arrays out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from graspforce._engine.layout import FIELDS
from graspforce._engine.settings import Settings
from graspforce._util.arrays import Array, require_keywords
from graspforce.batch import BatchProblems, solve_rows
from graspforce.contact import ContactModel, model_of, models_for
from graspforce.derivatives import Sensitivity
from graspforce.problem import ProblemOptions


def axes_of(name: str) -> int:
    """Return how many axes a field of one problem has."""
    return len(FIELDS[name].shape)


def shapes_of(fields: Mapping[str, Any], dims: Sequence[int]) -> dict[str, tuple[int, ...]]:
    """Return the shape of one problem's part of each field that is given."""
    sizes = {"k": fields["W"].shape[-2], "m": fields["W"].shape[-1], "n": len(dims)}
    sizes |= {"n_joints": np.shape(fields["J"])[-1]} if "J" in fields else {}
    sizes |= {"p": np.shape(fields["A"])[-2]} if "A" in fields else {}
    sizes |= {"r": internals(fields)}
    return {name: tuple(sizes.get(axis, 0) for axis in FIELDS[name].shape) for name in fields}


def internals(fields: Mapping[str, Any]) -> int:
    """Return how many internal forces of motors there are, which stand behind c."""
    return np.shape(fields["internal"])[-2] if "internal" in fields else 0


def one_for_all(name: str) -> bool:
    """Whether one number may stand for all entries of a field."""
    return FIELDS[name].broadcast or name in ("mu", "gamma")


def gather(
    W: Any, f: Any, models: ContactModel | Sequence[ContactModel], options: Mapping[str, Any]
) -> tuple[dict[str, Any], tuple[int, ...]]:
    """Return the fields that are given, mu and gamma among them, and the contacts' components.

    Raises:
        InvalidInputError: models that do not fit W, an unknown option.
    """
    require_keywords(options, [*ProblemOptions.__annotations__, "mu", "gamma"], "solve")
    each = models_for(models, W.shape[-1])
    fields = {"W": W, "f": f} | {
        name: value for name, value in options.items() if value is not None
    }
    for name in ("mu", "gamma"):
        fields.setdefault(name, [float(getattr(model, name)) for model in each])
    if any(model.pull > 0 for model in each):
        fields.setdefault("pull", [float(model.pull) for model in each])
    fields.setdefault("alpha", 5.0)
    return fields, tuple(model.dim for model in each)


def solve_fields(
    fields: Mapping[str, Any], dims: Sequence[int], settings: Settings
) -> tuple[Array, Array, Array, Any]:
    """Return forces, tau, nu and status, a row for each problem; internal forces stand behind c."""
    batch = solve_rows(_problems(fields, dims), settings=settings)
    return batch.found.forces, batch.tau, batch.nu, batch.status


def pull_back(
    fields: Mapping[str, Any],
    dims: Sequence[int],
    found: tuple[Array, Array, Any],
    gradients: tuple[Array, Array],
    wanted: tuple[str, ...],
) -> dict[str, Array]:
    """Return gradients by fields, of a field that all rows share the sum of theirs.

    Args:
        fields: what was solved.
        dims: the contacts' components.
        found: forces, as of :func:`solve_fields`, nu and whether each row is SOLVED.
        gradients: by forces and tau.
        wanted: the fields to differentiate by.
    """
    problems = _problems(fields, dims)
    known = [name for name in wanted if name != "engagement" or problems.layout.ceilings]
    by_forces, by_tau = gradients
    c, v = by_forces[:, : sum(dims)], by_forces[:, sum(dims) :]
    by_row = Sensitivity(problems, *found).vjp(wrt=tuple(known), c=c, internal_forces=v, tau=by_tau)
    result: dict[str, Array] = {}
    for name in wanted:
        shape = np.shape(fields[name])
        result[name] = (
            _unbroadcast(by_row[name], shape, axes_of(name)) if name in by_row else np.zeros(shape)
        )
    return result


def _unbroadcast(value: Array, shape: tuple[int, ...], axes: int) -> Array:
    """Sum what stands for (B, *entries) over the axes along which an argument was repeated."""
    wanted = (
        shape if len(shape) > axes else (1, *shape) if len(shape) == axes else (1,) * (axes + 1)
    )
    repeated = tuple(
        axis
        for axis, sizes in enumerate(zip(value.shape, wanted, strict=True))
        if sizes[0] != sizes[1]
    )
    return value.sum(axis=repeated, keepdims=True).reshape(shape)


def _problems(fields: Mapping[str, Any], dims: Sequence[int]) -> BatchProblems:
    pull = 1.0 if "pull" in fields else 0.0
    return BatchProblems.of([model_of(dim, 1.0, 1.0, pull) for dim in dims], fields)
