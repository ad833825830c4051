"""The board drives: servos of both protocols, speed controllers, radio control, battery."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pytest

from firmware.simulator.board import FIRMWARE
from tests.firmware import wheel_rules
from tests.support.firmware_host import CRUISE, CYCLE_S, Bench, read
from tests.support.markdown_pages import section, tables
from tsd_twin.hardware.board_geometry import compiled_geometry
from tsd_twin.hardware.dynamixel.control_table import (
    FW_VERSION,
    Block,
    BoardCommand,
    BoardIdentity,
    BoardMode,
    Geometry,
    ResetCause,
    Setup,
    Trip,
)
from tsd_twin.robots import RPM, SingularityDescription, description_of_kind, load_robot
from tsd_twin.simulation import Servos, SingularitySimulation

README = (FIRMWARE / "README.md").read_text(encoding="utf-8")
ROOM_CYCLES = 320
"""Two bytes at 1 Mbaud: so long one may wait in the chip."""
STEP_RAD = 2.0 * math.pi / 4096


def wave(cycle: int) -> list[int]:
    """Goals that keep all gimbals moving, each on its own."""
    return [round(80 * math.sin(2 * math.pi * CYCLE_S * cycle * (0.2 + 0.1 * i))) for i in range(6)]


def test_a_minute_at_100_hertz_without_a_trip_and_gimbals_follow(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_ready()
    assert pilot.arm().mode == BoardMode.ARMED
    behind = np.zeros(6)
    for cycle in range(6000):
        seen = pilot.cycle(1, CRUISE, wave(cycle))
        assert seen is not None
        assert (seen.mode, seen.trip) == (BoardMode.ARMED, Trip.NONE)
        if cycle > 100:
            behind = np.maximum(behind, np.abs(np.array(wave(cycle)) - seen.position))
    assert pilot.missed == 0
    assert (seen.crc_errors, seen.rx_errors, seen.servo_errors) == (0, 0, 0)
    # With the return delay that servos come with, and eleven bits to a byte, it is a near thing.
    assert seen.overruns < 10
    assert (pilot.simulation.servo_bus.nonsense, seen.trips, seen.resets) == (0, 0, 0)
    # Servos lag by 1 / 32 s; commands and readings each add a bus cycle.
    fastest = 80 * 2 * math.pi * 0.7
    assert (behind < fastest * (1 / 32 + 3 * CYCLE_S)).all()
    assert (behind > 0).all()


@pytest.mark.parametrize("version", [1, 2, (1, 2, 1, 2, 2, 1)], ids=str)
def test_servos_of_either_protocol_are_found_told_and_read(
    version: int | tuple[int, ...], bench: Bench
) -> None:
    neutral = (2048, 2100, 1990, 2048, 2048, 2011)
    reverse = [False, True, False, False, True, True]
    pilot = bench.pilot(version, neutral=neutral, reverse=reverse)
    pilot.get_ready(Setup(neutral=neutral, reverse=0b110010))
    assert pilot.arm().mode == BoardMode.ARMED
    goal = (120, -90, 60, 30, -200, 7)
    seen = pilot.drive(0.5, goal=goal)
    versions = [version] * 6 if isinstance(version, int) else version
    assert seen.servo_protocol == sum(1 << i for i in range(6) if versions[i] == 2)
    assert seen.position == goal
    assert pilot.simulation.plant.gimbals == pytest.approx(np.array(goal) * STEP_RAD, abs=STEP_RAD)
    assert seen.voltage == (120,) * 6
    assert seen.temperature == (35,) * 6
    assert seen.current == (0,) * 6
    assert seen.servo_errors == 0
    moving = [pilot.cycle(1, CRUISE, (-120, 90, -60, -30, 200, -7)) for _ in range(4)][-1]
    assert moving is not None
    top = (
        Servos.of(
            description_of_kind(load_robot("tsd"), SingularityDescription), 12.0
        ).speed_limit_rad_per_s
        / STEP_RAD
    )
    assert moving.velocity[0] == pytest.approx(-top, rel=0.02)
    assert moving.velocity[4] == pytest.approx(top, rel=0.02)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("delay_us", [20, 50, 100, 500])
def test_no_byte_is_lost_when_six_pulses_begin_and_end_at_once(
    delay_us: int, version: int, bench: Bench
) -> None:
    """At any moment of a cycle of the PC, and of the servos', which drift past each other."""
    pilot = bench.pilot(version, receiver=True)
    for servo in pilot.simulation.servos:
        servo.return_delay_us = delay_us
    board = pilot.simulation.board
    board.set_receiver((1900,) * 6)
    pilot.simulation.run(0.1)
    random = np.random.default_rng(10 * delay_us + version)
    pilot.telemetry()
    for cycle in range(100):
        board.start_parallel_pulses(random.uniform(0.0, CYCLE_S))
        pilot.simulation.run(random.uniform(0.0, 0.2 * CYCLE_S))
        pilot.cycle(0, goal=wave(cycle))
    seen, timing = pilot.telemetry(), board.timing()
    assert timing.lost == (0, 0)
    assert max(timing.longest_wait) < ROOM_CYCLES
    assert (seen.servo_errors, seen.rx_errors, pilot.missed) == (0, 0, 0)
    assert seen.servo_alive == 0b111111
    assert seen.rc == pytest.approx((1900,) * 6, abs=8)
    # The factory's delay needs all of a cycle, one that is cut short by a read included.
    assert seen.overruns < (10 if delay_us == 500 else 1)


def test_interrupts_and_stack_stay_as_the_page_says(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving((100, -60, 0, 40, -100, 20))
    pilot.simulation.set_switches(manual=True)
    pilot.drive(0.1)
    pilot.simulation.set_sticks(1.0, 0.5, -0.5, 1.0)
    assert pilot.drive(0.3).mode == BoardMode.RC
    radio = bench.pilot(receiver=True, sbus=True).get_driving()
    timing, by_radio = pilot.simulation.board.timing(), radio.simulation.board.timing()
    measured = wheel_rules.driving(bench).simulation.board.timing()
    (rows,) = tables(section(README, "### Interrupts and stack"))
    said = {what.strip("`"): int(most) for what, most, *_ in rows}
    taken = timing.interrupts | {"radio_byte": by_radio.interrupts["radio_byte"]}
    taken |= {"wheels": measured.interrupts["wheels"], "stack": max(timing.stack, measured.stack)}
    assert taken.keys() == said.keys()
    for what, most in said.items():
        assert 0.9 * most <= taken[what] <= most, what


def test_the_pose_is_that_of_the_mock_with_the_same_commands(bench: Bench) -> None:
    """From pulse to spin and from goal to gimbal nothing is lost: both roll the same way."""
    pilot = bench.pilot().get_ready()
    robot = description_of_kind(load_robot("tsd"), SingularityDescription)
    drive = robot.kinematics()
    joints = drive.inverse(np.array([0.3, -0.2, 0.5]))
    gimbals = joints.reshape(3, 3)[:, :2].ravel()
    goal = [round(angle / STEP_RAD) for angle in gimbals]
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.drive(2.0)
    start = pilot.simulation.plant.pose
    pilot.drive(2.0, goal=goal)
    moved = start.inverse() @ pilot.simulation.plant.pose
    mock = SingularitySimulation(robot.with_errors(0.0))
    spin = np.zeros(9)
    spin[[2, 5, 8]] = robot.drive.cruise_speed_rpm * RPM
    for setpoint, seconds in ((spin * 0.0, 2.5), (spin, 2.0), (joints, 2.0)):
        mock.command(setpoint)
        mock.advance(seconds)
    assert moved.xy_heading == pytest.approx(mock.pose.xy_heading, abs=0.02)
    assert np.hypot(*moved.xy_heading[:2]) > 0.4


def test_throttles_are_put_out_to_half_a_microsecond(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    assert pilot.arm().mode == BoardMode.ARMED
    for throttle in (
        (2001, 2255, 2256),
        (3000, 2511, 2512),
        (4000, 3999, 2000),
        (2256, 2512, 2768),
    ):
        assert pilot.drive(0.1, throttle=throttle).throttle_out == throttle
        assert pilot.simulation.pulses_us() == pytest.approx([t / 2 for t in throttle], abs=0.3)


def test_a_board_that_gets_power_says_who_it_is(bench: Bench) -> None:
    pilot = bench.pilot()
    pilot.simulation.run(0.01)
    seen = BoardIdentity.unpack(pilot.ask(read_block(BoardIdentity))[1])
    sources = b"".join(
        path.read_bytes()
        for path in sorted([*FIRMWARE.glob("*.[ch]"), *FIRMWARE.glob("rp2040/*.[chS]")])
    )
    build = int(hashlib.sha256(sources).hexdigest()[:8], 16)
    assert seen == BoardIdentity(fw=FW_VERSION, build=build)
    robot = description_of_kind(load_robot("tsd"), SingularityDescription)
    built_for = Geometry.unpack(pilot.ask(read_block(Geometry))[1])
    assert built_for == compiled_geometry(robot)
    assert built_for.pivot_y == (1500, -750, -750)
    assert Setup.unpack(pilot.ask(read_block(Setup))[1]) == Setup()
    assert BoardCommand.unpack(pilot.ask(read_block(BoardCommand))[1]) == BoardCommand()
    assert pilot.telemetry().reset_cause == ResetCause.POWER_ON


def read_block(block: type[Block]) -> bytes:
    return read(block.ADDRESS, block.LAYOUT.size)


def test_battery_and_receiver_are_measured(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True)
    for volts in (9.5, 12.6, 14.8):
        pilot.simulation.set_battery(volts)
        pilot.simulation.set_sticks(volts / 20, -volts / 20, 0.0, 0.25)
        pilot.simulation.run(0.2)
        seen = pilot.telemetry()
        assert seen.battery_mv == pytest.approx(1000 * volts, rel=0.005)
        sticks = [1500 + 20 * volts, 1500 - 20 * volts, 1500, 1300, 1900, 1100]
        assert seen.rc == pytest.approx(sticks, abs=8)


def test_the_radio_control_drives_by_the_kinematics_of_the_drive(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_ready()
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.1)
    assert pilot.mode() == BoardMode.RC
    robot = description_of_kind(load_robot("tsd"), SingularityDescription)
    drive = robot.kinematics()
    for forward, left, turn in (
        (1.0, 0.0, 0.0),
        (0.0, -1.0, 0.0),
        (0.0, 0.0, 1.0),
        (0.5, 0.5, -0.5),
        (1.0, 1.0, 1.0),
    ):
        pilot.simulation.set_sticks(forward, left, turn, 1.0)
        pilot.simulation.run(1.0)
        translation = np.array([dead(forward), dead(left)])
        translation /= max(1.0, float(np.hypot(*translation)))
        twist = np.array([*translation, robot.limits.turn_rate_rad_per_s * dead(turn)])
        gimbals = drive.inverse(twist).reshape(3, 3)[:, :2].ravel()
        goals = [servo.goal - 2048 for servo in pilot.simulation.servos]
        # A stick is measured to 0.3 %, and a goal is a whole step.
        assert goals == pytest.approx(gimbals / STEP_RAD, abs=2.0)
    assert pilot.telemetry().throttle_out == CRUISE
    before = pilot.simulation.plant.pose
    pilot.simulation.set_sticks(1.0, 0.0, 0.0, 1.0)
    pilot.simulation.run(1.0)
    x, y, heading = (before.inverse() @ pilot.simulation.plant.pose).xy_heading
    assert np.hypot(x, y) > 0.7
    assert abs(heading) < 0.5


def dead(stick: float) -> float:
    """Return the stick travel between dead bands of 20 in 400 us at the centre and the end."""
    return math.copysign(min(1.0, max(0.0, abs(stick) - 0.05) / 0.9), stick)


def test_sticks_that_jump_are_approached_within_the_acceleration(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_ready()
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.1)
    pilot.simulation.set_sticks(1.0, 0.0, 0.0, 1.0)
    robot = description_of_kind(load_robot("tsd"), SingularityDescription)
    most = robot.kinematics().inverse(np.array([1.0, 0.0, 0.0]))
    full = [round(angle / STEP_RAD) for angle in most.reshape(3, 3)[:, :2].ravel()]
    started_s = pilot.simulation.board.now_s
    while [servo.goal - 2048 for servo in pilot.simulation.servos] != full:
        pilot.simulation.run(0.01)
        assert pilot.simulation.board.now_s < started_s + 2.0
    took_s = pilot.simulation.board.now_s - started_s
    assert took_s == pytest.approx(1.0 / robot.limits.acceleration_mps2, abs=0.08)
