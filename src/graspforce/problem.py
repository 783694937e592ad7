"""The force distribution problem, Eq. (16) with everything that bounds it.

A :class:`ForceProblem` is frozen and completely validated: whatever passes its constructor can
be solved, and nothing later has to look at shapes or signs again. Its numbers live in one flat
float64 buffer (``packed``), of which the fields are read-only views; the compiled core reads that
buffer, whose order :class:`Layout` fixes.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce._arrays import (
    Array,
    as_array,
    as_positive,
    require,
    require_keywords,
    signless,
)
from graspforce.contact import FPC, PCWF, SFC, ContactModel, as_models, contact_starts
from graspforce.errors import InvalidInputError

# A contact whose engagement is no larger than this has left the grasp: its force is zero, and
# its cone, its limits and its finger's joints leave the problem (end of Section III-C.3).
REMOVAL_THRESHOLD = 1e-6


class Layout(NamedTuple):
    """The sizes of a problem: what stays the same from tick to tick."""

    wrench_rows: int
    dims: tuple[int, ...]  # components of each contact: 1 FPC, 3 PCWF, 4 SFC
    joints: int
    inequalities: int
    ceilings: bool
    floors: bool

    @property
    def fields(self) -> dict[str, tuple[int, ...]]:
        """The shape of every field, in the order of the flat buffer."""
        k, n, m = self.wrench_rows, len(self.dims), sum(self.dims)
        return {
            "W": (k, m),
            "f": (k,),
            "J": (m, self.joints),
            "tau_lo": (self.joints,),
            "tau_hi": (self.joints,),
            "tau_bias": (self.joints,),
            "c_max": (n if self.ceilings else 0,),
            "c_min": (n if self.floors else 0,),
            "engagement": (n,),
            "A": (self.inequalities, m),
            "b": (self.inequalities,),
            "mu": (n,),
            "gamma": (n,),
            "alpha": (),
        }

    def views(self, packed: Array) -> dict[str, Array]:
        """Return every field of a flat buffer as a view of it."""
        views: dict[str, Array] = {}
        start = 0
        for name, shape in self.fields.items():
            size = math.prod(shape)
            views[name] = packed[start : start + size].reshape(shape)
            start += size
        return views


class ProblemOptions(TypedDict, total=False):
    """The optional arguments of :class:`ForceProblem`, as keywords."""

    J: ArrayLike | None
    tau_lo: ArrayLike | None
    tau_hi: ArrayLike | None
    tau_bias: ArrayLike | None
    c_max: ArrayLike | None
    c_min: ArrayLike | None
    engagement: ArrayLike | None
    A: ArrayLike | None
    b: ArrayLike | None
    alpha: float


class ProblemArguments(ProblemOptions, total=False):
    """All arguments of :class:`ForceProblem`, as keywords."""

    W: ArrayLike
    f: ArrayLike
    models: ContactModel | Sequence[ContactModel]


class ForceProblem:
    """Find contact forces c with W c = f inside the friction cones and every linear limit.

    The minimiser of Phi_soc(c) + alpha·Phi_lin(c) is sought, Eq. (16). Linear limits, all in
    Phi_lin: ``tau_lo ≤ J.T c + tau_bias ≤ tau_hi`` (Eq. 2, 15), normal forces within
    ``engagement·c_min ≤ c_norm ≤ engagement·c_max`` (Eq. 20), ``A c ≤ b`` (Eq. 5).

    Args:
        W: grasp map, shape (k, m); k = 6 for a body in space.
        f: the wrench that the fingers exert on the object, shape (k,) [N, N·m].
        models: the contacts' models, n of them; one model alone stands for all contacts.
        J: hand Jacobian in contact frames, shape (m, n_joints): tau = J.T @ c [m].
        tau_lo: lower joint torque limits, shape (n_joints,) or a scalar [N·m].
        tau_hi: upper joint torque limits, likewise.
        tau_bias: torques that the fingers need for themselves, likewise; default 0.
        c_max: ceilings of the normal forces, shape (n,) or a scalar [N].
        c_min: floors of the normal forces, likewise; 0 or more.
        engagement: the paper's w_i in 0…1, shape (n,) or a scalar; needs c_max; default 1.
            A contact at 1e-6 or below is out of the grasp.
        A: further inequalities' matrix, shape (p, m).
        b: their right-hand sides, shape (p,).
        alpha: weight of the linear limits against the cones, above 0.

    Raises:
        InvalidInputError: a wrong shape, NaN or infinity, a limit that excludes another, limits
            without their Jacobian or the reverse; the text names the argument.
    """

    __slots__ = ("layout", "models", "packed", *Layout(0, (), 0, 0, False, False).fields)

    layout: Layout
    models: tuple[ContactModel, ...]
    packed: Array
    W: Array
    f: Array
    J: Array
    tau_lo: Array
    tau_hi: Array
    tau_bias: Array
    c_max: Array
    c_min: Array
    engagement: Array
    A: Array
    b: Array
    mu: Array
    gamma: Array
    alpha: float

    def __init__(
        self,
        W: ArrayLike,
        f: ArrayLike,
        models: ContactModel | Sequence[ContactModel],
        J: ArrayLike | None = None,
        tau_lo: ArrayLike | None = None,
        tau_hi: ArrayLike | None = None,
        tau_bias: ArrayLike | None = None,
        c_max: ArrayLike | None = None,
        c_min: ArrayLike | None = None,
        engagement: ArrayLike | None = None,
        A: ArrayLike | None = None,
        b: ArrayLike | None = None,
        alpha: float = 5.0,
    ) -> None:
        grasp = as_array(W, "W", ("k", "m"))
        k, m = grasp.shape
        each = _models_for(models, m)
        n = len(each)
        values: dict[str, Array] = {"W": grasp, "f": as_array(f, "f", (k,))}

        _together(J=J, tau_lo=tau_lo, tau_hi=tau_hi)
        joints = 0
        if J is not None and tau_lo is not None and tau_hi is not None:
            values["J"] = as_array(J, "J", (m, "n_joints"))
            joints = values["J"].shape[1]
            lower = as_array(tau_lo, "tau_lo", (joints,), broadcast=True)
            upper = as_array(tau_hi, "tau_hi", (joints,), broadcast=True)
            bias = 0.0 if tau_bias is None else tau_bias
            require(lower < upper, "tau_lo", lower, "less than tau_hi")
            values |= {"tau_lo": lower, "tau_hi": upper}
            values["tau_bias"] = as_array(bias, "tau_bias", (joints,), broadcast=True)
        elif tau_bias is not None:
            raise InvalidInputError("tau_bias: given without J, tau_lo and tau_hi")

        share = as_array(
            1.0 if engagement is None else engagement, "engagement", (n,), broadcast=True
        )
        require((share >= 0) & (share <= 1), "engagement", share, "a number in 0…1")
        values["engagement"] = share
        if c_max is not None:
            ceiling = as_array(c_max, "c_max", (n,), broadcast=True)
            require(ceiling > 0, "c_max", ceiling, "more than 0 N")
            values["c_max"] = ceiling
        elif engagement is not None:
            raise InvalidInputError("engagement: given without c_max, the ceiling that it scales")
        if c_min is not None:
            floor = as_array(c_min, "c_min", (n,), broadcast=True)
            require(floor >= 0, "c_min", floor, "0 N or more")
            if "c_max" in values:
                require(floor < values["c_max"], "c_min", floor, "less than c_max")
            values["c_min"] = floor

        _together(A=A, b=b)
        inequalities = 0
        if A is not None and b is not None:
            values["A"] = as_array(A, "A", ("p", m))
            inequalities = values["A"].shape[0]
            values["b"] = as_array(b, "b", (inequalities,))

        values["mu"] = np.array([getattr(model, "mu", 1.0) for model in each])
        values["gamma"] = np.array([getattr(model, "gamma", 1.0) for model in each])
        values["alpha"] = np.array(as_positive(alpha, "alpha"))

        layout = Layout(
            k, tuple(model.dim for model in each), joints, inequalities,
            "c_max" in values, "c_min" in values,
        )  # fmt: skip
        packed = np.concatenate([values[name].ravel() for name in layout.fields if name in values])
        self._adopt(layout, packed)

    @classmethod
    def from_packed(cls, layout: Layout, packed: Array) -> ForceProblem:
        """Wrap numbers that were validated before (a tick of a Servo); no copy, no checks."""
        problem = cls.__new__(cls)
        problem._adopt(layout, packed)
        return problem

    def _adopt(self, layout: Layout, packed: Array) -> None:
        packed.flags.writeable = False
        put = super().__setattr__
        put("layout", layout)
        put("packed", packed)
        for name, view in layout.views(packed).items():
            put(name, float(view) if name == "alpha" else view)
        coefficients = zip(layout.dims, self.mu.tolist(), self.gamma.tolist(), strict=True)
        put("models", tuple(_model(*each) for each in coefficients))

    def replace(self, **changes: Unpack[ProblemArguments]) -> ForceProblem:
        """Return a new problem with some arguments changed, validated like any other.

        Raises:
            InvalidInputError: as the constructor; or a name that is no argument of it.
        """
        arguments = self.arguments()
        require_keywords(changes, arguments, "ForceProblem.replace")
        changed: dict[str, Any] = {**arguments, **changes}
        return ForceProblem(**changed)

    def arguments(self) -> dict[str, Any]:
        """Return the constructor's arguments that make this problem; None where not given."""
        layout = self.layout
        given = {
            "J": layout.joints > 0,
            "tau_lo": layout.joints > 0,
            "tau_hi": layout.joints > 0,
            "tau_bias": bool(self.tau_bias.any()),
            "c_max": layout.ceilings,
            "c_min": layout.floors,
            "engagement": bool((self.engagement != 1).any()),
            "A": layout.inequalities > 0,
            "b": layout.inequalities > 0,
        }
        arguments: dict[str, Any] = {"W": self.W, "f": self.f, "models": self.models}
        arguments |= {name: getattr(self, name) if here else None for name, here in given.items()}
        arguments["alpha"] = self.alpha
        return arguments

    @property
    def n(self) -> int:
        """The number of contacts."""
        return len(self.models)

    @property
    def m(self) -> int:
        """The number of contact force components, the length of c."""
        return self.W.shape[1]

    @property
    def starts(self) -> list[int]:
        """Where each contact starts in c; entry n is m."""
        return contact_starts(self.models)

    @property
    def active(self) -> NDArray[np.bool_]:
        """Which contacts are part of the grasp, shape (n,): engagement above 1e-6."""
        return self.engagement > REMOVAL_THRESHOLD

    def linear_limits(self) -> tuple[Array, Array]:
        """Return every linear limit that counts as ``A c ≤ b`` (Eq. 5, 15 and 20).

        Returns:
            A, shape (v, m), and b, shape (v,). Rows in this order: tau_hi, tau_lo, ceilings,
            floors, the problem's own A. The columns of contacts that are out of the grasp are
            zero, and rows that touch no other contacts are left out.
        """
        A, b = self._all_limits()
        if self.active.all():
            return A, b
        rows = self.counted_limits()
        return A[rows] * np.repeat(self.active, self.layout.dims), b[rows]

    def counted_limits(self) -> NDArray[np.bool_]:
        """Which of all the rows :meth:`linear_limits` keeps: not those of removed contacts."""
        touches = self._all_limits()[0] != 0
        there = touches[:, np.repeat(self.active, self.layout.dims)].any(axis=1)
        return there | ~touches.any(axis=1)

    def _all_limits(self) -> tuple[Array, Array]:
        normals = np.zeros((self.n, self.m))
        normals[np.arange(self.n), self.starts[:-1]] = 1.0
        parts = [
            (self.J.T, self.tau_hi - self.tau_bias),
            (-self.J.T, self.tau_bias - self.tau_lo),
        ]
        if self.layout.ceilings:
            parts.append((normals, self.engagement * self.c_max))
        if self.layout.floors:
            parts.append((-normals, -self.engagement * self.c_min))
        parts.append((self.A, self.b))
        return np.vstack([rows for rows, _ in parts]), np.concatenate([b for _, b in parts])

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a ForceProblem is frozen; use problem.replace({name}=…)")

    def __delattr__(self, name: str) -> None:
        raise AttributeError("a ForceProblem is frozen")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ForceProblem):
            return NotImplemented
        return self.layout == other.layout and np.array_equal(self.packed, other.packed)

    def __hash__(self) -> int:
        return hash((self.layout, signless(self.packed)))

    def __reduce__(self) -> tuple[Any, ...]:
        return (ForceProblem.from_packed, (self.layout, np.array(self.packed)))

    def __repr__(self) -> str:
        counts = Counter(type(model).__name__ for model in self.models)
        contacts = " + ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
        bounds = [f"{self.layout.joints} joints"] if self.layout.joints else []
        bounds += ["ceilings"] if self.layout.ceilings else []
        bounds += ["floors"] if self.layout.floors else []
        bounds += [f"{self.layout.inequalities} inequalities"] if self.layout.inequalities else []
        return (
            f"ForceProblem({contacts}; {', '.join(bounds) or 'no limits'}; "
            f"f={np.array2string(self.f, precision=4)}, alpha={self.alpha:g})"
        )


def _model(dim: int, mu: float, gamma: float) -> ContactModel:
    return FPC() if dim == 1 else PCWF(mu) if dim == 3 else SFC(mu, gamma)


def _models_for(models: ContactModel | Sequence[ContactModel], m: int) -> tuple[ContactModel, ...]:
    each = as_models(models)
    if isinstance(models, PCWF | SFC) or len(each) == 1:
        each = each * max(1, m // each[0].dim)
    total = sum(model.dim for model in each)
    if total != m:
        raise InvalidInputError(
            f"W: got {m} columns, expected {total}, the components "
            f"of the {len(each)} contact models"
        )
    return each


def _together(**arguments: object) -> None:
    given = [name for name, value in arguments.items() if value is not None]
    missing = [name for name, value in arguments.items() if value is None]
    if given and missing:
        raise InvalidInputError(
            f"{missing[0]}: missing; {' and '.join(given)} came without it, "
            f"expected all of {', '.join(arguments)} or none"
        )
