"""The command, run as a user runs it: in a process of its own."""

from __future__ import annotations

import csv
import json
import math
import os
import pty
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from conftest import ALLEGRO
from models import paper_hand_urdf

import graspforce as gf
from graspforce import files
from graspforce.cli import main
from graspforce.scenarios.random import grasps

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
SEVERAL = EXAMPLES / "several_grasps.json"


def run(*arguments, cwd=None, **environment):
    """Run ``graspforce`` and return the finished process; nothing may ever be a traceback."""
    done = subprocess.run(
        [sys.executable, "-m", "graspforce", *map(str, arguments)],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        timeout=60,
    )
    done.stdout = done.stdout.decode(environment.get("PYTHONIOENCODING", "utf-8"))
    done.stderr = done.stderr.decode()
    assert "Traceback" not in done.stderr
    return done


def rows(table):
    """Return the cells of a printed table by the grasp's name."""
    cells = [re.split(r"\s{2,}", line.strip()) for line in table.splitlines()]
    return {each[1]: each[2:] for each in cells if len(each) == 7 and each[0].isdigit()}


def test_memory_that_was_freed_is_used_again():
    """Arrays of 40 MB in all, made and let go of: their pages come from the system once."""
    program = """
import resource, sys
import numpy as np
from graspforce.cli.process import keep_freed_memory
if sys.argv[1:]:
    keep_freed_memory()
for _ in range(20):
    parts = [np.ones(400_000) for _ in range(12)]
    del parts
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
"""
    plain, kept = (
        int(subprocess.check_output(
            [sys.executable, "-c", program, *arguments],
            env=os.environ | {"NUMPY_MADVISE_HUGEPAGE": "0"},
        ))
        for arguments in ([], ["keep"])
    )  # fmt: skip
    assert kept < plain / 4


# ---- help and version --------------------------------------------------------------------------


COMMANDS = (
    "solve", "batch", "explain", "hand", "scenario", "simulate", "view", "reproduce", "bench",
    "compare",
)  # fmt: skip


@pytest.mark.parametrize("command", [[], *([each] for each in COMMANDS)])
def test_cli_help_has_examples(command):
    done = run(*command, "--help")
    assert done.returncode == 0
    assert done.stderr == ""
    assert re.search(rf"Examples:\n +graspforce {' '.join(command) or 'solve'}\b", done.stdout)


def test_cli_help_names_every_command_scenario_and_scene():
    listed = re.findall(r"^  (\w+) {2,}", run("--help").stdout.partition("Commands:")[2], re.M)
    assert tuple(listed) == COMMANDS
    for command, names in (("scenario", gf.scenarios.NAMES), ("simulate", gf.sim.NAMES)):
        help_text = run(command, "--help").stdout
        assert all(name in help_text for name in names)


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Every command line that the help texts show, run as printed: the folder and the runs."""
    folder = tmp_path_factory.mktemp("examples")
    (folder / "examples").symlink_to(EXAMPLES)
    (folder / "results").mkdir()
    (folder / "light.csv").write_text("an --out is replaced")
    cone = files.read(EXAMPLES / "nose_cone.json")[0].problem
    np.savez(folder / "grasps.npz", W=[cone.W], f=[cone.f], mu=0.3, c_max=2.0)
    pages = [run(*command, "--help").stdout for command in ([], ["solve"], ["scenario"])]
    lines = set(re.findall(r"^ +graspforce (.*)$", "\n".join(pages), re.MULTILINE))
    with ThreadPoolExecutor(2) as pool:
        runs = pool.map(lambda line: run(*line.split(), cwd=folder), lines)
    return folder, dict(zip(lines, runs, strict=True))


def test_cli_examples_of_the_help_run_as_printed(examples):
    folder, runs = examples
    assert len(runs) >= 8
    assert {line: done.stderr for line, done in runs.items() if done.returncode != 0} == {}
    made = {str(path.relative_to(folder)) for path in folder.rglob("*.csv")}
    assert made == {"forces.csv", "dynamic.csv", "light.csv", "results/regrasp.csv"}


def test_cli_version():
    done = run("--version")
    assert (done.returncode, done.stdout) == (0, f"graspforce {gf.__version__}\n")


# ---- hand --------------------------------------------------------------------------------------

TWO_FINGERS = """<mujoco><worldbody><body name="palm"><geom type="box" size=".03 .03 .01"/>
  <body name="p1" pos=".03 0 .02"><joint name="a1" axis="0 1 0"/><geom size=".01"/>
    <body name="d1" pos="0 0 .04"><joint name="a2" axis="0 1 0"/><geom size=".01"/></body></body>
  <body name="p2" pos="-.03 0 .02"><joint name="b1" axis="0 1 0"/><geom size=".01"/>
    <body name="d2" pos="0 0 .04"><joint name="b2" axis="0 1 0"/><geom size=".01"/></body></body>
  </body></worldbody>
  <tendon><fixed name="cable"><joint joint="b1" coef=".01"/><joint joint="b2" coef=".008"/></fixed>
  </tendon><equality><joint joint1="a2" joint2="a1" polycoef="0 .7 0 0 0"/></equality>
  <actuator><motor joint="a1" ctrlrange="-.5 .5" forcerange="-1 1"/>
    <motor tendon="cable" ctrlrange="-20 0"/></actuator></mujoco>"""


def test_cli_hand_prints_what_is_understood_of_an_mjcf(tmp_path):
    pytest.importorskip("mujoco")
    path, picture = tmp_path / "hand.xml", tmp_path / "hand.png"
    path.write_text(TWO_FINGERS)
    done = run("hand", path, "--out", picture)
    assert (done.returncode, done.stderr) == (0, "")
    cells = [re.split(r"\s{2,}", line.strip()) for line in done.stdout.splitlines()]
    assert ["d1", "d1", "a1"] in cells
    assert ["d2", "d2", "cable"] in cells
    assert ["a1", "-0.5", "0.5", "N·m", "forcerange, ctrlrange"] in cells
    assert ["cable", "-20", "0", "N", "ctrlrange"] in cells
    for line in ("no motor controls 1 of 2 motions of 'b1', 'b2'", "'a1' also moves 'a2' by 0.7"):
        assert len([each for each in done.stdout.splitlines() if each.startswith(line)]) == 1
    assert "2 fingers, 2 motors; q holds 3 angles: a1, b1, b2" in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert run("hand", path, "--out", tmp_path / "hand.gif").returncode == 2
    tips = run("hand", path, "--tip", "d1", "--tau-max", "0.2").stdout
    assert "1 fingers, 1 motors" in tips
    assert "--tau-max" in tips


def test_cli_hand_reads_a_urdf_whatever_its_name(tmp_path):
    pytest.importorskip("pinocchio")
    path = tmp_path / "robot.xml"
    path.write_text(paper_hand_urdf("radial"))
    done = run("hand", path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "4 fingers, 12 motors" in done.stdout
    assert re.search(r"finger4_knee +-0.5 +0.5 +N·m +effort", done.stdout)
    assert "Nothing to remark" in done.stdout


def test_cli_hand_refuses_in_one_line(tmp_path):
    pytest.importorskip("mujoco")
    still = tmp_path / "still.xml"
    still.write_text('<mujoco><worldbody><body><geom size=".1"/></body></worldbody></mujoco>')
    for path, text in ((still, "nothing in it is moved by a motor"), ("none.xml", "no such file")):
        done = run("hand", path)
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert text in done.stderr


# ---- solve -------------------------------------------------------------------------------------


def test_cli_solve_prints_what_the_library_finds():
    done = run("solve", SEVERAL)
    assert done.returncode == 0
    assert done.stderr == ""
    printed = rows(done.stdout)
    grasps = files.read(SEVERAL)
    assert list(printed) == [name for name, _ in grasps]
    for name, problem in grasps:
        solution = gf.solve(problem)
        status, normal, slip, torque, steps = printed[name]
        assert status == solution.status.name.lower()
        assert int(steps) == solution.newton_steps
        assert torque == "–"
        if solution.status is gf.Status.SOLVED:
            assert float(normal) == pytest.approx(solution.normal_forces.max(), rel=1e-3)
            assert float(slip) == pytest.approx(solution.friction_margins.min(), rel=1e-3)
        else:
            assert (normal, slip) == ("–", "–")
            assert f"{name}: {solution.message}" in done.stdout
    assert "\n5 grasps: 3 solved, 2 infeasible\n" in done.stdout


def test_cli_solve_shows_the_torque_margin():
    done = run("solve", EXAMPLES / "paper_grasp.json")
    solution = gf.solve(files.read(EXAMPLES / "paper_grasp.json")[0].problem)
    margin = float(rows(done.stdout)["paper, static"][3])
    assert margin == pytest.approx(solution.torque_residual, rel=1e-3)
    assert "1 grasp: 1 solved\n" in done.stdout


@pytest.mark.parametrize("ending", ["json", "csv", "npz"])
def test_cli_solve_writes_everything(tmp_path, ending):
    out = tmp_path / f"out.{ending}"
    out.write_text("old")
    done = run("solve", SEVERAL, "--out", out)
    assert done.returncode == 0
    assert str(out) in done.stdout
    expected = tmp_path / f"expected.{ending}"
    names, problems = zip(*files.read(SEVERAL), strict=True)
    files.write(expected, list(zip(names, gf.solve_many(problems), strict=True)))
    if ending == "npz":
        with np.load(out) as a, np.load(expected) as b:
            assert set(a) == set(b)
            assert all(np.array_equal(a[key], b[key], equal_nan=a[key].dtype == float) for key in a)
    else:
        assert out.read_bytes() == expected.read_bytes()


def test_cli_options_override_every_grasp(tmp_path):
    out = tmp_path / "out.json"
    done = run("solve", SEVERAL, "--alpha", 30, "--c-max", 50, "--tol", 1e-12, "--out", out)
    assert done.returncode == 0
    for got, (name, problem) in zip(
        json.loads(out.read_text(encoding="utf-8"))["results"], files.read(SEVERAL), strict=True
    ):
        (solution,) = gf.solve_many([problem.replace(alpha=30, c_max=50)], gf.Settings(tol=1e-12))
        assert (got["name"], got["alpha"], got["c"]) == (name, 30, solution.c.tolist())


def test_cli_unbounded_grasp_shows_as_such(tmp_path):
    document = json.loads((EXAMPLES / "nose_cone.json").read_text(encoding="utf-8"))
    del document["c_max"]
    (tmp_path / "free.json").write_text(json.dumps(document), encoding="utf-8")
    done = run("solve", tmp_path / "free.json")
    assert done.returncode == 0
    assert rows(done.stdout)["nose cone, mu 0.3"][0] == "unbounded"
    assert "nothing limits the grip" in done.stdout
    assert "1 grasp: 1 unbounded\n" in done.stdout


def test_cli_names_come_through_a_pipe_whole(tmp_path):
    document = json.loads((EXAMPLES / "nose_cone.json").read_text(encoding="utf-8"))
    name = "a [bold]name[/bold] " + "that goes on and on " * 20 + "to here"
    tricky = "\x1b[2Jcleared\nscreen"
    grasps = [document | {"name": each} for each in (name, tricky)]
    (tmp_path / "long.json").write_text(json.dumps({"grasps": grasps}), encoding="utf-8")
    done = run("solve", tmp_path / "long.json", COLUMNS="40")
    assert name in done.stdout
    assert "…" not in done.stdout
    assert "\x1b" not in done.stdout
    assert "�[2Jcleared�screen" in done.stdout


def test_cli_many_failures_do_not_flood(tmp_path):
    slippery = json.loads(SEVERAL.read_text(encoding="utf-8"))["grasps"][1]
    (tmp_path / "many.json").write_text(json.dumps({"grasps": [slippery] * 30}), encoding="utf-8")
    done = run("solve", tmp_path / "many.json")
    assert done.stdout.count("no contact force gives") == 5
    assert "… and 25 more without an answer\n" in done.stdout
    assert "30 grasps: 30 infeasible\n" in done.stdout


def test_cli_a_poor_encoding_costs_no_output(tmp_path):
    document = json.loads((EXAMPLES / "nose_cone.json").read_text(encoding="utf-8"))
    path = tmp_path / "greek.json"
    path.write_text(json.dumps(document | {"name": "λάμδα"}), encoding="utf-8")
    done = run("solve", path, PYTHONIOENCODING="ascii")
    assert done.returncode == 0
    assert "1 grasp: 1 solved" in done.stdout


def test_cli_narrow_terminal_loses_nothing():
    """On a terminal the table fits its width: cells fold, and none ends in an ellipsis."""
    reader, terminal = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "graspforce", "solve", str(SEVERAL)],
        stdout=terminal,
        stderr=subprocess.PIPE,
        env=os.environ | {"COLUMNS": "60", "TERM": "xterm"},
    ) as process:
        os.close(terminal)
        shown = b""
        while True:
            try:
                piece = os.read(reader, 65536)
            except OSError:  # Linux: the other side is closed
                break
            if not piece:
                break
            shown += piece
        assert process.wait(timeout=60) == 0
    os.close(reader)
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode()).replace("\r", "")
    table = text[: text.index("can, 35 N: ")]
    assert max(map(len, table.splitlines())) <= 60
    assert "…" not in table
    for status, _, _, _, steps in rows(run("solve", SEVERAL).stdout).values():
        assert status in table
        assert steps in table


def test_cli_a_closed_pipe_is_no_error():
    with subprocess.Popen(
        [sys.executable, "-m", "graspforce", "solve", str(SEVERAL)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""


def test_cli_allegro_grasps():
    for alpha in ("1", "5"):
        done = run("solve", ALLEGRO, "--alpha", alpha)
        assert done.returncode == 0
        assert "12 grasps: 10 solved, 2 infeasible\n" in done.stdout
        assert "002_master_chef_can" in done.stdout
        assert re.search(r"were not read: .*ref_status", done.stdout)


# ---- what is wrong -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["solve", "none.json"], "none.json: cannot read the file: No such file or directory"),
        (["solve", "bad.json"], "bad.json: line 1, column 7: not JSON: Expecting value"),
        (["solve", "bad.npz"], "bad.npz: not an NPZ archive: empty, cut short, or of another kind"),
        (["solve", "grasps.yaml"], "grasps.yaml: got a file name ending in '.yaml', expected one"),
        (["solve", "key.json"], 'key.json: $: unknown key "nme"; expected one of $schema, '),
        (["solve", "cone.json", "--alpha", "0"], "--alpha: got 0.0, expected more than 0"),
        (["solve", "cone.json", "--alpha", "nan"], "--alpha: got nan, expected finite numbers"),
        (["solve", "cone.json", "--c-max", "-1"], "--c-max: got -1.0, expected more than 0"),
        (["solve", "cone.json", "--tol", "0"], "tol: got 0.0, expected more than 0"),
        (["solve", "floor.json", "--c-max", "1"], "floor.json: grasp 0 'floor': c_min[0]: got 1"),
        (["solve", "cone.json", "--out", "x.txt"], "x.txt: got a file name ending in '.txt'"),
        (["solve", "cone.json", "--out", "no/x.csv"], "no/x.csv: the directory no does not exist"),
        (["solve", "cone.json", "--out", "./cone.json"], "--out: got cone.json, the file of gr"),
        (["scenario", "dynamc"], "name: got 'dynamc', expected one of static, dynamic, regrasp"),
        (["scenario", "static", "--alpha", "-1"], "alpha: got -1.0, expected more than 0"),
        (["scenario", "static", "--out", "x.json"], "x.json: got a file name ending in '.json'"),
    ],
)
def test_cli_what_is_wrong_is_one_line(tmp_path, arguments, message, monkeypatch, capsys):
    """In this process, to be quick; the next test sees that a process of its own is the same."""
    cone = json.loads((EXAMPLES / "nose_cone.json").read_text(encoding="utf-8"))
    floor = cone | {"name": "floor", "c_min": 1.5}
    (tmp_path / "cone.json").write_text(json.dumps(cone), encoding="utf-8")
    (tmp_path / "floor.json").write_text(json.dumps(floor), encoding="utf-8")
    (tmp_path / "key.json").write_text('{"nme": 1}', encoding="utf-8")
    (tmp_path / "bad.json").write_text('{"f": ', encoding="utf-8")
    (tmp_path / "bad.npz").write_bytes(b"")
    before = sorted(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["graspforce", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert printed.err.startswith(f"graspforce: {message}")
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert sorted(tmp_path.iterdir()) == before


def test_cli_a_failed_write_still_shows_the_table(tmp_path, monkeypatch, capsys):
    def full(*_):
        raise OSError(28, "No space left on device")

    out = tmp_path / "out.csv"
    monkeypatch.setattr("os.replace", full)
    monkeypatch.setattr(sys, "argv", ["graspforce", "solve", str(SEVERAL), "--out", str(out)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert printed.err == f"graspforce: {out}: cannot write it: No space left on device\n"
    assert "5 grasps: 3 solved, 2 infeasible" in printed.out
    assert "Everything about them" not in printed.out


def test_cli_what_is_wrong_is_one_line_in_a_process(tmp_path):
    done = run("solve", tmp_path / "none.json")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"graspforce: {tmp_path / 'none.json'}: cannot read the file: No such file or directory\n"
    )


@pytest.mark.parametrize(
    "arguments",
    [["slove"], ["solve"], ["solve", "x.json", "--alhpa", "1"], ["solve", "x.json", "--tol", "x"]],
)
def test_cli_wrong_usage(arguments):
    done = run(*arguments)
    assert done.returncode == 2
    assert "Error: " in done.stderr
    assert done.stdout == ""


def test_cli_nothing_to_do_shows_the_help():
    done = run()
    assert done.returncode == 2
    assert "scenario" in done.stdout + done.stderr


# ---- scenario ----------------------------------------------------------------------------------


def test_cli_scenario_writes_every_tick(examples, tmp_path):
    folder, runs = examples
    done = runs["scenario static --alpha 100 --out light.csv"]
    assert done.stderr == ""
    log = gf.scenarios.run(gf.scenarios.get("static", alpha=100.0))
    log.write_csv(tmp_path / "expected.csv")
    assert (folder / "light.csv").read_bytes() == (tmp_path / "expected.csv").read_bytes()
    with (folder / "light.csv").open(encoding="utf-8", newline="") as file:
        assert len(list(csv.reader(file))) == 1 + len(log.t)
    assert "500 ticks: 500 solved; " in done.stdout
    normal = re.search(r"normal force \[N\] +(\S+) +(\S+)", done.stdout)
    assert normal is not None
    assert float(normal[1]) == pytest.approx(log.normal_forces.min(), rel=1e-3)
    assert float(normal[2]) == pytest.approx(log.normal_forces.max(), rel=1e-3)
    assert "Every tick is in dynamic.csv\n" in runs["scenario dynamic"].stdout


def test_cli_scenario_does_not_replace_what_nobody_named(tmp_path):
    (tmp_path / "static.csv").write_text("precious")
    done = run("scenario", "static", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "graspforce: static.csv: exists already; name it with --out to replace it\n"
    )
    assert (tmp_path / "static.csv").read_text() == "precious"


@pytest.mark.parametrize("options", [(), ("--rows",)])
def test_cli_of_many_grasps_shows_a_summary_unless_asked_for_rows(tmp_path, options):
    problems = grasps(60)
    f = np.array([problem.f for problem in problems])
    f[7] *= 1e4
    path = tmp_path / "many.npz"
    np.savez(
        path, f=f, tau_limit=0.5,
        **{name: np.array([getattr(each, name) for each in problems]) for name in ("W", "J", "mu")},
    )  # fmt: skip
    done = run("solve", path, *options)
    assert done.returncode == 0
    assert "60 grasps: " in done.stdout
    assert ("many[59]" in done.stdout) or not options
    assert ("median" in done.stdout) is not bool(options)
    assert len(done.stdout.splitlines()) < 45 or options


def test_cli_quantiles_of_margins_that_are_infinite(tmp_path):
    """A third of the grasps have no joints: their torque margins are larger than all others."""
    each = [
        {"W": p.W.tolist(), "f": p.f.tolist(), "c_max": 50,
         "models": [{"model": "PCWF", "mu": model.mu} for model in p.models]}
        | ({} if i % 3 == 0 else {"J": p.J.tolist(), "tau_lo": -9 - i, "tau_hi": 9 + i})
        for i, p in enumerate(grasps(90))
    ]  # fmt: skip
    (tmp_path / "many.json").write_text(json.dumps({"grasps": each}))
    done = run("solve", tmp_path / "many.json", "--out", tmp_path / "out.npz")
    assert done.stderr == ""
    with np.load(tmp_path / "out.npz") as out:
        margins = sorted(out["torque_residual"][out["status"] == "SOLVED"].tolist())
    assert len(margins) > 60
    shown = {}
    for line in done.stdout.splitlines():
        cells = re.split(r"\s{2,}", line.strip())
        if cells[0] in ("least", "1 %", "median", "99 %", "most"):
            shown[cells[0]] = cells[3]
    assert math.isfinite(margins[len(margins) // 2])
    assert shown["99 %"] == shown["most"] == "–"
    for name, percent in (("least", 0), ("1 %", 1), ("median", 50)):
        place = max(math.ceil(percent * len(margins) / 100) - 1, 0)
        assert float(shown[name]) == pytest.approx(margins[place], rel=1e-3)
