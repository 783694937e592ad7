"""Remedies as knobs: what a page can turn so that a load is held."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from graspforce.answers.remedies import Remedy
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.viewer.knobs import Knobs, direction_angles
from graspforce.viewer.moment import Subject
from graspforce.viewer.problems import answer


def knobs_for(
    remedy: Remedy, problem: ForceProblem, knobs: Knobs, subject: Subject
) -> Knobs | None:
    """Return the knobs with which a remedy is applied, tried; None where no knob does it.

    Args:
        remedy: of the problem.
        problem: that the knobs make.
        knobs: as they stand.
        subject: what they act on.
    """
    try:
        changed = knobs.changed(**_changes(remedy, problem, knobs))
        if changed == knobs:
            return None
        moment = subject.moment(changed)
        if moment.problem is not None and answer(moment.problem, changed).solved:
            return changed
    except InvalidInputError:  # beyond a knob's range, or out of the hand's reach
        pass
    return None


def _changes(remedy: Remedy, problem: ForceProblem, knobs: Knobs) -> dict[str, Any]:
    """Return the changes, rounded to three digits towards what helps more."""
    match remedy.kind:
        case "friction":
            return {"friction": _up(knobs.friction * remedy.value)}
        case "torque":
            return {"torque": _up(knobs.torque * remedy.value)}
        case "ceiling":
            return {"ceiling": _up(float(remedy.problem.c_max.max()))}
        case "load":
            factor = -_up(-remedy.value)
            push, twist = (
                tuple(factor * each for each in vector) for vector in (knobs.push, knobs.twist)
            )
            return {"load": factor * knobs.load, "push": push, "twist": twist}
        case "finger":
            engagement = np.array(knobs.engagements(problem.n))
            back = int(np.argmax(remedy.problem.engagement - problem.engagement))
            engagement[back] = min(_up(remedy.value), 1.0)
            return {"engagement": tuple(engagement.tolist())}
        case "turn":
            tilt, heading = direction_angles(-remedy.problem.f[:3])
            return {"tilt": tilt, "heading": heading}
        case _:
            return {}


def _up(value: float) -> float:
    """Return a number rounded up to three digits."""
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 2)
    return math.ceil(value / unit - 1e-9) * unit
