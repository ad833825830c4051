"""Robot descriptions: classes for each kind, the loader, and the shipped TOML files."""

from __future__ import annotations

from tsd_twin.robots.description import RPM, RobotDescription, WheelSpeedRange
from tsd_twin.robots.external import ExternalDescription
from tsd_twin.robots.joint_model import (
    FloorErrors,
    JointCompliance,
    JointErrors,
    WheelSpeedResponse,
)
from tsd_twin.robots.kinds import DESCRIPTIONS, kind_names, kind_of
from tsd_twin.robots.loader import (
    description_of_kind,
    load_robot,
    parse_description,
    read_description,
    robot_names,
)
from tsd_twin.robots.omni import OmniDescription, SphereDescription
from tsd_twin.robots.singularity import SingularityDescription

__all__ = [
    "DESCRIPTIONS",
    "RPM",
    "ExternalDescription",
    "FloorErrors",
    "JointCompliance",
    "JointErrors",
    "OmniDescription",
    "RobotDescription",
    "SingularityDescription",
    "SphereDescription",
    "WheelSpeedRange",
    "WheelSpeedResponse",
    "description_of_kind",
    "kind_names",
    "kind_of",
    "load_robot",
    "parse_description",
    "read_description",
    "robot_names",
]
