"""What reading a grasp from MuJoCo takes, once and in every tick of a loop.

A hand of four fingers with four joints each holds a cube, with a ball (4 contacts) or a flat pad
(16) at the end of each finger. In C++ (``benchmarks/reading.cpp``) reading goes from MuJoCo's
numbers to the fields of a Servo, torque limits included, and sending from torques to controls.
Half a minute, most of it for the compiler: ``python benchmarks/reading.py``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
from rich.table import Table
from saving import show, writable

import graspforce as gf
from graspforce._util.clock import hot, no_op

AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0")
LINK = 0.025  # [m]; the first two joints are at one point
TIPS = {
    "4 contacts": 'type="sphere" size=".005"',
    "16 contacts": 'type="box" size=".005 .01 .01"',
}


def scene(tip: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the hand around its cube, the tips 0.2 mm into it."""
    fingers, motors = "", ""
    for finger in range(4):
        chain = f'<geom {tip} pos="0 0 {LINK}" friction=".6 .005 .0001" mass=".01"/>'
        for joint in (3, 2, 1, 0):
            name, height = f"joint{finger}{joint}", LINK * (joint > 1)
            chain = f"""<body pos="0 0 {height}"><joint name="{name}" axis="{AXES[joint]}"/>
              <geom type="capsule" size=".003" fromto="0 0 0 0 0 {LINK}" mass=".01" contype="0"
                conaffinity="0"/>{chain}</body>"""
            motors += f'<motor joint="{name}" ctrlrange="-.7 .7"/>'
        fingers += f"""<body euler="0 0 {90 * finger}"><body pos=".0348 0 {LINK}">{chain}</body>
          </body>"""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option cone="elliptic" jacobian="dense"/><worldbody>{fingers}
          <body name="cube" pos="0 0 {4 * LINK}"><freejoint/>
            <geom type="box" size=".03 .03 .03" mass=".2"/></body></worldbody>
          <actuator>{motors}</actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def times(tip: str, rounds: int) -> dict[str, np.ndarray]:
    """Return the times of the calls [µs]."""
    model, data = scene(tip)
    grasp = gf.Grasp.from_mujoco(model, data, "cube")
    reader = gf.hands.MujocoGrasp(model, data, "cube", grasp.joint_names)
    servo = gf.Servo(grasp.problem([0, 0, 0.2 * 9.81, 0, 0, 0]))
    calls = {
        "Grasp.from_mujoco": lambda: gf.Grasp.from_mujoco(model, data, "cube"),
        "MujocoGrasp.update": lambda: reader.update(data),
        "Servo.step": lambda: servo.step(W=reader.W, J=reader.J, tau_bias=reader.tau_bias),
        "mujoco.mj_forward": lambda: mujoco.mj_forward(model, data),
    }
    return {name: hot([(no_op, call)], rounds) for name, call in calls.items()}


def times_of_cpp(folder: Path, rounds: int) -> list[dict[str, float]]:
    """Return the tenth of the times below for every tip [µs]; nothing without a compiler."""
    library = Path(mujoco.__file__).parent
    shared = next(iter(sorted(library.glob("libmujoco.so*"))), None)
    if shared is None:
        return [{}] * len(TIPS)
    root, program = Path(__file__).parents[1], folder / "reading"
    wide = "-mavx2 -mfma" if "avx2" in Path("/proc/cpuinfo").read_text() else ""
    flags = f"-std=c++17 -O3 {wide} -fno-math-errno -fno-trapping-math -Wno-psabi".split()
    includes = [f"-I{root / 'cpp/include'}", "-isystem", str(library / "include")]
    source = str(root / "benchmarks/reading.cpp")
    linked = [str(shared), f"-Wl,-rpath,{library}"]
    subprocess.run(["g++", *flags, *includes, source, "-o", str(program), *linked], check=True)
    names = ("C++: reading", "C++: Servo::tick", "C++: sending")
    found = []
    for tip in TIPS.values():
        model = str(folder / "scene.mjb")
        mujoco.mj_saveModel(scene(tip)[0], model, None)
        out = subprocess.run(
            [str(program), model, "cube", str(rounds)], check=True, capture_output=True, text=True
        ).stdout
        found.append(dict(zip(names, map(float, out.split()), strict=True)))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--save", type=writable, help="write the table to this file")
    options = parser.parse_args()
    table = Table(title="times of a call [µs], 16 joints: a tenth is below")
    table.add_column("")
    for contacts in TIPS:
        table.add_column(contacts, justify="right")
    measured = [times(tip, options.rounds) for tip in TIPS.values()]
    for name in measured[0]:
        table.add_row(name, *(f"{np.percentile(each[name], 10):.4g}" for each in measured))
    with tempfile.TemporaryDirectory() as folder:
        of_cpp = times_of_cpp(Path(folder), 10 * options.rounds)
    for name in of_cpp[0]:
        table.add_row(name, *(f"{each[name]:.3g}" for each in of_cpp))
    show(table, save=options.save, width=80)
    return 0


if __name__ == "__main__":
    sys.exit(main())
