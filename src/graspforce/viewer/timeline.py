"""Normal forces over time, of one method or two, with their jumps marked and a cursor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from viser import uplot

from graspforce._util.arrays import Array
from graspforce.viewer import colours, words

# A change of a normal force from one tick to the next is a jump from this share of the largest on.
JUMP = 0.05
_POINTS = 120  # that are drawn at least; both ends of a jump besides


@dataclass(frozen=True, eq=False)
class Forces:
    """Normal forces of one method, tick after tick.

    Attributes:
        method: its name.
        times: shape (T,) [s].
        normals: shape (T, n) [N]; NaN in ticks without forces.
    """

    method: str
    times: Array
    normals: Array

    @cached_property
    def largest(self) -> float:
        """The largest normal force [N]; 0 where there is none."""
        return float(np.nanmax(self.normals, initial=0.0))

    @cached_property
    def changes(self) -> Array:
        """Return how far each force moves from a tick to the next, shape (T − 1, n) [N]."""
        return np.nan_to_num(np.abs(np.diff(self.normals, axis=0)))

    def jumps(self, largest: float) -> NDArray[np.intp]:
        """Return the ticks after which a force jumps, where forces are as large as that [N]."""
        return np.flatnonzero(self.changes.max(axis=1, initial=0.0) > JUMP * largest)


class Timeline:
    """The plot in a panel."""

    def __init__(self, gui: Any) -> None:
        self._gui, self._plot = gui, None
        self._drawn: tuple[str, ...] = ()
        self._folder = gui.add_folder("Normal forces over time [N]")
        with self._folder:
            self._said = gui.add_html("")

    def show(self, fingers: tuple[str, ...], found: tuple[Forces, ...], now: float) -> None:
        """Draw forces, and a line upwards at ``now``.

        Args:
            fingers: names of the n contacts.
            found: of the page's method, and of another where one is compared, which is dashed.
            now: where the cursor is [s].
        """
        times = found[0].times
        largest = max(each.largest for each in found)
        top = max(1.05 * largest, 1e-6)
        kept = np.zeros(len(times), dtype=bool)
        kept[:: max(len(times) // _POINTS, 1)] = True
        for each in found:
            jumps = each.jumps(largest)
            kept[jumps] = kept[jumps + 1] = True
        t = times[kept]
        at = int(np.searchsorted(t, now))
        t = np.insert(t, at, (now, now, now))
        rows: list[Array] = []
        series: list[uplot.Series] = [uplot.Series(label="t [s]")]
        strokes = colours.of_fingers(fingers)
        for k, each in enumerate(found):
            for i, name in enumerate(fingers):
                line = each.normals[:, i]
                if not np.nan_to_num(line).any():
                    continue  # a place where nothing ever touches
                value = float(np.interp(now, times, line))
                rows.append(np.insert(line[kept], at, (value, value, value)))
                look: Any = {"dash": (4.0, 3.0), "width": 1} if k else {"width": 2}
                label = f"{name}, {each.method}" if k else name
                series.append(uplot.Series(label=label, stroke=strokes[i], **look))
        for k, each in enumerate(found):
            jumps, changes = each.jumps(largest), each.changes
            if not len(jumps):
                continue
            marks = np.full(len(times), np.nan)
            marks[jumps + 1] = each.normals[jumps + 1, changes[jumps].argmax(axis=1)]
            rows.append(np.insert(marks[kept], at, (np.nan, np.nan, np.nan)))
            colour = colours.OTHER if k else colours.RED
            points: Any = {"show": True, "size": 6, "fill": colour, "stroke": colour}
            label = f"jump of {each.method}"
            series.append(uplot.Series(label=label, stroke=colour, width=0, points=points))
        cursor = np.zeros(len(t))
        cursor[at + 1] = top
        series.append(uplot.Series(label="now", stroke=colours.INK, width=1))
        data = (t, *rows, cursor)
        scales = {"x": uplot.Scale(time=False), "y": uplot.Scale(range=(0.0, top))}
        self._said.content = words.jumps(found, fingers)
        drawn = tuple(str(each.get("label")) for each in series)
        if self._plot is None or drawn != self._drawn:
            if self._plot is not None:
                self._plot.remove()
            with self._folder:
                self._plot = self._gui.add_uplot(data, tuple(series), height=180, scales=scales)
            self._drawn = drawn
            return
        self._plot.scales = scales
        self._plot.data = data
