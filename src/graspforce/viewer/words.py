"""What a page says, as HTML: the verdict, the numbers, the legend."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from graspforce._util.arrays import Array
from graspforce.answers.diagnosis import Diagnosis
from graspforce.answers.wishes import slip_reserves
from graspforce.viewer import colours
from graspforce.viewer.moment import Look, Moment
from graspforce.viewer.problems import Answer

if TYPE_CHECKING:
    from graspforce.viewer.timeline import Forces

_TABLE = (
    'style="border-collapse:collapse;width:calc(100% - 1.2em);margin:0 .6em;font-size:0.8em;'
    'line-height:1.5"'
)
_NOISE = 1e-8  # of a force or torque [N, N·m]
_MISSED = 0.05  # share of the wanted force
_MANY = 8  # of more contacts those that do not touch are not listed
_CELL = 'style="text-align:right;padding:0 .3em;white-space:nowrap"'


def number(value: float, unit: str = "") -> str:
    """Return a number with four significant digits and its unit; rounding errors are 0."""
    text = f"{value if abs(value) > _NOISE else 0.0:.4g}"
    return f"{text}\N{NO-BREAK SPACE}{unit}" if unit else text


def percent(share: float) -> str:
    """Return a share in percent; a dash for what has none."""
    return f"{100 * share:.0f}\N{NO-BREAK SPACE}%" if np.isfinite(share) else "–"


def verdict(moment: Moment, answer: Answer | None, found: Diagnosis | None) -> str:
    """Return the sentence at the top of the page, and the numbers that matter most."""
    if answer is None:
        return _framed(colours.GREY, "No forces yet", escape(moment.note))
    solution = answer.solution
    if not answer.solved:
        # What would help stands on buttons below.
        text = solution.message
        if found is not None:
            text = str(found).partition(" Any one of these would do")[0]
        status = solution.status.name.replace("_", " ").capitalize()
        note = f"<br>{escape(moment.note)}" if moment.note else ""
        return _framed(colours.RED, status, escape(text) + note)
    slip = float(slip_reserves(answer.problem, solution.c).min(initial=np.inf))
    torque = float(answer.torque_use.max(initial=0.0))
    parts = [
        f"largest normal {_named('largest-normal', number(_largest(answer), 'N'))} "
        f"by {escape(moment.fingers[int(solution.normal_forces.argmax())])}",
    ]
    if np.isfinite(slip):
        parts.append(f"friction may fall by {_named('slip-reserve', percent(slip))}")
    if answer.problem.layout.joints:
        parts.append(f"largest torque {_named('torque-use', percent(torque))} of its limit")
    solves = f", {answer.solves} solves" if answer.solves > 1 else ""
    small = (
        f"alpha {_named('alpha', number(answer.alpha))} · "
        f"{_named('steps', str(solution.newton_steps))} Newton steps · "
        f"{_named('microseconds', f'{answer.microseconds:.0f}')} µs{solves}"
    )
    notes = [escape(each) for each in (answer.message, moment.note) if each]
    missed, wanted = answer.missed
    colour, title = colours.GREEN, "Held"
    if missed > _MISSED * wanted:  # by a loop that lets a load be missed
        colour = colours.RED
        title = f"Not held: {number(missed, 'N')} of {number(wanted, 'N')} are missing"
    return _framed(
        colour, title, "<br>".join([" · ".join(parts), f"<small>{small}</small>", *notes])
    )


def look(shown: Look) -> str:
    """Return what a page says while its subject is being made, or why there will be none."""
    if shown.failed:
        return _framed(colours.RED, "Not held", escape(shown.moment.note))
    return _framed(colours.GREY, "One moment", escape(shown.moment.note))


def numbers(moment: Moment, answer: Answer | None) -> str:
    """Return a table of the contacts and one of the joints."""
    if answer is None:
        return ""
    problem, solution = answer.problem, answer.solution
    forces, bars = solution.normal_forces, _bars(answer.cone_use)
    sizes = [
        float(np.linalg.norm(solution.c[start : start + min(dim, 3)]))
        for start, dim in zip(problem.starts, problem.layout.dims, strict=False)
    ]
    dots = colours.of_fingers(moment.fingers)
    rows = [
        f"<tr><td>{_dot(dots[i])}{escape(name)}</td>"
        f"<td {_CELL}>{_named(f'normal-{i + 1}', number(float(forces[i])))}</td>"
        f"<td {_CELL}>{number(sizes[i])}</td><td {_CELL}>{number(float(problem.mu[i]))}</td>"
        f"<td {_CELL}>{bars[i]}</td></tr>"
        for i, name in enumerate(moment.fingers)
        if problem.active[i] or problem.n <= _MANY
    ]
    heads = ("normal [N]", "force [N]", "mu", "cone used")
    text = f"<table {_TABLE}><tr><th></th>{_heads(heads)}</tr>{''.join(rows)}</table>"
    if not problem.layout.joints:
        return text
    tau, bars = solution.tau, _bars(answer.torque_use)
    rows = [
        f"<tr><td>{escape(name)}</td><td {_CELL}>{number(float(tau[j]))}</td>"
        f"<td {_CELL}>{bars[j]}</td></tr>"
        for j, name in enumerate(moment.joints)
    ]
    heads = ("torque [N·m]", "of its limit")
    return text + f"<br><table {_TABLE}><tr><th></th>{_heads(heads)}</tr>{''.join(rows)}</table>"


def legend(fingers: Sequence[str]) -> str:
    """Return what the colours and shapes of the scene mean.

    Args:
        fingers: names of the contacts; none where they are not known.
    """
    strokes = dict(zip(map(colours.finger_of, fingers), colours.of_fingers(fingers), strict=True))
    strokes.pop("spare", None)
    named = ", ".join(f"{_dot(colour)}{escape(name)}" for name, colour in strokes.items())
    lines = [
        (
            _dots(colours.FINGERS),
            "arrows: the force of each finger on the object, ending at it, with its newtons"
            + (f": {named}" if named else ""),
        ),
        (
            _dot(colours.WANTED),
            "arrow: the wrench that the fingers together shall exert; thin: its torque",
        ),
        (_dot(colours.PUSH), "arrow: the push on the object beside its weight; thin: a twist"),
        (_dot(colours.OTHER), "arrows: the forces of another method, or of the physics"),
        (
            f'<span style="display:inline-block;width:3.5em;height:.8em;border-radius:.2em;'
            f'background:{colours.css_ramp()}"></span>',
            "cones, balls at joints: how much of the friction, of the torque limit is used, from "
            "0 (blue) over 60 % (yellow) to all (red)",
        ),
        (_dot(colours.RED), "of a load that is not held: the limits in conflict; grey: the others"),
        (_dot("#ff0000"), "axis of a contact frame: the normal, into the object"),
    ]
    rows = "".join(
        f'<tr><td style="padding:.15em .5em .15em 0;white-space:nowrap">{mark}</td>'
        f"<td>{text}</td></tr>"
        for mark, text in lines
    )
    return f'<table style="font-size:0.8em;line-height:1.3">{rows}</table>'


def listing(rows: list[tuple[str, str, float]]) -> str:
    """Return a list of grasps: name, verdict and least friction margin [N]."""
    lines = "".join(
        f"<tr><td>{escape(name)}</td><td {_CELL}>{escape(status)}</td>"
        f"<td {_CELL}>{number(margin) if np.isfinite(margin) else '–'}</td></tr>"
        for name, status, margin in rows
    )
    return (
        f'<div class="gf-list" style="max-height:16em;overflow:auto;margin:0 .6em">'
        f"<table {_TABLE}><tr><th></th>{_heads(('status', 'margin [N]'))}</tr>{lines}</table></div>"
    )


def jumps(found: Sequence[Forces], fingers: Sequence[str]) -> str:
    """Return how often the forces of each method jump from a tick to the next, and how far."""
    said: list[str] = []
    most = max(each.largest for each in found)
    for each in found:
        ticks, changes = each.jumps(most), each.changes
        if not len(ticks):
            said.append(f"{escape(each.method)}: none")
            continue
        tick, finger = np.unravel_index(int(changes.argmax()), changes.shape)
        largest = number(float(changes[tick, finger]), "N")
        said.append(
            f"{escape(each.method)}: {len(ticks)}, the largest {largest} of "
            f"{escape(fingers[int(finger)])} at {each.times[tick + 1]:.3f} s"
        )
    return (
        f'<div class="gf-jumps" style="font-size:0.8em;margin:0 .8em">Jumps from tick to tick: '
        f"{'; '.join(said)}</div>"
    )


def pace(t: float, share: float, ended: str) -> str:
    """Return how far the physics is, and how fast it runs; why it has ended."""
    if ended:
        return _framed(colours.RED, f"Ended at {t:.2f} s", f"{escape(ended)}: begin again")
    return (
        f'<div style="font-size:0.8em;margin:0 .8em">t = {_named("live-time", f"{t:.2f}")} s, at '
        f"{100 * share:.0f}\N{NO-BREAK SPACE}% of real time</div>"
    )


def _largest(answer: Answer) -> float:
    return float(answer.solution.normal_forces.max(initial=0.0))


def _framed(colour: str, title: str, text: str) -> str:
    return (
        f'<div class="gf-verdict" style="border-left:.3em solid {colour};padding:.1em .6em;'
        f'margin:.4em .6em;font-size:0.85em;line-height:1.4">'
        f'<b style="color:{colour}">{title}.</b> {text}</div>'
    )


def _named(name: str, text: str) -> str:
    """Mark a number, so that a program can find it on the page."""
    return f'<b class="gf-{name}">{text}</b>'


def _dot(colour: str) -> str:
    return (
        f'<span style="display:inline-block;width:.7em;height:.7em;border-radius:50%;'
        f'background:{colour};margin-right:.35em"></span>'
    )


def _dots(colour: tuple[str, ...]) -> str:
    return "".join(map(_dot, colour))


def _bars(shares: Array) -> list[str]:
    """Return a bar with its percentage for each share."""
    return [
        _bar(share, colour) if np.isfinite(share) else "–"
        for share, colour in zip(shares.tolist(), colours.of_share(shares).tolist(), strict=True)
    ]


def _bar(share: float, colour: list[int]) -> str:
    r, g, b = colour
    width = 4 * min(max(share, 0.0), 1.0)
    return (
        f'<span style="display:inline-block;width:4em;height:.7em;background:#e6eaef;'
        f'text-align:left;margin-right:.3em"><span style="display:block;height:100%;'
        f'width:{width:.2f}em;background:rgb({r},{g},{b})"></span></span>{percent(share)}'
    )


def _heads(names: tuple[str, ...]) -> str:
    return "".join(f'<th style="text-align:right;font-weight:normal">{name}</th>' for name in names)


def largest_shares(answer: Answer) -> Array:
    """Return largest normal force [N], largest cone use and torque use [%], shape (3,)."""
    return np.array(
        [
            _largest(answer),
            100 * float(np.nan_to_num(answer.cone_use).max(initial=0.0)),
            100 * float(answer.torque_use.max(initial=0.0)),
        ]
    )
