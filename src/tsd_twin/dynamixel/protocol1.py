"""Dynamixel Protocol 1.0, the factory protocol of an MX-64 of 2014.

Frame: FF FF, id, length (of what follows), instruction or error, parameters, inverted sum.
https://emanual.robotis.com/docs/en/dxl/protocol1/
"""

from __future__ import annotations

from collections.abc import Mapping

from tsd_twin.dynamixel.packets import BROADCAST, Instruction, Packet, Status

HEADER: bytes = b"\xff\xff"
OVERHEAD = 6
"""Bytes of a frame without parameters."""


def encode(packet: Packet) -> bytes:
    """Frame of a packet."""
    inner = bytes([packet.id, len(packet.params) + 2, packet.code]) + packet.params
    return HEADER + inner + bytes([_sum(inner)])


def size(head: bytes) -> int | None:
    """Return how long the frame is that begins so; None: more is needed; 0: no frame does."""
    if len(head) < 4:
        return None
    return 4 + head[3] if head[2] <= BROADCAST and head[3] >= 2 else 0


def decode(frame: bytes) -> Packet | None:
    """Packet in a whole frame; None: the sum is wrong."""
    if _sum(frame[2:-1]) != frame[-1]:
        return None
    return Packet(frame[2], frame[4], frame[5:-1])


def as_status(packet: Packet) -> Status | None:
    """Packet as a status; Protocol 1.0 does not mark status packets."""
    return Status(packet.id, packet.code, packet.params)


def status(device: int, error: int, data: bytes = b"") -> bytes:
    """Frame of an answer."""
    return encode(Packet(device, error, data))


def ping(device: int) -> bytes:
    """Request a response without data, to find a device."""
    return encode(Packet(device, Instruction.PING))


def read(device: int, address: int, length: int) -> bytes:
    """Ask for `length` bytes of the table of a device."""
    return encode(Packet(device, Instruction.READ, bytes([address, length])))


def write(device: int, address: int, data: bytes) -> bytes:
    """Write into the table of a device."""
    return encode(Packet(device, Instruction.WRITE, bytes([address]) + data))


def sync_write(address: int, data: Mapping[int, bytes]) -> bytes:
    """Write the same part of the tables of several devices; there is no response."""
    (length,) = {len(part) for part in data.values()}
    params = bytes([address, length])
    params += b"".join(bytes([device]) + part for device, part in data.items())
    return encode(Packet(BROADCAST, Instruction.SYNC_WRITE, params))


def _sum(inner: bytes) -> int:
    return ~sum(inner) & 0xFF
