"""Robot node: the real-time loop of a robot."""

from __future__ import annotations

from tsd_twin.node.robot_node import PERIOD_S, RobotNode

__all__ = ["PERIOD_S", "RobotNode"]
