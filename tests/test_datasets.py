"""Data sets: files of grasps in, Parquet out, whatever happens on the way."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import graspforce as gf
from graspforce.scenarios.random import grasps

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
gd = pytest.importorskip("graspforce.datasets")

LIMITS = {"tau_lo": -0.5, "tau_hi": 0.5}
FIELDS = ("W", "f", "J", "mu", "alpha")


@pytest.fixture(scope="module")
def problems():
    """Random grasps of four fingers; of each eighth more is asked than it can hold."""
    made = grasps(300)
    return [
        problem.replace(f=200 * problem.f) if i % 8 == 0 else problem
        for i, problem in enumerate(made)
    ]


def columns_of(problems):
    """The fields of the problems as lists of rows."""
    columns = {name: [getattr(each, name) for each in problems] for name in FIELDS}
    lists = {
        name: [value if name == "alpha" else np.asarray(value).tolist() for value in rows]
        for name, rows in columns.items()
    }
    return lists | {"id": [f"grasp {i}" for i in range(len(problems))]}


def write_source(path, columns, **options):
    """Write columns to a file of the format that its ending tells."""
    if path.suffix == ".parquet":
        pq.write_table(pa.table(columns), path, **options)
    elif path.suffix == ".jsonl":
        names = list(columns)
        lines = [json.dumps(dict(zip(names, row, strict=True))) for row in zip(*columns.values())]  # noqa: B905
        path.write_text("\n".join(lines) + "\n")
    elif path.suffix == ".npz":
        np.savez_compressed(path, **{name: np.array(rows) for name, rows in columns.items()})
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, rows in columns.items():
                file[name] = rows if name == "id" else np.array(rows)
    return path


@pytest.fixture
def source(problems, tmp_path):
    return write_source(tmp_path / "grasps.parquet", columns_of(problems), row_group_size=70)


def solve(source, target, **options):
    return gd.solve_dataset(
        source, target, **(LIMITS | {"rows_per_part": 64, "threads": 2} | options)
    )


def content(target):
    """Every byte of a target, by its file."""
    return {
        str(path.relative_to(target)): path.read_bytes()
        for path in sorted(Path(target).rglob("*"))
        if path.is_file()
    }


def damage(path):
    """Make the second row group of a Parquet file unreadable."""
    place = pq.read_metadata(path).row_group(1).column(0).data_page_offset
    with path.open("r+b") as file:
        file.seek(place)
        file.write(b"\xff" * 40)


def rejects(target):
    lines = [
        json.loads(line)
        for path in sorted((Path(target) / "rejects").glob("*"))
        for line in path.read_text().splitlines()
    ]
    return {line["row"]: line["reason"] for line in lines}


# ---- what comes out ----------------------------------------------------------------------------


def test_every_row_is_what_solve_makes_of_it(source, problems, tmp_path):
    summary = solve(source, tmp_path / "out")
    table = pq.read_table(tmp_path / "out")
    assert table["row"].to_pylist() == list(range(len(problems)))
    assert table["id"].to_pylist() == [f"grasp {i}" for i in range(len(problems))]
    assert set(table["file"].to_pylist()) == {"grasps.parquet"}
    statuses = []
    for row, problem in zip(table.to_pylist(), problems, strict=True):
        sol = gf.solve(problem)
        assert row["status"] == sol.status.name
        statuses.append(sol.status.name)
        assert row["alpha"] == problem.alpha
        if sol.status is gf.Status.SOLVED:
            for name in ("c", "tau", "normal_forces", "friction_margins", "torque_margins"):
                np.testing.assert_allclose(row[name], getattr(sol, name), rtol=1e-6, atol=1e-7)
            assert row["wrench_error"] < 1e-9
            assert row["suboptimality"] < 1e-8
    assert summary.counts.statuses == {name: statuses.count(name) for name in set(statuses)}
    assert {"SOLVED", "INFEASIBLE"} <= set(statuses)
    assert summary.counts.rows == len(problems)
    assert "rejected" in str(summary)


def test_every_column_tells_what_it_is(source, tmp_path):
    solve(source, tmp_path / "out")
    schema = pq.read_schema(next((tmp_path / "out").glob("*.parquet")))
    assert schema.metadata[b"graspforce"].decode() == gf.__version__
    told = {field.name: field.metadata or {} for field in schema}
    assert told["c"][b"unit"].decode() == "N, N·m"
    assert told["tau"][b"unit"].decode() == "N·m"
    assert all(b"description" in told[name] for name in told if name != "id")


@pytest.mark.parametrize("ending", [".npz", ".h5", ".jsonl"])
def test_formats_give_the_same_forces(ending, source, problems, tmp_path):
    other = write_source(tmp_path / f"other{ending}", columns_of(problems))
    solve(source, tmp_path / "one")
    solve(other, tmp_path / "two")
    one, two = pq.read_table(tmp_path / "one"), pq.read_table(tmp_path / "two")
    names = [name for name in one.column_names if name != "file"]
    assert one.select(names).equals(two.select(names))


def test_stacks_may_be_float32_and_numbers_for_all(problems, tmp_path):
    columns = columns_of(problems[:20])
    np.savez(tmp_path / "stack.npz", W=np.array(columns["W"], np.float32), f=columns["f"], mu=0.5,
             remark="of no row")  # fmt: skip
    summary = gd.solve_dataset(tmp_path / "stack.npz", tmp_path / "out", c_max=20)
    assert summary.counts.rows == 20
    assert summary.counts.solved > 10


def test_tensor_columns_are_read_as_their_numbers(problems, tmp_path):
    columns = columns_of(problems[:20])
    W = pa.FixedShapeTensorArray.from_numpy_ndarray(np.array(columns["W"]))
    tensors = pa.table(columns | {"W": W})
    pq.write_table(tensors, tmp_path / "tensors.parquet")
    write_source(tmp_path / "lists.parquet", columns)
    for name in ("tensors", "lists"):
        solve(tmp_path / f"{name}.parquet", tmp_path / name)
    one, two = (pq.read_table(tmp_path / name).drop(["file"]) for name in ("tensors", "lists"))
    assert one.equals(two)


def test_threads_change_no_bit(source, tmp_path):
    for threads in (1, 3):
        solve(source, tmp_path / f"out{threads}", threads=threads)
    assert content(tmp_path / "out1") == content(tmp_path / "out3")


def test_folders_are_read_in_the_order_of_names_with_the_keys_of_their_partitions(
    problems, tmp_path
):
    columns = columns_of(problems[:30])
    for hand, rows in (("b", slice(20, 30)), ("a", slice(0, 20))):
        folder = tmp_path / "grasps" / f"hand={hand}"
        folder.mkdir(parents=True)
        part = {name: values[rows] for name, values in columns.items()}
        write_source(folder / "x.parquet", part)
    (tmp_path / "grasps" / "_remarks.parquet").write_text("no Parquet")
    solve(tmp_path / "grasps", tmp_path / "out")
    table = pq.read_table(tmp_path / "out", partitioning=None)
    assert table["id"].to_pylist() == columns["id"]
    assert table["hand"].to_pylist() == ["a"] * 20 + ["b"] * 10
    assert table["row"].to_pylist() == [*range(20), *range(10)]


def test_rows_of_other_shapes_stand_in_their_place(problems, tmp_path):
    """Mixed numbers of contacts and joints, and frictionless contacts among them."""
    columns = {name: values[:6] for name, values in columns_of(problems[1:]).items()}
    for i in (1, 4):
        columns["W"][i] = [row[:9] for row in columns["W"][i]]
        columns["J"][i] = columns["J"][i][:9]
        columns["mu"][i] = columns["mu"][i][:3]
    del columns["alpha"]
    path = write_source(tmp_path / "mixed.parquet", columns)
    solve(path, tmp_path / "out")
    table = pq.read_table(tmp_path / "out")
    assert [len(c) for c in table["c"].to_pylist()] == [12, 9, 12, 12, 9, 12]
    assert table["id"].to_pylist() == columns["id"]
    for i in range(6):
        sol = gf.solve(
            gf.ForceProblem(
                columns["W"][i], columns["f"][i], [gf.PCWF(mu) for mu in columns["mu"][i]],
                J=columns["J"][i], **LIMITS,
            )
        )  # fmt: skip
        np.testing.assert_allclose(table["c"][i].as_py(), sol.c, rtol=1e-6, atol=1e-7)


def test_models_may_be_a_column(problems, tmp_path):
    one = problems[1]
    soft = [gf.SFC(0.5, 0.01)] * 3
    W = gf.grasp_map(
        [
            gf.Contact((np.cos(a) / 20, np.sin(a) / 20, 0), (-np.cos(a), -np.sin(a), 0), model)
            for a, model in zip((0, 2, 4), soft, strict=True)
        ]
    )
    rows = [
        {"W": one.W.tolist(), "f": one.f.tolist(), "mu": one.mu.tolist(), "models": ["PCWF"] * 4},
        {"W": W.tolist(), "f": [0, 0, 1, 0, 0, 0.01], "mu": [0.5] * 3, "gamma": [0.01] * 3,
         "models": ["SFC"] * 3},
        {"W": one.W[:, ::3].tolist(), "f": one.f.tolist(), "mu": [1.0], "models": ["FPC"] * 4},
        {"W": one.W.tolist(), "f": one.f.tolist(), "mu": [0.5], "models": ["rubber"] * 4},
    ]  # fmt: skip
    for row in rows:
        row.setdefault("gamma", [1.0] * len(row["models"]))
    path = tmp_path / "soft.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    gd.solve_dataset(path, tmp_path / "out", c_max=20)
    table = pq.read_table(tmp_path / "out")
    assert [len(c) for c in table["c"].to_pylist()] == [12, 12, 4]
    sol = gf.solve(gf.ForceProblem(W, rows[1]["f"], soft, c_max=20))
    np.testing.assert_allclose(table["c"][1].as_py(), sol.c, rtol=1e-6, atol=1e-7)
    assert table["status"][2].as_py() != "SOLVED"
    assert "rubber" in rejects(tmp_path / "out")[3]


# ---- rows that are wrong -----------------------------------------------------------------------


def test_bad_rows_are_rejected_with_reasons_and_stop_nothing(problems, tmp_path):
    columns = {name: values[:12] for name, values in columns_of(problems[1:]).items()}
    columns["f"][1] = [0.0, 0.0, 1.0]  # too short
    columns["mu"][2] = [-0.5] * 4
    columns["W"][3] = None
    columns["J"][4] = columns["J"][4][:-1]
    columns["W"][5] = [row[:-1] if i else row for i, row in enumerate(columns["W"][5])]
    columns["f"][6] = [float("nan")] * 6
    columns["mu"][7] = [0.5] * 3
    columns["W"][8] = np.array(columns["W"][8]).T.tolist()
    path = write_source(tmp_path / "bad.parquet", columns)
    summary = solve(path, tmp_path / "out")
    found = rejects(tmp_path / "out")
    assert sorted(found) == list(range(1, 9))
    words = {1: "of f", 2: "mu", 3: "null", 4: "J", 5: "lengths", 6: "f[", 7: "mu:", 8: "W:"}
    for row, word in words.items():
        assert word in found[row], found[row]
    table = pq.read_table(tmp_path / "out")
    assert table["row"].to_pylist() == [0, 9, 10, 11]
    assert (summary.counts.rows, summary.counts.rejected) == (12, 8)


def test_bad_lines_of_json_are_rejected(problems, tmp_path):
    path = write_source(tmp_path / "grasps.jsonl", columns_of(problems[1:6]))
    lines = path.read_text().splitlines()
    lines[1] = lines[1][:40]
    lines[2] = ""
    lines[3] = lines[3].replace('"f": [', '"f": ["x", ')
    path.write_text("\n".join(lines))
    solve(path, tmp_path / "out")
    found = rejects(tmp_path / "out")
    assert sorted(found) == [1, 2, 3]
    assert "JSON" in found[1]
    assert "empty" in found[2]
    assert found[3].startswith("f:")


def test_a_part_whose_rows_are_all_bad_is_done_too(problems, tmp_path):
    columns = columns_of(problems[:8])
    columns["mu"] = [[-1.0] * 4] * 8
    path = write_source(tmp_path / "bad.parquet", columns)
    first = solve(path, tmp_path / "out")
    again = solve(path, tmp_path / "out")
    assert first.counts.rejected == again.counts.rejected == 8
    assert again.resumed == 1


# ---- columns that are wrong --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"tau_low": -0.5}, "tau_lo'"),
        ({"muu": 0.5}, "did you mean 'mu'"),
        ({"w": 0.5}, "did you mean 'W'"),
        ({"normal": 0.5}, "did you mean 'normals'"),
        ({"gravity_dir": 0.5}, "did you mean 'gravity_direction'"),
        ({"W": None}, "W: missing"),
        ({"f": None}, "f: missing; expected f, or the object's mass"),
        ({"mu": None}, "mu: missing"),
        ({"mu": "rough"}, "mu: got type string, expected numbers"),
        ({"status": 1}, "'status': the target has a column of this name"),
    ],
)
def test_wrong_columns_are_named_before_anything_is_done(changes, said, problems, tmp_path):
    columns = columns_of(problems[:4])
    for name, value in changes.items():
        if value is None:
            del columns[name]
        else:
            columns[name] = [value] * 4
    path = write_source(tmp_path / "grasps.parquet", columns)
    with pytest.raises(gf.InvalidInputError) as raised:
        solve(path, tmp_path / "out")
    assert said in str(raised.value)
    assert not (tmp_path / "out").exists()


def test_keys_that_are_no_slips_are_carried_through(problems, tmp_path):
    names = ("object", "object_code", "hand", "scale", "grasp_id", "name", "score", "fx")
    columns = columns_of(problems[:4]) | {name: ["x"] * 4 for name in names}
    solve(write_source(tmp_path / "grasps.parquet", columns), tmp_path / "out")
    assert set(names) <= set(pq.read_table(tmp_path / "out").column_names)


def test_keys_may_be_chosen(problems, tmp_path):
    columns = columns_of(problems[:4]) | {"muu": [1.0] * 4, "scale": [0.1] * 4}
    path = write_source(tmp_path / "grasps.parquet", columns)
    solve(path, tmp_path / "out", keys=["muu"])
    names = pq.read_table(tmp_path / "out").column_names
    assert "muu" in names
    assert "scale" not in names
    with pytest.raises(gf.InvalidInputError, match="no column 'scal'; did you mean 'scale'"):
        solve(path, tmp_path / "other", keys=["scal"])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"engine": "spark"}, "engine: got 'spark', expected 'local' or 'ray'"),
        ({"rows_per_part": 0}, "rows_per_part"),
        ({"gravity": "sphere"}, "mass: missing"),
        ({"gravity": "cube"}, "gravity: got 'cube'"),
        ({"slip_reserve": 1.5}, "slip_reserve"),
        ({"times_least": 1}, "times_least"),
        ({"sensitivities": ["c"]}, "sensitivities: got 'c'"),
        ({"alfa": 1.0}, "alfa: no column of the format; did you mean 'alpha'"),
        ({"models": "PWCF"}, "models: got 'PWCF'"),
        ({"settings": gf.Settings(budget_us=10)}, "budget_us"),
        ({"fingertips": ["tip"]}, "hand: missing"),
    ],
)
def test_wrong_arguments_are_named(options, said, source, tmp_path):
    with pytest.raises(gf.InvalidInputError) as raised:
        solve(source, tmp_path / "out", **options)
    assert said in str(raised.value)


def test_a_column_that_is_there_twice_is_refused(problems, tmp_path):
    columns = columns_of(problems[:4])
    table = pa.table(columns)
    pq.write_table(table.append_column("mu", table["mu"]), tmp_path / "twice.parquet")
    with pytest.raises(gf.InvalidInputError, match="'mu': it is there twice"):
        solve(tmp_path / "twice.parquet", tmp_path / "out")


def test_an_empty_source_is_done_at_once(problems, tmp_path):
    empty = pa.table(columns_of(problems[:4])).slice(0, 0)
    pq.write_table(empty, tmp_path / "empty.parquet")
    assert solve(tmp_path / "empty.parquet", tmp_path / "out").counts.rows == 0
    assert (tmp_path / "out" / "_summary.json").is_file()


def test_sources_that_are_none(tmp_path):
    for name, said in (
        ("nowhere", "does not exist"), ("empty", "holds no file"), ("grasps.csv", "'.csv'"),
        ("broken.parquet", "cannot read"), ("broken.npz", "not an NPZ archive"),
    ):  # fmt: skip
        path = tmp_path / name
        if name == "empty":
            path.mkdir()
        elif name != "nowhere":
            path.write_text("nothing of that kind")
        with pytest.raises(gf.InvalidInputError, match=said):
            gd.solve_dataset(path, tmp_path / "out")


def test_nothing_is_unpickled(tmp_path):
    np.savez(tmp_path / "objects.npz", W=np.array([{"a": 1}], dtype=object))
    with pytest.raises(gf.InvalidInputError, match="never unpickled"):
        gd.solve_dataset(tmp_path / "objects.npz", tmp_path / "out")


# ---- targets -----------------------------------------------------------------------------------


def test_a_target_is_gone_on_with_only_by_the_same_call(source, tmp_path):
    solve(source, tmp_path / "out")
    before = content(tmp_path / "out")
    with pytest.raises(gf.InvalidInputError, match=r"recipe: slip_reserve: null, now 0\.1"):
        solve(source, tmp_path / "out", slip_reserve=0.1)
    with pytest.raises(gf.InvalidInputError, match=r"values: alpha: null, now 2\.0"):
        solve(source, tmp_path / "out", alpha=2)
    with pytest.raises(gf.InvalidInputError, match=r"values: tau_lo: -0\.5, now null"):
        gd.solve_dataset(source, tmp_path / "out", rows_per_part=64, tau_limit=0.5)
    with pytest.raises(gf.InvalidInputError, match="rows_per_part: 64, now 65"):
        solve(source, tmp_path / "out", rows_per_part=65)
    table = pq.read_table(source)
    others = {"of other numbers": table.take(np.arange(len(table))[::-1]), "cut": table[:100]}
    for rows in others.values():
        pq.write_table(rows, source, row_group_size=70)
        with pytest.raises(gf.InvalidInputError, match=r"source: grasps\.parquet: (fing|rows)"):
            solve(source, tmp_path / "out")
    assert content(tmp_path / "out") == before


def test_a_folder_of_something_else_is_no_target(source, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    with pytest.raises(gf.InvalidInputError, match="not empty"):
        solve(source, tmp_path / "mine")
    with pytest.raises(gf.InvalidInputError, match="in the source"):
        solve(tmp_path, tmp_path / "out")
    with pytest.raises(gf.InvalidInputError, match="folder"):
        solve(source, source.parent / "mine" / "thesis.tex")


def test_parts_that_are_missing_are_made_again(source, tmp_path):
    solve(source, tmp_path / "out")
    whole = content(tmp_path / "out")
    for number in (1, 4):
        (tmp_path / "out" / f"part-{number:06d}.parquet").unlink()
    (tmp_path / "out" / ".graspforce-left").mkdir()
    seen = []
    summary = solve(
        source, tmp_path / "out", progress=lambda counts, total: seen.append((counts.rows, total))
    )
    assert content(tmp_path / "out") == whole
    assert not (tmp_path / "out" / ".graspforce-left").exists()
    assert (summary.resumed, summary.parts, summary.solved_here) == (3, 5, 64 + 44)
    assert seen[0] == (192, 300)
    assert seen[-1] == (300, 300)


def test_killed_at_any_moment_it_goes_on_to_the_same_bytes(problems, tmp_path):
    """SIGKILL at some moments of a run, each then gone on with."""
    columns = columns_of(problems)
    columns["mu"][17] = [-1.0] * 4
    columns = {name: values * 20 for name, values in columns.items()}
    source = write_source(tmp_path / "grasps.parquet", columns, row_group_size=1000)
    solve(source, tmp_path / "whole", rows_per_part=50)
    command = [
        sys.executable, "-m", "graspforce", "batch", str(source), str(tmp_path / "out"),
        "--rows-per-part", "50", "--set", "tau_lo=-0.5", "--set", "tau_hi=0.5",
    ]  # fmt: skip
    rng = np.random.default_rng(5)
    parts = 0
    for _ in range(4):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        most = time.monotonic() + 60
        wanted = parts + int(rng.integers(1, 8))
        while process.poll() is None and time.monotonic() < most:
            parts = len(list((tmp_path / "out").glob("part-*")))
            if parts >= wanted:
                break
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert 0 < parts < 120
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "from an earlier run" in done.stdout
    assert content(tmp_path / "out") == content(tmp_path / "whole")


def test_a_full_disk_loses_nothing(source, tmp_path, monkeypatch):
    write, count = pq.write_table, 0

    def on_a_full_disk(table, path, **options):
        nonlocal count
        count += 1
        if count > 2:
            Path(path).write_bytes(b"half of it")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(table, path, **options)

    monkeypatch.setattr(pq, "write_table", on_a_full_disk)
    with pytest.raises(gd.UnfinishedError, match="No space left on device; 2 of 5 parts are done"):
        solve(source, tmp_path / "out", threads=1)
    monkeypatch.undo()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "_manifest.json", "part-000000.parquet", "part-000001.parquet",
    ]  # fmt: skip
    assert solve(source, tmp_path / "out").resumed == 2
    solve(source, tmp_path / "whole")
    assert content(tmp_path / "out") == content(tmp_path / "whole")


def test_an_unreadable_file_keeps_no_other_from_being_done(problems, tmp_path):
    columns = columns_of(problems)
    (tmp_path / "grasps").mkdir()
    for name in ("a", "b"):
        write_source(tmp_path / "grasps" / f"{name}.parquet", columns, compression="none",
                     row_group_size=100, use_dictionary=False)  # fmt: skip
    whole = (tmp_path / "grasps" / "a.parquet").read_bytes()
    damage(tmp_path / "grasps" / "a.parquet")
    with pytest.raises(gd.UnfinishedError, match=r"a\.parquet: cannot read rows .* parts are done"):
        solve(tmp_path / "grasps", tmp_path / "out")
    assert (tmp_path / "out" / "part-000009.parquet").is_file()
    (tmp_path / "grasps" / "a.parquet").write_bytes(whole)
    assert solve(tmp_path / "grasps", tmp_path / "out").counts.rows == 600


# ---- the command -------------------------------------------------------------------------------


def run(*arguments):
    command = [sys.executable, "-m", "graspforce", "batch", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_command_and_its_exit_codes(source, tmp_path):
    out = tmp_path / "out"
    options = ("--set", "tau_lo=-0.5", "--set", "tau_hi=0.5", "--rows-per-part", "64")
    done = run(source, out, *options)
    assert done.returncode == 0
    assert "300 rows:" in done.stdout
    assert done.stderr == ""
    wrong = run(source, out, *options, "--set", "mu=0.4")
    assert wrong.returncode == 2
    assert "was begun with" in wrong.stderr
    damage(source)
    early = run(source, tmp_path / "other", *options)
    assert early.returncode == 3
    assert "1 of 5 parts are done" in early.stderr
    assert run(source, out, "--set", "tau_lo").returncode == 2


def test_ctrl_c_ends_in_order_and_is_gone_on_with(problems, tmp_path):
    columns = {name: values * 20 for name, values in columns_of(problems).items()}
    source = write_source(tmp_path / "grasps.parquet", columns)
    options = ("--set", "tau_lo=-0.5", "--set", "tau_hi=0.5", "--rows-per-part", "20")
    command = [sys.executable, "-m", "graspforce", "batch", str(source), str(tmp_path / "out")]
    process = subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 60
    while not list((tmp_path / "out").glob("part-*")) and time.monotonic() < until:
        time.sleep(0.005)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate()
    assert process.returncode == 130
    assert "Traceback" not in said
    assert not list((tmp_path / "out").glob(".graspforce-*"))
    summary = solve(source, tmp_path / "out", rows_per_part=20)
    assert 0 < summary.resumed < 300


def test_without_pyarrow_the_error_names_the_pip_line():
    code = "import sys, graspforce as gf; sys.modules['pyarrow'] = None; gf.datasets"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "MissingExtraError: graspforce.datasets needs pyarrow" in run.stderr
    assert "pip install 'pyarrow" in run.stderr


def test_without_ray_the_error_names_the_pip_line(source, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(
        gf.MissingExtraError, match=r"engine 'ray' needs ray.*pip install .*ray\[data"
    ):
        solve(source, tmp_path / "out", engine="ray")
    assert not (tmp_path / "out").exists()


def test_two_runs_do_not_write_one_target(source, tmp_path):
    def again(counts, total):
        with pytest.raises(gf.InvalidInputError, match="another run is writing"):
            solve(source, tmp_path / "out")

    solve(source, tmp_path / "out", progress=again)
    assert solve(source, tmp_path / "out").resumed == 5


def test_the_page_describes_every_column():
    from graspforce.datasets.schema import KNOWN, RESULTS

    page = (Path(__file__).parents[1] / "docs" / "datasets.md").read_text(encoding="utf-8")
    tables = "".join(line for line in page.splitlines() if line.startswith("| `"))
    assert [name for name in (*KNOWN, *RESULTS) if f"`{name}`" not in tables] == []
