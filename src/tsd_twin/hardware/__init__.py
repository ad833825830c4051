"""Machines on serial lines: the only door to pyserial."""

from tsd_twin.hardware.calibration import Calibration
from tsd_twin.hardware.errors import HardwareError, PortError
from tsd_twin.hardware.mega_robot import MegaRobot
from tsd_twin.hardware.port import ports

__all__ = ["Calibration", "HardwareError", "MegaRobot", "PortError", "ports"]
