"""Closing a hand: from a pose near the object to contacts that hold it.

The object is pinned where it is. Every finger is drawn, by the part of it that is nearest, straight
the shortest way to the object, or towards a point that the user names: with a force that is
limited, at a speed that is limited. A drive that moves two fingers, as of a gripper, moves with the
sum of both. The arm is held. When nothing moves any more, the contacts are asked whether they hold
the object's weight; where they do not, an error says in words what is missing. Else the loop takes
over while the object is still pinned, so that it is let go with the forces that hold it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array, as_array, as_positive
from graspforce.errors import GraspForceWarning, InvalidInputError
from graspforce.grasp import Grasp
from graspforce.hands.mujoco.model import bias_forces, compensated_by_motors
from graspforce.hands.mujoco.motors import MujocoMotors
from graspforce.sim.hand_loop import HandLoop, limits_of, quiet_reader, softness
from graspforce.sim.mujoco_import import mj, silenced_warnings
from graspforce.sim.world import Physics
from graspforce.solve import solve
from graspforce.trajectory import GRAVITY

# How fast a finger comes near, and how fast joints may still turn or slide when all is at rest.
_APPROACH = 0.15  # [m/s]
_AT_REST = 0.005  # [rad/s; m/s]
_RESTING = 0.05  # for how long [s]
_TAKING_OVER = 0.1  # how long the loop holds the object before it is let go [s]
_HEAVY = 1e4
_DAMPING = 20.0  # of all joints [1/s]
_SPRING = 200.0  # of joints that have come to touch [1/s²]
_STEERING = 100.0  # of a finger's motion aside of its way [1/s]
_NEAR = 5e-4  # from here on a finger presses and is not steered [m]
_LOOKS = 5  # in how many steps the nearest points are looked for once
_FAR = 0.5  # beyond it a finger has nothing to do with the object [m]
# The share of the weight by which the wrench of a grasp that holds it may be off.
_GOOD = 0.05


class _Finger(NamedTuple):
    """What moves together at the end of the arm."""

    name: str
    geoms: NDArray[np.intp]


class _Way(NamedTuple):
    """Where a finger is nearest to the object."""

    distance: float
    geom: int
    """Drawn at its centre, a face comes to lie flat."""
    direction: Array
    """To the object, a unit vector in world axes."""


def close(
    model: Any,
    body: str,
    start: ArrayLike | None = None,
    *,
    force: float | None = None,
    touch: Mapping[str, ArrayLike] | None = None,
    duration: float = 3.0,
    tau_max: float | Mapping[str, float] | None = None,
) -> Array:
    """Close a hand on an object that is pinned where it is, and return the configuration.

    Args:
        model: a compiled ``mujoco.MjModel``; it stays as it is.
        body: the object's name.
        start: joint positions to begin with, the open hand around the object, shape (nq,); by
            default those of the model's first keyframe, or qpos0.
        force: with which each finger presses [N]; by default twice the object's weight.
        touch: points to aim at, in the object's frame, by the names of the fingers' bodies [m]; by
            default the nearest there are.
        duration: how long it may take [s].
        tau_max: torque limits besides the model's, as for :class:`HandLoop`.

    Returns:
        Joint positions with the fingers in contact, shape (nq,), the ``start`` of a
        :class:`Trial`.

    Raises:
        InvalidInputError: a name that is not there; no finger at all; contacts that do not hold
            the object's weight: the text says which fingers touch, how far the others are, and on
            which side contacts are missing.
        ModelImportError: an actuator of a kind, or without a limit, that no torque can be sent to.
    """
    at = as_array(open_pose(model) if start is None else start, "start", (model.nq,))
    with silenced_warnings():
        return _Closing(model, body, at, force, touch, tau_max).run(
            as_positive(duration, "duration", "s")
        )


def open_pose(model: Any) -> Array:
    """Return the joint positions of a model's first keyframe, or qpos0, shape (nq,)."""
    return np.array(model.key_qpos[0] if model.nkey else model.qpos0, dtype=float)


class _Closing:
    """One closing of a hand."""

    def __init__(
        self,
        model: Any,
        body: str,
        start: Array,
        force: float | None,
        touch: Mapping[str, ArrayLike] | None,
        tau_max: float | Mapping[str, float] | None,
    ) -> None:
        self._physics = physics = Physics(model, start, body)
        self._model, self._data, self._body = physics.model, physics.data, body
        mj.mj_forward(self._model, self._data)
        self._pinned = np.array(start)
        weight = physics.mass * (float(np.linalg.norm(model.opt.gravity)) or GRAVITY)
        self._weight = weight
        self._force = 2 * weight if force is None else as_positive(force, "force", "N")
        self._tau_max = tau_max
        self._motors = MujocoMotors(model, tau_max=tau_max)
        self._ways: list[_Way] = []
        # Where each drive was when the fingers that it moves had come to touch.
        self._touched = np.full(len(self._motors.joint_names), np.nan)
        self._reader = quiet_reader(self._model, self._data, body, self._motors)
        self._lengths = self._motors.lengths(self._data)
        self._fingers, self._carried = self._find_fingers()
        if not self._fingers:
            raise InvalidInputError(
                f"model: no motor moves anything that can touch {body!r}, expected a hand"
            )
        self._aims = self._find_aims(touch or {})
        self._own_geoms = np.flatnonzero(
            self._reader.inside[self._model.geom_bodyid] & _collides(self._model)
        )
        self._mass_matrix = np.zeros((model.nv, model.nv))
        self._jacobian = np.zeros((3, model.nv))

    def run(self, duration: float) -> Array:
        """Close the hand; return joint positions.

        Raises:
            InvalidInputError: the contacts do not hold the object.
        """
        model, data, resting = self._model, self._data, 0.0
        dt = float(model.opt.timestep)
        steps = 0
        # Put back after every step, it would still give way within one: so it is made heavy, and
        # its weight is taken off.
        self._physics.multiply_mass(_HEAVY)
        inside = self._reader.inside
        lift: Array = data.xfrc_applied[:, :3]
        lift[inside] = np.outer(model.body_mass[inside], -model.opt.gravity)
        while data.time < duration and resting < _RESTING:
            mj.mj_step1(model, data)
            self._reader.update(data)
            if steps % _LOOKS == 0:
                self._ways = [self._way(i) for i in range(len(self._fingers))]
                self._note_touched()
            self._motors.write(data, self._torques(), dt)
            self._step()
            still = np.abs(self._motors.rates(data)).max() < _AT_REST
            resting = resting + dt if still and data.time > _RESTING else 0.0
            steps += 1
        self._physics.multiply_mass(1 / _HEAVY)
        lift[inside] = 0.0
        mj.mj_forward(model, data)
        self._reader.update(data)
        self._require_hold()
        loop = HandLoop(model, data, self._body, tau_max=self._tau_max)
        while data.time < duration + _TAKING_OVER and resting < _RESTING + _TAKING_OVER:
            mj.mj_step1(model, data)
            loop.step(0.0)
            self._step()
            resting += dt
        return np.array(data.qpos)

    def _step(self) -> None:
        """Finish a step of the physics; the object stays where it is."""
        mj.mj_step2(self._model, self._data)
        if self._physics.failure():
            raise InvalidInputError(
                f"model: closing the hand diverged at {self._data.time:.3f} s: "
                f"{self._physics.failure()}"
            )
        self._pin()

    def _pin(self) -> None:
        """Put the object back to where it was."""
        model, data = self._model, self._data
        joint = int(model.body_jntadr[self._physics.body])
        if joint >= 0 and model.jnt_type[joint] == int(mj.mjtJoint.mjJNT_FREE):
            q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            data.qpos[q : q + 7] = self._pinned[q : q + 7]
            data.qvel[v : v + 6] = 0.0

    # ---- the fingers ---------------------------------------------------------------------------

    def _find_fingers(self) -> tuple[list[_Finger], NDArray[np.bool_]]:
        """Return the fingers, and which drives carry all of them: the arm's."""
        model, dofs = self._model, self._reader.motion[0]
        driven = np.zeros(model.nv, dtype=bool)
        driven[dofs] = True
        moved = self._reader.moved_by(np.arange(int(model.nbody), dtype=np.intp))[:, driven].any(
            axis=1
        )
        moved &= ~self._reader.inside
        hands: list[tuple[int, list[int]]] = []
        for root in dict.fromkeys(model.body_rootid[moved].tolist()):
            bodies: list[int] = np.flatnonzero(moved & (model.body_rootid == root)).tolist()
            parents: set[int] = set(model.body_parentid[bodies].tolist())
            ends = [each for each in bodies if each not in parents]
            hands.append((_palm(model, ends), bodies))
        carrying = np.zeros(model.nv, dtype=bool)
        groups: dict[int, list[int]] = {}
        for palm, bodies in hands:
            if palm:
                carrying |= self._reader.moved_by(np.array([palm], dtype=np.intp))[0]
            for each in bodies:
                top = _below(model, each, palm)
                if top is not None:
                    groups.setdefault(top, []).append(each)
        self._merge(groups)
        fingers: list[_Finger] = []
        for bodies in groups.values():
            geoms = np.flatnonzero(np.isin(model.geom_bodyid, bodies) & _collides(model))
            if len(geoms):
                name = model.body(int(model.geom_bodyid[geoms].max())).name
                fingers.append(_Finger(name, geoms))
        columns = self._reader.motion[1]
        return fingers, (columns[carrying[dofs]] != 0).any(axis=0)

    def _merge(self, groups: dict[int, list[int]]) -> None:
        """Make one finger of groups that a closed linkage connects."""
        model = self._model
        place = (int(mj.mjtEq.mjEQ_CONNECT), int(mj.mjtEq.mjEQ_WELD))
        for each in range(model.neq):
            if int(model.eq_type[each]) not in place or not model.eq_active0[each]:
                continue
            pair = (int(model.eq_obj1id[each]), int(model.eq_obj2id[each]))
            if int(model.eq_objtype[each]) == int(mj.mjtObj.mjOBJ_SITE):
                pair = (int(model.site_bodyid[pair[0]]), int(model.site_bodyid[pair[1]]))
            tops = [top for top, bodies in groups.items() if set(pair) & set(bodies)]
            if len(tops) == 2:
                groups[tops[0]] += groups.pop(tops[1])

    def _find_aims(self, touch: Mapping[str, ArrayLike]) -> list[Array | None]:
        """Return where each finger aims, in the object's frame."""
        aims: list[Array | None] = [None] * len(self._fingers)
        for name, point in touch.items():
            body = mj.mj_name2id(self._model, mj.mjtObj.mjOBJ_BODY, name)
            owners = [
                i
                for i, finger in enumerate(self._fingers)
                if body in self._model.geom_bodyid[finger.geoms]
            ]
            if body < 0 or not owners:
                known = ", ".join(finger.name for finger in self._fingers)
                raise InvalidInputError(f"touch: got {name!r}, expected fingers of {known}")
            aims[owners[0]] = as_array(point, f"touch[{name!r}]", (3,))
        return aims

    def _nearest(self, finger: _Finger) -> tuple[float, int, Array, Array]:
        """Return the distance to the object, the geom, its nearest point and the way there."""
        best, found = np.inf, (0, np.zeros(6))
        for own in self._own_geoms.tolist():
            for geom in finger.geoms.tolist():
                ends = np.zeros(6)
                distance = mj.mj_geomDistance(self._model, self._data, geom, own, _FAR, ends)
                if distance < best:
                    best, found = float(distance), (geom, ends)
        geom, ends = found
        way = (ends[3:] - ends[:3]) / (best or 1e-12)
        return best, geom, ends[:3], way / max(float(np.linalg.norm(way)), 1e-12)

    def _way(self, finger: int) -> _Way:
        """Return from where on a finger the way to the object is the shortest."""
        data, aim = self._data, self._aims[finger]
        geoms = self._reader.geoms[:, 0]
        touching = np.flatnonzero(np.isin(geoms, self._fingers[finger].geoms))
        if len(touching):
            distance, geom, near = 0.0, int(geoms[touching[0]]), np.zeros(3)
            same = touching[geoms[touching] == geom]
            direction = self._reader.normals[same].mean(axis=0)
            direction /= float(np.linalg.norm(direction))
        else:
            distance, geom, near, direction = self._nearest(self._fingers[finger])
            if distance < 1e-4 and self._ways:  # too short to have a direction
                direction = self._ways[finger].direction
        if aim is not None and distance > _NEAR:
            place = data.xmat[self._physics.body].reshape(3, 3) @ aim
            direction = place + data.subtree_com[self._physics.body] - near
            direction /= max(float(np.linalg.norm(direction)), 1e-12)
        return _Way(distance, geom, direction)

    def _note_touched(self) -> None:
        """Note how the drives stand whose fingers have come to touch, all that each moves."""
        dofs, driven = self._reader.motion
        waiting = np.zeros(len(driven.T), dtype=bool)
        touching = np.zeros(len(driven.T), dtype=bool)
        for finger, way in zip(self._fingers, self._ways, strict=True):
            bodies = self._model.geom_bodyid[finger.geoms]
            moved = self._reader.moved_by(bodies)[:, dofs].any(axis=0)
            of_finger = (driven[moved] != 0).any(axis=0)
            (touching if way.distance <= _NEAR else waiting)[of_finger] = True
        new = touching & ~waiting & np.isnan(self._touched)
        self._touched[new] = self._motors.lengths(self._data)[new]

    # ---- the law -------------------------------------------------------------------------------

    def _torques(self) -> Array:
        """Return what the motors are to give, in their order."""
        model, data = self._model, self._data
        dofs, driven = self._reader.motion
        mj.mj_fullM(model, data, self._mass_matrix)
        rates, off = self._motors.rates(data), self._motors.lengths(data) - self._lengths
        M = driven.T @ self._mass_matrix[np.ix_(dofs, dofs)] @ driven
        free = ~self._carried & driven.any(axis=0)
        moving = driven[:, free]
        inverse = np.linalg.inv(M[np.ix_(free, free)])
        drawn = np.zeros(len(free))
        for way in self._ways:
            if way.distance >= _FAR:
                continue
            body = int(model.geom_bodyid[way.geom])
            mj.mj_jac(model, data, self._jacobian, None, data.geom_xpos[way.geom], body)
            velocity = self._jacobian @ data.qvel
            speed = float(way.direction @ velocity)
            push = self._force * np.clip(1 - speed / _APPROACH, -1.0, 1.0)
            J = self._jacobian[:, dofs] @ moving
            force = push * way.direction
            if way.distance > _NEAR:
                inertia = np.linalg.pinv(J @ inverse @ J.T, rcond=1e-2, hermitian=True)
                towards = inertia @ way.direction
                aside = speed * way.direction - velocity
                force = push * towards / float(way.direction @ towards)
                force += _STEERING * (inertia @ aside)
                most = 4 * self._force
                force *= min(1.0, most / max(float(np.linalg.norm(force)), 1e-12))
            drawn[free] += J.T @ force
        # What friction in the joints takes would be missing at the finger.
        drawn += np.sign(drawn) * (np.abs(driven).T @ model.dof_frictionloss[dofs])
        held = self._carried * (-400.0 * off - 40.0 * rates)
        # A finger that presses would buckle but for a spring about how it touched.
        bent = np.nan_to_num(self._motors.lengths(data) - self._touched)
        held -= ~self._carried * (_SPRING * bent + _DAMPING * rates)
        return drawn + driven.T @ bias_forces(data, compensated_by_motors(model))[dofs] + M @ held

    # ---- what came of it -----------------------------------------------------------------------

    def _require_hold(self) -> None:
        """Raise unless the contacts hold the object's weight.

        Raises:
            InvalidInputError: they do not; the text says what is missing.
        """
        reader, name = self._reader, self._body
        links = reader.links
        where = self._where()
        if not links:
            raise InvalidInputError(f"start: the hand closed and nothing touches {name!r}: {where}")
        side = _one_side(reader.normals)
        if side is not None:
            direction = ", ".join(f"{each:.2f}" for each in side)
            raise InvalidInputError(
                f"start: all contacts are on one side of {name!r}: together they push it along "
                f"({direction}) and nothing pushes back; {where}"
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", GraspForceWarning)  # the loop's reader notes it
            limits = limits_of(self._motors, self._data)
            grasp = Grasp.from_mujoco(self._model, self._data, name, tau_max=limits)
        gravity = self._model.opt.gravity
        f = np.append(-self._physics.mass * gravity, np.zeros(3))
        arm = float(np.linalg.norm(reader.points - reader.origin, axis=1).max())
        problem = grasp.problem(f, f_soft=softness(self._weight, arm), c_max=20 * self._weight)
        solution = solve(problem)
        missed = float(np.linalg.norm((solution.c @ grasp.W.T - f)[:3])) / self._weight
        if solution.status is not Status.SOLVED or missed > _GOOD:
            reason = solution.message or f"{missed:.0%} of it is missing"
            raise InvalidInputError(
                f"start: the contacts do not hold the weight of {name!r} within friction and the "
                f"motors' limits ({reason}); {where}"
            )

    def _where(self) -> str:
        """Say where each finger is."""
        touching: list[str] = []
        bodies = self._model.geom_bodyid[self._reader.geoms[:, 0]].tolist()
        for finger in self._fingers:
            own = set(self._model.geom_bodyid[finger.geoms].tolist())
            count = sum(body in own for body in bodies)
            distance = self._nearest(finger)[0]
            far = "more than 500" if distance >= _FAR else f"{1e3 * max(distance, 0):.1f}"
            touching.append(
                f"{finger.name} {f'touches at {count} points' if count else f'is {far} mm away'}"
            )
        return "; ".join(touching)


def _collides(model: Any) -> NDArray[np.bool_]:
    """Return which geoms can touch anything, shape (ngeom,)."""
    found: NDArray[np.bool_] = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return found


def _ancestors(model: Any, body: int) -> list[int]:
    """Return a body and those above it, to the world."""
    found = [body]
    while found[-1]:
        found.append(int(model.body_parentid[found[-1]]))
    return found


def _palm(model: Any, ends: list[int]) -> int:
    """Return the last body that carries all of ``ends``: of one alone, the world."""
    if len(ends) < 2:
        return 0
    common = set(_ancestors(model, ends[0]))
    for end in ends[1:]:
        common &= set(_ancestors(model, end))
    return max(common)


def _below(model: Any, body: int, palm: int) -> int | None:
    """Return the child of the palm that carries a body; None for others."""
    chain = _ancestors(model, body)
    if palm not in chain or chain[0] == palm:
        return None
    return chain[chain.index(palm) - 1]


def _one_side(normals: Array) -> Array | None:
    """Return where contacts push that all push to one side, a unit vector; else None.

    The point nearest to 0 in the normals' convex hull, by Gilbert's method.
    """
    nearest = normals.mean(axis=0)
    for _ in range(200):
        corner = normals[np.argmin(normals @ nearest)]
        step = nearest - corner
        if step @ step < 1e-12:
            break
        nearest = nearest - np.clip(nearest @ step / (step @ step), 0.0, 1.0) * step
    size = float(np.linalg.norm(nearest))
    return nearest / size if size > 0.5 else None
