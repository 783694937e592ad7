"""More motors than motions: tendons, muscles, two motors on one motion.

Every answer has to be one of the motors themselves: their forces within their own limits, and the
torques that they make at the joints those that the contacts ask for.
"""

import copy
import json
import pickle

import mujoco
import numpy as np
import pytest
from grasps import components
from redundant_hands import EDGE, margin, random_case
from scipy import optimize

import graspforce as gf
from graspforce import equations, files
from graspforce.baselines import socp
from graspforce.hands.transmission import transmission

pytestmark = pytest.mark.filterwarnings("ignore::graspforce.GraspForceWarning")


def pinching_hand(tendons, actuators, gravity="0 0 0"):
    """Two upright one-joint fingers, 5 cm apart at their tips, with tendons as given."""
    fingers = "".join(
        f'<body name="{name}" pos="{x} 0 0"><joint name="j{name}" axis="0 1 0"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 .05" size=".004" mass=".03"/>'
        f'<site name="tip{name}" pos="0 0 .05"/></body>'
        for name, x in (("l", -0.025), ("r", 0.025))
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="{gravity}"/><worldbody>{fingers}</worldbody>'
        f"<tendon>{tendons}</tendon><actuator>{actuators}</actuator></mujoco>"
    )


def fixed(name, joint, arm):
    return f'<fixed name="{name}"><joint joint="{joint}" coef="{arm}"/></fixed>'


def pulls(tendon, most):
    return f'<motor tendon="{tendon}" ctrllimited="true" ctrlrange="{-most} 0"/>'


def pinch(model, mu=0.8):
    hand = gf.hands.from_mjcf(model, ["tipl", "tipr"])
    left, right = hand.fingertip_positions([0, 0])
    contacts = [
        gf.Contact(left, [1, 0, 0], gf.PCWF(mu)), gf.Contact(right, [-1, 0, 0], gf.PCWF(mu)),
    ]  # fmt: skip
    return gf.Grasp(contacts, hand, [0, 0], origin=[0, 0, 0.05])


ANTAGONISTS = (
    fixed("fl", "jl", -0.012) + fixed("el", "jl", 0.008)
    + fixed("fr", "jr", 0.012) + fixed("er", "jr", -0.008),
    "".join(pulls(name, 50) for name in ("fl", "el", "fr", "er")),
)  # fmt: skip


# ---- by hand -----------------------------------------------------------------------------------


def test_antagonists_that_only_pull_pinch():
    grasp = pinch(pinching_hand(*ANTAGONISTS))
    assert grasp.joint_names == ("fl", "el", "fr", "er")
    solution = gf.solve(grasp.problem([0, 0, 1, 0, 0, 0]), check=True)
    u = dict(zip(grasp.joint_names, solution.motor_forces, strict=True))
    assert all(-50 < each < 0 for each in u.values())
    # Torque of each joint by the tendons, and by the contacts: n at 5 cm above.
    left, right = solution.normal_forces
    assert -0.012 * u["fl"] + 0.008 * u["el"] == pytest.approx(0.05 * left, abs=1e-9)
    assert -0.012 * u["fr"] + 0.008 * u["er"] == pytest.approx(0.05 * right, abs=1e-9)
    assert solution.verify().ok


def test_the_most_that_antagonists_hold_is_one_tendons_whole_force():
    # 50 N at 12 mm push with 12 N, and two contacts of mu .8 carry 1.6 times that.
    grasp = pinch(pinching_hand(*ANTAGONISTS))
    most = 1.6 * 50 * 0.012 / 0.05
    assert gf.solve(grasp.problem([0, 0, 0.999 * most, 0, 0, 0])).status is gf.Status.SOLVED
    beyond = grasp.problem([0, 0, 1.001 * most, 0, 0, 0])
    solution = gf.solve(beyond)
    assert solution.status is gf.Status.INFEASIBLE
    assert gf.check_certificate(beyond, solution.certificate)
    assert solution.verify().ok


def test_a_proof_that_internal_forces_undo_is_none():
    grasp = pinch(pinching_hand(*ANTAGONISTS))
    problem = grasp.problem([0, 0, 19.5, 0, 0, 0])  # a little more than can be held
    proof = gf.solve(problem).certificate
    for row in np.flatnonzero(proof.z > 0.1 * proof.z.max()):
        z = np.array(proof.z)
        z[row] *= 0.5
        assert not gf.check_certificate(problem, gf.Certificate(proof.y, z))


def test_two_motors_on_one_tendon_add_up_and_two_tendons_do_not_have_to_share():
    # A strong and a weak tendon at the same arm: the weak one must not hold the strong one back.
    tendons = fixed("al", "jl", -0.01) + fixed("bl", "jl", -0.01) + fixed("ar", "jr", 0.01)
    motors = pulls("al", 1) + pulls("bl", 60) + pulls("ar", 61)
    extend = '<motor joint="jl" ctrllimited="true" ctrlrange="-.01 .01"/><motor joint="jr" '
    extend += 'ctrllimited="true" ctrlrange="-.01 .01"/>'
    grasp = pinch(pinching_hand(tendons, motors + extend))
    solution = gf.solve(grasp.problem([0, 0, 15, 0, 0, 0]), check=True)  # 9.4 N, .47 N·m a side
    u = dict(zip(grasp.joint_names, solution.motor_forces, strict=True))
    assert u["bl"] < -40
    assert -1 < u["al"] < 0


def test_notes_name_the_motors_that_share():
    grasp = pinch(pinching_hand(*ANTAGONISTS))
    hand = gf.hands.from_mjcf(pinching_hand(*ANTAGONISTS), ["tipl", "tipr"])
    assert "'fl', 'el' are 2 motors for 1 motion" in " ".join(hand.notes)
    assert hand.fingers == {"tipl": ("fl", "el"), "tipr": ("fr", "er")}
    assert grasp.internal.shape == (2, 4)
    # Tensions that balance: none of them does work.
    arms = np.array([[-0.012, 0.008, 0, 0], [0, 0, 0.012, -0.008]])
    np.testing.assert_allclose(arms @ grasp.internal.T, 0, atol=1e-15)
    assert isinstance(hand, gf.hands.RedundantHand)


def test_a_hand_with_a_motor_a_joint_has_no_internal_forces():
    motors = '<motor joint="jl" ctrllimited="true" ctrlrange="-1 1"/>'
    motors += '<motor joint="jr" ctrllimited="true" ctrlrange="-1 1"/>'
    grasp = pinch(pinching_hand("", motors))
    problem = grasp.problem([0, 0, 1, 0, 0, 0])
    assert grasp.internal.shape == (0, 2)
    assert problem.layout.internals == 0
    assert gf.solve(problem).internal_forces.shape == (0,)


# ---- beside Clarabel ---------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(60))
def test_the_verdict_is_that_of_all_motors_as_unknowns(seed):
    case = random_case(np.random.default_rng([19, seed]))
    room = margin(case)
    solution = gf.solve(case.grasp.problem(case.f))
    assert abs(room) > EDGE
    assert solution.status is (gf.Status.SOLVED if room > 0 else gf.Status.INFEASIBLE)
    assert solution.verify().ok
    if room < 0:
        return
    # What the motors make at the joints is what the contacts, weight and couplings ask for.
    hand = case.hand
    u = dict(zip(case.grasp.joint_names, solution.motor_forces, strict=True))
    forces = np.array([u.get(name, 0.0) for name in names_of_motors(hand.xml)])
    left = case.torques.T @ solution.c + case.bias - hand.R @ forces
    free = np.linalg.svd(np.vstack((hand.couplings, np.zeros((1, len(left))))))[2]
    free = free[len(hand.couplings) :]  # motions that the couplings allow
    np.testing.assert_allclose(free @ left, 0, atol=1e-8)
    assert (forces >= hand.lo - 1e-12).all()
    assert (forces <= hand.hi + 1e-12).all()


def names_of_motors(xml):
    """The joint or tendon of each motor, in the file's order."""
    model = mujoco.MjModel.from_xml_string(xml)
    tendon = int(mujoco.mjtTrn.mjTRN_TENDON)
    return [
        (model.tendon if kind == tendon else model.joint)(target).name
        for kind, target in zip(model.actuator_trntype, model.actuator_trnid[:, 0], strict=True)
    ]


# ---- the minimum -------------------------------------------------------------------------------


def planted(rng, pull=True):
    """A problem with internal forces whose exact minimum is known: c, v."""
    models = [gf.PCWF(0.6, 3.0 * pull), gf.SFC(0.5, 0.006), gf.PCWF(0.4, 1.0 * pull)]
    m, r, joints, alpha = 10, 2, 15, float(rng.uniform(0.5, 20))
    pushes, c = rng.uniform(1, 5, 3), []
    for model, push in zip(models, pushes, strict=True):
        slope = rng.normal(size=model.dim - 1)
        slope *= rng.uniform(0, 0.9) * model.mu * push / np.linalg.norm(slope)
        if model.dim == 4:
            slope[2] *= model.gamma / model.mu
        c += [push - model.pull, *slope]
    c, v = np.array(c), rng.normal(size=r)
    W, J, internal = (rng.normal(size=shape) for shape in ((6, m), (m, joints), (r, joints)))
    loaded = c + np.array(
        [model.pull if i == 0 else 0.0 for model in models for i in range(model.dim)]
    )
    pushed = equations.grad_phi_soc(loaded, equations.Cones.of_models(models))
    nu = rng.normal(size=6)
    arms = np.vstack((J, internal))
    wanted = np.append((W.T @ nu - pushed) / alpha, np.zeros(r))
    delta = np.linalg.lstsq(arms, wanted, rcond=None)[0]
    s, tau = rng.uniform(0.2, 2, joints), arms.T @ np.append(c, v)
    problem = gf.ForceProblem(
        W, W @ c, models, J=J, internal=internal, alpha=alpha,
        tau_hi=tau + 1 / (s + np.maximum(delta, 0)), tau_lo=tau - 1 / (s + np.maximum(-delta, 0)),
    )  # fmt: skip
    return problem, c, v, nu


@pytest.mark.parametrize("backend", ["native", "reference"])
@pytest.mark.parametrize("seed", range(12))
def test_planted_minima_are_found(seed, backend):
    problem, c, v, nu = planted(np.random.default_rng(seed), pull=seed % 2 == 0)
    solution = gf.solve(problem, gf.Settings(backend=backend, tol=1e-16), check=True)
    np.testing.assert_allclose(solution.c, c, atol=1e-7)
    np.testing.assert_allclose(solution.internal_forces, v, atol=1e-7)
    np.testing.assert_allclose(solution.nu, nu, rtol=1e-5, atol=1e-6)
    arms = np.vstack((problem.J, problem.internal))
    np.testing.assert_allclose(solution.tau, arms.T @ np.append(c, v), atol=1e-6)
    assert solution.verify().ok


def test_phi_is_that_of_the_formulas(rng):
    problem, *_ = planted(rng)
    solution = gf.solve(problem, check=True)
    phi = 0.0
    for model, part in zip(problem.models, components(problem.models), strict=True):
        push, *slope = solution.c[part]
        slope = np.array(slope) * np.array([1, 1, model.mu / model.gamma])[: len(slope)]
        phi -= np.log(model.mu**2 * (push + model.pull) ** 2 - slope @ slope)
    room = np.concatenate((problem.tau_hi - solution.tau, solution.tau - problem.tau_lo))
    assert solution.phi == pytest.approx(phi - problem.alpha * np.log(room).sum(), abs=1e-9)


# ---- streams, copies, files --------------------------------------------------------------------


def test_a_servo_follows_moment_arms_that_change(rng):
    problem, *_ = planted(rng)
    servo = gf.Servo(problem)
    for tick in range(20):
        internal = problem.internal * (1 + 0.002 * tick)
        J = problem.J * (1 + 0.001 * tick)
        solution = servo.step(J=J, internal=internal)
        cold = gf.solve(problem.replace(J=J, internal=internal), check=True)
        assert solution.status is gf.Status.SOLVED
        assert solution.newton_steps <= 4 or tick == 0
        np.testing.assert_allclose(solution.c, cold.c, atol=1e-4)
        np.testing.assert_allclose(solution.internal_forces, servo.internal_forces)
        tau = servo.J.T @ servo.c + servo.internal.T @ servo.internal_forces
        np.testing.assert_allclose(tau, solution.tau, atol=1e-12)


def test_copies_and_arguments_keep_internal_forces_and_pulls(rng):
    problem, *_ = planted(rng)
    assert gf.ForceProblem(**problem.arguments()) == problem
    assert "pulls, 2 internal forces" in repr(problem)
    solution = gf.solve(problem)
    for other in (pickle.loads(pickle.dumps(solution)), copy.deepcopy(solution)):
        assert other == solution
        assert np.array_equal(other.internal_forces, solution.internal_forces)
        assert other.phi == solution.phi
    with pytest.raises(gf.InvalidInputError, match=r"^internal: given without J"):
        gf.ForceProblem(problem.W, problem.f, problem.models, c_max=1, internal=problem.internal)
    with pytest.raises(gf.InvalidInputError, match=r"^internal: got shape \(2, 14\)"):
        problem.replace(internal=problem.internal[:, 1:])


def test_contacts_leave_a_hand_of_more_motors(rng):
    problem, *_ = planted(rng)
    problem = problem.replace(c_max=50, engagement=[1, 1, 1], tau_lo=-30, tau_hi=30)
    for backend in ("native", "reference"):
        settings = gf.Settings(backend=backend)
        nothing = gf.solve(problem.replace(f=np.zeros(6), engagement=[0, 0, 0]), settings)
        assert nothing.status is gf.Status.SOLVED
        assert not nothing.c.any()
        assert nothing.verify().ok
        f = problem.W[:, 0] * 2 + problem.W[:, 3] * 2
        two = gf.solve(problem.replace(f=f, engagement=[1, 1, 0]), settings)
        assert two.status is gf.Status.SOLVED
        assert not two.c[7:].any()
        assert two.verify().ok


def test_files_hold_internal_forces_and_pulls(rng, tmp_path):
    problem, *_ = planted(rng)
    models = [gf.PCWF(0.6, 3.0), gf.PCWF(0.5), gf.PCWF(0.4, 1.0)]
    W, J = problem.W[:, :9], problem.J[:9]
    given = {"f": problem.f, "internal": problem.internal, "tau_lo": -50.0, "tau_hi": 50.0}
    wanted = gf.ForceProblem(W=W, J=J, models=models, **given)
    np.savez(
        tmp_path / "g.npz", W=W[None], J=J[None], f=problem.f[None], mu=[[0.6, 0.5, 0.4]],
        pull=[[3.0, 0, 1.0]], internal=problem.internal[None], tau_limit=50.0,
    )  # fmt: skip
    assert files.read(tmp_path / "g.npz")[0].problem == wanted
    kinds = [{"model": "PCWF", "mu": each.mu, "pull": each.pull} for each in models]
    text = {"W": W.tolist(), "J": J.tolist(), "models": kinds}
    text |= {key: np.asarray(value).tolist() for key, value in given.items()}
    (tmp_path / "g.json").write_text(json.dumps(text), encoding="utf-8")
    assert files.read(tmp_path / "g.json")[0].problem == wanted


def test_tables_of_many_have_the_motors_forces(rng):
    from graspforce.columns import Columns

    solutions = [gf.solve(planted(np.random.default_rng(seed))[0]) for seed in range(3)]
    table = Columns(solutions)
    for name in ("tau", "phi", "friction_margins", "friction_residual", "torque_margins"):
        each = np.array([getattr(solution, name) for solution in solutions])
        np.testing.assert_allclose(getattr(table, name), each, rtol=1e-12, atol=1e-12)


def test_other_methods_refuse_what_they_do_not_know(rng):
    problem, *_ = planted(rng, pull=False)
    with pytest.raises(gf.InvalidInputError, match=r"^internal: got internal forces"):
        socp.solve(problem)


# ---- transmissions -----------------------------------------------------------------------------


def test_a_transmission_of_independent_drives_is_as_ever(rng):
    drives = rng.normal(size=(3, 5))
    driven, free, internal, *_ = transmission(drives, np.zeros((0, 5)))
    np.testing.assert_allclose(drives @ driven, np.eye(3), atol=1e-12)
    assert internal.shape == (0, 3)
    assert free.shape == (5, 2)


@pytest.mark.parametrize("seed", range(20))
def test_drives_and_couplings_that_fix_every_joint_leave_nothing_else(seed):
    """Each drive moves by itself and no coupling is broken, however the rows are scaled."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    rows = rng.normal(size=(n, n)) * 10 ** rng.uniform(-3, 1, (n, 1))
    held = int(rng.integers(0, n))
    couplings, drives = rows[:held], rows[held:]
    driven, free, internal, *_ = transmission(drives, couplings)
    np.testing.assert_allclose(drives @ driven, np.eye(n - held), atol=1e-9)
    scale = np.abs(driven).max() * np.abs(couplings).max(initial=0)
    np.testing.assert_allclose(couplings @ driven, 0, atol=1e-9 * scale)
    assert free.shape == (n, 0)
    assert internal.shape == (0, n - held)


@pytest.mark.parametrize("twice", ["coupling", "drive", "nothing"])
def test_as_many_rows_as_joints_may_depend_on_each_other(twice):
    couplings, drives = np.eye(4)[:2], np.eye(4)[2:]
    if twice == "coupling":
        couplings = np.array([[1.0, 0, 0, 0], [2.0, 0, 0, 0]])
    if twice == "drive":
        drives = np.array([[0, 0, 1.0, 0], [0, 0, 1.0, 1e-12]])
    if twice == "nothing":
        couplings = np.array([[1.0, 0, 0, 0], [0, 0, 0, 0]])
    driven, free, internal, *_ = transmission(drives, couplings)
    assert free.shape == (4, 1)
    assert internal.shape == (int(twice == "drive"), 2)
    np.testing.assert_allclose((couplings @ driven), 0, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_internal_forces_do_no_work_and_the_others_carry_every_load(seed):
    rng = np.random.default_rng(seed)
    couplings = rng.normal(size=(seed % 2, 4))
    drives = rng.normal(size=(6, 4)) * 10 ** rng.uniform(-3, 1, (6, 1))
    driven, free, internal, *_ = transmission(drives, couplings)
    motions = 4 - len(couplings)
    assert internal.shape == (6 - motions, 6)
    assert free.shape[1] == 0
    allowed = np.linalg.svd(np.vstack((couplings, np.zeros((1, 4)))))[2][len(couplings) :].T
    scale = np.abs(drives).max() * np.abs(internal).max()
    np.testing.assert_allclose(internal @ drives @ allowed, 0, atol=1e-12 * scale)
    load = rng.normal(size=4)
    np.testing.assert_allclose(allowed.T @ drives.T @ driven.T @ load, allowed.T @ load, atol=1e-9)
    # Each row has a drive of its own, by which a proof bounds it.
    for row in internal:
        alone = (internal != 0).sum(axis=0) == 1
        assert (alone & (row == 1) & ~driven.any(axis=0)).any()


@pytest.mark.parametrize("seed", range(20))
def test_stops_beside_redundant_drives_bear_what_they_can(seed):
    """What joints can bear, against a linear program with a force for every motor and stop."""
    rng = np.random.default_rng(seed)
    joints, n = 3, int(rng.integers(2, 6))
    drives = rng.uniform(0.5, 2, (n, joints)) * rng.choice([-1, 1], (n, joints))
    alone = rng.random(n) < 0.7  # at one joint each, the others at all
    drives[alone] *= np.eye(joints)[rng.integers(joints, size=int(alone.sum()))]
    couplings = rng.normal(size=(seed % 2, joints))
    stops = rng.choice([-1, 1], (2, 1)) * np.eye(joints)[rng.permutation(joints)[:2]]
    lo, hi = -rng.uniform(0, 1, n), rng.uniform(0, 1, n)
    driven, free, internal, stopped, bearing, beside = transmission(drives, couplings, stops)
    lower, upper = lo.copy(), hi.copy()
    for _, drive, side in beside:
        (upper if side > 0 else lower)[drive] = side * np.inf
    counted = {*bearing, *(stop for stop, _, _ in beside)} == {0, 1}
    forces = np.vstack((drives, stops, couplings)).T
    bounds = [*zip(lo, hi, strict=True), *[(0, None)] * 2, *[(None, None)] * len(couplings)]
    held = []
    for _ in range(40):
        load = forces @ np.concatenate((
            rng.uniform(-1.2, 1.2, n), rng.uniform(-0.3, 1, 2), rng.normal(size=len(couplings))
        ))  # fmt: skip
        exact = optimize.linprog(np.zeros(forces.shape[1]), A_eq=forces, b_eq=load, bounds=bounds)
        told = (stopped.T @ load >= -1e-9).all() and np.abs(free.T @ load).max(initial=0) < 1e-9
        if told and len(internal):
            alike = driven.T @ load
            rows, room = (
                np.vstack((internal.T, -internal.T)),
                np.append(upper - alike, alike - lower),
            )
            told = optimize.linprog(
                np.zeros(len(internal)), A_ub=rows[room < np.inf], b_ub=room[room < np.inf],
                bounds=(None, None),
            ).success  # fmt: skip
        elif told:
            told = (lower <= driven.T @ load).all() and (driven.T @ load <= upper).all()
        held.append(bool(told))
        assert exact.success or not told
        assert told or not (counted and exact.success)
    assert any(held)


# ---- every kind of motor, through both doors ----------------------------------------------------

KINDS_OF_MOTORS = {
    "motor": '<motor tendon="{}" gear="20" ctrllimited="true" ctrlrange="-2 0"/>',
    "position": '<position tendon="{}" kp="1000" forcerange="-40 0"/>',
    "cylinder": '<cylinder tendon="{}" area="2" ctrlrange="-20 0"/>',
    "muscle": '<muscle tendon="{}" force="40" lengthrange=".01 .1"/>',
    "limited": '<general tendon="{}" ctrlrange="-9 9" gainprm="20"/>',
}


def held_box(tendons, motor):
    """A box of 50 g between two such fingers, with fixed tendons or with ones through sites."""
    fingers, ropes = "", ""
    for name, x in (("l", -0.03), ("r", 0.03)):
        inward = 0.006 if x < 0 else -0.006
        fingers += (
            f'<body name="f{name}" pos="{x} 0 0"><joint name="j{name}" axis="0 1 0"/>'
            '<geom type="capsule" fromto="0 0 0 0 0 .06" size=".004" mass=".02"/>'
            f'<site name="p{name}" pos=".01 0 .02"/><site name="m{name}" pos="-.01 0 .02"/>'
            f'<geom type="sphere" size=".005" pos="{inward} 0 .06" friction=".8" mass=".001"/>'
            f'<site name="tip{name}" pos="{inward} 0 .06"/></body>'
            f'<site name="gp{name}" pos="{x + 0.01} 0 -.02"/>'
            f'<site name="gm{name}" pos="{x - 0.01} 0 -.02"/>'
        )
        for side, sign in (("p", 1), ("m", -1)):
            ropes += fixed(side + name, f"j{name}", 0.01 * sign) if tendons == "fixed" else (
                f'<spatial name="{side}{name}"><site site="g{side}{name}"/>'
                f'<site site="{side}{name}"/></spatial>'
            )  # fmt: skip
    actuators = "".join(KINDS_OF_MOTORS[motor].format(name) for name in ("pl", "ml", "pr", "mr"))
    if motor == "limited":  # by the tendon
        ropes = ropes.replace("name=", 'actuatorfrclimited="true" actuatorfrcrange="-40 0" name=')
    return mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 -9.81" cone="elliptic"/><worldbody><body name="box" '
        'pos="0 0 .06"><freejoint/><geom type="box" size=".0195 .02 .02" mass=".05" '
        f'friction=".8"/></body>{fingers}</worldbody><tendon>{ropes}</tendon>'
        f"<actuator>{actuators}</actuator></mujoco>"
    )


@pytest.mark.parametrize("tendons", ["fixed", "spatial"])
@pytest.mark.parametrize("motor", KINDS_OF_MOTORS)
def test_every_kind_of_motor_that_pulls_holds_through_both_doors(tendons, motor):
    model = held_box(tendons, motor)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    seen = gf.Grasp.from_mujoco(model, data, "box")
    hand = gf.hands.from_mjcf(model, ["tipl", "tipr"])
    read = gf.Grasp(
        seen.contacts, hand.touching([f"tip{link[1:]}" for link in seen.links]), [0, 0],
        origin=seen.origin,
    )  # fmt: skip
    assert seen.joint_names == ("pl", "ml", "pr", "mr")
    assert (seen.tau_lo.tolist(), seen.tau_hi.tolist()) == ([-40] * 4, [0] * 4)
    for name in ("joint_names", "J", "internal", "tau_lo", "tau_hi", "tau_bias"):
        assert np.array_equal(getattr(seen, name), getattr(read, name))
    # 40 N at 1 cm make 0.4 N·m. The push takes 6 cm of arm; the load, a half on each finger, helps
    # with 1.05 cm: at the most L·(.06/1.6 − .0105/2) = 0.4, but for the fingers' own weight.
    for load, status in (
        (0.5, gf.Status.SOLVED),
        (12.0, gf.Status.SOLVED),
        (12.8, gf.Status.INFEASIBLE),
    ):
        for grasp in (seen, read):
            solution = gf.solve(grasp.problem([0, 0, load, 0, 0, 0]))
            assert solution.status is status
            assert solution.verify().ok


def test_two_motors_close_a_pair_of_coupled_jaws():
    jaws = "".join(
        f'<body name="{name}" pos="{x} 0 0"><joint name="j{name}" type="slide" axis="{way} 0 0"/>'
        '<geom type="box" size=".01 .01 .01" mass=".05" friction=".8"/></body>'
        for name, x, way in (("a", -0.0299, 1), ("b", 0.0299, -1))
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0" cone="elliptic"/><worldbody><body name="box"><freejoint/>'
        '<geom type="box" size=".02 .02 .02" mass=".1" friction=".8"/></body>' + jaws +
        '</worldbody><equality><joint joint1="ja" joint2="jb" polycoef="0 1 0 0 0"/></equality>'
        '<actuator><motor joint="ja" ctrllimited="true" ctrlrange="-2 6"/>'
        '<motor joint="jb" ctrllimited="true" ctrlrange="0 9"/></actuator></mujoco>'
    )  # fmt: skip
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    grasp = gf.Grasp.from_mujoco(model, data, "box")
    # Together 15 N, half of them on each jaw, .8 of that twice.
    for load, status in ((11.9, gf.Status.SOLVED), (12.1, gf.Status.INFEASIBLE)):
        solution = gf.solve(grasp.problem([0, 0, load, 0, 0, 0]))
        assert solution.status is status
    assert len(grasp.internal) == 1


def test_a_servo_on_a_reader_follows_moment_arms():
    model = held_box("spatial", "motor")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    reader = gf.hands.MujocoGrasp(model, data, "box")
    f = np.array([0, 0, 0.05 * 9.81, 0, 0, 0])
    servo = gf.Servo(gf.Grasp.from_mujoco(model, data, "box").problem(f))
    first = np.array(reader.internal)
    for turn in np.linspace(0, 0.02, 10):
        data.joint("jl").qpos, data.joint("jr").qpos = turn / 10, -turn / 30
        mujoco.mj_forward(model, data)
        reader.update(data)
        solution = servo.step(
            W=reader.W, J=reader.J, internal=reader.internal, tau_bias=reader.tau_bias
        )
        assert solution.status is gf.Status.SOLVED
        cold = gf.solve(gf.Grasp.from_mujoco(model, data, "box").problem(f))
        np.testing.assert_allclose(solution.motor_forces, cold.motor_forces, atol=1e-3)
    assert not np.array_equal(first, reader.internal)
