"""What a simulation leaves behind, and what is said when something is wrong."""

import csv
import dataclasses
import importlib.metadata
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import rich.console
from pages import DOCS, run
from typer.testing import CliRunner

import graspforce as gf
from graspforce import cli, sim
from graspforce._util import atomic
from graspforce.cli import simulate as simulate_command
from graspforce.cli import terminal
from graspforce.sim import allegro_hand, render
from graspforce.sim.controller import swing_point
from graspforce.sim.scenes.bulb import bulb


@pytest.fixture(scope="module")
def short():
    (trial,) = sim.get("hold", duration=0.1)
    return trial, sim.run(trial)


@pytest.fixture(scope="module")
def opengl(short):
    try:
        render.Camera(*short).close()
    except sim.RenderError as error:
        pytest.skip(str(error))


# ---- logs --------------------------------------------------------------------------------------


def test_sim_npz_has_every_array(short, tmp_path):
    _, log = short
    log.save(tmp_path / "log.npz")
    with np.load(tmp_path / "log.npz") as data:
        assert data["ending"] == "COMPLETED"
        for field in dataclasses.fields(log):
            if field.name not in ("ending", "message"):
                np.testing.assert_array_equal(data[field.name], getattr(log, field.name))


def test_sim_csv_and_parquet_have_the_same_columns(short, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    _, log = short
    log.save(tmp_path / "log.csv")
    log.save(tmp_path / "log.parquet")
    table = parquet.read_table(tmp_path / "log.parquet")
    assert table.schema.metadata[b"ending"] == b"COMPLETED"
    with (tmp_path / "log.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == table.column_names
    assert {"t", "tau_12", "force_4_z", "slip_1", "position_x", "newton_steps"} <= set(header)
    values = np.array(rows, dtype=float)
    for name, column in zip(header, values.T, strict=True):
        np.testing.assert_array_equal(column, table[name].to_numpy())
    np.testing.assert_array_equal(table["force_2_z"], log.force[:, 1, 2])


def test_sim_an_ending_in_capitals_is_the_same_format(short, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    _, log = short
    log.save(tmp_path / "log.NPZ")
    with np.load(tmp_path / "log.NPZ") as data:
        np.testing.assert_array_equal(data["t"], log.t)
    log.save(tmp_path / "log.Parquet")
    assert parquet.read_table(tmp_path / "log.Parquet").num_rows == len(log.t)


@pytest.mark.parametrize("ending", [".npz", ".parquet", ".csv"])
def test_sim_a_log_goes_into_a_pipe(short, tmp_path, ending, monkeypatch):
    pytest.importorskip("pyarrow")
    monkeypatch.setattr(atomic, "READER_TIMEOUT", 600)  # for cat to be started
    _, log = short
    fifo = tmp_path / f"fifo{ending}"
    os.mkfifo(fifo)
    with subprocess.Popen(["cat", fifo], stdout=subprocess.PIPE) as reader:
        log.save(fifo)
        came = reader.stdout.read()
    log.save(tmp_path / f"file{ending}")
    assert len(came) == (tmp_path / f"file{ending}").stat().st_size
    assert fifo.is_fifo()


def test_sim_a_log_goes_only_where_it_can(short, tmp_path):
    _, log = short
    with pytest.raises(gf.InvalidInputError, match=r"\.npz or \.parquet or \.csv"):
        log.save(tmp_path / "log.txt")
    with pytest.raises(gf.InvalidInputError):
        log.save(tmp_path / "not there" / "log.csv")


# ---- endings -----------------------------------------------------------------------------------


def pushed(newtons):
    (trial,) = sim.get("hold", duration=0.3)
    push = sim.Push((newtons, 0.0, 0.0), start=0.05, duration=0.1)
    return sim.run(dataclasses.replace(trial, disturbance=sim.Disturbance(pushes=(push,))))


def test_sim_a_diverging_simulation_stops_with_tick_and_cause(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = pushed(1e13)
    assert log.ending is sim.Ending.DIVERGED
    assert log.message == "at tick 25 (0.050 s) an acceleration is not finite or beyond 1e10"
    assert len(log.t) == len(log.tau) == 26
    assert np.isfinite(log.position).all()
    assert np.isfinite(log.tau).all()
    assert list(tmp_path.iterdir()) == []  # MuJoCo's own log file


def test_sim_a_dropped_object_ends_it():
    log = pushed(40.0)
    assert log.ending is sim.Ending.DROPPED
    assert not log.held
    assert 40 < len(log.t) < 100
    assert f"at tick {len(log.t) - 1} (" in log.message
    assert "mm off its target" in log.message


def test_sim_an_object_that_is_spun_round_is_lost_too():
    (trial,) = sim.get("hold", duration=0.1)
    start = trial.start.copy()
    start[15:19] = 0, 0, 0, 1  # half a turn about z, which leaves the sides where they were
    log = sim.run(dataclasses.replace(trial, start=start))
    assert log.ending is sim.Ending.DROPPED
    assert log.message.startswith("at tick 0 (0.000 s) the object was turned 174° off its target")


# ---- pictures ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("opengl")
def test_sim_a_still_shows_cones_and_forces(short, tmp_path):
    imageio = pytest.importorskip("imageio.v3")
    trial, log = short
    sim.save_still(trial, log, tmp_path / "still.png", 0.08)
    image = imageio.imread(tmp_path / "still.png").astype(int)
    assert image.shape == (960, 1280, 3)
    bare = dataclasses.replace(log, engagement=np.zeros_like(log.engagement))
    sim.save_still(trial, bare, tmp_path / "bare.png", 0.08)
    drawn = np.abs(image - imageio.imread(tmp_path / "bare.png")).sum(axis=2) > 20
    assert 2000 < drawn.sum() < 100_000
    with pytest.raises(gf.InvalidInputError, match=r"t: got 2\.0 s, expected 0 to 0\.098 s"):
        sim.save_still(trial, log, tmp_path / "late.png", 2.0)


@pytest.mark.usefixtures("opengl")
def test_sim_a_film_has_a_frame_every_fortieth_of_a_second(short, tmp_path):
    imageio = pytest.importorskip("imageio.v3")
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    told = []
    sim.save_video(*short, tmp_path / "film.gif", lambda *done: told.append(done))
    assert told == [(1, 3), (2, 3), (3, 3)]
    frames = imageio.imread(tmp_path / "film.gif", index=...)
    assert frames.shape[-3:-1] == (480, 640)
    assert frames.std() > 5
    sim.save_video(*short, tmp_path / "film.mp4")
    count, seconds = ffmpeg.count_frames_and_secs(tmp_path / "film.mp4")
    assert (count, seconds) == (3, pytest.approx(0.12))


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("name", ["film.mp4", "film.gif", "FILM.GIF", "100%d:b.mp4"])
def test_sim_a_film_replaces_a_file_as_a_whole_or_not_at_all(short, tmp_path, name):
    path = tmp_path / name
    path.write_text("old")
    path.chmod(0o600)

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sim.save_video(*short, path, stop)
    assert path.read_text() == "old"
    sim.save_video(*short, path)
    assert (b"ftyp" if path.suffix == ".mp4" else b"GIF8") in path.read_bytes()[:8]
    assert path.stat().st_mode & 0o777 == 0o600
    assert [each.name for each in tmp_path.iterdir()] == [name]


def test_sim_ffmpeg_that_fails_is_an_error_in_its_words(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    frame = np.zeros((480, 640, 3), np.uint8)
    for frames in (1, 100):  # it ends before the last of many
        with pytest.raises(OSError, match=r"ffmpeg failed: Error opening output .*: No such file"):
            render._write_mp4(tmp_path / "no" / "film.mp4", iter([frame] * frames))


def test_sim_no_opengl_says_what_to_set_and_to_install(short, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    with pytest.raises(sim.RenderError, match=r"MUJOCO_GL=egl.*libegl1.*MUJOCO_GL=osmesa"):
        render.Camera(*short)


# MuJoCo looks for OpenGL's library as it is imported, and what it raises is no ImportError.
NO_OPENGL = """
import ctypes, ctypes.util, sys
find, load = ctypes.util.find_library, ctypes.CDLL.__init__

def find_library(name):
    return None if "GL" in name or name == "OSMesa" else find(name)

def init(self, name, *more, **options):
    if "GL" in str(name) or "OSMesa" in str(name):
        raise OSError(f"{name}: no such file")
    load(self, name, *more, **options)

ctypes.util.find_library, ctypes.CDLL.__init__ = find_library, init
from graspforce import cli
sys.argv = ["graspforce", "simulate", "hold", "--set", "duration=.02", *sys.argv[1:]]
cli.main()
"""


@pytest.mark.parametrize("setting", ["egl", "nonsense"])
def test_sim_a_setting_that_mujoco_cannot_follow_is_named_in_one_line(setting):
    run = without_opengl(setting)
    assert run.returncode == 2
    assert f"MUJOCO_GL={setting} gives no OpenGL context" in run.stderr
    assert "install libegl1" in run.stderr
    assert "MUJOCO_GL=disable" in run.stderr
    assert run.stderr.count("\n") == 1


@pytest.mark.parametrize("setting", ["", "disable"])
def test_sim_without_opengl_all_but_the_film_is_there(setting, tmp_path):
    run = without_opengl(setting, "--log", tmp_path / "log.csv", "--video", tmp_path / "film.mp4")
    assert run.returncode == 2
    assert "held" in run.stdout
    assert "log.csv" in run.stdout
    assert "MUJOCO_GL=" in run.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]
    assert without_opengl(setting).returncode == 0


def without_opengl(setting, *arguments):
    return subprocess.run(
        [sys.executable, "-W", "ignore", "-c", NO_OPENGL, *map(str, arguments)],
        capture_output=True, encoding="utf-8", env={**os.environ, "MUJOCO_GL": setting},
    )  # fmt: skip


# ---- missing extras ----------------------------------------------------------------------------


def test_sim_without_mujoco_the_pip_line_is_named():
    code = "import sys; sys.modules['mujoco'] = None; import graspforce; graspforce.sim"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8")
    assert re.search(r"pip install .*'mujoco[<>=]", run.stderr.splitlines()[-1])


@pytest.mark.parametrize(
    ("module", "package", "act"),
    [
        ("pyarrow", "pyarrow", lambda trial, log, to: log.save(to / "log.parquet")),
        ("imageio.v3", "imageio", lambda trial, log, to: sim.save_video(trial, log, to / "x.gif")),
        (
            "imageio_ffmpeg",
            "imageio-ffmpeg",
            lambda trial, log, to: sim.save_video(trial, log, to / "x.mp4"),
        ),
        (
            "clarabel",
            "clarabel",
            lambda trial, log, to: sim.run(dataclasses.replace(trial, method="minimum_norm")),
        ),
    ],
)
def test_sim_a_missing_package_is_named(short, tmp_path, monkeypatch, module, package, act):
    monkeypatch.setitem(sys.modules, module, None)
    brought_by = package.removesuffix("-ffmpeg")
    with pytest.raises(
        gf.MissingExtraError, match=rf"needs {package}, .*pip install .*'{brought_by}[\[<>=]"
    ):
        act(*short, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_sim_without_the_allegro_package_the_pip_line_is_named(monkeypatch):
    def missing(name):
        raise importlib.metadata.PackageNotFoundError(name)

    allegro_hand._path.cache_clear()
    monkeypatch.setattr(importlib.metadata, "files", missing)
    with pytest.raises(gf.MissingExtraError, match=r"pip install .*'example-robot-data[<>=]"):
        sim.get("allegro")
    monkeypatch.setattr(importlib.metadata, "files", lambda name: [])
    with pytest.raises(gf.ModelImportError, match=r"allegro_right_hand\.urdf"):
        sim.get("allegro")


# ---- wrong input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("nothing", {}, "name: got 'nothing', expected one of hold, circle"),
        ("hold", {"speed": 1.0}, "speed: not an option of scene 'hold'; expected one of alpha"),
        ("hold", {"alpha": "firm"}, "alpha: got 'firm', expected such as 5.0"),
        ("hold", {"alpha": -1.0}, "alpha: got -1.0"),
        ("hold", {"rate": 300.0}, "rate: got 300 Hz, expected 1000 Hz"),
        ("hold", {"duration": 1e-4}, "at least one tick"),
        ("allegro", {"shape": "cone"}, "shape: got 'cone', expected all, sphere, box, cylinder"),
        ("disturbance", {"kind": "rain"}, "kind: got 'rain', expected all, none, push"),
    ],
)
def test_sim_wrong_options_are_refused(name, options, message):
    with pytest.raises(gf.InvalidInputError, match=message):
        sim.get(name, **options)


def test_sim_a_log_that_no_memory_holds_is_refused():
    (endless,) = sim.get("hold", duration=1e13)
    with pytest.raises(gf.InvalidInputError, match=r"duration: got .* ticks, .* fit into memory"):
        sim.run(endless)


def test_sim_a_trial_that_does_not_fit_together_is_refused(short):
    trial, _ = short
    with pytest.raises(gf.InvalidInputError, match="grips: got 3, expected 4"):
        dataclasses.replace(trial, grips=trial.grips[:3])
    (regrasp,) = sim.get("regrasp")
    with pytest.raises(gf.InvalidInputError, match="c_max: missing"):
        dataclasses.replace(regrasp, c_max=None)
    with pytest.raises(gf.ModelImportError, match="body 'cup': not in the model"):
        sim.run(dataclasses.replace(trial, body="cup"))
    with pytest.raises(gf.InvalidInputError, match="payload"):
        sim.Disturbance(payload=0.0)
    with pytest.raises(gf.InvalidInputError, match="delay"):
        sim.Disturbance(delay=-1)


# ---- the command -------------------------------------------------------------------------------


def simulate(*arguments):
    return CliRunner().invoke(cli.app, ["simulate", *map(str, arguments)])


def test_simulate_prints_a_table_and_writes_the_log(tmp_path):
    out = simulate("hold", "--set", "duration=0.1", "--set", "alpha=1", "--log", tmp_path / "l.npz")
    assert out.exit_code == 0, out.output
    assert "the paper's cube held at rest" in out.output
    assert "held" in out.output
    with np.load(tmp_path / "l.npz") as data:
        assert len(data["t"]) == 50


def test_sim_a_narrow_terminal_loses_no_heading(short, capsys, monkeypatch):
    trial, log = short
    console = rich.console.Console(width=80, highlight=False)
    monkeypatch.setattr(terminal, "stdout_console", lambda: console)
    long = dataclasses.replace(trial, name="cylinder, little finger down")
    slid = dataclasses.replace(log, slip=np.full_like(log.slip, 2e-3))
    monkeypatch.setattr(sim, "get", lambda *_, **__: (long,))
    monkeypatch.setattr(sim, "run", lambda *_: slid)
    simulate_command.simulate("hold")
    printed = capsys.readouterr().out
    assert "…" not in printed
    for words in ("position", "rotation", "regrasps", "held, but slipped", "2.000"):
        assert words in printed


@pytest.mark.usefixtures("opengl")
def test_simulate_makes_a_film(tmp_path):
    out = simulate("hold", "--set", "duration=0.1", "--video", tmp_path / "film.gif")
    assert out.exit_code == 0, out.output
    assert (tmp_path / "film.gif").read_bytes().startswith(b"GIF8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["tea"], "name: got 'tea'"),
        (["hold", "--set", "alpha"], "--set: got 'alpha', expected KEY=VALUE"),
        (["hold", "--set", "alpha=firm"], "alpha: got 'firm'"),
        (["hold", "--video", "film.avi"], "film.avi"),
        (["hold", "--log", "log.txt"], "log.txt"),
        (["disturbance", "--video", "film.gif"], "36 trials, expected one; choose it with --set"),
    ],
)
def test_simulate_says_in_one_line_what_is_wrong(arguments, message):
    out = simulate(*arguments)
    assert out.exit_code == 2
    assert message in out.stderr
    assert out.stderr.count("\n") == 1


# ---- the parts ---------------------------------------------------------------------------------


def test_sim_a_swing_starts_and_ends_on_the_surface_and_rises_between():
    swing = bulb().steps[5]
    radius = 0.004
    for t, grip in ((swing.release.leave, swing.start), (swing.release.back, swing.end)):
        gap = grip.point - (radius - 5e-4) * grip.normal - swing_point(swing, t, radius)
        assert np.abs(gap).max() < 1e-12
    times = np.linspace(swing.release.leave, swing.release.back, 101)
    heights = [np.linalg.norm(swing_point(swing, t, radius)) - 0.03 - radius for t in times]
    assert max(heights) > 5e-3
    assert min(heights) > -6e-4


def test_sim_step_is_an_alias_of_finger_swing_that_warns():
    with pytest.warns(DeprecationWarning, match="sim.Step is now graspforce.sim.FingerSwing"):
        step = sim.Step
    assert step is sim.FingerSwing
    with pytest.raises(AttributeError, match="has no attribute 'other'"):
        sim.other  # noqa: B018


@pytest.mark.parametrize(
    ("given", "name", "value"),
    [
        ("alpha=5", "alpha", 5),
        ("alpha=.5", "alpha", 0.5),
        ("feed_forward=false", "feed_forward", False),
        ("shape=box", "shape", "box"),
        ("a=b=c", "a", "b=c"),
    ],
)
def test_simulate_takes_settings_as_numbers_where_they_can_be(monkeypatch, given, name, value):
    taken = {}

    def get(_, **options):
        taken.update(options)
        raise gf.InvalidInputError("no scene")

    monkeypatch.setattr(sim, "get", get)
    assert simulate("hold", "--set", given).exit_code == 2
    assert taken == {name: value}
    assert type(taken[name]) is type(value)


def test_sim_the_snippet_of_the_docs_runs(tmp_path, monkeypatch, capsys, opengl):
    monkeypatch.chdir(tmp_path)
    run(DOCS / "simulation.md")
    assert capsys.readouterr().out.startswith("held ")
    assert {path.name for path in tmp_path.iterdir()} == {"regrasp.npz", "regrasp.png"}
