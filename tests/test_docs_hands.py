"""The snippets of docs/hands.md run as they stand, in one session."""

import re
import warnings
from pathlib import Path

import pytest
from models import paper_hand_urdf, paper_hand_xml

import graspforce as gf

PAGE = Path(__file__).parents[1] / "docs" / "hands.md"
CUBE = """<body name="cube" pos="0 0 .1"><freejoint/>
  <geom type="box" size=".0375 .0375 .0375" mass=".25"/></body>"""


def test_the_snippets_run(tmp_path, monkeypatch, capsys):
    pytest.importorskip("mujoco")
    pytest.importorskip("pinocchio")
    reach = 0.0375 + 0.004 - 0.0002
    around = [[reach, 0, 0.1], [0, reach, 0.1], [-reach, 0, 0.1], [0, -reach, 0.1]]
    q = gf.hands.PaperHand("radial").inverse_kinematics(around)
    key = f'<keyframe><key qpos="{" ".join(map(str, q))} 0 0 .1 1 0 0 0"/></keyframe>'
    scene = paper_hand_xml(world=CUBE, extra=key, options='cone="elliptic"')
    (tmp_path / "hand.xml").write_text(paper_hand_xml())
    (tmp_path / "scene.xml").write_text(scene)
    (tmp_path / "hand.urdf").write_text(paper_hand_urdf("radial"))
    monkeypatch.chdir(tmp_path)
    session: dict[str, object] = {}
    snippets = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert len(snippets) == 9
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for code in snippets:
            exec(compile(code, str(PAGE), "exec"), session)
    assert session["solution"].status is gf.Status.SOLVED
    assert "finger1_knee" in capsys.readouterr().out
    assert session["data"].ctrl.any()
