"""Robots of the bus as ROS 2 robots: table of topics, conversions, and `cmd_vel` as an operator.

Every adapter (Foxglove, ROS 2) uses the same table and the same operator. `mapping`, `frames` and
`cmd_vel` are pure: messages and time go in, messages and actions come out. `driver` carries the
actions out with the client library.
"""

from tsd_twin.interop.cmd_vel import CmdVel, CmdVelOperator, decode_cmd_vel
from tsd_twin.interop.driver import RobotDriver
from tsd_twin.interop.mapping import (
    CMD_VEL,
    PUBLISHED,
    SERVICES,
    RobotMapping,
    RosMessage,
    RosNames,
    RosTopic,
    namespaces,
)

__all__ = [
    "CMD_VEL",
    "PUBLISHED",
    "SERVICES",
    "CmdVel",
    "CmdVelOperator",
    "RobotDriver",
    "RobotMapping",
    "RosMessage",
    "RosNames",
    "RosTopic",
    "decode_cmd_vel",
    "namespaces",
]
