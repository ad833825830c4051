"""ROS 2: the robots on the bus as nodes, over rmw_zenoh's protocol or rclpy, and `cmd_vel`; and
robots of ROS on the bus.
"""

from tsd_twin.ros.adapter import MeshServer, serve_ros
from tsd_twin.ros.dds_port import DdsPort, check_ros
from tsd_twin.ros.imported_robot import ImportedRobot, ImportLimits, describe, endpoints
from tsd_twin.ros.port import ADAPTER, Endpoints, Inputs, OpenPort, RosPort
from tsd_twin.ros.zenoh_port import ZenohPort

__all__ = [
    "ADAPTER",
    "DdsPort",
    "Endpoints",
    "ImportLimits",
    "ImportedRobot",
    "Inputs",
    "MeshServer",
    "OpenPort",
    "RosPort",
    "ZenohPort",
    "check_ros",
    "describe",
    "endpoints",
    "serve_ros",
]
