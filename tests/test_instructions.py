"""The instruction count: what it runs, and how it reads what Valgrind writes."""

import sys
from pathlib import Path

from graspforce.compare import NAMES

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import instructions


def test_every_method_is_counted_and_the_core_alone():
    found = {name.split("|")[0] for name, _, _ in instructions.works()}
    assert set(NAMES) <= found
    assert {"wbf, C++ alone", "socp_norm, qoco", "socp_norm, scs"} <= found


def test_a_work_runs_as_many_ticks_as_it_says():
    works = {name: (count, prepare) for name, count, prepare in instructions.works()}
    count, prepare = works["socp_norm, qoco|False"]
    assert len(prepare()(count)) == count
    count, prepare = works["wbf, C++ alone|True"]
    assert len(prepare()(2 * count)) == 2 * count


def test_totals_of_callgrind_files(tmp_path):
    file = tmp_path / "1"
    file.write_text("# callgrind format\nsummary: 5\n\nfn=(1)\n1 7\ntotals: 123456\n")
    assert instructions._total(file) == 123456
