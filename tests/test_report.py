"""``reproduce``: everything is written, true, and readable without a network."""

import base64
import html.parser
import importlib
import json
import operator
import re
import sys
import xml.etree.ElementTree

import numpy as np
import pytest
from conftest import as_ordinary_user

import graspforce as gf
from graspforce import figures, scenarios
from graspforce._util import plot
from graspforce.study import compare, report
from graspforce.study.compare import methods
from graspforce.study.report import page

report_compared = report.COMPARED
COMPARED = ("dynamic",)  # the regrasp takes the slow methods too long for a test
TICKS = 4
PHYSICS = ("hold", "circle", "regrasp")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return the report's path and what the progress was told; the methods run a few ticks."""
    told = []
    whole = compare.task("dynamic")
    few = compare.Task(whole.name, whole.problems[:TICKS], whole.t[:TICKS])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "COMPARED", (few,))
        out = tmp_path_factory.mktemp("reproduce") / "not" / "there"
        path = report.reproduce(out, lambda *step: told.append(step))
    return path, told


@pytest.fixture(scope="module")
def results(made):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    text = (made[0].parent / "results.json").read_text(encoding="utf-8")
    return json.loads(text, parse_constant=refuse)


class Page(html.parser.HTMLParser):
    """The tags of a page; complains where one is closed that is not open."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.text = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def html_page(made):
    return Page(made[0].read_text(encoding="utf-8"))


def test_report_every_file_is_there_and_nothing_else(made, results):
    stems = [module.__name__.rpartition(".")[2] for module in figures.FIGURES]
    expected = {f"{stem}.{kind}" for stem in stems for kind in ("png", "svg")}
    expected |= {"grasp.png", "results.json", "report.html"}
    for task in COMPARED:
        expected |= {f"methods_forces_{task}.svg", f"methods_times_{task}.svg"}
    if not results["physics"]["no pictures"]:
        expected |= {f"physics_{name}.png" for name in PHYSICS}
    assert {path.name for path in made[0].parent.iterdir()} == expected
    for path in made[0].parent.glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    for path in made[0].parent.glob("*.svg"):
        assert xml.etree.ElementTree.parse(path).getroot().tag.endswith("svg")


def test_report_results_have_every_number(results):
    assert list(results["figures"]) == [str(number) for number in range(4, 13)]
    for entry in results["figures"].values():
        assert entry["claims"]
        assert entry["arrays"]
    assert set(results["scenarios"]) == {"static", "dynamic", "regrasp"}
    for run in results["scenarios"].values():
        assert run["ticks"] == run["ticks_solved"] == 500
        assert sum(run["ticks_by_newton_steps"].values()) == 500
    assert results["graspforce"] == gf.__version__
    assert {"cpu", "python", "numpy", "platform"} <= set(results["machine"])
    assert all(results["machine"].values())
    for name, times in results["timing"].items():
        if name != "passes":
            assert 0 < times["p50"] <= times["p99"]


def test_report_the_page_has_a_row_for_every_method(made, results):
    text = made[0].read_text(encoding="utf-8")
    rows = results["comparison"]["rows"]
    assert {row["method"] for row in rows} == set(methods.NAMES)
    for name in methods.NAMES:
        assert text.count(f"<tr><td>{name}</td>") == len(COMPARED)


def test_report_the_numbers_are_the_scenarios(results):
    sweep = gf.scenarios.sweep_alpha()
    arrays = results["figures"]["4"]["arrays"]
    np.testing.assert_array_equal(arrays["alpha"], sweep.alpha)
    np.testing.assert_array_equal(arrays["normal_forces"], sweep.normal_forces)
    steps = np.array(results["figures"]["12"]["arrays"]["newton_steps"])
    assert results["scenarios"]["regrasp"]["ticks_by_newton_steps"]["1"] == (steps == 1).sum()


def test_report_the_scenes_hold_in_physics(results, html_page):
    scenes = results["physics"]["scenes"]
    assert tuple(scenes) == PHYSICS
    for scene, millimetres in zip(scenes.values(), (0.1, 0.1, 0.3), strict=True):
        assert scene["verdict"] == "held"
        assert scene["ticks"] == scene["ticks_solved"] == 1000
        assert scene["largest position error [mm]"] <= millimetres
        assert scene["largest share of a torque limit"] < 1
    text = "".join(html_page.text)
    assert f"{scenes['circle']['largest position error [mm]']:.3f} mm" in text
    assert results["physics"]["no pictures"] in text


def test_report_without_opengl_the_page_says_why_it_has_no_pictures(monkeypatch):
    from graspforce import sim
    from graspforce.study.report import physics

    def refuse(*_):
        raise sim.RenderError("no OpenGL here")

    monkeypatch.setattr(sim, "save_still", refuse)
    monkeypatch.setattr(physics, "_SCENES", (("hold", 0.0),))
    monkeypatch.setattr(sim, "get", lambda name, get=sim.get: get(name, duration=0.01))
    results, pictures = physics.simulate(lambda *_: None)
    assert results["no pictures"] == "no OpenGL here"
    assert pictures == {}
    assert results["scenes"]["hold"]["ticks"] == 5


def test_report_the_page_loads_nothing(html_page):
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in html_page.tags}
    for _, attributes in html_page.tags:
        for name in ("src", "srcset", "data", "poster"):
            assert attributes.get(name, "data:").startswith("data:")
        assert attributes.get("href", "#").startswith("#")
    assert not re.search(r"url\(|@import", "".join(html_page.text))


def test_report_the_page_is_well_formed_and_its_links_lead_somewhere(html_page):
    assert html_page.open == []
    ids = [attributes["id"] for _, attributes in html_page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    for tag, attributes in html_page.tags:
        if tag == "a":
            assert attributes["href"][1:] in ids


def test_report_the_page_shows_every_figure_as_it_was_written(made, html_page):
    images = [attributes for tag, attributes in html_page.tags if tag == "img"]
    assert all(image["alt"] for image in images)
    inlined = {base64.b64decode(image["src"].partition(",")[2]) for image in images}
    files = [*made[0].parent.glob("*.svg"), *made[0].parent.glob("*.png")]
    files = [file for file in files if not re.match(r"fig\d+.*\.png", file.name)]
    assert len(files) >= 10 + 2 * len(COMPARED)
    assert inlined == {file.read_bytes() for file in files}


def test_report_the_page_sets_every_claim_beside_its_measurement(made, results):
    text = made[0].read_text(encoding="utf-8")
    claims = [claim for entry in results["figures"].values() for claim in entry["claims"]]
    claims += results["comparison"]["claims"]
    for claim in claims:
        paper, measured = page.typeset(claim["paper"]), page.typeset(claim["measured"])
        verdict = rf"\s*<span class=\"{'yes' if claim['holds'] else 'no'}\">\w+</span>\s*"
        row = f"<td>{re.escape(paper)}</td><td>{verdict}{re.escape(measured)}</td>"
        assert re.search(row, text), measured
    assert text.count('<span class="yes">') == sum(claim["holds"] is True for claim in claims)
    assert "700&nbsp;µs" in text
    assert results["machine"]["cpu"] in text


def test_report_progress_goes_up_stage_by_stage(made):
    stages = {}
    for stage, done, total in made[1]:
        assert stage not in stages or stage == list(stages)[-1]
        before = stages.get(stage, (0, total))
        assert before[0] <= done <= total == before[1]
        stages[stage] = (done, total)
    assert {"static", "dynamic", "regrasp", "figures"} <= set(stages)
    assert all(done == total for done, total in stages.values())


@pytest.mark.parametrize("where", ["taken", "taken/below"])
def test_report_a_file_in_the_way_is_refused_before_any_work(tmp_path, monkeypatch, where):
    (tmp_path / "taken").write_text("mine")
    monkeypatch.setattr(scenarios, "run", lambda *_, **__: pytest.fail("worked before it looked"))
    with pytest.raises(gf.InvalidInputError, match=r"out: got .*taken.* expected a folder"):
        report.reproduce(tmp_path / where)
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize("name", ["results.json", "report.html"])
def test_report_a_folder_in_the_place_of_a_file_is_refused_before_any_work(
    tmp_path, monkeypatch, name
):
    (tmp_path / name).mkdir()
    monkeypatch.setattr(scenarios, "run", lambda *_, **__: pytest.fail("worked before it looked"))
    with pytest.raises(gf.InvalidInputError, match=f"{name}: got a directory, expected a file"):
        report.reproduce(tmp_path)


def test_report_a_read_only_folder_is_refused(sealed_folder, monkeypatch):
    monkeypatch.setattr(scenarios, "run", lambda *_, **__: pytest.fail("worked before it looked"))
    refused = r"expected a folder to write into \(Permission"
    plot.new_figure()  # these import what a report is made with
    page.template()
    importlib.import_module("graspforce.study.report.physics")
    with pytest.raises(gf.InvalidInputError, match=refused), as_ordinary_user():
        report.reproduce(sealed_folder)


@pytest.mark.parametrize(
    ("module", "package"), [("matplotlib.figure", "matplotlib"), ("jinja2",) * 2]
)
def test_report_a_missing_extra_is_named_before_any_work(tmp_path, monkeypatch, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(scenarios, "run", lambda *_, **__: pytest.fail("worked before it looked"))
    with pytest.raises(gf.MissingExtraError, match=rf"pip install .*'{package}>="):
        report.reproduce(tmp_path / "results")
    assert not (tmp_path / "results").exists()


def test_report_the_paper_tasks_are_all_compared():
    assert set(report_compared) == {"static", "dynamic", "regrasp"}


def test_report_the_table_of_equations_names_what_there_is():
    numbers = set()
    for equations, _, where in page.EQUATIONS:
        numbers |= {int(number) for number in equations.split(",")}
        assert callable(operator.attrgetter(where)(gf))
    assert numbers == set(range(1, 23)) - {4}  # (4) is the problem without its objective


def test_report_typeset_sets_indices_and_escapes_the_rest():
    assert page.typeset("r_f < 2 N") == "<i>r</i><sub>f</sub> &lt; 2&nbsp;N"
    assert page.typeset("w_1 = 1e-09") == "<i>w</i><sub>1</sub>&nbsp;=&nbsp;10<sup>−9</sup>"


def test_report_numbers_that_json_lacks_become_null():
    text = report.json_text(
        report.json_types({"a": np.array([1.0, np.inf, np.nan]), "b": np.int64(3)})
    )
    assert json.loads(text) == {"a": [1.0, None, None], "b": 3}
