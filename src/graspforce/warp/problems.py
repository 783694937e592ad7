"""B force problems of one layout in Warp arrays: checked once, then solved and differentiated."""

from __future__ import annotations

import functools
import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias, TypedDict, Unpack, cast

import numpy as np
import warp

from graspforce._engine.outcome import Status
from graspforce._engine.settings import Settings
from graspforce._util.arrays import as_integer, as_positive, came, require_choice, require_keywords
from graspforce.contact import ContactModel, contact_starts, model_of, models_for
from graspforce.errors import InvalidInputError, warn
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.solve import solve as solve_on_cpu
from graspforce.warp.kernels import THREADS, WARP, WRENCH, Kernels, Precision, Shape, kernels

wp: Any = warp  # its types are made at run time, out of a type checker's sight
WarpArray: TypeAlias = Any
Values: TypeAlias = Any  # a Warp array or a number

MOST_CONTACTS, MOST_JOINTS = 8, 4
# A step in single precision leaves some 1e-7 of the forces, so less is never reached.
TOL: dict[Precision, float] = {"double": 1e-9, "single": 1e-5}
MAX_STEPS = 25


class Forces(NamedTuple):
    """The contact forces of B problems, in arrays on their device.

    Attributes:
        c: contact forces in the contact frames, shape (B, m) [N, N·m].
        tau: joint torques J.T c + tau_bias, shape (B, n·q) [N·m]; None without J.
        nu: multipliers of W c = f, shape (B, 6).
        status: a value of :class:`graspforce.Status` for each row, shape (B,), int32. SOLVED means
            what it means there; any other, that this method has found nothing, which proves
            nothing: see :meth:`Problems.finish_on_cpu`.
        newton_steps: taken, shape (B,), int32.
    """

    c: WarpArray
    tau: WarpArray | None
    nu: WarpArray
    status: WarpArray
    newton_steps: WarpArray


class Options(TypedDict, total=False):
    """The optional arguments of :class:`Problems`, as keywords."""

    mu: Values | None
    gamma: Values | None
    J: WarpArray | None
    tau_lo: Values | None
    tau_hi: Values | None
    tau_bias: Values | None
    c_max: Values | None
    c_min: Values | None
    engagement: Values | None
    alpha: Values
    precision: Precision


def solve(
    W: WarpArray,
    f: WarpArray,
    models: ContactModel | Sequence[ContactModel],
    *,
    start: WarpArray | None = None,
    tol: float | None = None,
    max_steps: int = MAX_STEPS,
    out: Forces | None = None,
    **options: Unpack[Options],
) -> Forces:
    """Find the contact forces of B problems on the device that their arrays are on.

    The same as ``Problems(W, f, models, …).solve(start, …)``, whose arguments these are; in a loop
    over the same arrays make the :class:`Problems` once.

    Raises:
        InvalidInputError: as :class:`Problems` and :meth:`Problems.solve`.
    """
    problems = Problems(W, f, models, **options)
    return problems.solve(start, tol=tol, max_steps=max_steps, out=out)


class Problems:
    """B force problems of one layout, rows that each are a :class:`graspforce.ForceProblem`.

    Shapes and types are checked here, and a layout's kernels compiled at its first use. The arrays
    are neither copied nor looked into: write new numbers into them and solve again. A row with a
    NaN or with limits that exclude each other comes out as not SOLVED; what else a ForceProblem
    refuses (an engagement above 1, a negative gamma) is taken as it is.

    Each array has a row for every problem, or is itself one row that all of them share, or is a
    number for all entries. Its order in memory is free: what ``warp.from_torch`` and
    ``warp.from_jax`` give without a copy is as good as any.

    At most 8 contacts fit, each with at most 4 joints that no other contact feels. J and the torque
    limits go by contact: column j of contact i's rows of J is joint i·q + j. For a joint that a
    finger lacks stand zeros in J and limits on both sides of zero. What does not fit is for
    :func:`graspforce.solve`.

    Args:
        W: grasp maps, shape (B, 6, m).
        f: wrenches that the fingers exert on the objects, shape (B, 6) [N, N·m]; never shared.
        models: the contacts' models, the same in all rows; one alone stands for all contacts.
        mu: coefficients of friction, shape (B, n); default the models'. Not looked at for FPC.
        gamma: coefficients of torsional friction, shape (B, n) [m], likewise; looked at for SFC.
        J: Jacobians in contact frames of each contact's own joints, shape (B, m, q) [m].
        tau_lo: lower torque limits, shape (B, n·q) [N·m].
        tau_hi: upper torque limits, likewise.
        tau_bias: torques that the fingers need for themselves, likewise; default 0.
        c_max: ceilings of the normal forces, shape (B, n) [N].
        c_min: floors of the normal forces, likewise; at c_max the squeeze is set.
        engagement: shares of c_max and c_min, shape (B, n), 0…1; a contact at 1e-6 or below is out
            of the grasp; default 1.
        alpha: weights of the linear limits, shape (B,); default 5.
        precision: "double" for arrays of float64, "single" for float32.

    Raises:
        InvalidInputError: anything but a Warp array, a wrong shape, type or device, more contacts
            or joints than fit, no limits at all.
    """

    def __init__(
        self,
        W: WarpArray,
        f: WarpArray,
        models: ContactModel | Sequence[ContactModel],
        **options: Unpack[Options],
    ) -> None:
        require_keywords(options, Options.__annotations__, "graspforce.warp")
        given = {name: value for name, value in options.items() if value is not None}
        precision = cast("Precision", given.pop("precision", "double"))
        require_choice(precision, "precision", ("double", "single"))
        real = wp.float64 if precision == "double" else wp.float32
        given = {"W": W, "f": f} | given
        for name in ("W", "f", "J"):
            if name in given:
                _require_array(given[name], name, real)
        B = f.shape[0]
        self.models = _fitting_models(models, W)
        _require_shape(f, "f", (B, WRENCH))
        n, m, q = len(self.models), W.shape[-1], _joints(given, W.shape[-1])
        given = {
            "alpha": 5.0,
            "mu": tuple(model.mu for model in self.models),
            "gamma": tuple(model.gamma for model in self.models),
        } | given
        shapes = {
            "W": (WRENCH, m), "f": (WRENCH,), "mu": (n,), "gamma": (n,), "J": (m, q),
            "tau_lo": (n * q,), "tau_hi": (n * q,), "tau_bias": (n * q,), "c_max": (n,),
            "c_min": (n,), "engagement": (n,), "alpha": (),
        }  # fmt: skip
        self.device = f.device
        if not f.device.is_cuda:
            found = "" if wp.is_cuda_available() else " (Warp finds no CUDA device)"
            warn(
                f"f: on Warp's CPU device{found}, where these kernels run for tests alone; "
                "graspforce.solve is several times as fast there"
            )
        self._arrays = {
            name: _rows(value, name, (B, *shapes[name]), real, f.device)
            for name, value in given.items()
        }
        self._sizes = {"c": m, "tau": n * q, "nu": WRENCH}
        self._shape = Shape(
            tuple(model.dim for model in self.models), q, "c_max" in given, "c_min" in given,
            "engagement" in given, "tau_bias" in given, precision,
            # One contact a thread, in groups of threads that a warp consists of.
            1 << (n - 1).bit_length() if f.device.is_cuda else 1,
        )  # fmt: skip
        self._kernels = _loaded(self._shape, str(f.device))
        self._inputs = _filled(self._kernels.Inputs, self._arrays)
        self._last: tuple[Forces | None, Any] = None, None

    def __len__(self) -> int:
        """Return B."""
        return self._arrays["f"].shape[0]

    def __getitem__(self, row: int) -> ForceProblem:
        """Return the problem of a row, with a copy of its numbers.

        Raises:
            InvalidInputError: there is no such row, or its numbers make no problem.
        """
        if not 0 <= as_integer(row, "row", 0) < len(self):
            raise InvalidInputError(f"row: got {row}, expected less than {len(self)}")
        numbers = {
            name: array[row : row + 1].numpy()[0].astype(float)
            for name, array in self._arrays.items()
        }
        mu, gamma = numbers.pop("mu"), numbers.pop("gamma")
        models = [
            model_of(*each)
            for each in zip((model.dim for model in self.models), mu, gamma, strict=True)
        ]
        if "J" in numbers:
            blocks, q = numbers["J"], self._shape.joints
            numbers["J"] = np.zeros((len(blocks), q * len(models)))
            for i, (start, end) in enumerate(pairwise(contact_starts(models))):
                numbers["J"][start:end, q * i : q * (i + 1)] = blocks[start:end]
        return ForceProblem(models=models, **numbers)

    def solve(
        self,
        start: WarpArray | None = None,
        *,
        tol: float | None = None,
        max_steps: int = MAX_STEPS,
        out: Forces | None = None,
    ) -> Forces:
        """Find the contact forces of every row, Eq. (16), in one launch.

        The host does not wait. With ``out`` nothing is allocated, and the call can be captured in a
        CUDA graph.

        Args:
            start: forces to start from, shape (B, m) [N, N·m]; may be ``out.c``. In a row in which
                they are outside the limits they are ignored.
            tol: certified bound on decrement²/2, as in :class:`graspforce.Settings`; default 1e-9,
                1e-5 in single precision.
            max_steps: the most Newton steps of a row.
            out: where to write: what an earlier call returned, or arrays of one's own; ``tau`` may
                be None.

        Returns:
            The forces with their statuses, on their way.

        Raises:
            InvalidInputError: a wrong argument.
        """
        bound = TOL[self._shape.precision] if tol is None else as_positive(tol, "tol")
        most = as_integer(max_steps, "max_steps", 1)
        if start is not None:
            self._require(start, "start", self._sizes["c"])
        if out is None:
            out = self._allocate_forces()
        outputs = self._outputs(out, "out")
        self._launch(self._kernels.solve, [self._inputs, start, outputs, bound, most])
        return out

    def vjp(
        self,
        forces: Forces,
        *,
        c: WarpArray | None = None,
        tau: WarpArray | None = None,
        wanted: Sequence[str] | None = None,
        out: Mapping[str, WarpArray] | None = None,
    ) -> dict[str, WarpArray]:
        """Return the gradients of a number L by the problems' numbers, from those by the forces.

        The derivative of the optimum by the implicit function theorem, from one factorisation at
        ``forces.c``; as exact as that is, so solve with a ``tol`` of 1e-15 where it matters. In a
        row that is not SOLVED all are zero. Of an array that the problems share each row gets the
        gradient by its own use of it: add them up. Where W has dependent rows, the gradients by f
        and W are those for changes that leave f in the range of W.

        Args:
            forces: what :meth:`solve` found for these numbers.
            c: dL/dc, shape (B, m).
            tau: dL/dtau, shape (B, n·q).
            wanted: names of the arguments to differentiate by, "W", "f", "mu" …; default those with
                a row for every problem. What is not wanted is not written.
            out: arrays to write to, by name, in place of ``wanted``.

        Returns:
            The gradients by name, shape (B, …).

        Raises:
            InvalidInputError: a wrong argument.
        """
        outputs = self._outputs(forces, "forces")
        if c is not None:
            self._require(c, "c", self._sizes["c"])
        if tau is not None:
            self._require(tau, "tau", self._sizes["tau"])
        if out is None:
            own = [name for name, array in self._arrays.items() if array.strides[0]]
            names = own if wanted is None else wanted
            require_keywords(names, self._arrays, "these problems")
            out = {name: self._allocate_gradient(name) for name in names}
        else:
            require_keywords(out, self._arrays, "these problems")
            for name, array in out.items():
                _require_array(array, f"out[{name!r}]", self._kernels.real, self.device)
                _require_shape(array, f"out[{name!r}]", self._arrays[name].shape)
        gradients = _filled(self._kernels.Inputs, out)
        self._launch(self._kernels.vjp, [self._inputs, outputs, c, tau, gradients])
        return dict(out)

    def finish_on_cpu(
        self, forces: Forces, settings: Settings | None = None
    ) -> dict[int, Solution]:
        """Hand the rows that are not SOLVED to :func:`graspforce.solve`, which gives proofs.

        Its forces, multipliers, statuses and steps are written into ``forces``. One row after the
        other, some 0.5 ms each: meant for the few.

        Args:
            forces: what :meth:`solve` found for these numbers.
            settings: of :func:`graspforce.solve`.

        Returns:
            The solutions by row.

        Raises:
            InvalidInputError: a wrong argument, or a row whose numbers make no problem.
        """
        self._outputs(forces, "forces")
        solutions: dict[int, Solution] = {}
        for row in np.flatnonzero(forces.status.numpy() != Status.SOLVED).tolist():
            solutions[row] = solution = solve_on_cpu(self[row], settings)
            for name, array in forces._asdict().items():
                if array is not None:
                    array[row : row + 1].assign(np.asarray(getattr(solution, name))[np.newaxis])
        return solutions

    # ---- what the methods share ------------------------------------------------------------------

    def _launch(self, kernel: Any, arguments: list[Any]) -> None:
        threads = len(self) * self._shape.lanes
        if self.device.is_cuda:  # whole warps: their threads wait for each other
            threads = -(-threads // WARP) * WARP
        block = _block(self.device)
        if threads:
            wp.launch(kernel, threads, arguments, device=self.device, block_dim=block)

    def _require(self, array: WarpArray, name: str, size: int) -> None:
        _require_array(array, name, self._kernels.real, self.device)
        _require_shape(array, name, (len(self), size))

    def _outputs(self, forces: Forces, name: str) -> Any:
        """Return the structure of the arrays of ``forces``, checked unless it was the last one."""
        if forces is not self._last[0]:
            for kind, size in self._sizes.items():
                if kind != "tau" or forces.tau is not None:
                    self._require(getattr(forces, kind), f"{name}.{kind}", size)
            for kind in ("status", "newton_steps"):
                _require_array(getattr(forces, kind), f"{name}.{kind}", wp.int32, self.device)
                _require_shape(getattr(forces, kind), f"{name}.{kind}", (len(self),))
            self._last = forces, _filled(self._kernels.Outputs, forces._asdict())
        return self._last[1]

    def _allocate_forces(self) -> Forces:
        B, real, device = len(self), self._kernels.real, self.device
        c, tau, nu = (
            wp.empty((B, size), dtype=real, device=device) for size in self._sizes.values()
        )
        status, steps = (wp.empty(B, dtype=wp.int32, device=device) for _ in range(2))
        return Forces(c, tau if self._shape.joints else None, nu, status, steps)

    def _allocate_gradient(self, name: str) -> WarpArray:
        # The numbers of one kind stand side by side in memory: most of the time of vjp goes into
        # writing, and this takes a quarter less.
        B, *row = self._arrays[name].shape
        array = wp.empty((*row, B), dtype=self._kernels.real, device=self.device)
        return array.transpose((len(row), *range(len(row))))


@functools.cache
def _loaded(shape: Shape, name: str) -> Kernels:
    """Return the kernels of a shape, compiled and on the device of a name."""
    found, device = kernels(shape), wp.get_device(name)
    with quiet():
        for kernel in (found.solve, found.vjp):
            wp.load_module(kernel.module, device=device, block_dim=_block(device))
    return found


@contextmanager
def quiet() -> Generator[None]:
    """Keep Warp from printing what it compiles; its warnings stay."""
    level = wp.config.log_level
    wp.config.log_level = max(level, wp.LOG_WARNING)
    try:
        yield
    finally:
        wp.config.log_level = level


def _block(device: Any) -> int:
    return THREADS if device.is_cuda else 1


def _filled(structure: Any, arrays: Mapping[str, WarpArray | None]) -> Any:
    filled = structure()
    for name, array in arrays.items():
        if array is not None:
            setattr(filled, name, array)
    return filled


# ---- arrays ------------------------------------------------------------------------------------


def _rows(value: Values, name: str, shape: tuple[int, ...], real: Any, device: Any) -> WarpArray:
    """Return an array with a row for every problem; where they share one, a view of it."""
    entries = math.prod(shape[1:])
    if isinstance(value, tuple):
        row = _constant(cast("tuple[float, ...]", value), real, str(device))
    elif isinstance(value, int | float):
        row = _constant((float(value),) * entries, real, str(device))
    else:
        _require_array(value, name, real, device)
        if value.shape != shape[1:]:
            _require_shape(value, name, shape)
            return value
        row = value
    strides = (0, *row.strides)[: len(shape)]
    view = wp.array(ptr=row.ptr, dtype=real, shape=shape, strides=strides, device=device)
    view._ref = row  # keeps the memory
    return view


@functools.lru_cache(maxsize=256)
def _constant(numbers: tuple[float, ...], real: Any, device: str) -> WarpArray:
    """Return numbers on the device, made once: what a CUDA graph captures must not allocate."""
    return wp.array(numbers, dtype=real, device=device)


def _require_array(value: WarpArray, name: str, dtype: Any, device: Any = None) -> None:
    if not isinstance(value, wp.array):
        raise InvalidInputError(
            f"{name}: got {came(value)}, expected a warp.array; warp.from_torch and warp.from_jax "
            "make one of a tensor on the GPU; for arrays in the host's memory use graspforce.solve"
        )
    if value.dtype != dtype:
        fits = {wp.float64: ' with precision="double"', wp.float32: ' with precision="single"'}
        raise InvalidInputError(
            f"{name}: got {value.dtype.__name__}, expected {dtype.__name__}{fits.get(dtype, '')}"
        )
    if device is not None and value.device != device:
        raise InvalidInputError(
            f"{name}: got an array on {value.device}, expected {device} as of f"
        )


def _require_shape(array: WarpArray, name: str, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise InvalidInputError(f"{name}: got shape {array.shape}, expected {shape}")


# ---- what fits ---------------------------------------------------------------------------------


def _fitting_models(
    models: ContactModel | Sequence[ContactModel], W: WarpArray
) -> tuple[ContactModel, ...]:
    """Return the model of each contact; W is known to be an array and no more."""
    if W.ndim not in (2, 3) or W.shape[-2] != WRENCH:
        raise InvalidInputError(
            f"W: got shape {W.shape}, expected (B, {WRENCH}, m); for a body in the plane add "
            "rows of zeros to W and f, or use graspforce.solve"
        )
    each = models_for(models, W.shape[-1])
    if len(each) > MOST_CONTACTS:
        raise InvalidInputError(
            f"models: got {len(each)} contacts, expected at most {MOST_CONTACTS}; for more use "
            "graspforce.solve"
        )
    if any(model.pull > 0 for model in each):
        raise InvalidInputError(
            "models: got contacts that pull, expected none; for these use graspforce.solve"
        )
    return each


def _joints(given: Mapping[str, Any], m: int) -> int:
    """Return the number of joints of a contact, and look whether what belongs together is there."""
    if "J" not in given and "c_max" not in given:
        raise InvalidInputError(
            "J, c_max: got neither, expected limits: without any the grip could be squeezed "
            "for ever"
        )
    for names, needed in (
        (("J",), ("tau_lo", "tau_hi")),
        (("tau_lo", "tau_hi", "tau_bias"), ("J",)),
        (("engagement",), ("c_max",)),
    ):
        for name in names:
            for other in needed:
                if name in given and other not in given:
                    raise InvalidInputError(f"{name}: given without {other}")
    if "J" not in given:
        return 0
    shape = given["J"].shape
    if len(shape) not in (2, 3) or shape[-2] != m or not 1 <= shape[-1] <= MOST_JOINTS:
        raise InvalidInputError(
            f"J: got shape {shape}, expected (B, {m}, q) with each contact's own q joints, at most "
            f"{MOST_JOINTS}; for more, or joints that contacts share, use graspforce.solve"
        )
    return shape[-1]
