"""Machines on serial lines: the only door to pyserial."""

from tsd_twin.hardware.calibration import Calibration
from tsd_twin.hardware.errors import HardwareError, PortError
from tsd_twin.hardware.mega_robot import MegaRobot
from tsd_twin.hardware.port import ports
from tsd_twin.hardware.u2d2_robot import U2D2Robot

__all__ = ["Calibration", "HardwareError", "MegaRobot", "PortError", "U2D2Robot", "ports"]
