"""The live page in a real browser: several clients, links, downloads."""

import time

import pytest
from browser import needs_browser
from live_page import PATIENCE, enter, is_drawn, open_tab, picture, row, session, shown, until

from graspforce import viewer
from graspforce.viewer import export
from graspforce.viewer.server import MOST_CLIENTS

pytestmark = needs_browser


# ---- several clients -----------------------------------------------------------------------------


def test_two_clients_have_knobs_of_their_own(served):
    page, one, two = served(viewer.open_subject("static"), pages=2)
    before = shown(two, "largest-normal")
    enter(one, "alpha", 500)
    until(lambda: shown(one, "largest-normal") != before, "the first page")
    time.sleep(0.3)
    assert shown(two, "largest-normal") == before
    assert session(page, 0).knobs.alpha == 500
    assert session(page, 1).knobs.alpha == 5


def test_a_tab_that_closes_during_a_drag_frees_its_session(served):
    page, tab = served(viewer.open_subject("static"))
    slider = row(tab, "Payload [kg]").locator("[role=slider]").bounding_box()
    thread = session(page)._thread
    tab.mouse.move(slider["x"] + 2, slider["y"] + 2)
    tab.mouse.down()
    for k in range(10):
        tab.mouse.move(slider["x"] + 5 * k, slider["y"] + 2)
    tab.close()
    until(lambda: not page.sessions, "the end of the session")
    until(lambda: not thread.is_alive(), "the end of its thread")


def test_more_clients_than_are_served_are_told(served, browser, monkeypatch):
    monkeypatch.setattr("graspforce.viewer.server.MOST_CLIENTS", 1)
    page, _ = served(viewer.open_subject("static"))
    tab = open_tab(browser, page.url, wait="text=pages are open already")
    assert len(page.sessions) == 1
    tab.close()
    assert MOST_CLIENTS > 1


# ---- sharing -------------------------------------------------------------------------------------


def test_a_link_opens_with_its_knobs(served):
    subject = viewer.open_subject("static")
    page, tab = served(subject, query="alpha=250&friction=1.5&engagement=[0]")
    knobs = session(page).knobs
    assert (knobs.alpha, knobs.friction, knobs.engagement) == (250, 1.5, (0,))
    tab.get_by_role("tab", name="Share").click()
    tab.get_by_role("button", name="Make the link").click()
    link = row(tab, "Link to these knobs").locator("input").first
    until(lambda: "alpha" in link.input_value(), "the link")
    assert link.input_value() == page.link(knobs)


def test_a_link_with_a_wrong_knob_says_so(served, browser):
    page, _ = served(viewer.open_subject("static"))
    wrong = page.link(page._knobs.changed(alpha=7.0)).replace("alpha%3D7.0", "alpha%3D-7")
    other = open_tab(browser, wrong)
    other.get_by_text("alpha: got -7").first.wait_for()
    other.close()


def test_an_export_opens_from_disk_without_a_network(browser, tmp_path):
    subject = viewer.open_subject("dynamic")
    path = tmp_path / "grasp.html"
    path.write_text(export.html(subject, subject.knobs, moving=True))
    context = browser.new_context(offline=True, viewport={"width": 640, "height": 400})
    try:
        tab = context.new_page()
        asked = []
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(path.as_uri())
        tab.wait_for_selector("canvas", timeout=PATIENCE)
        until(lambda: is_drawn(picture(tab)), "a drawing")
        assert all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    finally:
        context.close()


@pytest.mark.parametrize(
    ("button", "suffix"), [("Picture (.png)", ".png"), ("Page (.html)", ".html")]
)
def test_what_is_shared_is_downloaded(served, button, suffix):
    _, tab = served(viewer.open_subject("examples/nose_cone.json"))
    tab.get_by_role("tab", name="Share").click()
    with tab.expect_download(timeout=PATIENCE) as download:
        tab.get_by_role("button", name=button).click()
    assert download.value.suggested_filename.endswith(suffix)
    with open(download.value.path(), "rb") as file:
        content = file.read()
    assert is_drawn(content) if suffix == ".png" else b"__VISER_EMBED_DATA__" in content
