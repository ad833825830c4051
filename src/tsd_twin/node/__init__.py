"""The robot node: the loop between bus, core and joints."""

from tsd_twin.node.node import PERIOD_S, RobotNode
from tsd_twin.node.overhead_camera import OverheadCamera
from tsd_twin.node.robot_io import Guarded, RobotIO, Simulated, Truth

__all__ = ["PERIOD_S", "Guarded", "OverheadCamera", "RobotIO", "RobotNode", "Simulated", "Truth"]
