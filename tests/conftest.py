"""What every test file shares: hypothesis profiles, the two backends, the grasps of a real hand."""

import contextlib
import functools
import inspect
import os
import signal
import tempfile
from collections import Counter
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from threadpoolctl import threadpool_info

import graspforce as gf
from graspforce import _engine

# The same examples on every machine and in every run; HYPOTHESIS_PROFILE=explore draws new ones.
# No profile judges by time.
PATIENT = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("ci", derandomize=True, database=None, **PATIENT)
hypothesis.settings.register_profile("explore", max_examples=1000, print_blob=True, **PATIENT)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))

# What a shell may say to the commands under test. They print UTF-8, without colours and as wide as
# a pipe is; tests of something else say so.
os.environ["PYTHONIOENCODING"] = "utf-8"
for variable in ("COLUMNS", "LINES", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
    os.environ.pop(variable, None)
# A shell starts what runs in its background with SIGINT ignored, and so would the commands be.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

BACKENDS = ("reference", "native")
NOBODY = 65534  # the user of that name

# A few grasps of a real hand (tests/data/README.md), and where a machine may have the rest of them.
ALLEGRO = Path(__file__).parent / "data" / "allegro.npz"
SHARED = Path(__file__).parents[2] / "shared" / "data"


# In a run on several processes the files of tests in a browser start early, for they wait more than
# they compute, and one after another, for a picture takes a processor for seconds.
LONG = (
    "test_viewer_clients.py",
    "test_viewer_scene.py",
    "test_viewer_knobs.py",
    "test_viewer_command.py",
)


def pytest_collection_modifyitems(config, items):
    """Set the order in which the files of a parallel run start: by turns one in a browser and one
    of the others, of which those with the most tests come first, as pytest-xdist has it."""
    if not hasattr(config, "workerinput"):
        return
    files = [path for path, _ in Counter(item.path for item in items).most_common()]
    others = [path for path in files if path.name not in LONG]
    turn = {path: 2 * i + 1 for i, path in enumerate(others)}
    turn |= {path: 2 * LONG.index(path.name) for path in files if path.name in LONG}
    items.sort(key=lambda item: turn[item.path])


def pytest_report_header():
    """What the numbers are computed by: the first question about a failure elsewhere."""
    core = _engine.module.__name__.removeprefix("graspforce._core").strip("_") or "baseline"
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    kernels = {found["architecture"] for found in threadpool_info() if "architecture" in found}
    numpy = " ".join([*simd["baseline"], *simd.get("found", [])][-1:])
    return f"processor: core {core}, OpenBLAS {' '.join(sorted(kernels))}, NumPy {numpy}"


@pytest.fixture(params=BACKENDS)
def backend(request):
    """The name of a backend; a test that takes it runs on both."""
    return request.param


@pytest.fixture
def exact(backend):
    """Settings that ask for all the digits, on each backend."""
    return gf.Settings(tol=1e-14, backend=backend)


@pytest.fixture
def default(backend):
    """Settings as a user has them, on each backend."""
    return gf.Settings(backend=backend)


@pytest.fixture
def rng():
    return np.random.default_rng(20101)


@pytest.fixture
def sealed_folder():
    """A folder that no ordinary user can write into, and that every user can reach."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o555)
        yield folder
        folder.chmod(0o755)


@contextlib.contextmanager
def as_ordinary_user():
    """Give up root's right to write anywhere; Python's own files may be out of reach, too."""
    if os.geteuid() != 0:
        yield
        return
    # A root that may not become another user has no such right.
    with contextlib.suppress(OSError):
        os.setresgid(NOBODY, NOBODY, 0)
        os.setresuid(NOBODY, NOBODY, 0)
    try:
        yield
    finally:
        os.setresuid(0, 0, 0)
        os.setresgid(0, 0, 0)


@pytest.fixture
def ordinary_user():
    """A folder of a user without privileges, as whom the test runs, whoever runs the tests."""
    with tempfile.TemporaryDirectory() as name:
        if os.geteuid() == 0:
            os.chown(name, NOBODY, NOBODY)
        with as_ordinary_user():
            yield Path(name)


def on_both_backends(*, reference, native, **strategies):
    """Make a hypothesis test of a function ``test(settings, **drawn)``, run on both backends.

    The reference is slow, so each backend has its own number of examples. ``settings`` asks
    for all the digits.
    """
    examples = {"reference": reference, "native": native}

    def decorate(test):
        @pytest.mark.parametrize("backend", BACKENDS)
        def run(backend):
            settings = gf.Settings(tol=1e-14, backend=backend)

            @hypothesis.settings(max_examples=examples[backend])
            @hypothesis.given(**strategies)
            def example(**drawn):
                test(settings, **drawn)

            example()

        functools.update_wrapper(run, test)
        run.__signature__ = inspect.signature(lambda backend: None)
        return run

    return decorate


@pytest.fixture(scope="module")
def browser():
    """Return a browser without a screen; for tests that are marked by ``needs_browser``."""
    import browser as chromium
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=chromium.PATH, args=chromium.FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def served(browser):
    """Return a function that serves a subject, or a look, and opens pages on it."""
    import live_page

    from graspforce import viewer

    opened = []

    def serve(subject, query="", pages=1):
        page = viewer.Viewer(subject, port=0)
        opened.append(page.stop)
        tabs = []
        for _ in range(pages):
            url = page.link(page._knobs.from_query(query)) if query else page.url
            tab = live_page.open_tab(browser, url)
            opened.append(tab.close)
            tabs.append(tab)
        return page, *tabs

    yield serve
    for close in reversed(opened):
        close()
