"""The rules of the firmware hold up to their edges: the last value, byte and millisecond.

Here without the chip: `make mutants` runs these too.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
import pytest

from firmware.simulator import protocol2
from tests.support.firmware_host import (
    CRUISE,
    HOLD_S,
    ZERO,
    Bench,
    FirmwareHost,
    number,
    packets,
    read,
    write,
)
from tsd_twin.hardware.dynamixel.control_table import (
    ADDRESS,
    BoardCommand,
    BoardIdentity,
    BoardMode,
    Item,
    Refusal,
    Setup,
    Telemetry,
    Trip,
)
from tsd_twin.robots import SingularityDescription, description_of_kind, load_robot

STEPS_PER_RAD = 4096 / (2.0 * np.pi)
FORMATS = {"u8": "<B", "u16": "<H", "u32": "<I", "i16": "<h"}


def edges(item: Item) -> Iterator[tuple[int, bytes, int]]:
    """Address, value and error for each number of an item, at its limits and one beyond."""
    if item.limits is None:
        return
    form = FORMATS[item.type]
    size = struct.calcsize(form)
    for index in range(len(item.values)):
        for value in (*item.limits, item.limits[0] - 1, item.limits[1] + 1):
            error = 0 if item.limits[0] <= value <= item.limits[1] else 4
            try:
                yield ADDRESS[item.name] + size * index, struct.pack(form, value), error
            except struct.error:
                continue


def sticks_rest_between_ends(setup: Setup) -> bool:
    sticks = list(zip(setup.stick_low, setup.stick_centre, setup.stick_high, strict=True))
    ordered = all(low < high for low, _, high in sticks)
    return ordered and all(low <= centre <= high for low, centre, high in sticks[:3])


def test_each_value_is_taken_up_to_its_limits_and_refused_beyond(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    pilot.simulation.set_contactor(closed=False)  # With power there, the pulses must not change.
    pilot.simulation.run(0.5)
    for block in (Setup, BoardCommand):
        size, items = block.LAYOUT.size, block.items()
        for address, value, error in (edge for item in items for edge in edges(item)):
            if address == ADDRESS["arm"] and value in (b"\1", b"\2"):
                continue
            if not error and ADDRESS["pulse_low"] <= address < ADDRESS["pulse_high"]:
                continue  # All else takes 1000 us for the pulse of a board at rest.
            if block is Setup:
                whole = bytearray(Setup(servo_id=(11, 12, 13, 14, 15, 16)).pack())
            else:
                whole = bytearray(BoardCommand(1, 0, 1, ZERO, (0,) * 6, pilot.session).pack())
            if address < ADDRESS["session"]:
                at = address - block.ADDRESS
                whole[at : at + len(value)] = value
            if block is Setup and not sticks_rest_between_ends(Setup.unpack(bytes(whole))):
                error = 4
            before = pilot.ask(read(block.ADDRESS, size))[1]
            assert pilot.ask(write(block.ADDRESS, bytes(whole))) == (error, b""), (address, value)
            after = pilot.ask(read(block.ADDRESS, size))[1]
            assert after == (before if error else bytes(whole)), (address, value)


def test_a_receiver_drives_nothing_with_sticks_that_have_no_way(native_bench: Bench) -> None:
    """A stick whose dead bands meet or overlap has no effect; a wider one has its full effect."""
    for way_us, moves in ((30, False), (40, False), (41, True), (50, True)):
        pilot = native_bench.pilot(receiver=True).get_ready(
            Setup(
                stick_low=(1100, 1100, 1100, 1100),
                stick_high=(1500 + way_us, 1900, 1900, 1100 + way_us),
            )
        )
        pilot.simulation.set_switches(manual=True)
        pilot.simulation.run(0.1)
        assert pilot.mode() == BoardMode.RC
        for us in (25, 400):
            pilot.simulation.set_sticks(us / 400, 0.0, 0.0, us / 800)
            pilot.simulation.run(0.6)
            seen = pilot.telemetry()
            goals = [servo.goal for servo in pilot.simulation.servos]
            assert (seen.throttle_out != ZERO) == moves, (way_us, us)
            assert (goals != [2048] * 6) == moves, (way_us, us)
        if moves:
            assert seen.throttle_out == CRUISE


CENTRE, FULL = 1500, 1900
PERIOD_S = 0.02


def until(pilot: FirmwareHost, mode: BoardMode) -> None:
    for _ in range(200):
        if pilot.simulation.board.peek(ADDRESS["mode"]) == mode:
            return
        pilot.simulation.run(0.0005)
    raise AssertionError(f"never {mode}")


def take_over(pilot: FirmwareHost, sticks_us: tuple[int, ...], shift_us: int) -> None:
    """Move the switch to manual, with other pulses that much longer: they come one by one."""
    receiver = pilot.simulation.board.set_receiver
    receiver((*sticks_us, 1100, 1600 + shift_us, 1100))
    pilot.simulation.run(HOLD_S)
    receiver((*sticks_us, 1100, 1600 + shift_us, 1600))
    until(pilot, BoardMode.RC)


def give_back(pilot: FirmwareHost, sticks_us: tuple[int, ...], shift_us: int) -> None:
    pilot.simulation.board.set_receiver((*sticks_us, 1100, 1600 + shift_us, 1400))
    until(pilot, BoardMode.DISARMED)


def goals_of(pilot: FirmwareHost, seconds: float) -> tuple[list[float], list[tuple[int, ...]]]:
    """Changes of the goals that the servos get: when, and to what."""
    times_s: list[float] = []
    found: list[tuple[int, ...]] = []
    start_s = pilot.simulation.board.now_s
    while pilot.simulation.board.now_s < start_s + seconds:
        goals = tuple(servo.goal - 2048 for servo in pilot.simulation.servos)
        if not found or goals != found[-1]:
            times_s.append(pilot.simulation.board.now_s - start_s)
            found.append(goals)
        pilot.simulation.run(0.001)
    return times_s, found


def approached(wanted: np.ndarray) -> list[np.ndarray]:
    """Return the gimbal goals from rest to a twist, every 20 ms, in servo steps."""
    robot = description_of_kind(load_robot("tsd"), SingularityDescription)
    drive, limits = robot.kinematics(), robot.limits
    twist, found = np.zeros(3), [np.zeros(6)]
    while not np.array_equal(twist, wanted):
        off = wanted - twist
        steps = max(
            np.hypot(*off[:2]) / (limits.acceleration_mps2 * PERIOD_S),
            abs(off[2]) / (limits.angular_acceleration_rad_per_s2 * PERIOD_S),
        )
        twist = wanted if steps <= 1.0 else twist + off / steps
        gimbals = drive.inverse(twist).reshape(3, 3)[:, :2].ravel()
        found.append(gimbals * STEPS_PER_RAD)
    return found


def test_sticks_are_approached_from_rest_in_steps_of_the_accelerations(native_bench: Bench) -> None:
    """Wherever in the cycle of the servos it begins, and whatever was before."""
    limits = load_robot("tsd").limits
    most = (limits.speed_mps, limits.speed_mps, limits.turn_rate_rad_per_s)
    for sticks, shift_us in (
        ((1, 0, 0), 0),
        ((0, 0, 1), 200),
        ((0, -1, 0), 400),
        ((1, 0, -1), 600),
    ):
        pilot = native_bench.pilot(receiver=True).get_ready()
        take_over(pilot, tuple(CENTRE + 400 * stick for stick in sticks), shift_us)
        times_s, seen = goals_of(pilot, 0.4)
        expected = approached(np.multiply(sticks, most))
        assert len(seen) == len(expected)
        assert np.array(seen) == pytest.approx(np.array(expected), abs=0.51)
        # The first is there within a cycle of the servos, and each next one is a period later.
        assert times_s[1] < 0.017
        assert np.diff(times_s[1:]) == pytest.approx(PERIOD_S, abs=0.0021)
        give_back(pilot, (FULL,) * 3, 600)
        pilot.simulation.run(0.1)
        # Earlier outputs have no influence.
        take_over(pilot, (CENTRE,) * 3, 600 - shift_us)
        assert goals_of(pilot, 0.1)[1] == [(0,) * 6]


def test_answers_wait_up_to_255_bytes(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    pilot.simulation.run(0.1)
    for more, answered in ((-1, 3), (0, 3), (1, 2)):
        asked = read(0, 74) + read(0, 74) + read(0, 74 + more)
        pilot.simulation.board.keep_busy(0.005)
        pilot.simulation.board.send(asked)
        pilot.simulation.run(0.02)
        answers = packets(pilot.simulation.board.receive())
        assert [len(answer) for answer in answers] == [85, 85, 85 + more][:answered]
        assert all(protocol2.parse(answer) for answer in answers)


def test_a_lost_byte_is_counted_though_more_came_since(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    pilot.simulation.run(0.1)
    pilot.simulation.board.keep_busy(0.002)
    pilot.simulation.board.lose_byte()
    pilot.simulation.board.send(read(0, 1) * 2)
    pilot.simulation.run(0.005)
    assert len(packets(pilot.simulation.board.receive())) == 2
    assert pilot.telemetry().rx_errors == 1


def test_what_comes_while_the_board_is_busy_is_handled_then(native_bench: Bench) -> None:
    """The receive buffer holds 255 bytes, at any position of its first byte."""
    pilot = native_bench.pilot()
    pilot.simulation.run(0.1)
    question = read(Telemetry.ADDRESS, 1)
    for _ in range(30):
        pilot.simulation.board.keep_busy(0.004)
        pilot.simulation.board.send(question * 18)
        pilot.simulation.run(0.02)
        assert len(packets(pilot.simulation.board.receive())) == 18
    assert pilot.telemetry().rx_errors == 0


def test_the_light_is_on_while_a_source_has_the_robot(native_bench: Bench) -> None:
    pilot = native_bench.pilot(receiver=True).get_ready()
    assert not pilot.simulation.board.light
    assert pilot.arm().mode == BoardMode.ARMED
    assert pilot.simulation.board.light
    pilot.simulation.set_switches(manual=True)
    assert pilot.drive(0.1).mode == BoardMode.RC
    assert pilot.simulation.board.light
    pilot.simulation.set_switches()
    assert pilot.drive(0.1).mode == BoardMode.DISARMED
    assert not pilot.simulation.board.light


def ticks_until(
    pilot: FirmwareHost, item: str, value: int, size: int = 1, *, after_s: float = 0.0
) -> int:
    """Milliseconds of the board until an item has a value, which it has not within `after_s`."""
    start = number(pilot, "millis", 4)
    pilot.simulation.run(after_s)
    assert number(pilot, item, size) != value
    while number(pilot, item, size) != value:
        pilot.simulation.run(0.0002)
        assert number(pilot, "millis", 4) - start <= 3000, item
    return number(pilot, "millis", 4) - start


def test_silence_lasts_500_ms_and_zero_throttle_2000(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_driving()
    pilot.simulation.board.send(pilot.command(1, CRUISE))
    while number(pilot, "beat", 2) != pilot.beat:
        pilot.simulation.run(0.0001)
    assert ticks_until(pilot, "mode", BoardMode.DISARMED, after_s=0.49) == 500
    assert number(pilot, "esc_ready") == 0
    assert ticks_until(pilot, "esc_ready", 1, after_s=1.99) == 2000
    pilot.simulation.set_contactor(closed=False)
    pilot.simulation.run(0.5)
    pilot.simulation.set_contactor(closed=True)
    ticks_until(pilot, "drive_on", 1)
    took_ms = ticks_until(pilot, "esc_ready", 1, after_s=1.99)
    assert took_ms == 1999, "the one in which it came is the first"


def test_the_setup_may_be_written_2000_ms_after_the_last_throttle(native_bench: Bench) -> None:
    """The millisecond of the first zero is the first."""
    for after_ms, error in ((1998, 7), (1999, 0)):
        pilot = native_bench.pilot().get_driving()
        pilot.simulation.board.send(pilot.command(0))
        ticks_until(pilot, "throttle_out", ZERO[0], 2)
        start_ms = number(pilot, "millis", 4)
        pilot.simulation.run(1.99)
        ticks_until(pilot, "millis", start_ms + after_ms - 1, 4)
        pilot.simulation.run(0.0004)
        pilot.simulation.board.receive()
        packet = write(Setup.ADDRESS, Setup().pack())
        pilot.simulation.board.send(packet)
        pilot.simulation.run(1e-5 * len(packet) + 1e-6)
        assert number(pilot, "millis", 4) == start_ms + after_ms, "when its last byte came"
        pilot.simulation.run(0.0005)
        parsed = protocol2.parse(pilot.simulation.board.receive())
        assert parsed is not None
        assert parsed[2][0] == error


def test_rest_lasts_longer_than_sixteen_bits_count_milliseconds(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    pilot.simulation.servo_bus.servos.clear()
    pilot.simulation.run(66.5 - pilot.simulation.board.now_s)
    assert number(pilot, "esc_ready") == 1
    assert pilot.set_up() == 0


def test_arm_reads_1_while_the_pc_has_the_robot_and_0_else(native_bench: Bench) -> None:
    pilot = native_bench.pilot(receiver=True).get_ready()
    assert number(pilot, "arm") == 0
    assert pilot.arm().mode == BoardMode.ARMED
    assert number(pilot, "arm") == 1
    assert pilot.drive(0.1).mode == BoardMode.ARMED
    assert number(pilot, "arm") == 1
    pilot.simulation.run(0.6)
    assert (pilot.mode(), number(pilot, "arm")) == (BoardMode.DISARMED, 0)
    assert pilot.arm(at_once=True).refusal == Refusal.ESC_HOLD
    assert number(pilot, "arm") == 0
    pilot.cycle(1)
    assert number(pilot, "arm") == 0


def test_the_session_lasts_while_nothing_is_asked(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    pilot.cycle(0)
    session = pilot.telemetry().nonce
    for arm in (0, 0, 1, 1, 1):
        pilot.cycle(arm)
        assert pilot.telemetry().nonce == session
    pilot.cycle(0)
    assert pilot.telemetry().nonce != session


def test_a_block_is_refused_that_is_behind_or_of_another_session(native_bench: Bench) -> None:
    """The same beat again is none, but no mistake; and 0 in `arm` is always taken."""
    pilot = native_bench.pilot()
    pilot.beat = 65500  # Wrapping from 65535 to 0 counts as progress.
    pilot.get_driving()
    for _ in range(60):
        assert pilot.ask(pilot.command(1, CRUISE))[0] == 0
        assert pilot.ask(pilot.command(1, CRUISE, fresh=False))[0] == 0
    pilot.beat -= 2
    assert pilot.ask(pilot.command(1, CRUISE))[0] == 7
    pilot.beat += 1
    pilot.session = (pilot.session[0] ^ 1, pilot.session[1])
    assert pilot.ask(pilot.command(1, CRUISE))[0] == 7
    assert pilot.mode() == BoardMode.ARMED
    pilot.session = (pilot.session[0] ^ 1, pilot.session[1])
    assert pilot.ask(pilot.command(0, CRUISE))[0] == 0
    assert pilot.mode() == BoardMode.DISARMED


def test_each_throttle_and_each_goal_has_to_be_zero(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    for i in range(9):
        values = [2000] * 3 + [0] * 6
        values[i] += 1
        pilot.cycle(0)
        pilot.cycle(1, values[:3], values[3:])
        seen = pilot.telemetry()
        assert seen.refusal == (Refusal.THROTTLE if i < 3 else Refusal.GOAL), i
        assert seen.mode == BoardMode.DISARMED
    assert pilot.arm().mode == BoardMode.ARMED


def test_each_gimbal_has_to_be_within_the_neutral_band(native_bench: Bench) -> None:
    for i, off in ((0, 34), (1, 35), (2, -34), (3, -35), (4, 35), (5, 35), (0, -35)):
        neutral = [2048] * 6
        neutral[i] -= off
        pilot = native_bench.pilot()
        pilot.simulation.servos[i].jammed = True
        pilot.get_ready(Setup(neutral=tuple(neutral)))
        seen = pilot.arm()
        assert seen.position[i] == off
        refused = abs(off) > BoardIdentity().neutral_band
        assert seen.mode == (BoardMode.DISARMED if refused else BoardMode.ARMED), (i, off)
        assert seen.refusal == (Refusal.NOT_NEUTRAL if refused else Refusal.NONE)


def test_servos_that_are_not_expected_may_be_anything(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    dead, faulty, tilted = (pilot.simulation.servos[i] for i in (1, 2, 4))
    dead.dead = faulty.fault = tilted.jammed = True
    pilot.get_ready(Setup(neutral=(2048,) * 4 + (1948, 2048), servos_expected=0b101001))
    assert pilot.arm().mode == BoardMode.ARMED
    seen = pilot.drive(0.2)
    assert (seen.mode, seen.servo_alive, seen.servo_fault) == (BoardMode.ARMED, 0b111101, 0b000100)
    pilot.simulation.servos[3].dead = True
    assert pilot.drive(0.2).trip == Trip.SERVO


def test_the_radio_control_waits_for_zero_throttle_unless_it_takes_over(
    native_bench: Bench,
) -> None:
    pilot = native_bench.pilot(receiver=True).get_driving()
    pilot.simulation.set_switches(manual=True)
    assert pilot.drive(0.1).mode == BoardMode.RC
    pilot.simulation.set_sticks(0.0, 0.0, 0.0, 1.0)
    seen = pilot.drive(2.2)
    assert (seen.mode, seen.esc_ready) == (BoardMode.RC, 0), "it is driven, not held"
    pilot.simulation.set_sticks(0.0, 0.0, 0.0, 0.0)
    for manual in (False, True):
        pilot.simulation.set_switches(manual=manual)
        pilot.simulation.run(0.1)
    seen = pilot.telemetry()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.ESC_HOLD)


def test_the_first_reason_against_the_radio_control_is_named(native_bench: Bench) -> None:
    pilot = native_bench.pilot(receiver=True).get_driving()
    pilot.simulation.set_contactor(closed=False)
    pilot.simulation.set_sticks(0.0, 0.0, 0.0, 0.5)
    assert pilot.drive(0.3).drive_on == 0
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.1)
    seen = pilot.telemetry()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.DRIVE)


def test_a_low_battery_is_not_taken_over_with(native_bench: Bench) -> None:
    pilot = native_bench.pilot(receiver=True).get_ready(Setup(battery_arm_mv=11000))
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.simulation.set_battery(10.5)
    assert pilot.drive(0.2).mode == BoardMode.ARMED
    pilot.simulation.set_switches(manual=True)
    seen = pilot.drive(0.1)
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.BATTERY)


def test_servos_hold_under_radio_control_whatever_the_pc_writes(native_bench: Bench) -> None:
    pilot = native_bench.pilot(receiver=True).get_ready()
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.1)
    assert pilot.mode() == BoardMode.RC
    for _ in range(30):
        pilot.cycle(0, torque=0)
        assert all(servo.torque for servo in pilot.simulation.servos)
    pilot.simulation.set_switches()
    for _ in range(30):
        pilot.cycle(0, torque=0)
    assert not any(servo.torque for servo in pilot.simulation.servos)


def test_what_the_board_knows_is_said(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    pilot.simulation.run(0.2)
    seen = pilot.telemetry()
    assert (seen.setup_known, seen.drive_on, seen.esc_ready) == (0, 1, 0)
    seen = pilot.get_ready().telemetry()
    assert (seen.setup_known, seen.drive_on, seen.esc_ready) == (1, 1, 1)
    pilot.simulation.set_contactor(closed=False)
    pilot.simulation.run(0.5)
    seen = pilot.telemetry()
    assert (seen.setup_known, seen.drive_on, seen.esc_ready) == (1, 0, 0)


def test_pulses_of_the_receiver_count_from_800_to_2200_us(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    for us, counts in ((799, False), (800, True), (2200, True), (2201, False)):
        pilot.simulation.board.set_receiver((us,) * 6)
        pilot.simulation.run(0.3)
        assert pilot.telemetry().rc == ((us,) * 6 if counts else (0,) * 6)


def test_a_channel_is_lost_after_100_ms(native_bench: Bench) -> None:
    pilot = native_bench.pilot(receiver=True)
    pilot.simulation.run(0.1)
    pilot.simulation.board.set_receiver((1501, 1500, 1500, 1100, 1900, 1100))
    ticks_until(pilot, "rc", 1501, 2)
    pilot.simulation.lose_receiver(0)
    assert 100 < ticks_until(pilot, "rc", 0, 2) <= 105, "it is looked at every 5 ms"


def test_a_switch_turns_off_at_1500_us_and_on_above_1550_us(native_bench: Bench) -> None:
    """Driven by the PC, with the kill switch on."""
    for kill_us, manual_us, mode in (
        (1500, 1500, BoardMode.DISARMED),
        (1501, 1500, BoardMode.ARMED),
        (1501, 1550, BoardMode.ARMED),
        (1501, 1551, BoardMode.RC),
    ):
        pilot = native_bench.pilot(receiver=True).get_driving()
        pilot.simulation.board.set_receiver((1500, 1500, 1500, 1100, kill_us, manual_us))
        assert pilot.drive(0.1).mode == mode


def test_servos_that_answer_soon_are_all_heard_within_the_cycle(native_bench: Bench) -> None:
    for version in (1, 2):
        pilot = native_bench.pilot(version)
        for servo in pilot.simulation.servos:
            servo.return_delay_us = 100
        pilot.simulation.run(1.0)
        before = pilot.telemetry()
        assert before.servo_alive == 0b111111
        pilot.simulation.run(1.0)
        seen = pilot.telemetry()
        assert (seen.servo_errors, seen.overruns) == (before.servo_errors, before.overruns)
