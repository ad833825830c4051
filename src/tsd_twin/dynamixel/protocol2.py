"""Dynamixel Protocol 2.0: a header, stuffing that keeps it out of the data, and a CRC.

Frame: FF FF FD 00, id, length (2 bytes, of what follows), instruction, parameters, CRC (2 bytes).
https://emanual.robotis.com/docs/en/dxl/protocol2/
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from struct import pack, unpack_from

from tsd_twin.dynamixel.packets import BROADCAST, Instruction, Packet, Status, crc16

HEADER: bytes = b"\xff\xff\xfd\x00"
OVERHEAD = 10
"""Bytes of a frame without parameters."""
_LIKE_HEADER = b"\xff\xff\xfd"
_STUFFED = b"\xff\xff\xfd\xfd"
_BODY = 7
"""Where the instruction is."""
_SUM = 2


def encode(packet: Packet) -> bytes:
    """Frame of a packet."""
    # The pattern does not overlap with itself: one pass finds every place.
    body = (bytes([packet.code]) + packet.params).replace(_LIKE_HEADER, _STUFFED)
    frame = HEADER + pack("<BH", packet.id, len(body) + _SUM) + body
    return frame + pack("<H", crc16(frame))


def size(head: bytes) -> int | None:
    """Return how long the frame is that begins so; None: more is needed; 0: no frame does."""
    if len(head) < _BODY:
        return None
    device, length = unpack_from("<BH", head, len(HEADER))
    return _BODY + length if device <= BROADCAST and device != 0xFD and length > _SUM else 0


def decode(frame: bytes) -> Packet | None:
    """Packet in a whole frame; None: the sum is wrong."""
    if crc16(frame[:-_SUM]) != unpack_from("<H", frame, len(frame) - _SUM)[0]:
        return None
    body = frame[_BODY:-_SUM].replace(_STUFFED, _LIKE_HEADER)
    return Packet(frame[4], body[0], body[1:])


def as_status(packet: Packet) -> Status | None:
    """Answer that a packet is; None: it is none."""
    if packet.code != Instruction.STATUS or not packet.params:
        return None
    return Status(packet.id, packet.params[0], packet.params[1:])


def status(device: int, error: int, data: bytes = b"") -> bytes:
    """Frame of an answer."""
    return encode(Packet(device, Instruction.STATUS, bytes([error]) + data))


def ping(device: int) -> bytes:
    """Request model (2 bytes) and firmware version."""
    return encode(Packet(device, Instruction.PING))


def read(device: int, address: int, length: int) -> bytes:
    """Ask for `length` bytes of the table of a device."""
    return encode(Packet(device, Instruction.READ, pack("<HH", address, length)))


def write(device: int, address: int, data: bytes) -> bytes:
    """Write into the table of a device."""
    return encode(Packet(device, Instruction.WRITE, pack("<H", address) + data))


def sync_read(devices: Sequence[int], address: int, length: int) -> bytes:
    """Ask several devices for the same part of their tables; they answer in this order."""
    params = pack("<HH", address, length) + bytes(devices)
    return encode(Packet(BROADCAST, Instruction.SYNC_READ, params))


def sync_write(address: int, data: Mapping[int, bytes]) -> bytes:
    """Write the same part of the tables of several devices; there is no response."""
    (length,) = {len(part) for part in data.values()}
    params = pack("<HH", address, length)
    params += b"".join(bytes([device]) + part for device, part in data.items())
    return encode(Packet(BROADCAST, Instruction.SYNC_WRITE, params))
