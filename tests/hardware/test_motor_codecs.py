"""Frames of motor controllers, against vectors that their makers publish."""

from __future__ import annotations

import math
from binascii import crc_hqx
from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.hardware.motors import moteus, vesc
from tsd_twin.hardware.motors.base import Frame

pytestmark = pytest.mark.computes

# mjbots/moteus: docs/protocol/can.md and lib/python/moteus/test/moteus_test.py.
MOTEUS_REPLY = "2404000a005000000170ff230d181400"


def test_the_reply_in_the_manual_of_moteus_is_read_as_it_says() -> None:
    values = moteus.parse_reply(bytes.fromhex(MOTEUS_REPLY))
    assert values is not None
    assert values[moteus.MODE] == moteus.Mode.POSITION
    assert 360.0 * values[moteus.POSITION] == pytest.approx(2.88)
    assert 360.0 * values[moteus.VELOCITY] == pytest.approx(23.04)
    assert values[moteus.TORQUE] == pytest.approx(-1.44)
    assert values[moteus.VOLTAGE] == 12.0
    assert values[moteus.TEMPERATURE] == 20.0
    assert values[moteus.FAULT] == 0.0


def test_the_reply_in_the_tests_of_moteus_is_read_as_they_say() -> None:
    data = bytes((0x24, 4, 0, 10, 0, 0x10, 2, 0, 0xFE, 0x20, 0, 0x23, 13, 0x20, 0x30, 0x40))
    values = moteus.parse_reply(data)
    assert values is not None
    assert values[moteus.POSITION] == pytest.approx(0.0528)
    assert values[moteus.VELOCITY] == pytest.approx(-0.128)
    assert values[moteus.TORQUE] == pytest.approx(0.32)
    assert (values[moteus.VOLTAGE], values[moteus.TEMPERATURE]) == (16.0, 48.0)


def test_commands_of_moteus_are_those_of_its_tests() -> None:
    assert moteus.write_mode(moteus.Mode.POSITION) == bytes((1, 0, 10))
    body = moteus.position_mode(2.0, 0.0)
    assert body[:3] == bytes((1, 0, 10))
    # Two floats from 0x20: NaN and 2 Hz, then one at 0x27.
    assert body[3:13] == bytes((0x0E, 0x20, 0, 0, 0xC0, 0x7F, 0, 0, 0, 0x40))
    assert body[13:] == bytes((0x0D, 0x27, 0, 0, 0, 0))
    motors = moteus.MoteusMotors([1], [1])
    (frame,) = motors.drive([2.0 * math.pi])
    assert (frame.id, frame.fd, frame.extended) == (0x8001, True, True)
    assert len(frame.data) == 32
    assert bytes((0x14, 4, 0, 0x13, 13)) in frame.data, "as the manual queries"


# vedderb/bldc: identifier is packet << 8 | id, numbers are big-endian.
def test_frames_of_vesc_are_those_of_its_source() -> None:
    frame = vesc.set_erpm(11, 12345)
    assert (frame.id, frame.data) == (3 << 8 | 11, bytes.fromhex("00003039"))
    assert vesc.set_erpm(1, -1).data == b"\xff" * 4
    assert vesc.release(7) == Frame(1 << 8 | 7, bytes(4))


def long_frames(payload: bytes, target: int, sender: int) -> list[tuple[int, bytes]]:
    """Send as comm_can_send_buffer of vedderb/bldc does."""
    if len(payload) <= 6:
        return [(8 << 8 | target, bytes((sender, 1)) + payload)]
    frames, at = [], 0
    while at < len(payload) and at <= 255:
        frames.append((5 << 8 | target, bytes((at,)) + payload[at : at + 7]))
        at += 7
    while at < len(payload):
        frames.append((6 << 8 | target, pack(">H", at) + payload[at : at + 6]))
        at += 6
    end = bytes((sender, 1)) + pack(">HH", len(payload), crc_hqx(payload, 0))
    return [*frames, (7 << 8 | target, end)]


@given(st.binary(min_size=1, max_size=500))
def test_replies_in_many_frames_are_put_together(payload: bytes) -> None:
    reply, found = vesc.LongReply(), None
    for identifier, data in long_frames(payload, vesc.HOST_ID, 3):
        assert found is None
        found = reply.add(identifier >> 8, data)
    assert found == payload


def settings(device: int, timeout_ms: int, rate: int = 50, sent: int = 25) -> bytes:
    """Beginning of the settings as confgenerator.c writes them."""
    head = pack(">IBIIHHBB", 982638166, device, timeout_ms, 0, rate, 0, sent, 0)
    return bytes((17,)) + head + bytes(300)


@pytest.mark.parametrize(
    ("timeout_ms", "rate", "sent", "words"),
    [
        (200, 50, 25, ""),
        (1000, 50, 25, "its time-out is 1000 ms"),
        (0, 50, 25, "its time-out is 0 ms"),
        (200, 50, 1, "does not send CAN status"),
        (200, 5, 25, "does not send CAN status"),
    ],
)
def test_settings_of_a_vesc_are_checked(timeout_ms: int, rate: int, sent: int, words: str) -> None:
    motors = vesc.VescMotors([3], 7, [1])
    assert "does not answer" in motors.problem(0)
    for identifier, data in long_frames(settings(3, timeout_ms, rate, sent), vesc.HOST_ID, 3):
        motors.receive(Frame(identifier, data), 1.0)
    assert words in motors.problem(0)
    assert bool(words) == bool(motors.problem(0))


def test_measurements_of_a_vesc_are_those_of_the_wheel() -> None:
    motors = vesc.VescMotors([3, 4], 7, [1, -1])
    motors.receive(Frame(9 << 8 | 4, pack(">ihh", -7000, 123, 500)), 5.0)
    motors.receive(Frame(16 << 8 | 4, pack(">hhhh", 415, 0, 0, 0)), 5.0)
    motors.receive(Frame(27 << 8 | 4, pack(">ihh", 0, 118, 0)), 5.0)
    state = motors.states[1]
    assert state.speed_rad_per_s * 30.0 / math.pi == pytest.approx(1000.0)
    assert (state.current_a, state.temperature_c, state.voltage_v) == (12.3, 41.5, 11.8)
    assert (state.heard_s, motors.states[0].heard_s) == (5.0, -math.inf)


@given(st.binary(max_size=64), st.integers(0, (1 << 29) - 1), st.booleans())
def test_no_frame_makes_them_fail(data: bytes, identifier: int, fd: bool) -> None:
    frame = Frame(identifier, data, fd=fd)
    vesc.VescMotors([3], 7, [1]).receive(frame, 1.0)
    moteus.MoteusMotors([3], [1]).receive(frame, 1.0)
    for target in (vesc.HOST_ID, 3):
        for packet in (5, 6, 7, 8, 9, 16, 27):
            vesc.VescMotors([3], 7, [1]).receive(Frame(packet << 8 | target, data), 1.0)
    moteus.MoteusMotors([3], [1]).receive(Frame(3 << 8, data), 1.0)
    moteus.parse_reply(data)
