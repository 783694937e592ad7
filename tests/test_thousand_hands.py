"""examples/warp/thousand_hands.py, with a few hands on the CPU and with many on a GPU."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

wp = pytest.importorskip("warp")
pytest.importorskip("mujoco_warp")

pytestmark = pytest.mark.filterwarnings("default")  # of the simulator's own
PROGRAM = Path(__file__).parents[1] / "examples" / "warp" / "thousand_hands.py"


@pytest.fixture(scope="module")
def program():
    spec = importlib.util.spec_from_file_location("thousand_hands", PROGRAM)
    module = sys.modules["thousand_hands"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    wp.config.log_level = wp.LOG_WARNING
    return module


@pytest.fixture(params=["cpu", "cuda"])
def device(request):
    there = wp.is_cpu_available() if request.param == "cpu" else wp.is_cuda_available()
    if not there:
        pytest.skip(f"no {request.param}")
    return request.param


def test_every_hand_holds_its_ball_under_its_own_load(program, device):
    hands = program.Hands(4 if device == "cpu" else 1024, device)
    hands.run(0.6)
    assert hands.away().max() < 1e-3
    assert not hands.missed.numpy().any()
    forces, problems = hands.forces, hands.problems
    normals = forces.c.numpy()[:, ::3]
    assert (normals > 0.2).all()
    assert np.ptp(normals, axis=0).min() > 0.05  # each hand its own forces
    tau = forces.tau.numpy()
    assert (np.abs(tau) < 0.6).all()
    error = np.einsum("brm,bm->br", hands.W.numpy(), forces.c.numpy()) - hands.f.numpy()
    assert np.abs(error).max() < 1e-8
    assert len(problems) == hands.count


def test_without_torques_the_balls_fall(program, device):
    hands = program.Hands(2, device)
    hands.problems.solve = lambda *_, out, **__: out.status.fill_(2)
    hands.run(0.4)
    assert hands.away().min() > 0.1
    assert (hands.missed.numpy() >= 200).all()
