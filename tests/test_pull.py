"""Contacts that pull: a vacuum, adhesion, a magnet."""

import warnings

import mujoco
import numpy as np
import pytest

import graspforce as gf
from graspforce import regrasp

KINDS = [gf.FPC(4.0), gf.PCWF(0.6, 4.0), gf.SFC(0.6, 0.01, 4.0)]


def hang(load, model, **options):
    """A load under one contact whose normal points down, into the object."""
    contact = gf.Contact([0, 0, 0], [0, 0, -1], model)
    W = gf.grasp_map([contact])[2:3]
    return gf.ForceProblem(W, [load], model, c_max=10.0, **options)


# ---- by hand -----------------------------------------------------------------------------------


@pytest.mark.parametrize("model", KINDS, ids=lambda model: type(model).__name__)
@pytest.mark.parametrize("backend", ["native", "reference"])
def test_a_contact_bears_its_pull_and_no_more(model, backend):
    settings = gf.Settings(backend=backend)
    solution = gf.solve(hang(3.999, model), settings)
    assert solution.status is gf.Status.SOLVED
    assert solution.normal_forces[0] == pytest.approx(-3.999)
    assert solution.friction_margins[0] == pytest.approx(model.mu * 0.001, rel=1e-6)
    assert solution.verify().ok
    beyond = gf.solve(hang(4.001, model), settings)
    assert beyond.status is gf.Status.INFEASIBLE
    assert gf.check_certificate(beyond.problem, beyond.certificate)
    assert beyond.verify().ok
    assert not gf.check_certificate(hang(3.999, model), beyond.certificate)


def test_friction_is_that_of_the_preload():
    contacts = [gf.Contact([0, 0, 0], [0, 0, -1], gf.PCWF(0.5, 4.0))]
    W = gf.grasp_map(contacts)[:3]
    # Nothing presses: the pull alone holds mu times itself sideways; a hanging load takes of it.
    for load, most in ((0.0, 2.0), (3.0, 0.5), (-2.0, 3.0)):
        for share, status in ((0.999, gf.Status.SOLVED), (1.001, gf.Status.INFEASIBLE)):
            problem = gf.ForceProblem(W, [share * most, 0, load], contacts[0].model, c_max=10.0)
            assert gf.solve(problem).status is status


@pytest.mark.parametrize("points", [3, 4, 8, 24])
def test_a_cup_bears_peel_torque_up_to_its_radius(points):
    cup = gf.suction_cup([0, 0, 0.1], [0, 0, -1], 0.02, 30.0, 0.6, points=points)
    grasp = gf.Grasp(cup, origin=[0, 0, 0.1])
    assert sum(contact.model.pull for contact in cup) == pytest.approx(30)
    np.testing.assert_allclose([np.hypot(*each.point[:2]) for each in cup], 0.02)
    # With a net normal force of −10 N, 20 N are left on the rim. At the most all of it is at one
    # point, or on one side of the polygon, and the rest of the rim is about to lift off.
    corners = np.array([contact.point - [0, 0, 0.1] for contact in cup])
    sides = (corners + np.roll(corners, 1, axis=0)) / 2
    np.testing.assert_allclose(np.linalg.norm(sides, axis=1), 0.02 * np.cos(np.pi / points))
    for place in (*corners[:3], *sides[:3]):
        for share, status in ((0.999, gf.Status.SOLVED), (1.001, gf.Status.INFEASIBLE)):
            peel = np.cross(place, [0, 0, -20.0])
            f = np.concatenate(([0, 0, 10], share * peel))
            assert gf.solve(grasp.problem(f, c_max=100)).status is status


def test_a_cup_twists_and_shears_by_friction():
    cup = gf.suction_cup([0, 0, 0], [0, 0, -1], 0.02, 30.0, 0.5, points=12)
    grasp = gf.Grasp(cup)
    for f, most in (([1, 0, 0, 0, 0, 0], 15.0), ([0, 0, 0, 0, 0, 1], 0.3)):
        for share, status in ((0.99, gf.Status.SOLVED), (1.01, gf.Status.INFEASIBLE)):
            problem = grasp.problem(np.multiply(f, share * most), c_max=0.001)
            assert gf.solve(problem).status is status


# ---- the mathematics ---------------------------------------------------------------------------


def random_problem(rng, **options):
    models = [gf.PCWF(0.5, 3.0), gf.SFC(0.4, 0.006), gf.FPC(2.0), gf.PCWF(0.7, 1.0)]
    points = rng.normal(size=(4, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    contacts = [gf.Contact(0.05 * p, -p, model) for p, model in zip(points, models, strict=True)]
    m = sum(model.dim for model in models)
    given = {
        "J": 0.1 * rng.normal(size=(m, 8)), "tau_lo": -rng.uniform(0.5, 2, 8), "tau_hi": 1.5,
        "c_max": rng.uniform(5, 20, 4), "A": rng.normal(size=(2, m)), "b": [30.0, 40.0],
        "c_last": np.zeros(m), "dc_max": 15.0, "engagement": [1, 0.7, 0.9, 0.5],
    }  # fmt: skip
    f = rng.normal(size=6) * [1, 1, 1, 0.03, 0.03, 0.03]
    return gf.ForceProblem(gf.grasp_map(contacts), f, models, **(given | options))


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("seed", range(10))
def test_it_is_the_ordinary_problem_in_other_forces(seed, soft):
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, **({"f_soft": 0.1} if soft else {}))
    shift = np.zeros(problem.m)
    shift[problem.starts[:-1]] = problem.engagement * [3.0, 0, 2.0, 1.0]
    ordinary = problem.replace(
        models=[gf.PCWF(0.5), gf.SFC(0.4, 0.006), gf.FPC(), gf.PCWF(0.7)],
        f=problem.f + problem.W @ shift, tau_bias=-problem.J.T @ shift,
        b=problem.b + problem.A @ shift, c_max=problem.c_max + np.array([3.0, 0, 2.0, 1.0]),
        c_last=shift,
    )  # fmt: skip
    exact = gf.Settings(tol=1e-16)
    ours, theirs = gf.solve(problem, exact), gf.solve(ordinary, exact)
    assert ours.status is theirs.status
    assert ours.violation == pytest.approx(theirs.violation, rel=1e-6)
    assert ours.verify().ok
    by_reference = gf.solve(problem, gf.Settings(backend="reference"))
    assert by_reference.status is ours.status
    assert by_reference.verify().ok
    if ours.status is gf.Status.SOLVED:
        np.testing.assert_allclose(by_reference.c, ours.c, atol=1e-4)
        np.testing.assert_allclose(ours.c + shift, theirs.c, atol=1e-6)
        np.testing.assert_allclose(ours.tau, theirs.tau, atol=1e-6)
        np.testing.assert_allclose(ours.phi, theirs.phi, rtol=1e-9)
        np.testing.assert_allclose(ours.friction_margins, theirs.friction_margins, atol=1e-6)


def test_a_pull_of_nothing_is_none():
    assert not hang(1.0, gf.PCWF(0.5, 0.0)).layout.pulls
    assert gf.PCWF(0.5, 0) == gf.PCWF(0.5)
    for wrong in (-1.0, np.nan, "much"):
        with pytest.raises(gf.InvalidInputError, match=r"^PCWF\.pull: got"):
            gf.PCWF(0.5, wrong)
    with pytest.raises(gf.InvalidInputError, match=r"^points: got 2"):
        gf.suction_cup([0, 0, 0], [0, 0, 1], 0.01, 10, 0.5, points=2)


def test_the_models_of_a_problem_keep_their_pulls(rng):
    problem = random_problem(rng)
    assert [model.pull for model in problem.models] == [3.0, 0.0, 2.0, 1.0]
    assert gf.ForceProblem(**problem.arguments()) == problem
    assert "pulls" in repr(problem)


def test_no_answer_means_no_forces(rng):
    problem = random_problem(rng, J=None, tau_lo=None, tau_hi=None, c_max=None, engagement=None,
                             A=None, b=None, c_last=None, dc_max=None)  # fmt: skip
    for backend in ("native", "reference"):
        solution = gf.solve(problem, gf.Settings(backend=backend))
        assert solution.status is gf.Status.UNBOUNDED
        assert not solution.c.any()


def test_a_servo_lets_a_contact_that_pulls_go(rng):
    models = [gf.PCWF(0.8, 5.0)] * 3
    turns = 2 * np.pi * np.arange(3) / 3
    points = 0.03 * np.column_stack((np.cos(turns), np.sin(turns), np.zeros(3)))
    contacts = [gf.Contact(p, [0, 0, -1], m) for p, m in zip(points, models, strict=True)]
    problem = gf.Grasp(contacts).problem([0, 0, 3, 0, 0, 0], c_max=10, engagement=1)
    servo = gf.Servo(problem)
    assert servo.tick() is gf.Status.SOLVED
    for t in np.linspace(1, 0, 30):
        f = np.array([0, 0, 3, 0, 0, 0.0])
        f[3:] = np.cross(np.mean(points[: 3 if t > 0.2 else 2], axis=0), f[:3])
        solution = servo.step(f=f, engagement=np.array([1, 1, t]))
        assert solution.status is gf.Status.SOLVED
        assert solution.verify().ok
        assert solution.normal_forces[2] >= -5 * t
    assert regrasp.is_removed(t)
    assert not solution.c[6:].any()
    # What a vacuum pulls with may change from tick to tick.
    weaker = servo.step(pull=np.full(3, 1.6))
    assert weaker.status is gf.Status.SOLVED
    assert servo.step(pull=np.full(3, 1.4)).status is gf.Status.INFEASIBLE
    assert weaker.problem.models[0].pull == 1.6


# ---- from MuJoCo -------------------------------------------------------------------------------

CUP = """<mujoco><option cone="elliptic" timestep=".001"/><worldbody>
  <body name="box" pos="0 0 .2"><freejoint/>
    <geom type="box" size=".03 .03 .02" mass=".4" friction=".6" condim="4"/></body>
  <body name="arm" pos="0 0 .2299"><joint name="lift" type="slide" axis="0 0 1" damping="5"/>
    <geom type="box" size=".012 .012 .01" mass=".1" condim="4"/></body>
  </worldbody><actuator><position name="lift" joint="lift" kp="3000" forcerange="-60 60"/>
  <adhesion name="vacuum" body="arm" ctrlrange="0 1" gain="12"/></actuator></mujoco>"""


@pytest.fixture
def cup():
    model = mujoco.MjModel.from_xml_string(CUP)
    data = mujoco.MjData(model)
    data.ctrl[1] = 1
    return model, data


def test_adhesion_of_a_simulation_carries_what_it_carries_there(cup):
    model, data = cup
    for _ in range(1500):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    assert data.body("box").xpos[2] > 0.19  # the physics holds it
    reader = gf.hands.MujocoGrasp(model, data, "box")
    assert reader.pull.sum() == pytest.approx(12)
    weight = np.array([0, 0, 0.4 * 9.81, 0, 0, 0])
    np.testing.assert_allclose(reader.W @ reader.contact_forces(data), weight, atol=1e-2)
    grasp = gf.Grasp.from_mujoco(model, data, "box")
    solution = gf.solve(grasp.problem(weight), check=True)
    assert solution.verify().ok
    assert solution.normal_forces.sum() == pytest.approx(-0.4 * 9.81)
    # The arm's motor carries both.
    assert solution.tau[0] == pytest.approx(0.5 * 9.81, abs=1e-3)
    assert any("'vacuum'" in note and "12 N" in note for note in grasp.notes)
    heavy = gf.solve(grasp.problem([0, 0, 12.1, 0, 0, 0]))
    assert heavy.status is gf.Status.INFEASIBLE


def test_adhesion_pulls_as_it_is_controlled(cup):
    model, data = cup
    for control, most in ((0.5, 6.0), (2.0, 12.0), (0.0, 0.0)):
        data.ctrl[1] = control
        mujoco.mj_forward(model, data)
        reader = gf.hands.MujocoGrasp(model, data, "box")
        assert reader.pull.sum() == pytest.approx(most)
        for share in (0.99, 1.01):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", gf.GraspForceWarning)
                grasp = gf.Grasp.from_mujoco(model, data, "box")
            solution = gf.solve(grasp.problem([0, 0, share * most + 1e-3 * (most == 0), 0, 0, 0]))
            holds = share < 1 and most > 0
            assert solution.status is (gf.Status.SOLVED if holds else gf.Status.INFEASIBLE)
    mujoco.mj_resetData(model, data)
    data.ctrl[1] = 1
    mujoco.mj_step1(model, data)  # before the actuators' stage
    assert gf.hands.MujocoGrasp(model, data, "box").pull.sum() == pytest.approx(12)
