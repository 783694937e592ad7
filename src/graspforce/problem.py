"""The force distribution problem, Eq. (16) with everything that bounds it.

A :class:`ForceProblem` is frozen and completely validated: whatever passes its constructor can
be solved, and nothing later has to look at shapes or signs again. Its numbers live in one flat
float64 buffer (``packed``), of which the fields are read-only views; the compiled core reads that
buffer, whose order :mod:`graspforce._engine.layout` fixes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce import equations
from graspforce._engine import native
from graspforce._engine.layout import FIELDS, Layout, Slot
from graspforce._util.arrays import Array, as_array, hash_bytes, require_keywords
from graspforce.contact import ContactModel, contact_starts, model_of, models_for
from graspforce.equations import Barriers, Cones
from graspforce.errors import InvalidInputError

# A contact whose engagement is no larger than this has left the grasp: its force is zero, and
# its cone, its limits and its finger's joints leave the problem (end of Section III-C.3).
REMOVAL_THRESHOLD = 1e-6

# A normal force whose floor is its ceiling, a set squeeze, keeps to this share of it.
SQUEEZE = 1e-9

# Arguments that make sense together alone.
_GROUPS = (("J", "tau_lo", "tau_hi"), ("A", "b"), ("c_last", "dc_max"))


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
    c_last: ArrayLike | None
    dc_max: ArrayLike | None
    f_soft: ArrayLike | None
    internal: ArrayLike | None
    cone_weight: ArrayLike | None


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
        c_min: floors of the normal forces, likewise; 0 to c_max. A contact with c_min = c_max
            presses with just that force, to 1e-9 of it.
        engagement: the paper's w_i in 0…1, shape (n,) or a scalar; needs c_max; default 1.
            A contact at 1e-6 or below is out of the grasp.
        A: further inequalities' matrix, shape (p, m).
        b: their right-hand sides, shape (p,).
        alpha: weight of the linear limits against the cones, above 0.
        c_last: contact forces of the tick before, shape (m,) [N, N·m]; with dc_max. A Servo puts
            its own last forces in.
        dc_max: the most by which each component of c may differ from c_last, shape (m,) or a
            scalar, above 0 [N, N·m]: ``|c − c_last| ≤ dc_max``, in Phi_lin like the others.
        f_soft: softness of each row of W c = f, shape (k,) or a scalar [N, N·m]; 0 for a row that
            has to hold. The others may be missed: ½‖(W c − f)/f_soft‖² over them is added to
            what is minimised. What a pinch, a balance controller or a measured load needs.
        internal: where there are more motors than motions, and J is by motors, the r independent
            internal forces of the motors, which make no torque at any joint, shape (r, n_joints):
            ``tau = J.T c + internal.T v + tau_bias`` with any v. An infeasible problem can be
            proved so where for each v some motor feels it alone (a column of zeros in J).
        cone_weight: weight of each contact's cone in Phi_soc, shape (n,) or a scalar, above 0;
            default 1. Points that stand for one patch share 1 between them
            (:func:`graspforce.contact.patch_weights`), so that the grip does not depend on how
            many they are.

    Raises:
        InvalidInputError: a wrong shape, NaN or infinity, a limit that excludes another, limits
            without their Jacobian or the reverse; the text names the argument.
    """

    __slots__ = ("layout", "models", "packed", *FIELDS)

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
    pull: Array
    f_soft: Array
    cone_weight: Array
    c_last: Array
    dc_max: Array
    internal: Array
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
        c_last: ArrayLike | None = None,
        dc_max: ArrayLike | None = None,
        f_soft: ArrayLike | None = None,
        internal: ArrayLike | None = None,
        cone_weight: ArrayLike | None = None,
    ) -> None:
        grasp = as_array(W, "W", ("k", "m"), finite=False)
        k, m = grasp.shape
        each = models_for(models, m)
        given: dict[str, Any] = {
            "W": grasp, "f": f, "J": J, "tau_lo": tau_lo, "tau_hi": tau_hi, "tau_bias": tau_bias,
            "c_max": c_max, "c_min": c_min, "engagement": engagement, "f_soft": f_soft,
            "c_last": c_last, "dc_max": dc_max, "A": A, "b": b, "alpha": alpha,
            "internal": internal,
            "cone_weight": cone_weight,
        }  # fmt: skip
        require_groups(given)
        joints = inequalities = internals = 0
        if J is not None:
            given["J"] = as_array(J, "J", (m, "n_joints"), finite=False)
            joints = given["J"].shape[1]
        if internal is not None:
            given["internal"] = as_array(internal, "internal", ("r", joints), finite=False)
            internals = given["internal"].shape[0]
        if A is not None:
            given["A"] = as_array(A, "A", ("p", m), finite=False)
            inequalities = given["A"].shape[0]
        layout = layout_of(given, each, k, joints, inequalities, internals)
        given["mu"] = [model.mu for model in each]
        given["gamma"] = [model.gamma for model in each]
        given["pull"] = [model.pull for model in each] if layout.pulls else None
        slots = layout.slots
        packed = np.empty(slots["alpha"].stop)
        for name, slot in slots.items():
            value = given[name]
            if value is None and name not in ("f", "alpha"):
                packed[slot.start : slot.stop] = FIELDS[name].default
            else:
                _write(packed, name, slot, value)
        _check_values(layout, packed)
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

    def __getattr__(self, name: str) -> Any:
        """Make a field's view, or the models, when first asked for: many never are."""
        if name == "models":
            layout = self.layout
            pulls = self.pull.tolist() if layout.pulls else [0.0] * len(layout.dims)
            coefficients = zip(
                layout.dims, self.mu.tolist(), self.gamma.tolist(), pulls, strict=True
            )
            value: Any = tuple(model_of(*each) for each in coefficients)
        elif name in FIELDS:
            start, stop, shape = self.layout.slots[name]
            value = float(self.packed[start]) if name == "alpha" else (
                self.packed[start:stop].reshape(shape)
            )  # fmt: skip
        else:
            raise AttributeError(f"'ForceProblem' object has no attribute {name!r}")
        super().__setattr__(name, value)
        return value

    def replace(self, **changes: Unpack[ProblemArguments]) -> ForceProblem:
        """Return a new problem with some arguments changed, validated like any other.

        Raises:
            InvalidInputError: as the constructor; or a name that is no argument of it.
        """
        layout, slots = self.layout, self.layout.slots
        packed = np.array(self.packed)
        for name, value in changes.items():
            slot = slots.get(name)
            if slot is None or not self._keeps_layout(name, slot, value):
                return self._remade(changes)
            _write(packed, name, slot, value)
        _check_values(layout, packed)
        return ForceProblem.from_packed(layout, packed)

    def _keeps_layout(self, name: str, slot: Slot, value: object) -> bool:
        """Whether a new value of a field surely leaves the layout as it is."""
        if value is None or slot.start == slot.stop:
            return False
        if name == "engagement":
            return self.layout.ceilings
        return len(slot.shape) < 2 or getattr(value, "shape", None) == slot.shape

    def _remade(self, changes: ProblemArguments) -> ForceProblem:
        """Return the changed problem by way of the constructor: its layout may be another."""
        arguments = self.arguments()
        require_keywords(changes, arguments, "ForceProblem.replace")
        changed: dict[str, Any] = {**arguments, **changes}
        return ForceProblem(**changed)

    def arguments(self) -> dict[str, Any]:
        """Return the constructor's arguments that make this problem; None where not given."""
        arguments: dict[str, Any] = {"W": self.W, "f": self.f, "models": self.models}
        for name in ProblemOptions.__annotations__:
            value = getattr(self, name)
            left_out = name != "alpha" and (
                value.size == 0
                or (name in ("tau_bias", "engagement") and (value == FIELDS[name].default).all())
            )
            arguments[name] = None if left_out else value
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
    def squeezed(self) -> NDArray[np.bool_]:
        """Which contacts' normal forces are set, c_min = c_max to 1e-9 of n + pull, shape (n,)."""
        if not (self.layout.ceilings and self.layout.floors):
            return np.zeros(self.n, dtype=bool)
        pull = self.pull if self.layout.pulls else 0.0
        return self.c_min + pull >= (1 - SQUEEZE) * (self.c_max + pull)

    @property
    def active(self) -> NDArray[np.bool_]:
        """Which contacts are part of the grasp, shape (n,): engagement above 1e-6."""
        return self.engagement > REMOVAL_THRESHOLD

    @property
    def active_components(self) -> NDArray[np.bool_]:
        """Which components of c belong to contacts that are in the grasp, shape (m,)."""
        return np.repeat(self.active, self.layout.dims)

    @property
    def active_forces(self) -> NDArray[np.bool_]:
        """Which forces take part, shape (m + r,): :attr:`active_components`, all internal ones."""
        return np.append(self.active_components, np.ones(self.layout.internals, dtype=bool))

    @property
    def preload(self) -> Array:
        """What :attr:`pull` makes of the normal components, shape (m + r,) [N]; zeros elsewhere."""
        return preload(self.layout, self.layout.views(self.packed))

    def without_pulls(self) -> ForceProblem:
        """Return the same problem in ``c + preload``, in which all cones are the ordinary ones."""
        if not self.layout.pulls:
            return self
        layout, fields = without_pulls(self.layout, self.layout.views(self.packed))
        packed = [np.ravel(fields[name]) for name in FIELDS if fields[name].size]
        return ForceProblem.from_packed(layout, np.concatenate(packed))

    def restricted(self) -> ForceProblem:
        """Return the problem without the contacts that are out of the grasp.

        Their components leave c and W, their limits and the joints and rows of A that touch no
        other contact leave with them. Where no contact is left there are none in the layout.
        """
        if self.active.all():
            return self
        layout, kept = self.layout, self.active_components
        joints, rows = self._joints_that_count(), _touches(self.A, kept)
        chosen = {"m": kept, "n": self.active, "n_joints": joints, "p": rows}
        chosen["k"] = np.ones(layout.wrench_rows, dtype=bool)
        chosen["r"] = np.ones(layout.internals, dtype=bool)
        packed = [
            view[np.ix_(*(chosen[axis] for axis in FIELDS[name].shape))].ravel()
            for name, view in layout.views(self.packed).items()
            if view.size
        ]
        dims = tuple(np.array(layout.dims)[self.active].tolist())
        inner = layout._replace(dims=dims, joints=int(joints.sum()), inequalities=int(rows.sum()))
        return ForceProblem.from_packed(inner, np.concatenate(packed))

    def scatter(self, c: Array) -> Array:
        """Put forces of the :meth:`restricted` problem back, zeros for the contacts that are out.

        Args:
            c: forces of the contacts that are in the grasp, and all internal forces behind them.

        Returns:
            Forces of all contacts, and the internal ones, shape (m + r,).
        """
        kept = self.active_forces
        whole = np.zeros(len(kept))
        whole[kept] = c
        return whole

    def scatter_multipliers(self, z: Array) -> Array:
        """Put multipliers of :meth:`linear_limits` among zeros for the rows that do not count."""
        counted = self.counted_limits()
        every = np.zeros(len(counted))
        every[counted] = z
        return every

    @property
    def has_limits(self) -> bool:
        """Whether anything but floors limits the forces."""
        layout = self.layout
        return bool(layout.joints or layout.ceilings or layout.inequalities or layout.rate_limits)

    @property
    def cones(self) -> Cones:
        """The friction cones of all contacts."""
        weight = self.cone_weight if self.layout.cone_weights else None
        return Cones.of(self.layout.dims, self.mu, self.gamma, weight)

    @property
    def barriers(self) -> Barriers:
        """The terms of Eq. (16), of a problem :meth:`without_pulls`.

        Of a :meth:`restricted` problem they are those that count. With internal forces they are
        functions of these as well, behind c.
        """
        return Barriers(self.cones, *self.linear_limits(), self.alpha, *self._soft_rows())

    @property
    def exact(self) -> NDArray[np.bool_]:
        """Which rows of W c = f have to hold, shape (k,): those without softness."""
        if not self.layout.soft_wrench:
            return np.ones(len(self.f), dtype=bool)
        return self.f_soft == 0

    @property
    def equalities(self) -> tuple[Array, Array]:
        """W and f, shape (k,), of W c = f with zeros for the soft rows.

        W has shape (k, m + r), with columns of zeros for the internal forces.
        """
        W = _beside(self.W, self.layout.internals)
        if not self.layout.soft_wrench:
            return W, self.f
        return W * self.exact[:, None], self.f * self.exact

    def _soft_rows(self) -> tuple[Array, Array] | tuple[()]:
        """S and t of :class:`graspforce.equations.Barriers`."""
        return soft_rows(self.layout.views(self.packed)) if self.layout.soft_wrench else ()

    def linear_limits(self) -> tuple[Array, Array]:
        """Return every linear limit that counts as ``A c ≤ b`` (Eq. 5, 15 and 20).

        Returns:
            A, shape (v, m + r), and b, shape (v,). Rows in this order: tau_hi, tau_lo, ceilings,
            floors, rates above and below, the problem's own A. The last r columns are for the
            internal forces of the motors. The columns of contacts that are out of the grasp are
            zero, and rows that touch nothing else are left out.
        """
        A, b = all_limits(self.layout, with_bands(self.layout, self.layout.views(self.packed)))
        if self.active.all():
            return A, b
        counted = self.counted_limits()
        return A[counted] * self.active_forces, b[counted]

    def counted_limits(self) -> NDArray[np.bool_]:
        """Which of all the rows :meth:`linear_limits` keeps: not those of removed contacts."""
        layout, kept = self.layout, self.active_components
        joints = self._joints_that_count()
        return np.concatenate(
            [joints] * 2
            + [self.active] * (layout.ceilings + layout.floors)
            + [kept] * (2 * layout.rate_limits)
            + [_touches(self.A, kept)]
        )

    def _joints_that_count(self) -> NDArray[np.bool_]:
        return _touches(np.concatenate((self.J, self.internal)).T, self.active_forces)

    @property
    def undetermined(self) -> int:
        """How many components of c neither W c = f nor the torques determine; 0 without J."""
        if not self.layout.joints:
            return 0
        kept = self.active_components
        return equations.undetermined(self.W[:, kept], self.J[kept])

    def violation_scales(self) -> tuple[Array, Array]:
        """What one unit of relative violation means, for each linear limit and each cone.

        A contact's *reach* is the normal force that alone would use up the tightest range among its
        joints' torques and its ceiling, which pull is added to. A cone may be violated by mu·reach,
        a ceiling or floor by reach, a torque limit or a rate limit by half its range, a row of A by
        what forces of the size of reach make.

        Returns:
            scales of all rows that :meth:`linear_limits` keeps, shape (v,), and of the cones,
            shape (n,).
        """
        if self.layout.pulls:
            return self.without_pulls().violation_scales()
        layout, active = self.layout, self.active
        half = (self.tau_hi - self.tau_lo) / 2
        with np.errstate(divide="ignore"):
            reach = (2 * half / np.abs(self.J[self.starts[:-1]])).min(axis=1, initial=np.inf)
        if layout.ceilings:
            reach = np.minimum(reach, self.engagement * self.c_max)
        known = reach[np.isfinite(reach) & active]
        fallback = known.max() if known.size else float(np.abs(self.f).max()) or 1.0
        reach = np.where(np.isfinite(reach), reach, fallback)
        own = np.abs(self.A) @ np.repeat(reach * active, layout.dims)
        rows = [half] * 2 + [reach] * (layout.ceilings + layout.floors)
        rows += [self.dc_max] * (2 * layout.rate_limits)
        rows += [np.where(own > 0, own, np.maximum(np.abs(self.b), fallback))]
        return np.concatenate(rows)[self.counted_limits()], self.mu * reach

    def wrench_scales(self) -> Array:
        """What one unit of a missing wrench means, for each row of W c = f.

        By these the wrench nearest to f is meant where f itself cannot be had (``Solution.c``).
        Forces count by 1 N. Torques count by the grasp's size: the torque about the origin that a
        newton of contact force makes, root mean square over the force components of the contacts
        in the grasp [m]. So with six rows (behind which further ones may follow) and with
        three, a body in the plane. Any other row counts by the root mean square of its length over
        the contacts.

        Returns:
            Shape (k,) [N, N·m].
        """
        inner = self.restricted()
        return wrench_scales(inner.layout.dims, inner.W)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a ForceProblem is frozen; use problem.replace({name}=…)")

    def __delattr__(self, name: str) -> None:
        raise AttributeError("a ForceProblem is frozen")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ForceProblem):
            return NotImplemented
        return self.layout == other.layout and np.array_equal(self.packed, other.packed)

    def __hash__(self) -> int:
        return hash((self.layout, hash_bytes(self.packed)))

    def __reduce__(self) -> tuple[Any, ...]:
        return (ForceProblem.from_packed, (self.layout, np.array(self.packed)))

    def __repr__(self) -> str:
        counts = Counter(type(model).__name__ for model in self.models)
        contacts = " + ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
        bounds = [f"{self.layout.joints} joints"] if self.layout.joints else []
        bounds += ["ceilings"] if self.layout.ceilings else []
        bounds += ["floors"] if self.layout.floors else []
        bounds += ["rate limits"] if self.layout.rate_limits else []
        bounds += ["soft wrench"] if self.layout.soft_wrench else []
        bounds += ["pulls"] if self.layout.pulls else []
        bounds += [f"{self.layout.internals} internal forces"] if self.layout.internals else []
        bounds += [f"{self.layout.inequalities} inequalities"] if self.layout.inequalities else []
        return (
            f"ForceProblem({contacts}; {', '.join(bounds) or 'no limits'}; "
            f"f={np.array2string(self.f, precision=4)}, alpha={self.alpha:g})"
        )


def row_kinds(k: int) -> tuple[slice, slice]:
    """Return which of k rows of W are a body's forces, and which its torques.

    Those of a body in space come first, with any further rows behind them, or there are the three
    of a body in the plane. Rows of another number are not known to be either.
    """
    forces, torques = (3, 3) if k >= 6 else (2, 1) if k == 3 else (0, 0)
    return slice(0, forces), slice(forces, forces + torques)


def wrench_scales(dims: Sequence[int], W: Array) -> Array:
    """Return :meth:`ForceProblem.wrench_scales` of grasps without contacts that are out.

    Args:
        dims: components of each contact.
        W: grasp maps, shape (…, k, m).
    """
    pushes = np.array([axis < 3 for dim in dims for axis in range(dim)], dtype=bool)
    forces, torques = row_kinds(W.shape[-2])
    with np.errstate(all="ignore"):
        squared = np.square(W).sum(axis=-1) / len(dims)
        by_row = np.square(W[..., pushes]).sum(axis=-1)
        squared[..., forces] = 1.0
        lever = by_row[..., torques].sum(axis=-1) / by_row[..., forces].sum(axis=-1)
        squared[..., torques] = lever[..., None]
    return np.sqrt(np.where((squared > 0) & np.isfinite(squared), squared, 1.0))


def with_bands(layout: Layout, fields: Mapping[str, Array]) -> Mapping[str, Array]:
    """Return the fields with the band between c_min and c_max that a set squeeze leaves."""
    if not (layout.ceilings and layout.floors):
        return fields
    pull = fields["pull"] if layout.pulls else 0.0
    most, least = fields["c_max"] + pull, fields["c_min"] + pull
    return {
        **fields,
        "c_max": np.maximum(most, (1 + SQUEEZE) * least) - pull,
        "c_min": np.minimum(least, (1 - SQUEEZE) * most) - pull,
    }


def all_limits(layout: Layout, fields: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return all linear limits of a problem, or of a batch of them, as ``A c ≤ b``.

    Args:
        layout: of the problems.
        fields: the problems' fields :func:`with_bands`, by name, with any leading axes, see
            :meth:`Layout.views`. Linear in all but the products of engagement and its partners.

    Returns:
        A, shape (…, v, m + r), and b, shape (…, v), in the order of
        :meth:`ForceProblem.linear_limits`.
    """
    arms = np.concatenate((fields["J"], fields["internal"]), axis=-2)
    room = (fields[name] - fields["tau_bias"] for name in ("tau_lo", "tau_hi"))
    parts = [equations.torque_limits(arms, *room)]
    if layout.ceilings:
        parts.append(equations.ceilings(layout.dims, fields["engagement"], fields["c_max"]))
    if layout.floors:
        normals, floors = equations.ceilings(layout.dims, fields["engagement"], fields["c_min"])
        parts.append((-normals, -floors))
    if layout.rate_limits:
        unit = np.eye(sum(layout.dims))
        parts.append((unit, fields["c_last"] + fields["dc_max"]))
        parts.append((-unit, fields["dc_max"] - fields["c_last"]))
    parts.append((fields["A"], fields["b"]))
    batch = fields["f"].shape[:-1]
    width = arms.shape[-2]
    rows = [
        np.broadcast_to(_beside(A, width - A.shape[-1]), (*batch, A.shape[-2], width))
        for A, _ in parts
    ]
    return np.concatenate(rows, axis=-2), np.concatenate([b for _, b in parts], axis=-1)


def soft_rows(fields: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return W and f over f_soft, zero in the exact rows, of a problem or a batch of them."""
    over = np.where(fields["f_soft"] > 0, fields["f_soft"], np.inf)
    W = _beside(fields["W"], fields["internal"].shape[-2])
    return W / over[..., None], fields["f"] / over


def preload(layout: Layout, fields: Mapping[str, Array]) -> Array:
    """Return engagement·pull in the places of the normal forces, shape (…, m + r)."""
    m = sum(layout.dims)
    f = fields["f"]
    shift = np.zeros((*f.shape[:-1], m + layout.internals), f.dtype)
    if layout.pulls:
        there = fields["engagement"] > REMOVAL_THRESHOLD
        normals = np.cumsum((0, *layout.dims[:-1]))
        shift[..., normals] = np.where(there, fields["engagement"] * fields["pull"], 0.0)
    return shift


def without_pulls(layout: Layout, fields: Mapping[str, Array]) -> tuple[Layout, dict[str, Array]]:
    """Return a problem, or a batch of them, in c + :func:`preload`; all cones are ordinary there.

    What is linear has other right-hand sides: ``W (c + p) = f + W p``, and so on.
    """
    if not layout.pulls:
        return layout, dict(fields)
    shift = preload(layout, fields)[..., : sum(layout.dims)]
    moved = dict(fields)
    moved["f"] = equations.slacks(-shift, fields["W"], fields["f"])
    moved["tau_bias"] = fields["tau_bias"] - equations.joint_torques(shift, fields["J"], 0.0)
    moved["b"] = equations.slacks(-shift, fields["A"], fields["b"])
    for name in ("c_max", "c_min"):
        if fields[name].size:
            moved[name] = fields[name] + fields["pull"]
    if layout.rate_limits:
        moved["c_last"] = fields["c_last"] + shift
    moved["pull"] = fields["pull"][..., :0]
    return layout._replace(pulls=False), moved


def _beside(rows: Array, count: int) -> Array:
    """Return rows with so many columns of zeros behind the others: of internal forces."""
    if not count:
        return rows
    return np.concatenate((rows, np.zeros((*rows.shape[:-1], count))), axis=-1)


def _touches(rows: Array, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which rows of limits count: not those that touch contacts, but none that is kept."""
    entries = rows != 0
    return entries[:, kept].any(axis=1) | ~entries.any(axis=1)


def _write(packed: Array, name: str, slot: Slot, value: Any) -> None:
    """Put an argument's numbers into their place, which fixes their shape."""
    field = FIELDS[name]
    if type(value) is not np.ndarray or value.dtype != np.float64 or value.shape != slot.shape:
        shape: tuple[int | str, ...] = slot.shape
        value = as_array(value, name, shape, broadcast=field.broadcast, finite=False)
    packed[slot.start : slot.stop] = value.ravel()


def _check_values(layout: Layout, packed: Array) -> None:
    """Raise for the first number that is not finite or out of its range; the core has the words.

    Raises:
        InvalidInputError: there is one.
    """
    flaw = native.module.find_flaw(layout, packed)
    if flaw is not None:
        native.refuse(flaw)


def require_known(names: Collection[str]) -> None:
    """Raise unless every name is one of an argument of :class:`ForceProblem`.

    Raises:
        InvalidInputError: one is not; the text lists the valid ones.
    """
    require_keywords(names, ProblemOptions.__annotations__, "ForceProblem")


def require_groups(given: Mapping[str, object]) -> None:
    """Raise unless arguments that make sense together alone are given together, or None.

    Raises:
        InvalidInputError: one is missing.
    """
    for group in _GROUPS:
        _together({name: given[name] for name in group})
    for name in ("tau_bias", "internal"):
        if given[name] is not None and given["J"] is None:
            raise InvalidInputError(f"{name}: given without J, tau_lo and tau_hi")
    if given["engagement"] is not None and given["c_max"] is None:
        raise InvalidInputError("engagement: given without c_max, the ceiling that it scales")


def layout_of(
    given: Mapping[str, object],
    models: Sequence[ContactModel],
    k: int,
    joints: int,
    inequalities: int,
    internals: int,
) -> Layout:
    """Return the layout of problems with these arguments, None for one that is not given."""
    return Layout(
        k, tuple(model.dim for model in models), joints, inequalities, given["c_max"] is not None,
        given["c_min"] is not None, given["c_last"] is not None, given["f_soft"] is not None,
        any(model.pull > 0 for model in models), internals, given["cone_weight"] is not None,
    )  # fmt: skip


def _together(arguments: dict[str, object]) -> None:
    given = [name for name, value in arguments.items() if value is not None]
    missing = [name for name, value in arguments.items() if value is None]
    if given and missing:
        raise InvalidInputError(
            f"{missing[0]}: missing; {' and '.join(given)} came without it, "
            f"expected all of {', '.join(arguments)} or none"
        )
