"""Description of a robot that ROS drives: its limits here, and its shape from a URDF.

`tsd-ros --import` writes such a description; it has no simulation.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, field

from tsd_twin.kinematics import Joint, JointKind, TwistKinematics
from tsd_twin.robots.description import (
    Colour,
    JointErrors,
    NotNegative,
    Positive,
    Problem,
    RobotDescription,
    SpinUp,
    Table,
)

Triple: TypeAlias = tuple[float, float, float]
Sizes: TypeAlias = tuple[Positive, Positive, Positive]
JointName: TypeAlias = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_.:/ -]{1,48}\Z")]
MOST_JOINTS = 40
"""Joints whose angles are shown: their names and angles fit into one message of the bus."""
MOST_PARTS = 400
POSE_SENSORS = ("odom_x_m", "odom_y_m", "odom_heading_rad")
"""Readings that are the pose of the robot by its own odometry."""
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
"""What cannot be promised without our node on the robot."""
_LAG_S = 0.1


class ImportedPart(Table, frozen=True):
    """One of `[[drive.parts]]`."""

    shape: Literal["box", "cylinder", "sphere"]
    size_m: Sizes
    """Along X, Y and Z; a cylinder stands along Z."""
    on: str = ""
    """Joint that moves it; empty for the base."""
    at_m: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)
    colour_rgba: Colour = (0.7, 0.72, 0.75, 1.0)


class ImportedJoint(Table, frozen=True):
    """One of `[[drive.joints]]`; a joint is listed after the one that it hangs on."""

    name: JointName
    on: str = ""
    """Joint that it hangs on; empty for the base."""
    slides: bool = False
    at_m: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)
    axis: Triple = (0.0, 0.0, 1.0)


class ImportedGeometry(Table, frozen=True, tag="imported", tag_field="kind"):
    """`[drive]` of a robot that ROS drives."""

    parts: Annotated[list[ImportedPart], Meta(min_length=1, max_length=MOST_PARTS)]
    sideways: bool = False
    """Whether it follows `vy`."""
    height_m: NotNegative = 0.0
    """Height of `base_link` above the floor."""
    joints: Annotated[list[ImportedJoint], Meta(max_length=MOST_JOINTS)] = field(
        default_factory=list[ImportedJoint]
    )


class ImportedDescription(RobotDescription, frozen=True, kw_only=True):
    """A robot that ROS drives by `cmd_vel`."""

    drive: ImportedGeometry

    @property
    def sensors(self) -> tuple[Joint, ...]:
        """Pose by its own odometry, and the joints of its URDF."""
        names = (*POSE_SENSORS, *(joint.name for joint in self.drive.joints))
        return tuple(Joint(name, JointKind.POSITION) for name in names)

    @property
    def not_promised(self) -> tuple[str, ...]:
        """What our rules cannot promise, and how it is drawn."""
        return (*NOT_PROMISED, *self.assumptions)

    @property
    def driven_by_ros(self) -> bool:
        """It is."""
        return True

    @property
    def drives_sideways(self) -> bool:
        """Whether it follows `vy`."""
        return self.drive.sideways

    def kinematics(self) -> TwistKinematics:
        """Kinematics."""
        limits = self.limits
        return TwistKinematics(limits.speed_mps, limits.turn_rate_rad_per_s, self.drive.sideways)

    def joint_errors(self) -> JointErrors:
        """Return no errors: they are not known."""
        return JointErrors()

    def spin_up(self) -> SpinUp:
        """First-order model of how it follows a twist: assumed."""
        return SpinUp(0.0, _LAG_S, _LAG_S)

    def problems(self) -> Iterator[Problem]:
        """Yield joints that are there twice, hang on none, or have no axis, and lost parts."""
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
