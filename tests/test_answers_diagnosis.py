"""Why a grasp has no answer, and what would help: every remedy by another solver."""

import json
import re

import numpy as np
import pytest
from clarabel_oracle import random_problem
from conftest import ALLEGRO
from test_cli import EXAMPLES, SEVERAL, run

import graspforce as gf
from graspforce import files
from graspforce.baselines import socp


def allegro():
    return [problem for _, problem in files.read(ALLEGRO)]


def infeasible(count, seed=0):
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        problem = random_problem(rng)
        if gf.solve(problem).status is gf.Status.INFEASIBLE:
            found.append(problem)
    return found


def scaled_models(problem, factor):
    return [
        gf.FPC() if isinstance(model, gf.FPC)
        else gf.PCWF(factor * model.mu) if isinstance(model, gf.PCWF)
        else gf.SFC(factor * model.mu, factor * model.gamma)
        for model in problem.models
    ]  # fmt: skip


def a_little_less(problem, remedy, share):
    """The problem with a remedy that is smaller by a share."""
    value = remedy.value * (1 - share)
    match remedy.kind:
        case "friction":
            return problem.replace(models=scaled_models(problem, value))
        case "torque":
            lo, hi = problem.tau_lo, problem.tau_hi
            return problem.replace(
                tau_lo=np.where(lo < 0, value * lo, lo), tau_hi=np.where(hi > 0, value * hi, hi)
            )
        case "ceiling":
            return problem.replace(c_max=value * problem.c_max)
        case "rate":
            return problem.replace(dc_max=value * problem.dc_max)
        case "load":
            return problem.replace(f=remedy.value * (1 + share) * problem.f)
        case "support":
            limits = np.array(remedy.problem.b)
            limits[-1] = value
            return remedy.problem.replace(b=limits)
        case "finger":
            changed = np.flatnonzero(remedy.problem.engagement != problem.engagement)
            engagement = np.array(problem.engagement)
            assert len(changed) == 1
            engagement[changed] = value
            return problem.replace(engagement=engagement)
        case "turn":
            F, G = problem.f[:3], remedy.problem.f[:3]
            angle = np.arccos(F @ G / np.linalg.norm(F) / np.linalg.norm(G))
            assert abs(angle - remedy.value) < 1e-6
            axis = np.cross(F, G)
            axis /= np.linalg.norm(axis)
            parts = [
                np.cos(value) * v + np.sin(value) * np.cross(axis, v)
                + (1 - np.cos(value)) * (axis @ v) * axis
                for v in (F, problem.f[3:])
            ]  # fmt: skip
            return problem.replace(f=np.concatenate(parts))


@pytest.mark.parametrize("problem", infeasible(8) + [allegro()[i] for i in (4, 9)], ids=str)
def test_every_remedy_helps_and_a_hundredth_less_does_not(problem):
    found = gf.diagnose(problem)
    assert found.status is gf.Status.INFEASIBLE
    for remedy in found.remedies:
        assert remedy.solution.status is gf.Status.SOLVED
        assert remedy.solution.problem == remedy.problem
        assert remedy.solution.verify().ok
        assert gf.solve(a_little_less(problem, remedy, 0)).status is gf.Status.SOLVED
        less = a_little_less(problem, remedy, 0.01)
        assert socp.solve(less).status is gf.Status.INFEASIBLE
        assert remedy.text in str(found)


def test_a_tick_that_may_not_change_enough_says_by_how_much_more():
    problem = allegro()[0]
    last = gf.solve(problem).c
    found = gf.diagnose(problem.replace(f=1.5 * problem.f, c_last=last, dc_max=0.05))
    rate = next(each for each in found.remedies if each.kind == "rate")
    assert all(each.kind == "rate" for each in found.binding[:3])
    for share, status in ((0, gf.Status.SOLVED), (0.01, gf.Status.INFEASIBLE)):
        changed = a_little_less(found.solution.problem, rate, share)
        assert gf.solve(changed).status is status


def test_the_weights_are_those_of_the_conflict():
    """Only friction and torque of the loaded finger bind here, and removing either one helps."""
    for problem in infeasible(10):
        found = gf.diagnose(problem)
        shares = [each.share for each in found.binding]
        assert shares == sorted(shares, reverse=True)
        assert 0.9 < sum(shares) <= 1 + 1e-9
    # A pinch whose ceilings are too low for the weight: friction and ceilings, half each.
    contacts = [gf.Contact((s * 0.04, 0, 0), (-s, 0, 0), gf.SFC(0.5, 0.01)) for s in (1, -1)]
    pinch = gf.Grasp(contacts).problem([0, 0, 10, 0, 0, 0], c_max=8)
    found = gf.diagnose(pinch, fingers=["thumb", "index"])
    assert {each.kind for each in found.binding} == {"friction", "ceiling"}
    assert {each.name for each in found.binding} == {
        f"the {kind} of {tip}" for kind in ("friction", "ceiling") for tip in ("thumb", "index")
    }
    assert [each.share for each in found.binding] == pytest.approx([0.25] * 4, abs=1e-4)
    values = {each.kind: each.value for each in found.remedies}
    assert values["friction"] == pytest.approx(1.25, rel=0.01)
    assert values["ceiling"] == pytest.approx(1.25, rel=0.01)
    assert values["load"] == pytest.approx(0.8, rel=0.01)
    assert values["support"] == pytest.approx(2.0, rel=0.01)
    assert re.search(r"friction 1.2\d times as high \(mu = 0.6\d\d in place of 0.5\)", str(found))
    assert re.search(r"ceilings 1.2\d times as high \(10(.\d)? N in place of 8 N\)", str(found))


def test_a_torque_limit_is_named_by_its_joint():
    problem = allegro()[0]
    names = [f"j{i}" for i in range(16)]
    found = gf.diagnose(problem.replace(f=10 * problem.f), joints=names)
    torques = [each for each in found.binding if each.kind == "torque"]
    assert torques
    for each in torques:
        assert each.name.endswith(f" torque limit of j{each.index}")
    freed = np.full(16, 0.7)
    freed[[each.index for each in torques]] *= 3
    freer = problem.replace(f=10 * problem.f, tau_lo=-freed, tau_hi=freed)
    assert gf.solve(freer).violation < found.solution.violation


def test_a_finger_that_is_away_is_asked_back():
    problem = allegro()[0].replace(c_max=20, engagement=[1, 1, 0, 1])
    found = gf.diagnose(problem, fingers=["index", "middle", "ring", "thumb"])
    back = next(each for each in found.remedies if each.kind == "finger")
    assert back.text.startswith("ring back at an engagement of 0.")
    assert gf.solve(problem.replace(engagement=[1, 1, back.value, 1])).status is gf.Status.SOLVED


def test_a_grasp_with_an_answer_says_what_it_could_spare():
    problem = allegro()[0]
    found = gf.diagnose(gf.solve(problem))
    assert found.line == ""
    assert str(found).startswith("The grasp holds this load.")
    for remedy in found.remedies:
        assert remedy.solution.verify().ok
        less = a_little_less(problem, remedy, 0.01)
        assert socp.solve(less).status is gf.Status.INFEASIBLE


def test_nothing_that_limits_the_grip_is_said_to_be_missing():
    problem = allegro()[0].replace(J=None, tau_lo=None, tau_hi=None)
    found = gf.diagnose(problem)
    assert found.status is gf.Status.UNBOUNDED
    assert "Nothing limits the grip" in str(found)
    (remedy,) = found.remedies
    assert remedy.solution.status is gf.Status.SOLVED


def test_a_wrench_out_of_reach_is_told_by_its_part():
    contacts = [gf.Contact((s * 0.1, 0, 0), (-s, 0, 0), gf.PCWF(0.5)) for s in (1, -1)]
    found = gf.diagnose(gf.Grasp(contacts).problem([0, 0, 1, 0.01, 0, 0], c_max=10))
    assert found.status is gf.Status.WRENCH_UNREACHABLE
    assert found.missing == pytest.approx((0, 0, 0, 0.01, 0, 0), abs=1e-12)
    assert "The nearest that they make lacks 0.01 N·m about x of it" in str(found)


def test_what_an_infeasible_load_lacks_and_what_is_on_the_edge_are_told():
    contacts = [gf.Contact((s * 0.1, 0, 0), (-s, 0, 0), gf.SFC(0.5, 0.01)) for s in (1, -1)]
    pinch = gf.Grasp(contacts).problem([0, 0, 13, 0, 0, 0], c_max=10)
    found = gf.diagnose(pinch)
    assert found.status is gf.Status.INFEASIBLE
    assert found.missing == pytest.approx((0, 0, 3, 0, 0, 0), abs=1e-6)
    assert "The nearest wrench within them lacks 3 N along z." in str(found)
    edge = gf.diagnose(pinch.replace(f=[0, 0, 10, 0, 0, 0]))
    assert edge.status is gf.Status.ON_EDGE
    assert edge.missing == ()
    assert str(edge).startswith("This load is on the edge of what the contacts can hold")


def test_a_diagnosis_is_plain_data():
    found = gf.diagnose(infeasible(1)[0])
    data = json.loads(json.dumps(found.to_dict()))
    assert data["status"] == "INFEASIBLE"
    assert data["text"] == str(found)
    assert [each["value"] for each in data["remedies"]] == [r.value for r in found.remedies]


def test_wrong_arguments_are_refused():
    problem = allegro()[0]
    with pytest.raises(gf.InvalidInputError, match="expected a ForceProblem or a Solution"):
        gf.diagnose("grasp")
    with pytest.raises(gf.InvalidInputError, match="fingers: got 1 names, expected 4"):
        gf.diagnose(problem, fingers=["thumb"])
    with pytest.raises(gf.InvalidInputError, match=re.escape("joints[0]: got 3")):
        gf.diagnose(problem, joints=[3] * 16)


# ---- the command -------------------------------------------------------------------------------


def test_the_table_of_solve_adds_what_would_help():
    done = run("solve", SEVERAL)
    for name, problem in files.read(SEVERAL):
        solution = gf.solve(problem)
        if solution.status is not gf.Status.SOLVED:
            line = gf.diagnose(solution).line
            assert line.startswith("what would help: friction ")
            assert f"{name}: {solution.message}; {line}\n" in done.stdout


def test_explain_tells_the_first_grasp_without_an_answer_or_any(tmp_path):
    grasps = files.read(SEVERAL)
    done = run("explain", SEVERAL)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"1 can, 35 N: {gf.diagnose(grasps[1].problem)}\n")
    assert re.search(r"the friction of finger 2 +17 +█+", done.stdout)
    done = run("explain", SEVERAL, "--grasp", 0)
    assert done.stdout.startswith(f"0 can, 2.5 N: {gf.diagnose(grasps[0].problem)}\n")
    picture = tmp_path / "why.png"
    done = run("explain", EXAMPLES / "paper_grasp.json", "--picture", picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert f"The picture is {picture}" in done.stdout


def test_explain_refuses_a_grasp_or_picture_that_cannot_be(tmp_path):
    done = run("explain", SEVERAL, "--grasp", 5)
    assert done.returncode == 2
    assert done.stderr.startswith("graspforce: --grasp: got 5, expected 0 to 4")
    done = run("explain", SEVERAL, "--picture", tmp_path / "why.gif")
    assert done.returncode == 2
    assert ".png" in done.stderr
