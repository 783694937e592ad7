"""The compiled core of graspforce; see graspforce._engine."""

from collections.abc import Sequence
import types
from typing import Annotated

import numpy
from numpy.typing import NDArray


class SolutionBase:
    """Outcome and problem of a Solution."""

def instruction_sets() -> list[str]:
    """Which of the modules besides _core this processor runs, the best last."""

def solve(solution: object, problem: object, layout: object, packed: object, start: object | None, tol: float, max_steps: int, budget_us: float) -> object:
    """Solves a ForceProblem; what comes back is a `solution`."""

def solve_batch(layout: object, count: int, fields: Sequence[object], start: object | None, c: object, nu: object, status: object, newton_steps: object, starts: object, nearest: object, decrement: object, violation: object, tol: float, max_steps: int, budget_us: float, threads: int) -> tuple[object, object]:
    """
    Solves `count` problems of a layout, whose fields are arrays of one row each or of one that all share, into the arrays given; the infeasible rows and their certificates.
    """

def kkt_solve_batch(layout: object, count: int, fields: Sequence[object], c: object, wanted: object, x: object, threads: int) -> None:
    """
    kkt_solve in place for a right-hand side x, (B, m + r + k), of the rows wanted; zeros for the others and for those with forces c that are not strictly inside.
    """

def pull_back_batch(layout: object, count: int, fields: Sequence[object], c: object, nu: object, wanted: object, gradients: Sequence[object], out: Sequence[object], threads: int) -> None:
    """
    Pulls the gradients of a number by the answers' c, internal forces, tau, Phi, margins (None: it does not depend on them) back to the fields, into `out`, in the layout's order; zeros in rows that are not wanted.
    """

def kkt_solve(layout: object, packed: object, c: object, rhs: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None))]:
    """
    Solves H d + W.T nu = g, W d = r for every column (g, r) of rhs, shape (m + r + k, n), with the Hessian H of Phi at forces c, shape (m,), and the internal ones behind them, strictly inside every limit. Contacts out of the grasp get d = 0; dependent rows of W need r in its range and get nu = 0.
    """

def fields(layout: object) -> list[tuple[str, int, int, int]]:
    """
    Name, place in the buffer, rows and columns of every field of a layout.
    """

def find_flaw(layout: object, packed: object) -> object:
    """
    The first of a problem's numbers that is not finite or out of its range: the field, the indices of the entry, what came, what was expected; or None.
    """

def time_ticks(layout: object, packed: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], rounds: int, tol: float, max_steps: int, cold: bool) -> object:
    """
    Times of warm ticks, or of cold solves, without Python in between [ns].
    """

class Outcome:
    @property
    def status(self) -> int: ...

    @property
    def newton_steps(self) -> int: ...

    @property
    def decrement(self) -> float: ...

    @property
    def violation(self) -> float: ...

    @property
    def nearest(self) -> bool: ...

    @property
    def start(self) -> int: ...

    @property
    def elapsed_us(self) -> float: ...

    @property
    def c(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...

    @property
    def internal_forces(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...

    @property
    def nu(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...

    @property
    def y(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)] | None: ...

    @property
    def z(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)] | None: ...

    @property
    def packed(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)] | None: ...

class ContactBook:
    def __init__(self, counts: Sequence[int], spare: int, ramp: float, patience: float, reach: float) -> None: ...

    def update(self, points: object, normals: object, links: Sequence[int], dt: object, position: object, rotation: object) -> bool: ...

    @property
    def links(self) -> list[int]: ...

    @property
    def points(self) -> object: ...

    @property
    def axes(self) -> object: ...

    @property
    def engagement(self) -> object: ...

    @property
    def cone_weights(self) -> object: ...

    @property
    def present(self) -> object: ...

    @property
    def slots(self) -> object: ...

    @property
    def without_slot(self) -> int: ...

class Actuators:
    def __init__(self, own: object, counts: Sequence[int], places: object, gears: object, gains: object, biases: object, controls: object, forces: object, x: object, lags: Sequence[int], times: object) -> None: ...

    def set_curves(self, i: int, gain: float, bias: float) -> None: ...

    def limits(self, lengths: object, rates: object, states: object, controls: object) -> tuple[object, object]: ...

    def lengths(self, lengths: object, rates: object, states: object, controls: object) -> object: ...

    def rates(self, lengths: object, rates: object, states: object, controls: object) -> object: ...

    def damping(self, lengths: object, rates: object, states: object, controls: object) -> object: ...

    def send(self, lengths: object, rates: object, states: object, controls: object, torques: object, dt: float, step: float, at_once: bool) -> None: ...

    def torques(self, lengths: object, rates: object, states: object, controls: object, dt: float, step: float) -> object: ...

class RobotMotion:
    def __init__(self, mass_matrix: object, places: object, ends: object, near: object, above: object, roots: object, damping: object, qpos: object, qvel: object, subtree_com: object, cvel: object, cdof_dot: object) -> None: ...

    def follow(self, points: object, axes: object, dims: object, links: object, position: object, spin: object, acceleration: object) -> object: ...

    def inertia(self, dofs: object, driven: object, time: float, motor_damping: object) -> tuple[object, object]: ...

def rotation_vector(R: object) -> object:
    """Axis times angle of a rotation matrix."""

def object_acceleration(stiffness: float, damping: float, turned: object, position: object, rotation: object, velocity: object, spin: object, linear: object, angular: object, position_now: object, rotation_now: object, velocity_now: object, spin_now: object) -> object:
    """
    The acceleration that brings an object to its target; None of arrays to convert.
    """

def object_wrench(mass: float, inertia: object, acceleration: object, rotation: object, spin: object, gravity: object) -> object:
    """The wrench that makes an acceleration; None of arrays to convert."""

def drive_rows(moments: object, counts: object, starts: object, columns: object, outputs: object, gears: object, dofs: int) -> object:
    """How joints move drives, (k, dofs), of MuJoCo's sparse moments."""

def any_at_end(values: object, places: object, low: object, high: object) -> bool:
    """Whether any value at these places is at or beyond an end of its range."""

def contact_axes(points: object, frames: object, places: object, side: object) -> tuple[object, object]:
    """Points and axes of MuJoCo's contacts at these places."""

def joint_screws(cdof: object, dofs: object, centres: object, roots: object, origin: object) -> object:
    """The joints' screws about a point, (k, 6), of MuJoCo's cdof."""

def contact_maps(points: object, axes: object, dims: object, origin: object, screws: object, moved: object, dofs: object) -> tuple[object, object]:
    """
    W of contacts, (6, m), and their work along screws as far as these move them, (m, k).
    """

def linkage_rows(turns: object, kinds: Sequence[int], counts: Sequence[int], gradients: object, gaps: object) -> tuple[object, float]:
    """
    What couplings leave no joint motion along, without what is play, and by which share of its size the most open loop is open.
    """

def span(rows: object, least: float) -> object:
    """An orthonormal basis of what rows span, as rows."""

def determined_motions(drives: object, couplings: object) -> object:
    """
    The joints' motions by each drive's, where drives and couplings fix them all.
    """

def nearest_motion(metric: object, J: object, wanted: object, weights: object, give: float, wished: object) -> object:
    """
    Of all accelerations q with J q = wanted, the one nearest in the metric to the one wished.
    """

class Servo:
    def __init__(self, layout: object, packed: object, tol: float, max_steps: int, budget_us: float, statuses: Sequence[object], refuse: object, solution: object) -> None: ...

    step: types.MethodDescriptorType = ...

    def tick(self) -> object: ...

    def step_problem(self, packed: object, problem: object) -> object: ...

    def last(self) -> Outcome | None: ...

    def reset(self) -> None: ...

    @property
    def packed(self) -> object: ...

    @property
    def numbers(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]: ...

    @property
    def c(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...

    @property
    def internal_forces(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...

    @property
    def nu(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), writable=False)]: ...
