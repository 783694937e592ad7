"""Controls that make wanted torques, whatever kind of actuator takes them.

MuJoCo's actuators make the force ``gain·x + bias``, cut off at their ``forcerange``: x is the
control or, of actuators that lag behind it, an activation that follows the control; gain and bias
are numbers of the actuator, its length and its velocity. A ``<motor>`` has no bias; a position
servo has the gain kp and the bias −kp·q − kv·q̇. Solved for x, a servo is told the position at which
it makes the torque, and as much as its ``ctrlrange`` reaches is its limit. What an actuator is like
is read here; the core's ``actuators.hpp`` computes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspforce._engine import native
from graspforce._util.arrays import Array, as_array, as_positive, as_tuple
from graspforce.errors import InvalidInputError, ModelImportError
from graspforce.hands.limits import as_tau_max
from graspforce.hands.mujoco.contacts import Indices
from graspforce.hands.mujoco.model import drives, mujoco_module, name_of

_GAINS = ("FIXED", "AFFINE", "MUSCLE")
_BIASES = ("NONE", "AFFINE", "MUSCLE")
# As the core numbers them.
_DYNAMICS = ("NONE", "INTEGRATOR", "FILTER", "FILTEREXACT", "MUSCLE")


class MujocoMotors:
    """What to send to a model's actuators so that they make wanted torques.

    Motors, position and velocity servos, cylinders, muscles and other ``general`` actuators with
    affine gain and bias, on joints and tendons::

        motors = gf.hands.MujocoMotors(model, reader.joint_names)
        tau_lo, tau_hi = motors.limits(data)
        solution = servo.step(W=reader.W, J=reader.J, tau_lo=tau_lo, tau_hi=tau_hi)
        motors.write(data, solution.motor_forces, dt)

    Several actuators of one joint or tendon share its torque in proportion to what each can give.

    Args:
        model: the ``mujoco.MjModel``.
        joint_names: joints and tendons with motors, the order of tau; by default all of them.
        tau_max: torque limits besides the model's, both ways: one number for all, or by name
            [N·m; N for slides and tendons].

    Attributes:
        joint_names: the n joints and tendons.

    Raises:
        InvalidInputError: a name that has no motor.
        ModelImportError: an actuator of a kind whose force is not known here.
    """

    def __init__(
        self,
        model: Any,
        joint_names: Sequence[str] | None = None,
        tau_max: float | Mapping[str, float] | None = None,
    ) -> None:
        mj = self._mj = mujoco_module()
        known = {drive.limit.name: drive for drive in drives(model)[0]}
        names = tuple(known) if joint_names is None else as_tuple(joint_names, "joint_names", str)
        for name in names:
            if name not in known:
                raise InvalidInputError(
                    f"joint_names: got {name!r}, which has no motor, expected some of "
                    f"{', '.join(known)}"
                )
        self.joint_names, self._model = names, model
        given = as_tau_max(tau_max, names)
        most = np.array([given.get(name, np.inf) for name in names])
        own = np.column_stack((-most, most))
        of_each: list[list[int]] = [[] for _ in names]
        for motor in range(model.nactuator):
            found = _target(mj, model, motor)
            if found is None or found[0] not in names:
                continue
            _require_known(mj, model, motor)
            drive, (kind, target) = names.index(found[0]), found[1:]
            of_each[drive].append(motor)
            if getattr(model, f"{kind}_actfrclimited")[target]:
                low, high = getattr(model, f"{kind}_actfrcrange")[target]
                own[drive] = max(-most[drive], low), min(most[drive], high)
        motors: Indices = np.array([i for each in of_each for i in each], dtype=np.intp)
        muscles = model.actuator_gaintype[motors] == int(mj.mjtGain.mjGAIN_MUSCLE)
        self._muscles = [(i, int(motors[i])) for i in np.flatnonzero(muscles).tolist()]
        self._outputs: Indices = model.actuator_outadr[motors].astype(np.intp)
        self._core: Any = native.module.Actuators(
            own, [len(each) for each in of_each], *_actuators(mj, model, motors)
        )

    def limits(self, data: Any) -> tuple[Array, Array]:
        """Return the torques that the motors reach as the joints are, each shape (n,).

        Those of a position servo depend on where its joint is: its ``ctrlrange`` bounds how far
        from there it can be told to go. One beyond its range has a single torque, and limits a
        millionth of it apart.

        Args:
            data: the simulation's data, after ``mj_step1`` or ``mj_forward``.
        """
        return self._core.limits(*self._numbers(data))

    def lengths(self, data: Any) -> Array:
        """Return where the joints and tendons are, shape (n,) [rad; m]."""
        return self._core.lengths(*self._numbers(data))

    def rates(self, data: Any) -> Array:
        """Return how fast they move, shape (n,) [rad/s; m/s]."""
        return self._core.rates(*self._numbers(data))

    def damping(self, data: Any) -> Array:
        """Return by how much the motors' torques fall with the joints' rates, shape (n,)."""
        return self._core.damping(*self._numbers(data))

    def write(self, data: Any, tau: ArrayLike, dt: float, *, at_once: bool = False) -> Array:
        """Set the controls that make torques, and return the torques that they make.

        Args:
            data: the simulation's data, after ``mj_step1`` or ``mj_forward``.
            tau: wanted, in the order of ``joint_names``, shape (n,) [N·m; N].
            dt: how long these controls stay, by which actuators with a lag are told to go further
                [s].
            at_once: set the state of actuators with a lag, too, as for a simulation that begins.

        Returns:
            The torques that come of it, shape (n,): within the limits, and for actuators with a
            lag by the end of ``dt``.

        Raises:
            InvalidInputError: a wrong shape, numbers that are not finite, a dt not above 0.
        """
        wanted = as_array(tau, "tau", (len(self.joint_names),))
        time, step = as_positive(dt, "dt", "s"), float(self._model.opt.timestep)
        numbers = self._numbers(data)
        self._core.send(*numbers, wanted, time, step, bool(at_once))
        return self._core.torques(*numbers, time, step)

    def send(self, data: Any, tau: Array, dt: float, *, at_once: bool = False) -> None:
        """Set the controls as :meth:`write` does, and check no numbers.

        Args:
            data: the simulation's data.
            tau: wanted torques, shape (n,).
            dt: how long these controls stay.
            at_once: as for a simulation that begins.
        """
        step = float(self._model.opt.timestep)
        wanted = np.ascontiguousarray(tau, dtype=float)
        self._core.send(*self._numbers(data), wanted, dt, step, bool(at_once))

    def _numbers(self, data: Any) -> tuple[Array, Array, Array, Array]:
        """Return what the core reads and writes, muscles' curves being as they are just now."""
        lengths, rates = data.actuator_length, data.actuator_velocity
        model, mj = self._model, self._mj
        for i, motor in self._muscles:
            output = self._outputs[i]
            length, rate = lengths[output], rates[output]
            strength = float(model.actuator_acc0[output])
            between = model.actuator_lengthrange[output]
            prm, of_bias = model.actuator_gainprm[motor, :9], model.actuator_biasprm[motor, :9]
            self._core.set_curves(
                i, mj.mju_muscleGain(length, rate, between, strength, prm),
                mj.mju_muscleBias(length, between, strength, of_bias),
            )  # fmt: skip
        return lengths, rates, data.act, data.ctrl


def _actuators(mj: Any, model: Any, motors: Indices) -> tuple[Any, ...]:
    """Return what the core asks of each actuator: places, gear, gain, bias, ranges, lag, times."""
    outputs, inputs = model.actuator_outadr[motors], model.actuator_ctrladr[motors]
    count = model.actuator_actnum[motors]
    # The state that the force depends on where the actuator has dynamics.
    states = np.where(count > 0, model.actuator_actadr[motors] + count - 1, -1)
    gains, biases = mj.mjtGain, mj.mjtBias
    gain_type = model.actuator_gaintype[motors]
    gain = np.array(model.actuator_gainprm[motors, :3])
    gain[gain_type == int(gains.mjGAIN_FIXED), 1:] = 0.0
    bias = np.array(model.actuator_biasprm[motors, :3])
    bias[model.actuator_biastype[motors] != int(biases.mjBIAS_AFFINE)] = 0.0
    control = _range(model.actuator_ctrllimited, model.actuator_ctrlrange, inputs)
    force = _range(model.actuator_forcelimited, model.actuator_forcerange, motors)
    x = _range(model.actuator_actlimited, model.actuator_actrange, motors)
    dynamics = model.actuator_dyntype[motors]
    muscles = dynamics == int(mj.mjtDyn.mjDYN_MUSCLE)  # which cut their controls off there
    control[muscles] = control[muscles].clip(0.0, 1.0)
    # A state is confined by its own range; that of a filter by its control's, too.
    follows = (states < 0) | (dynamics != int(mj.mjtDyn.mjDYN_INTEGRATOR))
    x[follows, 0] = np.maximum(control[follows, 0], x[follows, 0])
    x[follows, 1] = np.minimum(control[follows, 1], x[follows, 1])
    x[gain_type == int(gains.mjGAIN_MUSCLE)] = 0.0, 1.0
    kinds = [int(getattr(mj.mjtDyn, f"mjDYN_{name}")) for name in _DYNAMICS]
    return (
        np.column_stack((outputs, inputs, states)).astype(np.intp),
        np.array(model.actuator_gear[outputs, 0]), gain, bias, control, force, x,
        [kinds.index(kind) for kind in dynamics.tolist()],
        np.array(model.actuator_dynprm[motors, :2]),
    )  # fmt: skip


def _target(mj: Any, model: Any, motor: int) -> tuple[str, str, int] | None:
    """Return the name of what an actuator drives, "jnt" or "tendon" and its number."""
    kind, target = int(model.actuator_trntype[motor]), int(model.actuator_trnid[motor, 0])
    if kind == int(mj.mjtTrn.mjTRN_TENDON):
        return name_of(model, mj.mjtObj.mjOBJ_TENDON, target), "tendon", target
    if kind in (int(mj.mjtTrn.mjTRN_JOINT), int(mj.mjtTrn.mjTRN_JOINTINPARENT)):
        return name_of(model, mj.mjtObj.mjOBJ_JOINT, target), "jnt", target
    return None


def _require_known(mj: Any, model: Any, motor: int) -> None:
    """Raise unless it is known how the actuator's force follows from its control.

    Raises:
        ModelImportError: it is not.
    """
    for what, prefix, field, known in (
        ("gain", "mjGAIN_", "gaintype", _GAINS),
        ("bias", "mjBIAS_", "biastype", _BIASES),
        ("dynamics", "mjDYN_", "dyntype", _DYNAMICS),
    ):
        value = int(getattr(model, f"actuator_{field}")[motor])
        kind = str(getattr(mj, f"mjt{prefix[2:-1].capitalize()}")(value).name)
        if kind.removeprefix(prefix) not in known or int(model.actuator_ctrlnum[motor]) != 1:
            name = name_of(model, mj.mjtObj.mjOBJ_ACTUATOR, motor)
            raise ModelImportError(
                f"actuator {name!r}: got the {what} type {kind.removeprefix(prefix).lower()!r} and "
                f"{int(model.actuator_ctrlnum[motor])} controls, expected one control and "
                f"{', '.join(known).lower()}: its torque does not follow from its control in a way "
                "known here; put a <motor> or <position> in its place"
            )


def _range(limited: Any, ranges: Any, which: Any) -> Array:
    """Return the ranges of what is limited, infinite ones of the rest, shape (n, 2)."""
    bounds = np.array(ranges[which], dtype=float).reshape(-1, 2)
    bounds[np.asarray(limited[which]) == 0] = -np.inf, np.inf
    return bounds
