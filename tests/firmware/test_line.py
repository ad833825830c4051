"""After any input on the serial line, the board answers the next ping."""

from __future__ import annotations

import numpy as np
import pytest

from firmware.simulator import protocol2
from tests.support.firmware_host import PING, Bench, at, packets, read, write
from tsd_twin.hardware.dynamixel.control_table import (
    BOARD_ID,
    FW_VERSION,
    MODEL,
    TABLE_SIZE,
    BoardCommand,
    BoardMode,
)

CASES = 100_000
CASES_ON_CHIP = 6_000
LONGEST_READ = 160
HEADER = b"\xff\xff\xfd\x00"
ANSWER = protocol2.status(BOARD_ID, MODEL.to_bytes(2, "little") + bytes([FW_VERSION]))
BATCH = 2000


def good(random: np.random.Generator) -> bytes:
    """A write that would be taken, or a read, or a ping."""
    kind = random.integers(4)
    if kind == 0:
        return protocol2.packet(int(random.integers(1, 254)), protocol2.PING)
    if kind == 1:
        return protocol2.packet(BOARD_ID, protocol2.READ, random.bytes(4))
    goal = tuple(int(g) for g in random.integers(-1023, 1024, 6))
    return write(BoardCommand.ADDRESS, BoardCommand(1, 1, 1, (2414,) * 3, goal).pack())


def garbage(random: np.random.Generator) -> bytes:
    return random.bytes(int(random.integers(1, 60)))


def cut(random: np.random.Generator) -> bytes:
    packet = good(random)
    size = int(random.integers(1, len(packet)))
    # What is cut off must not be what the ping begins with: both would be whole packets.
    return packet[:size] if packet[size] != PING[0] else b"\xff"


def flipped(random: np.random.Generator) -> bytes:
    packet = bytearray(good(random))
    for _ in range(int(random.integers(1, 4))):
        packet[int(random.integers(len(packet)))] ^= 1 << int(random.integers(8))
    return bytes(packet)


def headers(random: np.random.Generator) -> bytes:
    parts = [HEADER[: int(random.integers(1, 5))] for _ in range(int(random.integers(1, 12)))]
    return b"".join(parts)


def absurd(random: np.random.Generator) -> bytes:
    """A header that announces far too much, or too little."""
    return HEADER + random.bytes(4 + int(random.integers(10)))


KINDS = (garbage, cut, flipped, headers, absurd)


@pytest.mark.parametrize("cases_count", [CASES_ON_CHIP, CASES])
def test_a_hundred_thousand_broken_packets_are_each_followed_by_an_answered_ping(
    cases_count: int, bench: Bench, native_bench: Bench
) -> None:
    pilot = (bench if cases_count == CASES_ON_CHIP else native_bench).pilot()
    pilot.simulation.servo_bus.servos.clear()
    pilot.simulation.run(0.3)
    random = np.random.default_rng(7)
    for start in range(0, cases_count, BATCH):
        cases = [KINDS[(start + i) % len(KINDS)](random) for i in range(BATCH)]
        answered = pilot.simulation.board.count_answered(cases, PING, ANSWER, 0.05)
        assert answered == BATCH, cases[answered].hex()
    seen = pilot.telemetry()
    assert seen.mode == BoardMode.DISARMED
    assert seen.crc_errors + seen.rx_errors > 0
    assert pilot.simulation.board.resets == 0


def test_an_armed_board_drives_on_among_garbage(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    random = np.random.default_rng(8)
    for i in range(300):
        pilot.simulation.board.send(KINDS[i % len(KINDS)](random)[:20])
        pilot.simulation.run(0.012)
        pilot.simulation.board.receive()
        pilot.cycle(1, (2414, 2411, 2417))
    seen = pilot.telemetry()
    assert seen.throttle_out == (2414, 2411, 2417)
    assert seen.mode == BoardMode.ARMED
    assert pilot.missed == 0


def test_answers_without_room_are_left_out_as_a_whole(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    pilot.simulation.run(0.1)
    for length in (20, 97, LONGEST_READ):
        asked = read(0, length)
        pilot.simulation.board.send(asked * 40)
        pilot.simulation.run(0.1)
        answers = packets(pilot.simulation.board.receive())
        assert 2 <= len(answers) < 40
        for answer in answers:
            parsed = protocol2.parse(answer)
            assert parsed is not None
            assert len(parsed[2]) == 1 + length
    assert pilot.ask(PING)[0] == 0


def test_lost_bytes_are_counted(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    pilot.simulation.run(0.1)
    for lost in range(1, 4):
        pilot.simulation.board.lose_byte()
        assert pilot.telemetry().rx_errors == lost
        assert pilot.telemetry().rx_errors == lost


def test_every_length_of_read_is_answered_with_what_stands_there(bench: Bench) -> None:
    pilot = bench.pilot()
    pilot.simulation.run(0.2)
    size = TABLE_SIZE
    for length in range(1, LONGEST_READ + 1):
        request = protocol2.packet(
            BOARD_ID, protocol2.READ, (size - length).to_bytes(2, "little") + bytes([length, 0])
        )
        error, data = pilot.ask(request)
        assert (error, len(data)) == (0, length)
    for parameters in (
        b"\0\0\0\0",
        b"\0\0" + bytes([LONGEST_READ + 1, 0]),
        b"\0\0\xff\xff",
        b"\xff\xff\1\0",
        at(size) + at(1),
        b"\0",
    ):
        error, data = pilot.ask(protocol2.packet(BOARD_ID, protocol2.READ, parameters))
        assert error in (5, 7)
        assert data == b""


def test_what_looks_like_a_header_inside_a_packet_is_stuffed_both_ways(bench: Bench) -> None:
    """-1 and -3 as goals are FF FF FD FF in a row."""
    pilot = bench.pilot().get_ready()
    for goal in ((-1, -3, -1, -3, -1, -3), (-1, -1, -3, -3, -1, -513)):
        pilot.cycle(0, goal=goal)
        error, data = pilot.ask(read(BoardCommand.ADDRESS, BoardCommand.LAYOUT.size))
        assert error == 0
        assert BoardCommand.unpack(data).goal == goal


def test_others_are_not_answered_for_and_a_broadcast_ping_is(bench: Bench) -> None:
    pilot = bench.pilot()
    pilot.simulation.run(0.05)
    pilot.simulation.board.send(protocol2.packet(1, protocol2.PING) + protocol2.status(1, b"\1"))
    pilot.simulation.run(0.05)
    assert pilot.simulation.board.receive() == b""
    assert pilot.ask(protocol2.packet(protocol2.BROADCAST, protocol2.PING))[0] == 0
    assert pilot.ask(protocol2.packet(BOARD_ID, 0x99)) == (2, b"")
