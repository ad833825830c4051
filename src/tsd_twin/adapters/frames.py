"""Coordinate frames for `/tf` and `/tf_static` from a robot's URDF and joints (pure)."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tsd_twin.messages.errors import MessageError
from tsd_twin.models.links import from_roll_pitch_yaw, roll_pitch_yaw, three_numbers

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""(w, x, y, z), unit length."""
IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)
FOOTPRINT = "base_footprint"
"""Root frame of every URDF."""
_MOVING = frozenset({"revolute", "continuous"})
_RINGS = ("_yaw", "_pitch", "_roll")
"""Suffixes of the joints that represent a ball joint."""
_LONGEST_STEP_S = 0.1
"""Maximum time step for integrating wheel speeds."""


@dataclass(frozen=True, slots=True)
class Transform:
    """Pose of frame `child` in frame `parent`."""

    parent: str
    child: str
    position_m: Vector
    turn: Quaternion


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """URDF joint: its frame in the parent frame, and its axis."""

    name: str
    origin: Transform
    axis: Vector | None
    """None for fixed joints."""

    def at(self, angle_rad: float) -> Transform:
        """Return the transform at an angle."""
        if self.axis is None:
            return self.origin
        half = 0.5 * angle_rad
        x, y, z = (math.sin(half) * part for part in self.axis)
        turn = product(self.origin.turn, (math.cos(half), x, y, z))
        return Transform(self.origin.parent, self.origin.child, self.origin.position_m, turn)


@dataclass(frozen=True, slots=True)
class UrdfTree:
    """All joints of a URDF."""

    joints: Mapping[str, UrdfJoint]
    ball: str | None
    """Name of the ball joint if the robot turns a sphere, with ring joints `<name>_yaw` etc."""

    @property
    def fixed(self) -> list[Transform]:
        """Constant transforms."""
        return [joint.origin for joint in self.joints.values() if joint.axis is None]

    @property
    def ball_frame(self) -> str | None:
        """Frame of the sphere, or None."""
        return None if self.ball is None else self.joints[self.ball].origin.child

    def moving(self, angles_rad: Mapping[str, float]) -> list[Transform]:
        """Return the transforms of moving joints with finite angles."""
        return [
            self.joints[name].at(angle)
            for name, angle in angles_rad.items()
            if name in self.joints and self.joints[name].axis and math.isfinite(angle)
        ]

    def ring_angles(self, turn: Quaternion) -> dict[str, float]:
        """Return the ring angles of the ball joint for an orientation of the sphere."""
        if self.ball is None:
            return {}
        return {
            self.ball + ring: angle
            for ring, angle in zip(_RINGS, reversed(roll_pitch_yaw(turn)), strict=True)
        }


def parse_urdf(text: str) -> UrdfTree:
    """Parse the joints of a URDF.

    Raises:
        MessageError: If the URDF is invalid (`shape`).
    """
    try:
        root = ET.fromstring(text)  # noqa: S314  Python's expat limits entity expansion.
        joints = [_joint(element) for element in root.iter("joint")]
    except (ET.ParseError, ValueError, KeyError, TypeError) as error:
        raise MessageError("shape", f"not a URDF: {error}") from error
    named = {joint.name: joint for joint in joints}
    balls = [name for name in named if all(name + ring in named for ring in _RINGS)]
    return UrdfTree(named, balls[0] if balls else None)


def _joint(element: ET.Element) -> UrdfJoint:
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise ValueError("a joint has no parent or no child")
    origin, axis = element.find("origin"), element.find("axis")
    at = {} if origin is None else origin.attrib
    turn = from_roll_pitch_yaw(np.array(three_numbers(at.get("rpy"))))
    w, x, y, z = turn.wxyz.tolist()
    xyz = three_numbers(at.get("xyz"))
    place = Transform(parent.attrib["link"], child.attrib["link"], xyz, (w, x, y, z))
    if element.get("type") not in _MOVING:
        return UrdfJoint(element.attrib["name"], place, None)
    about = three_numbers(None if axis is None else axis.get("xyz"), (1.0, 0.0, 0.0))
    length = math.hypot(*about)
    if not length > 0.0:
        raise ValueError("an axis has no direction")
    x, y, z = (part / length for part in about)
    return UrdfJoint(element.attrib["name"], place, (x, y, z))


class WheelAngles:
    """Joint angles; unmeasured ones are integrated from speed.

    Wheels report only speed. Their angles are for display, with an arbitrary offset.
    """

    def __init__(self) -> None:
        self._angles: dict[str, float] = {}
        self._stamp_ns: int | None = None

    def update(
        self,
        names: Sequence[str],
        position_rad: Sequence[float],
        velocity_rad_per_s: Sequence[float],
        stamp_ns: int,
    ) -> dict[str, float]:
        """Return the angle of each joint, NaN if neither angle nor speed is known."""
        step_s = 0.0 if self._stamp_ns is None else 1e-9 * (stamp_ns - self._stamp_ns)
        step_s = min(max(step_s, 0.0), _LONGEST_STEP_S)
        self._stamp_ns = stamp_ns
        angles: dict[str, float] = {}
        for name, position, velocity in zip(names, position_rad, velocity_rad_per_s, strict=True):
            if math.isfinite(position):
                angles[name] = position
            elif math.isfinite(velocity):
                before = self._angles.get(name, 0.0)
                angles[name] = math.remainder(before + velocity * step_s, math.tau)
                self._angles[name] = angles[name]
            else:
                angles[name] = math.nan
        return angles


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the product `a b` (rotation `b`, then `a`)."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )
