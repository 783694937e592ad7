"""One client of the page: its knobs, its scene, its panel, and the thread that solves for it.

Widgets only note what they changed and wake the thread; it takes the knobs as they stand then. So
the latest change wins, whatever came between, and nothing queues up.
"""

from __future__ import annotations

import importlib
import logging
import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from viser import ClientHandle
from viser.transforms import SO3

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce.answers.diagnosis import diagnose
from graspforce.baselines import METHODS
from graspforce.errors import GraspForceError, InvalidInputError
from graspforce.solution import Solution
from graspforce.solve import solve
from graspforce.viewer import export, words
from graspforce.viewer.knobs import RANGES, Knobs, rotation
from graspforce.viewer.moment import Moment, Subject
from graspforce.viewer.panel import Panel
from graspforce.viewer.problems import Answer, answer
from graspforce.viewer.remedy import knobs_for
from graspforce.viewer.scene import Scene, contact_forces
from graspforce.viewer.timeline import Forces

# Redraws a second: at most, and while something moves by itself.
_MOST_RATE, _RATE = 60.0, 30.0
# Of the physics in a redraw, of forces over time while nothing else is to do and between two such
# slices, of a subject's own work between redraws [s].
_BUDGET, _SLICE, _PAUSE, _WORK = 0.025, 0.015, 0.005, 0.05
# Forces over time: points that are solved first, and ticks at most.
_TIMELINE, _TICKS = 100, 1000
# Grasps of a file: those that are solved for the list, and those that it shows.
_SOLVED, _LISTED = 20_000, 500

_LOG = logging.getLogger(__name__)


class Session:
    """A client's page, from when it opens to when it closes.

    Args:
        client: whose page.
        subject: what it is about; the session does not change it.
        knobs: where they stand at first.
        link: makes a link to the page from the knobs.

    Attributes:
        redraws: how often the scene was drawn.
    """

    def __init__(
        self,
        client: ClientHandle,
        subject: Subject,
        knobs: Knobs,
        link: Callable[[Knobs], str],
    ) -> None:
        self._client, self._subject = client, subject
        # Both threads turn knobs, each from where they stand.
        self._turning = threading.Lock()
        self._knobs, self._good = knobs, subject.knobs
        self._playing, self._closed = False, False
        self._wake = threading.Event()
        self.redraws = 0
        self._tasks: list[Callable[[], None]] = []
        self._loop: Any = None
        self._gizmo: Any = None
        self._gizmo_held = False
        self._moment: Moment | None = None
        self._order = list(range(len(subject.items)))
        self._timeline: tuple[Forces, ...] = ()
        self._timeline_of: Knobs | None = None
        self._job: Iterator[None] | None = None
        self._panel = Panel(client, subject, knobs, self, lambda: link(self._knobs))
        self._scene = Scene(
            client.scene, subject,
            self._pick if "picks" in subject.controls else None,
            self._pull if "push" in subject.controls else None,
        )  # fmt: skip
        self._thread = threading.Thread(target=self._run, name="graspforce page", daemon=True)
        self._wake.set()
        self._thread.start()

    @property
    def knobs(self) -> Knobs:
        """Where the knobs stand."""
        return self._knobs

    def close(self) -> None:
        """End the thread."""
        self._closed = True
        self._wake.set()

    def join(self) -> None:
        """Wait for the thread to end, for a few seconds at most: a browser may owe it a picture."""
        self._thread.join(5.0)

    # ---- what the panel and the scene ask for, in the server's event loop --------------------

    def turn(self, **changes: Any) -> None:
        """Turn knobs; what is out of range is said and not done."""
        if "item" in changes and "alpha" not in changes:
            changes["alpha"] = self._subject.alpha_of(changes["item"])
            if self._loop is not None:
                self.physics(True)
        try:
            with self._turning:
                self._knobs = self._knobs.changed(**changes)
        except InvalidInputError as error:
            self._tell("Not possible", str(error))
            self._tasks.append(lambda: self._panel.put(self._knobs))
        self._wake.set()

    def reset(self) -> None:
        """Put all knobs back."""
        self._knobs = self._subject.knobs
        self._wake.set()

    def play(self, on: bool) -> None:
        """Let the time run, or stop it."""
        self._playing = on
        self._wake.set()

    def step(self, by: int) -> None:
        """Go to another grasp of the file, in the order of the list."""
        place = self._order.index(self._knobs.item) + by
        self.turn(item=self._order[place % len(self._order)])

    def sort(self, by: str) -> None:
        """Order the list of grasps: "place", "margin" or "name"."""
        self._do(lambda: self._list(by))

    def handles(self, on: bool) -> None:
        """Show handles at the object, or hide them."""
        self._do(lambda: self._show_handles(on))

    def physics(self, on: bool) -> None:
        """Let the closed loop run, or leave it."""
        subject: Any = self._subject
        self._do(lambda: setattr(self, "_loop", subject.live(self._knobs) if on else None))

    def lift(self, finger: int) -> None:
        """Let a finger leave the object in physics and come back."""
        self._do(lambda: self._loop and self._loop.lift(finger))

    def again(self) -> None:
        """Begin the physics again."""
        self._do(lambda: self._loop and self._loop.reset())

    def touch_all(self) -> None:
        """Let all fingers touch the object."""
        subject: Any = self._subject
        self._do(lambda: self.turn(picks=subject.touch_all(self._knobs).picks))

    def screenshot(self) -> None:
        """Send a picture of the scene."""
        self._do(self._send_picture)

    def export(self) -> None:
        """Send the scene as a page of its own."""
        self._do(self._send_page)

    def _pick(self, origin: Array, direction: Array) -> None:
        subject: Any = self._subject
        picked = subject.pick(self._knobs, origin, direction, self._panel.next_finger)
        self.turn(picks=picked.picks)

    def _pull(self, wrench: Array, over: bool) -> None:
        if over and self._loop is not None:
            wrench = np.zeros(6)
        most = [RANGES[each].high for each in ("push", "twist") for _ in range(3)]
        x, y, z, *twist = np.clip(wrench, np.negative(most), most).tolist()
        self.turn(push=(x, y, z), twist=tuple(twist))

    def _do(self, task: Callable[[], Any]) -> None:
        self._tasks.append(task)
        self._wake.set()

    def _tell(self, title: str, text: str) -> None:
        self._client.add_notification(title, text, color="red", auto_close_seconds=6.0)

    # ---- the thread --------------------------------------------------------------------------

    def _run(self) -> None:
        """Serve the page until it closes; a failure costs the redraw in which it happens."""
        last = time.monotonic()
        while True:
            woken = self._wake.wait(self._patience())
            if self._closed:
                return
            if woken:  # else what wakes just now, after the wait has ended, would be forgotten
                self._wake.clear()
            now = time.monotonic()
            try:
                self._serve(woken, now - last)
            except Exception:
                _LOG.exception("a page failed to draw")
                self._tell("This page failed", "The terminal of graspforce view says how.")
                self._playing, self._loop = False, None
            pace = _MOST_RATE if woken else _RATE
            if self._job is None or woken:
                time.sleep(max(0.0, 1 / pace - (time.monotonic() - now)))
            last = now

    def _serve(self, woken: bool, seconds: float) -> None:
        """Do what there is to do after some seconds, the redraw last but for what can wait."""
        while self._tasks:
            self._tasks.pop(0)()
        busy = self._subject.busy
        if busy:
            self._subject.work(_WORK)
        if woken or busy or self._playing or self._loop is not None:
            self._advance(seconds)
            self._refresh(self._knobs)
        elif self._job is not None:
            self._go_on()

    def _patience(self) -> float | None:
        """Return how long to wait for something to do [s]; None for ever."""
        if self._loop is not None or self._subject.busy or self._playing:
            return 0.0
        return None if self._job is None else _PAUSE

    def _advance(self, seconds: float) -> None:
        """Move the time on, that of the physics, or round and round that of the scenario."""
        seconds = self._panel.speed * min(seconds, 0.2)
        if self._loop is not None:
            knobs = self._knobs
            self._loop.set(knobs.alpha, knobs.friction, knobs.applied)
            done = self._loop.advance(seconds, _BUDGET)
            share = done / seconds if seconds > 0 else 0.0
            self._panel.pace.content = words.pace(self._loop.tick.t, share, self._loop.ended)
        elif self._playing:
            t = (self._knobs.time + seconds) % float(self._subject.times[-1])
            with self._turning:
                self._knobs = self._knobs.changed(time=t)

    def _refresh(self, knobs: Knobs) -> None:
        """Solve for the knobs and show what comes out, the diagnosis after the forces."""
        subject: Any = self._subject
        try:
            live = self._loop is not None
            moment = subject.live_moment(self._loop, knobs) if live else subject.moment(knobs)
            found = None if moment.problem is None else answer(moment.problem, knobs)
        except GraspForceError as error:
            # An object out of reach, a wish that cannot be: back to what was.
            self._tell("Not possible", str(error))
            with self._turning:
                if self._knobs is knobs and knobs != self._good:
                    self._knobs = self._good
                    self._wake.set()
            return
        self._good, self._moment = knobs, moment
        self.redraws += 1
        other = self._other(moment, knobs)
        with self._client.atomic():
            self._panel.put(knobs)
            self._show(moment, found, knobs, other)
            self._panel.show(moment, found, words.verdict(moment, found, None))
            self._place_handles(knobs)
        self._client.flush()
        if found is None or found.solved:
            self._panel.offer([])
        elif not self._wake.is_set():
            self._explain(moment, found, knobs)
        self._refresh_timeline(knobs)
        if self.redraws == 1 and len(self._subject.items) > 1 and "list" in self._subject.controls:
            self._do(self._list)  # which takes a while for many: the first grasp is seen before

    def _show(self, moment: Moment, found: Answer | None, knobs: Knobs, other: Any) -> None:
        bodies = self._subject.bodies(knobs)
        self._scene.show(bodies, moment, found, other, applied=knobs.applied)

    def _explain(self, moment: Moment, found: Answer, knobs: Knobs) -> None:
        """Say why there are no forces, paint what binds, offer what would help."""
        known = diagnose(found.solution, moment.fingers, moment.joints)
        offers = [
            (each.text, knobs_for(each, found.solution.problem, knobs, self._subject))
            for each in known.remedies
        ]
        with self._client.atomic():
            self._scene.show(
                self._subject.bodies(knobs), moment, found, None, known.binding,
                knobs.applied,
            )  # fmt: skip
            self._panel.show(moment, found, words.verdict(moment, found, known))
            self._panel.offer(offers)

    def _other(self, moment: Moment, knobs: Knobs) -> Array | None:
        """Return the forces of another method, world axes; None where none is asked for."""
        if knobs.other == "physics":
            return moment.simulated
        if knobs.other not in METHODS or moment.problem is None or not moment.contacts:
            return None
        try:
            method: Any = importlib.import_module(METHODS[knobs.other])
            solution = method.solve(moment.problem)
        except (GraspForceError, np.linalg.LinAlgError) as error:
            self._tell(knobs.other, str(error))
            return None
        return contact_forces(moment, solution.c) if solution.status is Status.SOLVED else None

    # ---- forces over time --------------------------------------------------------------------

    def _refresh_timeline(self, knobs: Knobs) -> None:
        """Draw the cursor, and begin with the forces anew where other knobs have changed."""
        if not len(self._subject.times) or self._loop is not None:
            return
        if "physics" in self._subject.controls and knobs.time == 0:
            return  # a scene is run when somebody asks for its time
        timeless = knobs.changed(time=0.0)
        if timeless != self._timeline_of and not self._subject.busy:
            self._timeline_of, self._job = timeless, self._solve_timeline(timeless)
        self._show_timeline()

    def _show_timeline(self) -> None:
        if self._timeline:
            self._panel.timeline.show(self._subject.fingers, self._timeline, self._knobs.time)

    def _solve_timeline(self, knobs: Knobs) -> Iterator[None]:
        """Solve a few ticks, then all, then all by the other method; show what there is."""
        ticks = self._subject.times
        ticks = ticks[:: -(-len(ticks) // _TICKS)]
        few = ticks[:: max(len(ticks) // _TIMELINE, 1)]
        name = "WBF"
        normals: dict[float, Array] = {}
        for times in (few, ticks):
            for t in times.tolist():
                if t not in normals:
                    now = knobs.changed(time=t)
                    moment = self._subject.moment(now)
                    found = None if moment.problem is None else answer(moment.problem, now)
                    normals[t] = self._normals(moment, None if found is None else found.solution)
                    yield
            forces = Forces(name, times, np.array([normals[t] for t in times.tolist()]))
            self._timeline = (forces,)
            self._show_timeline()
        if knobs.other not in METHODS:
            return
        method: Any = importlib.import_module(METHODS[knobs.other])
        rows: list[Array] = []
        for t in ticks.tolist():
            moment = self._subject.moment(knobs.changed(time=t))
            rows.append(self._normals(moment, moment.problem and method.solve(moment.problem)))
            yield
        self._timeline = (*self._timeline, Forces(knobs.other, ticks, np.array(rows)))
        self._show_timeline()

    def _normals(self, moment: Moment, solution: Solution | None) -> Array:
        """Return normal forces in the order of the subject's fingers, NaN where there are none."""
        fingers = self._subject.fingers
        if solution is None or solution.status is not Status.SOLVED:
            return np.full(len(fingers), math.nan)
        forces = solution.normal_forces
        if len(forces) == len(fingers):
            return forces
        row = np.zeros(len(fingers))  # a log has the contacts that touch
        for name, force in zip(moment.fingers, forces, strict=True):
            if name in fingers:
                row[fingers.index(name)] += force
        return row

    def _go_on(self) -> None:
        """Go on with the forces over time for a little while."""
        end = time.monotonic() + _SLICE
        try:
            while self._job is not None and time.monotonic() < end and not self._wake.is_set():
                next(self._job)
        except (StopIteration, GraspForceError, np.linalg.LinAlgError):
            self._job = None

    # ---- further tasks -----------------------------------------------------------------------

    def _list(self, by: str = "place") -> None:
        """Show the list of a file's grasps in the wanted order."""
        subject: Any = self._subject
        rows: list[tuple[str, str, float]] = []
        for name, problem in zip(subject.items[:_SOLVED], subject.problems, strict=False):
            found = solve(problem)
            solved = found.status is Status.SOLVED
            margin = float(found.friction_margins.min(initial=math.inf))
            status = found.status.name.lower().replace("_", " ")
            rows.append((name, status, margin if solved else -math.inf))
        keys: dict[str, Callable[[int], Any]] = {
            "place": lambda i: i,
            "margin": lambda i: rows[i][2],
            "name": lambda i: rows[i][0],
        }
        order = sorted(range(len(rows)), key=keys[by])
        self._order = [*order, *range(len(rows), len(subject.items))]
        self._panel.listing.content = words.listing([rows[i] for i in order[:_LISTED]])

    def _show_handles(self, on: bool) -> None:
        if self._gizmo is None:
            self._gizmo = self._client.scene.add_transform_controls(
                "/handles", scale=self._subject.size, depth_test=False
            )

            @self._gizmo.on_update
            async def _(event: Any) -> None:
                moment = self._moment
                if moment is None or event.phase == "start":
                    return
                base = moment.origin - np.array(self._good.move)
                turn = SO3(np.array(event.target.wxyz)).log()
                move = np.array(event.target.position) - base
                self._gizmo_held = event.phase != "end"
                self.turn(move=tuple(move.tolist()), turn=tuple(turn.tolist()))

        self._gizmo.visible = on
        self._place_handles(self._knobs)

    def _place_handles(self, knobs: Knobs) -> None:
        if self._gizmo is not None and self._moment is not None and not self._gizmo_held:
            self._gizmo.position = self._moment.origin
            self._gizmo.wxyz = SO3.from_matrix(rotation(knobs.turn)).wxyz

    def _send_picture(self) -> None:
        try:
            image = self._client.get_render(height=720, width=1080, timeout=20.0)
        except (RuntimeError, TimeoutError) as error:
            self._tell("No picture", str(error))
            return
        imageio: Any = importlib.import_module("imageio.v3")  # takes a while
        png: bytes = imageio.imwrite("<bytes>", image, extension=".png")
        self._client.send_file_download(f"{self._stem}.png", png, save_immediately=True)

    def _send_page(self) -> None:
        page = export.html(self._subject, self._knobs, moving=len(self._subject.times) > 0)
        self._client.send_file_download(f"{self._stem}.html", page.encode(), save_immediately=True)

    @property
    def _stem(self) -> str:
        return "".join(c if c.isalnum() else "_" for c in self._subject.title)
