"""The loop from MuJoCo's numbers to its controls in C++: the numbers of Python, and no allocation.

The example runs a simulation of its own and prints every tick. Python is put into the same states
and reads, solves and sends by its own reader, book, Servo and motors.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import graspforce as gf
from graspforce import sim
from graspforce.contact import model_of
from graspforce.control import ContactBook, ObjectLaw
from graspforce.sim.hand_loop import quiet_reader
from graspforce.sim.world import object_inertia, object_pose
from graspforce.trajectory import Hold

mujoco = pytest.importorskip("mujoco")

ROOT = Path(__file__).parents[1]
MUJOCO = Path(mujoco.__file__).parent
CMAKE, COMPILER = shutil.which("cmake"), shutil.which("g++")
LIBRARY = next(iter(sorted(MUJOCO.glob("libmujoco.so*"))), None)
pytestmark = pytest.mark.skipif(
    None in (CMAKE, COMPILER, LIBRARY), reason="needs cmake, g++ and MuJoCo's library for Linux"
)
TICKS = 100


def run(*command, **options):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def compiled(source, target, *flags):
    options = ("-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror", "-Wno-psabi")
    includes = (f"-I{ROOT / 'cpp/include'}", f"-I{ROOT / 'cpp/tests'}")
    run(COMPILER, *options, *includes, ROOT / source, "-o", target, *flags)
    return target


def with_mujoco(source, target):
    return compiled(source, target, "-isystem", MUJOCO / "include", LIBRARY, f"-Wl,-rpath,{MUJOCO}")


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The example, by CMake, from an installed package."""
    folder = tmp_path_factory.mktemp("mujoco_loop")
    prefix = folder / "prefix"
    run(CMAKE, "-S", ROOT, "-B", folder / "core", f"-DCMAKE_INSTALL_PREFIX={prefix}")
    run(CMAKE, "--install", folder / "core")
    run(CMAKE, "-S", ROOT / "examples/cpp", "-B", folder / "build", f"-DCMAKE_PREFIX_PATH={prefix}",
        f"-DMUJOCO_DIR={MUJOCO}", "-DCMAKE_BUILD_TYPE=None", "-DCMAKE_CXX_FLAGS=-O1")  # fmt: skip
    run(CMAKE, "--build", folder / "build", "--target", "mujoco_loop")
    return folder / "build" / "mujoco_loop"


@pytest.fixture(scope="module")
def closed_scene(tmp_path_factory):
    """Return a hand that has closed on its object, and the file of it."""
    found = {}

    def scene(name):
        if name not in found:
            model = sim.hand_model(name)
            model.key_qpos[0] = sim.close(model, "object")
            path = tmp_path_factory.mktemp(name) / f"{name}.mjb"
            mujoco.mj_saveModel(model, str(path), None)
            found[name] = model, path
        return found[name]

    return scene


class Mirror:
    """Python's loop, as the example's."""

    def __init__(self, model):
        self.model, self.data = model, mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, self.data, 0)
        mujoco.mj_forward(model, self.data)
        self.motors = gf.hands.MujocoMotors(model)
        self.reader = reader = quiet_reader(model, self.data, "object", self.motors)
        self.body = model.body("object").id
        of_contacts = self.bodies_of_contacts()
        balls = (int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID))
        faces = ~np.isin(model.geom_type[reader.geoms[:, 0]], balls)
        counts, self.dims, self.mu, self.gamma = {}, [], [], []
        for body in dict.fromkeys(of_contacts.tolist()):
            own = of_contacts == body
            counts[body] = n = max(int(own.sum()), 4 if faces[own].any() else 1)
            self.dims += [reader.dims[own][-1]] * n
            self.mu += [reader.friction[0][own].min()] * n
            self.gamma += [max(reader.friction[1][own].min(), 1e-6)] * n
        self.book = ContactBook(counts)
        self.bodies, self.dims = np.array(self.book.links), np.array(self.dims)
        self.mu, self.gamma = np.array(self.mu), np.array(self.gamma)
        self.read()
        dofs, driven = reader.motion
        moved = reader.moved_by(self.bodies)[:, dofs].any(axis=0)
        self.holding = (driven[moved] != 0).any(axis=0)
        self.tau, self.servo = np.zeros(self.holding.sum()), None
        pose = object_pose(model, self.data, self.body)
        inertia = pose.rotation.T @ object_inertia(model, self.data, self.body) @ pose.rotation
        self.law = ObjectLaw(model.body_subtreemass[self.body], inertia, turned=pose.rotation)
        self.there = Hold(pose.position.tolist()).at(0)

    def bodies_of_contacts(self):
        return self.model.geom_bodyid[self.reader.geoms[:, 0]]

    def read(self):
        reader, data = self.reader, self.data
        reader.update(data)
        self.book.update(
            reader.points, reader.normals, self.bodies_of_contacts().tolist(),
            self.model.opt.timestep, data.subtree_com[self.body],
            data.xmat[self.body].reshape(3, 3),
        )  # fmt: skip
        slots = self.book.slots
        self.mu[slots[slots >= 0]] = reader.friction[0][slots >= 0]
        self.gamma[slots[slots >= 0]] = np.maximum(reader.friction[1][slots >= 0], 1e-6)

    def tick(self, qpos, qvel, act, f, first):
        """Return contact forces, torques and controls in a state."""
        self.data.qpos[:], self.data.qvel[:], self.data.act[:] = qpos, qvel, act
        mujoco.mj_forward(self.model, self.data)
        self.read()
        pose = object_pose(self.model, self.data, self.body)
        acceleration = self.law.acceleration(self.there, pose)
        wrench = self.law.wrench(acceleration, pose, self.model.opt.gravity)
        book, own = self.book, self.holding
        W, hand = self.reader.maps(
            book.points, book.frames.transpose(0, 2, 1), self.dims, self.bodies
        )
        low, high = (each[own] for each in self.motors.limits(self.data))
        # Of the rows that no motor moves there may be fewer than the example has room for.
        idle = np.zeros((len(f) - 6 - len(hand.passive_loads), W.shape[1]))
        fields = {
            "W": np.vstack((W, hand.passive_rows, idle)),
            "f": np.concatenate((f[:6], hand.passive_loads, np.zeros(len(idle)))),
            "J": hand.J[:, own], "tau_bias": hand.tau_bias[own],
            "tau_lo": low, "tau_hi": high,
            "engagement": book.engagement, "cone_weight": book.cone_weight,
        }  # fmt: skip
        if self.servo is None:
            weight = 9.81 * self.model.body_subtreemass[self.body]
            soft = np.full(len(f), 1e-3 * weight)
            soft[3:6] *= 0.03
            models = [
                model_of(*each)
                for each in zip(
                    *(a.tolist() for a in (self.dims, self.mu, self.gamma)), strict=True
                )
            ]
            problem = gf.ForceProblem(
                fields["W"], fields["f"], models, **{n: fields[n] for n in fields if n not in "Wf"},
                alpha=100.0, c_max=20 * weight, f_soft=soft, c_last=np.zeros(W.shape[1]),
                dc_max=1000.0,
            )  # fmt: skip
            self.servo = gf.Servo(problem)
        for name, value in fields.items():
            getattr(self.servo, name)[...] = value
        self.servo.mu[:], self.servo.gamma[:] = self.mu, self.gamma
        self.servo.dc_max[:] = 1000 if first else 500 * self.model.opt.timestep
        if self.servo.tick() is gf.Status.SOLVED or self.servo.solution.nearest:
            self.tau = self.servo.solution.motor_forces
        every = hand.tau_bias.copy()
        every[own] = self.tau
        self.motors.write(self.data, every, self.model.opt.timestep, at_once=first)
        return wrench, self.servo.c, self.tau, self.data.ctrl


# Of other make than the gallery: the object comes first and has parts, constraints are sparse, one
# jaw follows the other, and has two motors of its own.
OBJECT_FIRST = """<mujoco><option cone="elliptic" jacobian="sparse" impratio="100" timestep=".001"
    integrator="implicitfast" noslip_iterations="3"/>
  <default><geom solref=".002 1" solimp=".95 .99 .001" condim="4" friction=".8 .01 .0001"/>
    </default>
  <worldbody><body name="object" pos="0 0 .1"><freejoint/>
      <geom type="box" size=".02 .02 .02" mass=".15"/>
      <body pos="0 0 .02"><geom type="sphere" size=".01" mass=".05"/></body></body>
    <body name="left" pos="-.03 0 .1"><joint name="left" type="slide" axis="1 0 0" armature=".1"/>
      <geom type="box" size=".005 .015 .015" mass=".1" euler="3 0 0"/></body>
    <body name="right" pos=".03 0 .1"><joint name="right" type="slide" axis="1 0 0"/>
      <geom type="box" size=".005 .015 .015" mass=".1"/></body></worldbody>
  <equality><joint joint1="right" joint2="left" polycoef="0 -1 0 0 0" solref=".002 1"/></equality>
  <actuator><motor joint="left" gear="-4" ctrlrange="-5 5"/>
    <position joint="left" kp="900" kv="9" ctrlrange="-1 1" forcerange="-9 9"/></actuator>
  <keyframe><key qpos="0 0 .1 1 0 0 0 .0052 -.0052"/></keyframe></mujoco>"""


def test_cpp_loop_takes_objects_first_and_sparse_constraints(example, tmp_path):
    (tmp_path / "scene.xml").write_text(OBJECT_FIRST)
    model = mujoco.MjModel.from_xml_string(OBJECT_FIRST)
    assert mujoco.mj_isSparse(model)
    assert compare(model, tmp_path / "scene.xml", example) <= 0.5  # the jaws have to close first


@pytest.mark.parametrize("name", sim.HANDS)
def test_cpp_loop_has_the_numbers_of_python_and_holds(name, example, closed_scene):
    assert compare(*closed_scene(name), example) <= 0.1


def compare(model, path, example):
    """Let the example hold the object, and Python decide in every state that it came to.

    Returns how far the object went [mm].
    """
    lines = np.loadtxt(run(example, path, "object", TICKS).splitlines())
    assert len(lines) == TICKS
    mirror, nq, nv, na = Mirror(model), model.nq, model.nv, model.na
    n, m = int(mirror.holding.sum()), int(mirror.dims.sum())
    rows = lines.shape[1] - nq - nv - na - m - n - model.nu
    for tick, line in enumerate(lines):
        qpos, qvel, act, f, c, tau, ctrl = np.split(line, np.cumsum([nq, nv, na, rows, m, n]))
        expected = mirror.tick(qpos, qvel, act, f, tick == 0)
        for mine, theirs in zip((f[:6], c, tau, ctrl), expected, strict=True):
            assert_allclose(mine, theirs, rtol=0, atol=1e-9, err_msg=f"tick {tick}")
    place = model.jnt_qposadr[model.body("object").jntadr[0]]
    gone = lines[:, place : place + 3] - lines[0, place : place + 3]
    return 1e3 * np.linalg.norm(gone, axis=1).max()


def test_cpp_loop_allocates_nothing(closed_scene, tmp_path):
    program = with_mujoco("cpp/tests/mujoco_test.cpp", tmp_path / "mujoco_test")
    for name in ("leap", "shadow", "two_finger_linkage", "palm"):
        assert "passed" in run(program, closed_scene(name)[1], "object")


@pytest.fixture(scope="module")
def book_program(tmp_path_factory):
    return compiled("cpp/tests/contact_book_stream.cpp", tmp_path_factory.mktemp("book") / "book")


@pytest.mark.parametrize("spare", [0, 1, 2])
def test_cpp_book_is_pythons(spare, book_program):
    """Contacts that move, flicker, swap places, come and go, on an object that turns."""
    rng, counts, dt = np.random.default_rng(0), (2, 4, 1), 1e-3
    book = ContactBook(dict(enumerate(counts)), spare=spare)
    places = 0.03 * rng.standard_normal((9, 3))
    links = np.array([0, 0, 1, 1, 1, 1, 1, 2, 5])  # one more than link 1 has slots; one unknown
    normals = places / np.linalg.norm(places, axis=1)[:, None]
    text, expected, turn = [f"3 {' '.join(map(str, counts))} {spare}"], [], np.zeros(3)
    for k in range(400):
        turn += 0.01 * rng.standard_normal(3)
        quat, R = np.zeros(4), np.zeros(9)
        mujoco.mju_axisAngle2Quat(quat, turn / np.linalg.norm(turn), np.linalg.norm(turn))
        mujoco.mju_quat2Mat(R, quat)
        R, at = R.reshape(3, 3), 0.1 * rng.standard_normal(3)
        places += 2e-4 * rng.standard_normal((9, 3))
        normals += 0.02 * rng.standard_normal((9, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        away = [links == 9, links == 1, np.arange(9) % 2 == 0, links == 0][k // 60 % 4]
        seen = rng.permutation(np.flatnonzero(~away & (rng.random(9) > 0.1)))
        points, directions = at + places[seen] @ R.T, normals[seen] @ R.T
        book.update(points, directions, links[seen].tolist(), dt, at, R)
        touches = np.column_stack((links[seen], points, directions))
        numbers = [dt, *at, *R.ravel(), len(seen), *touches.ravel()]
        text.append(" ".join(f"{x:.17g}" for x in numbers))
        taken = [-1 if link is None else link for link in book.links]
        axes = book.frames.transpose(0, 2, 1).reshape(-1, 9)
        of_slots = np.column_stack((taken, book.engagement, book.present, book.points, axes))
        expected.append(np.concatenate((of_slots.ravel(), book.slots, [book.without_slot])))
    ends = len(book.links) * 15
    found = {int(slot) for each in expected for slot in each[ends:-1]}
    assert {0, 6, 6 + spare} <= found
    assert (-1 in found) == (spare < 2)
    late = {each[place] for each in expected for place in range(7 * 15, ends, 15)}
    assert late == (set(), {5}, {-1, 1, 5})[spare]
    printed = run(book_program, input="\n".join(text)).splitlines()
    for line, numbers in zip(printed, expected, strict=True):
        assert_allclose(np.array(line.split(), dtype=float), numbers, rtol=0, atol=1e-12)


JAWS = """<mujoco><worldbody>
  <body pos="-.03 0 0"><joint name="left" type="slide" axis="1 0 0" {range}/>
    <geom type="box" size=".01 .01 .01"/></body>
  <body name="right" pos=".03 0 0">{joint}<geom type="box" size=".01 .01 .01"/></body>
  <body name="cube"><freejoint/><geom type="box" size=".0202 .01 .01"/></body>
  <body name="lid" pos="0 0 1"><joint type="slide"/><geom size=".01"/></body></worldbody>
  {more}<actuator>{motor}</actuator></mujoco>"""
MOTOR = '<motor name="m" joint="left" ctrlrange="-9 9"/>'


@pytest.mark.parametrize(
    ("changes", "body", "words"),
    [
        ({}, "ball", "object: got 'ball', expected the name of a body"),
        ({}, "lid", "object: got 'lid', which does not float"),
        ({"motor": ""}, "cube", "got contacts that no motor moves"),
        ({"motor": MOTOR + '<adhesion body="right" ctrlrange="0 1"/>'}, "cube",
         "got one without a joint or tendon"),
        ({"motor": '<motor joint="left"/>'}, "cube", "'left': got a motor without a limit"),
        ({"motor": MOTOR + '<motor tendon="t" ctrlrange="-1 1"/>', "more":
          '<tendon><fixed name="t"><joint joint="left" coef="1"/></fixed></tendon>'}, "cube",
         "got motors that are more than the motions that they move"),
        ({"motor": '<motor tendon="t" ctrlrange="-1 1"/>', "more":
          '<tendon><fixed name="t"><joint joint="left" coef="1"/></fixed></tendon>', "range":
          'actuatorfrclimited="true" actuatorfrcrange="-.5 .5"'}, "cube",
         "joint 'left': got an actuatorfrcrange, and a motor at tendon 't'"),
    ],
)  # fmt: skip
def test_cpp_loop_says_what_it_does_not_know(changes, body, words, example, tmp_path):
    scene = tmp_path / "jaws.xml"
    scene.write_text(
        JAWS.format(**{"joint": "", "more": "", "range": "", "motor": MOTOR} | changes)
    )
    done = subprocess.run([example, scene, body, "10"], capture_output=True, text=True)
    assert done.returncode == 1
    assert words in done.stderr


def test_cpp_loop_reads_xml(example, tmp_path):
    scene = tmp_path / "jaws.xml"
    joint = '<joint name="right" type="slide" axis="-1 0 0"/>'
    motors = MOTOR + '<motor name="n" joint="right" ctrlrange="-9 9"/>'
    scene.write_text(JAWS.format(joint=joint, more="", range="", motor=motors))
    assert len(run(example, scene, "cube", 3).splitlines()) == 3
