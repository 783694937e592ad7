"""The hand of the paper's simulations (Section IV, Fig. 3).

Four fingers stand on the mid-sides of a square palm in the plane z = 0, centred at the origin:
finger 1 at +x, then +y, −x, −y. Each has two links, a base joint with two axes and a knee with
one. The paper lets the base joint "rotate about the axis normal to the hand and control the
angle of the finger relative to the palm", which can be read in two ways:

* ``palm_normal``: the first axis is the palm's normal z, the second pitches the finger away from
  it. With this reading the results of Section IV come out. Where a fingertip passes close to
  above its base the first joint has to turn fast for small motions.
* ``radial``: the first axis points from the palm's centre through the base (abduction), the
  second flexes. Well conditioned wherever the fingertips are above the palm.

Either way a finger is a two-link arm in a plane that the first joint turns. With ``up`` and
``out`` the plane's axes, link 1 points along cos(q2) up + sin(q2) out and link 2 likewise with
q2 + q3; at q = 0 the finger stands straight up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from graspforce._util.arrays import Array, as_array, as_positive, require_choice
from graspforce.contact import Contact, as_contacts
from graspforce.errors import InvalidInputError

BaseAxis: TypeAlias = Literal["palm_normal", "radial"]
Elbow: TypeAlias = Literal["outward", "inward"]

# A contact farther than this from its fingertip [m] is another finger's, or q is another pose's.
# Room for a fingertip of finite size to roll on the object, but not for a mix-up.
TIP_SIZE = 0.02

_NORMAL = np.array([0.0, 0.0, 1.0])
_RADIAL = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
_ACROSS = np.cross(_NORMAL, _RADIAL)


class _Pose(NamedTuple):
    """Where the joints and links of all fingers are; each shape (4, 3), world axes."""

    base: Array
    knee: Array
    tip: Array
    first_axis: Array  # of the base joint's first rotation
    bend_axis: Array  # of its second rotation and of the knee


@dataclass(frozen=True, slots=True)
class PaperHand:
    """Four three-joint fingers on a square palm; 12 joints, finger-major [base, pitch, knee].

    Args:
        base_axis: the base joint's first axis, "palm_normal" or "radial"; see the module.
        elbow: the branch of the inverse kinematics, one for all or one a finger. "outward" bends
            the knee towards ``out``. For "radial" that is away from the palm's centre; for
            "palm_normal" it is away from the base's normal, to the side where the fingertip is.
        link: length of each link [m].
        half_width: distance of the bases from the palm's centre [m].
        tau_max: torque limit of every joint, both ways [N·m].

    Raises:
        InvalidInputError: an unknown base_axis or elbow, or a number that is not positive.
    """

    base_axis: BaseAxis = "palm_normal"
    elbow: Elbow | tuple[Elbow, ...] = "outward"
    link: float = 0.075
    half_width: float = 0.05
    tau_max: float = 0.5

    def __post_init__(self) -> None:
        require_choice(self.base_axis, "base_axis", ("palm_normal", "radial"))
        if isinstance(self.elbow, list):  # a tuple hashes
            object.__setattr__(self, "elbow", tuple(self.elbow))
        branches = self._branches
        if len(branches) != 4:
            raise InvalidInputError(
                f"elbow: got {len(branches)}, expected 'outward', 'inward' or four of these"
            )
        for branch in branches:
            require_choice(branch, "elbow", ("outward", "inward"))
        for name in ("link", "half_width"):
            object.__setattr__(self, name, as_positive(getattr(self, name), name, "m"))
        object.__setattr__(self, "tau_max", as_positive(self.tau_max, "tau_max", "N·m"))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Finger by finger: ``finger1_base``, ``finger1_pitch``, ``finger1_knee``, and so on."""
        return tuple(
            f"finger{finger}_{joint}"
            for finger in (1, 2, 3, 4)
            for joint in ("base", "pitch", "knee")
        )

    @property
    def tau_lo(self) -> Array:
        """Lower joint torque limits, shape (12,) [N·m]."""
        return np.full(12, -self.tau_max)

    @property
    def tau_hi(self) -> Array:
        """Upper joint torque limits, shape (12,) [N·m]."""
        return np.full(12, self.tau_max)

    @property
    def bases(self) -> Array:
        """The base joints' positions, shape (4, 3) [m]."""
        return self.half_width * _RADIAL

    def inverse_kinematics(self, points: ArrayLike) -> Array:
        """Return the joint angles that put the fingertips at ``points``.

        Args:
            points: wanted fingertip positions, finger i's in row i, shape (4, 3) [m].

        Returns:
            q, shape (12,) [rad]. The first joint's angle is in (−π, π]; where the fingertip is
            on the first axis any angle would do, and 0 is taken.

        Raises:
            InvalidInputError: a point out of a finger's reach.
        """
        reach = as_array(points, "points", (4, 3)) - self.bases
        distance = np.linalg.norm(reach, axis=1)
        # A straight finger's own fingertip has to be in reach after rounding.
        out_of_reach = (distance > 2 * self.link * (1 + 1e-12)) | (distance == 0)
        if out_of_reach.any():
            i = int(np.flatnonzero(out_of_reach)[0])
            raise InvalidInputError(
                f"points[{i}]: out of reach of finger {i + 1}: {distance[i]:.4g} m from its base, "
                f"expected more than 0 and at most {2 * self.link:.4g} m"
            )
        radial = np.einsum("ij,ij->i", reach, _RADIAL)
        across = np.einsum("ij,ij->i", reach, _ACROSS)
        height = reach[:, 2]
        if self.base_axis == "palm_normal":
            first, out, up = np.arctan2(across, radial), np.hypot(across, radial), height
        else:
            first, out, up = np.arctan2(-across, height), radial, np.hypot(across, height)
        bend = np.arccos(np.clip(distance**2 / (2 * self.link**2) - 1, -1.0, 1.0))
        # With equal links the line from base to tip halves the knee's bend, and a knee that
        # bends back towards `up` lies on the side of `out`.
        side = np.array([-1.0 if branch == "outward" else 1.0 for branch in self._branches])
        knee = side * bend
        pitch = np.arctan2(out, up) - knee / 2
        return np.column_stack((first, pitch, knee)).ravel()

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Return the fingertips, shape (4, 3) [m], at joint angles q, shape (12,) [rad]."""
        return self._pose(q).tip

    def joint_positions(self, q: ArrayLike) -> Array:
        """Return base, knee and tip of every finger, shape (4, 3, 3) [m]: [finger, point, xyz]."""
        pose = self._pose(q)
        return np.stack((pose.base, pose.knee, pose.tip), axis=1)

    def jacobian(self, contacts: Sequence[Contact], q: ArrayLike) -> Array:
        """Return J, shape (m, 12), in the contact frames: tau = J.T @ c (Eq. 2).

        tau are the torques with which the actuators make the fingers push on the object with c.
        Each row is the velocity, per joint rate, of that point of the last link which is at the
        contact, along the contact's normal, x and y; a soft finger's torsion row is the link's
        angular velocity about the normal.

        Args:
            contacts: four, finger i's the i-th, in the hand's frame. Each near its fingertip
                (0.02 m); the point is the contact's own, so tips may roll.
            q: joint angles, shape (12,) [rad].

        Raises:
            InvalidInputError: not four contacts, or one that is not at its fingertip.
        """
        contacts = as_contacts(contacts)
        if len(contacts) != 4:
            raise InvalidInputError(
                f"contacts: got {len(contacts)}, expected 4, the i-th made by finger i"
            )
        pose = self._pose(q)
        points = np.array([contact.point for contact in contacts])
        gaps = np.linalg.norm(points - pose.tip, axis=1)
        if (gaps > TIP_SIZE).any():
            i = int(np.flatnonzero(gaps > TIP_SIZE)[0])
            raise InvalidInputError(
                f"contacts[{i}]: {gaps[i]:.4g} m from the tip of finger {i + 1} at these joint "
                f"angles, expected at most {TIP_SIZE} m"
            )
        axes = np.stack((pose.first_axis, pose.bend_axis, pose.bend_axis), axis=1)
        origins = np.stack((pose.base, pose.base, pose.knee), axis=1)
        velocities = np.cross(axes, points[:, None] - origins)  # [finger, joint, xyz], per rate
        blocks: list[Array] = []
        for i, contact in enumerate(contacts):
            twist = np.vstack((velocities[i].T, axes[i].T))  # of the tip, for each joint's rate
            block = np.zeros((contact.model.dim, 12))
            block[:, 3 * i : 3 * i + 3] = contact.wrench_basis.T @ twist
            blocks.append(block)
        return np.vstack(blocks)

    @property
    def _branches(self) -> tuple[Elbow, ...]:
        return self.elbow if isinstance(self.elbow, tuple) else (self.elbow,) * 4

    def _pose(self, q: ArrayLike) -> _Pose:
        first, pitch, knee = as_array(q, "q", (12,)).reshape(4, 3, 1).transpose(1, 0, 2)
        if self.base_axis == "palm_normal":
            first_axis = up = np.tile(_NORMAL, (4, 1))
            out = np.cos(first) * _RADIAL + np.sin(first) * _ACROSS
        else:
            first_axis = out = _RADIAL
            up = np.cos(first) * _NORMAL - np.sin(first) * _ACROSS
        base = self.bases
        knees = base + self.link * (np.cos(pitch) * up + np.sin(pitch) * out)
        tips = knees + self.link * (np.cos(pitch + knee) * up + np.sin(pitch + knee) * out)
        return _Pose(base, knees, tips, first_axis, np.cross(up, out))
