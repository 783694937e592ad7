"""The live page in a real browser: what is drawn, dragged and clicked, time, physics."""

import time

import numpy as np
import pytest
from browser import needs_browser
from live_page import (
    choose,
    clear,
    drag,
    is_drawn,
    number,
    picture,
    pixel,
    row,
    session,
    shown,
    turquoise,
    until,
)
from test_viewer import paper_mjcf

import graspforce as gf
from graspforce import sim, viewer
from graspforce.baselines import lp
from graspforce.viewer.scene import contact_forces

pytestmark = needs_browser


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
