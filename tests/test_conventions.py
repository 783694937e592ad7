"""docs/conventions.md, statement by statement; the number in a test's name is the page's."""

import copy
import dataclasses
import inspect
import math
import pickle
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from grasps import plant

import graspforce as gf
from graspforce import equations, regrasp, trajectory

PAGE = Path(__file__).parents[1] / "docs" / "conventions.md"


def test_every_statement_has_its_test_and_every_test_its_statement():
    stated = [int(k) for k in re.findall(r"^(\d+)\. \*\*", PAGE.read_text("utf-8"), re.M)]
    tested = sorted(
        int(match[1])
        for name in dir(sys.modules[__name__])
        if (match := re.match(r"test_(\d+)_", name))
    )
    assert stated == list(range(1, len(stated) + 1))
    assert tested == stated


def pair(model, gap=0.08, **limits):
    """Two fingers that press a box of width ``gap`` along x; the frames' x is the world's z."""
    contacts = [
        gf.Contact((s * gap / 2, 0, 0), (-s, 0, 0), model, tangent=(0, 0, 1)) for s in (-1, 1)
    ]
    return gf.Grasp(contacts), lambda f: gf.Grasp(contacts).problem(f, **limits)


# ---- geometry ----------------------------------------------------------------------------------


def test_01_units():
    """SI throughout: a box of .25 kg, pinched, and its weight in N at mu = .5."""
    weight = 0.25 * trajectory.GRAVITY
    assert weight == pytest.approx(2.4525)
    _, problem = pair(gf.PCWF(0.5), c_max=20.0)
    solution = gf.solve(problem([0, 0, weight, 0, 0, 0]))
    assert (solution.normal_forces > weight / 2 / 0.5).all()
    for thing in (
        gf.ForceProblem,
        gf.grasp_map,
        gf.Solution.tau.fget,
        gf.reference.friction_residual,
    ):
        assert re.search(r"\[(N|m|N·m|N, N·m|N²)\]", thing.__doc__)


def test_02_contact_models():
    assert [gf.FPC().dim, gf.PCWF(0.5).dim, gf.SFC(0.5, 0.01).dim] == [1, 3, 4]
    mixed = [gf.SFC(0.5, 0.01), gf.FPC(), gf.PCWF(0.3), gf.PCWF(0.9)]
    problem = gf.ForceProblem(np.zeros((6, 11)), np.zeros(6), mixed, c_max=1)
    assert problem.mu.tolist() == [0.5, 1.0, 0.3, 0.9]


def test_03_contact_frame():
    contact = gf.Contact((1, 2, 3), (0, 0, 1), gf.PCWF(0.5), tangent=(3, 4, 5))
    normal, x, y = contact.frame.T
    assert np.cross(x, y) == pytest.approx(normal)
    assert x == pytest.approx([0.6, 0.8, 0])
    # A finger below that pushes up, into the object, has a positive component.
    assert gf.grasp_map([contact])[:3, 0].tolist() == [0, 0, 1]
    gf.Contact((0, 0, 0), (0, 0, 1 + 9e-7), gf.FPC())
    with pytest.raises(gf.InvalidInputError):
        gf.Contact((0, 0, 0), (0, 0, 1 + 2e-6), gf.FPC())


def test_04_order_of_c():
    models = [gf.PCWF(0.5), gf.FPC(), gf.SFC(0.5, 0.01)]
    problem = gf.ForceProblem(np.ones((1, 8)), [1.0], models, c_max=9)
    assert problem.starts == [0, 3, 4, 8]
    solution = gf.solve(problem)
    assert solution.normal_forces.tolist() == solution.c[[0, 3, 4]].tolist()


def test_05_wrench_of_the_fingers():
    """The fingers push up against the weight: c's upward components are positive."""
    _, problem = pair(gf.PCWF(0.5), c_max=20.0)
    solution = gf.solve(problem([0, 0, 0.25 * 9.81, 0, 0, 0]))
    assert (solution.normal_forces > 0).all()
    assert solution.c[[1, 4]] == pytest.approx([0.25 * 9.81 / 2] * 2)  # x of each frame is up
    hold = trajectory.wrench(0.25, 1e-4 * np.eye(3))
    assert np.asarray(hold) == pytest.approx([0, 0, 0.25 * 9.81, 0, 0, 0])


def test_06_grasp_map():
    contact = gf.Contact((0.1, 0, 0), (0, 0, 1), gf.SFC(0.5, 0.01), tangent=(1, 0, 0))
    W = gf.grasp_map([contact], origin=(0.3, 0, 0))
    assert W.shape == (6, 4)
    c = np.array([2.0, 0, 0, 0.5])
    assert W @ c == pytest.approx([0, 0, 2, 0, 0.2 * 2, 0.5])  # (−.2, 0, 0) × (0, 0, 2)


@pytest.mark.parametrize("rows", [1, 3, 7])
def test_07_rows_of_W(rows, rng):
    W = rng.normal(size=(rows, 12))
    solution = gf.solve(plant(rng, ["PCWF"] * 4, W=W).problem)
    assert solution.status is gf.Status.SOLVED
    twice = solution.problem.replace(W=np.vstack((W, W)), f=np.tile(solution.problem.f, 2))
    assert gf.solve(twice).c == pytest.approx(solution.c, rel=1e-4)


def test_08_frames_in_names():
    """R_world_object maps the object's axes to the world's; nothing speaks of xyzw."""
    state = trajectory.Hold((0, 0, 0), yaw=math.pi / 2).at(0.0)
    assert "R_world_object" in trajectory.State.rotation.fget.__doc__
    assert state.rotation @ [1, 0, 0] == pytest.approx([0, 1, 0])
    for module in (gf, gf.reference, trajectory, regrasp, gf.hands):
        assert "xyzw" not in inspect.getsource(module).replace("wxyz", "")


# ---- limits ------------------------------------------------------------------------------------


@pytest.fixture
def solved(rng):
    return gf.solve(plant(rng, ["PCWF", "SFC", "PCWF", "FPC"], alpha=2.0, bias=True).problem)


def test_09_jacobian(solved):
    problem = solved.problem
    assert problem.J.shape == (problem.m, len(problem.tau_lo))
    assert solved.tau - problem.tau_bias == pytest.approx(problem.J.T @ solved.c)


def test_10_tau_with_bias(solved):
    problem = solved.problem
    assert problem.tau_bias.any()
    assert solved.tau == pytest.approx(problem.J.T @ solved.c + problem.tau_bias)
    assert (problem.tau_lo < solved.tau).all()
    assert (solved.tau < problem.tau_hi).all()


@pytest.mark.parametrize(
    ("model", "edge"),
    [
        (gf.FPC(), [0.0]),
        (gf.PCWF(0.5), [2.0, 0.6, -0.8]),
        (gf.SFC(0.5, 0.01), [2.0, 0.6, -0.8, 0]),
        (gf.SFC(0.5, 0.01), [2.0, 0, 0, 0.02]),  # gamma·n
        (gf.SFC(0.5, 0.01), [2.0, 0.6, 0, 0.8 * 0.02]),
    ],
)
def test_11_cones(model, edge):
    """On the edge the margin is 0; with a little more normal force it is inside."""
    margin = gf.reference.friction_margins
    assert margin(np.array(edge), [model]) == pytest.approx([0], abs=1e-15)
    assert margin(np.array([edge[0] + 0.1, *edge[1:]]), [model])[0] > 0.01
    assert margin(np.array([edge[0] - 0.1, *edge[1:]]), [model])[0] < -0.01


def test_12_ceilings_and_floors(rng):
    problem = plant(rng, ["PCWF"] * 4).problem
    problem = problem.replace(c_max=9.0, c_min=0.2, engagement=[1, 0.9, 0.8, 1.0])
    A, b = problem.linear_limits()
    assert b[-8:-4] == pytest.approx([9, 8.1, 7.2, 9])
    assert b[-4:] == pytest.approx([-0.2, -0.18, -0.16, -0.2])
    assert np.array_equal(A[-8:-4], np.eye(12)[[0, 3, 6, 9]])


def test_13_removal(rng):
    assert regrasp.REMOVAL_THRESHOLD == 1e-6
    problem = plant(rng, ["PCWF"] * 4, removed=2).problem
    for w in (0.0, 1e-6):
        solution = gf.solve(problem.replace(engagement=[1, 1, w, 1]))
        assert solution.problem.active.tolist() == [True, True, False, True]
        assert solution.c[6:9].tolist() == [0, 0, 0]
    assert problem.replace(engagement=[1, 1, 1.1e-6, 1]).active.all()
    # Its three joints are no limits any more: 9 of 12 joints, 3 ceilings.
    assert len(problem.linear_limits()[1]) == 2 * 9 + 3


def test_14_order_of_the_linear_limits(rng):
    problem = plant(rng, ["FPC"] * 4, ceilings=True, floors=True, inequalities=2, bias=True).problem
    A, b = problem.linear_limits()
    normals = np.eye(4)
    blocks = [problem.J.T, -problem.J.T, normals, -normals, problem.A]
    bounds = [
        problem.tau_hi - problem.tau_bias,
        problem.tau_bias - problem.tau_lo,
        problem.engagement * problem.c_max,
        -problem.engagement * problem.c_min,
        problem.b,
    ]
    assert np.array_equal(A, np.vstack(blocks))
    assert b == pytest.approx(np.concatenate(bounds))


# ---- objective ---------------------------------------------------------------------------------


def test_15_barriers():
    assert gf.reference.phi_soc(np.array([2.0, 0.5, 0.1]), [gf.PCWF(0.5)]) == pytest.approx(
        -math.log(0.25 * 4 - 0.25 - 0.01)
    )
    assert gf.reference.phi_soc(np.array([2.0]), [gf.FPC()]) == pytest.approx(-2 * math.log(2))
    assert gf.reference.phi_lin(
        np.array([2.0]), np.array([[1.0]]), np.array([5.0])
    ) == pytest.approx(-math.log(3))


def test_16_objective():
    """Two fingers that press: −4 ln n − 2 alpha ln(c_max − n) is least at 2 c_max/(2 + alpha)."""
    for alpha in (0.1, 1.0, 50.0):
        problem = gf.ForceProblem([[1.0, -1.0]], [0.0], gf.FPC(), c_max=10.0, alpha=alpha)
        solution = gf.solve(problem)
        assert solution.c == pytest.approx([20 / (2 + alpha)] * 2, rel=1e-4)
        n = 20 / (2 + alpha)
        assert solution.phi == pytest.approx(-4 * math.log(n) - 2 * alpha * math.log(10 - n))
    # The ceiling once more, as rows of A: counts twice, as alpha twice as large does.
    doubled = gf.ForceProblem(
        [[1.0, -1.0]], [0.0], gf.FPC(), A=np.eye(2), b=[10, 10], c_max=10, alpha=1
    )
    assert gf.solve(doubled).c == pytest.approx([20 / (2 + 2)] * 2, rel=1e-4)


def test_17_sign_of_nu():
    """One finger pushing with f: Phi* = −2 ln f − alpha ln(c_max − f); nu is its derivative."""
    problem = gf.ForceProblem([[1.0]], [2.0], gf.FPC(), c_max=10.0, alpha=3.0)
    assert gf.solve(problem).nu == pytest.approx([-2 / 2 + 3 / 8], rel=1e-6)


# ---- answers -----------------------------------------------------------------------------------


def test_18_solved(solved):
    problem, c = solved.problem, solved.c
    A, b = problem.linear_limits()
    assert (b - A @ c > 0).all()
    assert (solved.friction_margins > 0).all()
    assert gf.reference.decrement(c, problem) ** 2 / 2 <= gf.Settings().tol * 1.01
    assert 0 <= solved.suboptimality < 1e-8
    assert solved.verify().ok is True


def test_19_wrench_error(solved):
    problem, c = solved.problem, solved.c
    error = np.abs(problem.W @ c - problem.f).max()
    assert solved.wrench_error == error
    assert error <= 1e-9 * max(np.abs(problem.f).max(), (np.abs(problem.W) @ np.abs(c)).max())


def test_20_residuals(solved):
    c, problem = solved.c, solved.problem
    first = problem.models[0].mu * c[0] - math.hypot(c[1], c[2])
    assert solved.friction_margins[0] == pytest.approx(first)
    assert solved.torque_residual == solved.torque_margins.min()
    assert solved.torque_margins == pytest.approx(
        np.minimum(problem.tau_hi - solved.tau, solved.tau - problem.tau_lo)
    )
    other = gf.solve(problem.replace(c_max=50.0, engagement=[1, 1, 1, 0], f=0 * problem.f))
    assert other.friction_margins[3] == math.inf


def pressing(limit):
    """One finger asked to push with 3 N while its ceiling is ``limit``."""
    return gf.ForceProblem([[1.0]], [3.0], gf.FPC(), c_max=limit)


def test_21_certificate():
    solution = gf.solve(pressing(2.0))
    assert solution.status is gf.Status.INFEASIBLE
    certificate = solution.certificate
    assert gf.check_certificate(solution.problem, certificate)
    y, z = certificate.y, certificate.z
    assert (z >= 0).all()
    assert y[0] * 3.0 > z[0] * 2.0
    assert z[0] - y[0] >= 0  # e in the dual of n ≥ 0
    # By hand: y = z = 1 asks for 3 and admits 2.
    assert gf.check_certificate(pressing(2.0), gf.Certificate(np.array([1.0]), np.array([1.001])))
    assert not gf.check_certificate(
        pressing(4.0), gf.Certificate(np.array([1.0]), np.array([1.001]))
    )


def test_22_violation():
    """Ceiling 2 N, reach 2 N, 3 N wanted: sigma = 1/2. And each other scale by itself."""
    solution = gf.solve(pressing(2.0))
    assert solution.violation == pytest.approx(0.5, rel=1e-5)
    assert solution.c == pytest.approx([2.0])  # the nearest wrench's, inside the ceiling
    # A joint with lever .1 m and ±.2 N·m: half its range .2, reach .4/.1 = 4 N.
    joint = {"J": [[0.1]], "tau_lo": -0.2, "tau_hi": 0.2}
    torque = gf.solve(gf.ForceProblem([[1.0]], [3.0], gf.FPC(), **joint))
    assert torque.violation == pytest.approx((0.3 - 0.2) / 0.2, rel=1e-5)
    row = gf.solve(gf.ForceProblem([[1.0]], [3.0], gf.FPC(), **joint, A=[[2.0]], b=[0.1], alpha=1))
    assert row.violation == pytest.approx((2 * 3 - 0.1) / (2 * 4), rel=1e-5)
    floor = gf.solve(gf.ForceProblem([[1.0]], [0.5], gf.FPC(), **joint, c_min=1.5))
    assert floor.violation == pytest.approx((1.5 - 0.5) / 4, rel=1e-5)
    # A pure tangent of .3 N at mu = .5: margin −.3 + .5 n with n = 0, scale .5·4.
    cone = gf.ForceProblem(
        np.eye(3), [0.0, 0.3, 0.0], gf.PCWF(0.5), J=[[0.1], [0], [0]], tau_lo=-0.2, tau_hi=0.2
    )
    assert gf.solve(cone).violation == pytest.approx(0.3 / (0.5 * 4), rel=1e-5)


def test_23_unreachable_and_unbounded():
    _, problem = pair(gf.PCWF(0.5), c_max=20.0)
    about_the_line = gf.solve(problem([0, 0, 0, 0.01, 0, 0]))
    assert about_the_line.status is gf.Status.WRENCH_UNREACHABLE
    _, boundless = pair(gf.PCWF(0.5))
    assert gf.solve(boundless([0, 0, 1, 0, 0, 0])).status is gf.Status.UNBOUNDED


def test_24_two_channels():
    with pytest.raises(gf.InvalidInputError, match=r"^c_max\[0\]: got -1, expected more than 0$"):
        pressing(-1.0)
    assert gf.solve(pressing(2.0)).status is gf.Status.INFEASIBLE
    with pytest.raises(gf.InfeasibleGraspError):
        gf.solve(pressing(2.0), check=True)


def test_25_values(solved):
    contact = gf.Contact((0, 0, 0), (0, 0, 1), gf.PCWF(0.5))
    for thing in (solved, solved.problem, contact, gf.PCWF(0.5), gf.Settings(tol=1e-5)):
        assert pickle.loads(pickle.dumps(thing)) == thing
    with pytest.raises(AttributeError):
        solved.problem.f = np.zeros(6)
    with pytest.raises(dataclasses.FrozenInstanceError):
        contact.point = np.zeros(3)
    with pytest.raises(ValueError, match="read-only"):
        solved.problem.f[0] = 1.0
    f = np.ones(6)
    problem = solved.problem.replace(f=f)
    f[0] = 9.0
    assert problem.f[0] == 1.0
    servo = gf.Servo(problem)
    twin = copy.copy(servo)
    twin.f[0] = 9.0
    assert servo.f[0] == 1.0
    assert twin.step(f=f).start is gf.Start.COLD


@pytest.mark.parametrize("backend", ["native", "reference"])
def test_26_forces_in_world_axes(backend):
    """Each force from its frame, written out; together they and the torsions are the wrench."""
    normals = np.array([[-1, 0, 0], [0.6, -0.8, 0], [0.6, 0.64, 0.48], [0, 0, 1.0]])
    points = -0.05 * normals + [2.0, 3.0, 4.0]
    models = [gf.PCWF(0.8), gf.SFC(0.7, 0.02), gf.PCWF(0.9), gf.FPC()]
    origin = np.array([2.01, 3.0, 4.0])
    f = np.array([0.3, 0.2, 1.0, 0.01, -0.02, 0.005])
    contacts = [gf.Contact(*each) for each in zip(points, normals, models, strict=True)]
    problem = gf.Grasp(contacts, origin=origin).problem(f, c_max=20.0)
    solution = gf.solve(problem, gf.Settings(backend=backend))
    assert solution.status is gf.Status.SOLVED
    forces, c = solution.forces_world, solution.c
    first = c[0] * contacts[0].normal + c[1] * contacts[0].tangent
    first += c[2] * np.cross(contacts[0].normal, contacts[0].tangent)
    assert forces[0] == pytest.approx(first)
    assert forces[3] == pytest.approx(c[10] * normals[3])
    assert np.einsum("ij,ij->i", forces, normals) == pytest.approx(solution.normal_forces)
    assert forces.sum(axis=0) == pytest.approx(f[:3])
    torques = np.cross(points - origin, forces).sum(axis=0) + c[6] * normals[1]
    assert torques == pytest.approx(f[3:])


def test_27_slips():
    inward, _ = pair(gf.PCWF(0.5))
    for scale, turn, reason in ((1000, 1, "millimetres"), (1, -1, "normals point INTO the object")):
        slip = [
            gf.Contact(scale * each.point, turn * each.normal, each.model)
            for each in inward.contacts
        ]
        with pytest.warns(gf.GraspForceWarning, match=reason):
            grasp = gf.Grasp(slip)
        assert grasp.contacts == tuple(slip)
        with pytest.warns(gf.GraspForceWarning, match=reason):
            assert np.array_equal(gf.grasp_map(slip), grasp.W)


def test_28_rate_limits(rng):
    planted = plant(rng, ["PCWF"] * 4)
    servo = gf.Servo(planted.problem.replace(c_last=planted.c, dc_max=0.5))
    first = servo.step()
    assert np.abs(first.c - planted.c).max() < 0.5
    assert np.array_equal(servo.c_last, first.c)
    second = servo.step(f=planted.problem.f * 1.02)
    assert np.abs(second.c - first.c).max() < 0.5


def test_29_a_soft_wrench(rng):
    problem = plant(rng, ["PCWF"] * 4).problem.replace(f_soft=[0, 0, 0.5, 0, 0.02, 0])
    found = gf.solve(problem)
    missed = problem.W @ found.c - problem.f
    assert np.abs(missed[[0, 1, 3, 5]]).max() < 1e-9
    assert found.nu[[2, 4]] == pytest.approx(-missed[[2, 4]] / [0.5**2, 0.02**2], rel=1e-3)
    assert found.wrench_error == pytest.approx(np.abs(missed).max())
    cost = ((missed[[2, 4]] / [0.5, 0.02]) ** 2).sum() / 2
    assert found.phi == pytest.approx(
        gf.solve(problem.replace(f=problem.W @ found.c, f_soft=None)).phi + cost, abs=1e-3
    )


def test_30_contacts_that_pull():
    up = gf.Contact([0, 0, 0], [0, 0, -1], gf.PCWF(0.5, pull=3))
    problem = gf.Grasp([up]).problem([0.2, 0, 1.2, 0, 0, 0], c_max=9, engagement=0.8)
    found = gf.solve(problem.replace(W=problem.W[:3], f=problem.f[:3]), check=True)
    n, *t = found.c
    assert n == pytest.approx(-1.2)  # what the object feels; n > −.8·3
    assert np.hypot(*t) == pytest.approx(0.2)
    assert found.friction_margins[0] == pytest.approx(0.5 * (-1.2 + 0.8 * 3) - 0.2)
    assert found.phi == pytest.approx(
        -np.log(0.25 * 1.2**2 - 0.2**2) - problem.alpha * np.log(0.8 * 9 + 1.2)
    )


def test_31_internal_forces_of_motors():
    # One push, and a motor each way on its joint: the second against the first.
    problem = gf.ForceProblem(
        [[1.0]], [2.0], gf.FPC(), J=[[0.5, 0]], internal=[[1, 1]], tau_lo=0, tau_hi=[9, 3],
        tau_bias=[0.1, 0],
    )  # fmt: skip
    found = gf.solve(problem, check=True)
    (v,) = found.internal_forces
    assert found.tau == pytest.approx([0.5 * 2 + v + 0.1, v])
    assert np.array_equal(found.motor_forces, found.tau)
    A, _ = problem.linear_limits()
    assert A.shape == (4, 2)
    impossible = gf.solve(problem.replace(f=[18.0]))
    e = impossible.problem.linear_limits()[0].T @ impossible.certificate.z
    assert e[1] == pytest.approx(0, abs=1e-12)


def test_32_points_of_one_patch_share_a_weight(rng):
    problem = plant(rng, ["PCWF"] * 4).problem
    c = gf.solve(problem).c
    weighted = problem.replace(cone_weight=[1, 0.5, 0.25, 0.25])
    found = gf.solve(weighted)
    margins = (problem.mu * c[::3]) ** 2 - (c.reshape(4, 3)[:, 1:] ** 2).sum(axis=1)
    change = (np.array([0, 0.5, 0.75, 0.75]) * np.log(margins)).sum()
    assert weighted.barriers.unit == 0.25
    phi = equations.objective(c, weighted.barriers)
    assert phi == pytest.approx(gf.solve(problem).phi + change)
    assert found.phi < phi
    assert found.verify().ok


def test_33_a_set_squeeze():
    grasp, problem = pair(gf.PCWF(0.5), c_max=3.0, c_min=3.0)
    found = gf.solve(problem([0, 0, 1, 0, 0, 0]))
    assert found.status is gf.Status.SOLVED
    assert found.normal_forces == pytest.approx([3.0] * len(grasp.contacts), rel=1e-9)
    assert found.verify().ok
    assert found.problem.linear_limits()[1] == pytest.approx([3.0] * 2 + [-3.0] * 2, rel=2e-9)
