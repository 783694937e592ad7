"""graspforce bench: what is timed, kept and compared. No test depends on the time a call takes."""

import json
import subprocess
import sys

import numpy as np
import pytest

import graspforce as gf
from graspforce._util import clock
from graspforce.scenarios import random
from graspforce.study import bench
from graspforce.study.bench import own, peers, plot


@pytest.fixture(scope="module")
def run():
    return bench.Run.of([*own.ticks_and_solves(1), *own.growth(1), *peers.peer_times(1)])


def test_bench_a_run_times_what_it_promises(run):
    groups = list(dict.fromkeys(row.group for row in run.rows))
    assert groups == [
        "tick, the paper's dynamic task",
        "tick, paced at 1000 Hz",
        "cold solve",
        "tick by number of contacts, C++",
        "one Newton step of a cold solve",
        peers.GROUP,
    ]
    names = [row.name for row in run.rows]
    assert "servo.step(f=, W=, J=)" in names
    assert "C++, _core" in names
    assert peers.OWN in names
    assert all(row.p50 <= row.p99 <= row.p999 and row.count > 0 for row in run.rows)


def test_bench_every_tick_that_is_timed_is_solved():
    problems = list(gf.scenarios.dynamic().problems())[:40]
    for ticks in (own.bound_ticks(problems), own.written_ticks(problems), own.steps(problems)):
        for before, call in ticks:
            before()
            answer = call()
        if isinstance(answer, gf.Solution):
            assert answer.status is gf.Status.SOLVED
    (before, tick) = own.bound_ticks(problems)[5]
    before()
    assert tick() is gf.Status.SOLVED


def test_bench_random_grasps_are_feasible_and_the_same_each_time():
    once, again = random.grasps(20), random.grasps(20)
    assert once == again
    assert all(gf.solve(problem).status is gf.Status.SOLVED for problem in once)
    for contacts in own.CONTACTS:
        stream = random.stream(contacts, 4)
        assert all(gf.solve(problem).status is gf.Status.SOLVED for problem in stream)


def test_bench_times_are_of_the_call_and_not_of_what_comes_before():
    order = []
    pairs = [(lambda: order.append("before"), lambda: order.append("call"))] * 3
    times = clock.hot(pairs, rounds=2)
    assert times.shape == (6,)  # the first round warms up
    assert order == ["before", "call"] * 9
    assert clock.paced(pairs, 1e4, ticks=7).shape == (7,)


def test_bench_a_run_is_kept_and_read_again(run, tmp_path):
    path = tmp_path / "run.json"
    run.save(path)
    assert bench.Run.load(path) == run
    row = run.rows[0]
    assert run.p50(row.group, row.name) == row.p50
    assert run.p50(row.group, "no such thing") is None


ROW = '{"group": "a", "name": "b", "p50": %s, "p99": 1, "p999": 1, "count": 1}'
OTHERS = ["", "[]", "{}", '{"rows": [{"p50": 1}]}', '{"rows": 3}'] + [
    f'{{"rows": [{ROW % time}], "machine": {{}}, "date": ""}}' for time in ('"1"', "0", "null")
]


@pytest.mark.parametrize("text", OTHERS)
def test_bench_another_file_is_refused(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(gf.InvalidInputError, match="graspforce bench --save"):
        bench.Run.load(path)
    with pytest.raises(gf.InvalidInputError, match="cannot read"):
        bench.Run.load(tmp_path / "missing.json")


def test_bench_the_picture_is_drawn(run, tmp_path):
    path = tmp_path / "run.png"
    plot.draw(run, path)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_bench_the_command_compares_with_a_run_before(run, tmp_path):
    before, after = tmp_path / "before.json", tmp_path / "after.json"
    run.save(before)
    kept = json.loads(before.read_text())
    for row in kept["rows"]:
        row["p50"] *= 1e6
    before.write_text(json.dumps(kept))
    done = bench_command("--compare", before, "--save", after)
    assert done.returncode == 0, done.stderr
    line = next(line for line in done.stdout.splitlines() if "servo.step" in line)
    assert line.split()[-1] == "0.00"
    again = bench.Run.load(after)
    assert {(row.group, row.name) for row in again.rows} > {
        (row.group, row.name) for row in run.rows
    }


def test_bench_times_that_the_clock_covers_are_above_0(monkeypatch):
    """On a busy machine the clock may take longer than an empty call; a run is to be read again."""
    monkeypatch.setattr(clock, "_clock_time", lambda: 1e9)
    nothing = [(clock.no_op, clock.no_op)]
    for times in (clock.hot(nothing, 5), clock.paced(nothing, 1e4, 5)):
        np.testing.assert_array_equal(times, 1e-3)


def test_bench_a_run_before_that_is_missing_is_named():
    done = bench_command("--compare", "none.json")
    assert done.returncode == 2
    assert "none.json" in done.stderr


def bench_command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "graspforce", "bench", "--effort", "1", *map(str, arguments)],
        capture_output=True, encoding="utf-8",
    )  # fmt: skip


def test_bench_servo_steps_that_are_timed_take_every_field_that_changes():
    rng = np.random.default_rng(1)
    problems = [
        problem.replace(alpha=rng.uniform(1, 9), tau_hi=rng.uniform(0.5, 1, 12), c_max=c_max)
        for problem in list(gf.scenarios.dynamic().problems())[:20]
        for c_max in [rng.uniform(20, 30)]
    ]
    servo = gf.Servo(problems[0])
    for problem, (before, step) in zip(problems, own.steps(problems), strict=True):
        before()
        solution = step()
        assert solution.problem == problem
        np.testing.assert_allclose(solution.c, servo.step_to(problem).c, rtol=1e-9)


@pytest.mark.parametrize("ticks", [own.bound_ticks, own.written_ticks])
def test_bench_servo_ticks_that_write_f_W_J_refuse_other_changes(ticks):
    first, second = list(gf.scenarios.dynamic().problems())[:2]
    with pytest.raises(gf.InvalidInputError, match="problems: alpha, tau_lo changed, expected"):
        ticks([first, second.replace(alpha=2.0, tau_lo=-0.4)])
