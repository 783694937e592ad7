"""Plausible slips get a warning with the reason; the answer is that of the numbers as they are."""

import itertools
import warnings

import numpy as np
import pytest
from grasps import random_contacts, random_model
from scipy.spatial.transform import Rotation

import graspforce as gf

MAKE = (gf.Grasp, gf.grasp_map)


def contacts(points, normals, model=None, scale=1.0):
    model = gf.PCWF(0.5) if model is None else model
    return [
        gf.Contact(scale * np.asarray(p, float), np.asarray(v) / np.linalg.norm(v), model)
        for p, v in zip(points, normals, strict=True)
    ]


def around(n, radius=0.03, **options):
    """n fingers about the vertical, pressing inwards; with a negative radius outwards."""
    angles = 2 * np.pi * np.arange(n) / n
    ring = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(n)))
    return contacts(radius * ring, -ring, **options)


def turned(given):
    return [gf.Contact(c.point, -c.normal, c.model, c.tangent) for c in given]


def slips(make, given):
    """The texts of the warnings, all of which point at this file."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make(given)
    assert all(each.category is gf.GraspForceWarning for each in caught)
    assert {each.filename for each in caught} <= {__file__}
    return [str(each.message) for each in caught]


@pytest.mark.parametrize("make", MAKE)
@pytest.mark.parametrize("n", [2, 3, 5])
def test_millimetres(make, n):
    (text,) = slips(make, around(n, scale=1000.0))
    assert text.startswith("contacts: their points are ")
    assert "millimetres" in text


@pytest.mark.parametrize("make", MAKE)
def test_a_gamma_in_millimetres(make):
    (text,) = slips(make, around(3, model=gf.SFC(0.5, 5.0)))
    assert text.startswith("contacts: gamma is 5 m")


@pytest.mark.parametrize("make", MAKE)
@pytest.mark.parametrize("n", [2, 3, 4, 8])
def test_outward_normals(make, n):
    (text,) = slips(make, turned(around(n)))
    assert "every normal points away from the contacts' centre" in text
    assert "INTO" in text


def test_outward_normals_of_random_grasps(rng):
    for n in (2, 3, 5, 8) * 10:
        given = random_contacts(rng, [random_model(rng, "PCWF") for _ in range(n)])
        assert slips(gf.Grasp, given) == []
        assert len(slips(gf.Grasp, turned(given))) == 1


def test_both_at_once():
    assert len(slips(gf.Grasp, turned(around(3, scale=1000.0)))) == 2


@pytest.mark.filterwarnings("ignore::graspforce.GraspForceWarning")
def test_the_answer_is_that_of_the_numbers_as_they_are():
    """Lengths in millimetres and torques in N·mm are consistent units: the same forces."""

    def solve(length):
        soft = around(3, model=gf.SFC(0.5, 0.005 * length), scale=length)
        f = np.array([0, 0, 2.5, 0, 0, 0.01]) * np.repeat([1, length], 3)
        solution = gf.solve(gf.Grasp(soft).problem(f, c_max=20.0), gf.Settings(tol=1e-14))
        assert solution.status is gf.Status.SOLVED
        return solution.c.reshape(3, 4) / [1, 1, 1, length]

    assert solve(1000.0) == pytest.approx(solve(1.0), rel=1e-5, abs=1e-6)


# ---- what is no slip ---------------------------------------------------------------------------


def feet(heights, tilt=0.0):
    """Four feet of a robot, the normals leaning outwards by ``tilt``, as on the top of a hill."""
    corners = np.array([[x, y, 0.0] for x, y in itertools.product((-0.4, 0.4), (-0.3, 0.3))])
    corners[:, 2] = heights
    outward = corners * [1, 1, 0] / np.linalg.norm(corners[:, :2], axis=1)[:, None]
    return contacts(corners, np.sin(tilt) * outward + np.cos(tilt) * np.array([0, 0, 1.0]))


NO_SLIPS = {
    "one contact far from the origin": contacts([(90, 0, 0)], [(0, 0, 1)]),
    "a grasp far from the origin": contacts([(90, 0, 0), (90.1, 0, 0)], [(1, 0, 0), (-1, 0, 0)]),
    "two arms on a long beam": contacts([(0, 0, 0), (4.5, 0, 0)], [(1, 0, 0), (-1, 0, 0)]),
    "feet on the flat": feet(0.0),
    "feet on steps": feet([0.0, 0.2, 0.3, 0.1]),
    "feet on the top of a hill": feet(0.0, np.radians(30)),
    "cables of a parallel robot": turned(around(8, model=gf.FPC())),
    "fingers and a table": [
        *contacts([(0.03, 0, 0), (-0.03, 0, 0)], [(-1, 0, 0), (1, 0, 0)]),
        *contacts([(0, 0, -0.03)], [(0, 0, 1)]),
    ],
    "two fingers about a cup and one inside": contacts(
        [(0.03, 0, 0), (-0.03, 0, 0), (0.02, 0.01, 0)], [(-1, 0, 0), (1, 0, 0), (1, 0, 0)]
    ),
    "two fingers at one point": contacts([(0, 0, 0), (0, 0, 0)], [(1, 0, 0), (-1, 0, 0)]),
    "a thick fingertip": around(3, model=gf.SFC(0.5, 0.05)),
}


@pytest.mark.parametrize("make", MAKE)
@pytest.mark.parametrize("name", NO_SLIPS)
def test_no_slip(make, name, rng):
    given = NO_SLIPS[name]
    R = Rotation.random(random_state=rng).as_matrix()
    moved = [gf.Contact(R @ c.point, R @ c.normal, c.model, R @ c.tangent) for c in given]
    assert slips(make, given) == slips(make, moved) == []


@pytest.mark.filterwarnings("error::graspforce.GraspForceWarning")
def test_ticks_do_not_ask_again():
    with pytest.warns(gf.GraspForceWarning):
        problem = gf.Grasp(turned(around(3))).problem([0, 0, 1, 0, 0, 0], c_max=20)
    servo = gf.Servo(problem)
    assert servo.tick() is gf.Status.SOLVED
    assert servo.step(f=[0, 0, 1.1, 0, 0, 0]).problem.replace(alpha=3.0).models == problem.models


CUP = """
<mujoco>
  <worldbody>
    <body name="cup">
      <freejoint/>
      <geom type="box" size=".01 .02 .02" pos=".03 0 0" mass=".05"/>
      <geom type="box" size=".01 .02 .02" pos="-.03 0 0" mass=".05"/>
    </body>
    <body name="left" pos="-.0151 0 0">
      <joint name="l" type="slide" axis="-1 0 0"/>
      <geom type="sphere" size=".005" mass=".01"/>
    </body>
    <body name="right" pos=".0151 0 0">
      <joint name="r" type="slide" axis="1 0 0"/>
      <geom type="sphere" size=".005" mass=".01"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="l" ctrlrange="-5 5"/>
    <motor joint="r" ctrlrange="-5 5"/>
  </actuator>
</mujoco>
"""


@pytest.mark.filterwarnings("error::graspforce.GraspForceWarning")
def test_normals_that_a_simulator_found_are_not_doubted():
    """Two fingers that spread inside a cup."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(CUP)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "cup")
    assert all(contact.normal @ contact.point > 0.01 for contact in grasp.contacts)
    with pytest.warns(gf.GraspForceWarning, match="unless the fingers grip from inside"):
        gf.Grasp(grasp.contacts)
