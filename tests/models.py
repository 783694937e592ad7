"""Robots and scenes for the import tests, as text: nobody's model files."""

from __future__ import annotations

import numpy as np

import graspforce as gf


def contacts_at(points, rng, models):
    """Contacts at the points, with rolls and normals, into what is between them, at random."""
    normals = rng.standard_normal((len(points), 3))
    outward = np.einsum("ij,ij->i", normals, points - np.mean(points, axis=0)) > 0
    normals[outward] *= -1
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return [
        gf.Contact(point, normal, model, tangent=rng.standard_normal(3))
        for point, normal, model in zip(points, normals, models, strict=True)
    ]


def paper_hand_xml(
    base_axis="radial", *, joint="", actuators=None, world="", extra="", tip="", options=""
):
    """The paper's hand in primitives, its joints in PaperHand's order and sense.

    Args:
        base_axis: which of PaperHand's two readings.
        joint: attributes of every joint.
        actuators: the content of <actuator>; default a motor of ±0.5 N·m at every joint.
        world: more bodies in the world.
        extra: more sections.
        tip: attributes of the fingertips' geoms.
        options: attributes of <option>.
    """
    radial = [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]
    across = [(0, 1, 0), (-1, 0, 0), (0, -1, 0), (1, 0, 0)]

    def text(vector):
        return " ".join(f"{each:g}" for each in vector)

    fingers = ""
    for i, (r, a) in enumerate(zip(radial, across, strict=True), 1):
        first, bend = ((0, 0, 1) if base_axis == "palm_normal" else r), a
        fingers += f"""
      <body name="f{i}_base" pos="{text([0.05 * each for each in r])}">
        <joint name="finger{i}_base" axis="{text(first)}" {joint}/>
        <inertial pos="0 0 0" mass=".001" diaginertia="1e-6 1e-6 1e-6"/>
        <body name="f{i}_proximal">
          <joint name="finger{i}_pitch" axis="{text(bend)}" {joint}/>
          <geom type="capsule" size=".003" fromto="0 0 0 0 0 .075" mass=".02" contype="0"
            conaffinity="0"/>
          <body name="f{i}_distal" pos="0 0 .075">
            <joint name="finger{i}_knee" axis="{text(bend)}" {joint}/>
            <geom type="capsule" size=".003" fromto="0 0 0 0 0 .07" mass=".02" contype="0"
              conaffinity="0"/>
            <geom name="f{i}_pad" type="sphere" size=".004" pos="0 0 .075" mass=".002" {tip}/>
            <site name="tip{i}" pos="0 0 .075"/>
          </body>
        </body>
      </body>"""
    if actuators is None:
        actuators = "".join(
            f'<motor name="finger{i}_{each}_motor" joint="finger{i}_{each}" ctrllimited="true"'
            f' ctrlrange="-.5 .5"/>'
            for i in (1, 2, 3, 4)
            for each in ("base", "pitch", "knee")
        )
    return f"""
<mujoco model="paper hand">
  <compiler angle="radian" autolimits="true"/>
  <option {options}/>
  <worldbody>
    <body name="palm">
      <geom name="palm" type="box" size=".05 .05 .005" pos="0 0 -.005" mass=".3"/>{fingers}
    </body>
    {world}
  </worldbody>
  <actuator>{actuators}</actuator>
  {extra}
</mujoco>"""


TIPS = ("tip1", "tip2", "tip3", "tip4")


def urdf_joint(name, parent, child, *, kind="revolute", origin="0 0 0", axis="1 0 0", more=None):
    if more is None:
        more = '<limit effort=".5" velocity="1" lower="-2" upper="2"/>'
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <origin xyz="{origin}"/><axis xyz="{axis}"/>{more}</joint>"""


def _urdf_link(name):
    return f"""<link name="{name}"><inertial><origin xyz="0 0 .02"/><mass value=".03"/>
      <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def urdf_robot(links, joints):
    return f'<robot name="r">{"".join(map(_urdf_link, links))}{"".join(joints)}</robot>'


def paper_hand_urdf(base_axis):
    """The paper's hand: joints named and turning as PaperHand's."""
    links, joints = ["palm"], []
    radial = [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]
    for i, r in enumerate(radial, 1):
        r = np.array(r)
        bend = " ".join(map(str, np.cross([0, 0, 1], r)))
        first = "0 0 1" if base_axis == "palm_normal" else " ".join(map(str, r))
        links += [f"base{i}", f"proximal{i}", f"distal{i}", f"pad{i}"]
        at = " ".join(map(str, 0.05 * r))
        joints += [
            urdf_joint(f"finger{i}_base", "palm", f"base{i}", origin=at, axis=first),
            urdf_joint(f"finger{i}_pitch", f"base{i}", f"proximal{i}", axis=bend),
            urdf_joint(
                f"finger{i}_knee", f"proximal{i}", f"distal{i}", origin="0 0 .075", axis=bend
            ),
            urdf_joint(f"pad{i}_fixed", f"distal{i}", f"pad{i}", kind="fixed", origin="0 0 .075"),
        ]
    return urdf_robot(links, joints)
