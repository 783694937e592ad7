"""What reaches the terminal: the whole of the output, and nothing that steers it."""

from __future__ import annotations

import fcntl
import json
import os
import re
import struct
import subprocess
import sys
import termios
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import graspforce as gf
from graspforce import cli, errors, files
from graspforce.cli import terminal
from graspforce.study import compare
from graspforce.study.compare import output

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
SEVERAL = EXAMPLES / "several_grasps.json"
SMALL = {
    "name": "a",
    "W": np.eye(3).tolist(),
    "f": [1, 0, 0],
    "models": [{"model": "PCWF", "mu": 0.5}],
    "c_max": [20],
}
COMMAND = [sys.executable, "-m", "graspforce"]


def in_terminal(*arguments, columns=80, cwd=None):
    """Run ``graspforce`` in a terminal; returns the exit code and the bytes that it gets."""
    reader, writer = os.openpty()
    fcntl.ioctl(writer, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    environment = {key: value for key, value in os.environ.items() if key != "COLUMNS"}
    with subprocess.Popen(
        [*COMMAND, *map(str, arguments)], cwd=cwd, env=environment | {"TERM": "xterm"},
        stdin=writer, stdout=writer, stderr=writer,
    ) as running:  # fmt: skip
        os.close(writer)
        shown = b""
        while True:
            try:
                piece = os.read(reader, 65536)
            except OSError:  # Linux: the other side is closed
                break
            if not piece:
                break
            shown += piece
    os.close(reader)
    return running.returncode, shown


def plain(shown):
    """Return what stands on the terminal in the end, without styles and overwritten lines."""
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode()).replace("\r\n", "\n")
    return "\n".join(line.rpartition("\r")[2] for line in text.split("\n"))


def run(*arguments, cwd=None, redirect=""):
    """Run ``graspforce`` in a shell, with a redirection; nothing may ever be a traceback."""
    done = subprocess.run(
        ["/bin/sh", "-c", f'exec "$@" {redirect}', "sh", *COMMAND, *map(str, arguments)],
        cwd=cwd, capture_output=True, encoding="utf-8", timeout=120,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    return done


# ---- what steers a terminal --------------------------------------------------------------------

TITLE, CLEAR = "\x1b]0;OWNED\x07", "\x1b[2J"
STEERING = (TITLE, CLEAR, "\x9b31m", "\x08", "\x7f", "\u202e", "\u2066", "\u200f", "\u2028")


def steers(shown):
    """Whether anything else than the styles and the cursor movements of Rich is in it."""
    text = re.sub(r"\x1b\[(\?25[lh]|[0-9;]*m|2K|1A)", "", shown.decode())
    return any(each in text.replace("\r\n", "\n") for each in (*STEERING, "\x1b", "\x07"))


def test_terminal_printable():
    assert terminal.printable("".join(STEERING)) == "�]0;OWNED��[2J�31m������"
    assert terminal.printable("a\nb\tc\ud800\udce4") == "a�b�c��"
    for fine in ("λάμδα, 3 N·m", "手 🤏", "5\u00a0N", "full\u3000width", "Ä", "ä"):
        assert terminal.printable(fine) == fine


def test_terminal_the_check_itself_sees_what_steers():
    for each in STEERING:
        assert steers(f"a {each} b\r\n".encode())
    assert not steers(b"\x1b[1mbold\x1b[0m\r\n")


def test_nothing_from_a_file_steers_the_terminal(tmp_path):
    """Unused keys and names of an NPZ, keys and names of a JSON, their paths, the output's."""
    evil = "".join(STEERING)
    named = os.fsdecode(evil.encode())  # as an argument, whatever the locale
    path = tmp_path / f"grasps{named}.npz"
    grasp = {"W": np.eye(3)[None], "f": [[1.0, 0, 0]], "mu": 0.5, "c_max": 20.0}
    np.savez(path, **grasp, names=np.array([f"name {evil} [bold]b"]), **{f"key {evil}": [0.0]})
    out = tmp_path / f"out {named}.json"
    code, shown = in_terminal("solve", path, "--out", out)
    assert code == 0
    assert not steers(shown)
    assert "[bold]b" in re.sub(r"\s", "", plain(shown))
    assert json.loads(out.read_text(encoding="utf-8"))["results"][0]["name"].startswith("name")
    code, shown = in_terminal("compare", path, "--method", "wbf")
    assert code == 0
    assert not steers(shown)
    for text in (
        json.dumps({**SMALL, f"key {evil}": "X"}).replace('"X"', "NaN"),
        json.dumps({**SMALL, f"key {evil}": 1}),
        json.dumps({**SMALL, "name": f"name {evil}", "f": [1]}),
        json.dumps({**SMALL, "models": [{"model": f"model {evil}"}]}),
        f'{{"key {json.dumps(evil)[1:-1]}": 1, "key {json.dumps(evil)[1:-1]}": 1}}',
    ):
        bad = tmp_path / f"bad {named}.json"
        bad.write_text(text, encoding="utf-8")
        code, shown = in_terminal("solve", bad)
        assert code == 2
        assert not steers(shown)
        assert shown.count(b"\n") == 1
    for arguments in (
        ["solve", bad, "--out", tmp_path / f"no {named}" / "x.json"],
        ["solve", tmp_path / f"none {named}.json"],
        ["solve", tmp_path / f"ending.{named}"],
        ["compare", tmp_path / f"none {named}.json"],
        ["bench", "--compare", tmp_path / f"none {named}.json"],
        ["solve", path, f"one too many {named}"],
        ["solve", path, f"--option{named}"],
        [f"command{named}"],
    ):
        code, shown = in_terminal(*arguments)
        assert code == 2
        assert not steers(shown)


def test_terminal_a_path_with_a_newline_is_printed_on_one_line(tmp_path):
    out = tmp_path / "a\nb.json"
    done = run("solve", SEVERAL, "--out", out)
    assert f"Everything about them is in {tmp_path}/a�b.json\n" in done.stdout
    out.unlink()
    out.mkdir()
    done = run("solve", SEVERAL, "--out", out)
    expected = f"graspforce: {tmp_path}/a�b.json: got a directory, expected a file to write\n"
    assert (done.returncode, done.stderr) == (2, expected)


def test_terminal_exceptions_hold_what_the_file_holds(tmp_path):
    (tmp_path / "n.json").write_text(json.dumps({CLEAR: float("nan")}), encoding="utf-8")
    with pytest.raises(gf.InvalidInputError) as caught:
        files.read(tmp_path / "n.json")
    assert CLEAR in str(caught.value)


# ---- lone surrogates ---------------------------------------------------------------------------

LONE = "a\ud800b\udce4"


@pytest.mark.parametrize("source", ["json", "npz", "path"])
@pytest.mark.parametrize("ending", ["json", "csv", "npz"])
def test_terminal_a_lone_surrogate_costs_no_results(tmp_path, source, ending):
    path, name = tmp_path / f"grasps.{source}", LONE
    if source == "json":
        path.write_text(json.dumps({**SMALL, "name": LONE}))
    elif source == "npz":
        one = {"W": np.eye(3)[None], "f": [[1.0, 0, 0]], "mu": 0.5, "c_max": 20.0}
        np.savez(path, **one, names=np.array([LONE]))
    else:  # the name of a file that is not UTF-8 is what a grasp without a name is called
        path, name = tmp_path / os.fsdecode(b"\xe4\xff.json"), "\udce4\udcff"
        path.write_text(json.dumps({key: SMALL[key] for key in SMALL if key != "name"}))
    out = tmp_path / f"out.{ending}"
    done = run("solve", path, "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert terminal.printable(name) in done.stdout
    if ending == "json":
        assert json.loads(out.read_text(encoding="utf-8"))["results"][0]["name"] == name
    elif ending == "npz":
        with np.load(out) as data:
            assert data["name"][0] == name
    else:
        escaped = name.encode("utf-8", "backslashreplace").decode()
        assert f"\n{escaped},SOLVED," in out.read_text(encoding="utf-8")


def test_terminal_a_comparison_takes_every_file_name(tmp_path):
    path = tmp_path / os.fsdecode(b"\xe4" + b"n" * 240 + b"[bold].json")
    path.write_text(json.dumps({**SMALL, "name": LONE}))
    assert in_terminal("solve", path)[0] == 0
    code, _ = in_terminal("compare", path, "--method", "wbf", "--out", tmp_path / "out")
    assert code == 0
    text = (tmp_path / "out" / "comparison.json").read_text(encoding="utf-8")
    assert json.loads(text)["tasks"][0]["task"] == path.name
    assert len(list((tmp_path / "out").glob("times_*.png"))) == 1


# ---- output that cannot be written -------------------------------------------------------------

FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has it")
KEEPING = {
    "solve": (["solve", SEVERAL, "--out"], "out.json"),
    "scenario": (["scenario", "static", "--out"], "out.csv"),
    "simulate": (["simulate", "hold", "--set", "duration=0.02", "--log"], "out.npz"),
    "compare": (["compare", "static", "--method", "wbf", "--out"], "folder"),
    "bench": (["bench", "--effort", "1", "--save"], "out.json"),
}


@pytest.mark.parametrize(
    ("command", "redirect", "reason"),
    [
        *((command, ">&-", "Bad file descriptor") for command in KEEPING),
        ("solve", "<&- >&- 2>&-", ""),
        pytest.param("solve", ">/dev/full", "No space left on device", marks=FULL),
        pytest.param("scenario", ">/dev/full", "No space left on device", marks=FULL),
    ],
)
def test_terminal_output_that_nobody_gets_costs_no_file(tmp_path, command, redirect, reason):
    if command == "simulate":
        pytest.importorskip("mujoco")
    arguments, name = KEEPING[command]
    done = run(*arguments, tmp_path / name, redirect=redirect)
    assert done.returncode == 2
    said = f"graspforce: standard output: cannot write to it: {reason}\n" if reason else ""
    assert done.stderr == said
    assert [path.name for path in tmp_path.iterdir()] == [name]
    if name.endswith(".json"):
        json.loads((tmp_path / name).read_text(encoding="utf-8"))
    elif name.endswith(".npz"):
        with np.load(tmp_path / name) as data:
            assert len(data["t"]) == 10
    elif name.endswith(".csv"):
        assert len((tmp_path / name).read_text(encoding="utf-8").splitlines()) == 501
    else:
        json.loads((tmp_path / name / "comparison.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("arguments", [["--help"], ["solve", "--help"], ["--version"]])
def test_terminal_help_that_nobody_gets_is_an_error(arguments):
    done = run(*arguments, redirect=">&-")
    assert done.returncode == 2
    assert re.fullmatch(r"graspforce: (.*: )?Bad file descriptor\n", done.stderr)


@FULL
def test_terminal_when_all_fails_the_file_is_told_of(tmp_path):
    (tmp_path / "out.json").symlink_to("/dev/full")
    done = run("solve", SEVERAL, "--out", tmp_path / "out.json", redirect=">/dev/full")
    said = f"graspforce: {tmp_path}/out.json: cannot write it: No space left on device\n"
    assert (done.returncode, done.stderr) == (2, said)
    done = run("solve", "none.json", redirect="2>/dev/full")
    assert (done.returncode, done.stdout) == (2, "")


def test_terminal_a_reader_that_goes_away_costs_no_file(tmp_path):
    out = tmp_path / "out.json"
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [*COMMAND, "solve", SEVERAL, "--out", out],
        stdout=writer, stderr=subprocess.PIPE, encoding="utf-8", timeout=60,
    )  # fmt: skip
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")
    assert len(json.loads(out.read_text(encoding="utf-8"))["results"]) == 5


def test_terminal_what_is_printed_by_others_stays_out_of_a_file(tmp_path):
    """The file that is opened first must not get the number of the closed standard output."""
    code = (
        "import os, sys\n"
        "from graspforce._util.atomic import atomic_write\n"
        "from graspforce.cli.process import as_command\n"
        "with as_command(), atomic_write('out.txt') as path, path.open('w') as file:\n"
        "    file.write('mine')\n"
        "    for fd in (1, 2):\n"
        "        try: os.write(fd, b'printed')\n"
        "        except OSError: pass\n"
    )
    command = f'exec "{sys.executable}" -c "$0" <&- >&- 2>&-'
    subprocess.run(["/bin/sh", "-c", command, code], cwd=tmp_path, check=True, timeout=60)
    assert (tmp_path / "out.txt").read_text() == "mine"


@pytest.mark.skipif(not Path("/dev/stdout").exists(), reason="no /dev/stdout")
def test_terminal_results_to_standard_output(tmp_path):
    (tmp_path / "out.json").symlink_to("/dev/stdout")
    log = tmp_path / "log.txt"
    log.write_text("before\n")
    done = run("solve", SEVERAL, "--out", tmp_path / "out.json", redirect=f">>'{log}'")
    assert (done.returncode, done.stderr) == (0, "")
    before, results, table = re.split(r"(?s)(\{.*\n\]\}\n)", log.read_text(encoding="utf-8"))
    assert before == "before\n"
    assert len(json.loads(results)["results"]) == 5
    assert "5 grasps: 3 solved" in table
    assert (tmp_path / "out.json").readlink() == Path("/dev/stdout")
    done = run("solve", SEVERAL, "--out", "/dev/stdout")
    assert done.returncode == 2
    assert "got a file name ending in '', expected one in .json" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (["solve", SEVERAL, "--out"], "x.json"),
        (["scenario", "static", "--out"], "x.csv"),
        (["simulate", "hold", "--log"], "x.npz"),
        (["simulate", "hold", "--video"], "x.gif"),
        (["bench", "--save"], "x.json"),
        (["bench", "--plot"], "x.png"),
    ],
)
@pytest.mark.parametrize("kind", ["folder", "loop", "nowhere", "full"])
def test_terminal_a_bad_place_is_refused_before_the_work(
    tmp_path, monkeypatch, arguments, name, kind
):
    path = tmp_path / name
    what = {
        "folder": "got a directory, expected a file to write",
        "loop": "cannot write it: Too many levels of symbolic links",
        "nowhere": f"the directory {tmp_path}/none does not exist",
        "full": f"cannot write it: no file can be made in {tmp_path} (No space left on device)",
    }[kind]
    if kind == "folder":
        path.mkdir()
    elif kind == "loop":
        path.symlink_to(name)
    elif kind == "nowhere":
        path.symlink_to(f"none/{name}")
    else:

        def full(*_, **__):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("tempfile.mkdtemp", full)
    if arguments[0] == "simulate":
        pytest.importorskip("mujoco")
        monkeypatch.setattr("graspforce.sim.run", lambda *_: pytest.fail("worked first"))
    monkeypatch.setattr("graspforce.scenarios.run", lambda *_: pytest.fail("worked first"))
    monkeypatch.setattr("graspforce.study.bench.measure", lambda *_: pytest.fail("worked first"))
    monkeypatch.setattr("graspforce.files.read", lambda *_: pytest.fail("worked first"))
    done = CliRunner().invoke(cli.app, [*map(str, arguments), str(path)])
    assert done.exit_code == 2
    assert done.stderr == f"graspforce: {path}: {what}\n"


def test_terminal_a_default_name_is_not_replaced_behind_a_link(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("static.csv").symlink_to("other.csv")
    done = CliRunner().invoke(cli.app, ["scenario", "static"])
    assert done.exit_code == 2
    assert "exists already" in done.stderr


# ---- the width of a terminal -------------------------------------------------------------------


def tokens(text):
    return set(re.split(r"\s+|,\s*", text))


@pytest.mark.parametrize("columns", [40, 80, 100])
def test_terminal_a_comparison_splits_no_number(tmp_path, columns):
    pytest.importorskip("clarabel")
    code, shown = in_terminal(
        "compare", "static", "--method", "wbf", "--method", "minimum_norm", "--method", "socp_norm",
        "--method", "socp_norm_ecos", "--out", tmp_path, columns=columns,
    )  # fmt: skip
    assert code == 0
    *lines, path = plain(shown).splitlines()
    assert max(map(len, lines)) <= columns
    assert path.endswith(str(tmp_path))
    text = "\n".join(lines)
    document = json.loads((tmp_path / "comparison.json").read_text(encoding="utf-8"))
    for row in document["rows"]:
        if "missing" in row:
            continue
        times = row["cold [us]"], row["warm [us]"]
        expected = {output._number(float(np.median(each))) for each in times if each is not None}
        expected |= {
            output._number(row[f"{key} [N]"], 2) for key in ("slip margin", "largest jump")
        }
        expected |= {output._number(row["largest normal [N]"]), f"{np.mean(row['iterations']):.1f}"}
        assert expected <= tokens(text)


def test_terminal_a_comparison_is_one_table_where_there_is_room():
    task = compare.task("static")
    found = compare.compare(["static"], ["wbf", "minimum_norm"])
    for width, tables in ((200, 1), (80, 2), (45, 4)):
        console = terminal._Console(width=width)
        with console.capture() as printed:
            console.print(output.TaskTable(found, task.name))
        text = printed.get()
        assert text.count("method") == tables
        assert all(cell in text for row in found.rows for cell in output.cells(row))
        for heading in " ".join(output.HEADINGS).split():
            assert heading in text


@pytest.mark.parametrize("columns", [60, 80])
def test_terminal_a_long_name_splits_no_number(tmp_path, columns):
    document = json.loads(SEVERAL.read_text(encoding="utf-8"))
    for grasp in document["grasps"]:
        grasp["name"] = "n" * 200
    (tmp_path / "long.json").write_text(json.dumps(document))
    code, shown = in_terminal("solve", tmp_path / "long.json", columns=columns)
    assert code == 0
    for _, problem in files.read(SEVERAL):
        solution = gf.solve(problem)
        if solution.status is gf.Status.SOLVED:
            assert f"{solution.normal_forces.max():.4g}" in tokens(plain(shown))
            assert f"{solution.friction_margins.min():.4g}" in tokens(plain(shown))


def test_terminal_a_home_that_cannot_be_written_to_is_no_matter(tmp_path):
    """A container's user without a home folder: matplotlib then tells of its cache."""
    environment = {name: value for name, value in os.environ.items() if "MPL" not in name}
    environment |= {"HOME": "/dev/null", "XDG_CONFIG_HOME": "", "XDG_CACHE_HOME": ""}
    arguments = (
        "compare",
        "static",
        "--method",
        "wbf",
        "--method",
        "minimum_norm",
        "--out",
        tmp_path,
    )
    done = subprocess.run(
        [sys.executable, "-m", "graspforce", *map(str, arguments)],
        env=environment, capture_output=True, encoding="utf-8",
    )  # fmt: skip
    assert (done.returncode, "matplotlib" in done.stderr.lower()) == (0, False)
    assert list(tmp_path.glob("*.png"))


# ---- hints -------------------------------------------------------------------------------------

REQUIRES = [
    "numpy>=1.26",
    'matplotlib>=3.9; extra == "figures"',
    "graspforce[figures] ; extra == 'solvers'",
    'qoco>=0.3; extra == "solvers"',
    'imageio[ffmpeg]>=2.36; extra == "solvers"',
    'graspforce[solvers,figures]; extra == "all"',
    'graspforce[all]; extra == "all"',
]


@pytest.mark.parametrize(
    ("extra", "installed", "line"),
    [
        ("figures", (), "'matplotlib>=3.9'"),
        ("solvers", (), "'qoco>=0.3' 'imageio[ffmpeg]>=2.36' 'matplotlib>=3.9'"),
        ("solvers", ("matplotlib", "imageio"), "'qoco>=0.3'"),
        ("solvers", ("matplotlib", "imageio", "qoco"),
         "'qoco>=0.3' 'imageio[ffmpeg]>=2.36' 'matplotlib>=3.9'"),
        ("all", ("qoco",), "'imageio[ffmpeg]>=2.36' 'matplotlib>=3.9'"),
        ("nonsense", (), "package"),
        (None, (), "package"),
    ],
)  # fmt: skip
def test_terminal_the_hint_lists_what_pip_can_find(monkeypatch, extra, installed, line):
    """Not graspforce[extra], which is on no index; and only what is missing."""

    def version(name):
        if name not in installed:
            raise metadata.PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(metadata, "requires", lambda name: REQUIRES)
    monkeypatch.setattr(metadata, "version", version)
    text = str(gf.MissingExtraError("this", "package", extra))
    assert text == f"this needs package, which is not installed: pip install {line}"


def test_terminal_the_hint_where_graspforce_itself_is_not_installed(monkeypatch):

    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", missing)
    assert str(gf.MissingExtraError("this", "package", "sim")).endswith(": pip install package")


def test_terminal_every_extra_that_is_named_has_packages():
    source = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    named = set(re.findall(r'MissingExtraError\([^)]*, "(\w+)"\)', source))
    assert named >= {"figures", "baselines", "sim", "pinocchio"}
    for extra in named | {"mujoco", "solvers"}:
        assert errors._packages(extra)


def test_terminal_a_slip_in_a_file_is_one_line_of_warning(tmp_path):
    """Points in millimetres: the grasp is solved as given, and the reason is said once."""
    contacts = [
        {"point": [40 * s, 0, 0], "normal": [-s, 0, 0], "model": "PCWF", "mu": 0.5} for s in (-1, 1)
    ]
    path = tmp_path / "mm.json"
    path.write_text(json.dumps({"contacts": contacts, "f": [0, 0, 1, 0, 0, 0], "c_max": 20}))
    run = subprocess.run(
        [sys.executable, "-m", "graspforce", "solve", path], capture_output=True, encoding="utf-8"
    )
    assert run.returncode == 0
    (line,) = run.stderr.splitlines()
    assert line.startswith("graspforce: warning: ")
    assert "millimetres" in line
