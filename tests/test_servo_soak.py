"""What only many ticks or several threads show: no leak in the bindings, the lock let go.

The core's own soak is benchmarks/soak.cpp (`make soak`).
"""

import gc
import sys
import threading
import time

import numpy as np
import pytest
from test_servo import DT, Stream

import graspforce as gf
from graspforce._engine import dispatch


def test_steps_ticks_solves_and_refusals_leak_nothing():
    """Counted in the interpreter's blocks of memory: an outcome is one, and owns its numbers."""
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
        gc.collect()
        return sys.getallocatedblocks()

    rounds(30)  # caches fill
    before = rounds(30)
    assert rounds(300) - before < 300  # not even the rarest call, one a round, keeps anything


def test_the_interpreter_is_free_while_the_core_works(monkeypatch):
    """Another thread gets on with its work in the middle of a solve."""
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
    native_solve, in_core, seen = dispatch._solve, threading.Event(), threading.Event()

    def watched(*arguments):
        in_core.set()
        try:
            return native_solve(*arguments)
        finally:
            in_core.clear()

    def work():
        for _ in range(200):  # until the other thread came by in the middle of one
            if seen.is_set():
                break
            gf.solve(problem)

    monkeypatch.setattr(dispatch, "_solve", watched)
    thread = threading.Thread(target=work)
    interval = sys.getswitchinterval()
    try:
        # Nobody is made to let go: what is seen between set() and clear(), the core has let in.
        sys.setswitchinterval(1e3)
        thread.start()
        while thread.is_alive() and not seen.is_set():
            if in_core.is_set():
                seen.set()
            time.sleep(1e-4)  # lets the other thread have the lock
        thread.join()
    finally:
        sys.setswitchinterval(interval)
    assert seen.is_set()
