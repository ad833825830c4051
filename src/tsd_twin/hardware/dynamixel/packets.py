"""Dynamixel packets: framing of Protocol 1.0 and 2.0, CRC-16, and stream decoder."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache, lru_cache
from struct import pack, unpack_from
from typing import ClassVar


@lru_cache(maxsize=1024)  # Most requests repeat an earlier one.
def crc16(data: bytes) -> int:
    """Return the CRC-16 with polynomial 0x8005, start 0, not reflected (CRC-16/UMTS)."""
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
    STATUS = 0x55
    """Status packet; Protocol 2.0 only."""
    SYNC_READ = 0x82
    """Protocol 2.0 only."""
    SYNC_WRITE = 0x83


RANGE_ERROR = 4
ACCESS_ERROR = 7
"""Error of Protocol 2.0: the register is not writable in this state."""
ALERT = 0x80
"""Bit of `Status.error` in Protocol 2.0: the device has a hardware error but did not refuse."""


@dataclass(frozen=True, slots=True)
class Packet:
    """Device id, instruction code and parameters; `code` is the error in a Protocol 1.0 status."""

    id: int
    code: int
    params: bytes = b""


@dataclass(frozen=True, slots=True)
class StatusPacket:
    """Status packet: the response of a device."""

    id: int
    error: int
    """0 if no error; in Protocol 2.0 an error code and `ALERT`, in Protocol 1.0 error bits."""
    data: bytes = b""


class Framing(ABC):
    """Framing of a protocol version, for requests and responses."""

    HEADER: ClassVar[bytes]
    NUMBER: ClassVar[str]
    """`struct` format of an address or a length."""

    @abstractmethod
    def encode(self, packet: Packet) -> bytes:
        """Return the frame of a packet."""

    @abstractmethod
    def size(self, head: bytes) -> int | None:
        """Return the frame length from its first bytes; None if too few, 0 if invalid."""

    @abstractmethod
    def decode(self, frame: bytes) -> Packet | None:
        """Return the packet in a complete frame, or None if its checksum is wrong."""

    @abstractmethod
    def as_status(self, packet: Packet) -> StatusPacket | None:
        """Parse a packet as a response, or return None."""

    def ping(self, device: int) -> bytes:
        """Request a response to find a device; in Protocol 2.0 with model and firmware version."""
        return self.encode(Packet(device, Instruction.PING))

    def read(self, device: int, address: int, length: int) -> bytes:
        """Request `length` bytes of a device's table."""
        return self.encode(Packet(device, Instruction.READ, self._numbers(address, length)))

    def write(self, device: int, address: int, data: bytes) -> bytes:
        """Write to a device's table."""
        return self.encode(Packet(device, Instruction.WRITE, self._numbers(address) + data))

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> bytes:
        """Write the same part of several devices' tables, without a response."""
        (length,) = {len(part) for part in data.values()}
        params = self._numbers(address, length)
        params += b"".join(bytes([device]) + part for device, part in data.items())
        return self.encode(Packet(BROADCAST, Instruction.SYNC_WRITE, params))

    def _numbers(self, *numbers: int) -> bytes:
        return pack(f"<{len(numbers)}{self.NUMBER}", *numbers)


class Protocol1(Framing):
    """Dynamixel Protocol 1.0, the factory protocol of an MX-64 of 2014.

    Frame: FF FF, id, length (of the remaining bytes), instruction or error, parameters, inverted
    sum. https://emanual.robotis.com/docs/en/dxl/protocol1/
    """

    HEADER = b"\xff\xff"
    NUMBER = "B"

    def encode(self, packet: Packet) -> bytes:
        """Return the frame of a packet."""
        inner = bytes([packet.id, len(packet.params) + 2, packet.code]) + packet.params
        return self.HEADER + inner + bytes([_inverted_sum(inner)])

    def size(self, head: bytes) -> int | None:
        """Return the frame length from its first four bytes."""
        if len(head) < 4:
            return None
        return 4 + head[3] if head[2] <= BROADCAST and head[3] >= 2 else 0

    def decode(self, frame: bytes) -> Packet | None:
        """Return the packet in a complete frame, or None if its checksum is wrong."""
        if _inverted_sum(frame[2:-1]) != frame[-1]:
            return None
        return Packet(frame[2], frame[4], frame[5:-1])

    def as_status(self, packet: Packet) -> StatusPacket | None:
        """Return the packet as a status; Protocol 1.0 does not mark status packets."""
        return StatusPacket(packet.id, packet.code, packet.params)


def _inverted_sum(inner: bytes) -> int:
    return ~sum(inner) & 0xFF


_LIKE_HEADER = b"\xff\xff\xfd"
_STUFFED = b"\xff\xff\xfd\xfd"
_BODY = 7
"""Offset of the instruction in a Protocol 2.0 frame."""
_SUM = 2


class Protocol2(Framing):
    """Dynamixel Protocol 2.0: a header, byte stuffing to keep it out of the data, and a CRC.

    Frame: FF FF FD 00, id, length of the remaining bytes (2 bytes), instruction, parameters, CRC
    (2 bytes). https://emanual.robotis.com/docs/en/dxl/protocol2/
    """

    HEADER = b"\xff\xff\xfd\x00"
    NUMBER = "H"

    def encode(self, packet: Packet) -> bytes:
        """Return the frame of a packet, with byte stuffing."""
        # The pattern cannot overlap with itself, so one pass finds every occurrence.
        body = (bytes([packet.code]) + packet.params).replace(_LIKE_HEADER, _STUFFED)
        frame = self.HEADER + pack("<BH", packet.id, len(body) + _SUM) + body
        return frame + pack("<H", crc16(frame))

    def size(self, head: bytes) -> int | None:
        """Return the frame length from its first seven bytes."""
        if len(head) < _BODY:
            return None
        device, length = unpack_from("<BH", head, len(self.HEADER))
        return _BODY + length if device <= BROADCAST and device != 0xFD and length > _SUM else 0

    def decode(self, frame: bytes) -> Packet | None:
        """Return the packet in a complete frame, or None if its CRC is wrong."""
        if crc16(frame[:-_SUM]) != unpack_from("<H", frame, len(frame) - _SUM)[0]:
            return None
        body = frame[_BODY:-_SUM].replace(_STUFFED, _LIKE_HEADER)
        return Packet(frame[4], body[0], body[1:])

    def as_status(self, packet: Packet) -> StatusPacket | None:
        """Parse a packet as a response, or return None."""
        if packet.code != Instruction.STATUS or not packet.params:
            return None
        return StatusPacket(packet.id, packet.params[0], packet.params[1:])

    def sync_read(self, devices: Sequence[int], address: int, length: int) -> bytes:
        """Request the same part of several devices' tables; they respond in this order."""
        params = self._numbers(address, length) + bytes(devices)
        return self.encode(Packet(BROADCAST, Instruction.SYNC_READ, params))


protocol1, protocol2 = Protocol1(), Protocol2()


class Decoder:
    """Incremental decoder that finds packets in a byte stream.

    The buffer never exceeds one frame of `longest` bytes plus one input chunk. A frame that remains
    incomplete for `timeout_s` is abandoned. Only its header is discarded, because the following
    bytes may contain complete frames.
    """

    def __init__(self, framing: Framing, *, longest: int = 512, timeout_s: float = 0.02) -> None:
        self.framing = framing
        self._header = framing.HEADER
        self._longest = longest
        self._timeout_s = timeout_s
        self._kept = bytearray()
        self._received_s = -math.inf
        self.sum_errors = 0
        """Number of frames with a wrong checksum."""
        self.cut = 0
        """Number of abandoned incomplete frames."""
        self.skipped = 0
        """Number of bytes outside frames."""

    @property
    def rest(self) -> bytes:
        """Bytes that may begin an incomplete frame."""
        return bytes(self._kept)

    def feed(self, data: bytes, now_s: float) -> list[Packet]:
        """Return the packets completed by `data`, received at `now_s`; `data` may be empty."""
        packets: list[Packet] = []
        if self._kept and now_s - self._received_s > self._timeout_s:
            # One frame at a time, because the following ones may be complete or incomplete too.
            while self._kept:
                self._append_packets(packets)
                if self._kept:
                    self.cut += self._kept.startswith(self._header)
                    self._skip(1)
        if data:
            self._received_s = now_s
            self._kept += data
        self._append_packets(packets)
        return packets

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
        """Discard bytes before the next header; return whether a complete header was found."""
        at = self._kept.find(self._header)
        if at < 0:
            # The last bytes may be the beginning of a header.
            at = len(self._kept) - len(self._header) + 1
            at = max(at, 0)
            while not self._header.startswith(bytes(self._kept[at:])):
                at += 1
        self._skip(at)
        return len(self._kept) >= len(self._header)

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._kept[:count]
