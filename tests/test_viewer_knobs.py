"""The live page in a real browser: every knob, the sentence and its remedies, files of grasps."""

import re
import threading

from browser import needs_browser
from live_page import choose, enter, number, problem_of, row, session, shown, until

import graspforce as gf
from graspforce import viewer
from graspforce.viewer import colours

pytestmark = needs_browser


# ---- knobs ---------------------------------------------------------------------------------------


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


def test_a_knob_turned_just_as_a_wait_ends_is_answered(served, monkeypatch):
    page, tab = served(viewer.open_subject("static"))
    turned = iter([10.0])

    class JustEnded(threading.Event):
        def wait(self, timeout=None):
            woken = super().wait(timeout)
            if not woken:
                for alpha in turned:
                    live.turn(alpha=alpha)
            return woken

    live, before = session(page), session(page)._wake
    monkeypatch.setattr(live, "_patience", lambda: 0.01)
    live._wake = JustEnded()
    before.set()
    until(lambda: shown(tab, "alpha") == "10", "alpha that was turned")


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
    field = row(tab, "alpha").locator("input").first
    until(lambda: field.input_value() == "5", "the value that was there")
    enter(tab, "Object moved [m]", 0.5, index=2)
    tab.get_by_text("out of reach of finger").first.wait_for()
    until(lambda: session(page).knobs.move[2] < 0.5, "where the object was")


# ---- no ------------------------------------------------------------------------------------------


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


# ---- files ---------------------------------------------------------------------------------------


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
