"""What comes from the receiver: edges on six wires, bytes of SBUS, and those that were lost.

Here without the chip: the program takes no time, and a frame of pulses begins every 20 ms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.support.firmware_host import HOLD_S, Bench, FirmwareHost, number, run_until
from tsd_twin.hardware.dynamixel.control_table import Setup

FRAME_CHANNELS, WIRES = 16, 6
FAILSAFE = 0x08
SILENT = (0,) * FRAME_CHANNELS


def frame(values: Sequence[int], flags: int = 0, last: int = 0) -> bytes:
    """Frame of SBUS with numbers of 11 bits."""
    bits = sum(value << 11 * i for i, value in enumerate(values))
    return b"\x0f" + bits.to_bytes(22, "little") + bytes([flags, last])


def widths(values: Sequence[int]) -> tuple[int, ...]:
    """Pulses that the channels of a frame stand for."""
    return tuple(880 + value * 5 // 8 for value in values)


def framed(pilot: FirmwareHost) -> tuple[int, ...]:
    """Channels that came as frames."""
    return tuple(number(pilot, "channel", 2, i) for i in range(FRAME_CHANNELS))


def wired(pilot: FirmwareHost) -> tuple[int, ...]:
    """Channels that came as pulses."""
    return tuple(number(pilot, "channel", 2, FRAME_CHANNELS + i) for i in range(WIRES))


def run_to(pilot: FirmwareHost, end_s: float) -> None:
    pilot.simulation.run(end_s - pilot.simulation.board.now_s)


def run_to_half_ms(pilot: FirmwareHost) -> None:
    """Run on to the middle between two ticks."""
    now_ms = 1000 * pilot.simulation.board.now_s
    run_to(pilot, (int(now_ms + 0.501) + 0.5) / 1000)


def hear(pilot: FirmwareHost, data: bytes) -> None:
    """Send bytes as a receiver with SBUS, and wait until they were looked at."""
    pilot.simulation.board.send_from_receiver(data)
    pilot.simulation.run(12e-5 * len(data) + 0.002)


def test_pulses_at_the_same_time_are_measured_each(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    us = (1000, 1900, 1234, 801, 2199, 1500)
    pilot.simulation.board.set_receiver(us)
    pilot.simulation.board.start_parallel_pulses(0.01)
    pilot.simulation.run(0.1)
    for _ in range(100):
        pilot.simulation.run(0.0003)
        assert wired(pilot) == us


def test_a_wire_that_was_high_for_long_is_no_pulse(native_bench: Bench) -> None:
    """Not even after 34.3 ms, for which the timer counts 1.5 ms."""
    for wire in range(WIRES):
        pilot = native_bench.pilot()
        for begin_s, width_us in ((0.015, 30000), (0.035, 14268), (0.055, 0), (0.095, 1500)):
            run_to(pilot, begin_s)
            assert wired(pilot)[wire] == 0
            us = [1500 if wire else 0, 0, 0, 0, 0, 0]
            us[wire] = width_us
            pilot.simulation.board.set_receiver(us)
        run_to(pilot, 0.13)
        assert wired(pilot)[wire] == 1500


def test_edges_that_were_noted_before_some_were_lost_count_for_nothing(native_bench: Bench) -> None:
    """More than 31 can wait for the loop no longer."""
    pilot = native_bench.pilot()
    board = pilot.simulation.board
    board.set_receiver((1500,) * 6)
    run_to(pilot, 0.1195)
    assert wired(pilot) == (1500,) * 6
    board.set_receiver((1600,) * 6)
    board.keep_busy(0.0915)
    run_to(pilot, 0.2112)
    assert 1600 not in wired(pilot)
    run_to(pilot, 0.25)
    assert wired(pilot) == (1600,) * 6


def test_a_pulse_of_which_edges_were_lost_is_none(native_bench: Bench) -> None:
    # Its last edge before was seen 132.47 ms before its end, for which the timer counts 1.4 ms.
    pilot = native_bench.pilot()
    board = pilot.simulation.board
    board.set_receiver((1500,) * 6)
    run_to(pilot, 0.1022)
    board.keep_busy(0.13087)
    run_to(pilot, 0.215)
    board.set_receiver((13970, 0, 0, 0, 0, 0))
    run_to(pilot, 0.2359)
    assert wired(pilot)[0] == 0
    # It began before the loop continued, and all others end in between.
    pilot = native_bench.pilot()
    board = pilot.simulation.board
    board.set_receiver((2000, 1100, 1200, 1300, 1400, 1500))
    board.start_parallel_pulses(0.01)
    run_to(pilot, 0.0995)
    board.keep_busy(0.1114)
    run_to(pilot, 0.2259)
    assert wired(pilot) == (0,) * 6
    run_to(pilot, 0.24)
    assert wired(pilot) == (2000, 1100, 1200, 1300, 1400, 1500)


def test_what_is_heard_is_at_once_what_the_map_of_the_setup_says(native_bench: Bench) -> None:
    for sbus, maps in ((False, (0x543210, 0x012345, 0x5F4613)), (True, (0x543210, 0xF5A1E0))):
        pilot = native_bench.pilot(receiver=True, sbus=sbus)
        pilot.simulation.run(HOLD_S)
        setup = Setup(receiver_kind=int(sbus))
        for receiver_map in maps:
            # Between the pulses of two frames, where nothing but the setup changes.
            run_to(pilot, 0.02 * (int(pilot.simulation.board.now_s / 0.02) + 1) + 0.0105)
            assert pilot.set_up(replace(setup, receiver_map=receiver_map)) == 0
            pilot.simulation.run(0.0012)
            for us, lost in ((1500, False), (1400, True), (1450, False), (0, False), (1500, False)):
                pilot.simulation.set_signal(lost=lost)
                pilot.simulation.board.set_receiver([us and us + 10 * i for i in range(WIRES)])
                for _ in range(150):
                    channels = framed(pilot) if sbus else wired(pilot)
                    expected = [
                        channels[at] if at < len(channels) else 0
                        for at in (receiver_map >> 4 * i & 0xF for i in range(WIRES))
                    ]
                    assert [number(pilot, "rc", 2, i) for i in range(WIRES)] == expected
                    pilot.simulation.run(0.0008)


def test_frames_and_wires_are_each_lost_after_100_ms(native_bench: Bench) -> None:
    values = tuple(range(100, 1700, 100))
    for shift_ms in range(5):
        pilot = native_bench.pilot(receiver=True)
        run_to(pilot, 0.2 + 0.001 * shift_ms)
        wires = wired(pilot)
        pilot.simulation.board.send_from_receiver(frame(values))
        start_ms = run_until(pilot, "channel", widths(values)[0], 2)
        assert framed(pilot) == widths(values)
        lost_ms = run_until(pilot, "channel", 0, 2)
        assert framed(pilot) == SILENT
        assert 100 <= lost_ms - start_ms <= 104, "it is looked at every 5 ms"
        assert wired(pilot) == wires
        assert 0 not in wires


def test_all_channels_of_a_frame_are_heard_to_a_microsecond(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    random = np.random.default_rng(5)
    cases = [(0,) * 16, (2047,) * 16, (0, 2047) * 8, (2047, 0) * 8]
    cases += [tuple(int(value) for value in random.integers(0, 2048, 16)) for _ in range(20)]
    for values in cases:
        pilot.simulation.run(0.005)
        hear(pilot, frame(values))
        assert framed(pilot) == widths(values)
        assert wired(pilot) == (0,) * 6


def test_frames_of_either_version_count_and_others_do_not(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    good = (0x00, 0x04, 0x14, 0x24, 0x34)
    bad = (0x01, 0x02, 0x05, 0x06, 0x0C, 0x10, 0x30, 0x40, 0x44, 0x80, 0x84, 0xFF)
    for last in sorted((*good, *bad)):
        pilot.simulation.run(0.12)
        hear(pilot, frame((last,) * 16, last=last))
        assert framed(pilot) == (widths((last,) * 16) if last in good else SILENT), last


def test_a_frame_begins_after_a_pause_or_another_frame(native_bench: Bench) -> None:
    values = (1234,) * 16
    pilot = native_bench.pilot()
    pilot.simulation.run(0.01)
    hear(pilot, frame((1,) * 16) + frame((2,) * 16) + frame(values))
    assert framed(pilot) == widths(values)
    for gap_ms in (1, 2, 3, 4, 100, 254, 255, 256, 257, 258, 259):
        pilot.simulation.run(0.12)
        run_to_half_ms(pilot)
        pilot.simulation.board.send_from_receiver(b"\0")
        pilot.simulation.run(0.001 * gap_ms)
        hear(pilot, frame(values))
        assert framed(pilot) == (widths(values) if gap_ms > 2 else SILENT), gap_ms


def test_bytes_after_a_start_are_no_frame_before_a_pause(native_bench: Bench) -> None:
    for after_s in (0.0, 0.0015):
        pilot = native_bench.pilot()
        pilot.simulation.run(0.0203)
        pilot.simulation.board.reset()
        pilot.simulation.run(after_s)
        hear(pilot, frame((0,) * 16))
        assert framed(pilot) == SILENT
        pilot.simulation.run(0.004)
        hear(pilot, frame((0,) * 16))
        assert framed(pilot) == widths((0,) * 16)


def test_frames_of_which_bytes_were_lost_are_none(native_bench: Bench) -> None:
    """63 bytes can wait for the loop."""
    old, new = (1000,) * 16, (500,) * 16
    for data in (frame(new) * 3, bytes(64) + frame(new)):
        pilot = native_bench.pilot()
        pilot.simulation.run(0.01)
        hear(pilot, frame(old))
        pilot.simulation.run(0.005)
        pilot.simulation.board.keep_busy(0.02)
        pilot.simulation.board.send_from_receiver(data)
        pilot.simulation.run(0.025)
        assert framed(pilot) == widths(old)
        hear(pilot, frame(new))
        assert framed(pilot) == widths(new)


def test_no_signal_counts_whatever_follows(native_bench: Bench) -> None:
    values = (700,) * 16
    pilot = native_bench.pilot()
    for eighth in range(8):
        pilot.simulation.run(0.005)
        hear(pilot, frame(values))
        assert framed(pilot) == widths(values)
        pilot.simulation.run(0.005)
        run_to_half_ms(pilot)
        pilot.simulation.run(0.000125 * eighth)
        hear(pilot, frame(values, FAILSAFE) + frame(values)[:11])
        assert framed(pilot) == SILENT
        pilot.simulation.run(0.02)
        assert framed(pilot) == SILENT, "until it says otherwise"
