"""Drivers for real robots on serial ports; the only package that imports pyserial."""

from __future__ import annotations

from tsd_twin.hardware.joints import ServoCalibration
from tsd_twin.hardware.mega import MegaHardware
from tsd_twin.hardware.receiver_setup import set_up_receiver
from tsd_twin.hardware.serial_transport import HardwareError, PortError, serial_ports
from tsd_twin.hardware.u2d2 import U2D2Hardware

__all__ = [
    "HardwareError",
    "MegaHardware",
    "PortError",
    "ServoCalibration",
    "U2D2Hardware",
    "serial_ports",
    "set_up_receiver",
]
