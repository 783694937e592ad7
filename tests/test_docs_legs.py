"""The snippets of docs/legs.md run as they stand, in one session."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import graspforce as gf

PAGE = Path(__file__).parents[1] / "docs" / "legs.md"


def test_the_snippets_run(tmp_path, monkeypatch, capsys):
    pytest.importorskip("pinocchio")
    import test_legs

    (tmp_path / "quadruped.urdf").write_text(test_legs.robot(test_legs.quadruped_parts()))
    (tmp_path / "biped.urdf").write_text(test_legs.robot(test_legs.biped_parts()))
    (tmp_path / "arms.urdf").write_text(test_legs.robot(test_legs.two_arms_parts()))
    monkeypatch.chdir(tmp_path)
    session: dict[str, object] = {}
    snippets = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert len(snippets) == 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for code in snippets:
            exec(compile(code, str(PAGE), "exec"), session)
            assert session["solution"].status is gf.Status.SOLVED
    assert "fl_knee" in capsys.readouterr().out
    assert np.abs(session["ahead"]) < 0.1
