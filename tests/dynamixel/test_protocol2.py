"""Protocol 2.0 frames, with the manufacturer's SDK as the oracle where it is correct."""

from __future__ import annotations

from typing import Any

import pytest
from dynamixel_sdk import Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from tests.dynamixel.packet_strategies import DATA, IDS, PACKETS, BytesPort
from tsd_twin.hardware.dynamixel.packets import Instruction, Packet, StatusPacket, crc16, protocol2

SDK: Any = Protocol2PacketHandler()


def with_the_sdk(packet: Packet) -> bytes:
    """Return the frame with the SDK's stuffing and checksum; its `txPacket` drops the stuffing."""
    length = len(packet.params) + 3
    head = [0xFF, 0xFF, 0xFD, 0x00, packet.id, length & 0xFF, length >> 8]
    stuffed = SDK.addStuffing([*head, packet.code, *packet.params, 0, 0])[:-2]
    crc = SDK.updateCRC(0, stuffed, len(stuffed))
    return bytes([*stuffed, crc & 0xFF, crc >> 8])


@given(PACKETS)
def test_frames_are_those_of_the_sdk(packet: Packet) -> None:
    assert protocol2.encode(packet) == with_the_sdk(packet)


@given(st.binary(max_size=300))
def test_the_sum_is_that_of_the_sdk(data: bytes) -> None:
    assert crc16(data) == SDK.updateCRC(0, data, len(data))


@given(PACKETS)
def test_what_is_encoded_is_decoded(packet: Packet) -> None:
    frame = protocol2.encode(packet)
    assert protocol2.size(frame) == len(frame)
    assert protocol2.decode(frame) == packet


@given(PACKETS)
def test_no_header_is_inside_a_frame(packet: Packet) -> None:
    """A decoder that starts in the middle finds the next frame, for any data."""
    assert protocol2.HEADER not in protocol2.encode(packet)[4:-2]


@given(PACKETS, st.data())
def test_a_frame_with_a_wrong_bit_is_not_decoded(packet: Packet, data: st.DataObject) -> None:
    frame = bytearray(protocol2.encode(packet))
    bit = data.draw(st.integers(8 * 7, 8 * len(frame) - 1))
    frame[bit // 8] ^= 1 << bit % 8
    assert protocol2.decode(bytes(frame)) is None


@given(IDS, st.integers(0, 6), DATA.filter(lambda data: b"\xff\xff\xfd" not in data))
def test_the_sdk_reads_our_answers(device: int, error: int, data: bytes) -> None:
    """Without stuffing, because the SDK unstuffs the list it is scanning."""
    answer = Packet(device, Instruction.STATUS, bytes([error]) + data)
    packet, result = SDK.rxPacket(BytesPort(protocol2.encode(answer)), False)
    assert result == 0
    assert (packet[4], packet[8], bytes(packet[9 : 9 + len(data)])) == (device, error, data)


def test_what_we_ask_is_what_the_sdk_asks() -> None:
    port = BytesPort()
    SDK.ping(port, 200)
    assert port.written == protocol2.ping(200)
    port = BytesPort()
    SDK.readTx(port, 200, 59, 95)
    assert port.written == protocol2.read(200, 59, 95)
    port = BytesPort()
    SDK.writeTxOnly(port, 7, 116, 4, [1, 2, 3, 4])
    assert port.written == protocol2.write(7, 116, b"\x01\x02\x03\x04")
    port = BytesPort()
    SDK.syncReadTx(port, 126, 10, [1, 2, 3], 3, False)
    assert port.written == protocol2.sync_read([1, 2, 3], 126, 10)
    port = BytesPort()
    SDK.syncWriteTxOnly(port, 116, 2, [1, 10, 11, 2, 20, 21], 6)
    assert port.written == protocol2.sync_write(116, {1: b"\x0a\x0b", 2: b"\x14\x15"})


def test_devices_of_one_sync_write_get_as_many_bytes_each() -> None:
    with pytest.raises(ValueError, match="too many values"):
        protocol2.sync_write(116, {1: b"\x01", 2: b"\x01\x02"})


@pytest.mark.parametrize(
    ("head", "size"),
    [
        ("fffffd00 c8 0300", 10),
        ("fffffd00 c8 03", None),
        ("fffffd00 ff 0300", 0),
        ("fffffd00 c8 0200", 0),
        ("fffffd00 fd 0300", 0),
        ("fffffd00 c8 ffff", 65542),
    ],
)
def test_the_size_of_a_frame_stands_in_its_head(head: str, size: int | None) -> None:
    assert protocol2.size(bytes.fromhex(head)) == size


def test_an_answer_has_an_error_and_data() -> None:
    assert protocol2.as_status(Packet(1, Instruction.STATUS, b"\x04ab")) == StatusPacket(
        1, 4, b"ab"
    )
    assert protocol2.as_status(Packet(1, Instruction.PING)) is None
    assert protocol2.as_status(Packet(1, Instruction.STATUS)) is None
