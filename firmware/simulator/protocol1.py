# SPDX-License-Identifier: GPL-3.0-or-later
"""Dynamixel Protocol 1.0, servo side."""

from __future__ import annotations

BROADCAST = 0xFE
PING, READ, WRITE, SYNC_WRITE = 0x01, 0x02, 0x03, 0x83


def parse(request: bytes) -> tuple[int, int, bytes] | None:
    """Parse a packet; return id, instruction and parameters, or None if invalid."""
    if request[:2] != b"\xff\xff" or len(request) < 6 or len(request) != request[3] + 4:
        return None
    if sum(request[2:]) & 0xFF != 0xFF:
        return None
    return request[2], request[4], request[5:-1]


def fields(parameters: bytes) -> tuple[int, bytes]:
    """Return the start address of a read or write, and the remaining parameters."""
    return parameters[0], parameters[1:]


def status(servo: int, data: bytes, error: int = 0) -> bytes:
    """Return a status packet of a servo."""
    body = bytes([servo, len(data) + 2, error]) + data
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])
