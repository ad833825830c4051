"""ROS 2 bridge: robots on the bus as ROS nodes, and third-party ROS robots on the bus.

Uses the rmw_zenoh protocol or rclpy; `cmd_vel` drives the robots.
"""

from tsd_twin.adapters.ros.adapter import MeshServer, serve_ros
from tsd_twin.adapters.ros.dds_port import DdsPort, check_ros
from tsd_twin.adapters.ros.external_robot import ExternalLimits, ExternalRobot, describe, endpoints
from tsd_twin.adapters.ros.port import ADAPTER, Endpoints, OpenPort, PortCallbacks, RosPort
from tsd_twin.adapters.ros.zenoh_port import ZenohPort

__all__ = [
    "ADAPTER",
    "DdsPort",
    "Endpoints",
    "ExternalLimits",
    "ExternalRobot",
    "MeshServer",
    "OpenPort",
    "PortCallbacks",
    "RosPort",
    "ZenohPort",
    "check_ros",
    "describe",
    "endpoints",
    "serve_ros",
]
