"""ROS 2: the robots on the bus as nodes, over rmw_zenoh's protocol or rclpy, and `cmd_vel`."""

from tsd_twin.ros.adapter import MeshServer, serve_ros
from tsd_twin.ros.dds_port import DdsPort, check_ros
from tsd_twin.ros.port import Inputs, OpenPort, RosPort
from tsd_twin.ros.zenoh_port import ZenohPort

__all__ = [
    "DdsPort",
    "Inputs",
    "MeshServer",
    "OpenPort",
    "RosPort",
    "ZenohPort",
    "check_ros",
    "serve_ros",
]
