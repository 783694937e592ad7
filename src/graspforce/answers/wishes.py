"""What a user may ask of a grip in hard terms, and the problem that every such grip solves.

A slip reserve is friction lowered, a torque reserve is torque limits moved inwards, a largest
normal force is a ceiling. :class:`Relief` is the reverse: more friction, more torque, higher
ceilings, less load, one factor or force each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from graspforce._util.arrays import Array, as_number, as_positive
from graspforce.contact import ContactModel, model_of
from graspforce.equations import friction_margins
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem


@dataclass(frozen=True, slots=True)
class Wishes:
    """Hard wishes, each None where not asked for.

    Args:
        largest_normal: no finger pushes harder [N].
        slip_reserve: the grip holds with friction lower by this share, 0 to below 1.
        torque_reserve: the share of every joint's range that stays free, half of it at each end,
            0 to below 1.

    Raises:
        InvalidInputError: a wish out of its range.
    """

    largest_normal: float | None = None
    slip_reserve: float | None = None
    torque_reserve: float | None = None

    def __post_init__(self) -> None:
        if self.largest_normal is not None:
            value = as_positive(self.largest_normal, "largest_normal", "N")
            object.__setattr__(self, "largest_normal", value)
        for name in ("slip_reserve", "torque_reserve"):
            given = getattr(self, name)
            if given is not None:
                share = as_number(given, name)
                if not 0 <= share < 1:
                    raise InvalidInputError(f"{name}: got {share:g}, expected 0 or more, below 1")
                object.__setattr__(self, name, share)

    def check(self, problem: ForceProblem) -> None:
        """Raise where a wish is about something that the problem does not have.

        Raises:
            InvalidInputError: a torque reserve without joints, a slip reserve without friction, a
                largest normal force that a floor excludes.
        """
        if self.torque_reserve is not None and not problem.layout.joints:
            raise InvalidInputError(
                "torque_reserve: the problem has no joints; give it J, tau_lo and tau_hi"
            )
        if self.slip_reserve is not None and not any(d > 1 for d in problem.layout.dims):
            raise InvalidInputError("slip_reserve: no contact of the problem has friction")
        if self.largest_normal is not None and problem.layout.floors:
            floor = float((problem.active * problem.engagement * problem.c_min).max())
            if self.largest_normal <= floor:
                raise InvalidInputError(
                    f"largest_normal: got {self.largest_normal:g} N, expected more than {floor:g} "
                    "N, the largest floor c_min"
                )

    @property
    def given(self) -> dict[str, float]:
        """The wishes that were asked for, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    def only(self, *names: str) -> Wishes:
        """Return some of the wishes."""
        return Wishes(**{name: value for name, value in self.given.items() if name in names})

    def applied(self, problem: ForceProblem) -> ForceProblem:
        """Return the problem whose every answer meets the wishes."""
        changes: dict[str, Any] = {}
        if self.slip_reserve:
            changes["models"] = with_friction(problem, 1 - self.slip_reserve)
        if self.torque_reserve:
            inset = self.torque_reserve * (problem.tau_hi - problem.tau_lo) / 2
            changes |= {"tau_lo": problem.tau_lo + inset, "tau_hi": problem.tau_hi - inset}
        if self.largest_normal is not None:
            changes["c_max"] = ceilings_at(problem, self.largest_normal)
        return problem.replace(**changes) if changes else problem


def ceilings_at(problem: ForceProblem, force: float) -> Array:
    """Return the c_max with which no contact pushes harder than ``force`` [N]."""
    lifted = np.where(problem.active, force / np.where(problem.active, problem.engagement, 1), 1.0)
    return np.minimum(problem.c_max, lifted) if problem.layout.ceilings else lifted


def with_friction(problem: ForceProblem, factor: float) -> tuple[ContactModel, ...]:
    """Return the contact models with all coefficients of friction times a factor."""
    return tuple(
        model_of(model.dim, factor * model.mu, factor * model.gamma, model.pull)
        for model in problem.models
    )


def slip_reserves(problem: ForceProblem, c: Array) -> Array:
    """By what share the friction of each contact may fall before it slips, shape (n,).

    1 for a contact without tangential force; inf for one without friction or out of the grasp.
    """
    loaded = c + problem.preload[: problem.m]
    hold = problem.mu * loaded[problem.starts[:-1]]
    rubs = problem.active & (np.array(problem.layout.dims) > 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(rubs, friction_margins(loaded, problem.cones) / hold, math.inf)


def torque_reserves(problem: ForceProblem, tau: Array) -> Array:
    """Distance of each torque to its nearer limit over half of its range, shape (n_joints,)."""
    half = (problem.tau_hi - problem.tau_lo) / 2
    return np.minimum(problem.tau_hi - tau, tau - problem.tau_lo) / half
