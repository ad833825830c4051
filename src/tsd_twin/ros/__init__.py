"""ROS 2: the robots on the bus as nodes, over rmw_zenoh's protocol or rclpy, and `cmd_vel`."""

from tsd_twin.ros.adapter import serve_ros
from tsd_twin.ros.meshes import MeshServer
from tsd_twin.ros.port import Inputs, OpenPort, RosPort
from tsd_twin.ros.zenoh_port import ZenohPort

__all__ = ["Inputs", "MeshServer", "OpenPort", "RosPort", "ZenohPort", "serve_ros"]
