# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated telemetry wire of a speed controller: KISS or BLHeli_32, a packet every 30 ms."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

PERIOD_S = 0.03
_RPM = 30.0 / math.pi


def crc8(data: bytes) -> int:
    """Return the CRC of a packet, polynomial 0x07."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ (0x07 if crc & 0x80 else 0)) & 0xFF
    return crc


def packet(
    electrical_rpm: float, volts: float, *, celsius: int = 35, amps: float = 2.0, mah: int = 0
) -> bytes:
    """Return the ten bytes of a packet."""
    values = round(100.0 * volts), round(100.0 * amps), mah & 0xFFFF, int(electrical_rpm / 100.0)
    data = struct.pack(">B4H", celsius, *values)
    return data + bytes([crc8(data)])


class EscTelemetry:
    """Telemetry packets of a speed controller.

    `phase_s`: time of its first packet. `change` gets each packet, and returns the bytes to send.
    """

    def __init__(self, pole_pairs: int, phase_s: float) -> None:
        self._pole_pairs, self._due_s = pole_pairs, phase_s
        self.change: Callable[[bytes], bytes] = bytes
        self._mah = 0.0

    def due(self, now_s: float, rad_per_s: float, volts: float) -> bytes:
        """Return the bytes to send now; b"" without power, or before the next period."""
        if now_s < self._due_s:
            return b""
        self._due_s = max(self._due_s + PERIOD_S, now_s)
        if volts <= 0.0:
            return b""
        self._mah += 2000.0 * PERIOD_S / 3600.0
        rpm = self._pole_pairs * rad_per_s * _RPM
        return self.change(packet(rpm, volts, mah=int(self._mah)))
