"""Force components that neither W c = f nor the torques determine: counted, and said."""

from __future__ import annotations

import numpy as np
import pytest

import graspforce as gf
from graspforce import equations, guaranteed
from graspforce._engine.outcome import PlainOutcome

mujoco = pytest.importorskip("mujoco")

HELD = [0, 0.3 * 9.81, 0, 0, 0, 0]


def lying(angle, fingers):
    """A cylinder in a V of two plates, pressed on by so many fingers with a motor each."""
    pressing = "".join(
        f"""<body pos="0 .06 {z}"><joint name="finger{i}" type="slide" axis="0 -1 0" damping="2"/>
          <geom type="box" size=".03 .004 .006" mass=".05"/></body>"""
        for i, z in enumerate(np.linspace(-0.015, 0.015, fingers) if fingers > 1 else [0.0])
    )
    motors = "".join(
        f'<motor name="finger{i}" joint="finger{i}" ctrlrange="-30 30"/>' for i in range(fingers)
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option cone="elliptic" timestep=".001" integrator="implicitfast" gravity="0 -9.81 0"/>
      <default><geom solref=".004 1" friction=".5"/></default><worldbody><body name="palm">
      <geom type="box" size=".003 .03 .03" pos="-.024 0 0" euler="0 0 {angle}"/>
      <geom type="box" size=".003 .03 .03" pos=".024 0 0" euler="0 0 {-angle}"/></body>{pressing}
      <body name="can" pos="0 .02 0"><freejoint/>
      <geom type="cylinder" size=".02 .025" mass=".3"/></body></worldbody>
      <actuator>{motors}</actuator></mujoco>""")
    data = mujoco.MjData(model)
    data.ctrl[:] = 5
    mujoco.mj_step(model, data, 1500)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize(("angle", "fingers"), [(35, 1), (30, 2), (40, 3)])
def test_a_power_grasp_says_what_its_motors_cannot_tell(angle, fingers):
    model, data = lying(angle, fingers)
    grasp = gf.Grasp.from_mujoco(model, data, "can")
    rows = np.vstack((grasp.W, grasp.J.T))
    count = rows.shape[1] - np.linalg.matrix_rank(rows)
    assert grasp.undetermined == count > 3
    said = [note for note in grasp.notes if "undetermined" in note]
    assert len(said) == 1
    assert said[0].startswith(f"{count} of {rows.shape[1]} force components")
    assert "as asked" in said[0]
    solution = gf.solve(grasp.problem(HELD), check=True)
    assert solution.verify().undetermined == solution.problem.undetermined == count
    assert f"{count} of {rows.shape[1]} force components are as asked" in solution.message
    # Other forces, inside all cones, take the same wrench and torques.
    right = np.linalg.svd(rows)[2]
    other = solution.c + 1e-3 * right[-1]
    np.testing.assert_allclose(grasp.W @ other, HELD, atol=1e-9)
    np.testing.assert_allclose(grasp.J.T @ other + grasp.tau_bias, solution.tau, atol=1e-9)


def test_fingertips_with_three_joints_each_are_determined(rng):
    contacts = [
        gf.Contact([np.cos(a), np.sin(a), 0], [-np.cos(a), -np.sin(a), 0], gf.PCWF(0.5))
        for a in (0, 2, 4)
    ]
    W = gf.grasp_map(contacts)
    J = np.kron(np.eye(3), rng.normal(size=(3, 3)))
    problem = gf.ForceProblem(W, [0, 0, 1, 0, 0, 0], gf.PCWF(0.5), J=J, tau_lo=-9, tau_hi=9)
    assert problem.undetermined == 0
    assert "as asked" not in gf.solve(problem).message
    # Two joints a finger leave one component each; W c = f fixes the sums of them.
    fewer = problem.replace(J=J[:, [0, 1, 3, 4, 6, 7]], tau_lo=-9.0, tau_hi=9.0)
    rows = np.vstack((W, fewer.J.T))
    assert fewer.undetermined == 9 - np.linalg.matrix_rank(rows)
    # Without J nothing is known of torques, and nothing is said.
    free = gf.ForceProblem(W, [0, 0, 1, 0, 0, 0], gf.PCWF(0.5), c_max=9)
    assert free.undetermined == 0


def test_contacts_that_have_left_do_not_count():
    model, data = lying(35, 1)
    grasp = gf.Grasp.from_mujoco(model, data, "can")
    n = len(grasp.contacts)
    there = np.ones(n)
    there[0] = 0
    problem = grasp.problem(HELD, c_max=50.0, engagement=there)
    kept = np.repeat(there > 0, [each.model.dim for each in grasp.contacts])
    rows = np.vstack((grasp.W, grasp.J.T))[:, kept]
    assert problem.undetermined == rows.shape[1] - np.linalg.matrix_rank(rows)
    assert problem.undetermined < grasp.undetermined


def test_differences_by_rounding_determine_nothing():
    """Two contacts of one link that lie 1e-12 m apart are told apart by nothing."""
    points = [[0.02, 0, 0], [0.02, 1e-12, 0], [-0.02, 0, 0]]
    contacts = [
        gf.Contact(point, [-np.sign(point[0]), 0, 0], gf.PCWF(0.5), [0, 1, 0]) for point in points
    ]
    W = gf.grasp_map(contacts)
    J = np.zeros((9, 2))
    J[[0, 3], 0], J[6, 1] = 1, 1
    problem = gf.ForceProblem(W, np.zeros(6), gf.PCWF(0.5), J=J, tau_lo=-9, tau_hi=9)
    assert problem.undetermined == 9 - np.linalg.matrix_rank(np.vstack((np.round(W, 6), J.T)))


# ---- what is guaranteed ------------------------------------------------------------------------


def squeezed(models):
    """A box between two jaws with a slide each, two contacts on the one and one on the other."""
    points = [[0.02, 0, 0.01], [0.02, 0, -0.01], [-0.02, 0, 0]]
    contacts = [
        gf.Contact(point, [-np.sign(point[0]), 0, 0], model, [0, 1, 0])
        for point, model in zip(points, models, strict=True)
    ]
    W = gf.grasp_map(contacts)
    starts = np.cumsum([0] + [model.dim for model in models])
    J = np.zeros((W.shape[1], 2))
    J[starts[:2], 0], J[starts[2], 1] = 1, 1
    return gf.ForceProblem(W, [0, 0, 1, 0, 0, 0], models, J=J, tau_lo=-20, tau_hi=20)


def test_margins_that_are_determined_are_guaranteed(rng):
    pytest.importorskip("clarabel")
    models = [gf.PCWF(0.5), gf.SFC(0.5, 0.01), gf.FPC(), gf.PCWF(0.7)]
    contacts = [
        gf.Contact([np.cos(a), np.sin(a), 0], [-np.cos(a), -np.sin(a), 0], model)
        for a, model in zip((0, 2, 4, 5), models, strict=True)
    ]
    W = gf.grasp_map(contacts)
    problem = gf.ForceProblem(
        W, [0, 0, 1, 0, 0, 0], models, J=rng.normal(size=(11, 12)), tau_lo=-50, tau_hi=50
    )
    assert problem.undetermined == 0
    solution = gf.solve(problem, check=True)
    bounds, margins = guaranteed.friction_margins(solution), solution.friction_margins
    tangents = problem.mu * solution.normal_forces - margins
    # ‖t‖ is overestimated by at most 2 % and 7 %.
    assert (bounds <= margins).all()
    assert (bounds >= margins - np.array([0.02, 0.07, 1e-6, 0.02]) * tangents - 1e-6).all()


# What the jaw with one contact gives is determined, but for the torsion of a soft finger.
@pytest.mark.parametrize(("model", "least"), [(gf.PCWF(0.5), 1.0), (gf.SFC(0.5, 0.01), 0.0)])
def test_guaranteed_margins_are_below_those_of_all_forces_that_the_motors_allow(model, least, rng):
    pytest.importorskip("clarabel")
    problem = squeezed([model] * 3)
    assert problem.undetermined > 0
    solution = gf.solve(problem, check=True)
    bounds = guaranteed.friction_margins(solution)
    assert (bounds >= [0, 0, least]).all()
    rows = np.vstack((problem.W, problem.J.T))
    free = np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows) :]
    sizes = 10 ** rng.uniform(-4, 0.5, size=(3000, 1))
    tried = solution.c + sizes * rng.normal(size=(3000, len(free))) @ free
    inside = tried[equations.inside_cones(tried, problem.cones)]
    assert len(inside) > 50
    assert (equations.friction_margins(inside, problem.cones).min(axis=0) >= bounds - 1e-7).all()


def test_guarantees_leave_out_contacts_that_have_left():
    pytest.importorskip("clarabel")
    problem = squeezed([gf.PCWF(0.5)] * 3).replace(c_max=30.0, engagement=[1, 0, 1])
    problem = problem.replace(f=[0, 0, 0, 0, 0, 0], f_soft=[0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    bounds = guaranteed.friction_margins(gf.solve(problem, check=True))
    assert np.isinf(bounds[1])
    assert np.isfinite(bounds[[0, 2]]).all()


def test_forces_outside_the_cones_guarantee_nothing():
    pytest.importorskip("clarabel")
    solution = gf.solve(squeezed([gf.PCWF(0.5)] * 3), check=True)
    slipping = PlainOutcome(0, 1, np.tile([1.0, 1.0, 0.0], 3), solution.nu)
    with pytest.raises(gf.InvalidInputError, match="outside the cones"):
        guaranteed.friction_margins(gf.Solution(slipping, solution.problem))


@pytest.mark.parametrize(("axes", "most"), [(2, 1.02), (3, 1.07)])
def test_the_directions_of_slipping_leave_none_out(axes, most, rng):
    pytest.importorskip("scipy")
    directions = guaranteed._directions(axes)
    t = rng.normal(size=(5000, axes))
    largest = (t @ directions.T).max(axis=1) / np.linalg.norm(t, axis=1)
    assert largest.min() >= 1 - 1e-12
    assert largest.max() <= most


def test_a_batch_is_counted_as_each_of_its_problems():
    rng = np.random.default_rng(0)
    W, J = rng.normal(size=(300, 6, 12)), 10.0 ** rng.uniform(-4, 0, 300)[:, None, None]
    J = J * rng.normal(size=(300, 12, 8))
    J[::3, :, 5:] = 0  # eleven rows for twelve components
    J[::7] *= 10.0 ** rng.uniform(-12, -7, len(J[::7]))[:, None, None]
    W[5], J[5] = 0, 0
    J[8, :, 2:], W[8, :, 6:] = 0, W[8, :, :6] + 1e-11 * rng.normal(size=(6, 6))
    counts = equations.undetermined(W, J)
    alone = [equations.undetermined(*pair) for pair in zip(W, J, strict=True)]
    assert counts.tolist() == alone
    assert {0, 1, 6, 12} <= set(alone)
