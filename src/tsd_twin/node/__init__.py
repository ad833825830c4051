"""Robot node: the real-time loop, the hardware interface and a simulated overhead camera."""

from __future__ import annotations

from tsd_twin.node.overhead_camera import OverheadCamera
from tsd_twin.node.robot_node import (
    PERIOD_S,
    HasBattery,
    HasTruth,
    HasWatchdog,
    RobotIO,
    RobotNode,
    Truth,
)

__all__ = [
    "PERIOD_S",
    "HasBattery",
    "HasTruth",
    "HasWatchdog",
    "OverheadCamera",
    "RobotIO",
    "RobotNode",
    "Truth",
]
