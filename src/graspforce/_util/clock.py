"""Times of calls, less the clock's own."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from graspforce._util.arrays import Array

Call = Callable[[], object]
Pair = tuple[Call, Call]  # what comes before and is not timed, and what is

_now = time.perf_counter_ns


def no_op() -> None:
    """Do nothing: for a call that needs nothing before it."""


def hot(pairs: Sequence[Pair], rounds: int, warm_up: bool = True) -> Array:
    """Return the times of calls that follow one another at once, shape (rounds·pairs,) [µs].

    Args:
        pairs: the calls, in this order.
        rounds: how often all of them are made.
        warm_up: make them once more before, which does not count.
    """
    times = np.empty((rounds + warm_up, len(pairs)))
    with _no_collection():
        for row in times:
            for index, (before, call) in enumerate(pairs):
                before()
                start = _now()
                call()
                row[index] = _now() - start
    return _without_clock(times[warm_up:].ravel())


def paced(pairs: Sequence[Pair], rate: float, ticks: int) -> Array:
    """Return the times of calls that come at a rate [1/s], as in a control loop [µs].

    The processor waits in between, so its caches and its frequency are those of a control loop.
    """
    times = np.empty(ticks)
    period = 1e9 / rate
    with _no_collection():
        due = _now()
        for tick in range(ticks):
            before, call = pairs[tick % len(pairs)]
            due += period
            time.sleep(max(0.0, (due - _now()) / 1e9))
            before()
            start = _now()
            call()
            times[tick] = _now() - start
    return _without_clock(times)


def _without_clock(times: Array) -> Array:
    """Return times [ns] less the clock's own [µs]; what that covers counts as the clock's step."""
    return np.maximum(times - _clock_time(), 1.0) / 1e3


def _clock_time() -> float:
    return float(np.median([-(_now() - _now()) for _ in range(1001)]))


@contextmanager
def _no_collection() -> Generator[None]:
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
