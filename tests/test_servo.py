"""The servo: the same answers as solving each tick cold, and a state that nothing can spoil."""

import contextlib
import copy
import gc
import pickle
import pydoc

import numpy as np
import pytest
from grasps import plant
from scipy.spatial.transform import Rotation

import graspforce as gf


class Stream:
    """A smooth motion: the object turns and breathes, the hand's Jacobian follows, f swings."""

    def __init__(self, seed=0, kinds=("PCWF", "SFC", "PCWF", "PCWF"), **sort):
        self.rng = np.random.default_rng(seed)
        self.planted = plant(self.rng, list(kinds), alpha=2.0, **({"ceilings": True} | sort))
        self.axis = self.rng.normal(size=3)
        self.wobble = 0.02 * self.rng.normal(size=self.planted.problem.J.shape)
        self.problem = self.at(0)

    def fields(self, t):
        problem = self.planted.problem
        R = Rotation.from_rotvec(0.4 * np.sin(t) * self.axis).as_matrix()
        W = np.kron(np.eye(2), R) @ problem.W
        c = self.planted.c * (1 + 0.1 * np.sin(3 * t))
        J = problem.J * (1 + self.wobble * np.sin(2 * t))
        return {"f": W @ c, "W": W, "J": J}

    def at(self, t):
        return self.planted.problem.replace(**self.fields(t))


DT = 0.004
TICKS = {"reference": 12, "native": 250}


def assert_like_cold(solution, settings, accuracy=1e-6):
    """A tick's answer is that of a cold solve, and it bears itself out."""
    cold = gf.solve(solution.problem, settings)
    assert solution.status is cold.status
    if cold.status is gf.Status.SOLVED:
        assert np.abs(solution.c - cold.c).max() <= accuracy * np.abs(cold.c).max()
        assert solution.nu == pytest.approx(cold.nu, abs=1e-3 * np.abs(cold.nu).max())
    assert solution.verify().ok


@pytest.mark.parametrize("seed", range(3))
def test_every_tick_is_the_answer_of_a_cold_solve(backend, exact, seed):
    stream = Stream(seed, floors=seed == 1, shared=seed == 2)
    servo = gf.Servo(stream.problem, exact)
    steps = []
    for k in range(TICKS[backend] // 3):
        solution = servo.step(**stream.fields(k * DT))
        assert solution.problem == stream.at(k * DT)
        assert_like_cold(solution, exact)
        steps.append(solution.newton_steps)
    assert np.mean(steps[3:]) < 0.5 * steps[0]


def test_a_warm_tick_takes_a_step_or_two(backend):
    stream = Stream()
    servo = gf.Servo(stream.problem, gf.Settings(backend=backend))
    steps = [servo.step(**stream.fields(k * DT)).newton_steps for k in range(TICKS[backend])]
    assert max(steps[2:]) <= 3
    assert np.median(steps[2:]) == 1


def test_a_motion_that_goes_on_is_followed_faster_than_one_that_turns_back(backend):
    """What extrapolating the last two optima is for: large ticks ahead, and as large ones back."""
    stream = Stream()
    servo = gf.Servo(stream.problem, gf.Settings(backend=backend))
    steps = {+0.05: 0, -0.05: 0}
    for t in np.arange(10) * 0.3:
        for change in steps:
            servo.reset()
            servo.step(**stream.fields(t))
            servo.step(**stream.fields(t + 0.05))
            steps[change] += servo.step(**stream.fields(t + 0.05 + change)).newton_steps
    assert steps[+0.05] < 0.9 * steps[-0.05]


def test_arguments_keep_their_values_until_they_change(exact):
    stream = Stream()
    servo = gf.Servo(stream.problem, exact)
    servo.step(**stream.fields(0.1))
    f = stream.fields(0.1)["f"] * 1.02
    solution = servo.step(f=f)
    assert solution.problem == stream.at(0.1).replace(f=f)
    assert_like_cold(solution, exact)
    assert servo.step().problem == solution.problem
    assert servo.problem == solution.problem


@pytest.mark.parametrize(
    "change",
    [
        {"alpha": 3.0},
        {"c_max": 30.0},
        {"engagement": 0.9},
        {"tau_lo": -9.0},
        {"tau_hi": 9.0},
        {"models": [gf.PCWF(0.9), gf.SFC(0.8, 0.01), gf.PCWF(0.9), gf.PCWF(0.9)]},
        {"models": [gf.PCWF(0.9), gf.SFC(0.8, 0.01), gf.PCWF(0.9), gf.PCWF(0.9)], "alpha": 1.0},
        {"f": [0.0] * 6},
    ],
    ids=str,
)
def test_every_argument_may_change_in_mid_stream(exact, change):
    stream = Stream()
    servo = gf.Servo(stream.problem, exact)
    for k in range(4):
        servo.step(**stream.fields(k * DT))
    solution = servo.step(**change)
    assert solution.problem == stream.at(3 * DT).replace(**change)
    assert_like_cold(solution, exact)
    if "models" in change:
        assert solution.problem.models == tuple(change["models"])
    # … and stays so in the ticks after it.
    later = servo.step(**({} if "f" in change else stream.fields(4 * DT)))
    assert later.problem.alpha == solution.problem.alpha
    assert later.problem.models == solution.problem.models
    assert_like_cold(later, exact)


def test_rows_and_floors_and_bias_may_change_too(rng, exact):
    problem = plant(
        rng, ["PCWF"] * 4, floors=True, inequalities=2, bias=True, ceilings=True
    ).problem
    servo = gf.Servo(problem, exact)
    servo.step()
    changes = {
        "A": problem.A * 0.9,
        "b": problem.b + 1,
        "c_min": problem.c_min / 2,
        "tau_bias": problem.tau_bias * 0.99,
    }
    for name, value in changes.items():
        problem = problem.replace(**{name: value})
        solution = servo.step(**{name: value})
        assert solution.problem == problem
        assert_like_cold(solution, exact)


@pytest.mark.parametrize("kind", [list, np.float32, np.asfortranarray, "strided", "int"])
def test_arrays_of_any_kind_are_taken(exact, kind):
    stream = Stream()
    fields = stream.fields(0.02)
    plain = gf.Servo(stream.problem, exact)
    other = gf.Servo(stream.problem, exact)
    if kind is list:
        odd = {name: value.tolist() for name, value in fields.items()}
    elif kind == "strided":
        odd = {name: np.repeat(value, 2, axis=-1)[..., ::2] for name, value in fields.items()}
    elif kind == "int":
        fields = {"f": np.array([1.0, 0, 2, 0, 0, 0])}
        odd = {"f": np.array([1, 0, 2, 0, 0, 0])}
    elif kind is np.float32:
        fields = {name: value.astype(np.float32).astype(float) for name, value in fields.items()}
        odd = {name: value.astype(np.float32) for name, value in fields.items()}
    else:
        odd = {name: kind(value) for name, value in fields.items()}
    assert other.step(**odd) == plain.step(**fields)


# ---- a refused step ----------------------------------------------------------------------------

NAN = float("nan")
REFUSED = [
    ({"f": np.zeros(5)}, "f"),
    ({"f": np.full(6, NAN)}, "f"),
    ({"f": [1, 2, 3, 4, 5, np.inf]}, "f"),
    ({"f": "down"}, "f"),
    ({"f": np.zeros((1, 6))}, "f"),
    ({"W": np.zeros((6, 12))}, "W"),
    ({"W": np.zeros((13, 6))}, "W"),
    ({"W": np.full((6, 13), NAN)}, "W"),
    ({"J": np.zeros((13, 2))}, "J|tau_lo|step"),
    ({"J": 1.0}, "J"),
    ({"tau_lo": 1e9}, "tau_lo"),
    ({"tau_hi": -1e9}, "tau_lo"),
    ({"tau_bias": NAN}, "tau_bias"),
    ({"c_max": -1.0}, "c_max"),
    ({"c_max": 0.0}, "c_max"),
    ({"c_max": [1.0, 2.0]}, "c_max"),
    ({"engagement": 1.5}, "engagement"),
    ({"engagement": -0.1}, "engagement"),
    ({"engagement": [1, 1, 1, NAN]}, "engagement"),
    ({"engagement": [1, 1, 1]}, "engagement"),
    ({"alpha": 0.0}, "alpha"),
    ({"alpha": -2}, "alpha"),
    ({"alpha": NAN}, "alpha"),
    ({"alpha": "5"}, "alpha"),
    ({"c_min": 0.1}, "c_min|step"),  # the layout has no floors
    ({"A": np.ones((1, 13)), "b": [9.0]}, "A|step"),  # nor inequalities
    ({"A": np.ones((1, 13))}, "b|A"),
    ({"models": gf.PCWF(0.5)}, "W|models|step"),
    ({"models": [gf.SFC(0.5, 0.01)] + [gf.PCWF(0.5)] * 3}, "W|models|step"),  # another order
    ({"models": []}, "models"),
    # Good values beside a bad one, before and after it in the list of arguments.
    ({"f": np.ones(6), "engagement": 2.0}, "engagement"),
    ({"W": np.ones((6, 13)), "f": np.full(6, NAN)}, "f"),
    ({"f": np.ones(6), "alpha": -1.0}, "alpha"),
    ({"f": np.ones(6), "models": [gf.PCWF(0.1)]}, "W|models|step"),
]


@pytest.mark.parametrize("before", [0, 1, 3])
@pytest.mark.parametrize(
    ("bad", "name"), REFUSED, ids=[f"{k}-{'-'.join(bad)}" for k, (bad, _) in enumerate(REFUSED)]
)
def test_a_refused_step_leaves_no_trace(default, before, bad, name):
    """The next ticks are those of a servo that never saw it, bit for bit."""
    stream = Stream()
    spoiled, clean = (gf.Servo(stream.problem, default) for _ in range(2))
    for k in range(before):
        assert spoiled.step(**stream.fields(k * DT)) == clean.step(**stream.fields(k * DT))
    was = spoiled.problem
    with pytest.raises(gf.InvalidInputError, match=rf"^({name})(\[.*\])?: (.*expected|given)"):
        spoiled.step(**bad)
    assert spoiled.problem == was
    for k in range(before, before + 3):
        got, wanted = (servo.step(**stream.fields(k * DT)) for servo in (spoiled, clean))
        assert got == wanted
        assert got.nu.tolist() == wanted.nu.tolist()
        assert got.newton_steps == wanted.newton_steps
    assert spoiled.problem == clean.problem


def test_unknown_and_positional_arguments_are_no_arguments(default):
    servo = gf.Servo(Stream().problem, default)
    with pytest.raises(gf.InvalidInputError, match=r"^force: not an option of Servo\.step"):
        servo.step(force=np.zeros(6))
    with pytest.raises(TypeError):
        servo.step(np.zeros(6))


def test_arrays_of_a_tick_are_its_own(default):
    """Neither the caller's arrays nor later ticks reach into a Solution that was given out."""
    stream = Stream()
    servo = gf.Servo(stream.problem, default)
    fields = stream.fields(0)
    first = servo.step(**fields)
    again = pickle.loads(pickle.dumps(first))
    for value in fields.values():
        value[:] = NAN
    second = servo.step(**stream.fields(DT))
    assert second.status is gf.Status.SOLVED
    assert first == again
    assert first.problem == stream.at(0)
    assert first.nu.tolist() == again.nu.tolist()
    assert np.array_equal(first.c, again.c)


def test_solutions_kept_from_many_ticks_stay_apart(backend, default):
    """Looked at late and in any order, each has its own problem and forces."""
    stream = Stream()
    servo = gf.Servo(stream.problem, default)
    count = TICKS[backend] // 4
    kept = [servo.step(**stream.fields(k * DT)) for k in range(count)]
    del servo
    for k in reversed(range(count)):
        assert kept[k].problem == stream.at(k * DT)
        assert kept[k].verify().ok


def test_a_spoilt_answer_does_not_spoil_the_servo(default):
    """A caller either may not write into c, or does it without consequence."""
    stream = Stream()
    spoiled, clean = (gf.Servo(stream.problem, default) for _ in range(2))
    solution = spoiled.step()
    clean.step()
    with contextlib.suppress(ValueError):  # read-only
        solution.c[:] = NAN
    assert spoiled.step(**stream.fields(DT)) == clean.step(**stream.fields(DT))


# ---- trouble in the stream ---------------------------------------------------------------------


@pytest.mark.parametrize("ticks", [1, 3])
def test_an_infeasible_tick_is_a_status_and_the_servo_recovers(exact, ticks):
    stream = Stream()
    servo = gf.Servo(stream.problem, exact)
    for k in range(4):
        assert servo.step(**stream.fields(k * DT)).status is gf.Status.SOLVED
    for k in range(4, 4 + ticks):
        fields = stream.fields(k * DT)
        solution = servo.step(**(fields | {"f": 50 * fields["f"]}))
        assert solution.status is gf.Status.INFEASIBLE
        assert gf.check_certificate(solution.problem, solution.certificate)
        assert np.isfinite(solution.c).all()
    for k in range(4 + ticks, 10 + ticks):
        solution = servo.step(**stream.fields(k * DT))
        assert solution.status is gf.Status.SOLVED
        assert_like_cold(solution, exact)


def test_an_unreachable_wrench_is_a_status_and_the_servo_recovers(rng, exact):
    ends = [gf.Contact((s, 0, 0), (-s, 0, 0), gf.PCWF(0.5)) for s in (-1.0, 1.0)]
    servo = gf.Servo(gf.Grasp(ends).problem([0, 0, 1.0, 0, 0, 0], c_max=9), exact)
    for force, status in [
        ([0, 0, 1.0, 0, 0, 0], gf.Status.SOLVED),
        ([0, 0, 1.0, 0.5, 0, 0], gf.Status.WRENCH_UNREACHABLE),
        ([0, 0, 1.01, 0, 0, 0], gf.Status.SOLVED),
    ]:
        solution = servo.step(f=force)
        assert solution.status is status
        assert_like_cold(solution, exact)


@pytest.mark.parametrize("jump", [0.5, 2.0])
def test_a_jump_of_everything_is_answered_like_any_other_tick(exact, jump):
    stream = Stream()
    servo = gf.Servo(stream.problem, exact)
    for t in (0, DT, 2 * DT, jump, jump + DT, 0):
        assert_like_cold(servo.step(**stream.fields(t)), exact)


def test_reset_forgets_the_past(exact):
    stream = Stream()
    servo, fresh = gf.Servo(stream.problem, exact), gf.Servo(stream.problem, exact)
    for k in range(5):
        servo.step(**stream.fields(k * DT))
    servo.reset()
    again, first = servo.step(**stream.fields(1.0)), fresh.step(**stream.fields(1.0))
    assert again == first
    assert again.newton_steps == first.newton_steps
    assert servo.step(**stream.fields(1 + DT)) == fresh.step(**stream.fields(1 + DT))


def test_reset_keeps_the_problem(exact):
    stream = Stream()
    servo = gf.Servo(stream.problem, exact)
    servo.step(**stream.fields(0.3))
    servo.reset()
    assert servo.problem == stream.at(0.3)
    assert servo.step().problem == stream.at(0.3)


def test_noise_on_the_wrench_does_not_disturb_the_answers(backend, default):
    stream = Stream()
    servo = gf.Servo(stream.problem, default)
    rng = np.random.default_rng(9)
    size = np.abs(stream.problem.f).max() * np.array([1, 1, 1, 0.03, 0.03, 0.03])
    for k in range(TICKS[backend] // 4):
        fields = stream.fields(k * DT)
        solution = servo.step(**(fields | {"f": fields["f"] + 0.02 * size * rng.normal(size=6)}))
        assert_like_cold(solution, gf.Settings(tol=1e-14, backend=backend), accuracy=1e-4)


def test_servos_do_not_share_anything(exact):
    """Interleaved ticks of two streams of one shape are those of each alone."""
    streams = [Stream(0), Stream(3)]
    alone = []
    for stream in streams:
        servo = gf.Servo(stream.problem, exact)
        alone.append([servo.step(**stream.fields(k * DT)) for k in range(5)])
    together = [gf.Servo(stream.problem, exact) for stream in streams]
    for k in range(5):
        for i, stream in enumerate(streams):
            gf.solve(
                streams[1 - i].problem, exact
            )  # the shared solver of solve() is none of theirs
            assert together[i].step(**stream.fields(k * DT)) == alone[i][k]


COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda servo: pickle.loads(pickle.dumps(servo)),
}


@pytest.mark.parametrize("duplicate", COPIES.values(), ids=COPIES)
@pytest.mark.parametrize("ticks", [0, 3])
def test_a_copy_shares_nothing_and_starts_cold(exact, duplicate, ticks):
    stream = Stream()
    servo = gf.Servo(stream.problem, exact)
    for k in range(ticks):
        servo.step(**stream.fields(k * DT))
    servo.alpha[...] = 3.0  # not solved yet
    twin = duplicate(servo)
    assert twin.settings == servo.settings
    assert twin.problem == servo.problem
    assert twin.alpha == 3.0
    with pytest.raises(gf.InvalidInputError, match="before the first tick"):
        _ = twin.solution
    # Each goes its own way …
    servo.f[:] *= 1.01
    twin.f[:] *= 0.99
    before = servo.f.copy(), servo.c.copy(), servo.problem
    first = twin.step(**stream.fields(0.5), alpha=2.0)
    assert first.start is gf.Start.COLD
    assert_like_cold(first, exact)
    for now, then in zip((servo.f, servo.c), before[:2], strict=True):
        assert np.array_equal(now, then)
    assert servo.problem == before[2]
    # … and neither outlives the other only.
    del servo
    gc.collect()
    assert_like_cold(twin.step(**stream.fields(0.5 + DT)), exact)


def test_a_copy_goes_on_after_the_last_answer_of_the_original(exact):
    """The original's next tick is warm, its copy's cold, their answers the same."""
    stream = Stream()
    servo = gf.Servo(stream.problem, exact)
    for k in range(3):
        servo.step(**stream.fields(k * DT))
    twin = copy.copy(servo)
    warm, cold = servo.step(**stream.fields(3 * DT)), twin.step(**stream.fields(3 * DT))
    assert warm.start is not gf.Start.COLD
    assert cold.start is gf.Start.COLD
    assert warm.problem == cold.problem
    assert warm.c == pytest.approx(cold.c, rel=1e-5)


def test_settings_and_repr(default):
    servo = gf.Servo(Stream().problem, default)
    assert servo.settings == default
    assert repr(servo) == f"Servo({servo.problem!r}, {default!r})"
    assert repr(servo).startswith("Servo(ForceProblem(3 PCWF + 1 SFC; 13 joints, ceilings;")


def test_servo_help_of_tick_shows_its_documentation():
    text = pydoc.plain(pydoc.render_doc(gf.Servo.tick))
    assert "Solve the next tick from the fields" in text
    assert "Returns:" in text
    assert "Raises:" in text
