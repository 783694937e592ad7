"""The live page under a hand that never rests, and how fast it answers.

    python benchmarks/viewer.py                         # 20,000 random turns of knobs, in a browser
    python benchmarks/viewer.py --turns 0 --clients 3   # the times alone
    python benchmarks/viewer.py --save benchmarks/results/viewer.txt

Needs the extra test and Chromium or Chrome on the PATH. Fails on an exception on the page or in the
server, on a turn without an answer, on more than 50 MB of growth, and on threads that are left
over.
"""

from __future__ import annotations

import argparse
import logging
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import psutil
import viser
from playwright.sync_api import Browser, Page, sync_playwright

from graspforce import sim, viewer
from graspforce.viewer.scene import quiet

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = [
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
MOST_GROWTH = 50.0  # [MB]
PATIENCE = 30.0  # [s]
ALPHA = "label:text-is('alpha')"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=20_000)
    parser.add_argument("--clients", type=int, default=3, help="of the last of the times")
    parser.add_argument("--save", type=Path)
    chosen = parser.parse_args()
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit(f"no browser: none of {', '.join(BROWSERS)} is on the PATH")
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=browser, args=FLAGS)
        lines = [
            f"{platform.machine()}, {psutil.cpu_count()} cores, load {psutil.getloadavg()[0]:.1f}, "
            f"Python {platform.python_version()}, {date.today()}, software rendering, 640 × 400",
            *times(launched, chosen.clients),
        ]
        failures: list[str] = []
        if chosen.turns:
            said, failures = soak(launched, chosen.turns)
            lines += said
        launched.close()
    text = "\n".join([*lines, *failures]) + "\n"
    print(text, end="")
    if chosen.save is not None and not failures:
        chosen.save.write_text(text)
    return bool(failures)


def opened(browser: Browser, url: str, wait: str = ".gf-largest-normal") -> Page:
    tab = browser.new_page(viewport={"width": 640, "height": 400})
    tab.set_default_timeout(120_000)
    tab.goto(url)
    tab.wait_for_selector(wait)
    return tab


# ---- how fast -----------------------------------------------------------------------------------


def times(browser: Browser, clients: int) -> list[str]:
    """Return how long the command takes to a page, a knob to a number, and redraws a second."""
    with tempfile.TemporaryDirectory() as folder:
        up = [
            (kind, [_page_up(browser, *arguments) for _ in range(3)])
            for kind, *arguments in _kinds(Path(folder))
        ]
    empty = statistics.median(_empty_page_up(browser) for _ in range(3))
    page = viewer.Viewer(viewer.open_subject("static"), port=0)
    tabs = [opened(browser, page.url)]
    (session,) = page.sessions.values()
    time.sleep(1)
    server = [_server_time(session, 5 + 0.01 * k) for k in range(200)]
    tabs[0].wait_for_function("document.querySelector('.gf-alpha')?.innerText === '6.99'")
    answers = [_answer_time(tabs[0], 10 + k) for k in range(50)]
    rates = [_redraws(page, 1)]
    tabs += [opened(browser, page.url) for _ in range(clients - 1)]
    rates.append(_redraws(page, clients))
    for tab in tabs:
        tab.close()
    page.stop()
    return [
        "command to page         median of 3, and the processor time until its address is told",
        f"  an empty page of viser  {empty:.2f} s without a command",
        *(
            f"  {kind:<24}{statistics.median(wall for wall, _ in times):.2f} s, "
            f"{statistics.median(cpu for _, cpu in times):.2f} s"
            for kind, times in up
        ),
        f"knob to number shown    median {1e3 * statistics.median(answers):.0f} ms, p90 "
        f"{1e3 * float(np.quantile(answers, 0.9)):.0f} ms",
        f"of it in the server     median {1e3 * statistics.median(server):.1f} ms of CPU",
        f"redraws a second        {rates[0]:.0f} with one client, {rates[1]:.0f} each with "
        f"{clients}",
    ]


def _kinds(folder: Path) -> list[tuple[str, ...]]:
    """Return every kind of thing that a page shows, and the command's arguments for it."""
    scene, log = str(folder / "scene.xml"), str(folder / "hold.npz")
    mujoco.mj_saveLastXML(scene, sim.hand_model("leap"))
    (trial,) = sim.get("hold", duration=0.1)
    sim.run(trial).save(log)
    return [
        ("a paper scenario", "static"),
        ("a simulated scene", "hold"),
        ("one of many trials", "allegro"),
        ("a log", "hold", "--log", log),
        ("grasps of a file", "examples/several_grasps.json"),
        ("a hand of one's own", "--hand", scene),
        ("a scene of one's own", "--model", scene, "--object", "object"),
        *((f"hand/{name}", f"hand/{name}") for name in sim.HANDS),
    ]


def _page_up(browser: Browser, *arguments: str) -> tuple[float, float]:
    """Return the times to a sentence on the page, and of the processor to the page's address."""
    start = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-m", "graspforce", "view", *arguments, "--port", "0"],
        stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        process.stdout.readline()
        url = process.stdout.readline().split()[0]
        spent = psutil.Process(process.pid).cpu_times()
        tab = opened(browser, url, ".gf-verdict b")
        took = time.perf_counter() - start
        tab.close()
        process.terminate()
    return took, spent.user + spent.system


def _empty_page_up(browser: Browser) -> float:
    """Return the time to a word on a page of viser alone, which no page of ours can be below."""
    with quiet():
        server = viser.ViserServer(port=0, verbose=False)
    server.gui.add_html("<b class='gf-word'>here</b>")
    start = time.perf_counter()
    tab = opened(browser, f"http://127.0.0.1:{server.get_port()}", ".gf-word")
    took = time.perf_counter() - start
    tab.close()
    with quiet():
        server.stop()
    return took


def _server_time(session: Any, alpha: float) -> float:
    start = time.thread_time()
    session._refresh(session.knobs.changed(alpha=alpha))
    return time.thread_time() - start


def _answer_time(tab: Page, alpha: float) -> float:
    """Return the time from a value in the field to its number on the page, by the page's clock."""
    row = tab.locator(ALPHA).locator("xpath=ancestor::div[2]")
    field = row.locator("input").first.element_handle()
    return tab.evaluate(
        """([field, value]) => new Promise((done, fail) => {
          const start = performance.now();
          setTimeout(() => fail(new Error(`${value} did not show within 20 s`)), 20000);
          new MutationObserver((_, watch) => {
            if (document.querySelector('.gf-alpha')?.innerText === value) {
              watch.disconnect();
              done((performance.now() - start) / 1000);
            }
          }).observe(document.body, {subtree: true, childList: true, characterData: true});
          const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
          set.call(field, value);
          field.dispatchEvent(new Event('input', {bubbles: true}));
        })""",
        [field, f"{alpha:g}"],
    )


def _redraws(page: viewer.Viewer, clients: int, seconds: float = 5.0) -> float:
    """Return redraws a second and client while every client's alpha changes 60 times a second."""
    sessions = list(page.sessions.values())
    before = [session.redraws for session in sessions]
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for session in sessions:
            session.turn(alpha=5 + time.monotonic() % 1)
        time.sleep(1 / 60)
    done = sum(s.redraws - b for s, b in zip(sessions, before, strict=True))
    return done / seconds / clients


# ---- how long -----------------------------------------------------------------------------------


def soak(browser: Browser, turns: int) -> tuple[list[str], list[str]]:
    """Turn random knobs; return what there is to say, and what went wrong."""
    errors = _Errors()
    logging.getLogger().addHandler(errors)
    threading.excepthook = errors.of_thread
    threads = threading.active_count()
    page = viewer.Viewer(viewer.open_subject("regrasp"), port=0)
    tab = opened(browser, page.url)
    tab.on("pageerror", lambda error: errors.found.append(f"page: {error}"))
    (session,) = page.sessions.values()
    rng, memory, process = np.random.default_rng(7), [], psutil.Process()
    start = time.monotonic()
    for turn in range(turns):
        session.turn(**random_turn(rng))
        if turn % 100 == 0:
            tab.wait_for_timeout(1)  # which lets the page's events through
            memory.append(process.memory_info().rss / 2**20)
        if turn % 10 == 0 and not within(PATIENCE, lambda: session._good is session._knobs):
            errors.found.append(f"turn {turn} was not answered: {session._knobs}")
        time.sleep(0.005)
    session.reset()
    tab.wait_for_selector(".gf-largest-normal")
    took = time.monotonic() - start
    redraws = session.redraws
    tab.close()
    within(PATIENCE, lambda: not page.sessions)
    page.stop()
    within(PATIENCE, lambda: threading.active_count() <= threads)
    # The first tenth fills caches and plots.
    growth = memory[-1] - memory[len(memory) // 10]
    failures = list(errors.found)
    if growth > MOST_GROWTH:
        failures.append(f"grew by {growth:.0f} MB, allowed are {MOST_GROWTH:.0f}")
    if threading.active_count() > threads:
        failures.append(f"left threads: {[each.name for each in threading.enumerate()]}")
    said = [
        f"{turns} random turns in {took:.0f} s, {redraws} redraws, {len(errors.found)} exceptions, "
        f"memory {memory[len(memory) // 10]:.0f} to {memory[-1]:.0f} MB"
    ]
    return said, failures


def within(seconds: float, holds: Callable[[], bool]) -> bool:
    """Wait until something holds; return whether it does."""
    deadline = time.monotonic() + seconds
    while not holds() and time.monotonic() < deadline:
        time.sleep(0.01)
    return holds()


def random_turn(rng: np.random.Generator) -> dict[str, Any]:
    """Return a change of one knob, now and then to what cannot be."""
    triple = tuple(rng.normal(size=3).tolist())
    wishes = ("alpha", "largest_normal", "times_least", "slip_reserve", "torque_reserve")
    choices: tuple[dict[str, Any], ...] = (
        {"alpha": float(10 ** rng.uniform(-2, 6))},
        {"alpha": float(10 ** rng.uniform(-4, 8))},
        {"firmness": str(rng.choice(wishes)), "wish": float(rng.uniform(0, 3))},
        {"firmness": "alpha"},
        {"friction": float(rng.uniform(0.1, 3))},
        {"torque": float(rng.uniform(0.1, 3))},
        {"ceiling": float(rng.choice([0.0, rng.uniform(0, 20)]))},
        {"load": float(rng.uniform(0, 1.5))},
        {"push": tuple(0.5 * each for each in triple)},
        {"twist": tuple(0.005 * each for each in triple)},
        {"tilt": float(rng.uniform(0, 180)), "heading": float(rng.uniform(-180, 180))},
        {"move": tuple(0.02 * each for each in triple)},
        {"turn": tuple(0.1 * each for each in triple)},
        {"engagement": tuple(rng.choice([0.0, 0.3, 1.0], 4).tolist())},
        {"time": float(rng.uniform(0, 2))},
        {"other": str(rng.choice(["", "minimum_norm", "lp"]))},
    )
    return choices[rng.integers(len(choices))]


class _Errors(logging.Handler):
    """What is logged as an error, and what ends a thread."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.found.append(self.format(record))

    def of_thread(self, args: Any) -> None:
        self.found.append(f"{args.thread}: {args.exc_type.__name__}: {args.exc_value}")


if __name__ == "__main__":
    sys.exit(main())
