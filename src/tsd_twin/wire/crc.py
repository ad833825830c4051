"""The sum that ends a packet of Protocol 2.0."""

from __future__ import annotations

from functools import cache


def crc16(data: bytes) -> int:
    """Return CRC-16 with polynomial 0x8005, start 0, not reflected (also called CRC-16/UMTS)."""
    table = _table()
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ table[crc >> 8 ^ byte]
    return crc


@cache
def _table() -> tuple[int, ...]:
    table: list[int] = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = crc << 1 ^ (0x8005 if crc & 0x8000 else 0)
        table.append(crc & 0xFFFF)
    return tuple(table)
