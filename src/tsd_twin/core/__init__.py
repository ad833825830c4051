"""The robot core."""

from tsd_twin.core.core import RobotCore

__all__ = ["RobotCore"]
