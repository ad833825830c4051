"""Bridge between the bus and ROS 2: topic table, message conversion, and `cmd_vel` as an operator.

All adapters (Foxglove, ROS 2) share this code. `mapping`, `frames` and `cmd_vel` are pure: the
caller passes in messages and time, and performs the returned actions. `driver` performs them with
the client library.
"""

from tsd_twin.adapters.cmd_vel import CmdVel, CmdVelOperator, decode_cmd_vel
from tsd_twin.adapters.cmd_vel_bridge import CmdVelBridge
from tsd_twin.adapters.ros_messages import (
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
    "CmdVelBridge",
    "CmdVelOperator",
    "RobotMapping",
    "RosMessage",
    "RosNames",
    "RosTopic",
    "decode_cmd_vel",
    "namespaces",
]
