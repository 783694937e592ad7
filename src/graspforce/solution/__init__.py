"""The result of a solve: the forces, the status, and the means to check both.

Residuals and margins of a :class:`Solution` are computed, when asked for, from the problem's data
and the forces alone, never from values that the solver returned.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from graspforce import equations
from graspforce._engine import native
from graspforce._engine.layout import Layout
from graspforce._engine.outcome import Outcome, PlainOutcome, Start, Status, TickOutcome
from graspforce._util.arrays import Array, hash_bytes, require_instance
from graspforce.certificate import Certificate
from graspforce.contact import UNIT_TOLERANCE
from graspforce.errors import GraspForceError, InvalidInputError
from graspforce.problem import ForceProblem
from graspforce.solution.missing import in_words
from graspforce.solution.verification import Verification, verify

# What has every attribute of an Outcome.
_OUTCOMES = native.module.Outcome | PlainOutcome


class SolveError(GraspForceError):
    """A solution was required to be SOLVED and is not; ``solution`` holds what was found."""

    def __init__(self, solution: Solution) -> None:
        super().__init__(f"{solution.status.name}: {solution.message}")
        self.solution = solution

    def __reduce__(self) -> tuple[type[SolveError], tuple[Solution]]:
        """Pickle by the solution: the text is derived from it."""
        return (type(self), (self.solution,))


class InfeasibleGraspError(SolveError):
    """No contact force gives the wrench strictly within the cones and limits."""


class NotConvergedError(SolveError):
    """The solver stopped before it could certify an answer."""


UNREACHABLE_IN_WORDS = (
    "the wrench is outside the range of W: these contacts cannot make it, whatever their forces"
)


def infeasible_in_words(violation: float, lack: str) -> str:
    """Return what INFEASIBLE means for one problem, with the words for what its wrench lacks."""
    return (
        "no contact force gives this wrench within the friction cones and limits; "
        f"the least relative violation is {violation:.3g}{lack}"
    )


def solved_in_words(steps: int, suboptimality: float, undetermined: int, m: int) -> str:
    """Return what SOLVED means for one problem, with m components of force."""
    told = f"solved in {steps} Newton steps; Phi is within {suboptimality:.1e} of its minimum"
    if not undetermined:
        return told
    return (
        f"{told}; {undetermined} of {m} force components are as asked: neither W c = f nor "
        "the torques determine them"
    )


class Solution(native.SolutionBase):
    """The contact forces of one solve or one tick, with their verdict.

    Everything but the forces and the status is computed on first use from the problem's data.
    """

    __slots__ = ()  # the base's two members, which the core fills
    _outcome: Outcome
    _problem: ForceProblem | Layout

    def __init__(self, outcome: Outcome, problem: ForceProblem | Layout) -> None:
        # Not Outcome itself: to look a protocol's attributes up takes longer than a solve, 14 µs.
        require_instance(outcome, "outcome", _OUTCOMES, "an Outcome")
        require_instance(problem, "problem", ForceProblem | Layout, "a ForceProblem")
        self._outcome = outcome
        self._problem = problem

    @property
    def problem(self) -> ForceProblem:
        """The problem that was solved; for a tick of a Servo, made from the tick's snapshot."""
        if isinstance(self._problem, ForceProblem):
            return self._problem
        packed = cast(TickOutcome, self._outcome).packed
        self._problem = problem = ForceProblem.from_packed(self._problem, packed)
        return problem

    # ---- the answer -----------------------------------------------------------------------

    @property
    def c(self) -> Array:
        """Contact forces in the contact frames, shape (m,) [N, N·m].

        Strictly inside every limit when SOLVED. When INFEASIBLE or WRENCH_UNREACHABLE, see
        :attr:`nearest`: the force for the wrench nearest to f, inside every limit; else zero, or
        where the limits exclude each other and no force keeps them all, the one that makes the
        wrench and violates the limits least. On the edge when ON_EDGE. Zero when UNBOUNDED.
        """
        return self._outcome.c

    @property
    def status(self) -> Status:
        """The verdict."""
        return Status(self._outcome.status)

    @property
    def nu(self) -> Array:
        """Multipliers of W c = f at the optimum, shape (k,): ∇Phi(c) = W.T nu, nu = dPhi*/df.

        Of a soft row, (f − W c)/f_soft².
        """
        return self._outcome.nu

    @property
    def nearest(self) -> bool:
        """Whether c, not SOLVED, is the force for the nearest wrench, strictly inside every limit.

        ``W c`` is then as near to f as such forces make it, in units of
        :meth:`ForceProblem.wrench_scales`, and :attr:`missing` is the least that can be missing.
        Of all forces that make it c is the one that Phi would choose. False where no force is
        strictly inside, where ``max_steps`` or ``budget_us`` ended the search (c is then inside,
        if anything was found there, but its wrench is not the nearest), and with SOLVED.
        """
        return self._outcome.nearest

    @property
    def missing(self) -> Array:
        """What c lacks of the wrench, f − W c, shape (k,) [N, N·m]."""
        return self.problem.f - self.problem.W @ self.c

    @property
    def newton_steps(self) -> int:
        """Newton steps taken, those of Phase 1 included."""
        return self._outcome.newton_steps

    @property
    def decrement(self) -> float:
        """Certified bound on the Newton decrement at c, for Phi over its unit; or inf.

        The unit is the least of alpha, the weights of the cones and 1.
        """
        return self._outcome.decrement

    @property
    def start(self) -> Start:
        """The start of the Newton steps that led to c."""
        return Start(self._outcome.start)

    @property
    def elapsed_us(self) -> float:
        """Time taken [µs]; measured only with ``Settings.budget_us``, else 0."""
        return self._outcome.elapsed_us

    @property
    def suboptimality(self) -> float:
        """Certified upper bound on Phi(c) − Phi*; inf when nothing is certified.

        With the decrement bounded by λ₁ < 1, a standard self-concordant function is within
        −λ₁ − ln(1 − λ₁) of its minimum.
        """
        inner = self.problem.restricted()
        unit = min(1.0, inner.alpha, *inner.cone_weight.tolist())
        return unit * float(equations.suboptimality(self._outcome.decrement))

    @property
    def violation(self) -> float:
        """The least relative violation of the limits when INFEASIBLE, else 0.

        A torque limit is violated relative to half its range, a cone or a ceiling relative to
        the contact's reach: the normal force that alone would use up its tightest limit.
        """
        return self._outcome.violation

    @property
    def certificate(self) -> Certificate | None:
        """The proof of infeasibility; None unless INFEASIBLE."""
        y, z = self._outcome.y, self._outcome.z
        if y is None or z is None:
            return None
        return Certificate(y, z[self.problem.counted_limits()])

    @property
    def message(self) -> str:
        """The verdict in words."""
        match self.status:
            case Status.SOLVED:
                problem = self.problem
                return solved_in_words(
                    self.newton_steps, self.suboptimality, problem.undetermined, problem.m
                )
            case Status.INFEASIBLE:
                lack = in_words(self.problem, self.c, self.nearest)
                return infeasible_in_words(self.violation, lack)
            case Status.WRENCH_UNREACHABLE:
                return UNREACHABLE_IN_WORDS + in_words(self.problem, self.c, self.nearest)
            case Status.ON_EDGE:
                return (
                    "the wrench is on the edge of what these contacts can make: forces on the "
                    "boundary of a friction cone or a limit make it, none strictly inside do"
                )
            case Status.UNBOUNDED:
                return (
                    "nothing limits the grip: give torque limits with J, or c_max, "
                    "or inequalities A c <= b that bound every contact"
                )
            case Status.MAX_STEPS:
                return f"stopped by max_steps or budget_us after {self.newton_steps} Newton steps"
            case Status.STALLED:
                return "rounding stopped the progress before a verdict could be certified"
            case Status.INVALID_NUMBERS:
                return "the problem's numbers overflow in double precision; rescale them"

    def raise_if_failed(self) -> None:
        """Raise unless SOLVED.

        Raises:
            InfeasibleGraspError: INFEASIBLE, WRENCH_UNREACHABLE or ON_EDGE.
            NotConvergedError: any other failure.
        """
        if self.status in (Status.INFEASIBLE, Status.WRENCH_UNREACHABLE, Status.ON_EDGE):
            raise InfeasibleGraspError(self)
        if self.status is not Status.SOLVED:
            raise NotConvergedError(self)

    # ---- residuals and margins, from the data alone ----------------------------------------

    @property
    def phi(self) -> float:
        """The objective at c: Phi of Eq. (16), and ½‖(W c − f)/f_soft‖² with it; inf outside."""
        problem, forces = self.without_pulls()
        inner = problem.restricted()
        return float(equations.objective(forces[problem.active_forces], inner.barriers))

    def without_pulls(self) -> tuple[ForceProblem, Array]:
        """Return the problem whose cones are all ordinary, and its forces: what proofs speak of.

        Returns:
            The problem :meth:`graspforce.ForceProblem.without_pulls`, and c with its preload, the
            internal forces of the motors behind it, shape (m + r,).
        """
        problem = self.problem
        forces = np.append(self.c, self.internal_forces) + problem.preload
        return problem.without_pulls(), forces

    @property
    def tau(self) -> Array:
        """Joint torques J.T c + tau_bias, shape (n_joints,) [N·m]; empty without J.

        Where J is by motors that are more than the motions, their forces, ``problem.internal`` and
        :attr:`internal_forces` included: see :attr:`motor_forces`.
        """
        problem = self.problem
        tau = equations.joint_torques(self.c, problem.J, problem.tau_bias)
        if problem.layout.internals:
            tau = tau + problem.internal.T @ self.internal_forces
        return tau

    @property
    def motor_forces(self) -> Array:
        """What each motor gives, in the order of the columns of J [N·m; N for slides and tendons].

        The same as :attr:`tau`: a hand's J has a column for each drive, a joint or tendon that
        motors move, by the names ``grasp.joint_names``.
        """
        return self.tau

    @property
    def internal_forces(self) -> Array:
        """The factors v of ``problem.internal``, by which motors pull against each other, (r,)."""
        return self._outcome.internal_forces

    @property
    def normal_forces(self) -> Array:
        """Normal force of every contact, shape (n,) [N]."""
        return self.c[self.problem.starts[:-1]]

    @property
    def forces_world(self) -> Array:
        """Force of every contact on the object, shape (n, 3) [N], in the axes of f.

        These are the axes in which the contacts' normals were given to :func:`grasp_map`: the
        world's, as a rule. The forces add up to f[:3]; the torsion of a soft finger is no force
        and left out.

        Raises:
            InvalidInputError: W is not the grasp map of a body in space, the contacts' axes in
                its first three rows.
        """
        problem, dims = self.problem, self.problem.layout.dims
        forces = np.zeros((problem.n, 3))
        parts = zip(
            equations.split(problem.W[:3], dims), equations.split(self.c, dims), strict=True
        )
        for i, (axes, c) in enumerate(parts):
            orthonormal = np.diag([1.0, 1.0, 1.0, 0.0][: len(c)])  # torsion is no force
            off = np.abs(axes.T @ axes - orthonormal).max()
            if len(problem.W) < 6 or off > UNIT_TOLERANCE:
                raise InvalidInputError(
                    f"forces_world: got W of shape {problem.W.shape} whose first three rows are "
                    f"not the axes of contact {i}, expected what grasp_map returns"
                )
            forces[i] = axes @ c
        return forces

    @property
    def _loaded(self) -> Array:
        """Contact forces with the preload of what pulls: what the ordinary cones hold, (m,)."""
        problem = self.problem
        return self.c + problem.preload[: problem.m] if problem.layout.pulls else self.c

    @property
    def friction_margins(self) -> Array:
        """Margins mu n − ‖tangential force‖, shape (n,) [N]; negative where a contact slips.

        FPC: the normal force. SFC: the torsion counts as (mu/gamma)·torsion. n is the normal force
        and what the contact pulls with (``pull``). A contact that is out of the grasp has no
        margin: inf. Where ``problem.undetermined`` is above 0, margins are those of the forces
        asked for: other forces take the same wrench and torques.
        """
        margins = equations.friction_margins(self._loaded, self.problem.cones)
        return np.where(self.problem.active, margins, np.inf)

    @property
    def friction_residual(self) -> float:
        """r_f of Eq. (22) over the contacts in the grasp [N²]; inf when there is none."""
        inner = self.problem.restricted()
        c = self._loaded[self.problem.active_components]
        return float(equations.friction_residual(c, inner.cones))

    @property
    def torque_margins(self) -> Array:
        """Distance of every joint torque to its nearer limit, shape (n_joints,) [N·m].

        A joint that acts only on contacts out of the grasp does not count: inf.
        """
        problem, tau = self.problem, self.tau
        margins = equations.torque_margins(tau, problem.tau_lo, problem.tau_hi)
        return np.where(problem.counted_limits()[: len(tau)], margins, np.inf)

    @property
    def torque_residual(self) -> float:
        """r_tau of Section IV-A: the smallest torque margin [N·m]; inf without joints."""
        return float(self.torque_margins.min(initial=math.inf))

    @property
    def wrench_error(self) -> float:
        """Largest |W c − f| [N, N·m]."""
        return float(equations.wrench_error(self.c, self.problem.W, self.problem.f))

    def verify(self) -> Verification:
        """Recompute every residual from the problem's data and judge the status by them.

        ``ok`` always takes finite forces and multipliers, no force of a contact that is out of the
        grasp, and a Newton decrement at c, computed in NumPy, of at most ``decrement`` wherever
        that is finite: but for 1e-6 of it and for what the rounding of c and W may have moved.
        Besides, by status:

        * SOLVED: c is strictly inside every cone and limit, and W c = f holds to 1e-9 of the
          wrenches that add up to f, but for its soft rows.
        * INFEASIBLE: the certificate proves it, and no larger violation than is stated; c is
          strictly inside every cone and limit, or limits moved out by ``violation`` admit it.
        * WRENCH_UNREACHABLE: f is out of the range of W by more than 1e-9.
        * ON_EDGE: limits moved out by 1e-9 admit c, and W c = f holds to 1e-7.
        * Any of these with ``nearest``: c is strictly inside.
        * UNBOUNDED: the problem has no limits but floors; or there are forces, found here and not
          by the solver, with W c = f, strictly inside every cone and limit, and 1e6 times as
          large as what the limits are made for (the largest bound over the largest entry of its
          row, or the wrench).
        * MAX_STEPS and STALLED claim no more than that their numbers hold.
        * INVALID_NUMBERS: the problem has numbers beyond 1e±60, whose products leave double
          precision.
        """
        return verify(self._outcome, self.problem)

    def __repr__(self) -> str:
        return (
            f"Solution({self.status.name}, normal_forces="
            f"{np.array2string(self.normal_forces, precision=4)} N, "
            f"friction_residual={self.friction_residual:.4g} N², "
            f"torque_residual={self.torque_residual:.4g} N·m, newton_steps={self.newton_steps})"
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Solution):
            return NotImplemented
        return (
            self.status == other.status
            and self.problem == other.problem
            and np.array_equal(self.c, other.c)
        )

    def __hash__(self) -> int:
        return hash((self.status, hash_bytes(self.c)))

    def __reduce__(self) -> tuple[Any, ...]:
        raw = self._outcome
        plain = PlainOutcome(
            raw.status, raw.newton_steps, raw.c, raw.nu, raw.decrement, raw.violation, raw.y, raw.z,
            raw.start, raw.elapsed_us, raw.internal_forces, raw.nearest,
        )  # fmt: skip
        return (Solution, (plain, self.problem))
