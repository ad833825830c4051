"""Rules of the firmware for wheels with speed sensors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.firmware.source_rules import Source, ask, drive, driven_by, has_robot
from tests.support.firmware_host import CRUISE, HOLD_S, ZERO, Bench, FirmwareHost
from tsd_twin.hardware.dynamixel.control_table import BoardMode, Setup, Trip, Wheels, WheelSensor

PULSES = 4
"""Per turn."""
SENSORS = Setup(wheel_sensor=WheelSensor.HALL, wheel_pulses=PULSES)
_RPM = 30.0 / np.pi
SPUN_UP_S = 2.0
FOUND_S = 0.55
"""A wheel without drive has become too slow, and was for 0.3 s."""


def ready(bench: Bench, setup: Setup = SENSORS) -> FirmwareHost:
    return bench.pilot(wheel_pulses=PULSES).get_ready(setup)


def driving(bench: Bench) -> FirmwareHost:
    """Drive, with wheels at cruising speed."""
    return spun_up(ready(bench))


def spun_up(pilot: FirmwareHost) -> FirmwareHost:
    assert pilot.arm().mode == BoardMode.ARMED
    assert pilot.drive(SPUN_UP_S).mode == BoardMode.ARMED
    return pilot


def true_rpm(pilot: FirmwareHost) -> np.ndarray:
    return pilot.simulation.plant.wheel_speeds * _RPM


def speeds_of_the_wheels_are_measured(bench: Bench) -> None:
    pilot = ready(bench)
    assert pilot.wheels() == Wheels()
    assert pilot.arm().mode == BoardMode.ARMED
    for throttle in (CRUISE, (2700, 2900, 3300)):
        assert pilot.drive(SPUN_UP_S, throttle=throttle).mode == BoardMode.ARMED
        seen = pilot.wheels()
        assert (np.abs(seen.wheel_rpm / true_rpm(pilot) - 1.0) < 0.015).all(), seen
        assert seen.wheel_measured == 0b111
        assert max(seen.wheel_age) <= 5
    pilot.cycle(0)
    pilot.simulation.run(2.0 * HOLD_S)
    seen = pilot.wheels()
    assert (seen.wheel_measured, seen.wheel_rpm, seen.wheel_age) == (7, (0, 0, 0), (255,) * 3)


def a_wheel_that_does_not_follow_stops(bench: Bench) -> None:
    for source in Source:
        pilot = driven_by(source, _WithSensors(bench), SENSORS)
        assert has_robot(drive(pilot, source, SPUN_UP_S), source)
        pilot.simulation.plant.stuck.add(1)
        assert has_robot(drive(pilot, source, 0.25), source), "it may be disturbed for a moment"
        seen, wheels = drive(pilot, source, FOUND_S - 0.25), pilot.wheels()
        assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.WHEEL)
        assert wheels.wheel_stuck == 2
        assert wheels.stuck_rpm < 1500 < 2400 < wheels.stuck_wanted_rpm < 2600
        pilot.simulation.plant.stuck.clear()
        pilot.simulation.run(HOLD_S)
        if source is Source.PC:
            assert has_robot(ask(pilot, source), source)
            assert has_robot(drive(pilot, source, 0.1), source)


class _WithSensors(Bench):
    """A bench whose robots have wheel sensors."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    def pilot(self, version: int = 2, **more: object) -> FirmwareHost:  # type: ignore[override]
        return self._bench.pilot(version, wheel_pulses=PULSES, **more)


def a_wheel_that_is_slow_from_the_beginning_stops(bench: Bench) -> None:
    pilot = driving(bench)
    pilot.cycle(0)
    pilot.simulation.run(HOLD_S)
    pilot.simulation.plant.stuck.add(2)
    assert pilot.arm().mode == BoardMode.ARMED
    seen = pilot.drive(2.5)
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.WHEEL)
    assert pilot.wheels().wheel_stuck == 3


def changes_of_speed_are_followed_without_a_trip(bench: Bench) -> None:
    pilot, random = ready(bench), np.random.default_rng(2)
    assert pilot.arm().mode == BoardMode.ARMED
    for _ in range(6):
        throttle = random.integers(2350, 4000, 3).tolist()
        for some in (throttle, throttle, ZERO) if random.random() < 0.3 else (throttle,):
            seen = pilot.drive(float(random.uniform(0.2, 1.2)), throttle=some)
            assert (seen.mode, seen.trip) == (BoardMode.ARMED, Trip.NONE), some
    pilot.cycle(0)
    pilot.simulation.run(HOLD_S)  # Wheels that run down are not too fast.
    assert pilot.arm().mode == BoardMode.ARMED
    assert pilot.drive(1.0).mode == BoardMode.ARMED


def a_sensor_that_never_sent_a_pulse_does_not_stop(bench: Bench) -> None:
    pilot = ready(bench)
    pilot.simulation.sensor_wheels[1] = None
    assert pilot.arm().mode == BoardMode.ARMED
    assert pilot.drive(3.0).mode == BoardMode.ARMED
    seen = pilot.wheels()
    assert (seen.wheel_measured, seen.wheel_rpm[1], seen.wheel_age[1]) == (0b101, 0, 255)


def a_sensor_that_falls_silent_stops(bench: Bench) -> None:
    pilot = driving(bench)
    pilot.simulation.sensor_wheels[0] = None
    seen = pilot.drive(0.6)
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.WHEEL)
    assert pilot.wheels().wheel_stuck == 1


def swapped_sensors_stop_at_different_speeds(bench: Bench) -> None:
    pilot = driving(bench)
    pilot.simulation.sensor_wheels[:] = [1, 0, 2]
    assert pilot.drive(0.5).mode == BoardMode.ARMED, "the wheels have the same speed"
    seen = pilot.drive(2.0, throttle=(3600, CRUISE[1], CRUISE[2]))
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.WHEEL)
    assert pilot.wheels().wheel_stuck in (1, 2)


def a_wheel_that_is_too_fast_stops(bench: Bench) -> None:
    pilot = driving(bench)
    pilot.simulation.sensor_wheels[0] = 1
    seen = pilot.drive(2.5, throttle=(CRUISE[0], 3600, CRUISE[2]))
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.WHEEL)
    wheels = pilot.wheels()
    assert (wheels.wheel_stuck, wheels.stuck_wanted_rpm) == (1, 2501)


def a_motor_may_stand_below_its_starting_speed(bench: Bench) -> None:
    pilot = driving(bench)
    assert pilot.drive(3.0, throttle=(2340, 2340, 2340)).mode == BoardMode.ARMED
    assert max(true_rpm(pilot)) < 10.0


def wheels_may_run_down_when_the_radio_control_takes_over(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True, wheel_pulses=PULSES).get_ready(SENSORS)
    assert pilot.arm().mode == BoardMode.ARMED
    tilted = (0, 300, 0, -300, 0, 0)
    assert pilot.drive(SPUN_UP_S, throttle=(4000,) * 3, goal=tilted).mode == BoardMode.ARMED
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.08)
    assert pilot.mode() == BoardMode.DISARMED, "it waits until the gimbals are upright"
    pilot.simulation.run(0.4)
    for _ in range(20):
        pilot.simulation.run(0.1)
        seen = pilot.telemetry()
        assert (seen.mode, seen.trip) == (BoardMode.RC, Trip.NONE)


def without_sensors_in_the_setup_nothing_is_measured(bench: Bench) -> None:
    pilot = driving(bench)
    pilot.cycle(0)
    pilot.simulation.run(HOLD_S)
    assert pilot.set_up(Setup()) == 0
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.simulation.plant.stuck.add(1)
    assert pilot.drive(2.0).mode == BoardMode.ARMED
    assert pilot.wheels() == Wheels()


Law = Callable[[Bench], None]
LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        speeds_of_the_wheels_are_measured,
        a_wheel_that_does_not_follow_stops,
        a_wheel_that_is_slow_from_the_beginning_stops,
        changes_of_speed_are_followed_without_a_trip,
        a_sensor_that_never_sent_a_pulse_does_not_stop,
        a_sensor_that_falls_silent_stops,
        swapped_sensors_stop_at_different_speeds,
        a_wheel_that_is_too_fast_stops,
        a_motor_may_stand_below_its_starting_speed,
        wheels_may_run_down_when_the_radio_control_takes_over,
        without_sensors_in_the_setup_nothing_is_measured,
    )
}
