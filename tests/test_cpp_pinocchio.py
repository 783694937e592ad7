"""The C++ loop from Pinocchio's data has the numbers of Python's; its example, built by CMake."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import graspforce as gf
from graspforce.control import ContactBook

pin = pytest.importorskip("pinocchio")

ROOT = Path(__file__).parents[1]
PREFIX = next((p for p in Path(pin.__file__).parents if p.name == "cmeel.prefix"), None)
CMAKE = shutil.which("cmake")
HEADERS = PREFIX and all(
    (PREFIX / "include" / name).exists() for name in ("eigen3", "urdfdom_headers", "pinocchio")
)
pytestmark = pytest.mark.skipif(
    not (CMAKE and HEADERS), reason="needs cmake and the headers of Pinocchio, Eigen and URDFs"
)

TIPS = ("one_tip", "two_tip", "three_tip")
MIMICS = ("one_2=one_1*0.8", "three_2=three_1*-1.2")


def hand_urdf():
    """Three fingers around the z axis; the last joint of two of them follows the one before."""
    links, joints = '<link name="base"/>', ""
    for i, finger in enumerate(("one", "two", "three")):
        parent, turn = "base", 2 * np.pi * i / 3
        for k, axis in enumerate(("0 0 1", "0 1 0", "0 1 0")):
            link = f"{finger}_{k}_link"
            at = f"{0.05 * np.cos(turn)} {0.05 * np.sin(turn)} 0" if k == 0 else "0 0 .04"
            yaw = turn if k == 0 else 0
            follows = [m.split("=")[1].split("*") for m in MIMICS if m.startswith(f"{finger}_{k}=")]
            mimic = "".join(f'<mimic joint="{of}" multiplier="{by}"/>' for of, by in follows)
            links += f"""<link name="{link}"><inertial><mass value=".03"/><origin xyz="0 0 .02"/>
              <inertia ixx="1e-5" iyy="1e-5" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
              """
            joints += f"""<joint name="{finger}_{k}" type="revolute"><parent link="{parent}"/>
              <child link="{link}"/><origin xyz="{at}" rpy="0 0 {yaw}"/><axis xyz="{axis}"/>
              <limit lower="-2" upper="2" effort=".7" velocity="9"/>{mimic}</joint>"""
            parent = link
        links += f'<link name="{finger}_tip"/>'
        joints += f"""<joint name="{finger}_end" type="fixed"><parent link="{parent}"/>
          <child link="{finger}_tip"/><origin xyz="0 0 .04"/></joint>"""
    return f'<robot name="hand">{links}{joints}</robot>'


def run(*command, **options):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pinocchio_loop")
    run(CMAKE, "-S", ROOT, "-B", folder / "core", f"-DCMAKE_INSTALL_PREFIX={folder / 'prefix'}")
    run(CMAKE, "--install", folder / "core")
    run(CMAKE, "-S", ROOT / "examples/cpp", "-B", folder / "build", "-DCMAKE_BUILD_TYPE=None",
        f"-DCMAKE_PREFIX_PATH={folder / 'prefix'};{PREFIX}")  # fmt: skip
    run(CMAKE, "--build", folder / "build", "--target", "pinocchio_loop")
    return folder / "build" / "pinocchio_loop"


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    path = tmp_path_factory.mktemp("urdf") / "hand.urdf"
    path.write_text(hand_urdf())
    return path


def readings(model, data, rng, count):
    """Yield states and touches of fingers that hold a box, of which contacts flicker."""
    start, aside, push = np.zeros(model.nq), 0.005 * rng.standard_normal((3, 3)), rng.random(6)
    for k in range(count):
        q = start + 0.2 * np.sin(0.02 * k + np.arange(model.nq))
        v = 4 * np.cos(0.02 * k + np.arange(model.nq))
        pin.framesForwardKinematics(model, data, q)
        places = np.array([data.oMf[model.getFrameId(tip)].translation for tip in TIPS])
        position = places.mean(axis=0) + 0.001 * np.sin(0.1 * k + np.arange(3))
        rotation = pin.exp3(0.1 * np.cos(0.1 * k + np.arange(3)))
        normals = position - places + aside
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        f = np.array([0.3, 0.3, 0.1, 0.002, 0.002, 0.002]) * np.sin(0.1 * k + push)
        f[2] += 2.0
        yield q, v, position, rotation, f, rng.random(3) > 0.1 * (k > 0), places, normals


def test_cpp_pinocchio_loop_has_the_numbers_of_python(example, urdf):
    model = pin.buildModelFromUrdf(str(urdf))
    rng, text, expected = np.random.default_rng(1), [], []
    book, servo, grasp, tau = ContactBook(dict.fromkeys(TIPS, 1)), None, None, None
    for q, v, at, R, f, there, places, normals in readings(model, model.createData(), rng, 200):
        seen = np.flatnonzero(there)
        touches = np.column_stack((seen, places[seen], normals[seen])).ravel()
        numbers = (*q, *v, *at, *R.ravel(), *f, len(seen), *touches)
        text.append(" ".join(f"{x:.17g}" for x in numbers))
        book.update(places[seen], normals[seen], [TIPS[i] for i in seen], 1e-3, at, R)
        contacts = book.contacts(gf.PCWF(0.5))
        if grasp is None:
            grasp = gf.hands.PinocchioGrasp(model, q, contacts, TIPS, v, at, urdf=urdf)
        grasp.update(q, contacts, v, at)
        fields = {
            "W": grasp.W, "f": f, "J": grasp.J, "tau_bias": grasp.tau_bias,
            "engagement": book.engagement,
            "cone_weight": book.cone_weight,
        }  # fmt: skip
        if servo is None:
            more = {name: fields[name] for name in fields if name not in "Wf"}
            servo = gf.Servo(
                gf.ForceProblem(fields["W"], f, [each.model for each in contacts], c_max=20.0,
                                tau_lo=grasp.tau_lo, tau_hi=grasp.tau_hi, **more)
            )  # fmt: skip
        solution = servo.step(**fields)
        if solution.status is gf.Status.SOLVED or solution.nearest:
            tau = solution.tau
        expected.append((solution.c, tau))
    assert grasp.joint_names == ("one_0", "one_1", "three_0", "three_1", "two_0", "two_1", "two_2")
    printed = run(example, urdf, *TIPS, *MIMICS, input="\n".join(text)).splitlines()
    assert len(printed) == len(expected)
    for line, (c, torques) in zip(printed, expected, strict=True):
        assert_allclose(np.array(line.split(), float), np.append(c, torques), rtol=0, atol=1e-9)
    assert np.ptp([c for c, _ in expected], axis=0).min() > 0.1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["thumb"], "links: got 'thumb', expected the name of a frame"),
        (["base"], "links: got some that no motor moves"),
        ([*TIPS, "one_9=one_1*1"], "mimics: got 'one_9', expected a joint"),
    ],
)
def test_cpp_pinocchio_loop_says_what_is_wrong(words, message, example, urdf):
    done = subprocess.run([example, urdf, *words], capture_output=True, text=True, input="")
    assert done.returncode == 1
    assert message in done.stderr
