"""Robots that stand, and arms that carry a box, against inverse dynamics.

Pinocchio's recursive Newton-Euler algorithm with the contact forces on the links is the judge: its
base must need no force, and its joints need what graspforce says. The robots have dimensions as
published for a quadruped of 12 kg, a child-sized biped and a six-joint arm; all else is of boxes.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import graspforce as gf

pin = pytest.importorskip("pinocchio")

FEET = [f"{leg}_foot" for leg in ("fl", "fr", "hl", "hr")]


def link(name, mass, com=(0, 0, 0)):
    inertia = 0.4 * mass * 0.05**2
    turns = " ".join(f'{axis}="{inertia if axis[1] == axis[2] else 0}"' for axis in
                     ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))  # fmt: skip
    at = " ".join(map(str, com))
    return f"""<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/>
      <inertia {turns}/></inertial></link>"""


def joint(name, parent, child, at, axis=None, effort=200.0):
    """A revolute joint, or a fixed one without an axis."""
    xyz = " ".join(map(str, at))
    if axis is None:
        return f"""<joint name="{name}" type="fixed"><parent link="{parent}"/>
          <child link="{child}"/><origin xyz="{xyz}"/></joint>"""
    return f"""<joint name="{name}" type="revolute"><parent link="{parent}"/>
      <child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>
      <limit effort="{effort}" velocity="20" lower="-3" upper="3"/></joint>"""


def robot(parts):
    return f'<robot name="r">{"".join(parts)}</robot>'


def built(parts, floats=True):
    base = (pin.JointModelFreeFlyer(),) if floats else ()
    return pin.buildModelFromXML(robot(parts), *base)


def quadruped_parts():
    """Hips 0.376 m and 0.094 m apart, 0.08 m abduction, 0.213 m thighs and shanks."""
    parts = [link("trunk", 5.2, (0.02, 0, 0))]
    for foot, x, y in zip(FEET, (1, 1, -1, -1), (1, -1, 1, -1), strict=True):
        leg = foot[:2]
        parts += [
            link(f"{leg}_hip", 0.6), link(f"{leg}_thigh", 0.9, (0, 0, -0.03)),
            link(f"{leg}_shank", 0.2, (0, 0, -0.1)), link(foot, 0.06),
            joint(f"{leg}_abduct", "trunk", f"{leg}_hip", (0.188 * x, 0.047 * y, 0), "1 0 0", 24),
            joint(f"{leg}_pitch", f"{leg}_hip", f"{leg}_thigh", (0, 0.08 * y, 0), "0 1 0", 24),
            joint(f"{leg}_knee", f"{leg}_thigh", f"{leg}_shank", (0, 0, -0.213), "0 1 0", 36),
            joint(f"{leg}_end", f"{leg}_shank", foot, (0, 0, -0.213)),
        ]  # fmt: skip
    return parts


def quadruped():
    """The quadruped and a posture."""
    model = built(quadruped_parts())
    q = pin.neutral(model)
    q[7:] = [0.1, 0.7, -1.4, -0.1, 0.8, -1.5, 0.05, 0.75, -1.4, 0, 0.7, -1.45]
    return model, q


def biped_parts():
    """Six joints a leg, thighs and shanks of 0.2 m, soles of 0.2 by 0.1 m."""
    parts = [link("pelvis", 12.0, (0, 0, 0.15))]
    for side, y in (("l", 0.06), ("r", -0.06)):
        names = [f"{side}_{each}" for each in ("yaw", "roll", "hip", "knee", "pitch", "ankle")]
        places = [(0, y, 0), (0, 0, 0), (0, 0, 0), (0, 0, -0.2), (0, 0, -0.2), (0, 0, 0)]
        axes = ["0 0 1", "1 0 0", "0 1 0", "0 1 0", "0 1 0", "1 0 0"]
        parents = ["pelvis", *names[:-1]]
        for name, place, axis, parent in zip(names, places, axes, parents, strict=True):
            parts += [link(name, 0.5), joint(f"{name}_joint", parent, name, place, axis)]
        parts += [link(f"{side}_sole", 0.2), joint(f"{side}_end", names[-1], f"{side}_sole",
                                                    (0.02, 0, -0.05))]  # fmt: skip
    return parts


def biped():
    """The biped and a posture."""
    model = built(biped_parts())
    q = pin.neutral(model)
    q[7:] = [0, 0, -0.3, 0.6, -0.3, 0] * 2
    return model, q


def placements(model, q, names):
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return [data.oMf[model.getFrameId(name)].copy() for name in names]


def inverse_dynamics(model, q, v, grasp, c, sign):
    """Generalised forces without acceleration, the contacts' forces on their links given."""
    data = model.createData()
    tau = pin.rnea(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    start = 0
    for contact, name in zip(grasp.contacts, grasp.links, strict=True):
        wrench = sign * contact.wrench_basis @ c[start : start + contact.model.dim]
        start += contact.model.dim
        if name == "universe":
            continue
        frame = model.getFrameId(name)
        J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        arm = contact.point - data.oMf[frame].translation
        force, torque = wrench[:3], wrench[3:] + np.cross(arm, wrench[:3])
        tau -= J.T @ np.concatenate((force, torque))
    return tau


def by_name(model, tau):
    """Generalised forces by the joints' names; the base's are left out."""
    return {
        str(model.names[i]): tau[model.idx_vs[i]]
        for i in range(1, model.njoints)
        if model.nvs[i] == 1
    }


def agree(model, q, v, grasp, solution, c, sign):
    tau = inverse_dynamics(model, q, v, grasp, c, sign)
    expected = by_name(model, tau)
    assert np.abs(tau).max() > 1  # there is something to compare
    for name, torque in zip(grasp.joint_names, solution.tau, strict=True):
        assert abs(torque - expected[name]) <= 1e-8
    return tau


@pytest.mark.parametrize("moving", [False, True])
def test_a_quadruped_stands_on_its_feet(rng, moving):
    model, q = quadruped()
    v = rng.normal(size=model.nv) if moving else np.zeros(model.nv)
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.1, -0.05, 0.8)).coeffs()
    at = placements(model, q, FEET)
    contacts = [gf.Contact(foot.translation, (0, 0, 1), gf.PCWF(0.7)) for foot in at]
    grasp = gf.Grasp.from_pinocchio(model, q, contacts, FEET, v, on="robot")
    solution = gf.solve(grasp.problem(grasp.load), check=True)
    tau = agree(model, q, v, grasp, solution, solution.c, 1)
    assert np.abs(tau[:6]).max() <= 1e-8  # the base needs nothing
    weight = 9.81 * pin.computeTotalMass(model)
    if not moving:
        np.testing.assert_allclose(grasp.load[:3], [0, 0, weight], atol=1e-9)
    assert solution.normal_forces.min() > 5


def test_the_ground_as_the_object_gives_the_same_torques():
    """Normals down, and minus the load: the forces that the feet exert on the ground."""
    model, q = quadruped()
    at = [foot.translation for foot in placements(model, q, FEET)]
    up, down = (
        [gf.Contact(point, (0, 0, z), gf.PCWF(0.7), (1, 0, 0)) for point in at] for z in (1, -1)
    )
    on_robot = gf.Grasp.from_pinocchio(model, q, up, FEET, tau_max=30, on="robot")
    on_ground = gf.Grasp.from_pinocchio(model, q, down, FEET, tau_max=30)
    assert on_ground.load is None
    first = gf.solve(on_robot.problem(on_robot.load), check=True)
    second = gf.solve(on_ground.problem(-on_robot.load), check=True)
    np.testing.assert_allclose(first.tau, second.tau, atol=1e-4)
    agree(model, q, np.zeros(model.nv), on_ground, second, second.c, -1)


def test_normals_up_under_a_floating_robot_are_taken_as_what_carries_it():
    model, q = quadruped()
    at = [foot.translation for foot in placements(model, q, FEET)]
    contacts = [gf.Contact(point, (0, 0, 1), gf.PCWF(0.7)) for point in at]
    said = gf.Grasp.from_pinocchio(model, q, contacts, FEET, on="robot")
    with pytest.warns(gf.GraspForceWarning, match="on='robot' says so"):
        unsaid = gf.Grasp.from_pinocchio(model, q, contacts, FEET)
    np.testing.assert_array_equal(unsaid.J, said.J)
    held = gf.Grasp.from_pinocchio(model, q, contacts, FEET, on="object", tau_max=30)
    np.testing.assert_array_equal(held.J, -said.J)
    # A box on the hind feet, before the robot: its weight is not the robot's.
    box = [gf.Contact(point + np.array([0.6, 0, 0.5]), (0, 0, 1), gf.PCWF(0.7)) for point in at[2:]]
    carried = gf.Grasp.from_pinocchio(model, q, box, FEET[2:], tau_max=30)
    assert carried.load is None
    # One on its back, above its centre of mass.
    over = [gf.Contact(point + np.array([0, 0, 0.9]), (0, 0, 1), gf.PCWF(0.7)) for point in at]
    assert gf.Grasp.from_pinocchio(model, q, over, FEET, tau_max=30).load is None


def test_what_cannot_stand_is_refused():
    model = built([link("base", 1), link("a", 1), joint("j", "base", "a", (0, 0, 0), "1 0 0")],
                  floats=False)  # fmt: skip
    contact = [gf.Contact((0, 0, 0.1), (0, 0, 1), gf.PCWF(0.5))]
    with pytest.raises(gf.InvalidInputError, match="does not float"):
        gf.Grasp.from_pinocchio(model, pin.neutral(model), contact, ["a"], on="robot")
    with pytest.raises(gf.InvalidInputError, match="on: got 'ground'"):
        gf.Grasp.from_pinocchio(model, pin.neutral(model), contact, ["a"], on="ground")


def standing(q_pelvis=(0, 0, 0)):
    """The biped, shifted over its feet by its pelvis's roll and pitch; its soles' frames."""
    model, q = biped()
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*q_pelvis)).coeffs()
    return model, q, placements(model, q, ["l_sole", "r_sole"])


def four_points(frames):
    """Four points with friction for each sole, in the soles' own axes."""
    return [
        gf.Contact(frame.act(np.array([x, y, 0])), frame.rotation[:, 2], gf.PCWF(0.6))
        for frame in frames
        for x in (0.1, -0.1)
        for y in (0.05, -0.05)
    ]


def whole_soles(frames):
    return [
        contact
        for frame in frames
        for contact in gf.soles.contacts(
            frame.translation, frame.rotation[:, 2], gf.SFC(0.6, 0.04), 0.1, 0.05,
            tangent=frame.rotation[:, 0],
        )
    ]  # fmt: skip


def test_a_biped_stands_on_four_points_a_sole():
    model, q, frames = standing()
    names = ["l_sole"] * 4 + ["r_sole"] * 4
    grasp = gf.Grasp.from_pinocchio(model, q, four_points(frames), names, on="robot")
    np.testing.assert_allclose(grasp.cone_weight, 0.25)
    assert grasp.undetermined == 24 - np.linalg.matrix_rank(np.vstack((grasp.W, grasp.J.T)))
    solution = gf.solve(grasp.problem(grasp.load), check=True)
    tau = agree(model, q, np.zeros(model.nv), grasp, solution, solution.c, 1)
    assert np.abs(tau[:6]).max() <= 1e-8


def test_a_biped_stands_on_soles_with_a_centre_of_pressure():
    model, q, frames = standing()
    names = ["l_sole"] * 5 + ["r_sole"] * 5
    grasp = gf.Grasp.from_pinocchio(model, q, whole_soles(frames), names, on="robot")
    corners = {0: (1, 2, 3, 4), 8: (0,)}
    with pytest.raises(gf.InvalidInputError, match="corner 0"):
        gf.soles.as_one(grasp.problem(grasp.load), corners)
    corners = {0: (1, 2, 3, 4), 5: (6, 7, 8, 9)}
    problem = gf.soles.as_one(grasp.problem(grasp.load), corners)
    solution = gf.solve(problem, check=True)
    for first in (0, 8):  # components: centre 4, corners 1 each
        n, x, y, torsion, *shares = solution.c[first : first + 8]
        assert min(shares) > 0
        assert sum(shares) < n
        assert np.hypot(np.hypot(x, y), 0.6 / 0.04 * torsion) < 0.6 * n
    c = solution.c.copy()  # what stands at the centre itself
    for first in (0, 8):
        c[first] -= c[first + 4 : first + 8].sum()
    tau = agree(model, q, np.zeros(model.nv), grasp, solution, c, 1)
    assert np.abs(tau[:6]).max() <= 1e-8


@pytest.mark.parametrize("share", [0.9, 0.99, 1.01, 1.2])
def test_both_kinds_of_sole_end_at_the_rim(share):
    """The load stands at a share of the way from one sole's centre to its toe."""
    place = pin.SE3.Identity()
    f = [0, 0, 300, 0, -300 * 0.1 * share, 0]
    points = gf.Grasp(four_points([place])).problem(f, c_max=1e4)
    whole = gf.soles.as_one(gf.Grasp(whole_soles([place])).problem(f, c_max=1e4), {0: (1, 2, 3, 4)})
    expected = gf.Status.SOLVED if share < 1 else gf.Status.INFEASIBLE
    assert [gf.solve(each).status for each in (points, whole)] == [expected] * 2


def arm(name, y, turn):
    """Six joints with the lengths of a common arm for 5 kg: 0.089, 0.425, 0.392, … m."""
    places = [(0, y, 0.089), (0, 0.136 * turn, 0), (0, -0.12 * turn, 0.425), (0, 0, 0.392),
              (0, 0.093 * turn, 0), (0, 0, 0.095)]  # fmt: skip
    axes = ["0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0"]
    masses = [3.7, 8.4, 2.3, 1.2, 1.2, 0.2]
    parts, parent = [], "base"
    for i, (place, axis, mass) in enumerate(zip(places, axes, masses, strict=True), 1):
        child = f"{name}{i}"
        parts += [link(child, mass, (0, 0, 0.05)), joint(f"{child}_joint", parent, child, place,
                                                          axis, 150)]  # fmt: skip
        parent = child
    return [*parts, link(f"{name}_hand", 0.1), joint(f"{name}_end", parent, f"{name}_hand",
                                                      (0, 0.082 * turn, 0))]  # fmt: skip


def two_arms_parts():
    return [link("base", 20), *arm("a", 0.45, -1), *arm("b", -0.45, 1)]


def test_two_arms_carry_a_box(rng):
    model = built(two_arms_parts(), floats=False)
    q = np.array([0.1, 0.8, 0.9, 0.3, 0.1, 0, -0.1, 0.8, 0.9, 0.3, -0.1, 0])
    v = rng.normal(size=12)
    at = [each.translation for each in placements(model, q, ["a_hand", "b_hand"])]
    inward = (at[1] - at[0]) / np.linalg.norm(at[1] - at[0])
    side = np.cross(inward, [0, 0, 1.0])
    contacts = [
        gf.Contact(point + turn * 0.03 * side, normal, gf.SFC(0.6, 0.02))
        for point, normal in zip(at, (inward, -inward), strict=True)
        for turn in (1, -1)
    ]
    links = ["a_hand"] * 2 + ["b_hand"] * 2
    origin = np.mean(at, axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gf.GraspForceWarning)  # 150 N·m are these motors'
        grasp = gf.Grasp.from_pinocchio(model, q, contacts, links, v, origin)
    solution = gf.solve(grasp.problem([0, 0, 4 * 9.81, 0, 0, 0]), check=True)
    agree(model, q, v, grasp, solution, solution.c, -1)
    np.testing.assert_allclose(grasp.cone_weight, 0.5)


def test_contacts_of_a_sole_are_where_they_are_said_to_be():
    centre, *corners = gf.soles.contacts((1, 2, 3), (0, 0, 1), gf.PCWF(0.5), 0.1, 0.05, (0, 1, 0))
    assert centre.model == gf.PCWF(0.5)
    np.testing.assert_allclose(
        sorted(each.point.tolist() for each in corners),
        [[0.95, 1.9, 3], [0.95, 2.1, 3], [1.05, 1.9, 3], [1.05, 2.1, 3]],
    )
    with pytest.raises(gf.InvalidInputError, match="half_width"):
        gf.soles.contacts((0, 0, 0), (0, 0, 1), gf.PCWF(0.5), 0.1, 0)
    problem = gf.Grasp([centre, *corners]).problem([0, 0, 9, 0, 0, 0], c_max=20)
    for soles in ({5: ()}, {0: (1, 1)}, {"0": (1,)}):
        with pytest.raises(gf.InvalidInputError, match="soles: got"):
            gf.soles.as_one(problem, soles)
