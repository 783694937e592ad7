"""Hands from MuJoCo models: MJCF files, or an MjModel that is loaded already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array, came
from graspforce.errors import InvalidInputError, ModelImportError, warn
from graspforce.hands.configuration import (
    choose_motors,
    locking_rows,
    notes_of,
    range_notes,
    warnings_of,
)
from graspforce.hands.imported import (
    ImportedHand,
    as_fingertips,
    fingers_of,
)
from graspforce.hands.limits import DriveLimit
from graspforce.hands.loops import Coupling, closed
from graspforce.hands.mujoco.model import (
    CouplingReader,
    Drive,
    DriveReader,
    MujocoConfiguration,
    StopReader,
    body_of,
    coupling_rows,
    dof_names,
    dofs_above,
    drives,
    every_dof,
    is_plain_motor,
    joints_as_drives,
    links_of,
    loose_bodies,
    mujoco_module,
    name_of,
    taking_part,
    turning,
)
from graspforce.hands.stops import no_stops
from graspforce.hands.transmission import connected_dofs


def from_mjcf(
    source: str | Path | Any,
    fingertips: Sequence[str] | Mapping[str, str],
    tau_max: float | Mapping[str, float] | None = None,
    locked: Sequence[str] = (),
    motors: Sequence[str] | None = None,
) -> ImportedHand:
    """Read a hand from a MuJoCo model.

    A mount that floats (a free joint) is taken as held where the file has it. Joint equalities
    and closed linkages are followed; a joint or tendon without a motor becomes an equation that
    the contact forces have to satisfy (``ImportedHand.passive_rows``), or where it leans on its
    stop, an inequality.

    Args:
        source: an MJCF file, whose meshes need not be there, or an ``mujoco.MjModel``.
        fingertips: bodies or sites, one a finger; a mapping names the fingers.
        tau_max: torque limits in place of the file's, both ways unless the file's motor acts one
            way only: one number for all drives, or by name [N·m; N for slides and tendons]. A
            joint without a motor that it names gets one; where the file has no motors, one
            number makes motors of all hinges and slides that follow no other joint.
        locked: joints that are held whatever the contacts do to them, as by brakes.
        motors: the joints and tendons that have motors, in place of what the file says.

    Returns:
        The hand, contacts in the frame of the model's world. What should not be believed
        silently (implausible limits, motions that nothing controls) is in ``notes`` and is a
        GraspForceWarning.

    Raises:
        MissingExtraError: MuJoCo is not installed.
        ModelImportError: the file is missing or no model; a finger that no motor moves; a drive
            without a torque limit; a ball joint in a finger.
        InvalidInputError: a fingertip or a name in tau_max, locked or motors that is not there.
    """
    model, missing = _load(source)
    tips = as_fingertips(fingertips, links_of(model))
    bodies = tuple(dict.fromkeys(body_of(model, link) for link in tips.values()))
    candidates, motor_notes = drives(model)
    candidates += joints_as_drives(model, candidates, tau_max, motors)
    held = locking_rows(locked, dof_names(model, every_dof(model)))
    data = _evaluated(model, model.qpos0)
    above, moments = dofs_above(model), DriveReader(model, candidates).read(data)
    tied = coupling_rows(model, data)
    dofs = connected_dofs(np.any(above[list(bodies)], axis=0), np.vstack((moments, tied)))
    acting = taking_part(moments * ~held.any(axis=0), dofs)
    chosen = choose_motors([candidates[i] for i in acting], tau_max, motors)
    configuration = MujocoConfiguration(model, data, dofs, chosen.drives, held, no_stops(model.nv))
    fingers = fingers_of(configuration, chosen, tips)
    robot = MujocoRobot(
        model, dofs, chosen.drives, _joints(model, dofs.tolist(), chosen.joint_names),
        _links(model, dofs, above, loose_bodies(model, moments)), held, StopReader(model),
    )  # fmt: skip
    told = (chosen, configuration.transmission, configuration.dof_names)
    warnings = (*missing, *warnings_of(*told))
    warn(*warnings)
    notes = (
        *warnings,
        *notes_of(*told, locked, model.dof_frictionloss[dofs]),
        *range_notes(configuration.ranges, configuration.transmission),
        *motor_notes,
    )
    return ImportedHand(
        chosen.joint_names, robot.q_names, chosen.tau_lo, chosen.tau_hi, fingers, tips,
        tuple(tips.values()), notes, robot,
    )  # fmt: skip


def default_fingertips(source: str | Path | Any, tau_max: Any = None) -> tuple[str, ...]:
    """Return the last bodies of the chains that motors move, or the nearest body with a name.

    Args:
        source: as for :func:`from_mjcf`.
        tau_max: likewise.

    Raises:
        ModelImportError: the file is missing or no model.
    """
    model, _ = _load(source)
    candidates, _ = drives(model)
    candidates += joints_as_drives(model, candidates, tau_max)
    data = _evaluated(model, model.qpos0)
    moments = DriveReader(model, candidates).read(data)
    rows = np.vstack((moments, coupling_rows(model, data)))
    driven = np.zeros(model.nv, dtype=bool)
    driven[connected_dofs(np.any(moments != 0, axis=0), rows)] = True
    moved: NDArray[np.bool_] = np.any(dofs_above(model) & driven, axis=1)
    last = moved.copy()
    last[model.body_parentid[moved]] = False
    named = set(links_of(model))
    tips: list[str] = []
    for body in np.flatnonzero(last).tolist():
        kind = mujoco_module().mjtObj.mjOBJ_BODY
        while moved[body] and name_of(model, kind, body) not in named:
            body = int(model.body_parentid[body])
        if moved[body]:
            tips.append(name_of(model, kind, body))
    return tuple(dict.fromkeys(tips))


def limit_sources(model: Any, drive: Drive) -> str:
    """Return which of the file's numbers limit a drive: ``forcerange, actuatorfrcrange``, say."""
    mj, found = mujoco_module(), dict[str, None]()
    moments = [model.actuator_outadr[i] for i in range(model.nactuator)]
    if drive.output not in moments:
        return ""
    first = moments.index(drive.output)
    kind, target = int(model.actuator_trntype[first]), int(model.actuator_trnid[first, 0])
    for motor in range(model.nactuator):
        same = (int(model.actuator_trntype[motor]), int(model.actuator_trnid[motor, 0]))
        if same != (kind, target):
            continue
        if model.actuator_forcelimited[motor]:
            found["forcerange"] = None
        if model.actuator_gaintype[motor] == int(mj.mjtGain.mjGAIN_MUSCLE):
            found["muscle's force"] = None
        elif (
            is_plain_motor(model, motor)
            and model.actuator_ctrllimited[int(model.actuator_ctrladr[motor])]
        ):
            found["ctrlrange"] = None
    which = "tendon" if kind == int(mj.mjtTrn.mjTRN_TENDON) else "jnt"
    if getattr(model, f"{which}_actfrclimited")[target]:
        found["actuatorfrcrange"] = None
    return ", ".join(found)


class _Follower(NamedTuple):
    """A joint equality: a joint's angle is a polynomial in another's, both from qpos0."""

    joint: int
    leader: int  # −1: the joint is locked
    polynomial: tuple[float, ...]  # lowest power first


class _Joints(NamedTuple):
    """Which joints q is about, and which follow them."""

    free: tuple[int, ...]
    followers: tuple[_Follower, ...]


@dataclass(frozen=True, slots=True, eq=False)
class MujocoRobot:
    """A MuJoCo model as the kinematics of a hand."""

    model: Any
    dofs: NDArray[np.intp]
    drives: tuple[Drive, ...]
    joints: _Joints
    links: tuple[str, ...]
    held: Array
    stops: StopReader

    @property
    def limits(self) -> tuple[tuple[DriveLimit, str], ...]:
        """The file's limits of the drives, and which of its numbers they come from."""
        return tuple((each.limit, limit_sources(self.model, each)) for each in self.drives)

    @property
    def q_names(self) -> tuple[str, ...]:
        """The joints whose angles make a configuration."""
        joint = mujoco_module().mjtObj.mjOBJ_JOINT
        return tuple(name_of(self.model, joint, index) for index in self.joints.free)

    def configuration(self, q: Array) -> MujocoConfiguration:
        """Return the robot at the joint angles q; whatever else the model has is at qpos0.

        Raises:
            InvalidInputError: a closed linkage stays open whatever its joints do.
        """
        address, start = self.model.jnt_qposadr, self.model.qpos0
        qpos = np.array(start)
        qpos[address[list(self.joints.free)]] = q
        for _ in self.joints.followers:  # a follower may lead another
            for joint, leader, polynomial in self.joints.followers:
                at = address[leader]
                turned = 0.0 if leader < 0 else qpos[at] - start[at]
                qpos[address[joint]] = start[address[joint]] + np.polynomial.polynomial.polyval(
                    turned, polynomial
                )
        qpos, notes = self._closed(qpos)
        data = _evaluated(self.model, qpos)
        return MujocoConfiguration(
            self.model, data, self.dofs, self.drives, self.held, self.stops.read(data), notes
        )

    def _closed(self, qpos: Array) -> tuple[Array, list[str]]:
        """Return the posture with closed linkages that qpos stands for, and notes on the way."""
        model, dofs = self.model, self.dofs
        address = model.jnt_qposadr[model.dof_jntid[dofs]]
        couplings = CouplingReader(model)

        def at(positions: Array) -> Array:
            moved = np.array(qpos)
            moved[address] = positions
            return moved

        def read(positions: Array) -> list[Coupling]:
            found = couplings.read(_evaluated(model, at(positions)))
            return [each._replace(rows=each.rows[:, dofs]) for each in found]

        drives = DriveReader(model, self.drives).read(_evaluated(model, qpos))[:, dofs]
        alone = np.count_nonzero(drives, axis=1) == 1
        positions, notes = closed(
            qpos[address], model.qpos0[address], read, turning(model)[dofs],
            np.any(drives, axis=0), np.any(drives[alone], axis=0),
            np.any(self.held[:, dofs], axis=0), dof_names(model, dofs),
        )  # fmt: skip
        return at(positions), notes


def _load(source: Any) -> tuple[Any, list[str]]:
    """Return the model, and what should not be believed silently of its masses."""
    mj = mujoco_module()
    if isinstance(source, mj.MjModel):
        return source, []
    if not isinstance(source, str | Path):
        raise InvalidInputError(f"source: got {came(source)}, expected a path or an mujoco.MjModel")
    path = Path(source)
    if not path.is_file():
        raise ModelImportError(f"{path}: there is no such file")
    if path.suffix.lower() == ".urdf":  # MuJoCo reads them, but finds no motors
        raise ModelImportError(f"{path}: a URDF names no motors; hands.from_urdf reads it")
    warnings: list[str] = []
    try:
        try:
            model = mj.MjModel.from_xml_path(str(path))
        except ValueError:
            spec = mj.MjSpec.from_file(str(path))
            warnings = _stand_in_for_meshes(spec, path.parent)
            model = spec.compile()
    except ValueError as error:
        raise ModelImportError(f"{path}: not a model that MuJoCo reads: {error}") from error
    if model.nbody == 1:  # MuJoCo takes any other XML for a model with nothing in it
        raise ModelImportError(f"{path}: not a model that MuJoCo reads: it has no bodies")
    return model, warnings


def _stand_in_for_meshes(spec: Any, folder: Path) -> list[str]:
    """Put a small tetrahedron in place of every mesh whose file is missing; say so.

    Kinematics need no meshes, but MuJoCo does.
    """
    missing = [
        mesh
        for mesh in spec.meshes
        if mesh.file
        and not any((folder / place / mesh.file).is_file() for place in (spec.meshdir, "."))
    ]
    for mesh in missing:
        mesh.uservert = [0, 0, 0, 0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01]
        mesh.scale = [1, 1, 1]
    names = {mesh.name for mesh in missing}
    guessed = [
        body.name or "a body without a name"
        for body in spec.bodies
        if not body.explicitinertial and any(geom.meshname in names for geom in body.geoms)
    ]
    files = ", ".join(mesh.file for mesh in missing)
    for mesh in missing:
        mesh.file = ""
    if not guessed:
        return []
    return [
        f"mesh files are missing ({files}), and with them the weight of {', '.join(guessed)}: "
        "tau_bias lacks it"
    ]


def _evaluated(model: Any, qpos: Array) -> Any:
    """Return new data at rest at qpos: positions, moment arms, couplings, forces; no collisions."""
    mj = mujoco_module()
    data = mj.MjData(model)
    data.qpos[:] = qpos
    for stage in (
        mj.mj_kinematics, mj.mj_comPos, mj.mj_flex, mj.mj_tendon, mj.mj_transmission,
        mj.mj_makeConstraint, mj.mj_fwdVelocity,
    ):  # fmt: skip
        stage(model, data)
    return data


def _links(
    model: Any, dofs: NDArray[np.intp], above: NDArray[np.bool_], loose: NDArray[np.bool_]
) -> tuple[str, ...]:
    """Return the bodies and sites that a contact can be on: fixed, or moved by the hand alone."""
    usable = ~np.delete(above, dofs, axis=1).any(axis=1) & ~loose
    return tuple(link for link in links_of(model) if usable[body_of(model, link)])


def _joints(model: Any, dofs: Sequence[int], driven: Sequence[str]) -> _Joints:
    mj = mujoco_module()
    joints = list(dict.fromkeys(int(model.dof_jntid[dof]) for dof in dofs))
    names = {joint: name_of(model, mj.mjtObj.mjOBJ_JOINT, joint) for joint in joints}
    for joint, name in names.items():
        if model.jnt_type[joint] == int(mj.mjtJoint.mjJNT_BALL):
            raise ModelImportError(
                f"ball joint {name!r} moves a finger; expected hinges and slides"
            )
    followers: list[_Follower] = []
    for each in range(model.neq):
        if model.eq_type[each] != int(mj.mjtEq.mjEQ_JOINT) or not model.eq_active0[each]:
            continue
        joint, leader = int(model.eq_obj1id[each]), int(model.eq_obj2id[each])
        polynomial = tuple(float(a) for a in model.eq_data[each, :5])
        if joint not in names or (leader >= 0 and leader not in names):
            continue
        straight = polynomial[1] and not any(polynomial[2:])
        if leader >= 0 and names[joint] in driven and names[leader] not in driven and straight:
            # The one with the motor leads.
            joint, leader = leader, joint
            polynomial = (-polynomial[0] / polynomial[1], 1 / polynomial[1])
        followers.append(_Follower(joint, leader, polynomial))
    following = {each.joint for each in followers}
    return _Joints(tuple(j for j in joints if j not in following), tuple(followers))
