"""What every test file shares: hypothesis profiles, the two backends, the data of ../shared."""

import functools
import inspect
import os
import tempfile
from pathlib import Path

import hypothesis
import numpy as np
import pytest

import graspforce as gf

# The same examples on every machine and in every run; HYPOTHESIS_PROFILE=explore draws new ones.
# No profile judges by time.
PATIENT = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("ci", derandomize=True, database=None, **PATIENT)
hypothesis.settings.register_profile("explore", max_examples=1000, print_blob=True, **PATIENT)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))

BACKENDS = ("reference", "native")


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


@pytest.fixture(scope="session")
def shared_data():
    """The data that the repository does not carry; tests that need it skip where it is not."""
    folder = Path(__file__).parents[1].parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("../shared/data is not here")
    return folder


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


@pytest.fixture
def ordinary_user():
    """A folder of a user without privileges, as whom the test runs, whoever runs the tests."""
    with tempfile.TemporaryDirectory() as name:
        if os.geteuid() != 0:
            yield Path(name)
            return
        nobody = 65534
        os.chown(name, nobody, nobody)
        os.setresgid(nobody, nobody, 0)
        os.setresuid(nobody, nobody, 0)
        try:
            yield Path(name)
        finally:
            os.setresuid(0, 0, 0)
            os.setresgid(0, 0, 0)
