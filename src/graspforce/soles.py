"""A sole as one contact with a limit on its centre of pressure.

A flat sole presses with a total normal force n, whose centre of pressure lies within the sole. It
is made of a contact in its centre, which carries friction by n, and of frictionless corners: p_k is
how much of n stands at corner k instead of the centre, Σ p_k < n, and the centre of pressure is
Σ p_k r_k / n. So a foot has one friction cone, and its force is where the load wants it.

>>> import graspforce as gf
>>> sole = gf.soles.contacts((0, 0, 0), (0, 0, 1), gf.SFC(0.6, 0.03), 0.1, 0.05, tangent=(1, 0, 0))
>>> problem = gf.Grasp(sole).problem([0, 0, 300, 0, -20, 0], c_max=1000)
>>> solution = gf.solve(gf.soles.as_one(problem, {0: (1, 2, 3, 4)}))
>>> solution.status.name
'SOLVED'
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_positive, index_of
from graspforce.contact import FPC, Contact, ContactModel
from graspforce.errors import InvalidInputError
from graspforce.problem import ForceProblem


def contacts(
    point: ArrayLike,
    normal: ArrayLike,
    model: ContactModel,
    half_length: float,
    half_width: float,
    tangent: ArrayLike | None = None,
) -> list[Contact]:
    """Return the contacts of a rectangular sole: its centre, then its four corners.

    Args:
        point: its centre, shape (3,) [m].
        normal: unit normal into what c acts on (up, for what the ground does to a robot).
        model: friction of the whole sole: PCWF, or SFC for a torque about the normal.
        half_length: from the centre to the toe, along the tangent [m].
        half_width: from the centre to the side [m].
        tangent: the direction of the toe, shape (3,).

    Returns:
        Five contacts; the corners are FPC. With a link each, ``[foot] * 5``, they go to
        ``Grasp.from_pinocchio``.
    """
    x, y = as_positive(half_length, "half_length", "m"), as_positive(half_width, "half_width", "m")
    centre = Contact(point, normal, model, tangent)
    corners = [
        centre.point + centre.frame @ [0, ahead * x, aside * y]
        for ahead in (1, -1)
        for aside in (1, -1)
    ]
    return [centre, *(Contact(each, centre.normal, FPC(), centre.tangent) for each in corners)]


def as_one(problem: ForceProblem, soles: Mapping[int, Sequence[int]]) -> ForceProblem:
    """Return the problem with soles that each are one contact with a centre of pressure.

    In its solutions the centre's normal force is that of the whole sole, which its friction, its
    ceiling and its floor are of, and a corner's is its share of it.

    Args:
        problem: of contacts among which each sole has a centre and corners.
        soles: which contacts are the corners of which centre, by number.

    Raises:
        InvalidInputError: a number that is no contact's, or a corner that is no FPC or is in
            two soles; a problem with rate limits.
    """
    if problem.layout.rate_limits:
        raise InvalidInputError("problem: got rate limits, expected none: they go to the new one")
    starts, move = problem.starts, np.eye(problem.m)
    rows: list[Array] = []
    used: set[int] = set()
    for centre, corners in soles.items():
        row = np.zeros(problem.m)
        row[starts[_contact(centre, problem)]] = -1.0
        for corner in corners:
            if _contact(corner, problem) in used or problem.models[corner] != FPC():
                raise InvalidInputError(
                    f"soles: got corner {corner}, expected each once and of model FPC()"
                )
            used.add(corner)
            move[starts[centre], starts[corner]] = -1.0
            row[starts[corner]] = 1.0
        rows.append(row)
    A = np.vstack((problem.A @ move, *rows))
    b = np.append(problem.b, np.zeros(len(rows)))
    moved = problem.replace(W=problem.W @ move, A=A, b=b)
    return moved.replace(J=move.T @ problem.J) if problem.layout.joints else moved


def _contact(number: int, problem: ForceProblem) -> int:
    index = index_of(number)
    if index is None or not 0 <= index < problem.n:
        raise InvalidInputError(
            f"soles: got contact {number!r}, expected a number below {problem.n}"
        )
    return index
