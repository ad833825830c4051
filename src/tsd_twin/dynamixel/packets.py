"""Dynamixel packets without their framing, CRC-16, and the decoder that finds packets in a byte
stream.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Protocol


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


BROADCAST = 254


class Instruction(IntEnum):
    """Instruction codes of a packet."""

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
    """Error codes of Protocol 2.0, in the low seven bits of `Status.error`."""

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
    """Packet: device id, instruction code and parameters; in a Protocol 1.0 status, `code` is the
    error.
    """

    id: int
    code: int
    params: bytes = b""


@dataclass(frozen=True, slots=True)
class Status:
    """Status packet: the response of a device."""

    id: int
    error: int
    """0 is none; of Protocol 2.0 a `Fault`, and `ALERT`; of Protocol 1.0 bits."""
    data: bytes = b""


class Framing(Protocol):
    """Framing of one protocol version; implemented by the modules `protocol1` and `protocol2`."""

    HEADER: bytes

    def size(self, head: bytes) -> int | None:
        """Return how long the frame is that begins so; None: more is needed; 0: no frame does."""
        ...

    def decode(self, frame: bytes) -> Packet | None:
        """Packet in a whole frame; None: the sum is wrong."""
        ...

    def as_status(self, packet: Packet) -> Status | None:
        """Answer that a packet is; None: it is none."""
        ...


class Decoder:
    """Incremental decoder: finds packets in a byte stream.

    What is kept is never longer than one frame of `longest` bytes and a chunk of input. A frame
    that stays cut for `timeout_s` is given up. Of a frame that is given up, only the header is
    thrown away: what follows may be whole.
    """

    def __init__(self, framing: Framing, *, longest: int = 512, timeout_s: float = 0.02) -> None:
        self.framing = framing
        self._header = framing.HEADER
        self._longest = longest
        self._timeout_s = timeout_s
        self._kept = bytearray()
        self._heard_s = -math.inf
        self.sum_errors = 0
        """Frames with a wrong sum."""
        self.cut = 0
        """Frames that were given up because no more came."""
        self.skipped = 0
        """Bytes that belong to no frame."""

    def feed(self, data: bytes, now_s: float) -> list[Packet]:
        """Return the packets that are whole with `data`, which came at `now_s`; it may be empty."""
        packets: list[Packet] = []
        if self._kept and now_s - self._heard_s > self._timeout_s:
            # One frame at a time: what stood behind it may be whole, or cut as well.
            while self._kept:
                self._append_packets(packets)
                if self._kept:
                    self.cut += self._kept.startswith(self._header)
                    self._skip(1)
        if data:
            self._heard_s = now_s
            self._kept += data
        self._append_packets(packets)
        return packets

    def clear(self) -> None:
        """Discard buffered bytes, as after the port was opened again."""
        self._kept.clear()

    def _append_packets(self, packets: list[Packet]) -> None:
        while self._find_header():
            size = self.framing.size(bytes(self._kept[: len(self._header) + 8]))
            if size is None:
                return
            if size == 0 or size > self._longest:
                self._skip(1)
            elif len(self._kept) < size:
                return
            else:
                packet = self.framing.decode(bytes(self._kept[:size]))
                if packet is None:
                    self.sum_errors += 1
                    self._skip(1)
                else:
                    packets.append(packet)
                    del self._kept[:size]

    def _find_header(self) -> bool:
        """Discard bytes before the next header; return whether a complete header is there."""
        at = self._kept.find(self._header)
        if at < 0:
            # The end may be the beginning of one.
            at = len(self._kept) - len(self._header) + 1
            at = max(at, 0)
            while not self._header.startswith(bytes(self._kept[at:])):
                at += 1
        self._skip(at)
        return len(self._kept) >= len(self._header)

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._kept[:count]
