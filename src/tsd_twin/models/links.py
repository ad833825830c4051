"""Kinematic tree of a robot: groups of equal links, with joints and collision shapes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeAlias

import numpy as np

from tsd_twin.errors import RobotFileError
from tsd_twin.lie import SO3, Array
from tsd_twin.robots import RobotDescription

Link: TypeAlias = str
"""Kind of link: `chassis`, `wheel`, ...; links of the same kind share their parts."""
BASE = "base_link"
"""Root link, which has the parts of kind `chassis`."""


class JointType(StrEnum):
    """Joint between a link and its parent."""

    ANGLE = "revolute"
    """Position joint."""
    SLIDE = "prismatic"
    """Position joint that moves along its axis, in metres."""
    SPIN = "continuous"
    """Velocity joint without limits, whose angle is not measured."""
    BALL = "ball"
    """Ball joint; its orientation is the pose of the robot."""


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Limits of a joint: rad, rad/s, N m."""

    angle_rad: float
    """Limit in both directions."""
    speed_rad_per_s: float
    torque_nm: float


@dataclass(frozen=True, slots=True)
class Sphere:
    """Collision sphere about the origin of its link."""

    radius_m: float


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Collision cylinder about Y of its link."""

    radius_m: float
    length_m: float


CollisionShape: TypeAlias = Sphere | Cylinder | None
"""Collision shape of a link, if any."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkGroup:
    """Group of k equal links: the same parts on the same type of joint."""

    kind: Link
    """Kind of link that determines the parts."""
    names: tuple[str, ...]
    """Names of the k links."""
    joints: tuple[str, ...]
    """Names of the k joints, as in the kinematics."""
    parent: Link
    """Kind of the parents: the chassis, or k links in the same order."""
    at_m: Array
    """(k, 3): link positions in the parent frame."""
    turn: SO3
    """(k, 4): p_parent = R p_link + at, at joint zero."""
    joint_type: JointType
    axes: Array
    """(k, 3): unit joint axes in the link frames."""
    range: JointLimits | None = None
    collision: CollisionShape = None

    @property
    def count(self) -> int:
        """Number of links in the group."""
        return len(self.names)


@dataclass(frozen=True, slots=True, eq=False)
class KinematicTree:
    """All links of a robot, parents first."""

    height_m: float
    """Height of the origin of `base_link` above the floor."""
    link_groups: tuple[LinkGroup, ...]
    core_m: float
    """Radius of the chassis' collision shape: an upright cylinder about the origin, extending as
    far up as the chassis does down; 0 disables collision."""

    @property
    def kinds(self) -> tuple[Link, ...]:
        """All kinds of links, the chassis first."""
        return ("chassis", *(group.kind for group in self.link_groups))

    def link_group(self, kind: Link) -> LinkGroup:
        """Return the group of a kind other than the chassis."""
        return next(group for group in self.link_groups if group.kind == kind)


def alike(axis: tuple[float, float, float], k: int) -> Array:
    """Return the same axis for k joints, (k, 3)."""
    return np.tile(np.array(axis), (k, 1))


def about_z(angles_rad: Array) -> SO3:
    """Return rotations (k, 4) about Z by `angles_rad` (k,)."""
    return SO3.exp(angles_rad[:, None] * np.array([0.0, 0.0, 1.0]))


def from_axes(x: Array, y: Array, z: Array) -> SO3:
    """Return rotations (k, 4) whose frames have unit axes `x`, `y`, `z` (k, 3), right-handed."""
    from scipy.spatial.transform import Rotation  # Takes 0.25 s, as trimesh in `solids`.

    matrices: Any = Rotation.from_matrix(np.stack([x, y, z], axis=-1))
    return SO3(np.asarray(matrices.as_quat(scalar_first=True), np.float64))


def three_numbers(
    text: str | None, default: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[float, float, float]:
    """Return the numbers of an attribute of a URDF; None gives the default.

    Raises:
        ValueError: If these are not three finite numbers.
    """
    if text is None:
        return default
    x, y, z = (float(part) for part in text.split())
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError("a number is not finite")
    return x, y, z


def from_roll_pitch_yaw(rpy_rad: Array) -> SO3:
    """Return the rotation about fixed X, then Y, then Z by the angles (3,) of a URDF."""
    x, y, z = (SO3.exp(angle * axis) for angle, axis in zip(rpy_rad, np.eye(3), strict=True))
    return z @ y @ x


def roll_pitch_yaw(turn: Array | tuple[float, ...]) -> tuple[float, float, float]:
    """Return the angles about fixed X, Y, Z, in this order, for a rotation (4,), radians."""
    w, x, y, z = (float(q) for q in turn)
    sine = max(-1.0, min(1.0, 2.0 * (w * y - x * z)))
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(sine),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def chassis_mass_kg(
    robot: RobotDescription, total_kg: float, others_kg: float, others: str, needed: str
) -> float:
    """Return the mass of the chassis: the total minus the other links.

    Raises:
        RobotFileError: If nothing remains; the text names the `others`, and the keys `needed`.
    """
    if others_kg >= total_kg:
        raise RobotFileError(
            robot.name,
            f"mass.total_kg is {total_kg:g}, the {others} alone weigh {others_kg:g}",
            f"more than {needed}",
        )
    return total_kg - others_kg
