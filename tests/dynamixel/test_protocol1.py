"""Protocol 1.0 frames, with the manufacturer's SDK as the oracle."""

from __future__ import annotations

from typing import Any

from dynamixel_sdk import Protocol1PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from tests.dynamixel.packet_strategies import DATA, IDS, PACKETS, BytesPort
from tsd_twin.hardware.dynamixel.packets import Packet, protocol1

SDK: Any = Protocol1PacketHandler()


@given(PACKETS)
def test_what_is_encoded_is_decoded(packet: Packet) -> None:
    frame = protocol1.encode(packet)
    assert protocol1.size(frame) == len(frame)
    assert protocol1.decode(frame) == packet


@given(PACKETS, st.data())
def test_a_frame_with_a_wrong_bit_is_not_decoded(packet: Packet, data: st.DataObject) -> None:
    frame = bytearray(protocol1.encode(packet))
    bit = data.draw(st.integers(8 * 4, 8 * len(frame) - 1))
    frame[bit // 8] ^= 1 << bit % 8
    assert protocol1.decode(bytes(frame)) is None


@given(IDS, st.integers(0, 0x7F), DATA)
def test_the_sdk_reads_our_answers(device: int, error: int, data: bytes) -> None:
    packet, result = SDK.rxPacket(BytesPort(protocol1.encode(Packet(device, error, data))))
    assert result == 0
    assert (packet[2], packet[4], bytes(packet[5:-1])) == (device, error, data)


@given(IDS, st.integers(0, 73), DATA.filter(bool))
def test_what_we_ask_is_what_the_sdk_asks(device: int, address: int, data: bytes) -> None:
    port = BytesPort()
    SDK.ping(port, device)
    assert port.written == protocol1.ping(device)
    port = BytesPort()
    SDK.writeTxOnly(port, device, address, len(data), list(data))
    assert port.written == protocol1.write(device, address, data)
    port = BytesPort()
    SDK.readTx(port, device, address, len(data))
    assert port.written == protocol1.read(device, address, len(data))
    port = BytesPort()
    SDK.syncWriteTxOnly(port, address, len(data), [device, *data], len(data) + 1)
    assert port.written == protocol1.sync_write(address, {device: data})


def test_an_answer_has_an_error_and_data() -> None:
    status = protocol1.as_status(Packet(3, 0x20, b"ab"))
    assert status is not None
    assert (status.id, status.error, status.data) == (3, 0x20, b"ab")
