"""What a MuJoCo model says of drives, limits and couplings, and a configuration's kinematics.

A drive is a joint or a tendon with motors. Motors on sites, bodies, sliders and cranks, or on
ball joints have no single torque to limit and are left out, by name. The base of a free-floating
robot is taken as held: its six free degrees of freedom are in nobody's Jacobian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from graspforce._engine import native
from graspforce._util.arrays import Array, came, index_of
from graspforce.errors import InvalidInputError, MissingExtraError, ModelImportError
from graspforce.hands.configuration import as_names, stop_notes
from graspforce.hands.imported import as_link
from graspforce.hands.limits import DriveLimit, JointRanges, as_tau_max, no_ranges
from graspforce.hands.loops import Coupling, rows_of
from graspforce.hands.stops import Stops, ends, no_stops
from graspforce.hands.transmission import Transmission, transmission


def mujoco_module(purpose: str = "reading MuJoCo models", extra: str = "mujoco") -> Any:
    """Return MuJoCo, which has no types of its own.

    Args:
        purpose: what it is needed for, for the error's text.
        extra: the extra that brings it.

    Raises:
        MissingExtraError: it is not installed.
        ModelImportError: it cannot be imported: MUJOCO_GL names an OpenGL that is not there.
    """
    try:
        import mujoco  # pyright: ignore[reportMissingTypeStubs]
    except ImportError as error:
        raise MissingExtraError(purpose, "mujoco", extra) from error
    except Exception as error:  # it opens OpenGL's library as it is imported, which fails variously
        raise ModelImportError(
            f"MuJoCo cannot be imported ({error}); if its OpenGL is missing, set MUJOCO_GL=disable"
        ) from error
    module: Any = mujoco
    return module


_Kind: TypeAlias = Literal["place", "turn", "ratio"]


class Drive(NamedTuple):
    """A joint or tendon with motors."""

    limit: DriveLimit
    output: int
    """The output of one of its motors, whose moment arms over ``gear`` are the drive's; of a joint
    without a motor in the file, nout and its degree of freedom.
    """
    gear: float
    joint: int
    """Its number; −1 for a tendon, which may have a joint's name."""


def drives(model: Any) -> tuple[list[Drive], list[str]]:
    """Return the drives of a model with their limits, and notes on motors that are none."""
    mj = mujoco_module()
    joint_types = (int(mj.mjtTrn.mjTRN_JOINT), int(mj.mjtTrn.mjTRN_JOINTINPARENT))
    tendon_type = int(mj.mjtTrn.mjTRN_TENDON)
    hinge, slide = int(mj.mjtJoint.mjJNT_HINGE), int(mj.mjtJoint.mjJNT_SLIDE)
    found: dict[tuple[bool, int], Drive] = {}
    notes: list[str] = []
    for motor in range(model.nactuator):
        kind, target = int(model.actuator_trntype[motor]), int(model.actuator_trnid[motor, 0])
        output = int(model.actuator_outadr[motor])  # of a motor for a ball joint, the first of 3
        gear = float(model.actuator_gear[output, 0])
        if kind == int(mj.mjtTrn.mjTRN_BODY):
            notes.append(_adhesion_note(mj, model, motor))
            continue
        at_tendon = kind == tendon_type
        at_joint = kind in joint_types and int(model.jnt_type[target]) in (hinge, slide)
        if not gear or not (at_tendon or at_joint):
            name = name_of(model, mj.mjtObj.mjOBJ_ACTUATOR, motor)
            notes.append(f"motor {name!r} is left out: it drives neither a joint nor a tendon")
            continue
        if _is_muscle(model, motor):
            name = name_of(model, mj.mjtObj.mjOBJ_ACTUATOR, motor)
            notes.append(
                f"muscle {name!r} only pulls; its limit is its peak force, which it has at its "
                "optimal length and full activation alone"
            )
        low, high = sorted(gear * side for side in _motor_range(mj, model, motor))
        if (at_tendon, target) in found:  # motors side by side add up
            other = found[at_tendon, target]
            limit = other.limit._replace(lo=other.limit.lo + low, hi=other.limit.hi + high)
            found[at_tendon, target] = other._replace(limit=limit)
            continue
        kind_of_object = mj.mjtObj.mjOBJ_TENDON if at_tendon else mj.mjtObj.mjOBJ_JOINT
        at_hinge = at_joint and int(model.jnt_type[target]) == hinge
        limit = DriveLimit(
            name_of(model, kind_of_object, target), "N·m" if at_hinge else "N", low, high,
            _moment_arm(mj, model, target) if at_tendon else float(at_hinge),
        )  # fmt: skip
        found[at_tendon, target] = Drive(limit, output, gear, -1 if at_tendon else target)
    for (at_tendon, target), drive in found.items():
        which = "tendon" if at_tendon else "jnt"
        if getattr(model, f"{which}_actfrclimited")[target]:
            low, high = getattr(model, f"{which}_actfrcrange")[target]
            limit = drive.limit._replace(
                lo=max(drive.limit.lo, float(low)), hi=min(drive.limit.hi, float(high))
            )
            found[at_tendon, target] = drive._replace(limit=limit)
    return list(found.values()), notes


def adhesions(model: Any) -> list[tuple[int, int]]:
    """Return the actuators that make a body stick to what it touches, with its number."""
    sticks = model.actuator_trntype == int(mujoco_module().mjtTrn.mjTRN_BODY)
    motors: list[int] = np.flatnonzero(sticks).tolist()
    return [(motor, int(model.actuator_trnid[motor, 0])) for motor in motors]


def adhesion_force(model: Any, data: Any, motor: int) -> float:
    """Return what an adhesion pulls with as it is controlled now [N]; 0 if it pushes.

    By its control where that decides, which is known before the actuators' stage has run.
    """
    force = float(data.actuator_force[motor])
    if is_plain_motor(model, motor):
        low, high = _motor_range(mujoco_module(), model, motor)
        control = float(data.ctrl[int(model.actuator_ctrladr[motor])])
        force = min(max(float(model.actuator_gainprm[motor, 0]) * control, low), high)
    return max(force, 0.0)


def _adhesion_note(mj: Any, model: Any, motor: int) -> str:
    name = name_of(model, mj.mjtObj.mjOBJ_ACTUATOR, motor)
    body = name_of(model, mj.mjtObj.mjOBJ_BODY, int(model.actuator_trnid[motor, 0]))
    most = _motor_range(mj, model, motor)[1]
    return (
        f"adhesion {name!r} makes {body!r} pull with up to {most:g} N: contacts that are read from "
        "a simulation pull as it is controlled there; others take gf.suction_cup, or a model's pull"
    )


def joints_as_drives(
    model: Any,
    found: Sequence[Drive],
    tau_max: float | Mapping[str, float] | None,
    named: Sequence[str] | None = None,
    of_object: NDArray[np.bool_] | None = None,
) -> list[Drive]:
    """Return drives for the joints that the user gives motors which the file does not have.

    ``named`` says which have motors. Without it ``tau_max`` gives them by name to any hinges and
    slides. One number is for the file's motors; in a file without any, for all hinges and slides
    that follow no other joint.

    Args:
        model: the model.
        found: the file's drives.
        tau_max: the user's limits.
        named: the drives that have motors, where the user says so.
        of_object: which bodies make up the object, whose joints get motors by name only, shape
            (nbody,).

    Raises:
        InvalidInputError: ``tau_max`` is wrong, or it or ``named`` names what is neither a drive
            nor such a joint.
    """
    mj = mujoco_module()
    if named is None and (tau_max is None or (found and not isinstance(tau_max, Mapping))):
        return []
    hinge, slide = int(mj.mjtJoint.mjJNT_HINGE), int(mj.mjtJoint.mjJNT_SLIDE)
    names = {
        joint: name_of(model, mj.mjtObj.mjOBJ_JOINT, joint)
        for joint in range(model.njnt)
        if int(model.jnt_type[joint]) in (hinge, slide)
    }
    driven = [each.limit.name for each in found]
    known = list(dict.fromkeys((*driven, *names.values())))
    wanted: Sequence[str] = tuple(as_tau_max(tau_max, known))
    if named is not None:
        wanted = as_names(named, "motors", known)
    elif not isinstance(tau_max, Mapping):
        equal = (model.eq_type == int(mj.mjtEq.mjEQ_JOINT)) & (model.eq_active0 != 0)
        left = set(model.eq_obj1id[equal].tolist())
        if of_object is not None:
            left |= set(np.flatnonzero(of_object[model.jnt_bodyid]).tolist())
        names = {joint: name for joint, name in names.items() if joint not in left}
    added: list[Drive] = []
    for joint, name in names.items():
        if name in wanted and name not in driven:
            turns = int(model.jnt_type[joint]) == hinge
            limit = DriveLimit(name, "N·m" if turns else "N", 0.0, 0.0, float(turns))
            added.append(Drive(limit, model.nout + int(model.jnt_dofadr[joint]), 1.0, joint))
    return added


def is_plain_motor(model: Any, motor: int) -> bool:
    """Return whether an actuator's force is its gain times its control, as of a <motor>."""
    none = int(mujoco_module().mjtBias.mjBIAS_NONE)
    return _constant_bias(model, motor) is not None and int(model.actuator_biastype[motor]) == none


def _constant_bias(model: Any, motor: int) -> float | None:
    """Return the force that an actuator adds to its gain times its control.

    None where its force is not of that kind, as of a servo, whose depends on where the joint is.
    """
    mj = mujoco_module()
    filters = (mj.mjtDyn.mjDYN_NONE, mj.mjtDyn.mjDYN_FILTER, mj.mjtDyn.mjDYN_FILTEREXACT)
    by_control = (
        model.actuator_ctrlnum[motor] == 1
        and model.actuator_gaintype[motor] == int(mj.mjtGain.mjGAIN_FIXED)
        and model.actuator_dyntype[motor] in [int(each) for each in filters]
    )
    constant, by_length, by_velocity = model.actuator_biasprm[motor, :3].tolist()
    kind = int(model.actuator_biastype[motor])
    if by_control and kind == int(mj.mjtBias.mjBIAS_NONE):
        return 0.0
    if by_control and kind == int(mj.mjtBias.mjBIAS_AFFINE) and not (by_length or by_velocity):
        return constant
    return None


def _motor_range(mj: Any, model: Any, motor: int) -> tuple[float, float]:
    """Return the range of a motor's force before its gear, infinite where there is none."""
    low, high = -np.inf, np.inf
    if model.actuator_forcelimited[motor]:
        low, high = model.actuator_forcerange[motor]
    input_ = int(model.actuator_ctrladr[motor])
    if _is_muscle(model, motor):  # it pulls, and gear says which way that is at the joint
        low, high = max(low, -_peak_force(model, motor)), min(high, 0.0)
    bias = _constant_bias(model, motor)
    if bias is not None and model.actuator_ctrllimited[input_]:
        ends = sorted(model.actuator_gainprm[motor, 0] * model.actuator_ctrlrange[input_] + bias)
        low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)


def _is_muscle(model: Any, motor: int) -> bool:
    return bool(model.actuator_gaintype[motor] == int(mujoco_module().mjtGain.mjGAIN_MUSCLE))


def _peak_force(model: Any, muscle: int) -> float:
    """Return the largest active force of a muscle [N], as MuJoCo takes it from its parameters."""
    force, scale = model.actuator_gainprm[muscle, 2:4].tolist()
    output = int(model.actuator_outadr[muscle])
    return force if force >= 0 else scale / float(model.actuator_acc0[output])


def _moment_arm(mj: Any, model: Any, tendon: int) -> float:
    """Return the longest arm of a tendon at a hinge that the model states [m]; 0 for none."""
    first = int(model.tendon_adr[tendon])
    arms = [
        abs(float(model.wrap_prm[i]))
        for i in range(first, first + int(model.tendon_num[tendon]))
        if model.wrap_type[i] == int(mj.mjtWrap.mjWRAP_JOINT)
        and model.jnt_type[model.wrap_objid[i]] == int(mj.mjtJoint.mjJNT_HINGE)
    ]
    return max(arms, default=0.0)


class DriveReader:
    """Reads how a model's joints move its drives."""

    def __init__(self, model: Any, each: Sequence[Drive]) -> None:
        """Look up which rows of MuJoCo's are the drives'."""
        self._dofs = int(model.nv)
        self._outputs = np.array([drive.output for drive in each], dtype=np.intp)
        self._gears = np.array([drive.gear for drive in each], dtype=float)

    def read(self, data: Any) -> Array:
        """Return the drives' motions by joint motion, shape (n_drives, nv), as data stand."""
        return native.module.drive_rows(
            data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind,
            self._outputs, self._gears, self._dofs,
        )  # fmt: skip


def joint_ranges(
    model: Any, each: Sequence[Drive], rows: Array, dofs: NDArray[np.intp]
) -> JointRanges:
    """Return the joints with an ``actuatorfrcrange`` at which more than their own drive pulls.

    MuJoCo cuts off what all actuators together do at a joint. Of a joint that its own drive alone
    moves that is in the drive's limits already.

    Args:
        model: the model.
        each: the drives.
        rows: their motions by joint motion, shape (n_drives, nv).
        dofs: the degrees of freedom that count.
    """
    limited = dofs[model.jnt_actfrclimited[model.dof_jntid[dofs]] != 0]
    if not len(limited):
        return no_ranges(len(each))
    arms = rows[:, limited].T
    own = model.dof_jntid[limited, None] == np.array([drive.joint for drive in each], dtype=int)
    pulled = np.any((arms != 0) & ~own, axis=1)
    joints = model.dof_jntid[limited[pulled]]
    lo, hi = model.jnt_actfrcrange[joints].T
    return JointRanges(dof_names(model, limited[pulled]), arms[pulled], lo, hi)


class CouplingReader:
    """Finds the active equality constraints between a model's joints.

    Those that hold a free body (the mount of a hand, an object) are left out.
    """

    def __init__(self, model: Any) -> None:
        """Look up what each equality ties, and which joints can change how."""
        mj = mujoco_module()
        loops = (int(mj.mjtEq.mjEQ_CONNECT), int(mj.mjtEq.mjEQ_WELD))
        self._model, self._free = model, np.flatnonzero(free_joint_dofs(model))
        ratio = int(mj.mjtEq.mjEQ_JOINT)  # of hinges and slides alone
        self._may_hold_free = bool(np.any(model.eq_type != ratio))
        # Joints that move both links of a loop alike have no part in it.
        self._part = np.ones((model.neq, model.nv))
        self._tied: list[tuple[str, ...]] = [()] * model.neq
        self._key = b""
        self._parts: list[tuple[_Kind, int, int, tuple[str, ...]]] = []
        for each in np.flatnonzero(np.isin(model.eq_type, loops)).tolist():
            pair = _tied_bodies(model, each)
            self._part[each, moved_by(model, pair[0]) & moved_by(model, pair[1])] = 0.0
            self._tied[each] = tuple(name_of(model, mj.mjtObj.mjOBJ_BODY, body) for body in pair)

    def read(self, data: Any) -> list[Coupling]:
        """Return the couplings at data's configuration."""
        count = int(data.ne)  # equalities come first
        if not count:
            return []
        which = data.efc_id[:count]
        rows = np.zeros((count, self._model.nv))
        mj = mujoco_module()
        if mj.mj_isSparse(self._model):
            mj.mju_sparse2dense(
                rows, data.efc_J, data.efc_J_rownnz[:count], data.efc_J_rowadr[:count],
                data.efc_J_colind,
            )  # fmt: skip
        else:
            rows[:] = data.efc_J.reshape(-1, self._model.nv)[:count]
        key = which.tobytes()
        if key != self._key:  # of equalities that are switched on or off
            self._key, self._parts = key, self._parts_of(which.tolist())
        if self._may_hold_free:
            rows *= self._part[which]
        gaps = np.array(data.efc_pos[:count])
        found = [Coupling(kind, rows[i:j], gaps[i:j], tied) for kind, i, j, tied in self._parts]
        if self._may_hold_free and (of_free := rows[:, self._free]).any():
            free = [bool(of_free[i:j].any()) for _, i, j, _ in self._parts]
            found = [each for each, held in zip(found, free, strict=True) if not held]
        return found

    def _parts_of(self, numbers: list[int]) -> list[tuple[_Kind, int, int, tuple[str, ...]]]:
        """Return what each of the equalities' rows hold: the kind, first and last, the links."""
        parts: list[tuple[_Kind, int, int, tuple[str, ...]]] = []
        for each in dict.fromkeys(numbers):
            first, tied = numbers.index(each), self._tied[each]
            last = first + numbers.count(each)
            middle = first + 3 if tied else last
            parts.append(("place" if tied else "ratio", first, middle, tied))
            if middle < last:
                parts.append(("turn", middle, last, tied))
        return parts


def coupling_rows(model: Any, data: Any) -> Array:
    """Return the gradients of a model's couplings at data's configuration, shape (p, nv)."""
    turns = turning(model)
    return rows_of(CouplingReader(model).read(data), turns)[0]


def _tied_bodies(model: Any, equality: int) -> tuple[int, int]:
    """Return the two bodies that a connect or weld ties together."""
    pair = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    if int(model.eq_objtype[equality]) == int(mujoco_module().mjtObj.mjOBJ_SITE):
        return int(model.site_bodyid[pair[0]]), int(model.site_bodyid[pair[1]])
    return pair


def moved_by(model: Any, body: int) -> NDArray[np.bool_]:
    """Return which degrees of freedom move a body, a free joint's too, shape (nv,)."""
    moving = np.zeros(model.nv, dtype=bool)
    while body:
        first = int(model.body_dofadr[body])
        moving[first : first + int(model.body_dofnum[body])] = True
        body = int(model.body_parentid[body])
    return moving


def turning(model: Any) -> NDArray[np.bool_]:
    """Return which degrees of freedom are turns and no slides, shape (nv,)."""
    slide = int(mujoco_module().mjtJoint.mjJNT_SLIDE)
    turns: NDArray[np.bool_] = model.jnt_type[model.dof_jntid] != slide
    return turns


class StopReader:
    """Finds the stops that a model's joints and tendons lean on."""

    def __init__(self, model: Any) -> None:
        """Look up which of them have stops."""
        mj = mujoco_module()
        hinge, slide = int(mj.mjtJoint.mjJNT_HINGE), int(mj.mjtJoint.mjJNT_SLIDE)
        simple = (model.jnt_type == hinge) | (model.jnt_type == slide)
        self._model, self._none = model, no_stops(model.nv)
        self._off = int(mj.mjtDisableBit.mjDSBL_LIMIT)
        self._joints = np.flatnonzero(simple & (model.jnt_limited != 0))
        self._tendons = np.flatnonzero(model.tendon_limited != 0)
        self._at = model.jnt_qposadr[self._joints].astype(np.intp)
        self._ends = ends(
            np.vstack((model.jnt_range[self._joints], model.tendon_range[self._tendons])),
            np.append(model.jnt_type[self._joints] == hinge, np.zeros(len(self._tendons), bool)),
        )

    def read(self, data: Any) -> Stops:
        """Return the stops that are leant on at data's configuration."""
        if self._model.opt.disableflags & self._off:
            return self._none
        low, high, joints = self._ends.low, self._ends.high, len(self._joints)
        if not (
            native.module.any_at_end(data.qpos, self._at, low[:joints], high[:joints])
            or native.module.any_at_end(data.ten_length, self._tendons, low[joints:], high[joints:])
        ):
            return self._none
        positions = np.append(data.qpos[self._at], data.ten_length[self._tendons])
        found = self._ends.leaning(positions, lambda: self._rows(data), self._name)
        return self._none if found is None else found

    def _rows(self, data: Any) -> Array:
        model, moved = self._model, np.zeros((self._model.ntendon, self._model.nv))
        if len(self._tendons):
            mujoco_module().mju_sparse2dense(
                moved, np.ravel(data.ten_J), model.ten_J_rownnz, model.ten_J_rowadr,
                model.ten_J_colind,
            )  # fmt: skip
        of_joints = np.eye(model.nv)[model.jnt_dofadr[self._joints]]
        return np.vstack((of_joints, moved[self._tendons]))

    def _name(self, place: int) -> str:
        kinds, joints = mujoco_module().mjtObj, len(self._joints)
        if place < joints:
            return name_of(self._model, kinds.mjOBJ_JOINT, int(self._joints[place]))
        return name_of(self._model, kinds.mjOBJ_TENDON, int(self._tendons[place - joints]))


def compensated_by_motors(model: Any) -> NDArray[np.bool_] | None:
    """Return at which joints motors do gravity compensation, shape (nv,); None for none."""
    by_motor: NDArray[np.bool_] = model.jnt_actgravcomp[model.dof_jntid] != 0
    return by_motor if by_motor.any() else None


def bias_forces(data: Any, by_motor: NDArray[np.bool_] | None) -> Array:
    """Return the generalised forces at which nothing accelerates without contacts, shape (nv,).

    Of gravity compensation the passive forces have only what no motor gives: ``by_motor``, of
    :func:`compensated_by_motors`, says where.
    """
    bias = data.qfrc_bias - data.qfrc_passive
    return bias if by_motor is None else bias - data.qfrc_gravcomp * by_motor


def free_joint_dofs(model: Any) -> NDArray[np.bool_]:
    """Return which degrees of freedom are free joints', shape (nv,)."""
    free = model.jnt_type == int(mujoco_module().mjtJoint.mjJNT_FREE)
    dofs: NDArray[np.bool_] = free[model.dof_jntid]
    return dofs


def dofs_above(model: Any) -> NDArray[np.bool_]:
    """Return which degrees of freedom move each body, shape (nbody, nv); not a free joint's."""
    above = np.zeros((model.nbody, model.nv), dtype=bool)
    for body in range(1, model.nbody):  # a body comes after its parent
        above[body] = above[model.body_parentid[body]]
        first = int(model.body_dofadr[body])
        above[body, first : first + int(model.body_dofnum[body])] = True
    return above & ~free_joint_dofs(model)


def mocap_bodies(model: Any) -> NDArray[np.bool_]:
    """Return which bodies are moved by a mocap body: fixed to one, or welded by an equality."""
    weld = int(mujoco_module().mjtEq.mjEQ_WELD)
    body = int(mujoco_module().mjtObj.mjOBJ_BODY)
    moved: NDArray[np.bool_] = model.body_mocapid >= 0
    for each in np.flatnonzero((model.eq_type == weld) & (model.eq_objtype == body)).tolist():
        pair = model.eq_obj1id[each], model.eq_obj2id[each]
        if model.eq_active0[each] and moved[list(pair)].any():
            moved[list(pair)] = True
    of_body: NDArray[np.bool_] = moved[model.body_weldid] | moved[model.body_rootid]
    return of_body


def loose_bodies(model: Any, moments: Array) -> NDArray[np.bool_]:
    """Return which bodies float freely and belong to no robot, like an object on a table.

    Args:
        model: the model.
        moments: the drives' motions by joint motion, shape (n_drives, nv); the trees that they
            move are robots, whose floating bases are taken as held.
    """
    root = model.body_rootid[model.dof_bodyid]
    loose = np.zeros(model.nbody, dtype=bool)
    loose[root[free_joint_dofs(model)]] = True
    loose[root[moments.any(axis=0)]] = False
    of_body: NDArray[np.bool_] = loose[model.body_rootid] & ~mocap_bodies(model)
    return of_body


def taking_part(moments: Array, dofs: NDArray[np.intp]) -> list[int]:
    """Return which drives move any of ``dofs``: in the order of these, whatever the motors' is."""
    first = {i: int(row.argmax()) for i, row in enumerate(moments[:, dofs] != 0) if row.any()}
    return sorted(first, key=first.__getitem__)


class MujocoConfiguration:
    """A model at the configuration whose positions, moment arms and constraints ``data`` holds."""

    def __init__(
        self,
        model: Any,
        data: Any,
        dofs: NDArray[np.intp],
        drives: Sequence[Drive],
        held: Array,
        stops: Stops,
        notes: Sequence[str] = (),
    ) -> None:
        """Read how the drives move the degrees of freedom.

        Args:
            model: the model.
            data: its data.
            dofs: the degrees of freedom that count.
            drives: the drives.
            held: further couplings, shape (p, nv): joints that are locked.
            stops: those that joints lean on.
            notes: what a user should know of the posture.
        """
        self._model, self._data, self._dofs = model, data, dofs
        coupled = np.vstack((coupling_rows(model, data), held))
        leaned = stops.on(dofs, held)
        rows = DriveReader(model, drives).read(data)
        self.transmission: Transmission = transmission(rows[:, dofs], coupled[:, dofs], leaned.rows)
        self.ranges = joint_ranges(model, drives, rows, dofs[~held[:, dofs].any(axis=0)])
        self.notes = (*notes, *stop_notes(leaned, self.transmission))

    @property
    def data(self) -> Any:
        """The ``mujoco.MjData``, with the places of bodies, geoms and joints."""
        return self._data

    @property
    def dof_names(self) -> tuple[str, ...]:
        """The joints of the degrees of freedom that ``transmission`` speaks of."""
        return dof_names(self._model, self._dofs)

    def twist(self, link: str, point: Array | None) -> Array:
        """Return the velocity of a body or site by each joint's, shape (6, n_dofs)."""
        at = self.position(link) if point is None else point
        twist = np.zeros((6, self._model.nv))
        mujoco_module().mj_jac(
            self._model, self._data, twist[:3], twist[3:], at.reshape(3, 1),
            body_of(self._model, link),
        )  # fmt: skip
        return twist[:, self._dofs]

    def position(self, link: str, at: Array | None = None) -> Array:
        """Return the origin of a body or site, or the point ``at`` in its frame, (3,) [m]."""
        kind, index = find_link(self._model, link)
        data = self._data
        origins, axes = (
            (data.xpos, data.xmat) if kind == "body" else (data.site_xpos, data.site_xmat)
        )
        origin = np.array(origins[index])
        return origin if at is None else origin + axes[index].reshape(3, 3) @ at

    def chain(self, link: str) -> Array:
        """Return where the joints are that move a link, and the link, from the base, (k, 3) [m]."""
        body, places = body_of(self._model, link), [self.position(link)]
        while body:
            first, count = int(self._model.body_jntadr[body]), int(self._model.body_jntnum[body])
            places += [np.array(self._data.xanchor[first + i]) for i in reversed(range(count))]
            body = int(self._model.body_parentid[body])
        return np.array(places[::-1])

    def bias(self) -> Array:
        """Return what all joints must give at rest against gravity and springs, shape (n_dofs,)."""
        return bias_forces(self._data, compensated_by_motors(self._model))[self._dofs]


def every_dof(model: Any) -> NDArray[np.intp]:
    """Return the numbers of all degrees of freedom."""
    return np.arange(int(model.nv), dtype=np.intp)


def dof_names(model: Any, dofs: NDArray[np.intp]) -> tuple[str, ...]:
    """Return the names of the degrees of freedom's joints."""
    joint = mujoco_module().mjtObj.mjOBJ_JOINT
    return tuple(name_of(model, joint, each) for each in model.dof_jntid[dofs].tolist())


def links_of(model: Any) -> tuple[str, ...]:
    """Return the names of all bodies and sites."""
    mj = mujoco_module()
    names = [mj.mj_id2name(model, mj.mjtObj.mjOBJ_BODY, i) for i in range(model.nbody)]
    names += [mj.mj_id2name(model, mj.mjtObj.mjOBJ_SITE, i) for i in range(model.nsite)]
    return tuple(dict.fromkeys(name for name in names if name))


def find_link(model: Any, link: str) -> tuple[str, int]:
    """Return ("body", id) or ("site", id) of a name; a body's goes before a site's.

    Raises:
        InvalidInputError: no body or site has that name.
    """
    mj = mujoco_module()
    for kind, which in (("body", mj.mjtObj.mjOBJ_BODY), ("site", mj.mjtObj.mjOBJ_SITE)):
        index = int(mj.mj_name2id(model, which, link))
        if index >= 0:
            return kind, index
    raise InvalidInputError(f"got {link!r}, expected the name of a body or site")


def body_of(model: Any, link: str) -> int:
    """Return the body that is, or carries the site that is, called ``link``."""
    kind, index = find_link(model, link)
    return index if kind == "body" else int(model.site_bodyid[index])


def as_body(model: Any, body: object, argument: str) -> int:
    """Return a body's number, given that or its name.

    Raises:
        InvalidInputError: there is no such body; the text names the argument.
    """
    mj = mujoco_module()
    if isinstance(body, str):
        number = int(mj.mj_name2id(model, mj.mjtObj.mjOBJ_BODY, body))
        if number < 0:
            names = [mj.mj_id2name(model, mj.mjtObj.mjOBJ_BODY, i) for i in range(model.nbody)]
            as_link(body, argument, [name for name in names if name])
        return number
    number = index_of(body)
    if number is None or not 0 <= number < model.nbody:
        raise InvalidInputError(
            f"{argument}: got {came(body)}, expected a body's name or its number, below "
            f"{model.nbody}"
        )
    return number


def name_of(model: Any, kind: Any, index: int) -> str:
    """Return an object's name, or its kind and number where it has none."""
    name = mujoco_module().mj_id2name(model, kind, index)
    return str(name) if name else f"{str(kind.name).removeprefix('mjOBJ_').lower()} {index}"
