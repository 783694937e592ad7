"""Why a grasp has no answer, or how near it is to having none, and what would help.

A certificate of infeasibility weighs every limit; in the units of ``Solution.violation`` the
weights add up to 1, and those that are not zero are the limits that exclude each other. A
:class:`Diagnosis` names them by finger and joint, and adds the least remedy of each kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspforce._engine.outcome import Status
from graspforce._util.arrays import as_tuple, require_instance
from graspforce.answers.remedies import Remedy, remedies
from graspforce.answers.wishes import slip_reserves
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.solution import Solution
from graspforce.solution.missing import components
from graspforce.solve import solve

__all__ = ["Binding", "Diagnosis", "Remedy", "diagnose"]

# Limits that weigh less in the conflict, and margins larger than this, bind nothing.
_LEAST_SHARE, _TIGHT = 0.01, 0.1
_NAMED = 4  # limits in the text; all are in ``binding``


@dataclass(frozen=True, slots=True)
class Binding:
    """A limit that binds.

    Attributes:
        kind: "friction", "torque", "ceiling", "floor", "rate" or "inequality".
        index: of the contact, joint, component of c or row of A, from 0.
        name: in words.
        share: of an infeasible grasp, its part in the conflict; all of them add up to 1. Of a
            SOLVED one 1 minus the part that is left of its margin.
    """

    kind: str
    index: int
    name: str
    share: float


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What ``str()`` says in words.

    Attributes:
        solution: of the problem in question.
        binding: the limits that bind, the heaviest first.
        remedies: for a grasp without an answer the least change of each kind that gives it one;
            for one with an answer what it could spare.
        missing: what the nearest wrench that the contacts make within the limits lacks, INFEASIBLE
            or WRENCH_UNREACHABLE, shape (k,) as a tuple; empty otherwise.
    """

    solution: Solution
    binding: tuple[Binding, ...]
    remedies: tuple[Remedy, ...]
    missing: tuple[float, ...]

    @property
    def status(self) -> Status:
        """The verdict on the problem."""
        return self.solution.status

    @property
    def line(self) -> str:
        """What would help, on one line; empty where nothing is known to."""
        said = [remedy.text for remedy in self.remedies]
        return f"what would help: {_or(said)}" if said and self.status != Status.SOLVED else ""

    @property
    def _lacking(self) -> str:
        return components(self.solution.problem, np.array(self.missing))

    def __str__(self) -> str:
        limits = ", ".join(
            f"{each.name} ({100 * each.share:.0f} %)" for each in self.binding[:_NAMED]
        )
        said = [remedy.text for remedy in self.remedies]
        match self.status:
            case Status.SOLVED:
                text = "The grasp holds this load."
                if limits:
                    text += f" Nearly used up: {limits}."
                if said:
                    text += f" It would also hold with any one of: {'; '.join(said)}."
                return text
            case Status.INFEASIBLE:
                size = self.solution.violation
                over = f"{size:.3g} times" if size >= 1 else f"{100 * size:.3g} % of"
                text = (
                    "No contact force holds this load within the limits: they would have to be "
                    f"exceeded by {over} their size. In conflict, by weight: {limits}."
                )
                if self.missing:
                    text += f" The nearest wrench within them lacks {self._lacking}."
            case Status.WRENCH_UNREACHABLE:
                text = (
                    "These contacts cannot make this wrench, whatever their forces. The nearest "
                    f"that they make lacks {self._lacking} of it: add a contact, give one "
                    "friction or torsion, or let the row give way with f_soft."
                )
            case Status.ON_EDGE:
                text = (
                    "This load is on the edge of what the contacts can hold: forces on the "
                    "boundary of a friction cone or a limit make it, none strictly inside do. A "
                    "little less load, or a little more of any limit, would do."
                )
            case Status.UNBOUNDED:
                text = (
                    "Nothing limits the grip, so there is no firmest one: give torque limits (J, "
                    "tau_lo, tau_hi) or ceilings (c_max)."
                )
            case _:
                text = f"There is no verdict: {self.solution.message}."
        if said:
            text += f" Any one of these would do: {'; '.join(said)}."
        elif self.status is Status.INFEASIBLE:
            text += " No single change was found that would help."
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, ready for JSON."""
        return {
            "status": self.status.name,
            "violation": float(self.solution.violation),
            "missing_wrench": list(self.missing),
            "binding": [
                {"kind": b.kind, "index": b.index, "name": b.name, "share": b.share}
                for b in self.binding
            ],
            "remedies": [
                {"kind": r.kind, "value": r.value, "unit": r.unit, "bound": r.bound, "text": r.text}
                for r in self.remedies
            ],
            "text": str(self),
        }


def diagnose(
    problem: ForceProblem | Solution,
    fingers: Sequence[str] | None = None,
    joints: Sequence[str] | None = None,
) -> Diagnosis:
    """Say which limits bind, and what would help; or what a grasp with an answer could spare.

    Args:
        problem: of the grasp, or its solution.
        fingers: names of the n contacts; default "finger 1", "finger 2", ….
        joints: names of the n_joints joints; default "joint 1", …; ``grasp.joint_names``.

    Returns:
        The diagnosis; every remedy in it was solved, and is within 1 % of the least that helps.

    Raises:
        InvalidInputError: neither a problem nor a solution, or another number of names.
    """
    require_instance(problem, "problem", ForceProblem | Solution, "a ForceProblem or a Solution")
    solution = problem if isinstance(problem, Solution) else solve(problem)
    asked = solution.problem
    tips, axes = default_names(asked)
    tips, axes = _names(fingers, "fingers", tips), _names(joints, "joints", axes)
    missing: tuple[float, ...] = ()
    helps: tuple[Remedy, ...] = ()
    match solution.status:
        case Status.INFEASIBLE:
            binding, helps = _in_conflict(solution, tips, axes), remedies(solution, tips)
        case Status.SOLVED:
            binding, helps = _tight(solution, tips, axes), remedies(solution, tips)
        case Status.WRENCH_UNREACHABLE:
            binding = ()
        case Status.UNBOUNDED:
            binding, helps = (), _bounded(asked)
        case _:
            binding = ()
    if solution.status is Status.WRENCH_UNREACHABLE or (
        solution.status is Status.INFEASIBLE and solution.nearest
    ):
        scales = asked.wrench_scales()
        left = solution.missing / scales * asked.exact
        left = np.where(np.abs(left) > 1e-9 * np.abs(left).max(), left, 0.0)  # but rounding
        missing = tuple((scales * left).tolist())
    return Diagnosis(solution, binding, helps, missing)


def default_names(problem: ForceProblem) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return "finger 1", "finger 2", … and "joint 1", …: what a problem without names has."""
    counts = {"finger": problem.n, "joint": problem.layout.joints}
    fingers, joints = (
        tuple(f"{word} {i + 1}" for i in range(count)) for word, count in counts.items()
    )
    return fingers, joints


def _names(given: Sequence[str] | None, argument: str, default: tuple[str, ...]) -> tuple[str, ...]:
    if given is None:
        return default
    names = as_tuple(given, argument, str)
    if len(names) != len(default):
        raise InvalidInputError(f"{argument}: got {len(names)} names, expected {len(default)}")
    return names


def _rows(problem: ForceProblem, tips: tuple[str, ...], axes: tuple[str, ...]) -> list[Binding]:
    """Return every linear limit that counts, in order, without its share."""
    layout, m = problem.layout, problem.m
    owners = np.repeat(np.arange(problem.n), layout.dims)
    rows = [("torque", j, f"the upper torque limit of {axes[j]}") for j in range(layout.joints)]
    rows += [("torque", j, f"the lower torque limit of {axes[j]}") for j in range(layout.joints)]
    if layout.ceilings:
        rows += [("ceiling", i, f"the ceiling of {tips[i]}") for i in range(problem.n)]
    if layout.floors:
        rows += [("floor", i, f"the floor of {tips[i]}") for i in range(problem.n)]
    if layout.rate_limits:
        rates = [("rate", i, f"the rate limit of {tips[owners[i]]}") for i in range(m)]
        rows += rates + rates
    rows += [("inequality", i, f"row {i} of A c <= b") for i in range(layout.inequalities)]
    counted = problem.counted_limits()
    return [Binding(*row, 0.0) for row, kept in zip(rows, counted, strict=True) if kept]


def _in_conflict(
    solution: Solution, tips: tuple[str, ...], axes: tuple[str, ...]
) -> tuple[Binding, ...]:
    """Return the limits by their weight in the certificate."""
    problem, certificate = solution.problem.without_pulls(), solution.certificate
    assert certificate is not None
    A, _ = problem.linear_limits()
    of_rows, of_cones = problem.violation_scales()
    # In the unit of force of its cone, a contact's part of the multipliers is e_n/mu.
    e = A.T[problem.starts[:-1]] @ certificate.z - problem.W.T[problem.starts[:-1]] @ certificate.y
    cones = np.where(problem.active, e / problem.mu * of_cones, 0.0)
    weights = np.concatenate((certificate.z * of_rows, np.maximum(cones, 0.0)))
    words = {1: "that {} cannot pull"}
    named = _rows(problem, tips, axes) + [
        Binding("friction", i, words.get(model.dim, "the friction of {}").format(tips[i]), 0.0)
        for i, model in enumerate(problem.models)
    ]
    return _heaviest(named, weights / weights.sum(), _LEAST_SHARE)


def _tight(solution: Solution, tips: tuple[str, ...], axes: tuple[str, ...]) -> tuple[Binding, ...]:
    """Return the limits of which less than a tenth is left."""
    problem, forces = solution.without_pulls()
    A, b = problem.linear_limits()
    of_rows, _ = problem.violation_scales()
    slips = slip_reserves(solution.problem, solution.c)
    left = np.concatenate(((b - A @ forces) / of_rows, slips))
    named = _rows(problem, tips, axes) + [
        Binding("friction", i, f"the friction of {tip}", 0.0) for i, tip in enumerate(tips)
    ]
    return _heaviest(named, 1 - left, 1 - _TIGHT)


def _heaviest(named: list[Binding], shares: Any, least: float) -> tuple[Binding, ...]:
    order = [int(i) for i in np.argsort(-shares, kind="stable") if shares[i] >= least]
    return tuple(
        Binding(named[i].kind, named[i].index, named[i].name, float(shares[i])) for i in order
    )


def _bounded(problem: ForceProblem) -> tuple[Remedy, ...]:
    """Return ceilings of twice the least possible force for a grip that nothing limits."""
    from graspforce.answers import firmness

    edge = firmness.least(problem, rtol=5e-3)
    if not edge.found or not edge.upper > 0:
        return ()
    force = 2 * edge.upper
    limited = problem.replace(c_max=force)
    solution = solve(limited)
    if solution.status is not Status.SOLVED:
        return ()
    text = f"c_max={force:.3g} N, twice the least possible largest normal force"
    return (Remedy("ceiling", force, "N", edge.lower, text, limited, solution),)


def _or(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])}, or {parts[-1]}"
