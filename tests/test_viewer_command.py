"""The command ``graspforce view``, and pages of hands that have yet to close."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager

from browser import needs_browser
from live_page import (
    enter,
    is_drawn,
    number,
    open_tab,
    picture,
    problem_of,
    session,
    shown,
    until,
)  # fmt: skip

import graspforce as gf
from graspforce import viewer

pytestmark = needs_browser


COMMAND = (sys.executable, "-m", "graspforce", "view")
OUT_OF_REACH = """<mujoco><worldbody>
  <body name="finger" pos="-.08 0 0">
    <joint name="slide" type="slide" axis="1 0 0" range="0 .02" limited="true"/>
    <geom type="sphere" size=".01"/></body>
  <body name="cube"><freejoint/><geom type="box" size=".02 .02 .02" mass=".1"/></body>
</worldbody><actuator><motor joint="slide" ctrlrange="-9 9"/></actuator></mujoco>"""


@contextmanager
def command(*arguments):
    """Run the command; give its process, what it says first, and the address of its page."""
    with subprocess.Popen(
        [*COMMAND, *arguments, "--port", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as process:  # fmt: skip
        try:
            said = process.stdout.readline()
            yield process, said, process.stdout.readline().split()[0]
        finally:
            process.kill()


def test_the_command_serves_until_ctrl_c_and_frees_its_port(browser):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        busy = subprocess.run(
            [*COMMAND, "static", "--port", str(port)], capture_output=True, text=True
        )
        assert busy.returncode == 2
        assert f"port: got {port} on 127.0.0.1, expected a free one" in busy.stderr
    with command("static", "--set", "alpha=80") as (process, said, url):
        assert said.startswith("static:")
        tab = open_tab(browser, url)
        assert shown(tab, "alpha") == "80"
        tab.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        assert process.stderr.read() == ""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", int(url.rstrip("/").rsplit(":", 1)[1])))


def test_a_page_turns_from_the_open_hand_to_the_held_grasp(served, caplog):
    look, finish = viewer.begin_subject("hand/panda")
    page, tab, other = served(look, query="load=0.3", pages=2)
    for each in (tab, other):
        assert "The hand closes on the object" in each.locator(".gf-verdict").inner_text()
        assert each.get_by_role("tab").count() == 0
    until(lambda: is_drawn(picture(tab)), "the open hand")
    other.close()
    until(lambda: len(page._clients) == 1, "the other page's end")
    page.turn_to(look.failing("finger 2 is 12 mm away"))
    tab.get_by_text("Not held. finger 2 is 12 mm away").wait_for()
    subject = finish()
    page.turn_to(subject)
    tab.locator(".gf-largest-normal").wait_for()
    assert tab.locator(".gf-verdict").count() == 1
    assert session(page).knobs.load == 0.3
    solution = gf.solve(problem_of(subject, session(page).knobs))
    assert shown(tab, "largest-normal") == number(solution.normal_forces.max(), "N")
    enter(tab, "Payload [kg]", 0.1)
    until(lambda: session(page).knobs.load == 0.1, "a knob that is turned")
    assert not tab.failures
    assert not caplog.records


def test_a_hand_that_does_not_hold_is_told_on_the_page_and_on_the_terminal(browser, tmp_path):
    (tmp_path / "one.xml").write_text(OUT_OF_REACH)
    with command("--model", str(tmp_path / "one.xml"), "--object", "cube") as (process, _, url):
        tab = open_tab(browser, url, wait="text=nothing touches 'cube': finger is")
        assert process.poll() is None  # until somebody has read it
        tab.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 2
        (said,) = process.stderr.read().splitlines()
        assert said.startswith("graspforce: start: the hand closed and nothing touches 'cube'")


def test_ctrl_c_ends_a_hand_that_closes():
    with command("hand/inspire") as (process, said, _):
        assert "the hand closes on the object" in said
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        assert process.stderr.read() == ""
