"""Description of an external ROS robot: limits from here, shape from a URDF.

`tsd-ros --import` writes such a description; it has no simulation.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, TypeAlias

from msgspec import Meta, field

from tsd_twin.kinematics import Joint, JointKind, TwistKinematics
from tsd_twin.robots.description import RobotDescription
from tsd_twin.robots.joint_model import JointErrors, WheelSpeedResponse
from tsd_twin.tables import Colour, NotNegative, Positive, Problem, Table

Triple: TypeAlias = tuple[float, float, float]
JOINT_NAME = re.compile(r"[A-Za-z0-9_.:/ -]{1,48}")
MOST_JOINTS = 40
"""Maximum number of displayed joints; their names and angles fit into one bus message."""
MOST_PARTS = 400
POSE_SENSORS = ("odom_x_m", "odom_y_m", "odom_heading_rad")
"""Readings that form the robot's pose from its own odometry."""
RESERVED = frozenset({"vx", "vy", "omega", *POSE_SENSORS})
"""Names that a joint cannot have."""
NOT_PROMISED = (
    "The distance in which it stops: its own controller brakes, or does not. No stop envelope is "
    "drawn.",
    "That it stops when tsd-ros or its link fails: its own timeout of cmd_vel decides, if it has "
    "one.",
    "That only the operator here drives it: any ROS node can publish cmd_vel. Control and arming "
    "hold on this side only.",
    "Its pose: that is its own odometry, not an estimate of ours. There is no consistency test, "
    "and no covariance.",
)
"""Guarantees that require the project's node on the robot."""
_LAG_S = 0.1


class ExternalPart(Table, frozen=True):
    """Entry of `[[drive.parts]]`."""

    shape: Literal["box", "cylinder", "sphere"]
    size_m: tuple[Positive, Positive, Positive]
    """Along X, Y and Z; cylinder axes are along Z."""
    on: str = ""
    """Joint that moves the part; empty for the base."""
    at_m: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)
    colour_rgba: Colour = (0.7, 0.72, 0.75, 1.0)


class ExternalJoint(Table, frozen=True):
    """Entry of `[[drive.joints]]`; parent joints come first."""

    name: Annotated[str, Meta(pattern=rf"^{JOINT_NAME.pattern}\Z")]
    on: str = ""
    """Parent joint; empty for the base."""
    slides: bool = False
    at_m: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)
    axis: Triple = (0.0, 0.0, 1.0)


class ExternalGeometry(Table, frozen=True, tag="imported", tag_field="kind"):
    """`[drive]` of an external ROS robot."""

    parts: Annotated[list[ExternalPart], Meta(min_length=1, max_length=MOST_PARTS)]
    sideways: bool = False
    """Whether the robot follows `vy`."""
    height_m: NotNegative = 0.0
    """Height of `base_link` above the floor."""
    joints: Annotated[list[ExternalJoint], Meta(max_length=MOST_JOINTS)] = field(
        default_factory=list[ExternalJoint]
    )


class ExternalDescription(RobotDescription, frozen=True, kw_only=True):
    """External robot driven through ROS `cmd_vel`."""

    drive: ExternalGeometry
    driven_by_ros: ClassVar[bool] = True

    @property
    def sensors(self) -> tuple[Joint, ...]:
        """Pose from the robot's own odometry, and the joints of its URDF."""
        names = (*POSE_SENSORS, *(joint.name for joint in self.drive.joints))
        return tuple(Joint(name, JointKind.POSITION) for name in names)

    @property
    def not_promised(self) -> tuple[str, ...]:
        """Rules that do not hold, and drawing assumptions."""
        return (*NOT_PROMISED, *self.assumptions)

    @property
    def drives_sideways(self) -> bool:
        """Whether the robot follows `vy`."""
        return self.drive.sideways

    def kinematics(self) -> TwistKinematics:
        """Return the kinematics."""
        limits = self.limits
        return TwistKinematics(limits.speed_mps, limits.turn_rate_rad_per_s, self.drive.sideways)

    def joint_errors(self) -> JointErrors:
        """Return zero errors, because they are unknown."""
        return JointErrors()

    def spin_up(self) -> WheelSpeedResponse:
        """Return an assumed first-order model of the robot's response to a twist."""
        return WheelSpeedResponse(0.0, _LAG_S, _LAG_S)

    def problems(self) -> Iterator[Problem]:
        """Yield duplicate joints, unknown parents, zero axes, and parts on unknown joints."""
        known = {""}
        for i, joint in enumerate(self.drive.joints):
            path = f"drive.joints[{i}]"
            if joint.name in known or joint.name in RESERVED:
                yield f"{path}.name: '{joint.name}' is taken", "a name of its own"
            if joint.on not in known:
                yield f"{path}.on: no joint before it is called '{joint.on}'", "parents first"
            if not 0.5 < sum(part * part for part in joint.axis) < 2.0:
                yield f"{path}.axis is no direction", "a unit vector"
            known.add(joint.name)
        for i, part in enumerate(self.drive.parts):
            if part.on not in known:
                yield f"drive.parts[{i}].on: there is no joint '{part.on}'", ""
