"""Calls for the type checker, for test_typed.py: it has to object to the lines marked ``red``."""

import graspforce as gf
from graspforce import scenarios


def calls(grasp: gf.Grasp, problem: gf.ForceProblem, servo: gf.Servo) -> None:
    problem.replace(f=[0.0] * 6, models=gf.PCWF(0.5), c_max=20.0, A=None, b=None, alpha=3.0)
    problem.replace(alhpa=3.0)  # red
    problem.replace(alpha="3")  # red
    grasp.problem([0.0] * 6, c_max=20.0, tau_bias=0.1, engagement=[1.0, 0.5])
    grasp.problem([0.0] * 6, cmax=20.0)  # red
    grasp.problem([0.0] * 6, W=problem.W)  # red
    servo.step(f=[0.0] * 6, alpha=3.0)
    servo.step(forces=[0.0] * 6)  # red


def scenario_calls(name: str) -> None:
    scenarios.get("static", alpha=3.0, hand=gf.hands.PaperHand("radial"), mu=0.4)
    scenarios.get("dynamic", rate=500.0, duration=1.0)
    scenarios.get("regrasp", c_max=50.0, shape="smooth", alpha=3.0)
    scenarios.get(name, alpha=3.0)
    scenarios.get("static", alhpa=3.0)  # red
    scenarios.get("static", c_max=50.0)  # red
    scenarios.get("regrasp", cmax=50.0)  # red
    scenarios.get("regrasp", shape="square")  # red
    scenarios.get(name, alhpa=3.0)  # red
