"""What a Pinocchio model says of drives and limits, and a configuration's kinematics.

A drive is a joint with one degree of freedom. Joints with more (a floating base, a ball joint)
have no single torque to limit and are taken as held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce.errors import MissingExtraError
from graspforce.hands.configuration import stop_notes
from graspforce.hands.limits import DriveLimit, no_ranges
from graspforce.hands.stops import Stops, ends, no_stops
from graspforce.hands.transmission import Transmission, connected_dofs, transmission


def pinocchio_module() -> Any:
    """Return Pinocchio, which has no types of its own.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import pinocchio  # pyright: ignore[reportMissingTypeStubs]
    except ImportError as error:
        raise MissingExtraError("reading URDF models", "Pinocchio", "pinocchio") from error
    module: Any = pinocchio
    return module


class JointDrive(NamedTuple):
    """A joint as a drive."""

    limit: DriveLimit
    dof: int


def joint_drives(model: Any) -> list[JointDrive]:
    """Return the joints of one degree of freedom that follow no other, with their limits."""
    found: list[JointDrive] = []
    for joint in range(1, model.njoints):
        if int(model.nvs[joint]) != 1:
            continue
        dof = int(model.idx_vs[joint])
        slides = _slides(model, joint)
        low, high = float(model.lowerEffortLimit[dof]), float(model.upperEffortLimit[dof])
        limit = DriveLimit(
            str(model.names[joint]), "N" if slides else "N·m", low, high, float(not slides)
        )
        found.append(JointDrive(limit, dof))
    return found


class StopReader:
    """Finds the stops that a model's joints of one degree of freedom lean on."""

    def __init__(self, model: Any) -> None:
        """Look up where their ranges end."""
        joints = [
            joint
            for joint in range(1, model.njoints)
            if int(model.nvs[joint]) == 1 and int(model.nqs[joint]) == 1
        ]
        self._names = [str(model.names[joint]) for joint in joints]
        self._at = [int(model.idx_qs[joint]) for joint in joints]
        self._rows = np.eye(model.nv)[[int(model.idx_vs[joint]) for joint in joints]]
        self._none = no_stops(model.nv)
        self._ends = ends(
            np.column_stack((
                model.lowerPositionLimit[self._at], model.upperPositionLimit[self._at]
            )),
            np.array([not _slides(model, joint) for joint in joints], dtype=bool),
        )  # fmt: skip

    def read(self, q: Array) -> Stops:
        """Return the stops that are leant on at q, shape (nq,)."""
        found = self._ends.leaning(q[self._at], lambda: self._rows, self._names.__getitem__)
        return self._none if found is None else found


def _slides(model: Any, joint: int) -> bool:
    return str(model.joints[joint].shortname()).startswith("JointModelP")


def turning(model: Any) -> NDArray[np.bool_]:
    """Return which degrees of freedom are turns and no slides, shape (nv,)."""
    turns = np.ones(model.nv, dtype=bool)
    for joint in range(1, model.njoints):
        if int(model.nvs[joint]) == 1:
            turns[int(model.idx_vs[joint])] = not _slides(model, joint)
    return turns


def frames_of(model: Any) -> dict[str, int]:
    """Return the frames that a contact can be on, by name: links, user's frames, the world."""
    kinds = pinocchio_module().FrameType
    wanted = (kinds.BODY, kinds.OP_FRAME)
    named = {str(f.name): i for i, f in enumerate(model.frames) if i and f.type in wanted}
    return {str(model.frames[0].name): 0} | named


def dofs_above(model: Any, frame: int) -> NDArray[np.bool_]:
    """Return which degrees of freedom move a frame, shape (nv,); not a floating base's."""
    moving = np.zeros(model.nv, dtype=bool)
    for joint in model.supports[model.frames[frame].parentJoint]:
        if int(model.nvExtendeds[joint]) == 1:  # a mimic joint has its leader's
            moving[int(model.idx_vs[joint])] = True
    return moving


def what_moves(model: Any, links: Sequence[str], couplings: Array) -> NDArray[np.intp]:
    """Return the degrees of freedom that move ``links``, and all that these are coupled with.

    Args:
        model: a ``pinocchio.Model``.
        links: names of frames.
        couplings: joint motions with ``couplings @ dq != 0`` are impossible, shape (p, nv).
    """
    frames = frames_of(model)
    moving = np.zeros(model.nv, dtype=bool)
    for link in links:
        moving |= dofs_above(model, frames[link])
    return connected_dofs(moving, couplings)


class PinocchioConfiguration:
    """A model at a configuration."""

    def __init__(
        self,
        model: Any,
        q: Array,
        dofs: NDArray[np.intp],
        drives: Sequence[JointDrive],
        couplings: Array,
        held: Array,
        leans: bool = True,
        loops: Callable[[Any], Array] | None = None,
    ) -> None:
        """Compute how the drives move the degrees of freedom, and where the frames are.

        Args:
            model: the model.
            q: its configuration, shape (nq,).
            dofs: the degrees of freedom that count.
            drives: the drives.
            couplings: joint motions with ``couplings @ dq != 0`` are impossible, shape (p, nv).
            held: further couplings: joints that are locked.
            leans: whether joints at the ends of their ranges lean on stops.
            loops: returns further couplings, of data with Jacobians: of closed linkages.
        """
        self._model, self._frames, self._dofs = model, frames_of(model), dofs
        self._data = model.createData()
        self._rows = np.eye(model.nv)[[each.dof for each in drives]].reshape(-1, model.nv)
        self._couplings, self._held = couplings, held
        self.ranges = no_ranges(len(drives))
        self._reader = StopReader(model) if leans else None
        self._loops = loops
        self._made_from: tuple[bytes, bytes] | None = None
        self.update(q)

    def update(self, q: Array) -> None:
        """Compute where the frames are at the configuration q, shape (nq,), and what leans."""
        pin, dofs = pinocchio_module(), self._dofs
        self._q = q
        pin.computeJointJacobians(self._model, self._data, q)
        pin.updateFramePlacements(self._model, self._data)
        stops = no_stops(self._model.nv) if self._reader is None else self._reader.read(q)
        stops = stops.on(dofs, self._held)
        coupled = np.vstack((self._couplings, self._held))
        if self._loops is not None:
            coupled = np.vstack((coupled, self._loops(self._data)))
        coupled = coupled[:, dofs]
        made_from = coupled.tobytes(), stops.rows.tobytes()
        if made_from != self._made_from:
            self._made_from = made_from
            self.transmission: Transmission = transmission(self._rows[:, dofs], coupled, stops.rows)
            self.notes = tuple(stop_notes(stops, self.transmission))

    @property
    def data(self) -> Any:
        """The ``pinocchio.Data``, with the places of joints and frames."""
        return self._data

    @property
    def dof_names(self) -> tuple[str, ...]:
        """The joints of the degrees of freedom that ``transmission`` speaks of."""
        names = dof_names(self._model)
        return tuple(names[dof] for dof in self._dofs)

    def twist(self, link: str, point: Array | None) -> Array:
        """Return the velocity of a frame by each joint's, shape (6, n_dofs)."""
        pin = pinocchio_module()
        twist = np.array(
            pin.getFrameJacobian(
                self._model, self._data, self._frames[link], pin.LOCAL_WORLD_ALIGNED
            )
        ).reshape(6, self._model.nv)  # of one joint, Pinocchio gives a vector
        if point is not None:
            twist[:3] += np.cross(twist[3:], point - self.position(link), axis=0)
        return twist[:, self._dofs]

    def position(self, link: str, at: Array | None = None) -> Array:
        """Return the origin of a frame, or the point ``at`` in it, shape (3,) [m]."""
        frame = self._data.oMf[self._frames[link]]
        return np.array(frame.translation if at is None else frame.act(at))

    def chain(self, link: str) -> Array:
        """Return where the joints are that move a link, and the link, from the base, (k, 3) [m]."""
        joints = self._model.supports[self._model.frames[self._frames[link]].parentJoint]
        places = [np.array(self._data.oMi[joint].translation) for joint in joints if joint]
        return np.array([*places, self.position(link)])

    def bias(self) -> Array:
        """Return what all joints must give at rest against gravity, shape (n_dofs,)."""
        pin = pinocchio_module()
        weight = pin.computeGeneralizedGravity(self._model, self._data, self._q)
        return np.array(weight)[self._dofs]


def dof_names(model: Any) -> Mapping[int, str]:
    """Return the name of the joint of every degree of freedom."""
    return {
        int(model.idx_vs[joint]) + i: str(model.names[joint])
        for joint in range(1, model.njoints)
        for i in range(int(model.nvs[joint]))
    }
