"""Wrenches that cannot be had, or only on the edge: what comes back, against another solver."""

import re

import numpy as np
import pytest
from clarabel_oracle import nearest_by_clarabel, random_problem, scales_by_hand
from grasps import plant

import graspforce as gf

BACKENDS = ("native", "reference")


@pytest.mark.parametrize(("backend", "count"), [("reference", 12), ("native", 150)])
def test_the_missing_part_is_clarabels(backend, count):
    rng = np.random.default_rng(12)
    settings = gf.Settings(backend=backend, max_steps=1000)
    judged = 0
    while judged < count:
        problem = random_problem(rng)
        found = gf.solve(problem, settings)
        if found.status is not gf.Status.INFEASIBLE or not found.nearest:
            continue
        status, lacks = nearest_by_clarabel(problem)
        assert found.verify().ok
        assert found.verify().friction_margin > 0
        assert found.verify().limit_margin > 0
        assert found.verify().certificate_holds
        scales = problem.wrench_scales()
        assert scales == pytest.approx(scales_by_hand(problem), rel=1e-12)
        ours, size = found.missing / scales, np.linalg.norm(problem.f / scales)
        assert np.linalg.norm(ours) <= np.linalg.norm(lacks) + 1e-9 * size
        if status == "Solved":  # else only that ours is no further away counts
            judged += 1
            assert np.linalg.norm(ours - lacks) <= 1e-6 * size


@pytest.mark.parametrize("backend", BACKENDS)
def test_limits_that_exclude_each_other_leave_the_force_of_least_violation(backend):
    problem = gf.ForceProblem(
        [[1.0, -1.0]], [0.0], gf.FPC(), A=[[1.0, 0.0], [-1.0, 0.0]], b=[1.0, -2.0], c_max=9.0
    )
    found = gf.solve(problem, gf.Settings(backend=backend))
    assert found.status is gf.Status.INFEASIBLE
    assert not found.nearest
    assert found.verify().ok
    assert found.c == pytest.approx([1.5, 1.5], abs=1e-5)
    assert "c makes the wrench and violates them least" in found.message


@pytest.mark.parametrize("backend", BACKENDS)
def test_internal_forces_and_weights_of_cones_have_a_nearest_wrench_too(backend):
    """One push, two motors against each other: the most that they make is what tau_hi leaves."""
    problem = gf.ForceProblem(
        [[1.0]], [50.0], gf.FPC(), J=[[0.5, 0]], internal=[[1, 1]], tau_lo=0, tau_hi=[9, 3],
        tau_bias=[0.1, 0], cone_weight=0.25,
    )  # fmt: skip
    found = gf.solve(problem, gf.Settings(backend=backend, max_steps=1000))
    assert found.status is gf.Status.INFEASIBLE
    assert found.nearest
    assert found.verify().ok
    most = (9 - 0.1) / 0.5  # with no internal force
    assert found.c == pytest.approx([most], rel=1e-6)
    assert found.missing == pytest.approx([50 - most], rel=1e-6)
    assert found.internal_forces == pytest.approx([0], abs=1e-4)


@pytest.mark.parametrize("backend", BACKENDS)
def test_contacts_that_pull_make_what_is_left_of_a_load(backend):
    up = gf.Contact([0, 0, 0], [0, 0, -1], gf.PCWF(0.5, pull=4))
    problem = gf.Grasp([up]).problem([0, 0, 6.0, 0, 0, 0], c_max=9)
    problem = problem.replace(W=problem.W[:3], f=problem.f[:3])
    found = gf.solve(problem, gf.Settings(backend=backend, max_steps=1000))
    assert found.status is gf.Status.INFEASIBLE
    assert found.nearest
    assert found.verify().ok
    assert found.missing == pytest.approx([0, 0, 2], abs=1e-5)
    assert found.c[0] == pytest.approx(-4, abs=1e-5)


# ---- a pinch ------------------------------------------------------------------------------------


def pinch(model, offset, f=(0, 0, 1.96, 0, 0, 0), c_max=20.0):
    contacts = [
        gf.Contact((-0.02, 0, 0), (1, 0, 0), model),
        gf.Contact((0.02, 0, 0), (-1, 0, 0), model),
    ]
    return gf.Grasp(contacts, origin=(0, offset, 0)).problem(f=f, c_max=c_max)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("offset", [1e-7, 1e-5, 3e-4, 5e-3])
def test_a_pinch_beside_the_centre_of_mass_holds_on(backend, offset):
    exact = gf.Settings(backend=backend, tol=1e-14)
    found = gf.solve(pinch(gf.PCWF(0.7), offset), exact)
    assert found.status is gf.Status.WRENCH_UNREACHABLE
    assert found.nearest
    assert found.verify().ok
    # Along z and about x: the force F gives the torque −offset·F, of which none was asked.
    size = found.problem.wrench_scales()[3]
    assert size == pytest.approx(np.sqrt(2 / 3) * np.hypot(0.02, offset))
    lift = 1.96 / (1 + (offset / size) ** 2)
    assert found.missing == pytest.approx([0, 0, 1.96 - lift, offset * lift, 0, 0], abs=1e-9)
    # As firm as the grip that lifts just that.
    centred = gf.solve(pinch(gf.PCWF(0.7), 0, f=(0, 0, lift, 0, 0, 0)), exact)
    assert found.c == pytest.approx(centred.c, rel=1e-6, abs=1e-6)
    assert "N·m about x" in found.message
    assert "soft fingers" in found.message
    assert "f_soft" in found.message


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("model", "reachable"),
    [(gf.PCWF(0.7), False), (gf.SFC(0.7, 0.005), True), (gf.SFC(0.7, 2e-4), False)],
    ids=["point", "soft", "hardly soft"],
)
def test_a_servo_never_opens_a_pinch(backend, model, reachable):
    ticks = 200 if backend == "native" else 20
    servo = gf.Servo(pinch(model, 0.0), gf.Settings(backend=backend, max_steps=1000))
    offsets = 5e-3 * (1 - np.abs(np.linspace(-1, 1, ticks + 1)))
    solutions = [servo.step_to(pinch(model, offset)) for offset in offsets]
    solved = [each.status is gf.Status.SOLVED for each in solutions]
    assert all(a or b.nearest for a, b in zip(solved, solutions, strict=True))
    assert all(solved) == reachable
    c = np.array([each.c for each in solutions])
    assert c[:, 0].min() > 3
    jumps = np.linalg.norm(np.diff(c, axis=0), axis=1)
    beside = np.maximum(jumps[:-2], jumps[2:])
    assert (jumps[1:-1] <= 5 * np.maximum(beside, 1e-4)).all()


def test_the_message_names_what_is_missing_and_what_would_help():
    heavy = gf.solve(pinch(gf.SFC(0.7, 0.005), 0, f=(0, 0, 40, 0, 0, 0)))
    assert heavy.status is gf.Status.INFEASIBLE
    assert re.search(r"a torque counts by 0\.0163 m", heavy.message)
    assert re.search(
        r"lacks 12 N along z; another contact or a soft wrench \(f_soft\) would help$",
        heavy.message,
    )
    W = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 0]])
    flat = gf.ForceProblem(W, [1, 0.1, 0.2], gf.PCWF(0.5), c_max=5)
    assert "lacks 0.2 N·m about z;" in gf.solve(flat).message
    passive = np.vstack((pinch(gf.SFC(0.7, 0.005), 0).W, np.zeros(8)))
    odd = gf.ForceProblem(passive, [0, 0, 1, 0, 0, 0, 2.5], gf.SFC(0.7, 0.005), c_max=20)
    assert "lacks 2.5 in row 6 of W c = f;" in gf.solve(odd).message
    soft = pinch(gf.PCWF(0.7), 1e-3).replace(f_soft=[0, 0, 0, 0, 0.1, 0])
    assert "f_soft" not in gf.solve(soft).message


@pytest.mark.parametrize("backend", BACKENDS)
def test_soft_rows_have_no_say(rng, backend):
    planted = plant(rng, ["PCWF", "SFC", "PCWF", "PCWF"], ceilings=True).problem
    exact = np.array([0, 1, 2])
    f_soft = np.array([0, 0, 0, 0.1, 0.1, 0.1])
    problem = planted.replace(f=30 * planted.f, f_soft=f_soft)
    settings = gf.Settings(backend=backend, max_steps=1000)
    found = gf.solve(problem, settings)
    assert found.status is gf.Status.INFEASIBLE
    assert found.nearest
    alone = gf.solve(planted.replace(W=problem.W[exact], f=problem.f[exact]), settings)
    assert alone.status is gf.Status.INFEASIBLE
    forces = np.linalg.norm(found.missing[:3])
    fewer = gf.solve(planted.replace(f=problem.f), settings)
    assert forces < np.linalg.norm(fewer.missing[:3])


# ---- the edge -----------------------------------------------------------------------------------


def feet(rng, n):
    """On a circle: each is a corner of what they stand on."""
    angles = 2 * np.pi * (np.arange(n) + rng.uniform(0.1, 0.9, n)) / n
    return [
        gf.Contact((0.2 * np.cos(a), 0.2 * np.sin(a), 0), (0, 0, 1), gf.PCWF(rng.uniform(0.3, 1)))
        for a in angles
    ]


def on_a_ray(rng, contacts):
    """A wrench on an extreme ray of one contact's cone, and the only forces that make it."""
    c = np.zeros(3 * len(contacts))
    i, angle = int(rng.integers(len(contacts))), rng.uniform(0, 2 * np.pi)
    c[3 * i] = rng.uniform(1, 8)
    c[3 * i + 1 : 3 * i + 3] = (
        contacts[i].model.mu * c[3 * i] * np.array([np.cos(angle), np.sin(angle)])
    )
    return gf.grasp_map(contacts) @ c, c


@pytest.mark.parametrize(("backend", "count"), [("reference", 20), ("native", 300)])
def test_wrenches_on_extreme_rays_are_on_the_edge(rng, backend, count):
    for _ in range(count):
        contacts = feet(rng, int(rng.integers(3, 6)))
        f, c = on_a_ray(rng, contacts)
        found = gf.solve(gf.Grasp(contacts).problem(f=f, c_max=50), gf.Settings(backend=backend))
        assert found.status is gf.Status.ON_EDGE
        assert "edge" in found.message
        assert found.verify().ok
        assert found.violation == 0
        assert found.c == pytest.approx(c, abs=1e-4 * c.max())
        with pytest.raises(gf.InfeasibleGraspError, match="edge"):
            found.raise_if_failed()


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_asked_of_feet_is_on_the_edge(rng, backend):
    for n in range(2, 12 if backend == "native" else 5):
        problem = gf.Grasp(feet(rng, n)).problem(f=np.zeros(6), c_max=30)
        found = gf.solve(problem, gf.Settings(backend=backend))
        assert found.status is gf.Status.ON_EDGE
        assert found.verify().ok
        assert np.abs(found.c).max() <= 1e-6


@pytest.mark.parametrize("step", [1, 0.7])
def test_centres_of_pressure_up_to_the_rim(step):
    points = [(0.1, 0.05, 0), (0.1, -0.05, 0), (-0.1, 0.05, 0), (-0.1, -0.05, 0)]
    sole = gf.Grasp([gf.Contact(p, (0, 0, 1), gf.PCWF(0.5)) for p in points])
    problem = sole.problem(f=[0, 0, 10, 0, 0, 0], c_max=100)
    for x in np.arange(-11, 12) * step / 100:
        for y in np.arange(-6, 7) * step / 100:
            found = gf.solve(problem.replace(f=[0, 0, 10, 10 * y, -10 * x, 0]))
            beyond = max(abs(x) - 0.1, abs(y) - 0.05)
            on_rim = abs(beyond) < 1e-12
            inside, outside = gf.Status.SOLVED, gf.Status.INFEASIBLE
            expected = gf.Status.ON_EDGE if on_rim else inside if beyond < 0 else outside
            assert found.status is expected, (x, y)
            assert found.verify().ok
            assert found.status is gf.Status.SOLVED or found.nearest


@pytest.mark.parametrize("backend", BACKENDS)
def test_ceilings_that_carry_all_are_on_the_edge(backend):
    points = [(0.1, 0.05, 0), (0.1, -0.05, 0), (-0.1, 0.05, 0), (-0.1, -0.05, 0)]
    sole = gf.Grasp([gf.Contact(p, (0, 0, 1), gf.PCWF(0.5)) for p in points])
    found = gf.solve(sole.problem(f=[0, 0, 400, 0, 0, 0], c_max=100), gf.Settings(backend=backend))
    assert found.status is gf.Status.ON_EDGE
    assert found.normal_forces == pytest.approx([100] * 4, rel=1e-6)


# ---- a set squeeze ------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_floor_at_the_ceiling_sets_the_force(rng, backend):
    """The others are then those of the problem in which one more row of W sets it."""
    settings = gf.Settings(backend=backend, tol=1e-12)
    for _ in range(10 if backend == "native" else 3):
        planted = plant(rng, ["PCWF", "SFC", "PCWF", "PCWF"], alpha=2.0, ceilings=True)
        problem, force = planted.problem, 1.02 * planted.c[0]
        share = problem.engagement[0]
        c_max = np.array(problem.c_max)
        c_max[0] = force / share
        c_min = np.array([force / share, 0, 0, 0])
        found = gf.solve(problem.replace(c_max=c_max, c_min=c_min), settings)
        assert found.status is gf.Status.SOLVED
        assert found.verify().ok
        assert abs(found.c[0] - force) <= 1e-9 * force
        normal = np.eye(problem.m)[:1]
        c_max[0] = 1e9 * force  # far away: no limit
        other = gf.solve(
            problem.replace(
                W=np.vstack((problem.W, normal)), f=np.append(problem.f, force), c_max=c_max,
                c_min=np.zeros(4),
            ),
            settings,
        )  # fmt: skip
        assert other.status is gf.Status.SOLVED
        assert found.c == pytest.approx(other.c, abs=1e-5 * np.abs(planted.c).max())


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_squeeze_that_the_limits_exclude_is_infeasible(backend):
    problem = pinch(gf.PCWF(0.7), 0).replace(c_min=1.0)
    found = gf.solve(problem.replace(c_min=1.0, c_max=1.0), gf.Settings(backend=backend))
    assert found.status is gf.Status.INFEASIBLE  # 1 N a side holds 1.4 N
    assert found.verify().ok
    assert found.c[[0, 3]] == pytest.approx([1, 1], rel=1e-9)
    assert found.missing[2] == pytest.approx(0.56, abs=1e-6)


def test_a_squeeze_ramps_in_a_servo():
    problem = pinch(gf.PCWF(0.7), 0).replace(c_min=3.0, c_max=3.0)
    servo = gf.Servo(problem)
    for force in np.linspace(3, 5, 40):
        found = servo.step(c_min=np.full(2, force), c_max=np.full(2, force))
        assert found.status is gf.Status.SOLVED
        assert found.c[[0, 3]] == pytest.approx([force, force], rel=1e-9)
    for force in np.linspace(5, 3, 40):
        found = servo.step(engagement=np.full(2, force / 5))
        assert found.status is gf.Status.SOLVED
        assert found.c[[0, 3]] == pytest.approx([force, force], rel=1e-9)


def test_a_squeeze_counts_what_a_contact_pulls_with():
    """The band is by what the cone bears: n + pull."""
    up = gf.Contact([0, 0, 0], [0, 0, -1], gf.PCWF(0.5, pull=6))
    down = gf.Contact([0, 0, -0.1], [0, 0, 1], gf.PCWF(0.5))
    problem = gf.Grasp([up, down]).problem([0.2, 0, 0, 0, 0, 0], c_max=[2, 9], c_min=[2, 0])
    problem = problem.replace(W=problem.W[:3], f=problem.f[:3])
    for backend in BACKENDS:
        found = gf.solve(problem, gf.Settings(backend=backend))
        assert found.status is gf.Status.SOLVED
        assert found.verify().ok
        assert found.c[0] == pytest.approx(2, abs=1e-9 * (2 + 6))
    assert problem.linear_limits()[1][[0, 2]] == pytest.approx([2 + 8e-9, -2 + 8e-9], abs=1e-12)


def test_a_floor_above_the_ceiling_is_refused():
    with pytest.raises(gf.InvalidInputError, match=r"c_min\[1\]: got 3, expected at most c_max"):
        pinch(gf.PCWF(0.7), 0).replace(c_min=[1, 3], c_max=[2, 2])
