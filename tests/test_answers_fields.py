"""The answers for contacts that pull, motors that share, and patches."""

import numpy as np
import pytest
from test_answers_firmness import feasible

import graspforce as gf
from graspforce import firmness, guaranteed, payload, regrasp, robust
from graspforce.answers.wishes import slip_reserves, with_friction


def with_joints(count):
    return [p for p in feasible(4 * count, seed=5) if p.layout.joints][:count]


def two_motors(problem):
    """The same, but the first joint's motor is two that share its range in halves."""
    half = {name: np.array(getattr(problem, name)) for name in ("tau_lo", "tau_hi", "tau_bias")}
    for values in half.values():
        values[0] /= 2
    ends = {name: np.append(values, values[0]) for name, values in half.items()}
    J = np.hstack((problem.J, np.zeros((problem.m, 1))))
    internal = np.zeros((1, J.shape[1]))
    internal[0, 0], internal[0, -1] = 1, -1  # u = tau + v and −v, of which each has half a bias
    return gf.ForceProblem(**(problem.arguments() | {"J": J, "internal": internal} | ends))


def weighted(problem):
    """The same limits; the cones of the objective weigh less."""
    return problem.replace(cone_weight=np.linspace(0.2, 1, problem.n))


def edges(diagnosis):
    return {each.kind: each.value for each in diagnosis.remedies}


@pytest.mark.parametrize("change", [two_motors, weighted])
@pytest.mark.parametrize("load", [1.0, 30.0])
def test_an_equivalent_problem_has_the_same_answers(change, load):
    for problem in with_joints(4):
        given = problem.replace(f=load * problem.f)
        other = change(given)
        plain, found = gf.diagnose(given), gf.diagnose(other)
        assert plain.status is found.status
        expected = edges(plain)
        assert edges(found) == {kind: pytest.approx(v, rel=0.011) for kind, v in expected.items()}
        assert all(each.solution.verify().ok for each in found.remedies)
        if load > 1:
            assert sum(each.share for each in found.binding) == pytest.approx(1, abs=0.1)
        least, others = firmness.least(given, rtol=1e-4), firmness.least(other, rtol=1e-4)
        assert others.lower <= least.upper * (1 + 1e-7)
        assert least.lower <= others.upper * (1 + 1e-7)
        along, others = payload.along(given, given.f), payload.along(other, given.f)
        assert others.lower <= along.upper + 1e-6
        assert along.lower <= others.upper + 1e-6
        for i in range(given.n):
            leaves = regrasp.can_leave(other, i).possible
            assert regrasp.can_leave(given, i).possible == leaves


def test_the_ball_of_motors_that_share_is_that_of_one():
    for problem in with_joints(4):
        one, two = payload.ball(problem), payload.ball(two_motors(problem))
        assert 0 < two.lower >= 0.99 * two.upper
        assert two.lower <= one.upper * (1 + 1e-9)
        assert one.lower <= two.upper * (1 + 1e-9)


def test_the_ball_of_contacts_that_pull(rng):
    """Every wrench in it is held, one just beyond is not, and less pull holds less."""
    problem = cups(3.0)
    found = payload.ball(problem)
    assert 0 < found.lower >= 0.99 * found.upper
    sizes = np.array([1, 1, 1, *[found.length] * 3])
    for _ in range(300):
        u = rng.normal(size=6)
        w = found.lower * sizes * u / np.linalg.norm(u)
        assert gf.solve(problem.replace(f=problem.f + w)).status is gf.Status.SOLVED
    beyond = problem.f + 1.001 * found.upper * found.weakest
    assert gf.solve(problem.replace(f=beyond)).status is gf.Status.INFEASIBLE
    np.testing.assert_allclose(found.forces @ problem.W.T, found.wrenches, atol=1e-9)
    assert payload.ball(cups(3.0, pull=4.0)).upper < found.lower


def test_wishes_of_two_motors_are_met():
    met = 0
    for problem in with_joints(6):
        other = two_motors(problem)
        grip = firmness.choose(other, times_least=2.0, torque_reserve=0.1)
        if grip.met:
            met += 1
            assert grip.torque_reserve >= 0.1 - 1e-9
            assert grip.torque_reserve == pytest.approx(
                (np.minimum(other.tau_hi - grip.solution.tau, grip.solution.tau - other.tau_lo)
                 / (other.tau_hi - other.tau_lo) * 2).min()
            )  # fmt: skip
            assert grip.solution.verify().ok
    assert met >= 3


def cups(load, pull=6.0, mu=0.5):
    """Three cups on a plate above them, which hangs from them: n < 0."""
    points = [(0.05, 0, 0), (-0.03, 0.04, 0), (-0.03, -0.04, 0)]
    contacts = [gf.Contact(p, (0, 0, -1), gf.PCWF(mu, pull=pull)) for p in points]
    f = [0, 0, load, 0, 0, 0]
    return gf.Grasp(contacts).problem(f, c_max=20)


def test_cups_that_carry_a_plate():
    problem = cups(3.0)
    # Torques about the origin, where the load is: the first cup carries 3·(0.03/0.08) = 1.125 N and
    # the others half of the rest. The most that each cup can pull is 6 N.
    shares = np.array([1.125, 0.9375, 0.9375])
    found = payload.along(problem, problem.f)
    most = 6 / shares.max() - 1
    assert found.lower <= most <= found.upper
    assert found.upper - found.lower < 1e-3
    assert gf.check_certificate(
        problem.replace(f=problem.f * (1.001 * most + 1)), found.certificate
    )
    solution = gf.solve(problem)
    assert solution.c[::3] == pytest.approx(-shares)
    assert slip_reserves(problem, solution.c) == pytest.approx(np.ones(3))  # nothing pulls aside


def test_friction_of_cups_is_that_of_their_preload():
    problem = cups(3.0).replace(f=[1.5, 0, 3.0, 0, 0, 0])
    solution = gf.solve(problem)
    reserve = float(slip_reserves(problem, solution.c).min())
    assert 0 < reserve < 1
    weaker = problem.replace(models=with_friction(problem, 1 - reserve))
    assert [model.pull for model in weaker.models] == [6.0] * 3
    loaded = solution.c.reshape(3, 3) + np.array([6.0, 0, 0])
    margins = 0.5 * (1 - reserve) * loaded[:, 0] - np.linalg.norm(loaded[:, 1:], axis=1)
    assert margins.min() == pytest.approx(0, abs=1e-9)
    grip = firmness.choose(problem, slip_reserve=0.3)
    assert grip.met
    assert grip.slip_reserve > 0.3
    overloaded = problem.replace(f=[7.9, 0, 3.0, 0, 0, 0])  # of 0.5 (18 − 3) N of friction
    assert gf.solve(overloaded).status is gf.Status.INFEASIBLE
    friction = edges(gf.diagnose(overloaded))["friction"]
    assert friction == pytest.approx(7.9 / 7.5, rel=0.02)
    lower = robust.tighten(problem, friction=0.2)
    assert lower.mu == pytest.approx(0.4)
    assert lower.pull == pytest.approx(6.0)


def test_margins_of_cups_that_are_guaranteed():
    """Without friction the wrench alone tells what each cup carries."""
    problem = cups(3.0).replace(f=[0, 0, 3.0, 0, 0, 0])
    normals = problem.starts[:-1]
    smooth = gf.ForceProblem(
        problem.W[np.ix_([2, 3, 4], normals)], [3.0, 0, 0], gf.FPC(pull=6.0),
        np.zeros((3, 1)), [-1], [1], c_max=20,
    )  # fmt: skip
    bounds = guaranteed.friction_margins(gf.solve(smooth))
    assert bounds == pytest.approx(6 - np.array([1.125, 0.9375, 0.9375]), abs=1e-5)


def shared():
    return two_motors(with_joints(1)[0])


@pytest.mark.parametrize(
    ("make", "call", "words"),
    [
        (lambda: cups(3.0), lambda p: robust.tighten(p, point=1e-3), "contacts that pull"),
        (lambda: cups(3.0), lambda p: robust.tighten(p, normal=0.1), "contacts that pull"),
        (shared, lambda p: robust.tighten(p, point=1e-3), "internal forces of motors"),
    ],
)  # fmt: skip
def test_what_is_not_known_is_refused(make, call, words):
    with pytest.raises(gf.InvalidInputError, match=f"problem: got {words}"):
        call(make())
