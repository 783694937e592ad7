"""Data sets of contact points: W, wrenches and joints are made of each row's geometry."""

from __future__ import annotations

import json

import numpy as np
import pytest
from grasps import random_contacts, random_model, unit
from models import paper_hand_xml
from scipy.spatial.transform import Rotation

import graspforce as gf

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
gd = pytest.importorskip("graspforce.datasets")

KINDS = (["PCWF"] * 3, ["SFC"] * 4, ["PCWF", "SFC", "FPC", "PCWF"], ["PCWF"] * 5)


@pytest.fixture(scope="module")
def contacts():
    """Contacts of 24 grasps, of four sets of models."""
    rng = np.random.default_rng(8)
    return [
        random_contacts(rng, [random_model(rng, kind) for kind in KINDS[i % 4]]) for i in range(24)
    ]


def row_of(contacts):
    return {
        "points": [each.point.tolist() for each in contacts],
        "normals": [each.normal.tolist() for each in contacts],
        "tangents": [each.tangent.tolist() for each in contacts],
        "mu": [float(each.model.mu) for each in contacts],
        "gamma": [float(each.model.gamma) for each in contacts],
        "models": [type(each.model).__name__ for each in contacts],
    }


def written(path, rows):
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def table_of(source, target, **options):
    gd.solve_dataset(source, target, **options)
    return pq.read_table(target)


def rejects(target):
    lines = [
        json.loads(line)
        for path in sorted((target / "rejects").glob("*"))
        for line in path.read_text().splitlines()
    ]
    return {line["row"]: line["reason"] for line in lines}


def assert_same(found, solution):
    assert found["status"] == solution.status.name
    if solution.status is gf.Status.SOLVED:
        for name in ("c", "tau", "normal_forces", "friction_margins"):
            np.testing.assert_allclose(found[name], getattr(solution, name), rtol=1e-6, atol=1e-7)


def test_geometry_is_what_grasp_makes_of_it(contacts, tmp_path):
    rng = np.random.default_rng(1)
    loads = rng.normal(size=(len(contacts), 6)) * [1, 1, 1, 0.01, 0.01, 0.01]
    origins = rng.normal(size=(len(contacts), 3)) / 100
    rows = [
        row_of(each) | {"f": f.tolist(), "origin": origin.tolist()}
        for each, f, origin in zip(contacts, loads, origins, strict=True)
    ]
    found = table_of(written(tmp_path / "a.jsonl", rows), tmp_path / "out", c_max=20).to_pylist()
    solved = 0
    for row, each, f, origin in zip(found, contacts, loads, origins, strict=True):
        solution = gf.solve(gf.Grasp(each, origin=origin).problem(f, c_max=20))
        assert_same(row, solution)
        solved += row["status"] == "SOLVED"
    assert solved > 10


def test_without_tangents_frames_are_those_of_contacts(contacts, tmp_path):
    rows = [row_of(each) | {"f": [0, 0, 1, 0, 0, 0]} for each in contacts]
    for row in rows:
        del row["tangents"]
    found = table_of(written(tmp_path / "a.jsonl", rows), tmp_path / "out", c_max=20).to_pylist()
    plain = [gf.Contact(each.point, each.normal, each.model) for each in contacts[0]]
    assert_same(found[0], gf.solve(gf.Grasp(plain).problem([0, 0, 1, 0, 0, 0], c_max=20)))


def test_a_mass_is_carried_against_gravity_as_the_object_stands(contacts, tmp_path):
    rng = np.random.default_rng(2)
    turn = Rotation.random(random_state=rng)
    down = unit(rng.normal(size=3))
    quaternion = np.roll(turn.as_quat(), 1)
    row = row_of(contacts[0]) | {
        "mass": 0.2,
        "object_pose": [1.0, 2, 3, *quaternion],
        "gravity_direction": (3 * down).tolist(),
    }
    table = table_of(written(tmp_path / "a.jsonl", [row]), tmp_path / "out", c_max=20)
    (found,) = table.to_pylist()
    force = -0.2 * 9.81 * turn.inv().apply(down)
    np.testing.assert_allclose(found["f"], [*force, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found["gravity"], turn.inv().apply(down), atol=1e-12)
    assert_same(found, gf.solve(gf.Grasp(contacts[0]).problem(found["f"], c_max=20)))


@pytest.mark.parametrize(("name", "count"), [("sphere", 6), ("sphere20", 20)])
def test_the_sphere_of_gravity_has_a_row_for_each_direction(name, count, contacts, tmp_path):
    rows = [row_of(each) | {"mass": 0.1 * (1 + i % 9), "id": i} for i, each in enumerate(contacts)]
    rows[4]["normals"][1] = [0.0, 0.0, 2.0]
    source = written(tmp_path / "a.jsonl", rows)
    summary = gd.solve_dataset(source, tmp_path / "out", gravity=name, c_max=10, rows_per_part=7)
    table = pq.read_table(tmp_path / "out")
    good = [i for i in range(len(rows)) if i != 4]
    assert table["row"].to_pylist() == np.repeat(good, count).tolist()
    assert table["id"].to_pylist() == np.repeat(good, count).tolist()
    assert table["gravity_index"].to_pylist() == [*range(count)] * len(good)
    directions = np.array(table["gravity"].to_pylist()).reshape(-1, count, 3)[0]
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(directions.T @ directions, np.eye(3) * count / 3, atol=1e-12)
    assert len(np.unique(directions.round(6), axis=0)) == count
    held = 0
    for place, i in enumerate(good):
        found = table.slice(place * count, count).to_pylist()
        held += all(row["status"] == "SOLVED" for row in found)
        f = np.append(-9.81 * rows[i]["mass"] * directions[3], np.zeros(3))
        assert_same(found[3], gf.solve(gf.Grasp(contacts[i]).problem(f, c_max=10)))
    assert summary.counts.held == held
    assert 0 < held < len(good)
    assert f"{held} grasps hold for all {count} directions" in str(summary)
    assert "normals[1]: got length 2" in rejects(tmp_path / "out")[4]


def test_frames_that_are_none_are_rejected(contacts, tmp_path):
    rows = [row_of(contacts[0]) | {"f": [0, 0, 1, 0, 0, 0]} for _ in range(6)]
    rows[0]["normals"][2] = [0.0, 0.0, 0.5]
    rows[1]["tangents"][1] = rows[1]["normals"][1]
    rows[2]["points"][0] = [0.0, 0.0]
    rows[3]["points"][0][1] = float("nan")
    rows[4]["normals"] = rows[4]["normals"][:2]
    found = table_of(written(tmp_path / "a.jsonl", rows), tmp_path / "out", c_max=20)
    assert found["row"].to_pylist() == [5]
    reasons = rejects(tmp_path / "out")
    words = {0: "normals[2]: got length 0.5", 1: "tangents[1]", 2: "points", 3: "W[", 4: "normals:"}
    for row, word in words.items():
        assert word in reasons[row]


def test_a_pose_needs_a_unit_quaternion(contacts, tmp_path):
    row = row_of(contacts[0]) | {"mass": 0.1, "object_pose": [0, 0, 0, 2.0, 0, 0, 0]}
    gd.solve_dataset(written(tmp_path / "a.jsonl", [row]), tmp_path / "out", c_max=20)
    assert "object_pose: got a quaternion of length 2" in rejects(tmp_path / "out")[0]


def test_f_beside_mass_is_refused(contacts, tmp_path):
    row = row_of(contacts[0]) | {"mass": 0.1, "f": [0.0] * 6}
    source = written(tmp_path / "a.jsonl", [row])
    with pytest.raises(gf.InvalidInputError, match="f: given beside mass"):
        gd.solve_dataset(source, tmp_path / "out", c_max=20)


def test_wishes_hold_with_the_default_alpha_too(contacts, tmp_path):
    rows = [row_of(each) | {"mass": 0.1} for each in contacts]
    source = written(tmp_path / "a.jsonl", rows)
    found = table_of(source, tmp_path / "out", c_max=20, slip_reserve=0.2).to_pylist()
    problem = gf.Grasp(contacts[1]).problem(found[1]["f"], c_max=20)
    grip = gf.firmness.choose(problem, slip_reserve=0.2)
    assert found[1]["met"] == grip.met
    np.testing.assert_allclose(found[1]["c"], grip.c, rtol=1e-6, atol=1e-7)


def test_columns_that_need_each_other_reject_their_rows(contacts, tmp_path):
    rows = [row_of(each) | {"mass": 0.1} for each in contacts[:2]]
    rows[1]["dc_max"] = [1.0] * 16
    source = written(tmp_path / "a.jsonl", rows)
    gd.solve_dataset(source, tmp_path / "out", c_max=20)
    assert "null" in rejects(tmp_path / "out")[0]
    assert "c_last: missing" in rejects(tmp_path / "out")[1]


# ---- hands -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hand_file(tmp_path_factory):
    pytest.importorskip("mujoco")
    path = tmp_path_factory.mktemp("hand") / "hand.xml"
    path.write_text(paper_hand_xml())
    return path


def held_rows(hand, count, rng, pose=None):
    """Grasps of the paper's hand on what is between its fingertips, in the object's axes."""
    rows, problems = [], []
    for _ in range(count):
        q = np.tile([0.0, 0.3, 0.8], 4) + 0.1 * rng.normal(size=12)
        points = hand.fingertip_positions(q)
        normals = unit(points.mean(axis=0) - points)
        inside = [gf.Contact(p, n, gf.PCWF(0.6)) for p, n in zip(points, normals, strict=True)]
        origin, f = points.mean(axis=0), np.array([0, 0, 1.0, 0, 0, 0])
        problems.append(gf.Grasp(inside, hand, q, origin=origin).problem(f))
        turn = Rotation.identity() if pose is None else Rotation.from_quat(np.roll(pose[3:], -1))
        place = np.zeros(3) if pose is None else pose[:3]
        rows.append(
            {
                "points": (turn.apply(points) + place).tolist(),
                "normals": turn.apply(normals).tolist(),
                "tangents": turn.apply([each.tangent for each in inside]).tolist(),
                "origin": (turn.apply(origin) + place).tolist(),
                "f": [*turn.apply(f[:3]), *turn.apply(f[3:])],
                "q": q.tolist(),
            }
            | ({} if pose is None else {"hand_pose": pose.tolist()})
        )
    return rows, problems


@pytest.mark.parametrize("posed", [False, True])
def test_a_hand_gives_joints_and_limits(posed, hand_file, tmp_path):
    rng = np.random.default_rng(4)
    tips = ["tip1", "tip2", "tip3", "tip4"]
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(hand_file))
    model.opt.gravity[:] = 0
    hand = gf.hands.from_mjcf(model, tips)
    pose = np.append([0.1, -0.2, 0.3], np.roll(Rotation.random(random_state=rng).as_quat(), 1))
    rows, problems = held_rows(hand, 5, rng, pose if posed else None)
    rows[3]["q"] = rows[3]["q"][:-1]
    source = written(tmp_path / "a.jsonl", rows)
    table = table_of(source, tmp_path / "out", hand=hand_file, fingertips=tips, mu=0.6)
    assert table["row"].to_pylist() == [0, 1, 2, 4]
    assert "q" in rejects(tmp_path / "out")[3]
    solved = 0
    for found, problem in zip(table.to_pylist(), problems[:3] + problems[4:], strict=True):
        assert_same(found, gf.solve(problem))
        assert len(found["tau"]) == 12
        solved += found["status"] == "SOLVED"
    assert solved


def test_a_hand_holds_against_gravity_from_all_sides(hand_file, tmp_path):
    rng = np.random.default_rng(4)
    tips = ["tip1", "tip2", "tip3", "tip4"]
    hand = gf.hands.from_mjcf(hand_file, tips)
    hand.robot.model.opt.gravity[:] = 0
    rows, _ = held_rows(hand, 2, rng)
    for row in rows:
        del row["f"]
    source = written(tmp_path / "a.jsonl", rows)
    options = {"hand": hand_file, "fingertips": tips, "mu": 0.6, "mass": 0.1}
    table = table_of(source, tmp_path / "out", gravity="sphere", **options).to_pylist()
    assert len(table) == 12
    for found in table:
        row = rows[found["row"]]
        contacts = [
            gf.Contact(p, n, gf.PCWF(0.6), t)
            for p, n, t in zip(row["points"], row["normals"], row["tangents"], strict=True)
        ]
        grasp = gf.Grasp(contacts, hand, row["q"], origin=row["origin"])
        force = -0.981 * np.array(found["gravity"])
        np.testing.assert_allclose(found["f"], [*force, 0, 0, 0], atol=1e-12)
        assert_same(found, gf.solve(grasp.problem([*force, 0, 0, 0])))


def test_a_hand_asks_for_what_it_needs(hand_file, tmp_path):
    rng = np.random.default_rng(4)
    hand = gf.hands.from_mjcf(hand_file, ["tip1", "tip2", "tip3", "tip4"])
    rows, _ = held_rows(hand, 1, rng)
    source = written(tmp_path / "a.jsonl", rows)
    with pytest.raises(gf.InvalidInputError, match="fingertips: missing"):
        gd.solve_dataset(source, tmp_path / "out", hand=hand_file, mu=0.6)
    with pytest.raises((gf.InvalidInputError, gf.ModelImportError), match="nowhere"):
        gd.solve_dataset(source, tmp_path / "out", hand="nowhere.xml", fingertips=["a"], mu=0.6)
    for row in rows:
        row["fingertips"] = ["tip1", "tip2", "tip3", "tip4"]
    with_tips = table_of(
        written(tmp_path / "b.jsonl", rows), tmp_path / "b", hand=hand_file, mu=0.6
    )
    assert len(with_tips) == 1


# ---- wishes and derivatives --------------------------------------------------------------------


@pytest.fixture
def matrices(tmp_path):
    from graspforce.scenarios.random import grasps

    problems = grasps(12)
    columns = {
        name: [np.asarray(getattr(each, name)).tolist() for each in problems]
        for name in ("W", "f", "J", "mu", "alpha")
    }
    pq.write_table(pa.table(columns), tmp_path / "m.parquet")
    return tmp_path / "m.parquet", problems


@pytest.mark.parametrize(
    "wishes",
    [
        {"slip_reserve": 0.1},
        {"torque_reserve": 0.2},
        {"largest_normal": 4.0},
        {"slip_reserve": 0.05, "torque_reserve": 0.1, "largest_normal": 6.0},
    ],
)
def test_wishes_are_those_of_firmness(wishes, matrices, tmp_path):
    source, problems = matrices
    table = table_of(source, tmp_path / "out", tau_lo=-0.5, tau_hi=0.5, **wishes)
    met = 0
    for row, problem in zip(table.to_pylist(), problems, strict=True):
        grip = gf.firmness.choose(problem, **wishes)
        assert row["met"] == grip.met
        if not grip.met:
            assert row["status"] != "SOLVED"
            continue
        met += 1
        np.testing.assert_allclose(row["c"], grip.c, rtol=1e-6, atol=1e-7)
        own = gf.equations.friction_margins(np.array(row["c"]), problem.cones)
        np.testing.assert_allclose(row["friction_margins"], own, atol=1e-9)
        torques = np.minimum(0.5 - np.array(row["tau"]), np.array(row["tau"]) + 0.5)
        np.testing.assert_allclose(row["torque_margins"], torques, atol=1e-9)
    assert met


def test_a_multiple_of_the_least_force(matrices, tmp_path):
    source, problems = matrices
    table = table_of(source, tmp_path / "out", tau_lo=-0.5, tau_hi=0.5, times_least=2)
    for row, problem in zip(table.to_pylist(), problems, strict=True):
        grip = gf.firmness.choose(problem, times_least=2)
        assert row["met"] == grip.met
        np.testing.assert_allclose(row["alpha"], grip.alpha, rtol=1e-6)
        np.testing.assert_allclose(row["least"], grip.least, rtol=1e-6)
        np.testing.assert_allclose(row["c"], grip.c, rtol=1e-6, atol=1e-7)
        if grip.met:
            np.testing.assert_allclose(max(row["normal_forces"]), 2 * row["least"], rtol=0.02)


def test_derivatives_are_those_of_sensitivity(matrices, tmp_path):
    source, problems = matrices
    table = table_of(source, tmp_path / "out", tau_lo=-0.5, tau_hi=0.5, sensitivities=["f", "mu"])
    for row, problem in zip(table.to_pylist(), problems, strict=True):
        solution = gf.solve(problem)
        for name in ("f", "mu"):
            wanted = gf.sensitivity(solution).jacobian(name)
            found = np.array(row[f"dc_d{name}"]).reshape(wanted.shape)
            scale = np.abs(wanted).max()
            np.testing.assert_allclose(found / scale, wanted / scale, atol=1e-5)
