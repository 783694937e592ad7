"""The object of a grasp in a MuJoCo model: its bodies, what carries it, and what hangs on it."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspforce._engine import native
from graspforce._util.arrays import Array
from graspforce.errors import InvalidInputError
from graspforce.hands.mujoco.contacts import Indices
from graspforce.hands.mujoco.model import (
    as_body,
    dof_names,
    free_joint_dofs,
    moved_by,
    mujoco_module,
    name_of,
)
from graspforce.hands.transmission import connected_dofs, independent_columns, null_space


class HeldObject:
    """A body that can move, with all that hangs on it.

    Args:
        model: the model.
        body: the body's name or number.

    Attributes:
        top: the body that it is fixed to, from which the object's tree goes down.
        inside: which bodies make it up, shape (nbody,).
        carrying: which degrees of freedom move it, shape (nv,); not a free joint's.

    Raises:
        InvalidInputError: a body that is not there, or that is fixed to the world.
    """

    def __init__(self, model: Any, body: str | int) -> None:
        number = as_body(model, body, "object_body")
        self.top = int(model.body_weldid[number])
        if not self.top:
            raise InvalidInputError(
                f"object_body: {body!r} is fixed to the world, expected a body that can move"
            )
        self.inside = np.zeros(model.nbody, dtype=bool)
        for each in range(self.top, model.nbody):  # a body comes after its parent
            self.inside[each] = each == self.top or self.inside[model.body_parentid[each]]
        moving = moved_by(model, self.top)
        free = free_joint_dofs(model)
        self.carrying = moving & ~free
        self._floats = bool(moving[free].any())
        self._own_dofs = self.inside[model.dof_bodyid] & ~moving
        self._model, self._number = model, number
        self._root_of_dof: Indices = model.body_rootid[model.dof_bodyid].astype(np.intp)

    @property
    def name(self) -> str:
        """The name of its body."""
        return name_of(self._model, mujoco_module().mjtObj.mjOBJ_BODY, self._number)

    def centre(self, data: Any) -> Array:
        """Return its centre of mass, shape (3,) [m]."""
        return np.array(data.subtree_com[self.top])

    def screws(self, data: Any, dofs: Indices) -> Array:
        """Return the motion by each joint's, [linear at its centre; angular], (n_dofs, 6)."""
        return native.module.joint_screws(
            data.cdof, dofs, data.subtree_com, self._root_of_dof, data.subtree_com[self.top]
        )

    def motions(self, data: Any, moments: Array, couplings: Array) -> Array | None:
        """Return the motions that its own joints leave it.

        Args:
            data: the simulation's data.
            moments: the drives' motions by joint motion, shape (n_drives, nv).
            couplings: gradients of the active equalities between joints, shape (p, nv).

        Returns:
            shape (6, k), as [linear at its centre; angular]; None where it moves freely, or motors
            carry it.
        """
        if self._floats or not self.carrying.any():
            return None
        dofs = connected_dofs(self.carrying, couplings)
        if moments[:, dofs].any():
            return None
        screws = self.screws(data, dofs).T * self.carrying[dofs]
        motions = independent_columns(screws @ null_space(couplings[:, dofs]))
        return motions if motions.shape[1] < 6 else None

    def notes(self, moments: Array, motions: Array | None) -> list[str]:
        """Say what else moves with it, and what carries it, a sentence each.

        Args:
            moments: the drives' motions by joint motion, shape (n_drives, nv).
            motions: what :meth:`motions` has returned.
        """
        model, body, notes = self._model, mujoco_module().mjtObj.mjOBJ_BODY, list[str]()
        if self.carrying.any():
            joints = ", ".join(dict.fromkeys(dof_names(model, np.flatnonzero(self.carrying))))
            if motions is not None:
                notes.append(
                    f"{self.name!r} moves by {joints} alone: of f only what works along these "
                    "motions is asked of the contacts, and the joints bear the rest"
                )
            elif self._floats:
                root = name_of(model, body, int(model.body_rootid[self.top]))
                notes.append(
                    f"{self.name!r} hangs by {joints} on {root!r}, which floats: all of f is asked "
                    f"of the contacts; object_body={root!r} counts both"
                )
        held: dict[int, list[str]] = {}
        free = np.flatnonzero(self._own_dofs & ~moments.any(axis=0))
        for dof, joint in zip(free.tolist(), dof_names(model, free), strict=True):
            held.setdefault(int(model.dof_bodyid[dof]), []).append(joint)
        if held:
            parts = ", ".join(
                f"{name_of(model, body, each)} ({model.body_mass[each]:.3g} kg, by "
                f"{', '.join(dict.fromkeys(joints))})"
                for each, joints in held.items()
            )
            notes.append(f"f has to hold what moves on {self.name!r} too: {parts}")
        return notes
