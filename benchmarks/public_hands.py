"""Public models of hands through every door: what is read of them, J, and the verdict on a grasp.

    python benchmarks/public_hands.py FOLDER … [--save FILE]

Nobody's models are in this repository: a FOLDER is a copy of dexsuite/dex-urdf, say, or the models
that the package example-robot-data brings. Of every file that HANDS names and a folder has, each
door reads a hand: from_urdf, from_pinocchio, and from_mjcf by way of MuJoCo's own reader of URDFs,
with a motor for every joint that has an effort. The table tells how far J is from differences of
positions, how far the doors are apart, and what becomes of a grasp of all fingertips pushing
towards their middle, soft fingers of friction 0.8, under 1 N.
"""

from __future__ import annotations

import argparse
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce.cli.process import as_command
from graspforce.hands import from_mjcf
from graspforce.hands.overview import read_hand
from graspforce.hands.pinocchio.mimics import mimics_of

G1 = [f"right_hand_{each}_link" for each in ("thumb_2", "middle_1", "index_1")]
KINOVA = [f"j2s6s200_link_finger_tip_{i}" for i in (1, 2)]
INSPIRE = ["thumb_tip", "index_tip", "middle_tip", "ring_tip", "pinky_tip"]
# What the table calls it, how its path ends, and its fingertips where they are not the last links
# of all chains that motors move.
HANDS: dict[str, tuple[str, list[str]]] = {
    "Ability hand": ("ability_hand/ability_hand_right.urdf", []),
    "Ability hand on an xArm 7": ("xarm7_ability/xarm7_ability_right_hand.urdf", []),
    "Allegro, left": ("hands/allegro_hand/allegro_hand_left.urdf", []),
    "Allegro, right": ("hands/allegro_hand/allegro_hand_right.urdf", []),
    "Allegro, tactile": ("allegro_hand/variation/allegro_hand_right_fsr.urdf", []),
    "Allegro, another's file": ("allegro_hand_description/urdf/allegro_right_hand.urdf", []),
    "Barrett": ("barrett_hand/bhand_model.urdf", []),
    "D'Claw": ("dclaw_gripper/dclaw_gripper.urdf", []),
    "G1's right hand": ("g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf", G1),
    "Inspire, left": ("inspire_hand/inspire_hand_left.urdf", []),
    "Inspire, right": ("inspire_hand/inspire_hand_right.urdf", []),
    "Inspire on an RM75": ("rm75_inspire/rm75_inspire_right_hand.urdf", INSPIRE),
    "Kinova's fingers": ("kinova_description/robots/kinova.urdf", KINOVA),
    "LEAP, left": ("leap_hand/leap_hand_left.urdf", []),
    "LEAP, right": ("leap_hand/leap_hand_right.urdf", []),
    "Panda gripper": ("panda_gripper/panda_gripper_glb.urdf", []),
    "Panda gripper on its arm": ("panda.urdf", ["panda_leftfinger", "panda_rightfinger"]),
    "PR2's right gripper": (
        "pr2_description/urdf/pr2.urdf", [f"r_gripper_{i}_finger_tip_link" for i in "lr"]
    ),
    "Schunk SVH": ("schunk_hand/schunk_svh_hand_right.urdf", []),
    "Shadow, left": ("shadow_hand/shadow_hand_left.urdf", []),
    "Shadow, right": ("shadow_hand/shadow_hand_right.urdf", []),
    "Shadow, two": ("shadow_hand/bimanual.urdf", []),
    "Shadow on a UR5e": ("ur5e_shadow/ur5e_shadow_right_hand_glb.urdf", []),
    "SO-101's jaw": ("so101.urdf", ["gripper_frame_link", "moving_jaw_so101_v1_link"]),
}  # fmt: skip
EFFORT = 1.0  # of joints for which the file states none [N·m]


def without_shapes(path: Path) -> ElementTree.Element:
    """A URDF without meshes, which are often not there, and whose links MuJoCo does not merge."""
    root = ElementTree.parse(path).getroot()
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    return root


def in_mujoco(path: Path, tau_max: float | None) -> mujoco.MjModel:
    """The URDF as MuJoCo reads it, with motors at its joints and its mimics as equations."""
    root = without_shapes(path)
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(
        extension, "compiler",
        fusestatic="false", balanceinertia="true", boundmass="1e-6", boundinertia="1e-9",
    )  # fmt: skip
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    mimics = mimics_of(path)
    following = {mimic.joint for mimic in mimics}
    for joint in root.iter("joint"):
        limit, name = joint.find("limit"), joint.get("name")
        if joint.get("type") in ("fixed", "floating") or name in following:
            continue
        effort = tau_max or float(limit.get("effort", 0) if limit is not None else 0)
        if effort:
            spec.add_actuator(
                name=f"{name} motor", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
                forcelimited=True, forcerange=[-effort, effort],
            )  # fmt: skip
    if not spec.equalities:
        for mimic in mimics:
            tie = spec.add_equality(
                type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT,
                name1=mimic.joint, name2=mimic.leader,
            )  # fmt: skip
            tie.data[:5] = [mimic.offset, mimic.multiplier, 0, 0, 0]
    return spec.compile()


def posture(model: pinocchio.Model) -> dict[str, float]:
    """Every joint four tenths through its range."""
    found = {}
    for joint, name in enumerate(model.names):
        if joint:
            at = model.idx_qs[joint]
            lo, hi = model.lowerPositionLimit[at], model.upperPositionLimit[at]
            bounded = model.nqs[joint] == 1 and np.isfinite([lo, hi]).all()
            found[name] = lo + 0.4 * (hi - lo) if bounded else 0.1
    return found


def differences(hand, contacts, q, h=1e-6):
    """J by differences of positions: of points that are fixed to the fingertips' links."""
    columns = []
    links = [hand.fingertips[name] for name in hand.made_by]
    here = hand.robot.configuration(q)
    for joint in hand.joint_names:
        step = h * np.array([float(name == joint) for name in hand.q_names])
        ahead, behind = (hand.robot.configuration(q + sign * step) for sign in (1, -1))
        rows = []
        for link, contact in zip(links, contacts, strict=True):
            assert np.allclose(here.position(link), contact.point)
            rows.append(contact.frame.T @ (ahead.position(link) - behind.position(link)) / (2 * h))
        columns.append(np.concatenate(rows))
    return np.transpose(columns)  # without the torsional rows


def doors(path: Path, tips: list[str]) -> tuple[str, ...]:
    """A row of the table: one file."""
    tau_max = None
    try:
        hand = read_hand(path, tips)
    except gf.ModelImportError:  # the file states no effort; what else is wrong comes up again
        tau_max = EFFORT
        hand = read_hand(path, tips, tau_max)
    tips = list(hand.fingertips.values())
    plain = pinocchio.buildModelFromUrdf(str(path))
    angles = posture(plain)
    q = np.array([angles[name] for name in hand.q_names])
    places = hand.fingertip_positions(q)
    middle = places.mean(axis=0)
    inwards = middle - places
    inwards /= np.linalg.norm(inwards, axis=1)[:, None]
    contacts = [
        gf.Contact(point, normal, gf.SFC(0.8, 0.005))
        for point, normal in zip(places, inwards, strict=True)
    ]
    grasps = {"from_urdf": gf.Grasp(contacts, hand, q, middle)}
    off = np.abs(
        np.delete(grasps["from_urdf"].J, np.s_[3::4], axis=0) - differences(hand, contacts, q)
    ).max()

    mimics = {mimic.joint: mimic for mimic in mimics_of(path)}

    def angle(name: str) -> float:
        mimic = mimics.get(name)
        return (
            angles[name] if mimic is None else mimic.offset + mimic.multiplier * angle(mimic.leader)
        )

    whole = []
    for name, size in zip(plain.names[1:], plain.nqs[1:], strict=True):  # 2: cosine and sine
        whole += [angle(name)] if size == 1 else [np.cos(angle(name)), np.sin(angle(name))]
    grasps["from_pinocchio"] = gf.Grasp.from_pinocchio(
        plain, whole, contacts, tips, origin=middle, urdf=path, tau_max=tau_max
    )
    other = from_mjcf(in_mujoco(path, tau_max), tips)
    grasps["from_mjcf"] = gf.Grasp(contacts, other, [angle(name) for name in other.q_names], middle)

    apart, verdicts = 0.0, []
    first = grasps["from_urdf"]
    for grasp in grasps.values():
        order = [grasp.joint_names.index(name) for name in first.joint_names]
        apart = max(apart, np.abs(grasp.J[:, order] - first.J).max())
        verdicts.append(gf.solve(grasp.problem(np.array([0, 0, 1, 0, 0, 0]))).status.name)
    verdict = verdicts[0] if len(set(verdicts)) == 1 else ", ".join(verdicts)
    motors = f"{len(hand.joint_names)}" + (f" of {tau_max:g} N·m" if tau_max else "")
    return f"{len(tips)}", motors, f"{off:.0e}", f"{apart:.0e}", verdict


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    table = Table(title="public hands through from_urdf, from_pinocchio and from_mjcf")
    for heading in ("hand", "fingers", "motors", "J off by, m", "doors apart by", "1 N held"):
        table.add_column(heading, justify="left" if heading in ("hand", "1 N held") else "right")
    files = [path for folder in options.folders for path in sorted(folder.rglob("*.urdf"))]
    for name, (ending, tips) in HANDS.items():
        found = [path for path in files if path.as_posix().endswith(ending)]
        if not found:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", gf.GraspForceWarning)
            try:
                table.add_row(name, *doors(found[0], tips))
            except (gf.GraspForceError, ValueError) as error:
                table.add_row(name, str(error).splitlines()[0])
    show(table, save=options.save, width=120)
    return 0


if __name__ == "__main__":
    with as_command():
        sys.exit(main())
