"""What only many ticks or several threads show: no leak in the bindings, the lock let go.

The core's own soak is benchmarks/soak.cpp (`make soak`).
"""

import gc
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from test_servo import DT, Stream

import graspforce as gf

STATM = Path("/proc/self/statm")


def resident_pages():
    gc.collect()
    return int(STATM.read_text().split()[1])


@pytest.mark.skipif(not STATM.exists(), reason="reads the memory in use from /proc")
def test_steps_ticks_solves_and_refusals_leak_nothing():
    stream = Stream()
    servo = gf.Servo(stream.problem)
    fields = [stream.fields(k * DT) for k in range(50)]
    heavy = fields[0]["f"] * 100

    def rounds(count):
        for _ in range(count):
            for each in fields:
                solution = servo.step(**each)
                assert solution.c is not None
                servo.f[:] = each["f"]
                servo.tick()
            assert servo.step(f=heavy).certificate is not None
            assert servo.solution.problem is not None
            gf.solve(stream.problem)
            with pytest.raises(gf.InvalidInputError):
                servo.step(f=np.full(6, np.nan))
            servo.f[0] = np.nan
            with pytest.raises(gf.InvalidInputError):
                servo.tick()
            servo.f[:] = fields[0]["f"]

    rounds(30)
    before = resident_pages()
    rounds(300)  # 30 000 ticks: one lost outcome a tick would be 10 MB
    assert resident_pages() - before < 256


def test_the_interpreter_is_free_while_the_core_works():
    """Another thread gets on with its work in the middle of a long solve."""
    rng = np.random.default_rng(3)
    n = 120
    contacts = [
        gf.Contact(0.04 * p, -p, gf.PCWF(0.6), tangent=np.cross(p, rng.normal(size=3)))
        for p in (v / np.linalg.norm(v) for v in rng.normal(size=(n, 3)))
    ]
    J = rng.normal(size=(3 * n, 60)) / 60  # every joint feels every contact: one large block
    problem = gf.ForceProblem(
        gf.grasp_map(contacts), [0, 0, 1, 0, 0, 0], gf.PCWF(0.6), J, -9.0, 9.0, c_max=5.0
    )
    span = []

    def work():
        begin = time.perf_counter()
        gf.solve(problem)
        span.extend((begin, time.perf_counter()))

    interval = sys.getswitchinterval()
    stamps = []
    try:
        sys.setswitchinterval(10)  # nobody is made to let go
        thread = threading.Thread(target=work)
        thread.start()
        while thread.is_alive():
            stamps.append(time.perf_counter())
            time.sleep(1e-4)  # lets the other thread have the lock in the first place
        thread.join()
    finally:
        sys.setswitchinterval(interval)
    begin, end = span
    assert end - begin > 0.01
    third = (end - begin) / 3
    assert any(begin + third < stamp < end - third for stamp in stamps)
