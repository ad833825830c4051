"""Sans-I/O control loop of a robot."""

from __future__ import annotations

from tsd_twin.control.logged_controller import LoggedController
from tsd_twin.control.robot_controller import RobotController

__all__ = ["LoggedController", "RobotController"]
