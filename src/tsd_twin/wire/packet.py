"""Packets of both Dynamixel protocols, without their frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

BROADCAST = 254


class Instruction(IntEnum):
    """What a packet asks for."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REBOOT = 0x08
    STATUS = 0x55
    """An answer; Protocol 2.0 only."""
    SYNC_READ = 0x82
    """Protocol 2.0 only."""
    SYNC_WRITE = 0x83
    BULK_READ = 0x92


class Fault(IntEnum):
    """Why a device of Protocol 2.0 refuses, in the low seven bits of `Status.error`."""

    FAILED = 1
    INSTRUCTION = 2
    CRC = 3
    RANGE = 4
    LENGTH = 5
    LIMIT = 6
    ACCESS = 7


ALERT = 0x80
"""Bit of `Status.error` of Protocol 2.0: the device has a hardware error; no refusal."""


@dataclass(frozen=True, slots=True)
class Packet:
    """Who it is for and what it says; of an answer of Protocol 1.0, `code` is the error."""

    id: int
    code: int
    params: bytes = b""


@dataclass(frozen=True, slots=True)
class Status:
    """An answer."""

    id: int
    error: int
    """0 is none; of Protocol 2.0 a `Fault`, and `ALERT`; of Protocol 1.0 bits."""
    data: bytes = b""
