"""Controls that make wanted torques, whatever kind of actuator takes them.

MuJoCo's actuators make the force ``gain·x + bias``, cut off at their ``forcerange``: x is the
control or, of actuators that lag behind it, an activation that follows the control; gain and bias
are numbers of the actuator, its length and its velocity. A ``<motor>`` has no bias; a position
servo has the gain kp and the bias −kp·q − kv·q̇. Solved for x, a servo is told the position at which
it makes the torque, and as much as its ``ctrlrange`` reaches is its limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_array, as_positive, as_tuple
from graspforce.errors import InvalidInputError, ModelImportError
from graspforce.hands.limits import as_tau_max
from graspforce.hands.mujoco.model import drives, mujoco_module, name_of

_GAINS = ("FIXED", "AFFINE", "MUSCLE")
_BIASES = ("NONE", "AFFINE", "MUSCLE")
_DYNAMICS = ("NONE", "INTEGRATOR", "FILTER", "FILTEREXACT", "MUSCLE")


class Reach(NamedTuple):
    """What the motors can do as the joints are."""

    lo: Array
    """The torques that they reach, shape (n,) [N·m; N]."""
    hi: Array
    gain: Array
    """What x is multiplied by for a motor's force."""
    bias: Array
    """What the motor makes besides."""
    low: Array
    """The least and the largest torque of every motor at its joint."""
    high: Array
    least: Array
    """Their sums over the motors of each joint, shape (n,), whatever limits that has itself."""
    most: Array


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
        self._lo, self._hi = -most, most.copy()
        motors: list[int] = []
        drive_of: list[int] = []
        for motor in range(model.nactuator):
            found = _target(mj, model, motor)
            if found is None or found[0] not in names:
                continue
            _require_known(mj, model, motor)
            motors.append(motor)
            drive_of.append(names.index(found[0]))
            kind, target = found[1:]
            if getattr(model, f"{kind}_actfrclimited")[target]:
                low, high = getattr(model, f"{kind}_actfrcrange")[target]
                self._lo[drive_of[-1]] = max(-most[drive_of[-1]], low)
                self._hi[drive_of[-1]] = min(most[drive_of[-1]], high)
        self._motors = np.array(motors, dtype=np.intp)
        self._drive_of = np.array(drive_of, dtype=np.intp)
        first = np.array([drive_of.index(i) for i in range(len(names))], dtype=np.intp)
        self._output = model.actuator_outadr[self._motors]
        self._input = model.actuator_ctrladr[self._motors]
        self._gear: Array = model.actuator_gear[self._output, 0]
        self._own_output, self._own_gear = self._output[first], self._gear[first]
        gains, biases = mj.mjtGain, mj.mjtBias
        gain_type = model.actuator_gaintype[self._motors]
        bias_type = model.actuator_biastype[self._motors]
        self._gain = np.array(model.actuator_gainprm[self._motors, :3])
        self._gain[gain_type == int(gains.mjGAIN_FIXED), 1:] = 0.0
        self._bias = np.array(model.actuator_biasprm[self._motors, :3])
        self._bias[bias_type != int(biases.mjBIAS_AFFINE)] = 0.0
        self._muscles = np.flatnonzero(gain_type == int(gains.mjGAIN_MUSCLE))
        # The state that the force depends on where the actuator has dynamics.
        self._dynamics = model.actuator_dyntype[self._motors]
        self._state = np.where(
            model.actuator_actnum[self._motors] > 0,
            model.actuator_actadr[self._motors] + model.actuator_actnum[self._motors] - 1,
            -1,
        )
        self._lags = np.flatnonzero(self._state >= 0)
        self._control = _range(model.actuator_ctrllimited, model.actuator_ctrlrange, self._input)
        own = _range(model.actuator_actlimited, model.actuator_actrange, self._motors)
        # A state is confined by its own range; that of a filter by its control's, too.
        follows = (self._state < 0) | (self._dynamics != int(mj.mjtDyn.mjDYN_INTEGRATOR))
        self._reach = np.where(
            follows[:, None],
            np.column_stack((
                np.maximum(self._control[:, 0], own[:, 0]),
                np.minimum(self._control[:, 1], own[:, 1]),
            )),
            own,
        )  # fmt: skip
        self._reach[self._muscles] = 0.0, 1.0
        self._force = _range(model.actuator_forcelimited, model.actuator_forcerange, self._motors)
        self._beside = np.bincount(self._drive_of)[self._drive_of]
        # Where no gain depends on where the joints are, it is computed once.
        varies = bool(self._gain[:, 1:].any()) or len(self._muscles) > 0
        self._fixed_span = None if varies else self._span(self._gain[:, 0])
        self._own_damping = self._of_drives(self._gear**2 * np.maximum(-self._bias[:, 2], 0.0))

    def limits(self, data: Any) -> tuple[Array, Array]:
        """Return the torques that the motors reach as the joints are, each shape (n,).

        Those of a position servo depend on where its joint is: its ``ctrlrange`` bounds how far
        from there it can be told to go.

        Args:
            data: the simulation's data, after ``mj_step1`` or ``mj_forward``.
        """
        reach = self.reach(data)
        return reach.lo, reach.hi

    def reach(self, data: Any) -> Reach:
        """Return :meth:`limits` and what :meth:`write` needs besides, computed once.

        Args:
            data: the simulation's data, after ``mj_step1`` or ``mj_forward``.
        """
        gain, bias = self._affine(data)
        span = self._span(gain) if self._fixed_span is None else self._fixed_span
        ends = self._gear * (span + bias).clip(self._force[:, 0], self._force[:, 1])
        low, high = ends.min(axis=0), ends.max(axis=0)
        least, most = self._of_drives(low), self._of_drives(high)
        lo, hi = np.maximum(least, self._lo), np.minimum(most, self._hi)
        return Reach(lo, hi, gain, bias, low, high, least, most)

    def lengths(self, data: Any) -> Array:
        """Return where the joints and tendons are, shape (n,) [rad; m]."""
        return data.actuator_length[self._own_output] / self._own_gear

    def rates(self, data: Any) -> Array:
        """Return how fast they move, shape (n,) [rad/s; m/s]."""
        return data.actuator_velocity[self._own_output] / self._own_gear

    def damping(self, data: Any) -> Array:
        """Return by how much the motors' torques fall with the joints' rates, shape (n,)."""
        if self._fixed_span is not None:
            return self._own_damping.copy()
        by_rate = -(self._gain[:, 2] * data.ctrl[self._input] + self._bias[:, 2])
        return self._of_drives(self._gear**2 * np.maximum(by_rate, 0.0))

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
        time, reach = as_positive(dt, "dt", "s"), self.reach(data)
        x = self.send(data, wanted, time, reach, at_once=at_once)
        if len(self._lags):
            x = self._reached(data, x, time)
        made = (reach.gain * x + reach.bias).clip(self._force[:, 0], self._force[:, 1])
        return self._of_drives(self._gear * made).clip(self._lo, self._hi)

    def send(
        self, data: Any, tau: Array, dt: float, reach: Reach, *, at_once: bool = False
    ) -> Array:
        """Set the controls as :meth:`write` does, of what is known; nothing is checked.

        Args:
            data: the simulation's data.
            tau: wanted torques.
            dt: how long these controls stay.
            reach: what the motors can do in these data.
            at_once: as for a simulation that begins.

        Returns:
            The controls, in the order of the motors.
        """
        wanted = tau.clip(self._lo, self._hi)
        # Each motor's share; without limits, as much as any other.
        with np.errstate(invalid="ignore", divide="ignore"):
            share = (wanted - reach.least) / (reach.most - reach.least)
            share = share.clip(0.0, 1.0)[self._drive_of]
            at_joint = reach.low + share * (reach.high - reach.low)
        finite = np.isfinite(at_joint)
        if not finite.all():
            at_joint = np.where(finite, at_joint, wanted[self._drive_of] / self._beside)
        x = (at_joint / self._gear - reach.bias) / np.where(reach.gain == 0, np.inf, reach.gain)
        x = x.clip(self._reach[:, 0], self._reach[:, 1])
        if len(self._lags):
            x = self._led(data, x, dt, at_once)
        x = x.clip(self._control[:, 0], self._control[:, 1])
        data.ctrl[self._input] = x
        return x

    def _of_drives(self, of_motors: Array) -> Array:
        """Return the sums over each drive's motors, shape (n,)."""
        sums = np.bincount(self._drive_of, of_motors, len(self.joint_names))
        return cast("Array", sums)

    def _affine(self, data: Any) -> tuple[Array, Array]:
        """Return gain and bias of every motor as its joint is."""
        length = data.actuator_length[self._output]
        velocity = data.actuator_velocity[self._output]
        gain, bias = self._gain[:, 0], self._at(self._bias, length, velocity)
        if self._fixed_span is None:
            gain = self._at(self._gain, length, velocity)
        model, mj = self._model, self._mj
        for i in self._muscles.tolist():
            motor = int(self._motors[i])
            between, strength = model.actuator_lengthrange[motor], float(model.actuator_acc0[motor])
            prm = model.actuator_gainprm[motor, :9]
            gain[i] = mj.mju_muscleGain(length[i], velocity[i], between, strength, prm)
            bias[i] = mj.mju_muscleBias(
                length[i], between, strength, model.actuator_biasprm[motor, :9]
            )
        return gain, bias

    @staticmethod
    def _at(of: Array, length: Array, velocity: Array) -> Array:
        return of[:, 0] + of[:, 1] * length + of[:, 2] * velocity

    def _span(self, gain: Array) -> Array:
        """Return the forces by the least and the largest x alone, shape (2, n_motors)."""
        with np.errstate(invalid="ignore"):  # of a motor without gain, whose x is not limited
            span: Array = np.where(gain == 0, 0.0, gain * self._reach.T)
        return span

    def _led(self, data: Any, x: Array, dt: float, at_once: bool) -> Array:
        """Return controls that bring the states of motors with a lag to x, as far as dt allows."""
        lags, states = self._lags, self._state[self._lags]
        if at_once:
            data.act[states] = x[lags]
        led = x.copy()
        led[lags] = data.act[states] + (x[lags] - data.act[states]) / self._pace(data, x, dt)
        integrators = lags[self._dynamics[lags] == int(self._mj.mjtDyn.mjDYN_INTEGRATOR)]
        led[integrators] = (x[integrators] - data.act[self._state[integrators]]) / dt
        return led

    def _reached(self, data: Any, control: Array, dt: float) -> Array:
        """Return the x that every motor has after dt under the controls."""
        lags, states = self._lags, self._state[self._lags]
        reached, before = control.copy(), data.act[states]
        reached[lags] = before + (control[lags] - before) * self._pace(data, control, dt)
        integrators = lags[self._dynamics[lags] == int(self._mj.mjtDyn.mjDYN_INTEGRATOR)]
        reached[integrators] = data.act[self._state[integrators]] + control[integrators] * dt
        return np.clip(reached, self._reach[:, 0], self._reach[:, 1])

    def _pace(self, data: Any, towards: Array, dt: float) -> Array:
        """Return the share of the way to their control that states go in dt, above 0."""
        mj = self._mj
        prm: Array = self._model.actuator_dynprm[self._motors[self._lags]]
        kinds = self._dynamics[self._lags]
        act: Array = data.act[self._state[self._lags]]
        tau = np.maximum(prm[:, 0], 1e-9)
        muscle = kinds == int(mj.mjtDyn.mjDYN_MUSCLE)
        scale = 0.5 + 1.5 * np.clip(act, 0.0, 1.0)  # of a muscle's two time constants
        rising = towards[self._lags] > act
        of_muscle = np.where(rising, prm[:, 0] * scale, prm[:, 1] / scale)
        tau = np.where(muscle, np.maximum(of_muscle, 1e-9), tau)
        steps = max(round(dt / float(self._model.opt.timestep)), 1)
        one = np.minimum(dt / steps / tau, 1.0)
        exact = kinds == int(mj.mjtDyn.mjDYN_FILTEREXACT)
        return np.where(exact, -np.expm1(-dt / tau), 1 - (1 - one) ** steps)


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
