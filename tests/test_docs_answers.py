"""docs/answers.md prints what it shows."""

import doctest
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_the_page_runs_as_it_stands(monkeypatch):
    monkeypatch.chdir(ROOT)
    flags = doctest.NORMALIZE_WHITESPACE | doctest.REPORT_NDIFF
    page = str(ROOT / "docs" / "answers.md")
    found = doctest.testfile(page, module_relative=False, optionflags=flags, encoding="utf-8")
    assert found.attempted > 20
    assert found.failed == 0
