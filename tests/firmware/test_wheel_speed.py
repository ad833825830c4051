"""Measured wheel speeds: error over random speeds, lost and additional pulses, load of the chip."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
import pytest

from firmware.simulator.esc_telemetry import packet
from tests.firmware import telemetry_rules
from tests.firmware.telemetry_rules import POLE_PAIRS, QUANTUM_RPM, TELEMETRY
from tests.firmware.wheel_rules import PULSES, SENSORS, driving, ready, true_rpm
from tests.support.firmware_host import CYCLE_S, Bench, FirmwareHost
from tsd_twin.hardware.dynamixel.control_table import BoardMode, Setup, Trip, WheelSensor

SETTLED = 0.015
LATEST_S = 0.08
"""Maximum age of a speed, which is the mean over 50 ms and updated as often."""


def profile(pilot: FirmwareHost, seed: int, back: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Drive at random throttles; yield the least and greatest true speeds of `back` cycles."""
    random = np.random.default_rng(seed)
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.drive(1.0)
    true: deque[np.ndarray] = deque(maxlen=back)
    for _ in range(12):
        throttle = random.integers(2400, 4000, 3).tolist()
        for _ in range(int(random.integers(10, 90))):
            seen = pilot.cycle(1, throttle)
            assert seen is not None
            assert seen.mode == BoardMode.ARMED
            true.append(true_rpm(pilot))
            if len(true) == back:
                recent = np.array(true)
                yield recent.min(axis=0), recent.max(axis=0)


@pytest.mark.parametrize("pulses", [1, 2, 4])
def test_speeds_over_random_profiles_are_within_the_stated_error(
    pulses: int, native_bench: Bench
) -> None:
    pilot = native_bench.pilot(wheel_pulses=pulses)
    pilot.get_ready(Setup(wheel_sensor=WheelSensor.HALL, wheel_pulses=pulses))
    back = round(LATEST_S / CYCLE_S) + (3 if pulses == 1 else 0)
    for slowest, fastest in profile(pilot, pulses, back):
        rpm = np.array(pilot.wheels().wheel_rpm)
        assert (rpm >= (1.0 - SETTLED) * slowest).all()
        assert (rpm <= (1.0 + SETTLED) * fastest).all()


@pytest.mark.parametrize(
    "disturbance", [{"lost": 0.05}, {"extra": 0.05}, {"lost": 0.03, "extra": 0.03}], ids=str
)
def test_lost_and_additional_pulses_hardly_change_a_speed(
    disturbance: dict[str, float], native_bench: Bench
) -> None:
    pilot = driving(native_bench)
    pilot.simulation.board.disturb_wheel(1, **disturbance)
    errors = []
    for _ in range(500):
        seen = pilot.cycle(1, (3000, 3000, 3000))
        assert seen is not None
        assert seen.mode == BoardMode.ARMED
        errors.append(pilot.wheels().wheel_rpm / true_rpm(pilot) - 1.0)
    middle, other = np.array(errors[100:])[:, 1], np.array(errors[100:])[:, (0, 2)]
    assert np.abs(other).max() < SETTLED
    assert abs(middle.mean()) < 0.02
    assert np.abs(middle).max() < 0.2


def test_no_byte_is_lost_while_fast_wheels_and_six_pulses_interrupt(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True, wheel_pulses=PULSES)
    for servo in pilot.simulation.servos:
        servo.return_delay_us = 100
    pilot.get_ready(SENSORS)
    pilot.simulation.board.start_parallel_pulses(0.003)
    assert pilot.arm().mode == BoardMode.ARMED
    for _ in range(150):
        seen = pilot.cycle(1, (4000, 4000, 4000))
    assert seen is not None
    assert seen.trip == Trip.NONE
    assert (seen.servo_errors, seen.rx_errors, seen.overruns) == (0, 0, 0)
    assert min(pilot.wheels().wheel_rpm) > 13000
    timing = pilot.simulation.board.timing()
    assert timing.lost == (0, 0)
    assert max(timing.longest_wait) < 320
    assert timing.interrupts["wheels"] <= 130


def test_a_main_loop_that_is_late_measures_again(native_bench: Bench) -> None:
    pilot = driving(native_bench)
    pilot.simulation.board.keep_busy(0.012)
    pilot.simulation.run(0.02)
    for _ in range(20):
        seen = pilot.cycle(1, (2414, 2411, 2417))
        assert np.abs(pilot.wheels().wheel_rpm / true_rpm(pilot) - 1.0).max() < 2 * SETTLED
    assert seen is not None
    assert seen.mode == BoardMode.ARMED


def test_another_number_of_pulses_is_another_speed(native_bench: Bench) -> None:
    pilot = ready(native_bench, Setup(wheel_sensor=WheelSensor.HALL, wheel_pulses=2 * PULSES))
    assert pilot.arm().mode == BoardMode.ARMED
    seen = pilot.drive(2.5)
    assert seen.mode == BoardMode.DISARMED, "half the speed is not the speed of the throttle"
    assert pilot.wheels().stuck_rpm == pytest.approx(1250, abs=30)


def test_telemetry_is_within_its_quantum_over_random_profiles(native_bench: Bench) -> None:
    pilot = telemetry_rules.ready(native_bench)
    back = round(telemetry_rules.LATEST_S / CYCLE_S)
    for slowest, fastest in profile(pilot, 5, back):
        rpm = np.array(pilot.wheels().wheel_rpm)
        assert (rpm >= slowest - QUANTUM_RPM - 1.0).all()
        assert (rpm <= fastest + 1.0).all()


def noisy(pilot: FirmwareHost, data: bytes, *, broken: bool = False) -> int:
    """Send bytes instead of telemetry every 30 ms for a second; return the measured wheels."""
    measured = 0
    for _ in range(33):
        pilot.simulation.board.send_telemetry(0, data, broken=broken)
        pilot.simulation.run(0.03)
        measured |= pilot.wheels().wheel_measured
    return measured


def test_what_is_not_telemetry_is_no_speed(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready(TELEMETRY)
    whole = packet(2500.0 * POLE_PAIRS, 12.0)
    assert noisy(pilot, bytes(10)) == 0, "of zeros, the sum is correct"
    assert noisy(pilot, whole, broken=True) == 0
    assert noisy(pilot, whole[:9]) == 0
    assert noisy(pilot, b"\x00" + whole) == 0
    random = np.random.default_rng(6)
    for _ in range(20):
        assert noisy(pilot, random.bytes(10)) == 0
    assert noisy(pilot, whole) == 1


def test_other_numbers_of_pole_pairs_are_other_speeds(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready(TELEMETRY)
    assert noisy(pilot, packet(42_000.0, 12.0)) == 1
    assert pilot.wheels().wheel_rpm[0] == 6000
    one = Setup(wheel_sensor=WheelSensor.TELEMETRY, wheel_pulses=1)
    assert pilot.set_up(one) == 0
    noisy(pilot, packet(6_553_500.0, 12.0))
    assert pilot.wheels().wheel_rpm[0] == 65535


def test_a_late_main_loop_and_a_flood_of_bytes_are_no_wrong_speed(native_bench: Bench) -> None:
    pilot = telemetry_rules.driving(native_bench)
    for wheel in range(3):
        pilot.simulation.board.send_telemetry(wheel, bytes(range(256)))
    pilot.simulation.board.keep_busy(0.03)
    pilot.simulation.run(0.04)
    for _ in range(20):
        pilot.cycle(1, (2414, 2411, 2417))
        telemetry_rules.assert_true(pilot, pilot.wheels(), 30.0)
    assert pilot.wheels().wheel_measured == 7


def test_the_sensor_may_be_changed(native_bench: Bench) -> None:
    pilot = telemetry_rules.ready(native_bench)
    pilot.simulation.run(0.2)
    assert pilot.wheels().wheel_measured == 7
    assert pilot.set_up(SENSORS) == 0
    pilot.simulation.run(0.2)
    assert pilot.wheels().wheel_measured == 0
    assert pilot.set_up(TELEMETRY) == 0
    pilot.simulation.run(0.2)
    assert pilot.wheels().wheel_measured == 7


def test_a_mega_does_not_accept_telemetry(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    assert pilot.set_up(TELEMETRY) == 4
    assert pilot.set_up(SENSORS) == 0
