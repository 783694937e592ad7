"""The live page without a browser: knobs, problems, remedies, picking, files, the server's ways."""

import json
import re
import socket
import threading
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from models import paper_hand_xml
from typer.testing import CliRunner
from viser import ViserServer

import graspforce as gf
from graspforce import cli, sim, viewer
from graspforce.baselines import lp
from graspforce.viewer import colours, export, shapes, words
from graspforce.viewer.knobs import Knobs, direction_angles
from graspforce.viewer.problems import answer
from graspforce.viewer.remedy import knobs_for
from graspforce.viewer.scene import Scene, contact_forces
from graspforce.viewer.subjects.closing import open_hand
from graspforce.viewer.subjects.file import contacts_of
from graspforce.viewer.subjects.trial import TrialSubject
from graspforce.viewer.timeline import Forces


def solved(subject, **changes):
    knobs = subject.knobs.changed(**changes)
    moment = subject.moment(knobs)
    return moment, answer(moment.problem, knobs)


# ---- knobs --------------------------------------------------------------------------------------


def test_a_link_brings_all_knobs_back():
    base = Knobs(load=0.25)
    knobs = base.changed(
        firmness="slip_reserve", alpha=12.5, wish=0.3, friction=1.5, push=(1.0, -2.0, 0.5),
        tilt=30.0, engagement=(1.0, 0.25), time=0.7, other="lp", shape="box",
        picks=((1, (0.0, 0.01, 0.02), (0.0, -1.0, 0.0)),),
    )  # fmt: skip
    assert base.from_query(knobs.to_query(base)) == knobs
    assert base.to_query(base) == ""


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("alpha=1e9", "alpha: got 1000000000.0, expected 0.01 to 1e\\+06"),
        ("alpha=nan", "alpha: got 'nan', expected a number"),
        ("alpha=NaN", "alpha: got nan"),
        ("friction=true", "friction: got True"),
        ("push=[1,2]", "push: got"),
        ("engagement=[2]", "engagement: got 2"),
        ("firmness=hard", "firmness: got 'hard', expected alpha"),
        ("shape=cup", "shape: got 'cup', expected sphere, box, cylinder"),
        ("picks=[[0,[0,0,0],[0,0,2]]]", "picks: got"),
        ("picks=3", "picks: got 3"),
        ("warmth=3", "knob: got 'warmth', expected one of alpha, ceiling"),
    ],
)
def test_a_link_with_a_wrong_knob_is_refused(query, said):
    with pytest.raises(gf.InvalidInputError, match=said):
        Knobs().from_query(query)


def test_gravity_is_where_tilt_and_heading_say():
    assert np.allclose(Knobs().gravity, [0, 0, -1])
    assert np.allclose(Knobs(tilt=90, heading=90).gravity, [0, 1, 0])
    assert np.allclose(direction_angles(Knobs(tilt=50, heading=-120).gravity), [50, -120])


# ---- the problem that the knobs make ------------------------------------------------------------


@pytest.mark.parametrize("name", ["static", "dynamic", "regrasp"])
def test_knobs_at_rest_show_the_scenario_itself(name):
    scenario, subject = gf.scenarios.get(name), viewer.open_subject(name)
    for t in (0.0, 0.6):
        _, found = solved(subject, time=t)
        assert np.allclose(found.solution.c, gf.solve(scenario.problem(t)).c, rtol=1e-7, atol=1e-9)


def test_each_knob_does_what_it_says():
    subject = viewer.open_subject("static")
    moment, plain = solved(subject)
    given = plain.problem
    assert np.allclose(solved(subject, load=0.5)[1].problem.f, 2 * given.f)
    assert np.allclose(solved(subject, push=(1, 2, 3))[1].problem.f[:3], given.f[:3] - [1, 2, 3])
    assert np.allclose(
        solved(subject, tilt=90, heading=0)[1].problem.f[:3], [-0.25 * 9.81, 0, 0], atol=1e-12
    )
    assert np.allclose(solved(subject, friction=2)[1].problem.mu, 2 * given.mu)
    assert np.allclose(solved(subject, torque=0.8)[1].problem.tau_hi, 0.8 * given.tau_hi)
    assert np.allclose(solved(subject, ceiling=9)[1].problem.c_max, 9)
    away = solved(subject, engagement=(0.0,))[1]
    assert away.solved
    assert away.solution.normal_forces[0] == 0
    assert (away.solution.normal_forces[1:] > 0).all()
    moved, _ = solved(subject, move=(0.01, 0, 0.005), turn=(0, 0, 0.1))
    assert np.allclose(moved.origin, moment.origin + np.array([0.01, 0, 0.005]))
    assert moved.contacts[0] != moment.contacts[0]


def test_a_larger_alpha_is_lighter_and_a_wish_is_kept():
    subject = viewer.open_subject("static")
    firm, light = (solved(subject, alpha=a)[1].solution.normal_forces.max() for a in (0.1, 100))
    assert light < firm
    _, found = solved(subject, firmness="largest_normal", wish=1.3)
    assert firm > 1.3 >= found.solution.normal_forces.max()
    with pytest.raises(gf.InvalidInputError, match="slip_reserve"):
        solved(subject, firmness="slip_reserve", wish=1.5)


def test_an_object_out_of_reach_is_refused():
    with pytest.raises(gf.InvalidInputError, match="out of reach of finger"):
        viewer.open_subject("static").moment(Knobs(move=(0.0, 0.0, 0.3)))


def test_remedies_are_knobs_that_were_tried():
    subject = viewer.open_subject("static")
    knobs = subject.knobs.changed(load=2.0)
    moment = subject.moment(knobs)
    found = gf.diagnose(moment.problem, moment.fingers, moment.joints)
    assert found.status is gf.Status.INFEASIBLE
    helped = {each.kind: knobs_for(each, moment.problem, knobs, subject) for each in found.remedies}
    assert helped["support"] is None  # no knob is a further finger
    for kind in ("friction", "torque", "load"):
        assert helped[kind] != knobs
        assert answer(subject.moment(helped[kind]).problem, helped[kind]).solved
    # Nothing is turned farther than a part in a hundred beyond what helps.
    less = knobs.changed(friction=0.98 * helped["friction"].friction)
    assert not answer(subject.moment(less).problem, less).solved


def test_an_absent_finger_comes_back_as_a_remedy():
    subject = viewer.open_subject("static")
    knobs = subject.knobs.changed(load=1.0, engagement=(0.05, 0.05, 1.0, 1.0), ceiling=20.0)
    moment = subject.moment(knobs)
    remedy = [each for each in gf.diagnose(moment.problem).remedies if each.kind == "finger"]
    assert remedy
    changed = knobs_for(remedy[0], moment.problem, knobs, subject)
    assert sum(a != b for a, b in zip(changed.engagement, knobs.engagement, strict=True)) == 1


def test_the_verdict_says_why_and_names_are_no_html():
    subject = viewer.open_subject("static")
    moment, found = solved(subject, load=2.0)
    names = [f"<i>{name}</i>" for name in moment.fingers]
    known = gf.diagnose(found.solution, names, moment.joints)
    said = words.verdict(moment, found, known)
    assert "No contact force holds this load" in said
    assert "the friction of &lt;i&gt;finger" in said
    assert "<i>" not in said
    assert "Any one of these" not in said  # they stand on buttons


# ---- files of grasps ----------------------------------------------------------------------------


def test_contacts_are_read_off_the_grasp_map():
    contacts = (
        gf.Contact((0.04, 0, 0.01), (-1, 0, 0), gf.PCWF(0.5)),
        gf.Contact((-0.03, 0.02, 0), (0.6, -0.8, 0), gf.SFC(0.6, 0.004), tangent=(0, 0, 1)),
        gf.Contact((0.0, 0.0, -0.03), (0, 0, 1), gf.FPC()),
    )
    problem = gf.Grasp(contacts).problem([0, 0, 1, 0, 0, 0], c_max=10)
    found = contacts_of(problem)
    for i, contact in enumerate(contacts):
        if contact.model.dim > 1:  # without friction it may be anywhere on its normal
            assert np.allclose(found[i].point, contact.point)
        assert np.allclose(found[i].normal, contact.normal)
    assert np.allclose(gf.grasp_map(found), problem.W)
    assert np.allclose(found[1].frame, contacts[1].frame)
    assert contacts_of(problem.replace(W=2 * problem.W)) is None


def test_a_file_is_a_list_of_grasps(tmp_path):
    subject = viewer.open_subject("examples/several_grasps.json")
    grasps = gf.files.read("examples/several_grasps.json")
    assert subject.items == tuple(each.name for each in grasps)
    for i, (_, problem) in enumerate(grasps):
        moment, found = solved(subject, item=i, alpha=problem.alpha)
        assert np.array_equal(found.solution.c, gf.solve(problem).c)
        assert len(moment.contacts) == problem.n
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps({"grasp": 3}))
    with pytest.raises(gf.InvalidInputError, match=str(wrong)):
        viewer.open_subject(str(wrong))
    with pytest.raises(gf.InvalidInputError, match="expected a file of grasps or one of static"):
        viewer.open_subject("statik")


def test_a_grasp_that_is_no_grasp_map_is_solved_but_not_drawn(tmp_path):
    problem = gf.scenarios.get("static").problem(0.0)
    cables = problem.replace(W=1.5 * problem.W)
    np.savez(
        tmp_path / "cables.npz", W=cables.W[None], f=cables.f[None], mu=cables.mu[None],
        J=cables.J[None], tau_lo=cables.tau_lo[None], tau_hi=cables.tau_hi[None],
    )  # fmt: skip
    subject = viewer.open_subject(str(tmp_path / "cables.npz"))
    moment, found = solved(subject)
    assert found.solved
    assert not moment.contacts
    assert "no places to draw" in moment.note


# ---- hands --------------------------------------------------------------------------------------


TIPS = [f"link_{k}.0_tip" for k in (3, 7, 11, 15)]


def allegro_file():
    files = metadata.files("example-robot-data")
    found = next(each.locate() for each in files if each.name == "allegro_right_hand.urdf")
    return Path(str(found))


def allegro():
    return viewer.open_hand(allegro_file(), TIPS, 0.7)


def paper_mjcf(tmp_path):
    path = tmp_path / "hand.xml"
    path.write_text(paper_hand_xml())
    return viewer.open_hand(path)


@pytest.mark.parametrize("make", [lambda _: allegro(), paper_mjcf], ids=["urdf", "mjcf"])
def test_contacts_are_picked_and_the_fingers_reach_for_them(make, tmp_path):
    subject = make(tmp_path)
    empty = subject.moment(subject.knobs)
    assert empty.problem is None
    assert "click on the object" in empty.note
    knobs = subject.touch_all(subject.knobs)
    moment = subject.moment(knobs)
    assert moment.fingers == subject.fingers
    centre, radius = moment.origin, subject.knobs.size / 2
    for contact in moment.contacts:
        assert np.linalg.norm(contact.point - centre) == pytest.approx(radius, rel=0.03)
        assert contact.normal @ (centre - contact.point) > 0.99 * radius * 0.97
    assert answer(moment.problem, knobs).solution.status is gf.Status.SOLVED
    again = subject.knobs.from_query(knobs.to_query(subject.knobs))
    assert np.array_equal(subject.moment(again).problem.J, moment.problem.J)


def test_a_hand_whose_meshes_are_missing_is_drawn_as_links(tmp_path):
    path = tmp_path / "hand.urdf"
    path.write_text(allegro_file().read_text())  # its meshes are named relative to a package
    subject = viewer.open_hand(path, TIPS, 0.7)
    names = {body.name.rpartition(" ")[0] for body in subject.bodies(subject.knobs)[:-1]}
    assert names == set(subject.fingers)
    assert len(allegro().bodies(subject.knobs)) > 20  # where they are found


def test_a_click_beside_the_object_is_no_contact_and_one_on_it_is():
    subject = allegro()
    away = subject.centre + np.array([0, 0, 1.0])
    assert subject.pick(subject.knobs, away, np.array([0, 1.0, 0]), None) == subject.knobs
    knobs = subject.pick(subject.knobs, away, np.array([0, 0, -1.0]), 2)
    (pick,) = knobs.picks
    assert pick.finger == 2
    assert np.allclose(pick.point, [0, 0, knobs.size / 2], atol=2e-3)
    twice = subject.pick(knobs, away, np.array([0, 0, -1.0]), 2)
    assert len(twice.picks) == 1  # a finger touches once


@pytest.mark.parametrize("shape", ["sphere", "box", "cylinder"])
def test_normals_point_into_every_shape(shape):
    subject = allegro()
    knobs = subject.knobs.changed(shape=shape)
    for way in np.vstack((np.eye(3), -np.eye(3))):
        changed = subject.pick(knobs, subject.centre + way, -way, 0)
        assert np.allclose(changed.picks[0].normal, -way, atol=0.1)


def test_a_hand_that_does_not_load_says_what_the_reader_says(tmp_path):
    wrong = tmp_path / "hand.xml"
    wrong.write_text("<mujoco><worldbody/>")
    with pytest.raises(gf.ModelImportError, match="not a model that MuJoCo reads"):
        viewer.open_hand(wrong)


def test_meshes_are_closed_and_have_their_sizes():
    for (vertices, faces), extent in (
        (shapes.box([1, 2, 3]), (1, 2, 3)),
        (shapes.ball(2.0), (4, 4, 4)),
        (shapes.cylinder(1.0, 3.0), (2, 2, 3)),
        (shapes.capsule(0.5, 2.0), (1, 1, 3)),
        (shapes.cone(), (2, 2, 1)),
    ):
        assert np.allclose(np.ptp(vertices, axis=0), extent, rtol=0.01)
        corners = vertices[faces]
        areas = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        edges = {}
        for a, b, c in np.unique(vertices.round(9), axis=0, return_inverse=True)[1][
            faces[areas > 1e-9]
        ]:
            for edge in ((a, b), (b, c), (c, a)):
                edges[edge] = edges.get(edge, 0) + 1
        assert all(edges.get((b, a)) == n for (a, b), n in edges.items())


# ---- simulated scenes ---------------------------------------------------------------------------


def test_a_scene_is_run_while_nothing_else_is_to_do_and_scrubbed():
    subject = viewer.open_subject("hold")
    start = subject.moment(subject.knobs)
    assert not subject.busy
    knobs = subject.knobs.changed(time=0.02)
    subject.moment(knobs)
    while len(subject._scene(0).source._ticks) < 30:
        assert subject.busy
        subject.work(0.05)
    moment = subject.moment(knobs)
    assert np.linalg.norm(moment.simulated, axis=1).min() > 0.1
    assert np.allclose(moment.origin, start.origin, atol=1e-3)
    assert answer(moment.problem, knobs).solved
    assert np.allclose(
        solved(subject, load=2 * subject.knobs.load)[1].problem.f[2], 2 * 9.81 * 0.25
    )


def test_a_scene_that_is_called_like_a_scenario_has_a_name_of_its_own():
    assert "physics" not in viewer.open_subject("regrasp").controls
    assert "physics" in viewer.open_subject("sim/regrasp").controls
    with pytest.raises(gf.InvalidInputError, match="regrasp, hold, circle, sim/regrasp, allegro"):
        viewer.open_subject("sim/reg")


def test_physics_answers_to_push_lift_friction_and_reset():
    subject = viewer.open_subject("hold")
    loop = subject.live(subject.knobs)
    loop.advance(0.05, 100)
    rest = loop.tick.origin
    loop.set(5.0, 1.0, np.array([1.5, 0, 0, 0, 0, 0]))
    loop.advance(0.1, 100)
    assert loop.tick.origin[0] > rest[0] + 1e-4
    loop.set(5.0, 1.0, np.array([0, 0, 0, 0, 0, 0.02]))
    loop.advance(0.1, 100)
    assert 2 * loop.tick.qpos[-1] > 0.002  # turned about z [rad]
    loop.set(5.0, 1.0, np.zeros(6))
    loop.lift(0)
    loop.advance(0.8, 100)
    assert loop.tick.problem.engagement[0] < 1e-2
    loop.reset()
    assert loop.tick.t == 0
    loop.set(1e4, 0.25, np.zeros(6))  # light, with a quarter of the friction it counts on
    loop.advance(2.0, 100)
    assert "dropped" in loop.ended


def test_a_push_and_a_twist_are_taken_off_the_wrench_of_every_subject():
    applied = np.array([0.1, -0.2, 0.3, 0.004, 0.005, -0.006])
    for subject in (
        viewer.open_subject("regrasp"), viewer.open_subject("hold"),
        viewer.open_subject("examples/several_grasps.json"),
    ):  # fmt: skip
        without = subject.moment(subject.knobs).problem.f
        pushed = subject.knobs.changed(push=tuple(applied[:3]), twist=tuple(applied[3:]))
        assert np.allclose(subject.moment(pushed).problem.f, without - applied, atol=1e-12)


def test_each_trial_of_a_scene_is_chosen_and_has_its_own_alpha():
    subject = viewer.open_subject("disturbance")
    trials = sim.get("disturbance")
    assert subject.items == tuple(trial.name for trial in trials)
    assert [subject.alpha_of(i) for i in (0, 3)] == [trials[0].alpha, trials[3].alpha]
    assert trials[0].alpha != trials[3].alpha
    payload = subject.items.index("payload, alpha=5")
    knobs = subject.knobs.changed(item=payload, time=0.01)
    subject.moment(knobs)
    while subject.moment(knobs.changed(time=0.1)).origin is subject.moment(knobs).origin:
        subject.work(0.05)
    assert "is being run" in subject.moment(knobs).note
    assert subject.moment(knobs.changed(item=0, time=0)).note == ""


def test_whatever_hand_holds_something_runs_live_and_is_told_by_its_links():
    subject = viewer.open_subject("hand/panda")
    assert {each.rpartition(" ")[0] for each in subject.fingers} == {
        "left_jaw",
        "right_jaw",
        "spare",
    }
    assert "lift" not in subject.controls
    _, found = solved(subject)
    loop = subject.live(subject.knobs)
    # The loop may miss a hundredth of the weight.
    assert np.allclose(found.solution.c, gf.solve(loop.tick.problem).c, atol=2e-3)
    moment, heavy = solved(subject, load=30.0)
    assert heavy.solution.status is gf.Status.INFEASIBLE
    soft = loop.tick.problem.replace(f=moment.problem.f)
    said = words.verdict(moment, answer(soft, subject.knobs), None)
    assert re.search("Not held: .*N of 294.3.*N are missing", said)
    loop.set(subject.knobs.alpha, 1.0, np.array([0, 0, 1.0, 0, 0, 0]))
    loop.advance(0.02, 100)
    assert loop.tick.f[2] < 9.81 * loop.mass  # it is lifted, and the law holds against that
    forces = subject.live_moment(loop, subject.knobs).simulated.sum(axis=0)
    assert forces[2] == pytest.approx(9.81 * loop.mass - 1.0, rel=0.1)
    firm = loop.tick.problem.alpha
    loop.set(100 * firm, 0.01, np.zeros(6))  # the controller does not know that nothing rubs
    loop.advance(0.5, 100)
    assert loop.tick.problem.alpha == 100 * firm
    assert "dropped" in loop.ended


def test_a_hand_that_has_yet_to_close_is_shown_open(tmp_path):
    look, finish = viewer.begin_subject("hand/panda")
    assert isinstance(look, viewer.Look)
    assert "closes on the object" in look.moment.note
    subject = finish()
    moment = subject.moment(subject.knobs)
    assert moment.problem is not None
    assert subject.title == look.title
    assert np.allclose(look.centre, subject.centre, atol=1e-3)
    assert look.size == pytest.approx(subject.size, rel=0.1)
    moved = [
        np.linalg.norm(pose.position - look.moment.poses[name].position)
        for name, pose in moment.poses.items()
    ]
    assert 0.005 < max(moved) < 0.1  # the jaws
    sim.run(subject._trials[0]).save(tmp_path / "log.npz")
    _, finish = viewer.begin_subject("hand/panda", tmp_path / "log.npz")
    assert finish().title == "hand/panda, a log"
    with pytest.raises(gf.InvalidInputError, match="expected a body of the model: "):
        open_hand(sim.hand_model("panda"), "cup", "")
    with pytest.raises(gf.InvalidInputError, match="No such file"):  # before the hand closes
        viewer.begin_subject("hand/panda", tmp_path / "none.npz")


def test_contacts_of_one_finger_have_its_colour_and_one_label():
    names = ("index (1)", "index (2)", "thumb", "finger 1", "finger 2", "index (3)")
    blue, orange, green, pink = colours.FINGERS
    assert colours.of_fingers(names) == [blue, blue, orange, green, pink, blue]
    subject = viewer.open_subject("hand/panda")
    moment, found = solved(subject)
    server = ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        scene = Scene(server.scene, subject)
        scene.show(subject.bodies(subject.knobs), moment, found)
        labels = [each.text for each in scene._contacts._labels if each.visible]
    finally:
        server.stop()
    forces = contact_forces(moment, found.solution.c)
    expected = []
    for jaw in ("left_jaw", "right_jaw"):
        own = [name.startswith(jaw) for name in moment.fingers]
        assert sum(own) > 1
        expected.append(f"{jaw}: {np.linalg.norm(forces[own].sum(axis=0)):.2f} N")
    assert sorted(labels) == expected
    assert "largest normal" in words.verdict(moment, found, None)
    largest = moment.fingers[int(found.solution.normal_forces.argmax())]
    assert f"by {largest} ·" in words.verdict(moment, found, None)
    legend = words.legend(subject.fingers)
    assert "left_jaw" in legend
    assert "spare" not in legend


def test_a_log_is_played_with_the_grasps_that_the_loop_had(tmp_path):
    (trial,) = sim.get("regrasp", duration=0.6)
    log = sim.run(trial)
    log.save(tmp_path / "log.npz")
    subject = TrialSubject((trial,), "regrasp", sim.Log.load(tmp_path / "log.npz"))
    assert np.array_equal(subject.times, log.t)
    for k in (10, 225, 299):  # at rest; while finger 1 leaves; when it is off
        moment, found = solved(subject, time=float(log.t[k]))
        assert np.allclose(moment.problem.f, log.f[k], atol=1e-12)
        touching = np.flatnonzero(log.clearance[k] == 0)
        assert moment.fingers == tuple(f"finger {i + 1}" for i in touching)
        order = [moment.fingers.index(f"finger {i + 1}") for i in touching]
        normal = np.reshape(log.c[k], (4, 3))[touching, 0]
        # The loop's bias torques have the fingers' own inertia, of joints at rest there is none.
        assert np.allclose(found.solution.normal_forces[order], normal, atol=0.05)
        assert np.allclose(moment.simulated[order], log.force[k][touching])
    (other,) = sim.get("quadruped")
    with pytest.raises(gf.InvalidInputError, match="expected one of that scene"):
        TrialSubject((other,), "quadruped", sim.Log.load(tmp_path / "log.npz"))
    with pytest.raises(gf.InvalidInputError, match="expected a scene that is one"):
        viewer.open_subject("allegro", tmp_path / "log.npz")
    with pytest.raises(gf.InvalidInputError, match="expected a scene to the log, one of hold"):
        viewer.open_subject("static", tmp_path / "log.npz")


def test_a_log_that_is_none_is_refused(tmp_path):
    np.savez(tmp_path / "other.npz", t=np.zeros(3))
    (tmp_path / "text.npz").write_text("no archive")
    for name, said in (
        ("other.npz", "it has no qpos"), ("text.npz", "expected the .npz of a log"),
        ("missing.npz", "No such file"), ("log.csv", "does not have all of it"),
    ):  # fmt: skip
        with pytest.raises(gf.InvalidInputError, match=said):
            sim.Log.load(tmp_path / name)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("static --log l.npz", "expected a scene to the log, one of hold"),
        ("hold --log l.npz", "No such file"),
        ("--hand h.xml --log l.npz", "--log: expected with a simulated scene"),
        ("--model m.xml", "--model, --object: got one of them"),
        ("hold --model m.xml --object cube", "NAME hold: got --model m.xml beside it"),
        ("--model m.xml --object cube", "m.xml: there is no such file"),
        ("hold --tip thumb", "expected together with --hand"),
    ],
)
def test_the_command_says_what_does_not_go_together(options, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli.app, ["view", *options.split()])
    assert result.exit_code == 2
    assert said in " ".join(result.stderr.split())


# ---- forces over time ---------------------------------------------------------------------------


def test_jumps_are_where_a_vertex_changes_and_wbf_has_none():
    subject = viewer.open_subject("regrasp")
    times = subject.times[105:130]  # finger 1 is about to be away
    problems = [subject.moment(subject.knobs.changed(time=float(t))).problem for t in times]
    forces = [
        Forces(name, times, np.array([solve(problem).normal_forces for problem in problems]))
        for name, solve in (("WBF", gf.solve), ("lp", lp.solve))
    ]
    largest = max(each.largest for each in forces)
    smooth, jumping = (each.jumps(largest) for each in forces)
    assert len(smooth) == 0
    n = forces[1].normals
    by_hand = [
        k for k in range(24) if max(abs(n[k + 1, i] - n[k, i]) for i in range(4)) > 0.05 * largest
    ]
    assert by_hand
    assert jumping.tolist() == by_hand
    said = words.jumps(forces, subject.fingers)
    assert "WBF: none; lp: " in said
    step = np.abs(np.diff(n, axis=0)).max(axis=0)
    assert f"{step.max():.4g}\N{NO-BREAK SPACE}N of finger {step.argmax() + 1} at" in said


# ---- export and server --------------------------------------------------------------------------


def test_an_exported_page_has_everything_in_it():
    subject = viewer.open_subject("static")
    page = export.html(subject, subject.knobs)
    assert page.startswith("<!")
    assert "__VISER_EMBED_DATA__" in page
    assert "<script src=" not in page


def test_a_recording_of_a_scene_runs_it_first():
    (trial,) = sim.get("hold", duration=0.1)
    subject = TrialSubject((trial,), "hold")
    page = export.html(subject, subject.knobs, moving=True)
    assert "__VISER_EMBED_DATA__" in page
    assert not subject.busy
    now = subject.knobs.changed(time=float(subject.times[-1]))
    assert subject.moment(now).note == ""


def threads():
    return sorted(each.name for each in threading.enumerate())


def test_the_server_frees_its_port_and_its_threads():
    before = threads()
    page = viewer.Viewer(viewer.open_subject("static"), port=0)
    port = int(page.url.rsplit(":", 1)[1].strip("/"))
    with pytest.raises(gf.InvalidInputError, match=f"port: got {port} on 127.0.0.1"):
        viewer.Viewer(viewer.open_subject("static"), port=port)
    page.stop()
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))
    deadline = time.monotonic() + 20
    while threads() != before and time.monotonic() < deadline:
        time.sleep(0.05)
    assert threads() == before


def test_other_interfaces_are_warned_of_and_wrong_ones_refused():
    with pytest.warns(gf.GraspForceWarning, match="can use the page"):
        viewer.Viewer(viewer.open_subject("static"), host="0.0.0.0", port=0).stop()
    for host, port, said in (("192.0.2.1", 0, "host"), ("no.such.host.invalid", 0, "host")):
        with pytest.raises(gf.InvalidInputError, match=f"^{said}: got"):
            viewer.Viewer(viewer.open_subject("static"), host=host, port=port)
    with pytest.raises(gf.InvalidInputError, match="expected 0 to 65535"):
        viewer.Viewer(viewer.open_subject("static"), port=70000)
