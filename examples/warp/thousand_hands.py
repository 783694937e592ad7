"""A thousand hands in MuJoCo Warp, each holding its ball by a tick of its own in every step.

Everything is on the device: the simulator's state, W and J, the forces, the torques; on a GPU one
CUDA graph is a step. Each ball is pulled about by a load that turns, another for each hand.

    pip install 'graspforce[gpu]' mujoco-warp
    python thousand_hands.py --hands 1024 --seconds 2

Without a GPU it runs on Warp's CPU device; take few hands.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from functools import partial
from typing import Any, NamedTuple

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

import graspforce as gf
import graspforce.warp as gw

FINGERS, JOINTS = 3, 3
STEP = 0.002  # [s]
RADIUS, TIP = 0.03, 0.008  # of the ball, of a fingertip [m]
HEIGHT = 0.09  # of the ball over the palm [m]
MASS = 0.1  # of the ball [kg]
LARGEST_LOAD = 2.0  # [N]
MU = 0.6  # that the forces keep to; the simulated fingertips have 0.8
STIFFNESS, DAMPING = 400.0, 40.0  # of the ball's place, by its mass [1/s², 1/s]


def model() -> mujoco.MjModel:
    """Three fingers around a ball, in the pose that qpos = 0 is; one motor a joint."""
    finger = """
      <body name="finger{i}" pos="{x} {y} 0" euler="0 0 {angle}">
        <joint name="swing{i}" axis="1 0 0"/><joint name="lower{i}" axis="0 1 0"/>
        <geom type="capsule" size=".006" fromto="0 0 0 .0095 0 .0592" mass=".02"
          contype="0" conaffinity="0"/>
        <body pos=".0095 0 .0592">
          <joint name="upper{i}" axis="0 1 0"/>
          <geom type="capsule" size=".006" fromto="0 0 0 -.0515 0 .0308" mass=".015"
            contype="0" conaffinity="0"/>
          <geom type="sphere" size="{tip}" pos="-.0515 0 .0308" mass=".002"/>
          <site name="tip{i}" pos="-.0515 0 .0308"/>
        </body>
      </body>"""
    around = [
        finger.format(
            i=i, tip=TIP, angle=120 * i,
            x=0.08 * math.cos(math.radians(120 * i)), y=0.08 * math.sin(math.radians(120 * i)),
        )
        for i in range(FINGERS)
    ]  # fmt: skip
    names = [f"{kind}{i}" for i in range(FINGERS) for kind in ("swing", "lower", "upper")]
    motors = "".join(f'<motor joint="{name}"/>' for name in names)
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="100"
        jacobian="dense"/>
      <default>
        <joint damping=".002" armature=".0002"/>
        <geom friction=".8" condim="3" solref=".004 1" solimp=".95 .99 .001"/>
      </default>
      <worldbody>
        <body name="ball" pos="0 0 {HEIGHT}">
          <freejoint/><geom type="sphere" size="{RADIUS}" mass="{MASS}"/>
        </body>
        {"".join(around)}
      </worldbody>
      <actuator>{motors}</actuator>
    </mujoco>""")


# ---- kernels: the simulator's numbers to a problem's, the torques back to the motors -------------


class Names(NamedTuple):
    """Where the model has what the kernels read."""

    ball: int
    first_dof: int  # of the ball
    tips: Any  # sites
    joints: Any
    dofs: Any


@wp.kernel(enable_backward=False)
def look(
    xpos: wp.array2d(dtype=wp.vec3),
    site_xpos: wp.array2d(dtype=wp.vec3),
    xanchor: wp.array2d(dtype=wp.vec3),
    xaxis: wp.array2d(dtype=wp.vec3),
    bias: wp.array2d(dtype=float),
    ball: int,
    tips: wp.array(dtype=int),
    joints: wp.array(dtype=int),
    dofs: wp.array(dtype=int),
    W: wp.array3d(dtype=wp.float64),
    J: wp.array3d(dtype=wp.float64),
    tau_bias: wp.array2d(dtype=wp.float64),
):
    """W, J and what the fingers' motion takes, of finger i of hand b."""
    b, i = wp.tid()
    centre = wp.vec3d(xpos[b, ball])
    tip = wp.vec3d(site_xpos[b, tips[i]])
    normal = wp.normalize(centre - tip)  # into the ball
    point = tip + wp.float64(TIP) * normal
    up = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    x = wp.normalize(wp.cross(up, normal))
    y = wp.cross(normal, x)
    for a in range(3):
        axis = wp.where(a == 0, normal, wp.where(a == 1, x, y))
        turn = wp.cross(point - centre, axis)
        for r in range(3):
            W[b, r, 3 * i + a] = axis[r]
            W[b, 3 + r, 3 * i + a] = turn[r]
        for k in range(JOINTS):
            joint = joints[JOINTS * i + k]
            moves = wp.cross(wp.vec3d(xaxis[b, joint]), point - wp.vec3d(xanchor[b, joint]))
            J[b, 3 * i + a, k] = wp.dot(axis, moves)
    for k in range(JOINTS):
        tau_bias[b, JOINTS * i + k] = wp.float64(bias[b, dofs[JOINTS * i + k]])


@wp.kernel(enable_backward=False)
def want(
    xpos: wp.array2d(dtype=wp.vec3),
    xquat: wp.array2d(dtype=wp.quat),
    qvel: wp.array2d(dtype=float),
    ball: int,
    dof: int,
    clock: wp.array(dtype=float),
    load: wp.array(dtype=wp.vec3),
    axis: wp.array(dtype=wp.vec3),
    pull: wp.array2d(dtype=wp.spatial_vector),
    f: wp.array2d(dtype=wp.float64),
):
    """Turn the load, and ask for the wrench that holds the ball where it was against it."""
    b = wp.tid()
    clock[b] += STEP
    turned = wp.quat_rotate(wp.quat_from_axis_angle(axis[b], 2.0 * wp.pi * clock[b]), load[b])
    turned *= wp.min(clock[b] / 0.2, 1.0)  # it sets in
    pull[b, ball] = wp.spatial_vector(turned, wp.vec3())
    off = wp.vec3(0.0, 0.0, HEIGHT) - xpos[b, ball]
    own = wp.vec3(qvel[b, dof + 3], qvel[b, dof + 4], qvel[b, dof + 5])  # in the ball's axes
    turn = xquat[b, ball]  # MuJoCo's, w first
    spin = wp.quat_rotate(wp.quat(turn[1], turn[2], turn[3], turn[0]), own)
    for r in range(3):
        weight = wp.where(r == 2, 9.81, 0.0)
        back = weight + STIFFNESS * off[r] - DAMPING * qvel[b, dof + r]
        f[b, r] = wp.float64(MASS * back - turned[r])
        f[b, 3 + r] = wp.float64(-MASS * 0.4 * RADIUS * RADIUS * DAMPING * spin[r])


@wp.kernel(enable_backward=False)
def drive(
    tau: wp.array2d(dtype=wp.float64),
    status: wp.array(dtype=int),
    ctrl: wp.array2d(dtype=float),
    missed: wp.array(dtype=int),
):
    """Send the torques; where there are none the motors keep theirs."""
    b, j = wp.tid()
    if status[b] == 0:
        ctrl[b, j] = float(tau[b, j])
    elif j == 0:
        missed[b] += 1


# ---- the hands -----------------------------------------------------------------------------------


class Hands:
    """Hands with a ball each, on a device."""

    def __init__(self, count: int, device: str, seed: int = 0) -> None:
        self.count, self.device = count, wp.get_device(device)
        self.model = model()
        with wp.ScopedDevice(self.device):
            self._m = mjw.put_model(self.model)
            self._d = mjw.make_data(self.model, nworld=count, nconmax=8, njmax=32)
            self._names = self._find_names()
            rng = np.random.default_rng(seed)
            load, axis = rng.normal(size=(2, count, 3))
            load *= rng.uniform(0, LARGEST_LOAD, (count, 1)) / np.linalg.norm(
                load, axis=1, keepdims=True
            )
            axis /= np.linalg.norm(axis, axis=1, keepdims=True)
            self._load = wp.array(load, dtype=wp.vec3)
            self._axis = wp.array(axis, dtype=wp.vec3)
            self._clock = wp.zeros(count, dtype=float)
            self.missed = wp.zeros(count, dtype=int)
            self.W = wp.zeros((count, 6, 9), dtype=wp.float64)
            self.J = wp.zeros((count, 9, JOINTS), dtype=wp.float64)
            self.f = wp.zeros((count, 6), dtype=wp.float64)
            self._bias = wp.zeros((count, 9), dtype=wp.float64)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="f: on Warp's CPU device")
            self.problems = gw.Problems(
                self.W, self.f, [gf.PCWF(MU)] * FINGERS, J=self.J, tau_lo=-0.6, tau_hi=0.6,
                tau_bias=self._bias, c_max=10.0,
            )  # fmt: skip
        self._sense()
        self.forces = self.problems.solve()
        self._sense()  # the clock has gone on

    def _find_names(self) -> Names:
        fingers = range(FINGERS)
        find = mujoco.mj_name2id
        joints = [
            find(self.model, mujoco.mjtObj.mjOBJ_JOINT, f"{kind}{i}")
            for i in fingers
            for kind in ("swing", "lower", "upper")
        ]
        ball = find(self.model, mujoco.mjtObj.mjOBJ_BODY, "ball")
        tips = [find(self.model, mujoco.mjtObj.mjOBJ_SITE, f"tip{i}") for i in fingers]
        dofs = [int(self.model.jnt_dofadr[joint]) for joint in joints]
        first = int(self.model.body_dofadr[ball])
        return Names(ball, first, *(wp.array(each, dtype=int) for each in (tips, joints, dofs)))

    def _sense(self) -> None:
        mjw.step1(self._m, self._d)
        d, names = self._d, self._names
        wp.launch(
            look, (self.count, FINGERS),
            [d.xpos, d.site_xpos, d.xanchor, d.xaxis, d.qfrc_bias, names.ball, names.tips,
             names.joints, names.dofs, self.W, self.J, self._bias], device=self.device,
        )  # fmt: skip
        wp.launch(
            want, self.count,
            [d.xpos, d.xquat, d.qvel, names.ball, names.first_dof, self._clock, self._load,
             self._axis, d.xfrc_applied, self.f], device=self.device,
        )  # fmt: skip

    def step(self) -> None:
        """Sense, solve from the last forces, drive the motors, and go on by one step."""
        with wp.ScopedDevice(self.device):
            self._sense()
            self.problems.solve(self.forces.c, out=self.forces)
            wp.launch(
                drive, (self.count, FINGERS * JOINTS),
                [self.forces.tau, self.forces.status, self._d.ctrl, self.missed],
                device=self.device,
            )  # fmt: skip
            mjw.step2(self._m, self._d)

    def run(self, seconds: float) -> float:
        """Go on for a time; return the seconds by the wall's clock."""
        steps = round(seconds / STEP)
        step = self.step
        if self.device.is_cuda:
            with wp.ScopedCapture(self.device) as capture:
                self.step()
            step = partial(wp.capture_launch, capture.graph)
        wp.synchronize_device(self.device)
        start = time.perf_counter()
        for _ in range(steps):
            step()
        wp.synchronize_device(self.device)
        return time.perf_counter() - start

    def away(self) -> np.ndarray:
        """How far each ball is from its place [m]."""
        places = self._d.xpos.numpy()[:, self._names.ball]
        return np.linalg.norm(places - [0, 0, HEIGHT], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--hands", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=2.0, help="of simulated time")
    parser.add_argument("--device", default=None, help="default: Warp's, a GPU where there is one")
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    hands = Hands(arguments.hands, arguments.device or str(wp.get_preferred_device()))
    hands.run(STEP)  # kernels are compiled
    took = hands.run(arguments.seconds)
    steps, away = round(arguments.seconds / STEP), hands.away()
    print(f"{hands.count} hands on {hands.device.name}, {steps} steps of {STEP * 1e3:g} ms")
    print(f"{(away < 0.005).sum()} balls held, at most {away.max() * 1e3:.1f} mm from their place")
    print(f"{hands.missed.numpy().sum()} ticks without an answer")
    print(f"{hands.count * steps / took:,.0f} grasps × steps a second")


if __name__ == "__main__":
    main()
