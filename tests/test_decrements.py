"""The certified bound on the decrement over random ticks; ``make decrements`` is the long run."""

import decrements
import pytest


@pytest.fixture(scope="module")
def solved():
    return [tick for index in range(70) for tick in decrements.stream(20, index) if tick.solved]


def test_no_tick_passes_its_certified_bound(solved):
    """By no more than a millionth of it, and by rounding only where that could be the cause."""
    assert [tick for tick in solved if tick.faulty] == []


def test_the_ticks_put_the_bound_to_the_test(solved):
    clear = [tick for tick in solved if not tick.blurred]
    assert len(solved) > 2000
    assert len(clear) > 1000
    assert max(tick.measured / tick.bound for tick in clear if tick.bound > 0) > 0.9
    assert sum(tick.tol > 1e-4 for tick in clear) > 200
