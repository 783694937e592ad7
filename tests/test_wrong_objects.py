"""Objects of the wrong kind, in every argument: taken for what they are, or refused by name.

An InvalidInputError names the argument, says what came and what was expected; nothing else comes
out of a public call, whatever goes in.
"""

import re

import models
import numpy as np
import pytest
from scipy import sparse

import graspforce as gf
from graspforce import hands, regrasp, scenarios, trajectory
from graspforce.scenarios import random


class Convertible:
    """What pandas and others look like to NumPy."""

    def __array__(self, dtype=None, copy=None):
        return np.array([1.0, 2.0])


class Inconvertible:
    """What a tensor that carries derivatives looks like to NumPy."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("call detach() first\nand then numpy()")


class Poor:
    """A hand that returns what a hand does not."""

    joint_names, tau_lo, tau_hi = ("a",), [-1.0], [1.0]

    def __init__(self, **parts):
        self.J = np.zeros((12, 1))
        vars(self).update(parts)

    def jacobian(self, contacts, q):
        return self.J


PROBLEM = gf.ForceProblem(np.eye(3), [1, 0, 0], gf.PCWF(0.5), c_max=20)
SOLVED = gf.solve(PROBLEM)
PRESSING = gf.ForceProblem([[1.0]], [3.0], gf.FPC(), c_max=2.0)
PROOF = gf.solve(PRESSING).certificate
FULL = {
    "f": [1, 0, 0], "W": np.eye(3), "J": np.ones((3, 2)), "tau_lo": -9, "tau_hi": 9, "tau_bias": 0,
    "c_max": 20, "c_min": 0.1, "engagement": 0.9, "A": np.ones((1, 3)), "b": [100], "alpha": 3.0,
    "models": gf.PCWF(0.5),
}  # fmt: skip
SCENARIO = scenarios.static(duration=0.004)
CONTACTS, ANGLES = SCENARIO.contacts_at(0.0), SCENARIO.joint_angles(0.0)
CONTACT = CONTACTS[0]
RELEASE = {"finger": 0, "leave": 0.5, "back": 1.0, "ramp": 0.1}
MASKED = np.ma.masked_array([1.0, 2.0, 3.0], [True, False, False])
NESTED = []
NESTED.append(NESTED)

JUNK = {
    "None": None,
    "text": "abc",
    "bytes": b"abc",
    "number": 1.5,
    "zero": 0,
    "integer": 7,
    "NaN": np.nan,
    "infinity": np.inf,
    "complex": 1j,
    "True": True,
    "NumPy's True": np.True_,
    "too large an int": 2**31,
    "a far larger one": 10**5000,
    "vector": np.zeros(3),
    "matrix": np.zeros((3, 3)),
    "objects": np.array([None, 1], dtype=object),
    "texts": np.array(["a"]),
    "dates": np.array(["2020-01-01"], dtype="M8[D]"),
    "masked": MASKED,
    "nothing masked": np.ma.masked_array([1.0, 2.0, 3.0]),
    "masked number": np.ma.masked,
    "masked rows": [MASKED, MASKED, MASKED],
    "sparse": sparse.csr_array(np.eye(3)),
    "convertible": Convertible(),
    "inconvertible": Inconvertible(),
    "list": [1, 2],
    "no list": [],
    "ragged": [[1, 2], [3]],
    "itself": NESTED,
    "set": {1, 2},
    "dict": {"a": 1},
    "iterator": iter([1]),
    "object": object(),
    "function": lambda: 1,
    "class": gf.ForceProblem,
    "model's class": gf.PCWF,
    "hand's class": hands.PaperHand,
    "problem": PROBLEM,
    "solution": SOLVED,
    "settings": gf.Settings(),
    "servo": gf.Servo(PROBLEM),
    "contact": CONTACT,
    "hand": SCENARIO.hand,
    "scenario": SCENARIO,
    "module": np,
}


def step(**fields):
    return gf.Servo(gf.ForceProblem(**FULL)).step(**fields)


# What is called, with arguments that are right.
CALLS = {
    gf.solve: {"problem": PROBLEM, "settings": None, "start": np.zeros(3), "check": False},
    gf.Servo: {"problem": PROBLEM, "settings": None},
    step: FULL,
    gf.ForceProblem: FULL,
    PROBLEM.replace: {"f": [1, 0, 0], "models": gf.PCWF(0.5), "c_max": 20, "alpha": 3.0},
    gf.Settings: {"tol": 1e-9, "max_steps": 10, "budget_us": None, "backend": "native"},
    gf.check_certificate: {"problem": PRESSING, "certificate": PROOF},
    PROOF.proves_infeasible: {"problem": PRESSING},
    PROOF.excess: {"problem": PRESSING},
    gf.Certificate: {"y": PROOF.y, "z": PROOF.z},
    gf.Solution: {"outcome": SOLVED._outcome, "problem": PROBLEM},
    gf.PCWF: {"mu": 0.5},
    gf.SFC: {"mu": 0.5, "gamma": 0.01},
    gf.Contact: {"point": (0, 0, 0), "normal": (0, 0, 1), "model": gf.FPC(), "tangent": (1, 0, 0)},
    gf.grasp_map: {"contacts": CONTACTS, "origin": (0, 0, 0)},
    gf.Grasp: {"contacts": CONTACTS, "hand": SCENARIO.hand, "q": ANGLES, "origin": (0, 0, 0)},
    gf.Grasp(CONTACTS).problem: {
        "f": np.ones(6), "J": np.ones((12, 1)), "tau_lo": -9, "tau_hi": 9, "tau_bias": 0,
        "c_max": 20, "c_min": 0.1, "engagement": 0.9, "A": np.ones((1, 12)), "b": [1], "alpha": 3.0,
    },
    hands.PaperHand: {
        "base_axis": "radial", "elbow": "outward", "link": 0.1, "half_width": 0.1, "tau_max": 1.0,
    },
    SCENARIO.hand.jacobian: {"contacts": CONTACTS, "q": ANGLES},
    SCENARIO.hand.inverse_kinematics: {"points": [each.point for each in CONTACTS]},
    SCENARIO.hand.forward_kinematics: {"q": ANGLES},
    regrasp.is_removed: {"engagement": [0.5, 0.0]},
    regrasp.linear: {"s": 0.5},
    regrasp.smooth: {"s": 0.5},
    regrasp.Release: RELEASE,
    regrasp.Schedule: {"contacts": 4, "releases": [], "shape": "linear"},
    regrasp.Schedule(4, [regrasp.Release(**RELEASE)]): {"t": 0.5},
    trajectory.Hold: {"position": (0, 0, 0), "yaw": 0.1},
    trajectory.Hold((0, 0, 0)).at: {"t": 0.1},
    trajectory.Circle: {
        "centre": (0, 0, 0), "radius": 1, "period": 1, "yaw_amplitude": 1, "yaw_frequency": 1,
    },
    trajectory.Circle((0, 0, 0), 1.0, 1.0).at: {"t": 0.1},
    trajectory.Move: {"start": (0, 0, 0), "way": (0, 0, 1), "begin": 0.1, "duration": 1.0},
    trajectory.Move((0, 0, 0), (0, 0, 1), 0.1, 1.0).at: {"t": 0.1},
    trajectory.Sway: {
        "start": (0, 0, 0), "way": (0, 0, 1), "yaw": 0.1, "begin": 0.1, "period": 1.0,
    },
    trajectory.Sway((0, 0, 0), (0, 0, 1), 0.1, 0.1, 1.0).at: {"t": 0.1},
    trajectory.Screw: {"start": (0, 0, 0), "angle": 1.0, "rate": 1.0, "ramp": 0.1, "pitch": 0.01},
    trajectory.Screw((0, 0, 0), 1.0, 1.0, 0.1, 0.01).at: {"t": 0.1},
    trajectory.wrench: {
        "mass": 1, "inertia": np.eye(3), "acceleration": (0, 0, 0), "angular_velocity": (0, 0, 0),
        "angular_acceleration": (0, 0, 0), "gravity": 9.81,
    },
    scenarios.get: {"name": "static"},
    scenarios.regrasp: {
        "c_max": 20.0, "shape": "linear", "alpha": 5.0, "hand": SCENARIO.hand, "mu": 0.5,
        "rate": 250.0, "duration": 2.0,
    },
    scenarios.Cube: {"mass": 1.0, "side": 1.0},
    SCENARIO.cube.side_contacts: {"model": gf.FPC()},
    scenarios.Scenario: {
        "name": "mine", "summary": "", "cube": SCENARIO.cube, "hand": SCENARIO.hand,
        "contacts": SCENARIO.contacts, "motion": SCENARIO.motion, "alpha": 5.0, "c_max": 20.0,
        "schedule": None, "rate": 250.0, "duration": 2.0,
    },
    random.grasps: {"count": 1, "seed": 1},
    random.stream: {"contacts": 4, "ticks": 2},
    random.geometry: {"rng": np.random.default_rng(1), "hard": False},
    scenarios.run: {"scenario": SCENARIO, "settings": None},
    scenarios.sweep_alpha: {"alphas": [1.0], "scenario": SCENARIO, "settings": None},
}  # fmt: skip


def name_of(call):
    return getattr(call, "__qualname__", repr(type(call).__name__))


def refusals(call, good, name):
    """What junk an argument is refused with, by what the junk is."""
    texts = {}
    for what, junk in JUNK.items():
        try:
            call(**(good | {name: junk}))
        except gf.InvalidInputError as error:
            texts[what] = str(error)
    return texts


def assert_telling(texts, names):
    """Each text names an argument and tells what was expected; no argument takes whatever comes."""
    for what, text in texts.items():
        assert re.search("expected|missing|given without", text), (what, text)
        assert "\n" not in text, (what, text)
        about = re.match(r"(?:\w+\.)*(\w+)(\[[\d, ]+\])?: ", text)
        assert about is not None, (what, text)
        assert about[1] in names, (what, text)
    assert {"object", "complex", "class", "module", "masked", "set"} <= set(texts)


@pytest.mark.filterwarnings("ignore:overflow encountered in cast:RuntimeWarning")
@pytest.mark.parametrize(
    ("call", "name"),
    [(call, name) for call, good in CALLS.items() for name in good],
    ids=[f"{name_of(call)}-{name}" for call, good in CALLS.items() for name in good],
)
def test_taken_or_refused_by_name(call, name):
    texts = refusals(call, CALLS[call], name)
    # What is of the right kind may not fit another argument, which the text then names.
    assert_telling(texts, {name, *CALLS[call], "step", "certificate"})


# ---- one by one: the text ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: gf.solve(PROBLEM.W), "problem: got type ndarray, expected a ForceProblem"),
        (lambda: gf.solve(SOLVED), "problem: got type Solution, expected a ForceProblem"),
        (lambda: gf.solve(gf.ForceProblem), "problem: got the class ForceProblem, expected a Fo"),
        (lambda: gf.solve(gf.Grasp(CONTACTS)), "problem: got type Grasp, expected a ForceProblem"),
        (lambda: gf.solve(PROBLEM, 1e-6), "settings: got 1e-06, expected a Settings"),
        (lambda: gf.solve(PROBLEM, 0), "settings: got 0, expected a Settings"),
        (lambda: gf.solve(PROBLEM, False), "settings: got False, expected a Settings"),
        (lambda: gf.solve(PROBLEM, []), "settings: got [], expected a Settings"),
        (lambda: gf.solve(PROBLEM, SOLVED.c), "settings: got type ndarray, expected a Settings"),
        (lambda: gf.solve(PROBLEM, gf.Settings), "settings: got the class Settings, expected a"),
        (lambda: gf.solve(PROBLEM, start=[[0, 0, 0]]), "start: got shape (1, 3), expected shape"),
        (lambda: gf.solve(PROBLEM, check="no"), "check: got 'no', expected True or False"),
        (lambda: gf.Servo(PROBLEM.W), "problem: got type ndarray, expected a ForceProblem"),
        (lambda: gf.Servo(PROBLEM, 0), "settings: got 0, expected a Settings"),
        (lambda: gf.check_certificate(PRESSING, None), "certificate: got None, expected a Certif"),
        (lambda: gf.check_certificate(PROOF, PRESSING), "problem: got type Certificate, expected"),
        (lambda: PROOF.excess(PROBLEM), "certificate: got y of shape (1,) and z of shape (1,)"),
        (lambda: gf.Settings(max_steps=2**31), "max_steps: got 2147483648, expected an integer in"),
        (lambda: gf.Settings(max_steps=True), "max_steps: got True, expected an integer in 1…2147"),
        (lambda: gf.Settings(max_steps=1.0), "max_steps: got 1.0, expected an integer in 1…21474"),
        (lambda: gf.Settings(max_steps=10**5000), "max_steps: got type int, expected an integer"),
        (lambda: gf.Settings(backend=np.zeros(2)), "backend: got type ndarray, expected 'native'"),
        (lambda: gf.Settings(tol="1e-6"), "tol: got type str128, expected real numbers of shape ("),
        (lambda: gf.Grasp(CONTACTS, object(), [0]), "hand: got type object, expected a Hand"),
        (lambda: gf.Grasp(CONTACTS, hands.PaperHand, [0]), "hand: got the class PaperHand, expec"),
        (lambda: gf.Grasp(set(CONTACTS)), "contacts: got type set, expected a list of Contact"),
        (lambda: gf.Grasp(iter(CONTACTS)), "contacts: got type tuple_iterator, expected a list"),
        (lambda: gf.Grasp("abc"), "contacts: got 'abc', expected a list of Contact"),
        (lambda: gf.Grasp(CONTACTS).problem(np.ones(6), cmax=1), "cmax: not an option of Grasp.pr"),
        (lambda: gf.Grasp(CONTACTS).problem(np.ones(6), W=1), "W: not an option of Grasp.problem"),
        (lambda: PROBLEM.replace(cmax=1), "cmax: not an option of ForceProblem.replace; expected"),
        (lambda: PROBLEM.replace(f=MASKED), "f: got a masked array, expected real numbers of sha"),
        (lambda: PROBLEM.replace(W=[MASKED] * 3), "W: got a masked array, expected real numbers"),
        (lambda: gf.PCWF(np.ma.masked), "PCWF.mu: got a masked array, expected real numbers"),
        (lambda: gf.Servo(PROBLEM).step(f=MASKED), "f: got a masked array, expected real numbers"),
        (lambda: PROBLEM.replace(f=Inconvertible()), "f: not a regular array of numbers (call det"),
        (lambda: PROBLEM.replace(f={1, 2}), "f: got type set, expected real numbers of shape"),
        (lambda: scenarios.get(["static"]), "name: got type list, expected one of static, dynamic"),
        (lambda: scenarios.run("static"), "scenario: got 'static', expected a Scenario"),
        (lambda: scenarios.run(SCENARIO, progress=3), "progress: got 3, expected a function"),
        (lambda: scenarios.sweep_alpha(scenario=0), "scenario: got 0, expected a Scenario"),
        (lambda: regrasp.Schedule(4, regrasp.Release(**RELEASE)), "releases: got type Release, ex"),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)  # fmt: skip
def test_text(call, text):
    with pytest.raises(gf.InvalidInputError, match="^" + re.escape(text)):
        call()


@pytest.mark.parametrize(
    ("hand", "text"),
    [
        (Poor(J=None), "hand.jacobian: got None, expected"),
        (Poor(J=np.zeros((11, 1))), "hand.jacobian: got shape (11, 1), expected shape (12, 1)"),
        (Poor(tau_lo=[-1.0, 1.0]), "hand.tau_lo: got shape (2,), expected shape (1,) or a scalar"),
        (Poor(tau_hi=None), "hand.tau_hi: got None, expected"),
        (Poor(joint_names=None), "hand.joint_names: got None, expected a list of str"),
        (Poor(joint_names="a"), "hand.joint_names: got 'a', expected a list of str"),
        (Poor(joint_names=[1]), "hand.joint_names[0]: got 1, expected a str"),
    ],
)
def test_a_hand_that_returns_something_else(hand, text):
    with pytest.raises(gf.InvalidInputError, match="^" + re.escape(text)):
        gf.Grasp(CONTACTS, hand, [0.0])


def test_a_hand_of_ones_own_is_taken():
    grasp = gf.Grasp(CONTACTS, Poor(tau_lo=-1.0), [0.0])
    assert grasp.tau_lo.tolist() == [-1.0]
    assert grasp.joint_names == ("a",)


def test_settings_are_what_they_compare_and_print_as():
    """Numbers of NumPy's kinds become Python's, so that equal settings are equal."""
    settings = gf.Settings(tol=np.array(1e-6), max_steps=np.int32(7), budget_us=np.float32(50))
    assert settings == gf.Settings(1e-6, 7, 50.0)
    assert hash(settings) == hash(gf.Settings(1e-6, 7, 50.0))
    assert [type(each) for each in (settings.tol, settings.max_steps)] == [float, int]


def test_the_most_steps_that_settings_take_is_what_the_core_takes(default):
    most = gf.Settings(max_steps=2**31 - 1, backend=default.backend)
    assert gf.solve(PROBLEM, most).status is gf.Status.SOLVED
    assert gf.Servo(PROBLEM, most).step().status is gf.Status.SOLVED


def test_a_subclass_is_as_good():
    class Mine(gf.ForceProblem):
        pass

    class Quick(gf.Settings):
        pass

    mine = Mine(np.eye(3), [1, 0, 0], gf.PCWF(0.5), c_max=20)
    assert gf.solve(mine, Quick(), check=np.True_) == SOLVED
    assert gf.Servo(mine, Quick()).step() == SOLVED


# ---- robots from elsewhere ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """The paper's hand as MuJoCo and Pinocchio have it, and as files."""
    mujoco, pinocchio = pytest.importorskip("mujoco"), pytest.importorskip("pinocchio")
    mjcf, urdf = (tmp_path_factory.mktemp("hand") / f"hand.{kind}" for kind in ("xml", "urdf"))
    mjcf.write_text(models.paper_hand_xml())
    urdf.write_text(models.paper_hand_urdf("radial"))
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pads, sites = ([f"{name}{i}" for i in (1, 2, 3, 4)] for name in ("pad", "tip"))
    return {
        hands.from_mjcf: {"source": mjcf, "fingertips": sites, "tau_max": 1.0},
        hands.from_urdf: {"path": urdf, "fingertips": pads, "tau_max": 1.0},
        hands.from_mjcf(mjcf, sites).touching: {"names": sites},
        gf.Grasp.from_mujoco: {
            "model": model, "data": data, "object_body": 1, "fingertips": sites, "tau_max": 1.0,
        },
        gf.Grasp.from_pinocchio: {
            "model": pinocchio.buildModelFromUrdf(str(urdf)), "q": np.zeros(12),
            "contacts": CONTACTS, "links": pads, "v": np.zeros(12), "origin": (0, 0, 0),
            "tau_max": 1.0,
        },
    }  # fmt: skip


def test_robots_are_taken_or_refused_by_name(robots):
    for call, good in robots.items():
        for name in set(good) - {"source", "path"}:
            assert_telling(refusals(call, good, name), good)


def test_text_for_robots(robots):
    from_mjcf, from_urdf, touching, from_mujoco, from_pinocchio = robots
    for call, changed, text in (
        (from_mjcf, {"source": None}, "source: got None, expected a path or an mujoco.MjModel"),
        (from_urdf, {"path": None}, "path: got None, expected a path"),
        (from_urdf, {"fingertips": [1]}, "fingertips[0]: got 1, expected a str"),
        (touching, {"names": "tip1"}, "names: got 'tip1', expected a list of str"),
        (from_mujoco, {"object_body": np.zeros(2)}, "object_body: got type ndarray, expected a bo"),
        (from_pinocchio, {"links": None}, "links: got None, expected a list of str"),
        (from_pinocchio, {"links": ["pad1"]}, "links: got ('pad1',), expected 4 names, one"),
    ):
        with pytest.raises(gf.InvalidInputError, match="^" + re.escape(text)):
            call(**(robots[call] | changed))


def test_slips_in_what_pinocchio_gets(robots):
    *_, from_pinocchio = robots
    good = robots[from_pinocchio]
    outward = [gf.Contact(c.point, -c.normal, c.model, c.tangent) for c in good["contacts"]]
    with pytest.warns(gf.GraspForceWarning, match="INTO") as caught:
        from_pinocchio(**(good | {"contacts": outward}))
    assert [each.filename for each in caught] == [__file__]
