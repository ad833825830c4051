"""Errors of devices on serial lines."""

from __future__ import annotations

from tsd_twin.errors import TwinError


class HardwareError(TwinError):
    """A device is not there, is not ours, or does not answer."""


class PortError(HardwareError):
    """A serial port cannot be opened, or is gone."""
