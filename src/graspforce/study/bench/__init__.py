"""Times of graspforce and of other solvers on this machine, in one run.

``graspforce bench`` prints what :func:`measure` returns. Only ratios within a run are worth
comparing between machines.
"""

from __future__ import annotations

from collections.abc import Callable

from graspforce.study.bench import own, peers
from graspforce.study.bench.measurement import Measurement, Row, Run

__all__ = ["Measurement", "Row", "Run", "measure"]


def measure(effort: int = 20, progress: Callable[[Measurement], None] | None = None) -> Run:
    """Time ticks, cold solves, growth with the contacts, the other solvers and the import.

    Args:
        effort: rounds of every measurement.
        progress: called with each measurement when it is made.
    """
    measurements: list[Measurement] = []
    for part in (own.ticks_and_solves, own.growth, peers.peer_times, own.import_time):
        for measurement in part(effort):
            measurements.append(measurement)
            if progress is not None:
                progress(measurement)
    return Run.of(measurements)
