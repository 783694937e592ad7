"""Hands of the kinds that people own, built of primitives from published dimensions.

Each is like the hand that its name says in what matters to a force loop: how many joints and of
which lengths, which motors move them (torque motors, position and velocity servos, muscles,
tendons, mimic joints, closed linkages), what the limits are, and the shape of what touches. None is
a copy of a file, and none has its maker's masses or looks.

Every model has an object of 0.2 kg called "object", and a keyframe with the hand open around it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from graspforce.errors import InvalidInputError
from graspforce.sim.mujoco_import import mj

MASS = 0.2  # of every object [kg]


class _Scene(NamedTuple):
    """A hand as MJCF, and how it stands open."""

    bodies: str
    actuators: str
    object: str
    """The object's geom; its body is where the site "grip" is."""
    pose: Mapping[str, float]
    """Joint positions that are not 0."""
    more: str = ""
    """Tendons and equalities."""
    view: tuple[float, float, float] = (0.45, -0.45, 0.25)
    """From where it is looked at, seen from the object [m]."""


def hand_model(name: str) -> Any:
    """Return a compiled model of a hand by name, ``sim.HANDS``.

    Raises:
        InvalidInputError: there is no hand of that name.
    """
    if name not in _HANDS:
        raise InvalidInputError(f"name: got {name!r}, expected one of {', '.join(HANDS)}")
    scene = _HANDS[name]()
    model = mj.MjModel.from_xml_string(_mjcf(name, scene, None, ""))
    data = mj.MjData(model)
    for joint, value in scene.pose.items():
        data.joint(joint).qpos = value
    mj.mj_kinematics(model, data)
    grip = data.site("grip")
    data.joint("object").qpos[:3] = grip.xpos
    mj.mju_mat2Quat(data.joint("object").qpos[3:], grip.xmat)
    place = grip.xpos.tolist()
    return mj.MjModel.from_xml_string(
        _mjcf(name, scene, place, " ".join(f"{each:.17g}" for each in data.qpos))
    )


def _mjcf(name: str, scene: _Scene, place: Sequence[float] | None, qpos: str) -> str:
    camera = ""
    if place is not None:
        eye = [a + b for a, b in zip(place, scene.view, strict=True)]
        x, y, _ = scene.view
        right = f"{-y} {x} 0"
        up = f"{-x * scene.view[2]} {-y * scene.view[2]} {x * x + y * y}"
        camera = f'<camera name="view" pos="{_join(eye)}" xyaxes="{right} {up}" fovy="24"/>'
    key = f'<keyframe><key name="open" qpos="{qpos}"/></keyframe>' if qpos else ""
    return f"""<mujoco model="{name}"><compiler angle="radian" autolimits="true"/>
      <option timestep=".001" integrator="implicitfast" cone="elliptic" impratio="100"
        noslip_iterations="3" jacobian="dense"/>
      <visual><headlight ambient=".45 .45 .45" diffuse=".5 .5 .5" specular=".1 .1 .1"/></visual>
      <asset><texture type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="64"
        height="64"/></asset>
      <default>
        <geom condim="4" friction=".8 .01 .0001" solref=".002 1" solimp=".95 .99 .001" contype="1"
          conaffinity="2" rgba=".62 .66 .7 1"/>
        <joint damping=".01" armature=".0005"/>
        <default class="bone"><geom contype="0" conaffinity="0"/></default>
        <default class="tip"><geom rgba=".13 .15 .18 1"/></default>
        <default class="object"><geom contype="2" conaffinity="1" rgba=".87 .68 .42 1"/></default>
        <default class="arm"><joint damping="1" armature=".1"/></default>
      </default>
      <worldbody>{scene.bodies}{camera}
        <body name="object"><freejoint name="object"/>
          <geom class="object" mass="{MASS}" {scene.object}/></body></worldbody>
      {scene.more}<actuator>{scene.actuators}</actuator>{key}</mujoco>"""


def _join(numbers: Sequence[float]) -> str:
    return " ".join(f"{each:.6g}" for each in numbers)


class _Joint(NamedTuple):
    """A joint of a finger, and the link that follows it along z."""

    name: str
    axis: str
    link: float
    """[m]"""
    range: str = "-1.6 1.9"
    more: str = ""


def _finger(
    name: str, place: str, joints: Sequence[_Joint], tip: str, radius: float = 0.007
) -> str:
    """Return a finger: at zero it stretches along z of where it stands."""
    inside = f'<geom class="tip" name="{name}_tip" {tip} mass=".01"/>'
    for i, joint in reversed(list(enumerate(joints))):
        bone = f'<geom class="bone" size="{radius}" mass=".02"/>'
        if joint.link:
            bone = (
                f'<geom class="bone" type="capsule" size="{radius}" mass=".03" '
                f'fromto="0 0 0 0 0 {joint.link}"/>'
            )
        at = f"0 0 {joints[i - 1].link}" if i else "0 0 0"
        inside = (
            f'<body name="{name}_{i + 1}" pos="{at}"><joint name="{joint.name}" '
            f'axis="{joint.axis}" range="{joint.range}" {joint.more}/>{bone}{inside}</body>'
        )
    return f'<body name="{name}_base" {place}>{inside}</body>'


def _arm(hand: str, grip: str) -> tuple[str, str, dict[str, float]]:
    """Return an arm with six joints, of a UR5's lengths and torques, that carries a hand downwards.

    Its motors are position servos, as it comes.

    Args:
        hand: bodies of the hand.
        grip: where the object is in it.

    Returns:
        Bodies, actuators and the arm's pose.
    """
    joints = (
        ("pan", "0 0 1", 0.089, 150), ("lift", "0 1 0", 0.425, 150),
        ("elbow", "0 1 0", 0.392, 150), ("wrist1", "0 1 0", 0.109, 28),
        ("wrist2", "1 0 0", 0.095, 28), ("wrist3", "0 0 1", 0.082, 28),
    )  # fmt: skip
    inside = f'<body name="mount" pos="0 0 .13">{hand}<site name="grip" pos="{grip}"/></body>'
    actuators = ""
    for i, (name, axis, link, most) in reversed(list(enumerate(joints))):
        at = joints[i - 1][2] if i else 0.0
        inside = f"""<body name="{name}" pos="0 0 {at}"><joint name="{name}" class="arm"
          axis="{axis}"/><geom class="bone" type="capsule" size=".04" mass="{2 if i < 3 else 0.8}"
          fromto="0 0 0 0 0 {link}"/>{inside}</body>"""
        actuators = (
            f'<position name="{name}" joint="{name}" kp="2000" kv="100" ctrlrange="-6.28 6.28" '
            f'forcerange="-{most} {most}"/>{actuators}'
        )
    # The wrist's angle makes the tool look down.
    return inside, actuators, {"lift": 0.6, "elbow": 1.2, "wrist1": 1.3415926535897931}


def _row_of_fingers(
    names: Sequence[str], joints: Callable[[str], list[_Joint]], thumb: str, tip: str, apart: float
) -> str:
    """Return fingers that curl over an object, side by side, and a thumb below it."""
    width = apart * (len(names) - 1)
    fingers = "".join(
        _finger(name, f'pos="0 {width / 2 - apart * i:.4f} .04"', joints(name), tip)
        for i, name in enumerate(names)
    )
    return f"""<body name="palm"><geom class="bone" type="box" size=".012 {width / 2 + 0.012} .045"
      pos="-.015 0 -.005" mass=".3"/>{fingers}{thumb}</body>"""


def _allegro() -> _Scene:
    """Four fingers of four joints with torque motors, balls as tips."""

    def joints(name: str) -> list[_Joint]:
        return [
            _Joint(f"{name}_0", "0 0 1", 0.0, "-.47 .47"), _Joint(f"{name}_1", "0 1 0", 0.054),
            _Joint(f"{name}_2", "0 1 0", 0.0384), _Joint(f"{name}_3", "0 1 0", 0.0437),
        ]  # fmt: skip

    ball = 'type="sphere" size=".012" pos="0 0 .0437"'
    # Its z is forward; it bends upwards.
    thumb = _finger(
        "thumb", 'pos="-.02 0 -.055" euler="0 1.5708 0"',
        [_Joint("thumb_0", "0 0 1", 0.0), _Joint("thumb_1", "1 0 0", 0.0, "-.6 .6"),
         _Joint("thumb_2", "0 -1 0", 0.0554), _Joint("thumb_3", "0 -1 0", 0.0514)],
        'type="sphere" size=".012" pos="0 0 .0514"',
    )  # fmt: skip
    names = ("index", "middle", "ring")
    pose = {f"{name}_{i}": q for name in names for i, q in ((1, 0.35), (2, 1.0), (3, 0.95))}
    actuators = "".join(
        f'<motor name="{name}_{i}" joint="{name}_{i}" ctrlrange="-.7 .7"/>'
        for name in (*names, "thumb") for i in range(4)
    )  # fmt: skip
    hand = _row_of_fingers(names, joints, thumb, ball, 0.0435)
    bodies, servos, stance = _arm(hand, ".083 0 .01")
    return _Scene(
        bodies, servos + actuators, 'type="box" size=".024 .05 .0225"',
        stance | pose | {"thumb_2": -0.1, "thumb_3": 0.7},
    )  # fmt: skip


def _leap() -> _Scene:
    """Four fingers of four joints with position servos, boxes as tips."""

    def joints(name: str) -> list[_Joint]:
        return [
            _Joint(f"{name}_mcp", "0 1 0", 0.0), _Joint(f"{name}_rot", "1 0 0", 0.0384, "-1 1"),
            _Joint(f"{name}_pip", "0 1 0", 0.036), _Joint(f"{name}_dip", "0 1 0", 0.04),
        ]  # fmt: skip

    box = 'type="box" size=".008 .009 .012" pos="0 0 .04"'
    thumb = _finger(
        "thumb", 'pos="-.02 0 -.055" euler="0 1.5708 0"',
        [_Joint("thumb_cmc", "0 0 1", 0.0), _Joint("thumb_axl", "1 0 0", 0.0, "-.6 .6"),
         _Joint("thumb_mcp", "0 -1 0", 0.053), _Joint("thumb_ipl", "0 -1 0", 0.045)],
        'type="box" size=".008 .009 .012" pos="0 0 .045"',
    )  # fmt: skip
    names = ("index", "middle", "ring")
    pose = {f"{n}_{j}": q for n in names for j, q in (("mcp", 0.3), ("pip", 1.0), ("dip", 1.2))}
    every = [f"{n}_{j}" for n in names for j in ("mcp", "rot", "pip", "dip")]
    every += ["thumb_cmc", "thumb_axl", "thumb_mcp", "thumb_ipl"]
    actuators = "".join(
        f'<position name="{each}" joint="{each}" kp="3" kv=".03" ctrlrange="-2 2.2" '
        'forcerange="-.95 .95"/>'
        for each in every
    )
    hand = _row_of_fingers(names, joints, thumb, box, 0.0454)
    bodies, servos, stance = _arm(hand, ".066 0 .008")
    return _Scene(
        bodies, servos + actuators, 'type="box" size=".02 .055 .0225"',
        stance | pose | {"thumb_mcp": -0.1, "thumb_ipl": 0.8},
    )  # fmt: skip


def _shadow() -> _Scene:
    """Fingers with a tendon over their last two joints, a wrist, capsules as tips.

    The tendon turns both joints with one torque, so that what presses on the tip has to be about
    along the link between them: the fingers stand so. Weak springs keep the two apart.
    """

    def joints(name: str) -> list[_Joint]:
        return [
            _Joint(f"{name}J4", "1 0 0", 0.0, "-.35 .35"), _Joint(f"{name}J3", "0 1 0", 0.045),
            _Joint(f"{name}J2", "0 1 0", 0.025, more='stiffness=".2" springref="1.2"'),
            _Joint(f"{name}J1", "0 1 0", 0.026, more='stiffness=".2" springref=".5"'),
        ]  # fmt: skip

    pad = 'type="capsule" size=".008" fromto="0 0 .018 0 0 .026"'
    thumb = _finger(
        "TH", 'pos="-.03 0 -.095" euler="0 1.5708 0"',
        [_Joint("THJ5", "0 0 1", 0.0, "-1 1"), _Joint("THJ4", "1 0 0", 0.038, "-.6 .6"),
         _Joint("THJ2", "0 -1 0", 0.032), _Joint("THJ1", "0 -1 0", 0.0275)],
        'type="capsule" size=".009" fromto="0 0 .018 0 0 .0275"',
    )  # fmt: skip
    names = ("FF", "MF", "RF", "LF")
    pose = {f"{n}{j}": q for n in names for j, q in (("J3", 1.5), ("J2", 1.2), ("J1", 0.5))}
    hand = _row_of_fingers(names, joints, thumb, pad, 0.022)
    servo = 'kp="5" kv=".05" ctrlrange="-1.6 3.2"'
    wrist = (
        '<position name="WRJ1" joint="WRJ1" kp="20" kv=".5" ctrlrange="-1 1" forcerange="-10 10"/>'
    )
    actuators = wrist + "".join(
        f"""<position name="{n}J4" joint="{n}J4" {servo} forcerange="-1 1"/>
        <position name="{n}J3" joint="{n}J3" {servo} forcerange="-1 1"/>
        <position name="{n}J0" tendon="{n}J0" {servo} forcerange="-1 1"/>"""
        for n in names
    )
    actuators += "".join(
        f'<position name="{j}" joint="{j}" {servo} forcerange="-1.5 1.5"/>'
        for j in ("THJ5", "THJ4", "THJ2", "THJ1")
    )
    tendons = "".join(
        f'<fixed name="{n}J0"><joint joint="{n}J2" coef="1"/>'
        f'<joint joint="{n}J1" coef="1"/></fixed>'
        for n in names
    )
    forearm = f"""<body name="forearm"><joint name="WRJ1" axis="0 1 0" range="-.6 .6"
      armature=".3" damping=".5"/><body pos="0 0 .1">{hand}</body></body>"""
    bodies, servos, stance = _arm(forearm, ".048 0 .058")
    return _Scene(
        bodies, servos + actuators, 'type="box" size=".018 .045 .018"',
        stance | pose | {"THJ2": -0.1, "THJ1": 0.8}, f"<tendon>{tendons}</tendon>",
    )  # fmt: skip


def _two_finger_linkage() -> _Scene:
    """A gripper of two four-bar linkages with one motor between them, on an arm."""

    def side(name: str, s: int) -> str:
        return f"""
          <body name="{name}_crank" pos="0 {0.0306 * s} .055"><joint name="{name}_crank"
            axis="{s} 0 0" range="-.9 .9"/><geom class="bone" type="capsule" size=".005" mass=".02"
            fromto="0 0 0 0 0 .055"/>
            <body name="{name}_pad" pos="0 0 .055"><joint name="{name}_pad" axis="{s} 0 0"/>
              <geom class="bone" type="capsule" size=".005" mass=".02"
                fromto="0 0 0 0 {-0.018 * s} 0"/>
              <geom class="tip" name="{name}_face" type="box" size=".011 .004 .019" mass=".02"
                pos="0 {-0.004 * s} .03"/></body></body>
          <body name="{name}_rod" pos="0 {0.0126 * s} .055"><joint name="{name}_rod"
            axis="{s} 0 0"/><geom class="bone" type="capsule" size=".004" mass=".02"
            fromto="0 0 0 0 0 .055"/></body>"""

    hand = f"""<body name="gripper"><geom class="bone" type="cylinder"
      size=".037 .04" mass=".6"/>{side("left", 1)}{side("right", -1)}</body>"""
    bodies, actuators, pose = _arm(hand, "0 0 .14")
    actuators += """<general name="fingers" tendon="split" biastype="affine" gainprm="20"
      biasprm="0 -20 -.5" ctrlrange="-.9 .9" forcerange="-8 8"/>"""
    more = """<tendon><fixed name="split"><joint joint="left_crank" coef=".5"/>
        <joint joint="right_crank" coef=".5"/></fixed></tendon>
      <equality><joint joint1="right_crank" joint2="left_crank" solref=".002 1"/>
        <connect body1="left_pad" body2="left_rod" anchor="0 -.018 0" solref=".002 1"/>
        <connect body1="right_pad" body2="right_rod" anchor="0 .018 0" solref=".002 1"/></equality>
      """
    return _Scene(bodies, actuators, 'type="box" size=".015 .016 .03"', pose, more)


def _panda() -> _Scene:
    """Parallel jaws that move together, on an arm with seven joints."""
    jaws = "".join(
        f"""<body name="{name}_jaw" pos="0 0 .0584"><joint name="{name}_jaw" type="slide"
          axis="0 {s} 0" range="0 .04" damping="10" armature=".1"/>
          <geom class="bone" type="box" size=".01 .007 .02" pos="0 {0.0145 * s} .02" mass=".02"/>
          <geom class="tip" name="{name}_face" type="box" size=".0088 .004 .0085"
            pos="0 {0.004 * s} .0445" mass=".015"/></body>"""
        for name, s in (("left", 1), ("right", -1))
    )
    inside = f"""<body name="hand" pos="0 0 .107" euler="0 0 -.785398"><geom class="bone" type="box"
      size=".03 .1 .03" pos="0 0 .03" mass=".7"/>{jaws}<site name="grip" pos="0 0 .1029"/></body>"""
    joints = (
        ("0 0 .333", "0 0 0", "0 0 1", 87, 3.0), ("0 0 0", "0 0 0", "0 1 0", 87, 3.0),
        ("0 0 .316", "0 0 0", "0 0 1", 87, 3.0), (".0825 0 0", "0 0 0", "0 -1 0", 87, 2.5),
        ("-.0825 0 .384", "0 0 0", "0 0 1", 12, 2.5), ("0 0 0", "0 0 0", "0 -1 0", 12, 1.5),
        (".088 0 0", "3.14159265 0 0", "0 0 1", 12, 0.7),
    )  # fmt: skip
    ends = ("0 0 -.15", "0 0 .15", ".04 0 .05", "-.04 0 .05", "0 0 -.15", ".044 0 0", "0 0 .06")
    actuators = ""
    for i, (at, turn, axis, most, mass) in reversed(list(enumerate(joints, 1))):
        inside = f"""<body name="link{i}" pos="{at}" euler="{turn}"><joint name="joint{i}"
          class="arm" axis="{axis}"/><geom class="bone" type="capsule" size=".05"
          fromto="0 0 0 {ends[i - 1]}" mass="{mass}"/>{inside}</body>"""
        actuators = f"""<general name="actuator{i}" joint="joint{i}" biastype="affine"
          gainprm="3000" biasprm="0 -3000 -200" ctrlrange="-3 3.8" forcerange="-{most} {most}"/>
          {actuators}"""
    actuators += """<general name="actuator8" tendon="split" biastype="affine" gainprm="2"
      biasprm="0 -1000 -100" ctrlrange="0 255" forcerange="-100 100"/>"""
    pose = {"joint2": -0.785, "joint4": -2.356, "joint6": 1.571, "joint7": 0.785}
    return _Scene(
        inside, actuators, 'type="box" size=".02 .02 .03"',
        pose | {"left_jaw": 0.03, "right_jaw": 0.03},
        """<tendon><fixed name="split"><joint joint="left_jaw" coef=".5"/>
          <joint joint="right_jaw" coef=".5"/></fixed></tendon>
        <equality><joint joint1="left_jaw" joint2="right_jaw" solref=".002 1"/></equality>""",
    )  # fmt: skip


def _inspire() -> _Scene:
    """Fingers with one motor for two joints, the second following the first, on an arm."""

    def joints(name: str) -> list[_Joint]:
        return [
            _Joint(f"{name}_proximal", "0 1 0", 0.032, "0 1.7"),
            _Joint(f"{name}_distal", "0 1 0", 0.045, "0 1.8"),
        ]

    names = ("index", "middle", "ring", "little")
    pad = 'type="box" size=".006 .007 .012" pos="0 0 .04"'
    thumb = _finger(
        "thumb", 'pos="0 0 -.04" euler="0 1.5708 0"',
        [_Joint("thumb_yaw", "0 0 1", 0.02, "-.6 .6"),
         _Joint("thumb_pitch", "0 -1 0", 0.05, "-.6 1"),
         _Joint("thumb_distal", "0 -1 0", 0.035, "-.6 1.2")],
        'type="box" size=".007 .008 .012" pos="0 0 .03"',
    )  # fmt: skip
    hand = _row_of_fingers(names, joints, thumb, pad, 0.02)
    bodies, actuators, pose = _arm(hand, ".066 0 .006")
    driven = [f"{name}_proximal" for name in names] + ["thumb_yaw", "thumb_pitch"]
    actuators += "".join(
        f'<position name="{each}" joint="{each}" kp="8" kv=".1" ctrlrange="-2 2.5" '
        'forcerange="-1.5 1.5"/>'
        for each in driven
    )
    mimics = "".join(
        f'<joint joint1="{name}_distal" joint2="{name}_proximal" polycoef="0 1.06 0 0 0" '
        'solref=".002 1"/>'
        for name in names
    )
    mimics += (
        '<joint joint1="thumb_distal" joint2="thumb_pitch" polycoef="0 .8 0 0 0" solref=".002 1"/>'
    )
    pose |= {f"{name}_proximal": 0.75 for name in names}
    pose |= {f"{name}_distal": 0.75 * 1.06 for name in names}
    return _Scene(
        bodies, actuators, 'type="box" size=".03 .05 .02"', pose, f"<equality>{mimics}</equality>"
    )


def _two_hands() -> _Scene:
    """Two flat hands, each on a gantry with three slides and a wrist, on one box."""
    bodies = actuators = ""
    for name, s in (("left", 1), ("right", -1)):
        slides = "".join(
            f'<joint name="{name}_{axis}" type="slide" axis="{vector}" damping="5" armature=".5"/>'
            for axis, vector in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
        )
        wrist = "".join(
            f'<joint name="{name}_{axis}" axis="{vector}" damping=".05" armature=".01"/>'
            for axis, vector in (("roll", "1 0 0"), ("pitch", "0 1 0"), ("yaw", "0 0 1"))
        )
        bodies += f"""<body name="{name}_carriage" pos="0 {0.12 * s} .2">{slides}<geom class="bone"
          type="box" size=".03 .03 .03" mass="1"/><body name="{name}_hand" pos="0 {-0.03 * s} 0">
          {wrist}<geom class="tip" name="{name}_face" type="box" size=".03 .01 .04"
            pos="0 {-0.01 * s} 0" mass=".3"/></body></body>"""
        actuators += "".join(
            f'<velocity name="{name}_{axis}" joint="{name}_{axis}" kv="200" ctrlrange="-2 2" '
            'forcerange="-60 60"/>'
            for axis in "xyz"
        )
        actuators += "".join(
            f'<motor name="{name}_{axis}" joint="{name}_{axis}" ctrlrange="-1 1" gear="3"/>'
            for axis in ("roll", "pitch", "yaw")
        )
    return _Scene(
        bodies + '<site name="grip" pos="0 0 .2"/>', actuators, 'type="box" size=".06 .05 .05"', {}
    )


def _palm() -> _Scene:
    """Three fingers that press a ball onto a palm, by muscles and motors, on a gantry."""

    def joints(name: str) -> list[_Joint]:
        return [
            _Joint(f"{name}_spread", "0 0 1", 0.0, "-.5 .5"),
            _Joint(f"{name}_near", "0 1 0", 0.05), _Joint(f"{name}_far", "0 1 0", 0.04),
        ]  # fmt: skip

    places = (
        ("one", -0.02, 0.03, 0.0),
        ("two", -0.02, -0.03, 0.0),
        ("three", 0.045, 0.0, 3.14159265),
    )
    fingers = "".join(
        _finger(name, f'pos="{x - 0.025} {y} 0" euler="0 0 {turn}"', joints(name),
                'type="sphere" size=".01" pos="0 0 .04"')
        for name, x, y, turn in places
    )  # fmt: skip
    slides = "".join(
        f'<joint name="{axis}" type="slide" axis="{vector}" damping="5" armature=".5"/>'
        for axis, vector in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
    )
    bodies = f"""<body name="carriage" pos="0 0 .2">{slides}<geom class="bone" type="box"
      size=".02 .02 .02" mass="1" pos="0 0 -.05"/><body name="palm"><joint name="yaw" axis="0 0 1"
      damping=".1" armature=".02"/><geom name="palm" type="box" size=".06 .05 .005" pos="0 0 -.005"
      mass=".3"/>{fingers}<site name="grip" pos="0 0 .0299"/></body></body>"""
    actuators = "".join(
        f'<motor name="{axis}" joint="{axis}" gear="20" ctrlrange="-4 4"/>' for axis in "xyz"
    )
    actuators += '<motor name="yaw" joint="yaw" ctrlrange="-5 5"/>'
    for name, *_ in places:
        actuators += f'<motor name="{name}_spread" joint="{name}_spread" ctrlrange="-.5 .5"/>'
        actuators += "".join(
            f'<cylinder name="{name}_{which}" joint="{name}_{which}" timeconst=".005" area="1" '
            'ctrlrange="-1 1"/>'
            for which in ("near", "far")
        )
    pose = {f"{name}_{j}": q for name, *_ in places for j, q in (("near", -0.1), ("far", 0.9))}
    return _Scene(bodies, actuators, 'type="sphere" size=".03"', pose)


_HANDS: dict[str, Callable[[], _Scene]] = {
    "allegro": _allegro,
    "leap": _leap,
    "shadow": _shadow,
    "two_finger_linkage": _two_finger_linkage,
    "panda": _panda,
    "inspire": _inspire,
    "two_hands": _two_hands,
    "palm": _palm,
}

HANDS: tuple[str, ...] = tuple(_HANDS)
"""The hands that :func:`hand_model` knows."""
