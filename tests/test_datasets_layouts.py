"""Published layouts of data sets: rows of our own making, saved as their projects save them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import graspforce as gf

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
gd = pytest.importorskip("graspforce.datasets")

# Four fingertips that slide towards the middle, from 50 mm, along x and y of the hand.
DIRECTIONS = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
TIP, HALF = 0.005, 0.02


def text(vector):
    return " ".join(map(str, vector))


@pytest.fixture
def hand_file(tmp_path):
    pytest.importorskip("mujoco")
    fingers = "".join(
        f"""<body name="finger{i}" pos="{text(0.05 * d)}">
          <joint name="robot0:slide{i}" type="slide" axis="{text(-d)}" range="0 .05"/>
          <geom type="sphere" size="{TIP}" mass=".01"/>
        </body>"""
        for i, d in enumerate(DIRECTIONS)
    )
    motors = "".join(
        f'<motor name="m{i}" joint="robot0:slide{i}" ctrlrange="-9 9"/>' for i in range(4)
    )
    path = tmp_path / "hand.xml"
    path.write_text(
        f"""<mujoco><compiler autolimits="true"/><worldbody>
        <body name="palm" pos="0 0 0"><geom type="box" size=".05 .05 .005" pos="0 0 -.2"/>{fingers}
        </body></worldbody><actuator>{motors}</actuator></mujoco>"""
    )
    return path


def box_mesh(path, *centres):
    """Write boxes of unit half length as one OBJ file."""
    lines = []
    faces = ["132", "243", "586", "578", "162", "156", "348", "387", "137", "175", "268", "284"]
    for n, centre in enumerate(centres):
        corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        lines += [f"v {text(np.add(corner, centre))}" for corner in corners]
        lines += [f"f {text(8 * n + np.array([*map(int, face)]))}" for face in faces]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def dexgraspnet_row(rotation, place, gaps):
    """A grasp of a box of 20 mm half length whose fingertips keep these gaps to it [m]."""
    angles = dict(zip(("WRJRx", "WRJRy", "WRJRz"), rotation.as_euler("xyz"), strict=True))
    angles |= dict(zip(("WRJTx", "WRJTy", "WRJTz"), place, strict=True))
    angles |= {f"robot0:slide{i}": 0.05 - TIP - HALF - gap for i, gap in enumerate(gaps)}
    return {"qpos": angles, "scale": HALF}


def rejects(target):
    lines = [
        json.loads(line)
        for path in (target / "rejects").glob("*")
        for line in path.read_text().splitlines()
    ]
    return {line["row"]: line["reason"] for line in lines}


@pytest.mark.parametrize("where", ["thing/coacd/decomposed.obj", "thing.obj"])
def test_dexgraspnet_finds_contacts_between_hand_and_mesh(where, hand_file, tmp_path):
    pytest.importorskip("trimesh")
    box_mesh(tmp_path / "meshes" / where, (0, 0, 0))
    # The hand's z stays along the box's: a quarter and a half turn about it.
    turns = [Rotation.identity(), Rotation.from_euler("z", 90, degrees=True),
             Rotation.from_euler("xyz", [180, 0, 0], degrees=True)]  # fmt: skip
    rows = [dexgraspnet_row(turn, (0, 0, 0.003), [0.001, -0.0005, 0.001, 0.002]) for turn in turns]
    rows.append(dexgraspnet_row(turns[0], (0, 0, 0), [0.001, 0.004, 0.001, 0.02]))
    rows.append(dexgraspnet_row(turns[0], (0, 0, 0.3), [0.001] * 4))
    rows.append({"qpos": {}, "scale": 1.0})
    (tmp_path / "poses").mkdir()
    np.save(tmp_path / "poses" / "thing.npy", np.array(rows, dtype=object), allow_pickle=True)
    gd.solve_dataset(
        tmp_path / "poses", tmp_path / "out", layout="dexgraspnet", hand=hand_file,
        meshes=tmp_path / "meshes", mu=0.8, mass=0.1,
    )  # fmt: skip
    table = pq.read_table(tmp_path / "out").to_pylist()
    assert [row["row"] for row in table] == [0, 1, 2, 3]
    assert [len(row["normal_forces"]) for row in table] == [4, 4, 4, 3]
    said = "hand model and object mesh, within 0.005 m"
    assert {row["contacts_from"] for row in table} == {said}
    np.testing.assert_allclose(
        table[0]["contact_distances"], [0.001, -0.0005, 0.001, 0.002], atol=1e-6
    )
    for row, turn in zip(table[:3], turns, strict=True):
        assert row["status"] == "SOLVED"
        assert row["object_code"] == "thing"
        np.testing.assert_allclose(
            row["points"] - np.array([0, 0, 0.003]), turn.apply(HALF * DIRECTIONS), atol=1e-5
        )
        np.testing.assert_allclose(row["normals"], turn.apply(-DIRECTIONS), atol=1e-3)
        assert row["fingertips"] == ["finger0", "finger1", "finger2", "finger3"]
        wrench = np.zeros(6)
        geometry = zip(row["points"], row["normals"], strict=True)
        for (point, normal), force in zip(geometry, np.reshape(row["c"], (-1, 3)), strict=True):
            push = gf.Contact(point, normal, gf.PCWF(0.8)).frame @ force
            wrench += np.append(push, np.cross(point, push))
        np.testing.assert_allclose(wrench, [0, 0, 0.981, 0, 0, 0], atol=1e-5)
    reasons = rejects(tmp_path / "out")
    assert "no link of the hand is within 5 mm" in reasons[4]
    assert "WRJTx: missing" in reasons[5]


def test_meshes_are_read_as_the_pieces_that_hang_together(tmp_path):
    pytest.importorskip("trimesh")
    from graspforce.datasets.proximity import read_mesh

    box_mesh(tmp_path / "two.obj", (0, 0, 0), (5, 0, 0))
    one, other = sorted(read_mesh(str(tmp_path / "two.obj")), key=lambda piece: piece[0, 0])
    np.testing.assert_allclose(one.mean(axis=0), [0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(other.mean(axis=0), [5, 0, 0], atol=1e-12)
    assert len(one) == len(other) == 8
    (tmp_path / "none.obj").write_text("no mesh")
    with pytest.raises(gf.InvalidInputError, match=r"none\.obj"):
        read_mesh(str(tmp_path / "none.obj"))


def bodex_file(path, rng, count=5, **changes):
    """A file of grasps of a ball of 30 mm at (0.1, 0.2, 0.3) by four contacts."""
    base = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5
    out = Rotation.random(count, random_state=rng).as_matrix() @ base.T
    out = np.moveaxis(out, 1, 2)
    centre = np.array([0.1, 0.2, 0.3])
    frames = np.empty((count, 4, 3, 3))
    for i in range(count):
        for j in range(4):
            frames[i, j] = gf.Contact((0, 0, 0), -out[i, j], gf.PCWF(1)).frame
    pose = np.zeros((1, count, 3, 7 + 4))
    pose[..., 3] = 1
    pose[..., :3] = centre
    pose[..., 7:] = 0.05 - TIP - 0.03
    placed = {"scale": [0.06] * 3, "pose": [*centre, 1, 0, 0, 0]}
    content = {
        "robot_pose": pose,
        "joint_names": [f"slide{i}" for i in range(4)],
        "contact_point": (centre + 0.03 * out)[None].astype(np.float32),
        "contact_frame": frames[None].astype(np.float32),
        "manip_name": ["scene_ball"],
        "world_cfg": [{"mesh": {"scene_ball": placed}}],
    } | changes
    np.save(path, {name: value for name, value in content.items() if value is not None})
    return out


def test_bodex_brings_its_contacts(tmp_path):
    out = bodex_file(tmp_path / "ball_grasp.npy", np.random.default_rng(3))
    gd.solve_dataset(
        tmp_path / "ball_grasp.npy", tmp_path / "out", layout="bodex", mu=0.8, mass=0.2, c_max=10
    )
    table = pq.read_table(tmp_path / "out").to_pylist()
    assert {row["contacts_from"] for row in table} == {"stored"}
    assert {row["object_code"] for row in table} == {"scene_ball"}
    for row, directions in zip(table, out, strict=True):
        contacts = [gf.Contact(0.03 * d, -d, gf.PCWF(0.8)) for d in directions]
        problem = gf.Grasp(contacts).problem([0, 0, 0.2 * 9.81, 0, 0, 0], c_max=10)
        sol = gf.solve(problem)
        assert row["status"] == sol.status.name
        np.testing.assert_allclose(row["normal_forces"], sol.normal_forces, rtol=1e-3)


def test_bodex_takes_the_joints_of_its_hand(hand_file, tmp_path):
    bodex_file(tmp_path / "ball.npy", np.random.default_rng(3), count=2)
    gd.solve_dataset(
        tmp_path / "ball.npy", tmp_path / "out", layout="bodex", mu=0.8, mass=0.2, c_max=10,
        hand=hand_file, fingertips=[f"finger{i}" for i in range(4)],
    )  # fmt: skip
    table = pq.read_table(tmp_path / "out")
    assert [len(tau) for tau in table["tau"].to_pylist()] == [4, 4]


class Evil:
    def __reduce__(self):
        return (print, ("unpickled",))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"contact_point": Evil()}, "asks for builtins.print; only arrays are unpickled"),
        ({"contact_frame": None}, "contact_frame: missing"),
        ({"contact_point": np.zeros((2, 3))}, "contact_point: got shape"),
    ],
)
def test_files_that_are_not_of_the_layout(content, said, tmp_path, capfd):
    bodex_file(tmp_path / "ball.npy", np.random.default_rng(3), **content)
    with pytest.raises(gf.InvalidInputError) as raised:
        gd.solve_dataset(tmp_path / "ball.npy", tmp_path / "out", layout="bodex", mu=1, mass=1)
    assert said in str(raised.value)
    assert "unpickled\n" not in capfd.readouterr().out


def test_a_layout_has_to_be_named_and_known(hand_file, tmp_path):
    np.save(tmp_path / "thing.npy", np.array([{"qpos": {}}], dtype=object), allow_pickle=True)
    with pytest.raises(gf.InvalidInputError, match="name its layout"):
        gd.solve_dataset(tmp_path / "thing.npy", tmp_path / "out")
    with pytest.raises(gf.InvalidInputError, match="layout: got 'dexonomy'"):
        gd.solve_dataset(tmp_path / "thing.npy", tmp_path / "out", layout="dexonomy")
    with pytest.raises(gf.InvalidInputError, match="hand: missing; contacts are not stored"):
        gd.solve_dataset(tmp_path / "thing.npy", tmp_path / "out", layout="dexgraspnet")
