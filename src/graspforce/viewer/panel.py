"""The control panel of a page: knobs, verdict, numbers, plots, buttons.

A panel shows and asks; it solves nothing. Every widget is bound to the knobs by two functions, what
a new value changes and what value the knobs stand for, so that a remedy, a link or a reset moves
the widgets like a hand.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from viser import ClientHandle, uplot

from graspforce._util.arrays import Array
from graspforce.baselines import METHODS
from graspforce.viewer import colours, words
from graspforce.viewer.knobs import FIRMNESS, RANGES, SHAPES, Knobs
from graspforce.viewer.moment import Moment, Subject
from graspforce.viewer.problems import Answer
from graspforce.viewer.timeline import Timeline

# Of the live plots [s]; points are kept and sent this often at most.
WINDOW, _PLOT_PERIOD = 10.0, 0.1
SPEEDS = {"1/10": 0.1, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0}
NONE = "none"
_NAMED = 500  # grasps that are chosen by name, more by number


class Actions(Protocol):
    """What the buttons of a panel do."""

    def turn(self, **changes: Any) -> None:
        """Turn knobs."""
        ...

    def reset(self) -> None:
        """Put all knobs back."""
        ...

    def play(self, on: bool) -> None:
        """Let the time run, or stop it."""
        ...

    def step(self, by: int) -> None:
        """Go to another grasp of the file, in the order of the list."""
        ...

    def sort(self, by: str) -> None:
        """Order the list of grasps: "place", "margin" or "name"."""
        ...

    def handles(self, on: bool) -> None:
        """Show handles at the object, or hide them."""
        ...

    def physics(self, on: bool) -> None:
        """Let the closed loop run, or leave it."""
        ...

    def lift(self, finger: int) -> None:
        """Let a finger leave the object in physics and come back."""
        ...

    def again(self) -> None:
        """Begin the physics again."""
        ...

    def touch_all(self) -> None:
        """Let all fingers touch the object."""
        ...

    def screenshot(self) -> None:
        """Send a picture of the scene."""
        ...

    def export(self) -> None:
        """Send the scene as a page of its own."""
        ...


def dress_panel(gui: Any, title: str) -> None:
    """Set the place, the colours and the title of a client's panel."""
    gui.configure_theme(
        control_width="large", show_logo=False, show_share_button=False,
        brand_color=colours.rgb(colours.FINGERS[0]),
    )  # fmt: skip
    gui.main_panel.dock_right()
    gui.set_panel_label(f"graspforce · {title}")


class Panel:
    """The widgets of one client.

    Args:
        client: whose page.
        subject: what it is about.
        knobs: where they stand.
        actions: what the buttons do.
        link: returns a link to the page as it stands.
    """

    def __init__(
        self, client: ClientHandle, subject: Subject, knobs: Knobs, actions: Actions,
        link: Callable[[], str],
    ) -> None:  # fmt: skip
        # viser types icons by a list that it makes when it is built.
        self._gui: Any = client.gui
        self._subject, self._actions, self._link, self._knobs = subject, actions, link, knobs
        self._bound: list[tuple[Any, Callable[[Knobs], Any]]] = []
        self._engagements: list[Any] = []
        self._remedies: list[Any] = []
        self.speed = 1.0
        gui = self._gui
        dress_panel(gui, subject.title)
        self._verdict = gui.add_html("")
        self._remedy_folder = gui.add_folder("What would help", visible=False)
        tabs = gui.add_tab_group()
        self.tabs = tabs
        with tabs.add_tab("Knobs"):
            self._add_choice()
            self._add_picks()
            self._add_grip()
            self._add_load()
            self._add_limits()
            self._reset = gui.add_button("Reset all knobs")
            self._on_click(self._reset, actions.reset)
        with tabs.add_tab("Numbers"):
            self._numbers = gui.add_html("")
            self._live = _LivePlots(gui)
        if len(subject.times):
            with tabs.add_tab("Physics" if self._has("physics") else "Time"):
                if self._has("physics"):
                    self._add_physics()
                self._add_time()
        with tabs.add_tab("Colours"):
            gui.add_html(words.legend(subject.fingers))
        with tabs.add_tab("Share"):
            self._add_share()

    # ---- what is shown -----------------------------------------------------------------------

    def show(self, moment: Moment, answer: Answer | None, verdict: str) -> None:
        """Show the numbers of a moment, and a verdict made by ``words``."""
        self._verdict.content = verdict
        self._numbers.content = words.numbers(moment, answer)
        if answer is not None and answer.solved:
            self._live.add(words.largest_shares(answer))
        self._offer_engagements(moment)

    def offer(self, remedies: Sequence[tuple[str, Knobs | None]]) -> None:
        """Offer remedies: each by its text, as a button where it has knobs."""
        for each in self._remedies:
            each.remove()
        self._remedies = []
        self._remedy_folder.visible = bool(remedies)
        with self._remedy_folder:
            for text, knobs in remedies:
                if knobs is None:
                    self._remedies.append(self._gui.add_markdown(f"- {text}"))
                    continue
                short = text.partition(" (")[0]
                button = self._gui.add_button(short[0].upper() + short[1:], color="red", hint=text)
                self._on_click(button, lambda knobs=knobs: self._apply(knobs))
                self._remedies.append(button)

    def put(self, knobs: Knobs) -> None:
        """Move the widgets to where the knobs stand."""
        self._knobs = knobs
        for handle, stands in self._bound:
            handle.value = stands(knobs)
        for i, handle in enumerate(self._engagements):
            handle.value = float(knobs.engagements(i + 1)[i])
        self._wish.visible = knobs.firmness != "alpha"
        self._alpha.visible = self._slider.visible = knobs.firmness == "alpha"

    # ---- groups of widgets -------------------------------------------------------------------

    def _add_choice(self) -> None:
        """Add what chooses a grasp among several, and their list."""
        items = self._subject.items
        if len(items) < 2:
            return
        gui = self._gui
        last = len(items) - 1
        names = [f"{i} {name}" for i, name in enumerate(items[:_NAMED])]
        listed = self._has("list")
        label = "Grasp" if listed else "Trial"
        with gui.add_folder("Grasps of the file" if listed else "Trials of the scene"):
            if len(items) <= _NAMED:
                self._bind(
                    gui.add_dropdown(
                        label, names, initial_value=names[min(self._knobs.item, last)]
                    ),
                    lambda value: {"item": names.index(value)},
                    lambda knobs: names[min(knobs.item, last)],
                )
            else:
                self._bind(
                    gui.add_number(label, self._knobs.item, min=0, max=last, step=1),
                    lambda value: {"item": min(max(value, 0), last)},
                    lambda knobs: min(knobs.item, last),
                )
            step = gui.add_button_group("", ("previous", "next"))

            @step.on_click
            async def _(event: Any) -> None:
                self._actions.step(1 if step.value == "next" else -1)

            if not listed:
                return
            order = gui.add_dropdown("Sort the list by", ("place", "margin", "name"))
            self._on_update(order, self._actions.sort)
            self.listing = gui.add_html("")

    def _add_picks(self) -> None:
        """Add what chooses the object of a hand and its contacts."""
        if not self._has("picks"):
            return
        gui, fingers = self._gui, ("nearest", *self._subject.fingers)
        with gui.add_folder("Object and contacts"):
            self._bind(
                gui.add_dropdown("Object", SHAPES, initial_value=self._knobs.shape),
                lambda value: {"shape": value, "picks": ()},
                lambda knobs: knobs.shape,
            )
            self._bind(
                gui.add_number("Its size [m]", self._knobs.size, step=0.001),
                lambda value: {"size": value, "picks": ()},
                lambda knobs: knobs.size,
            )
            gui.add_markdown("A click on the object is a contact there.")
            self._next_finger = gui.add_dropdown("Contact of", fingers)
            self._on_click(gui.add_button("Let all fingers touch"), self._actions.touch_all)
            self._on_click(gui.add_button("Take the last contact away"), self._unpick)

    @property
    def next_finger(self) -> int | None:
        """The finger of the next contact; None for the nearest."""
        fingers = ("nearest", *self._subject.fingers)
        return (
            fingers.index(self._next_finger.value) - 1
            if self._next_finger.value != "nearest"
            else None
        )

    def _unpick(self) -> None:
        self._actions.turn(picks=self._knobs.picks[:-1])

    def _add_grip(self) -> None:
        gui, knobs = self._gui, self._knobs
        with gui.add_folder("How firm"):
            self._bind(
                gui.add_dropdown(
                    "Told by", FIRMNESS, initial_value=knobs.firmness,
                    hint="alpha itself, or a wish in newtons or as a share",
                ),
                lambda value: {"firmness": value},
                lambda knobs: knobs.firmness,
            )  # fmt: skip
            low, high, _ = RANGES["alpha"]
            self._slider = self._bind(
                gui.add_slider(
                    "Firm to light", math.log10(low), math.log10(high), 0.01,
                    round(math.log10(knobs.alpha), 2),
                    marks=((-2.0, "firm"), (2.0, "log10 alpha"), (6.0, "light")),
                    hint="alpha = 10^x, the weight of the limits: small is firm, large is light",
                ),
                lambda value: {"alpha": float(f"{10**value:.4g}")},
                lambda knobs: round(math.log10(knobs.alpha), 2),
            )  # fmt: skip
            self._alpha = self._number("alpha", "alpha", step=0.01)
            self._wish = self._number(
                "Wish", "wish", step=0.01,
                hint="largest_normal: N; times_least: times the least possible; slip_reserve, "
                "torque_reserve: 0 to 1",
            )  # fmt: skip
            self._wish.visible = knobs.firmness != "alpha"
            self._alpha.visible = self._slider.visible = knobs.firmness == "alpha"
            names = (NONE, *sorted(METHODS), *(["physics"] if self._has("physics") else []))
            self._bind(
                gui.add_dropdown(
                    "Compare with", names, initial_value=knobs.other or NONE,
                    hint="forces of another method beside, in turquoise",
                ),
                lambda value: {"other": "" if value == NONE else value},
                lambda knobs: knobs.other or NONE,
            )  # fmt: skip

    def _add_load(self) -> None:
        gui, knobs, start = self._gui, self._knobs, self._subject.knobs
        with gui.add_folder("Load"):
            mass = self._subject.load_unit == "kg"
            label = "Payload [kg]" if mass else "Load [times]"
            self._factor(label, "load", max(2.0, 6 * start.load))
            if self._has("push"):
                self._bind(
                    gui.add_vector3(
                        "Push [N]", knobs.push, step=0.05,
                        hint="a force on the object beside its weight; also by dragging the "
                        "object, with Shift at the point where it is taken hold of",
                    ),
                    lambda value: {"push": value}, lambda knobs: knobs.push,
                )  # fmt: skip
                self._bind(
                    gui.add_vector3(
                        "Twist [N·m]", knobs.twist, step=0.001, hint="a torque on the object"
                    ),
                    lambda value: {"twist": value},
                    lambda knobs: knobs.twist,
                )
            if self._has("tilt"):
                self._slide("Gravity tilted [°]", "tilt", 0.0, 180.0, 1.0)
                self._slide("towards [°]", "heading", -180.0, 180.0, 1.0)
            if self._has("move"):
                self._bind(
                    gui.add_vector3(
                        "Object moved [m]", knobs.move, step=0.001,
                        hint="also by dragging the object's handles",
                    ),
                    lambda value: {"move": value}, lambda knobs: knobs.move,
                )  # fmt: skip
                handles = gui.add_checkbox(
                    "Handles to drag", False, hint="arrows and rings at the object that move it"
                )
                self._on_update(handles, self._actions.handles)

    def _add_limits(self) -> None:
        with self._gui.add_folder("Friction and limits"):
            self._factor("Friction [times]", "friction", 3.0)
            self._factor("Torque limits [times]", "torque", 3.0)
            self._number(
                "Ceiling [N]", "ceiling", step=0.1,
                hint="of every normal force; 0: as the grasp has it",
            )  # fmt: skip
        self._fingers = self._gui.add_folder("Fingers in the grasp")

    def _offer_engagements(self, moment: Moment) -> None:
        """Offer a slider a contact; anew where their number has changed."""
        if len(self._engagements) == len(moment.fingers):
            return
        for each in self._engagements:
            each.remove()
        self._engagements = []
        with self._fingers:
            for i, name in enumerate(moment.fingers):
                slider = self._gui.add_slider(
                    name, 0.0, 1.0, 0.01, float(self._knobs.engagements(i + 1)[i]),
                    hint="1: takes part; 0: out of the grasp; between: its ceiling is lowered",
                )  # fmt: skip
                self._on_update(slider, lambda value, i=i: self._engage(i, value))
                self._engagements.append(slider)

    def _engage(self, finger: int, value: float) -> None:
        engagement = self._knobs.engagements(len(self._engagements))
        engagement[finger] = value
        self._actions.turn(engagement=tuple(engagement.tolist()))

    def _add_time(self) -> None:
        gui, times = self._gui, self._subject.times
        self.timeline = Timeline(gui)
        end = float(times[-1])
        self._slide("Time [s]", "time", 0.0, end, max(end / 1000, 1e-3))
        self.playing = gui.add_checkbox("Play", False)
        self._on_update(self.playing, self._actions.play)
        speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1")

        def faster(value: str) -> None:
            self.speed = SPEEDS[value]

        self._on_update(speed, faster)

    def _add_physics(self) -> None:
        gui = self._gui
        gui.add_markdown(
            "Run live: the closed loop. Drag the object to push it; lower the friction, which the "
            "controller does not know, and see which alpha still holds. Below: the scene from its "
            "beginning to its end."
        )
        self.live = gui.add_checkbox("Run live", False)
        self._on_update(self.live, self._actions.physics)
        self.pace = gui.add_html("")
        self._on_click(gui.add_button("Begin again"), self._actions.again)
        if not self._has("lift"):
            return
        names = self._subject.fingers
        lift = gui.add_dropdown("Finger", names)
        self._on_click(
            gui.add_button("Lift it for a second"),
            lambda: self._actions.lift(names.index(lift.value)),
        )

    def _add_share(self) -> None:
        gui = self._gui
        self._on_click(gui.add_button("Picture (.png)"), self._actions.screenshot)
        self._on_click(gui.add_button("Page (.html)"), self._actions.export)
        gui.add_markdown("The page opens from disk, without a network, and can be turned.")
        link = gui.add_text("Link to these knobs", self._link())
        show = gui.add_button("Make the link")

        def make() -> None:
            link.value = self._link()

        self._on_click(show, make)

    # ---- single widgets ----------------------------------------------------------------------

    def _has(self, control: str) -> bool:
        return control in self._subject.controls

    def _factor(self, label: str, knob: str, most: float) -> None:
        """Add a slider whose end moves out when a remedy or a link goes beyond it."""
        now = float(getattr(self._knobs, knob))
        slider = self._gui.add_slider(label, 0.0, max(most, now), 0.01, now)

        def stands(knobs: Knobs) -> float:
            value = float(getattr(knobs, knob))
            if value > slider.max:
                slider.max = math.ceil(value)
            return value

        self._bind(slider, lambda value: {knob: value}, stands)

    def _slide(self, label: str, knob: str, low: float, high: float, step: float) -> Any:
        return self._bind(
            self._gui.add_slider(label, low, high, step, float(getattr(self._knobs, knob))),
            lambda value: {knob: value},
            lambda knobs: float(getattr(knobs, knob)),
        )

    def _number(self, label: str, knob: str, step: float, hint: str | None = None) -> Any:
        """Add a field without bounds, so that what is out of range is answered by a sentence."""
        return self._bind(
            self._gui.add_number(label, float(getattr(self._knobs, knob)), step=step, hint=hint),
            lambda value: {knob: value},
            lambda knobs: float(getattr(knobs, knob)),
        )

    def _bind(
        self, handle: Any, read: Callable[[Any], dict[str, Any]], stands: Callable[[Knobs], Any]
    ) -> Any:
        self._bound.append((handle, stands))
        self._on_update(handle, lambda value: self._actions.turn(**read(value)))
        return handle

    def _on_update(self, handle: Any, call: Callable[[Any], None]) -> None:
        # In the event loop and not in a pool of threads: changes keep their order.
        @handle.on_update
        async def _(event: Any) -> None:
            if event.client is not None:  # not moved by the page itself
                call(handle.value)

    def _on_click(self, handle: Any, call: Callable[[], None]) -> None:
        @handle.on_click
        async def _(event: Any) -> None:
            call()

    def _apply(self, knobs: Knobs) -> None:
        changes = {name: getattr(knobs, name) for name in knobs.__slots__}
        self._actions.turn(**changes)


class _LivePlots:
    """Largest normal force, and largest shares of cones and torque limits, of the last seconds."""

    def __init__(self, gui: Any) -> None:
        self._start, self._sent = time.monotonic(), -math.inf
        self._points: deque[tuple[float, Array]] = deque()
        nothing = np.array([0.0])
        self._normal = gui.add_uplot(
            (nothing, nothing),
            (uplot.Series(label="t [s]"),
             uplot.Series(label="largest normal [N]", stroke=colours.FINGERS[0], width=2)),
            height=130, scales={"x": uplot.Scale(time=False)}, legend=uplot.Legend(show=True),
        )  # fmt: skip
        self._shares = gui.add_uplot(
            (nothing, nothing, nothing),
            (uplot.Series(label="t [s]"),
             uplot.Series(label="cone used [%]", stroke=colours.FINGERS[1], width=2),
             uplot.Series(label="torque used [%]", stroke=colours.FINGERS[2], width=2)),
            height=130, legend=uplot.Legend(show=True),
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(range=(0.0, 100.0))},
        )  # fmt: skip

    def add(self, values: Array) -> None:
        """Add a point now; what has left the window is dropped."""
        now = time.monotonic() - self._start
        if self._points:  # the last value stood until now
            self._points.append((now - 1e-3, self._points[-1][1]))
        self._points.append((now, values))
        while self._points[0][0] < now - WINDOW:
            self._points.popleft()
        if now - self._sent >= _PLOT_PERIOD:
            self._sent = now
            t = np.array([each[0] for each in self._points])
            rows = np.array([each[1] for each in self._points])
            self._normal.data = (t, rows[:, 0].copy())
            self._shares.data = (t, rows[:, 1].copy(), rows[:, 2].copy())
