"""The C interface: built, found by CMake, called from C, ctypes and Rust; Python's digits."""

import ctypes
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import graspforce as gf
from graspforce import _core
from graspforce._engine import dispatch

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
CMAKE, RUSTC = shutil.which("cmake"), shutil.which("rustc")
pytestmark = pytest.mark.skipif(CMAKE is None, reason="needs cmake and a C++ compiler")


def run(*command, **options):
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    folder = tmp_path_factory.mktemp("c")
    where = f"-DCMAKE_INSTALL_PREFIX={folder / 'prefix'}"
    debug = "-DCMAKE_BUILD_TYPE=Debug"  # the same digits, sooner built
    run(CMAKE, "-S", ROOT, "-B", folder / "build", "-DGRASPFORCE_C=ON", where, debug)
    run(CMAKE, "--build", folder / "build")
    run(CMAKE, "--install", folder / "build")
    return folder / "prefix"


@pytest.fixture(scope="module")
def library(prefix):
    return next((prefix / "lib").glob("libgraspforce.*"))


@pytest.fixture(scope="module")
def lib(library):
    """The functions that the tests call, with the types of what they return."""
    lib = ctypes.CDLL(str(library))
    for name, kind in {
        "create": ctypes.c_void_p, "error": ctypes.c_char_p, "version": ctypes.c_char_p,
        "field": ctypes.POINTER(ctypes.c_double), "forces": ctypes.POINTER(ctypes.c_double),
        "multipliers": ctypes.POINTER(ctypes.c_double), "decrement": ctypes.c_double,
        "violation": ctypes.c_double, "status_name": ctypes.c_char_p, "find_margins": Margins,
    }.items():  # fmt: skip
        getattr(lib, f"graspforce_{name}").restype = kind
    lib.graspforce_set_limits.argtypes = [
        ctypes.c_void_p, ctypes.c_double, ctypes.c_int, ctypes.c_double,
    ]  # fmt: skip
    return lib


class Margins(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in ("friction", "torque", "limit", "wrench_error")]


class CServo:
    """A servo of the C library with a problem's numbers in it."""

    def __init__(self, lib, problem, optional):
        self.lib, self.problem = lib, problem
        layout = problem.layout
        models = (ctypes.c_int * len(layout.dims))(*layout.dims)
        sizes = (layout.wrench_rows, len(layout.dims), models, layout.joints, layout.inequalities)
        self.servo = ctypes.c_void_p(lib.graspforce_create(*sizes, optional))
        assert self.servo.value, lib.graspforce_error()
        for name, values in layout.views(problem.packed).items():
            if values.size:
                self.field(name)[...] = values

    def __getattr__(self, name):
        function = getattr(self.lib, f"graspforce_{name}")
        return lambda *arguments: function(self.servo, *arguments)

    def field(self, name):
        rows, columns = ctypes.c_int(), ctypes.c_int()
        first = self.lib.graspforce_field(
            self.servo, name.encode(), ctypes.byref(rows), ctypes.byref(columns)
        )
        if not first:
            return None
        values = np.ctypeslib.as_array(first, (rows.value, columns.value))
        return values if columns.value > 1 else values[:, 0]


@pytest.fixture
def servo(lib):
    """The paper's grasp, whose hand has joints."""
    servo = CServo(lib, gf.scenarios.get("static").problem(0.0), None)
    yield servo
    servo.destroy()


def cube_in_python(monkeypatch):
    """What Python's baseline core answers to the examples."""
    monkeypatch.setattr(dispatch, "NativeServo", _core.Servo)
    sides = [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]
    contacts = [
        gf.Contact(0.0375 * np.array(side), -np.array(side), gf.PCWF(0.5), tangent=(0, 0, 1))
        for side in sides
    ]
    problem = gf.Grasp(contacts).problem([0, 0, 0.25 * 9.81, 0, 0, 0], c_max=20)
    servo = gf.Servo(problem)
    for engagement in (1, 0.5, 0.1, 0, 0.1, 1):
        servo.engagement[3] = engagement
        assert servo.tick() is gf.Status.SOLVED
        yield servo.c.copy()


def in_c(prefix, library, folder):
    run(CMAKE, "-S", EXAMPLES / "c", "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}")
    run(CMAKE, "--build", folder)
    return run(folder / "hold_cube")


def in_ctypes(prefix, library, folder):
    return run(sys.executable, EXAMPLES / "c" / "hold_cube.py", library)


def in_rust(prefix, library, folder):
    if RUSTC is None:
        pytest.skip("needs rustc")
    source, program = EXAMPLES / "rust" / "hold_cube.rs", folder / "hold_cube"
    run(RUSTC, "--edition", "2021", "-D", "warnings", "-L", prefix / "lib", source, "-o", program)
    return run(program, env={"LD_LIBRARY_PATH": str(prefix / "lib")})


@pytest.mark.parametrize("example", [in_c, in_ctypes, in_rust])
def test_the_examples_print_the_forces_of_python(example, prefix, library, tmp_path, monkeypatch):
    printed = np.loadtxt(example(prefix, library, tmp_path).splitlines())
    forces = np.array(list(cube_in_python(monkeypatch)))
    np.testing.assert_allclose(printed, forces, rtol=0, atol=1e-12)
    if platform.machine() in ("x86_64", "AMD64"):
        np.testing.assert_array_equal(printed, forces)


def test_a_tick_is_that_of_pythons_servo(servo, lib):
    problem = servo.problem
    found = gf.solve(problem)
    assert servo.tick() == 0
    c = np.ctypeslib.as_array(servo.forces(), (len(found.c),))
    np.testing.assert_allclose(c, found.c, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.ctypeslib.as_array(servo.multipliers(), (6,)), found.nu, 1e-6)
    tau = np.empty(problem.layout.joints)
    servo.torques(tau.ctypes.data_as(ctypes.c_void_p))
    np.testing.assert_allclose(tau, problem.J.T @ c + problem.tau_bias, rtol=0, atol=1e-12)
    assert servo.newton_steps() == found.newton_steps
    assert servo.decrement() <= 2e-9**0.5
    margins = servo.find_margins()
    assert margins.torque == pytest.approx(found.torque_margins.min(), rel=1e-6)
    assert margins.wrench_error < 1e-9


def test_an_infeasible_tick_has_its_violation(servo):
    servo.field("f")[2] = 500
    assert servo.lib.graspforce_status_name(servo.tick()) == b"INFEASIBLE"
    assert servo.violation() > 0
    assert servo.nearest() == 1
    margins = servo.find_margins()
    assert min(margins.friction, margins.torque) > 0
    assert margins.wrench_error > 1
    servo.field("f")[:] = servo.problem.f
    assert servo.tick() == 0


def test_a_refused_tick_says_why_and_changes_nothing(servo):
    servo.tick()
    c = np.ctypeslib.as_array(servo.forces(), (12,))
    before, words = c.copy(), ctypes.create_string_buffer(100)
    assert servo.refusal(words, 100) == 0
    assert words.value == b""
    servo.field("W")[2, 3] = np.nan
    assert servo.lib.graspforce_status_name(servo.tick()) == b"INVALID_NUMBERS"
    whole = servo.refusal(words, 100)
    assert words.value == b"W[2, 3]: got nan, expected finite numbers everywhere"
    assert whole == len(words.value)
    assert servo.refusal(words, 5) == whole
    assert words.value == b"W[2,"
    np.testing.assert_array_equal(c, before)
    servo.field("W")[...] = servo.problem.W
    servo.field("tau_lo")[4] = 9
    servo.tick()
    servo.refusal(words, 100)
    assert words.value == b"tau_lo[4]: got 9, expected less than tau_hi"


def test_every_field_is_found_in_the_shape_of_pythons(lib):
    rng = np.random.default_rng(0)
    problem = gf.ForceProblem(
        rng.standard_normal((6, 11)), np.ones(6),
        [gf.PCWF(0.4, pull=2), gf.SFC(0.5, 0.01), gf.SFC(1, 0.1)],
        rng.standard_normal((11, 5)), -np.ones(5), np.ones(5), c_max=10.0, c_min=0.1,
        A=rng.standard_normal((2, 11)), b=np.ones(2), f_soft=np.ones(6), cone_weight=0.5,
        c_last=np.zeros(11), dc_max=np.ones(11),
    )  # fmt: skip
    servo = CServo(lib, problem, b" c_max c_min pull f_soft  cone_weight c_last dc_max")
    views = problem.layout.views(problem.packed)
    assert views.pop("internal").size == 0
    for name, values in views.items():
        np.testing.assert_array_equal(servo.field(name).ravel(), values.ravel(), err_msg=name)
    assert servo.field("friction") is None
    servo.destroy()


def test_a_field_that_the_problem_has_not_is_null(servo):
    assert servo.field("c_min") is None


def test_limits_are_taken_or_refused_whole(servo):
    assert servo.set_limits(1e-9, 1, np.inf) == 0
    for bad in ((0.0, 5, 1.0), (1.0, 5, 1.0), (np.nan, 5, 1.0), (1e-9, 0, 1.0), (1e-9, 5, 0.0)):
        assert servo.set_limits(*bad) == -1
    servo.tick()
    assert servo.newton_steps() == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0, 1, [3], 0, 0, None), "got 0 wrench rows"),
        ((6, 0, [3], 0, 0, None), "0 contacts"),
        ((6, 1, None, 0, 0, None), "models: got null, expected one a contact"),
        ((6, 2, [3, 2], 0, 0, None), "models[1]: got 2, expected 1 (FPC), 3 (PCWF) or 4 (SFC)"),
        ((6, 1, [3], -1, 0, None), "-1 joints"),
        (
            (6, 1, [3], 0, 0, b"c_max c_mx"),
            "optional: got c_mx, expected c_max, c_min, pull, f_soft",
        ),
    ],
)
def test_a_servo_that_cannot_be_made_says_why(arguments, words, lib):
    rows, contacts, models, *rest = arguments
    given = None if models is None else (ctypes.c_int * len(models))(*models)
    assert lib.graspforce_create(rows, contacts, given, *rest) is None
    assert words in lib.graspforce_error().decode()


@pytest.mark.parametrize("contact", [-1, 4])
def test_a_contact_that_there_is_not_is_not_written(contact, servo):
    before = servo.field("W").copy()
    vectors = [(ctypes.c_double * 3)(*values) for values in ([0, 0, 0], [0, 0, 1], [1, 0, 0])]
    assert servo.write_contact(contact, *vectors) == -1
    np.testing.assert_array_equal(servo.field("W"), before)
    assert servo.write_contact(0, vectors[0], vectors[0], vectors[2]) == -1


def test_only_the_interface_is_exported(library):
    if shutil.which("nm") is None or sys.platform != "linux":
        pytest.skip("needs nm")
    symbols = run("nm", "-D", "--defined-only", library).split("\n")
    names = {line.split()[-1] for line in symbols if line}
    header = (ROOT / "cpp" / "c" / "graspforce.h").read_text(encoding="utf-8")
    declared = set(re.findall(r"^GRASPFORCE_API .*?\b(graspforce_\w+)\(", header, re.M))
    assert names == declared
    assert len(declared) >= 20


def test_the_version_is_pythons(lib):
    assert lib.graspforce_version().decode() == gf.__version__
    header = (ROOT / "cpp" / "c" / "graspforce.h").read_text(encoding="utf-8")
    assert lib.graspforce_abi() == int(re.search(r"GRASPFORCE_ABI (\d+)", header)[1])


def test_the_page_shows_the_files_that_run():
    page = (ROOT / "docs" / "c.md").read_text(encoding="utf-8")
    sources = [path.read_text(encoding="utf-8") for path in (EXAMPLES / "c").iterdir()]
    snippets = re.findall(r"^```(?:c|cmake)\n(.*?)^```", page, re.S | re.M)
    assert len(snippets) >= 5
    for snippet in snippets:
        assert any(snippet in source for source in sources), snippet
