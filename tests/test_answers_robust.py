"""Forces that hold for sets: drawn inside, where none may slip, and outside, where some do."""

import numpy as np
import pytest
from conftest import ALLEGRO

import graspforce as gf

robust = gf.robust
POINTS = np.array([(1, 0, 0.2), (-0.6, 0.75, -0.1), (-0.55, -0.8, 0.1), (0.2, 0.1, -1)])
POINTS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)


def grasp(models, radius=0.04):
    return gf.Grasp([gf.Contact(radius * p, -p, m) for p, m in zip(POINTS, models, strict=False)])


def ball():
    """A ball in four fingers, one of them soft, with a joint an axis of each contact."""
    models = [gf.PCWF(0.8), gf.PCWF(0.6), gf.SFC(0.7, 0.01), gf.PCWF(0.9)]
    held = grasp(models)
    m = held.W.shape[1]
    J = np.zeros((m, m))
    for start in (0, 3, 6, 10):
        turn, _ = np.linalg.qr(np.random.default_rng(start).normal(size=(3, 3)))
        J[start : start + 3, start : start + 3] = 0.06 * turn
    J[9, 9] = 1.0
    problem = held.problem([0, 0, 2, 0, 0, 0], J=J, tau_lo=-0.8, tau_hi=0.8, c_max=30)
    return held, problem


def unit(rng, size):
    u = rng.normal(size=size)
    return u / np.linalg.norm(u)


def worst(held, problem, c, rng, sets, count):
    """The least margins over draws at the rims of the sets, relative: friction, torque, ceiling."""
    G, contacts = robust.response(problem), held.contacts
    least = np.full(3, np.inf)
    L = np.linalg.cholesky(sets["wrench"]) if "wrench" in sets else np.zeros((6, 6))
    starts = problem.starts
    for _ in range(count):
        lost = 1 - sets.get("friction", 0)
        w = L @ unit(rng, 6)
        moved = [sets.get("point", 0) * unit(rng, 3) for _ in contacts]
        # The wrench that displaced forces make differs; the response makes up for it.
        x = np.array(c)
        for _ in range(6):
            turn = np.zeros(6)
            for i, contact in enumerate(contacts):
                turn[3:] += np.cross(moved[i], contact.frame @ x[starts[i] : starts[i] + 3])
            x = c + G @ (w - turn)
        tau = problem.J.T @ x
        for i, contact in enumerate(contacts):
            force = contact.frame @ x[starts[i] : starts[i] + 3]
            axis = np.cross(contact.normal, unit(rng, 3))
            axis /= np.linalg.norm(axis)
            angle = sets.get("normal", 0)
            normal = np.cos(angle) * contact.normal + np.sin(angle) * np.cross(axis, contact.normal)
            push = normal @ force
            across = [np.linalg.norm(force - push * normal)]
            mu = lost * contact.model.mu
            if contact.model.dim == 4:
                across.append(mu / (lost * contact.model.gamma) * x[starts[i] + 3])
            least[0] = min(least[0], 1 - np.linalg.norm(across) / (mu * push) if push > 0 else -1)
            # A displaced force turns each joint of its finger by up to the lever arm's change.
            joints = slice(starts[i], starts[i] + 3)
            tau[joints] += rng.choice([-1, 1]) * np.linalg.norm(np.cross(moved[i], force))
        least[1] = min(least[1], (problem.tau_hi - np.abs(tau)).min())
        least[2] = min(least[2], (problem.c_max - x[starts[:-1]]).min())
    return least


SETS = {
    "friction": {"friction": 0.3},
    "normal": {"normal": 0.2},
    "friction and normal": {"friction": 0.2, "normal": 0.15},
    "wrench": {"wrench": np.diag([0.3, 0.3, 0.3, 0.006, 0.006, 0.006]) ** 2},
    "wide wrench": {"wrench": np.diag([0.8, 0.8, 0.8, 0.016, 0.016, 0.016]) ** 2},
    "point": {"point": 0.003},
    "all": {
        "friction": 0.1, "normal": 0.05, "point": 0.001,
        "wrench": np.diag([0.2, 0.2, 0.2, 0.004, 0.004, 0.004]) ** 2,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", SETS)
def test_an_answer_holds_all_over_the_set(name, rng):
    held, problem = ball()
    sets = SETS[name]
    tight = robust.tighten(problem, **sets)
    for alpha in (1, 1e5, 1e9):
        solution = gf.solve(tight.replace(alpha=alpha))
        assert solution.status is gf.Status.SOLVED
        assert problem.replace(alpha=alpha).f == pytest.approx(problem.W @ solution.c)
        assert (worst(held, problem, solution.c, rng, sets, 40) > 0).all()


@pytest.mark.parametrize(("name", "factor"), [
    ("friction", 1.05), ("normal", 1.05), ("wrench", 4), ("point", 12),
])  # fmt: skip
def test_the_sets_are_not_absurdly_small(name, factor, rng):
    """A light grip at the edge of the tightened limits fails in a set larger by a factor."""
    held, problem = ball()
    sets = SETS[name]
    edge = gf.firmness.least(robust.tighten(problem, **sets))
    larger = {
        key: value * (factor**2 if key == "wrench" else factor) for key, value in sets.items()
    }
    assert worst(held, problem, edge.solution.c, rng, sets, 40).min() > 0
    assert worst(held, problem, edge.solution.c, rng, larger, 250).min() < 0


def test_more_uncertainty_takes_more_force():
    _, problem = ball()
    for name, sets in SETS.items():
        forces = [gf.firmness.least(problem).upper]
        for factor in (0.5, 1):
            changed = {k: v * (factor**2 if k == "wrench" else factor) for k, v in sets.items()}
            forces.append(gf.firmness.least(robust.tighten(problem, **changed)).upper)
        assert (np.diff(forces) >= -2e-6 * forces[-1]).all(), name  # each is known to 1e-6
        assert forces[-1] > 1.01 * forces[0]


def test_a_servo_runs_on_tightened_problems():
    problem = dict(gf.files.read(ALLEGRO))["065-j_cups"]
    E = np.diag([0.01, 0.01, 0.01, 1e-4, 1e-4, 1e-4]) ** 2
    tight = robust.tighten(problem, friction=0.1, wrench=E)
    servo = gf.Servo(tight)
    for share in np.linspace(1, 1.2, 20):
        solution = servo.step_to(
            robust.tighten(problem.replace(f=share * problem.f), 0.1, wrench=E)
        )
        assert solution.status is gf.Status.SOLVED
    assert solution.newton_steps <= 2


def test_the_response_makes_the_wrench_and_spares_contacts_that_are_out():
    _, problem = ball()
    assert problem.W @ robust.response(problem) == pytest.approx(np.eye(6), abs=1e-9)
    away = problem.replace(engagement=[1, 1, 1, 0])
    assert not robust.response(away)[10:].any()
    tight = robust.tighten(away, wrench=np.diag([1e-2] * 3 + [1e-5] * 3) ** 2)
    assert gf.solve(tight).status in (gf.Status.SOLVED, gf.Status.INFEASIBLE)
    assert not tight.A[:, 10:].any()


@pytest.mark.parametrize(
    ("sets", "text"),
    [
        ({"friction": 1}, "friction: got 1, expected less than 1"),
        ({"friction": -0.1}, "friction: got -0.1, expected 0 or more"),
        ({"friction": [0.1, 0.1]}, "friction: got shape"),
        ({"normal": 0.8}, r"normal\[0\]: got 0.8 rad, expected less than 0.6747 rad"),
        ({"point": -1}, "point: got -1"),
        ({"point": 1}, "point: got 1 m, so far off that no response"),
        ({"wrench": -np.eye(6)}, "eigenvalue -1, expected a positive definite"),
        ({"wrench": np.triu(np.ones((6, 6)))}, "not symmetric"),
        ({"wrench": np.eye(3)}, "wrench: got shape"),
    ],
)
def test_sets_that_are_none_are_refused(sets, text):
    with pytest.raises(gf.InvalidInputError, match=text):
        robust.tighten(ball()[1], **sets)


def test_a_wrench_that_cannot_be_made_is_refused():
    contacts = [gf.Contact((s * 0.1, 0, 0), (-s, 0, 0), gf.PCWF(0.5)) for s in (1, -1)]
    pinch = gf.Grasp(contacts).problem([0, 0, 1, 0, 0, 0], c_max=10)
    with pytest.raises(gf.InvalidInputError, match="these contacts cannot make"):
        robust.tighten(pinch, wrench=np.eye(6))
    pushes = gf.ForceProblem(np.eye(3), [1, 1, 1], gf.FPC(), c_max=9)
    with pytest.raises(
        gf.InvalidInputError, match=r"normal\[0\]: got 0.1 rad, expected less than 0"
    ):
        robust.tighten(pushes, normal=0.1)


def test_the_room_in_the_cones_is_enough_for_every_response_and_not_much_more(rng):
    held, problem = ball()
    E = SETS["wrench"]["wrench"]
    room = -robust.tighten(problem, wrench=E).b[-4:]
    responses = robust.response(problem) @ np.linalg.cholesky(E)
    largest = np.zeros(4)
    for _ in range(4000):
        x = responses @ unit(rng, 6)
        for i, (start, contact) in enumerate(zip(problem.starts[:-1], held.contacts, strict=True)):
            scaled = contact.model.cone_scaling * x[start : start + contact.model.dim]
            largest[i] = max(largest[i], np.linalg.norm(scaled[1:]) - scaled[0])
    assert (largest <= room).all()
    assert (room <= 1.6 * largest).all()
