"""Problems whose J is that of a ForceProblem, in Warp arrays: what the front ends hand over.

The kernels want J by contact, so its blocks are gathered, and the gradients scattered back. Which
joints a contact feels is looked up in the numbers of J, in one wait for the device.
"""

# The functions under @wp.kernel are written in Warp's language and compiled from their source.
# pyright: basic
# pyright: reportInvalidTypeForm=false
# ruff: noqa: RUF046, UP018

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp

from graspforce.contact import ContactModel, model_of
from graspforce.errors import InvalidInputError
from graspforce.warp.problems import MOST_JOINTS, Forces, Problems, quiet

wp: Any = warp  # its types are made at run time, out of a type checker's sight
WarpArray = Any

OF_JOINTS = ("tau_lo", "tau_hi", "tau_bias")
TAKEN = (
    "W", "f", "mu", "gamma", "J", *OF_JOINTS, "c_max", "c_min", "engagement", "alpha",
)  # fmt: skip
# What a place without a joint holds: limits on both sides of its torque, which is 0.
FREE = {"tau_lo": -1.0, "tau_hi": 1.0, "tau_bias": 0.0}
ELSEWHERE = "for these use graspforce.solve_batch, or give tensors on the CPU"


def require_taken(names: Sequence[str]) -> None:
    """Raise an InvalidInputError for the first field that the kernels do not take."""
    for name in names:
        if name not in TAKEN:
            raise InvalidInputError(
                f"{name}: got one, which the kernels for a GPU do not take; {ELSEWHERE}"
            )


class Joints(NamedTuple):
    """Which place in the kernels' arrays each joint of J has.

    Attributes:
        places: of each joint; place q·i + k is the k-th of contact i.
        homes: the contact that feels each joint; -1: none.
        each: places of a contact, q.
        contacts: their number.
    """

    places: tuple[int, ...]
    homes: tuple[int, ...]
    each: int
    contacts: int

    @classmethod
    def of(cls, felt: Any) -> "Joints":
        """Give places to joints by what contacts feel, shape (n, n_joints), booleans.

        A joint that no contact feels gets a place that is left: its torque limits count, too.

        Raises:
            InvalidInputError: a joint felt by two contacts, or more joints than places.
        """
        n, count = felt.shape
        shared = np.flatnonzero(felt.sum(axis=0) > 1)
        if shared.size:
            joint = int(shared[0])
            who = ", ".join(map(str, np.flatnonzero(felt[:, joint])))
            raise InvalidInputError(
                f"J: got joint {joint} felt by contacts {who}, expected joints of one contact each "
                f"in the kernels for a GPU; {ELSEWHERE}"
            )
        home = np.where(felt.any(axis=0), felt.argmax(axis=0), -1)
        own = np.bincount(home[home >= 0], minlength=n)
        each = max(1, int(own.max(initial=0)), -(-count // n))
        if each > MOST_JOINTS:
            raise InvalidInputError(
                f"J: got {each} joints a contact, expected at most {MOST_JOINTS} in the kernels "
                f"for a GPU; {ELSEWHERE}"
            )
        places, used = np.zeros(count, dtype=int), np.zeros(n, dtype=int)
        for joint in np.argsort(home < 0, kind="stable").tolist():  # those of nobody come last
            contact = int(home[joint]) if home[joint] >= 0 else int(used.argmin())
            places[joint] = each * contact + used[contact]
            used[contact] += 1
        return cls(tuple(places.tolist()), tuple(home.tolist()), each, n)

    @property
    def in_order(self) -> bool:
        """Whether the places of the joints are the joints themselves."""
        return self.places == tuple(range(self.each * self.contacts))


class Fields:
    """B problems from fields by the names of ForceProblem's, ready to be solved.

    Args:
        fields: arrays of float64 on one device, each with a row for every problem, which may be
            the same memory; J of shape (B, m, n_joints).
        dims: the contacts' components.
        empty: makes an array of a shape and a type on the device of the fields. What it made is
            let go of while the kernels may still run.

    Raises:
        InvalidInputError: what the kernels do not take.
    """

    def __init__(
        self,
        fields: Mapping[str, WarpArray],
        dims: Sequence[int],
        empty: Callable[[tuple[int, ...], Any], WarpArray],
    ) -> None:
        require_taken(list(fields))
        given, self._empty, self._joints = dict(fields), empty, None
        self._device, self._rows = given["f"].device, len(given["f"])
        if "J" in given and given["J"].shape[-1]:
            _load(str(self._device))
            self._contact_of = _indices(
                tuple(i for i, dim in enumerate(dims) for _ in range(dim)), str(self._device)
            )
            self._joints = _placed(self._felt(given["J"], len(dims)).tobytes(), len(dims))
            self._places = _indices(self._joints.places, str(self._device))
            given["J"] = self._by_contact(given["J"])
            for name in OF_JOINTS:
                if name in given and not self._joints.in_order:
                    given[name] = self._gathered(given[name], FREE[name])
        else:
            for name in ("J", *OF_JOINTS):
                given.pop(name, None)
        W, f = given.pop("W"), given.pop("f")
        self._problems = Problems(W, f, _models(tuple(dims)), **given)

    def solve(self, forces: Forces, tol: float, max_steps: int) -> None:
        """Write the forces, torques in the order of J's columns."""
        tau = None if self._joints is None else forces.tau
        if self._joints and not self._joints.in_order:
            tau = self._of_places()
        self._problems.solve(tol=tol, max_steps=max_steps, out=forces._replace(tau=tau))
        if tau is not None and tau is not forces.tau:
            self._scatter(tau, forces.tau)

    def vjp(
        self, forces: Forces, c: WarpArray, tau: WarpArray, out: Mapping[str, WarpArray]
    ) -> None:
        """Write the gradients, of J those by the entries of the joints that a contact feels."""
        inner, by_tau = dict(out), None
        joints = self._joints
        if joints is None:
            for name in ("J", *OF_JOINTS):
                inner.pop(name, None)  # of length 0
        else:
            by_tau = tau if joints.in_order else self._gathered(tau, 0.0)
            if "J" in out:
                shape = (*out["J"].shape[:2], joints.each)
                inner["J"] = self._empty(shape, wp.float64)
            for name in OF_JOINTS:
                if name in out and not joints.in_order:
                    inner[name] = self._of_places()
        self._problems.vjp(forces._replace(tau=None), c=c, tau=by_tau, out=inner)
        if joints is None:
            return
        if "J" in out:
            homes = _indices(joints.homes, str(self._device))
            own = [inner["J"], self._places, homes, self._contact_of, joints.each]
            self._launch(_scatter_J, out["J"].shape, *own, out["J"])
        for name in OF_JOINTS:
            if name in out and not joints.in_order:
                self._scatter(inner[name], out[name])

    def _felt(self, J: WarpArray, contacts: int) -> Any:
        J = J[:1] if not J.strides[0] else J
        felt = wp.zeros((contacts, J.shape[-1]), dtype=wp.bool, device=self._device)
        self._launch(_mark_felt, J.shape, J, self._contact_of, felt)
        return felt.numpy()

    def _by_contact(self, J: WarpArray) -> WarpArray:
        joints, (rows, m, _) = self._joints, J.shape
        assert joints is not None
        blocks = self._empty((rows, m, joints.each), wp.float64)
        blocks.zero_()
        self._launch(
            _gather_J, (rows, J.shape[-1]), J, self._places, self._contact_of, joints.each, blocks
        )
        return blocks

    def _of_places(self) -> WarpArray:
        joints = self._joints
        assert joints is not None
        return self._empty((self._rows, joints.each * joints.contacts), wp.float64)

    def _gathered(self, rows: WarpArray, free: float) -> WarpArray:
        gathered = self._of_places()
        gathered.fill_(free)
        self._launch(_gather, rows.shape, rows, self._places, gathered)
        return gathered

    def _scatter(self, gathered: WarpArray, rows: WarpArray) -> None:
        self._launch(_scatter, rows.shape, gathered, self._places, rows)

    def _launch(self, kernel: Any, shape: tuple[int, ...], *arguments: Any) -> None:
        wp.launch(kernel, shape, list(arguments), device=self._device)


@functools.cache
def _load(device: str) -> None:
    with quiet():
        wp.load_module(__name__, device=device)


# Made once, for a call on a few thousand problems is the host's time in Python.


@functools.lru_cache(maxsize=256)
def _models(dims: tuple[int, ...]) -> tuple[ContactModel, ...]:
    return tuple(model_of(dim, 1.0, 1.0) for dim in dims)


@functools.lru_cache(maxsize=256)
def _placed(felt: bytes, contacts: int) -> Joints:
    """Return the places for what contacts feel, a byte for each contact and joint."""
    return Joints.of(np.frombuffer(felt, dtype=bool).reshape(contacts, -1))


@functools.lru_cache(maxsize=256)
def _indices(values: tuple[int, ...], device: str) -> WarpArray:
    return wp.array(values, dtype=int, device=device)


# ---- kernels -------------------------------------------------------------------------------------

_A2, _A3, _I1 = wp.array2d(dtype=wp.float64), wp.array3d(dtype=wp.float64), wp.array(dtype=int)


@wp.kernel(enable_backward=False)
def _mark_felt(J: _A3, contact_of: _I1, felt: wp.array2d(dtype=wp.bool)):
    b, a, j = wp.tid()
    if J[b, a, j] != wp.float64(0.0) and wp.isfinite(J[b, a, j]):
        felt[contact_of[a], j] = True


@wp.kernel(enable_backward=False)
def _gather_J(J: _A3, places: _I1, contact_of: _I1, each: int, blocks: _A3):
    b, j = wp.tid()
    contact = places[j] // each
    k = places[j] % each
    mine = int(0)
    stray = wp.float64(0.0)
    for a in range(J.shape[1]):
        if contact_of[a] == contact:
            blocks[b, a, k] = J[b, a, j]
            mine = a
        else:
            stray += wp.float64(0.0) * J[b, a, j]  # NaN where it is no number
    if stray != wp.float64(0.0):
        blocks[b, mine, k] = stray


@wp.kernel(enable_backward=False)
def _scatter_J(blocks: _A3, places: _I1, homes: _I1, contact_of: _I1, each: int, J: _A3):
    b, a, j = wp.tid()
    value = wp.float64(0.0)
    if contact_of[a] == homes[j]:
        value = blocks[b, a, places[j] % each]
    J[b, a, j] = value


@wp.kernel(enable_backward=False)
def _gather(rows: _A2, places: _I1, gathered: _A2):
    b, j = wp.tid()
    gathered[b, places[j]] = rows[b, j]


@wp.kernel(enable_backward=False)
def _scatter(gathered: _A2, places: _I1, rows: _A2):
    b, j = wp.tid()
    rows[b, j] = gathered[b, places[j]]
