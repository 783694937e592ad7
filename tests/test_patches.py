"""Points that stand for one patch: the grip does not depend on how many they are."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import graspforce as gf
from graspforce.baselines import minimum_norm
from graspforce.contact import patch_weights

SPLITS = [(1, 1), (4, 4), (3, 5), (16, 5), (1, 16)]


def jaws(split, spread=0.0, mu=0.8, **options):
    """Two jaws along y with a slide each, their patches of so many points, and cone weights."""
    contacts, links = [], []
    for side, count in zip((1, -1), split, strict=True):
        for angle in 2 * np.pi * np.arange(count) / count:
            place = spread * np.array([np.cos(angle), 0, np.sin(angle)])
            contacts.append(gf.Contact(place - [0, 0.02 * side, 0], [0, side, 0], gf.SFC(mu, 0.01)))
            links.append(side)
    W = gf.grasp_map(contacts)
    J = np.zeros((W.shape[1], 2))
    J[::4, 0], J[::4, 1] = np.array(links) > 0, np.array(links) < 0
    weight = patch_weights(np.array([each.normal for each in contacts]), links)
    return gf.ForceProblem(
        W, [0, 0, 1.96, 0, 0, 0], [each.model for each in contacts], J=J, tau_lo=-100, tau_hi=100,
        cone_weight=weight, **options,
    )  # fmt: skip


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("spread", [0.0, 0.01])
def test_a_patch_squeezes_as_one_point_does(split, spread, exact):
    one = gf.solve(jaws((1, 1)), exact)
    found = gf.solve(jaws(split, spread), exact, check=True)
    np.testing.assert_allclose(found.tau, one.tau, rtol=1e-3)
    assert found.verify().ok
    alike = gf.solve(jaws(split, spread).replace(cone_weight=None), exact)
    if max(split) > 1:
        assert alike.tau[0] > 1.2 * one.tau[0]  # what the number of points used to do


@pytest.mark.parametrize("split", [(64, 5), (64, 64)])
def test_a_patch_of_many_points_squeezes_as_one_does(split):
    one = gf.solve(jaws((1, 1)))
    found = gf.solve(jaws(split, 0.01), check=True)
    np.testing.assert_allclose(found.tau, one.tau, rtol=1e-3)
    assert found.verify().ok


def test_coincident_points_share_the_force_of_one(exact):
    one = gf.solve(jaws((1, 1)), exact).c.reshape(2, 4)
    found = gf.solve(jaws((3, 5)), exact).c.reshape(8, 4)
    sums = np.array([found[:3].sum(axis=0), found[3:].sum(axis=0)])
    np.testing.assert_allclose(sums, one, rtol=1e-6, atol=1e-6)


def test_points_that_come_and_go_do_not_move_the_grip():
    squeezes = [
        gf.solve(jaws(split, 0.01), check=True).tau[0]
        for split in itertools.product((1, 2, 3, 4, 8), repeat=2)
    ]
    assert max(squeezes) / min(squeezes) < 1.01


def test_weights_are_shares_of_a_link_and_a_normal():
    up, tilted = np.array([0, 0, 1.0]), np.array([0, np.sin(0.6), np.cos(0.6)])
    normals = np.array([up, up, tilted, up, up])
    weights = patch_weights(normals, ["pad", "pad", "pad", "pad", "palm"])
    np.testing.assert_allclose(weights, [1 / 3, 1 / 3, 1, 1 / 3, 1])


def test_weights_do_not_jump_as_normals_turn():
    angles = np.radians(np.linspace(0, 40, 401))
    normals = np.array([[[0, 0, 1], [0, np.sin(a), np.cos(a)]] for a in angles])
    weights = np.array([patch_weights(pair, ["pad", "pad"])[0] for pair in normals])
    assert weights[0] == weights[100] == 0.5  # up to 10°
    assert weights[-1] == 1
    assert np.diff(weights).min() >= 0
    assert np.diff(weights).max() < 0.01


def test_a_hard_patch_is_decided_by_the_fallback(exact):
    """A load that takes nearly all the friction there is, with weights 1/16 beside 1."""
    problem = jaws((1, 16), 0.01, mu=0.2).replace(f=[0, 0, 2 * 0.2 * 97, 0, 0, 0], alpha=500.0)
    found = gf.solve(problem, exact)
    assert found.status is gf.Status.SOLVED
    assert found.verify().ok


def test_the_reference_does_not_take_a_step_upwards_for_solved():
    problem = jaws((1, 64), 0.01, mu=0.2).replace(f=[0, 0, 2 * 0.2 * 97, 0, 0, 0], alpha=500.0)
    found = gf.solve(problem, gf.Settings(tol=1e-14, backend="reference"))
    assert found.verify().ok  # whatever the status: with that many points rounding may stop it


def test_a_servo_keeps_and_changes_weights():
    problem = jaws((3, 5), 0.01)
    servo = gf.Servo(problem)
    servo.step()
    warm = servo.step(f=[0, 0, 2.5, 0, 0, 0])
    cold = gf.solve(problem.replace(f=[0, 0, 2.5, 0, 0, 0]))
    np.testing.assert_allclose(warm.c, cold.c, atol=1e-3)
    changed = servo.step(cone_weight=1.0)
    assert changed.tau[0] > 1.2 * warm.tau[0]
    np.testing.assert_array_equal(changed.problem.cone_weight, np.ones(8))


@pytest.mark.parametrize("weight", [0.0, -1.0, np.nan, [1.0, 2.0]])
def test_wrong_weights_are_refused(weight):
    with pytest.raises(gf.InvalidInputError, match="cone_weight"):
        jaws((1, 2)).replace(cone_weight=weight)


def test_a_contact_that_has_left_does_not_count_in_the_unit():
    problem = jaws((1, 4)).replace(
        c_max=50.0, cone_weight=[1, 1, 1, 1, 1e-3], engagement=[1, 1, 1, 1, 0]
    )
    found = gf.solve(problem, check=True)
    assert found.verify().ok
    assert found.suboptimality <= -found.decrement - np.log1p(-found.decrement)
    assert found.suboptimality > 0.5 * found.decrement**2 / 2


def test_methods_without_weights_refuse_them():
    with pytest.raises(gf.InvalidInputError, match="cone_weight"):
        minimum_norm.solve(jaws((1, 2)))


def test_columns_weigh_as_the_problem_does():
    problems = [jaws((3, 5), 0.01).replace(f=[0, 0, z, 0, 0, 0]) for z in (1, 2)]
    solutions = [gf.solve(each) for each in problems]
    from graspforce.columns import Columns

    np.testing.assert_allclose(Columns(solutions).phi, [each.phi for each in solutions])


def pads(left, right):
    """A box between two jaws of so many tiles by so many, squeezed in MuJoCo until it rests."""
    mujoco = pytest.importorskip("mujoco")

    def jaw(side, tiles):
        half = 0.012 / tiles
        places = [-0.012 + half + 2 * half * i for i in range(tiles)]
        geoms = "".join(
            f'<geom type="box" size="{half} .004 {half}" pos="{x} 0 {z}" mass=".02"/>'
            for x in places
            for z in places
        )
        return f"""<body name="jaw{side}" pos="0 {0.03 * side} 0">
          <joint name="slide{side}" type="slide" axis="0 {-side} 0" damping="5"/>{geoms}</body>"""

    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option cone="elliptic" timestep=".001" integrator="implicitfast" gravity="0 0 0"/>
      <default><geom friction=".8" solref=".004 1"/></default><worldbody>
      {jaw(1, left)}{jaw(-1, right)}
      <body name="box"><freejoint/><geom type="box" size=".02 .02 .02" mass=".2"/></body>
      </worldbody><actuator><motor joint="slide1" ctrlrange="-100 100"/>
      <motor joint="slide-1" ctrlrange="-100 100"/></actuator></mujoco>""")
    data = mujoco.MjData(model)
    data.ctrl[:] = 5
    mujoco.mj_step(model, data, 300)
    mujoco.mj_forward(model, data)
    return model, data


def test_a_simulator_s_points_do_not_change_the_grip():
    squeezes, points = [], []
    for tiles in ((1, 1), (2, 2), (1, 3)):
        model, data = pads(*tiles)
        grasp = gf.Grasp.from_mujoco(model, data, "box")
        reader = gf.hands.MujocoGrasp(model, data, "box")
        np.testing.assert_array_equal(reader.cone_weight, grasp.cone_weight)
        assert grasp.cone_weight.sum() == pytest.approx(2)  # two patches
        points.append(len(grasp.contacts))
        squeezes.append(gf.solve(grasp.problem([0, 0, 1.96, 0, 0, 0]), check=True).tau[0])
    assert min(points) * 4 <= max(points)
    assert max(squeezes) / min(squeezes) < 1.01
    each = grasp.problem([0, 0, 1.96, 0, 0, 0], cone_weight=1.0)
    assert gf.solve(each).tau[0] > 1.3 * squeezes[0]


def test_the_links_of_a_hand_from_a_file_make_patches(tmp_path):
    from models import paper_hand_xml

    pytest.importorskip("mujoco")
    path = tmp_path / "hand.xml"
    path.write_text(paper_hand_xml())
    hand = gf.hands.from_mjcf(path, ["tip1", "tip2"]).touching(["tip1", "tip1", "tip2"])
    contacts = [gf.Contact([0.03 * i, 0, 0.1], [0, 0, 1], gf.PCWF(0.5)) for i in range(3)]
    grasp = gf.Grasp(contacts, hand, np.zeros(len(hand.q_names)))
    np.testing.assert_array_equal(grasp.cone_weight, [0.5, 0.5, 1])
    np.testing.assert_array_equal(gf.Grasp(contacts).cone_weight, 1)  # no links are known
