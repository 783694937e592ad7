"""Every Python snippet of every page runs as it stands, and every program of the gallery."""

import re
import runpy

import numpy as np
import pytest
from models import paper_hand_urdf, paper_hand_xml
from pages import DOCS, PAGES, ROOT, blocks, run

import graspforce as gf

GALLERY = sorted((ROOT / "examples" / "gallery").rglob("*.py"))
CUBE = """<body name="cube" pos="0 0 .1"><freejoint/>
  <geom type="box" size=".0375 .0375 .0375" mass=".25"/></body>"""
# What a page's snippets need besides NumPy.
NEEDS = ("mujoco", "pinocchio", "warp", "clarabel", "pyarrow", "torch", "jax")
# These are run where their subject is tested, since their results are looked at further.
ELSEWHERE = ("README.md", "answers.md", "hands.md", "legs.md", "gpu.md", "simulation.md")
SNIPPETS = [page for page in PAGES if blocks(page, "python") and page.name not in ELSEWHERE]


def name_of(path):
    return str(path.relative_to(ROOT))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def require(text):
    for package in NEEDS:
        if re.search(rf"\b(import {package}|{package}\]|from_urdf|socp)\b", text):
            pytest.importorskip(package)


@pytest.mark.parametrize("page", SNIPPETS, ids=name_of)
def test_the_snippets_of_the_page_run(page, folder):
    require(page.read_text(encoding="utf-8"))
    run(page)


def test_the_pages_with_snippets_are_found():
    assert len(SNIPPETS) >= 18


def test_the_snippets_about_hands_run(folder, capsys):
    pytest.importorskip("mujoco")
    pytest.importorskip("pinocchio")
    reach = 0.0375 + 0.004 - 0.0002
    around = [[reach, 0, 0.1], [0, reach, 0.1], [-reach, 0, 0.1], [0, -reach, 0.1]]
    q = gf.hands.PaperHand("radial").inverse_kinematics(around)
    key = f'<keyframe><key qpos="{" ".join(map(str, q))} 0 0 .1 1 0 0 0"/></keyframe>'
    scene = paper_hand_xml(world=CUBE, extra=key, options='cone="elliptic"')
    (folder / "hand.xml").write_text(paper_hand_xml())
    (folder / "scene.xml").write_text(scene)
    (folder / "hand.urdf").write_text(paper_hand_urdf("radial"))
    page = DOCS / "hands.md"
    assert len(blocks(page, "python")) == 9
    session = run(page)
    assert session["solution"].status is gf.Status.SOLVED
    assert "finger1_knee" in capsys.readouterr().out
    assert session["data"].ctrl.any()


def test_the_snippets_about_legs_run(folder, capsys):
    pytest.importorskip("pinocchio")
    import test_legs  # which needs it, too

    for name in ("quadruped", "biped"):
        parts = getattr(test_legs, f"{name}_parts")()
        (folder / f"{name}.urdf").write_text(test_legs.robot(parts))
    (folder / "arms.urdf").write_text(test_legs.robot(test_legs.two_arms_parts()))
    page = DOCS / "legs.md"
    assert len(blocks(page, "python")) == 3
    session = run(page)
    assert session["solution"].status is gf.Status.SOLVED
    assert "fl_knee" in capsys.readouterr().out
    assert np.abs(session["ahead"]) < 0.1


@pytest.mark.parametrize("program", GALLERY, ids=name_of)
def test_the_programs_of_the_gallery_run(program, folder, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    plt = pytest.importorskip("matplotlib.pyplot")
    require(program.read_text(encoding="utf-8"))
    try:
        runpy.run_path(str(program), run_name="__main__")
        assert plt.get_fignums()  # a gallery's program draws
    except gf.errors.RenderError as error:
        pytest.skip(str(error))
    finally:
        plt.close("all")


def test_refined_grasps_climb_along_exact_slopes(monkeypatch):
    """The gallery's program with few grasps: slopes are differences of what they say."""
    pytest.importorskip("mujoco")
    plt = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    text = (ROOT / "examples" / "gallery" / "plot_refine_grasps.py").read_text(encoding="utf-8")
    run = {"__name__": "refine"}
    exec(text.replace("COUNT, MU, LIMIT, MASS = 1000", "COUNT, MU, LIMIT, MASS = 12"), run)
    plt.close("all")
    assert (run["margin"] > run["history"][0]).all()

    s, q, batch, _ = run["before"]
    half = run["half"]
    slope, ways = run["slopes"](s, half, q, batch)

    def soft_least(s):
        q_there, off = run["follow"](s, half, q, 4)
        assert off.max() < 1e-9
        margins = run["slip"](s, half, q_there)[0].friction_margins
        weights = np.exp(
            -8 * (batch.friction_margins - batch.friction_margins.min(axis=1)[:, None])
        )
        return (weights / weights.sum(axis=1, keepdims=True) * margins).sum(axis=1)

    for finger, way in ((0, 0), (3, 1)):
        ends = []
        for sign in (1, -1):
            there = s.copy()
            there[:, finger] += sign * 1e-4 * ways[:, finger, :, way]
            ends.append(soft_least(there / np.linalg.norm(there, axis=-1, keepdims=True)))
        expected = (ends[0] - ends[1]) / 2e-4
        np.testing.assert_allclose(slope[:, finger, way], expected, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=name_of)
def test_the_page_says_first_who_it_is_for(page):
    text = re.sub(r"^```\{index\}.*?^```$", "", page.read_text("utf-8"), flags=re.S | re.M)
    title, first = text.strip().split("\n\n")[:2]
    assert title.startswith("# ")
    assert re.match(r"\*For [^*]+\*", first)
