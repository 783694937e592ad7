"""The instruction count: what it runs, how it reads what Valgrind writes; benchmarks' files."""

import argparse
import dataclasses
import subprocess
import sys
from pathlib import Path

import convergence
import instructions
import linearised_cones
import numpy as np
import pytest
import saving
import simulation

from graspforce import sim
from graspforce.baselines import METHODS
from graspforce.study.compare import NAMES

BENCHMARKS = Path(simulation.__file__).parent


def test_every_method_is_counted_and_the_core_alone():
    found = {name.split("|")[0] for name, _, _ in instructions.works()}
    assert set(NAMES) - {"socp_norm_ecos", "socp_norm_moreau"} <= found
    assert "wbf, C++ alone" in found


def test_a_work_runs_as_many_ticks_as_it_says():
    works = {name: (count, prepare) for name, count, prepare in instructions.works()}
    count, prepare = works["socp_norm_qoco|False"]
    assert len(prepare()(count)) == count
    count, prepare = works["wbf, C++ alone|True"]
    assert len(prepare()(2 * count)) == 2 * count


def test_totals_of_callgrind_files(tmp_path):
    file = tmp_path / "1"
    file.write_text("# callgrind format\nsummary: 5\n\nfn=(1)\n1 7\ntotals: 123456\n")
    assert instructions.read_total(file) == 123456


def refusal(benchmark, monkeypatch, capsys, *arguments):
    """What a benchmark says when it refuses its arguments, which it does before any work."""
    for name in ("measure", "judge", "scenes"):
        if hasattr(benchmark, name):
            monkeypatch.setattr(benchmark, name, lambda *_: pytest.fail("worked before it looked"))
    monkeypatch.setattr(sys, "argv", [benchmark.__file__, *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        benchmark.main()
    assert end.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    "benchmark", [instructions, linearised_cones, convergence, simulation], ids=lambda m: m.__name__
)
def test_a_file_that_cannot_be_written_is_refused_before_the_work(
    benchmark, tmp_path, monkeypatch, capsys
):
    nowhere = tmp_path / "none" / "table.txt"
    said = refusal(benchmark, monkeypatch, capsys, "--save", nowhere)
    assert f"{nowhere}: the directory {nowhere.parent} does not exist" in said


def test_missing_grasps_are_one_line(tmp_path, monkeypatch, capsys):
    said = refusal(linearised_cones, monkeypatch, capsys, "--data", tmp_path / "no.npz")
    assert "there are no grasps at" in said


def test_a_path_that_is_only_asked_for_is_left_alone(tmp_path):
    old, new = tmp_path / "old.txt", tmp_path / "new.txt"
    old.write_text("kept")
    assert saving.writable(str(old)) == old
    assert saving.writable(str(new)) == new
    assert old.read_text() == "kept"
    assert not new.exists()


def test_a_link_that_is_only_asked_for_is_left_alone(tmp_path):
    (tmp_path / "link.txt").symlink_to("new.txt")
    assert saving.writable(str(tmp_path / "link.txt")) == tmp_path / "link.txt"
    assert [path.name for path in tmp_path.iterdir()] == ["link.txt"]
    (tmp_path / "loop.txt").symlink_to("loop.txt")
    with pytest.raises(argparse.ArgumentTypeError, match=r"loop\.txt: cannot write it"):
        saving.writable(str(tmp_path / "loop.txt"))


def test_a_table_is_written_as_a_whole_and_printed(tmp_path, capsys, monkeypatch):
    path = tmp_path / "table.txt"
    saving.show("one", save=path, width=80)
    saving.show("two", save=path, width=80, append=True)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert (lines[0], lines.index("two")) == ("one", len(lines) // 2)
    saving.show("three", save=path, width=80)
    assert path.read_text(encoding="utf-8").startswith("three\n")
    assert capsys.readouterr().out.count("cores, Python") == 3

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OSError, match="No space left"):
        saving.show("four", save=path, width=80)
    assert "four" in capsys.readouterr().out
    assert path.read_text(encoding="utf-8").startswith("three\n")


def test_the_campaign_appends_and_tells_what_it_cannot_write(tmp_path):
    path = tmp_path / "tables.txt"
    command = [sys.executable, BENCHMARKS / "campaign.py", "--grasps", "10", "--jobs", "1"]
    path.write_text("before\n")
    shell = subprocess.run(
        ["/bin/sh", "-c", 'exec "$@" >&-', "sh", *command, "--save", path],
        capture_output=True, encoding="utf-8", timeout=120,
    )  # fmt: skip
    assert shell.returncode == 2
    assert shell.stderr.endswith("standard output: cannot write to it: Bad file descriptor\n")
    text = path.read_text(encoding="utf-8")
    assert text.startswith("before\n")
    assert text.count("cores, Python") == 1
    refused = subprocess.run(
        [*command, "--save", tmp_path], capture_output=True, encoding="utf-8", timeout=120
    )
    assert refused.returncode == 2
    assert f"{tmp_path}: got a directory, expected a file to write" in refused.stderr


def test_the_table_of_convergence_has_every_method():
    grasps = list(convergence.problems(2))
    rows = [convergence.judge(method, grasps) for method in convergence.methods()]
    assert {row.name.split(",")[0] for row in rows} == set(METHODS)
    for row in rows:
        assert row.unsolved == 0
        assert row.objective < 1e-6
        assert len(row.steps) == len(grasps)
    assert len(convergence.table(rows, 2).rows) == len(rows)


def test_the_cells_of_simulations():
    (trial,) = sim.get("hold", duration=0.05)
    held = sim.run(trial)
    slid = dataclasses.replace(held, slip=np.full_like(held.slip, 2e-3))
    dropped = held.ended(10, sim.Ending.DROPPED, "")
    slip = 1e3 * held.slip.max()
    cells = [simulation.cell(log) for log in (held, slid, dropped)]
    assert cells == [f"holds {slip:.2f}", "slips 2.00", "drops"]
    firmer = dataclasses.replace(held, tau=2 * held.tau)
    assert simulation.measured([firmer, held])[2:4] == [
        f"{slip:.2f} mm",
        f"{200 * held.torque_use:.0f} %",
    ]
    assert simulation.measured([held, slid])[0] == "not held"
