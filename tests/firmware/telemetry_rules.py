"""Rules of the firmware for wheel speeds from the telemetry of the speed controllers.

The chip of the Mega does not have them: `HAL_TELEMETRY`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from firmware.simulator.esc_telemetry import crc8
from tests.firmware.wheel_rules import SPUN_UP_S, spun_up, true_rpm
from tests.support.firmware_host import CRUISE, HOLD_S, Bench, FirmwareHost
from tsd_twin.hardware.dynamixel.control_table import BoardMode, Setup, Trip, Wheels, WheelSensor

POLE_PAIRS = 7
QUANTUM_RPM = 100.0 / POLE_PAIRS
TELEMETRY = Setup(wheel_sensor=WheelSensor.TELEMETRY, wheel_pulses=POLE_PAIRS)
LATEST_S = 0.08
"""Maximum age of a speed: two packets, 30 to 34 ms apart, and a cycle of the PC."""


def ready(bench: Bench, setup: Setup = TELEMETRY) -> FirmwareHost:
    return bench.pilot(pole_pairs=POLE_PAIRS).get_ready(setup)


def driving(bench: Bench) -> FirmwareHost:
    """Drive, with wheels at cruising speed."""
    return spun_up(ready(bench))


def assert_true(pilot: FirmwareHost, wheels: Wheels, margin_rpm: float = 10.0) -> None:
    error = true_rpm(pilot) - wheels.wheel_rpm
    assert (error > -margin_rpm).all(), error
    assert (error < QUANTUM_RPM + margin_rpm).all(), error


def telemetry_is_the_speed_of_the_wheels(bench: Bench) -> None:
    pilot = ready(bench)
    assert pilot.arm().mode == BoardMode.ARMED
    for throttle in (CRUISE, (2700, 2900, 3300)):
        assert pilot.drive(SPUN_UP_S, throttle=throttle).mode == BoardMode.ARMED
        seen = pilot.wheels()
        assert_true(pilot, seen)
        assert seen.wheel_measured == 0b111
        assert max(seen.wheel_age) <= 40
    pilot.cycle(0)
    pilot.simulation.run(2.0 * HOLD_S)
    seen = pilot.wheels()
    assert (seen.wheel_measured, seen.wheel_rpm) == (7, (0, 0, 0))


def a_wheel_with_telemetry_that_does_not_follow_stops(bench: Bench) -> None:
    pilot = driving(bench)
    pilot.simulation.plant.stuck.add(1)
    assert pilot.drive(0.25).mode == BoardMode.ARMED
    seen, wheels = pilot.drive(0.35), pilot.wheels()
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.WHEEL)
    assert wheels.wheel_stuck == 2
    assert wheels.stuck_rpm < 1500 < 2400 < wheels.stuck_wanted_rpm < 2600


def telemetry_that_falls_silent_is_no_speed_and_stops(bench: Bench) -> None:
    pilot = driving(bench)
    pilot.simulation.sensor_wheels[0] = None
    assert pilot.drive(0.22).mode == BoardMode.ARMED
    seen = pilot.wheels()
    assert (seen.wheel_measured, seen.wheel_rpm[0], seen.wheel_age[0]) == (0b110, 0, 255)
    assert pilot.drive(0.38).trip == Trip.WHEEL
    assert pilot.wheels().wheel_stuck == 1


def telemetry_that_was_never_received_does_not_stop(bench: Bench) -> None:
    pilot = bench.pilot(pole_pairs=POLE_PAIRS)
    pilot.simulation.sensor_wheels[1] = None
    pilot.get_ready(TELEMETRY)
    assert pilot.arm().mode == BoardMode.ARMED
    assert pilot.drive(3.0).mode == BoardMode.ARMED
    seen = pilot.wheels()
    assert (seen.wheel_measured, seen.wheel_rpm[1], seen.wheel_age[1]) == (0b101, 0, 255)


def wheels_without_power_have_no_speed_instead_of_a_wrong_one(bench: Bench) -> None:
    pilot = driving(bench)
    pilot.simulation.set_contactor(closed=False)
    pilot.drive(0.3)
    assert min(true_rpm(pilot)) > 100.0, "they run down"
    assert pilot.wheels().wheel_measured == 0


def broken_telemetry_is_no_wrong_speed(bench: Bench) -> None:
    """Also one of 256 random packets, whose sum is correct."""
    pilot, random = driving(bench), np.random.default_rng(4)
    packets = 0

    def change(data: bytes) -> bytes:
        nonlocal packets
        packets += 1
        noise = random.bytes(random.integers(1, 30))
        at = random.integers(10)
        match packets % 16:
            case 3:
                return data[:at]
            case 6:
                return data[:at] + random.bytes(1) + data[at + 1 :]
            case 9:
                return noise + data
            case 12:
                wrong = data[:7] + random.bytes(2)
                return wrong + bytes([crc8(wrong)])
            case 15:
                return random.bytes(10)
            case _:
                return data

    pilot.simulation.telemetry[1].change = change
    heard = 0
    for _ in range(200):
        assert pilot.cycle(1, CRUISE).mode == BoardMode.ARMED  # type: ignore[union-attr]
        seen = pilot.wheels()
        heard += seen.wheel_measured >> 1 & 1
        if seen.wheel_measured == 0b111:
            assert_true(pilot, seen, 30.0)
    assert heard == 200


Law = Callable[[Bench], None]
LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        telemetry_is_the_speed_of_the_wheels,
        a_wheel_with_telemetry_that_does_not_follow_stops,
        telemetry_that_falls_silent_is_no_speed_and_stops,
        telemetry_that_was_never_received_does_not_stop,
        wheels_without_power_have_no_speed_instead_of_a_wrong_one,
        broken_telemetry_is_no_wrong_speed,
    )
}
