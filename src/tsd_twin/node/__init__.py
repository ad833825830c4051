"""Robot node: the real-time loop and the hardware interface."""

from __future__ import annotations

from tsd_twin.node.robot_node import (
    PERIOD_S,
    HasBattery,
    HasServoTemperature,
    HasTruth,
    HasWatchdog,
    RobotIO,
    RobotNode,
    Truth,
)

__all__ = [
    "PERIOD_S",
    "HasBattery",
    "HasServoTemperature",
    "HasTruth",
    "HasWatchdog",
    "RobotIO",
    "RobotNode",
    "Truth",
]
