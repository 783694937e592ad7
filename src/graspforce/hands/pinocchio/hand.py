"""Hands from URDF files, read with Pinocchio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array, require_instance
from graspforce._util.native_stderr import native_stderr
from graspforce.errors import ModelImportError, warn
from graspforce.hands.configuration import (
    as_names,
    choose_motors,
    locking_rows,
    notes_of,
    warnings_of,
)
from graspforce.hands.imported import (
    ImportedHand,
    as_fingertips,
    fingers_of,
)
from graspforce.hands.limits import DriveLimit
from graspforce.hands.pinocchio.mimics import Mimic, joints_of, mimic_couplings, mimics_of
from graspforce.hands.pinocchio.model import (
    JointDrive,
    PinocchioConfiguration,
    dof_names,
    dofs_above,
    frames_of,
    joint_drives,
    pinocchio_module,
    what_moves,
)


def from_urdf(
    path: str | Path,
    fingertips: Sequence[str] | Mapping[str, str],
    tau_max: float | Mapping[str, float] | None = None,
    locked: Sequence[str] = (),
    motors: Sequence[str] | None = None,
) -> ImportedHand:
    """Read a hand from a URDF file; meshes are neither needed nor looked for.

    URDF does not say which joints have motors. Every revolute, continuous or prismatic joint
    that mimics no other is taken to have one, unless its effort limit is 0 and ``tau_max`` does
    not give another, or ``motors`` says which have.

    Args:
        path: the file.
        fingertips: links, one a finger; a mapping names the fingers.
        tau_max: torque limits in place of the file's effort limits, both ways: one number for
            all joints, or by name [N·m; N for prismatic joints].
        locked: joints that are held whatever the contacts do to them, as by brakes.
        motors: the joints that have motors; the others turn freely, but for those that are locked
            or follow others.

    Returns:
        The hand, contacts in the frame of the root link. What should not be believed silently
        (implausible limits, joints without a motor) is in ``notes`` and is a GraspForceWarning.

    Raises:
        MissingExtraError: Pinocchio is not installed.
        ModelImportError: the file is missing or no URDF; a finger that no motor moves; a joint
            without a torque limit; a joint that mimics one that is not there.
        InvalidInputError: a fingertip or a name in tau_max, locked or motors that is not there.
    """
    require_instance(path, "path", str | Path, "a path")
    path = Path(path)
    pin = pinocchio_module()
    mimics = mimics_of(path)
    model = _built(path)
    tips = as_fingertips(fingertips, tuple(frames_of(model)))
    links = tuple(dict.fromkeys(tips.values()))
    couplings = mimic_couplings(path, model, mimics, links)
    following = {each.joint for each in mimics}
    dofs = what_moves(model, links, couplings)
    every = [each for each in joint_drives(model) if each.limit.name not in following]
    held = locking_rows(locked, list(dof_names(model).values()))
    if motors is not None:
        as_names(motors, "motors", [each.limit.name for each in every])
    drives = [each for each in every if each.dof in dofs and not held[:, each.dof].any()]
    chosen = choose_motors(drives, tau_max, motors)
    configuration = PinocchioConfiguration(
        model, pin.neutral(model), dofs, chosen.drives, couplings, held, leans=False
    )
    fingers = fingers_of(configuration, chosen, tips)
    free = tuple(name for name in configuration.dof_names if name not in following)
    robot = PinocchioRobot(model, dofs, chosen.drives, couplings, free, mimics, held)
    told = (chosen, configuration.transmission, configuration.dof_names)
    warnings = warnings_of(*told)
    warn(*warnings)
    notes = (*warnings, *notes_of(*told, locked, model.upperDryFrictionLimit[dofs]))
    return ImportedHand(
        chosen.joint_names, free, chosen.tau_lo, chosen.tau_hi, fingers, tips,
        tuple(tips.values()), notes, robot,
    )  # fmt: skip


def default_fingertips(path: str | Path) -> tuple[str, ...]:
    """Return the last links of the chains that joints move.

    Raises:
        ModelImportError: the file is missing or no URDF.
    """
    model, joints = _built(Path(path)), joints_of(path)
    parents = {parent for _, parent in joints}
    frames = frames_of(model)
    return tuple(
        child
        for child, _ in joints
        if child not in parents and child in frames and dofs_above(model, frames[child]).any()
    )


@dataclass(frozen=True, slots=True, eq=False)
class PinocchioRobot:
    """A URDF as the kinematics of a hand."""

    model: Any
    dofs: NDArray[np.intp]
    drives: tuple[JointDrive, ...]
    couplings: Array
    q_names: tuple[str, ...]
    mimics: tuple[Mimic, ...]
    held: Array

    @property
    def limits(self) -> tuple[tuple[DriveLimit, str], ...]:
        """The file's limits of the drives, and which of its numbers they come from."""
        return tuple((each.limit, "effort") for each in self.drives)

    @property
    def links(self) -> tuple[str, ...]:
        """The links that are fixed or that the hand alone moves."""
        other = np.ones(self.model.nv, dtype=bool)
        other[self.dofs] = False
        return tuple(
            link
            for link, frame in frames_of(self.model).items()
            if not (dofs_above(self.model, frame) & other).any()
        )

    def configuration(self, q: Array) -> PinocchioConfiguration:
        """Return the robot at the joint angles q; joints that move no finger are at 0."""
        pin = pinocchio_module()
        angles = dict(zip(self.q_names, q.tolist(), strict=True))
        for _ in self.mimics:  # a follower may lead another
            for each in self.mimics:
                if each.leader in angles:
                    angles[each.joint] = each.multiplier * angles[each.leader] + each.offset
        names = dof_names(self.model)
        turned = np.array([angles.get(names[dof], 0.0) for dof in range(self.model.nv)])
        q = pin.integrate(self.model, pin.neutral(self.model), turned)
        return PinocchioConfiguration(
            self.model, q, self.dofs, self.drives, self.couplings, self.held
        )


def _built(path: Path) -> Any:
    """Return Pinocchio's model of a file.

    Its parser prints the reason of a refusal on the process's stderr and leaves it out of the
    exception, so it is read from there.
    """
    pin = pinocchio_module()
    with native_stderr() as said:
        try:
            return pin.buildModelFromUrdf(str(path))
        except (ValueError, RuntimeError) as error:
            reasons = [line.strip().removeprefix("Error:").strip() for line in said().splitlines()]
            reason = "; ".join(each for each in reasons if each and not each.startswith("at line "))
            raise ModelImportError(
                f"{path}: not a robot that Pinocchio reads: {reason or error}"
            ) from error
