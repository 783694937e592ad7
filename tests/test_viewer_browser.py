"""The live page in a real browser: every knob, the sentence and its remedies, several clients.

Needs Chromium or Chrome on the PATH; it is run without a screen and draws in software.
"""

import os
import re
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from browser import needs_browser
from test_viewer import paper_mjcf
from viser.transforms import SO3

import graspforce as gf
from graspforce import sim, viewer
from graspforce.baselines import lp
from graspforce.viewer import colours, export
from graspforce.viewer.scene import contact_forces
from graspforce.viewer.server import MOST_CLIENTS

pytestmark = needs_browser
PATIENCE = 60_000  # [ms]; a page draws slowly without a GPU on a busy machine


@pytest.fixture
def served(browser):
    """Return a function that serves a subject and opens a page on it."""
    opened = []

    def serve(subject, query="", pages=1):
        page = viewer.Viewer(subject, port=0)
        opened.append(page.stop)
        tabs = []
        for _ in range(pages):
            tab = open_tab(browser, page.link(page._knobs.from_query(query)) if query else page.url)
            opened.append(tab.close)
            tabs.append(tab)
        return page, *tabs

    yield serve
    for close in reversed(opened):
        close()


def open_tab(browser, url, wait=".gf-verdict"):
    tab = browser.new_page(viewport={"width": 640, "height": 400})
    tab.set_default_timeout(PATIENCE)
    tab.failures = []
    tab.on("pageerror", lambda error: tab.failures.append(str(error)))
    tab.goto(url)
    tab.wait_for_selector(wait)
    return tab


def row(tab, label):
    """Return the row of a knob by its label."""
    return tab.locator(f"label:text-is('{label}')").locator("xpath=ancestor::div[2]")


def enter(tab, label, value, index=-1):
    """Type a number into a knob's field."""
    inputs = row(tab, label).locator("input:not([type=hidden])")
    field = inputs.nth(inputs.count() + index if index < 0 else index)
    field.fill(str(value))
    field.press("Enter")


def choose(tab, label, option):
    """Choose from a list, opened again where an update of the page has closed it."""
    choice = tab.get_by_role("option", name=option, exact=True)

    def opened():
        if not choice.is_visible():
            row(tab, label).locator("input:not([type=hidden])").first.click()
            tab.wait_for_timeout(300)
        return choice.is_visible()

    until(opened, f"the choices of {label}")
    choice.click()


def shown(tab, name):
    return tab.locator(f".gf-{name}").first.inner_text().replace("\N{NO-BREAK SPACE}", " ")


def until(condition, what):
    deadline = time.monotonic() + PATIENCE / 1000
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.02)


def number(value, unit=""):
    return f"{value:.4g} {unit}".strip()


def session(page, index=0):
    return page.sessions[sorted(page.sessions)[index]]


def picture(tab):
    """Return the left half of what a tab shows, which is the scene's, as a PNG."""
    return tab.screenshot(clip={"x": 0, "y": 0, "width": 230, "height": 400}, timeout=PATIENCE)


def pixel(tab, live, point):
    """Return where a page draws a point of the scene."""
    camera, box = live._client.camera, tab.locator("canvas").first.bounding_box()
    x, y, z = SO3(camera.wxyz).as_matrix().T @ (np.asarray(point) - camera.position)
    height = box["height"] / (2 * np.tan(camera.fov / 2))
    return (
        box["x"] + box["width"] / 2 + height * x / z,
        box["y"] + box["height"] / 2 + height * y / z,
    )


def drag(tab, start, end):
    """Drag from a pixel to another, as slowly as a page without a GPU draws."""
    tab.mouse.move(*start)
    tab.wait_for_timeout(200)
    tab.mouse.down()
    tab.wait_for_timeout(200)
    tab.mouse.move(*end, steps=4)
    tab.wait_for_timeout(200)
    tab.mouse.up()


def clear(tab):
    """Close the browser's notice that it draws in software, which lies over the scene."""
    notice = tab.locator("[class*=Notification] button").first
    notice.click()
    notice.wait_for(state="hidden")


def turquoise(png):
    """Return how many pixels have the colour of another method's forces."""
    import imageio.v3

    r, g, b = np.moveaxis(imageio.v3.imread(png)[..., :3].astype(int), -1, 0)
    return int(((g - r > 40) & (abs(g - b) < 20)).sum())


def is_drawn(png):
    """Tell whether a picture has more on it than a background."""
    import imageio.v3

    pixels = imageio.v3.imread(png)[..., :3].astype(int)
    return pixels.std() > 5 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 200


def problem_of(subject, knobs):
    return subject.moment(knobs).problem


# ---- knobs --------------------------------------------------------------------------------------


def test_every_knob_changes_the_forces_as_solve_has_them(served):
    subject = viewer.open_subject("regrasp")
    page, tab = served(subject)

    def check(**expected):
        until(
            lambda: all(getattr(session(page).knobs, k) == v for k, v in expected.items()),
            f"{expected}, not {session(page).knobs}",
        )
        problem = problem_of(subject, session(page).knobs)
        largest = number(gf.solve(problem).normal_forces.max(), "N")
        until(lambda: shown(tab, "largest-normal") == largest, f"{largest} at {expected}")

    check(alpha=5.0)
    enter(tab, "alpha", 50)
    check(alpha=50.0)
    enter(tab, "Firm to light", 0)
    check(alpha=1.0)
    enter(tab, "Payload [kg]", 0.4)
    check(load=0.4)
    enter(tab, "Push [N]", 0.5, index=1)
    check(push=(0.0, 0.5, 0.0))
    enter(tab, "Gravity tilted [°]", 20)
    check(tilt=20.0)
    enter(tab, "towards [°]", 45)
    check(heading=45.0)
    enter(tab, "Object moved [m]", 0.003, index=2)
    check(move=(0.0, 0.0, 0.003))
    enter(tab, "Friction [times]", 1.2)
    check(friction=1.2)
    enter(tab, "Torque limits [times]", 0.9)
    check(torque=0.9)
    enter(tab, "Ceiling [N]", 15)
    check(ceiling=15.0)
    enter(tab, "finger 2", 0)
    check(engagement=(1.0, 0.0, 1.0, 1.0))
    enter(tab, "finger 2", 1)
    check(engagement=(1.0, 1.0, 1.0, 1.0))
    tab.get_by_role("tab", name="Time").click()
    enter(tab, "Time [s]", 0.3)
    check(time=0.3)
    tab.get_by_role("tab", name="Knobs").click()
    tab.get_by_role("button", name="Reset all knobs").click()
    check(alpha=5.0, load=0.25, time=0.0)
    assert not tab.failures


def test_a_larger_alpha_has_lighter_forces_and_numbers_are_those_of_solve(served):
    subject = viewer.open_subject("static")
    _, tab = served(subject)
    tab.get_by_role("tab", name="Numbers").click()
    forces = []
    for alpha in (0.1, 100):
        tab.get_by_role("tab", name="Knobs").click()
        enter(tab, "alpha", alpha)
        tab.get_by_role("tab", name="Numbers").click()
        sol = gf.solve(problem_of(subject, subject.knobs.changed(alpha=float(alpha))))
        for i, force in enumerate(sol.normal_forces, 1):
            until(lambda i=i, f=force: shown(tab, f"normal-{i}") == number(f), f"finger {i}")
        assert shown(tab, "steps") == str(sol.newton_steps)
        forces.append(sol.normal_forces.max())
    assert forces[1] < forces[0]


def test_a_wish_tells_the_firmness(served):
    page, tab = served(viewer.open_subject("static"))
    choose(tab, "Told by", "largest_normal")
    enter(tab, "Wish", 1.3)
    until(lambda: float(shown(tab, "largest-normal").split()[0]) <= 1.3, "a lighter grip")
    choose(tab, "Told by", "slip_reserve")  # 1.3 is no share
    tab.get_by_text("slip_reserve: got 1.3").first.wait_for()
    until(lambda: session(page).knobs.firmness == "largest_normal", "what was before")


def test_values_out_of_range_are_answered_by_a_sentence(served):
    page, tab = served(viewer.open_subject("static"))
    enter(tab, "alpha", 1e9)
    tab.get_by_text("expected 0.01 to 1e+06").first.wait_for()
    assert session(page).knobs.alpha <= 1e6
    enter(tab, "Object moved [m]", 0.5, index=2)
    tab.get_by_text("out of reach of finger").first.wait_for()
    until(lambda: session(page).knobs.move[2] < 0.5, "where the object was")


# ---- no ----------------------------------------------------------------------------------------


def test_an_overload_says_why_and_a_button_mends_it(served):
    page, tab = served(viewer.open_subject("static"))
    enter(tab, "Payload [kg]", 2)
    button = tab.get_by_role("button", name=re.compile("^Friction .* times as high"))
    button.wait_for()
    said = tab.locator(".gf-verdict").inner_text()
    assert "No contact force holds this load" in said
    assert "the friction of finger" in said
    # What is in conflict is red, and nothing else is in colour.
    cones = session(page)._scene._contacts._cones.batched_colors.tolist()
    red, grey = list(colours.rgb(colours.RED)), list(colours.rgb(colours.GREY))
    problem = problem_of(viewer.open_subject("static"), session(page).knobs)
    blamed = {each.index for each in gf.diagnose(problem).binding if each.kind == "friction"}
    assert {int(i) - 1 for i in re.findall("finger ([0-9])", said)} <= blamed
    assert cones == [red if i in blamed else grey for i in range(4)]
    button.click()
    tab.locator(".gf-largest-normal").wait_for()
    assert session(page).knobs.friction > 1
    assert gf.solve(problem_of(viewer.open_subject("static"), session(page).knobs)).status == (
        gf.Status.SOLVED
    )


# ---- scene, time, physics -----------------------------------------------------------------------


def test_the_canvas_is_not_blank(served):
    _, tab = served(viewer.open_subject("static"))
    until(lambda: is_drawn(picture(tab)), "a drawing")
    tab.get_by_role("tab", name="Colours").click()
    assert "friction, of the torque limit is used" in tab.inner_text("body")


def test_time_plays_and_stops(served):
    page, tab = served(viewer.open_subject("dynamic"))
    tab.get_by_role("tab", name="Time").click()
    row(tab, "Play").locator("input").check()
    until(lambda: session(page).knobs.time > 0.1, "the time to run")
    row(tab, "Play").locator("input").uncheck()
    until(lambda: not session(page)._playing, "the end of play")
    t = session(page).knobs.time
    time.sleep(0.3)
    assert session(page).knobs.time == t
    assert tab.locator("canvas").count() > 1  # the plot over time


def test_the_object_and_a_wrench_on_it_are_dragged(served):
    page, tab = served(viewer.open_subject("static"))
    live = session(page)
    clear(tab)
    row(tab, "Handles to drag").locator("input").check()
    until(lambda: live._gizmo is not None, "handles")
    tab.wait_for_timeout(500)
    origin, size = live._moment.origin, live._subject.size

    def at(x, z):
        return pixel(tab, live, origin + size * np.array([x, 0.0, z]))

    drag(tab, at(0.0, 0.85), at(0.0, 1.0))  # the arrow of z
    until(lambda: any(live.knobs.move), "the object to rise")
    tab.wait_for_timeout(500)
    x, y, z = live.knobs.move
    assert z == pytest.approx(0.15 * size, rel=0.2)
    assert abs(x) + abs(y) < 1e-9
    origin = live._moment.origin
    ring = [0.69 * np.array([np.cos(a), np.sin(a)]) for a in np.radians([70, 50])]
    drag(tab, at(*ring[0]), at(*ring[1]))  # that about y
    until(lambda: any(live.knobs.turn), "the object to turn")
    tab.wait_for_timeout(500)
    x, y, z = live.knobs.turn
    assert y == pytest.approx(np.radians(20), rel=0.3)
    assert abs(x) + abs(z) < 1e-9
    moment = live._subject.moment(live.knobs)
    assert shown(tab, "largest-normal") == number(gf.solve(moment.problem).normal_forces.max(), "N")
    row(tab, "Handles to drag").locator("input").uncheck()
    until(lambda: not live._gizmo.visible, "the end of the handles")
    # A push at the object's centre, then one where it is taken hold of.
    start = pixel(tab, live, live._moment.origin + 0.3 * size * np.array([-1.0, 0.0, -1.0]))
    drag(tab, start, (start[0] + 6, start[1]))
    until(lambda: any(live.knobs.push), "a push")
    assert live.knobs.twist == (0, 0, 0)
    tab.keyboard.down("Shift")
    drag(tab, start, (start[0] + 6, start[1]))
    tab.keyboard.up("Shift")
    until(lambda: any(live.knobs.twist), "a twist")
    push, twist = np.array(live.knobs.push), np.array(live.knobs.twist)
    arm = np.cross(push, twist) / (push @ push)  # the part of it across the push
    assert abs(push @ twist) < 1e-6 * np.linalg.norm(push) * np.linalg.norm(twist)
    assert 0.1 * size < np.linalg.norm(arm) < size
    assert arm @ (live._client.camera.position - live._moment.origin) > 0  # on the side in sight
    assert not tab.failures


def test_another_method_stands_beside_and_its_jumps_are_marked(served):
    page, tab = served(viewer.open_subject("regrasp"))
    live = session(page)
    clear(tab)
    until(lambda: is_drawn(picture(tab)), "a drawing")
    before = turquoise(picture(tab))
    choose(tab, "Compare with", "lp")
    until(lambda: live._scene._contacts._others.visible, "the other forces")
    forces = contact_forces(live._moment, lp.solve(live._moment.problem).c)
    arrows = live._scene._contacts._others.points
    assert np.allclose(
        arrows[:, 1] - arrows[:, 0], live._scene.metres_per_newton * forces, atol=1e-6
    )
    until(lambda: turquoise(picture(tab)) > before + 60, "arrows in turquoise")
    tab.get_by_role("tab", name="Time").click()
    until(lambda: len(live._timeline) == 2, "the other method's forces over time")
    wbf, other = live._timeline
    assert wbf.times.tolist() == other.times.tolist() == live._subject.times.tolist()
    jumps = other.jumps(max(wbf.largest, other.largest))
    assert len(jumps) > 5
    tab.get_by_text(f"WBF: none; lp: {len(jumps)}, the largest").wait_for()
    tab.get_by_text("jump of lp").first.wait_for()


def test_a_log_plays_and_a_hand_runs_live(served, tmp_path):
    (trial,) = sim.get("hold", duration=0.3)
    sim.run(trial).save(tmp_path / "log.npz")
    page, tab = served(viewer.open_subject("hold", tmp_path / "log.npz"))
    tab.get_by_role("tab", name="Physics").click()
    row(tab, "Play").locator("input").check()
    until(lambda: session(page).knobs.time > 0.05, "the time to run")
    row(tab, "Play").locator("input").uncheck()
    tab.get_by_text("Jumps from tick to tick").wait_for()
    tab.close()
    page, tab = served(viewer.open_subject("hand/panda"))
    tab.get_by_role("tab", name="Physics").click()
    row(tab, "Run live").locator("input").check()
    until(lambda: session(page)._loop is not None, "physics")
    until(lambda: session(page)._loop.tick.t > 0.02, "the hand to hold")
    assert session(page)._loop.ended == ""
    assert not tab.get_by_role("button", name="Lift it for a second").count()


def test_physics_is_pushed_by_dragging_the_object(served):
    page, tab = served(viewer.open_subject("hold"))
    tab.get_by_role("tab", name="Physics").click()
    row(tab, "Run live").locator("input").check()
    until(lambda: session(page)._loop is not None and session(page)._loop.tick.t > 0.02, "physics")
    rest = session(page)._loop.tick.origin
    box = tab.locator("canvas").first.bounding_box()
    # The object is in the middle of what the panel leaves free.
    x, y = box["x"] + box["width"] / 2, box["y"] + 0.45 * box["height"]
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 15, y, steps=5)
    until(lambda: np.linalg.norm(session(page).knobs.push) > 0, "a push")
    until(
        lambda: np.linalg.norm(session(page)._loop.tick.origin - rest) > 2e-4, "the object to move"
    )
    tab.mouse.up()
    until(lambda: session(page).knobs.push == (0, 0, 0), "the end of the push")
    tab.get_by_role("button", name="Lift it for a second").click()
    until(lambda: session(page)._loop.tick.problem.layout.ceilings, "the lift")
    tab.get_by_role("button", name="Begin again").click()
    until(lambda: session(page)._loop.tick.t < 0.5, "the beginning")


def test_a_click_on_the_object_is_a_contact(served, tmp_path):
    page, tab = served(paper_mjcf(tmp_path))
    assert "click on the object" in tab.locator(".gf-verdict").inner_text()
    box = tab.locator("canvas").first.bounding_box()
    until(lambda: is_drawn(picture(tab)), "a drawing")
    tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    until(lambda: len(session(page).knobs.picks) == 1, "a contact")
    tab.get_by_role("button", name="Let all fingers touch").click()
    tab.locator(".gf-largest-normal").wait_for()
    assert len(session(page).knobs.picks) == 4


# ---- files --------------------------------------------------------------------------------------


def test_the_grasps_of_a_file_are_gone_through_in_the_order_of_the_list(served):
    page, tab = served(viewer.open_subject("examples/several_grasps.json"))
    tab.locator(".gf-list").wait_for()
    tab.get_by_role("button", name="next").click()
    until(lambda: session(page).knobs.item == 1, "the next grasp")
    choose(tab, "Sort the list by", "margin")
    first = session(page)._order
    until(lambda: session(page)._order != list(range(len(first))), "another order")
    order = session(page)._order
    tab.get_by_role("button", name="next").click()
    until(lambda: session(page).knobs.item == order[(order.index(1) + 1) % len(order)], "the next")


# ---- several clients ----------------------------------------------------------------------------


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


# ---- sharing ------------------------------------------------------------------------------------


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


# ---- the command --------------------------------------------------------------------------------


def test_the_command_serves_until_ctrl_c_and_frees_its_port(browser):
    command = [sys.executable, "-m", "graspforce", "view", "static", "--set", "alpha=80"]
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        busy = subprocess.run([*command, "--port", str(port)], capture_output=True, text=True)
        assert busy.returncode == 2
        assert f"port: got {port} on 127.0.0.1, expected a free one" in busy.stderr
    with subprocess.Popen(
        [*command, "--port", "0"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as process:  # fmt: skip
        try:
            assert process.stdout.readline().startswith("static:")
            url = process.stdout.readline().split()[0]
            tab = open_tab(browser, url)
            assert shown(tab, "alpha") == "80"
            tab.close()
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 0
            assert process.stderr.read() == ""
        finally:
            process.kill()
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", int(url.rstrip("/").rsplit(":", 1)[1])))
