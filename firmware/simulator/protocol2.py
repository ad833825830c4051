# SPDX-License-Identifier: GPL-3.0-or-later
"""Dynamixel Protocol 2.0, servo side; independent of `tsd_twin.hardware.dynamixel`."""

from __future__ import annotations

from functools import lru_cache

BROADCAST = 0xFE
PING, READ, WRITE, STATUS, SYNC_WRITE = 0x01, 0x02, 0x03, 0x55, 0x83
_START = b"\xff\xff\xfd\x00"
_HEADER, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"


def _row(byte: int) -> int:
    total = byte << 8
    for _ in range(8):
        total = total << 1 ^ (0x18005 if total & 0x8000 else 0)
    return total & 0xFFFF


_ROWS = [_row(byte) for byte in range(256)]


@lru_cache(maxsize=1024)  # Most packets repeat earlier ones.
def crc(data: bytes) -> bytes:
    """Return the CRC of a packet: polynomial 0x8005, most significant bit first."""
    total = 0
    for byte in data:
        total = (total << 8 & 0xFFFF) ^ _ROWS[total >> 8 ^ byte]
    return total.to_bytes(2, "little")


def packet(ident: int, instruction: int, parameters: bytes = b"") -> bytes:
    """Return a complete packet."""
    body = (bytes([instruction]) + parameters).replace(_HEADER, _STUFFED)
    data = _START + bytes([ident]) + (len(body) + 2).to_bytes(2, "little") + body
    return data + crc(data)


def parse(request: bytes) -> tuple[int, int, bytes] | None:
    """Parse a packet; return id, instruction and parameters, or None if invalid."""
    if request[:4] != _START or len(request) < 10:
        return None
    if len(request) != 7 + int.from_bytes(request[5:7], "little"):
        return None
    if crc(request[:-2]) != request[-2:]:
        return None
    body = request[7:-2].replace(_STUFFED, _HEADER)
    return request[4], body[0], body[1:]


def fields(parameters: bytes) -> tuple[int, bytes]:
    """Return the start address of a read or write, and the remaining parameters."""
    return int.from_bytes(parameters[:2], "little"), parameters[2:]


def status(servo: int, data: bytes, error: int = 0) -> bytes:
    """Return a status packet of a servo."""
    return packet(servo, STATUS, bytes([error]) + data)
