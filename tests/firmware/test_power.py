"""Voltages that the board measures, and what it decides by them, up to the last millivolt.

Here without the chip: its simulation has no sampling capacitor. `make mutants` runs these too.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.support.firmware_host import CRUISE, HOLD_S, Bench, FirmwareHost, number
from tsd_twin.hardware.dynamixel.control_table import BoardMode, Refusal, Setup, Trip

DIVIDER, FULL_SCALE, SUPPLY_MV = 4, 1023, 5000
BANDGAP = 1100 * 1024 // SUPPLY_MV
"""Reading of the bandgap by the converter."""
MEASURED_S = 0.055
"""After this a voltage that changed has been measured as a whole."""
BATTERY, DRIVE = 0, 1


def millivolts(value: int, bandgap_mv: int) -> int:
    """Voltage that the board makes of a number of the converter."""
    supply_mv = bandgap_mv * FULL_SCALE // BANDGAP
    return value * supply_mv * DIVIDER // FULL_SCALE


def drive_is_on(pilot: FirmwareHost, battery: int, drive: int) -> bool:
    """Put numbers of the converter at both inputs, and let the board measure them."""
    for channel, value in ((BATTERY, battery), (DRIVE, drive)):
        pilot.simulation.inputs_v[channel] = math.ceil(value * SUPPLY_MV / 1024) / 1000.0
    pilot.simulation.run(MEASURED_S)
    return bool(number(pilot, "drive_on"))


def test_voltages_are_those_of_the_inputs(native_bench: Bench) -> None:
    random = np.random.default_rng(1)
    for bandgap_mv in (1000, 1100, 1200):
        pilot = native_bench.pilot()
        pilot.get_ready(Setup(bandgap_mv=bandgap_mv))
        for _ in range(12):
            battery, drive = random.integers(0, 1024, 2).tolist()
            on = drive_is_on(pilot, battery, drive)
            assert number(pilot, "supply_mv", 2) == bandgap_mv * FULL_SCALE // BANDGAP
            # Four samples are added before they are divided.
            seen = (number(pilot, "battery_mv", 2), number(pilot, "drive_mv", 2))
            expected = (millivolts(battery, bandgap_mv), millivolts(drive, bandgap_mv))
            assert seen == pytest.approx(expected, abs=1)
            assert on == (seen[1] >= 5000 and seen[1] // 3 >= seen[0] // 4)


def test_the_drive_is_on_from_5_v_on(native_bench: Bench) -> None:
    exact = [
        (bandgap_mv, value)
        for bandgap_mv in range(1000, 1201)
        for value in range(200, 300)
        if millivolts(value, bandgap_mv) == 5000
    ]
    bandgap_mv, value = exact[0]
    pilot = native_bench.pilot()
    pilot.get_ready(Setup(bandgap_mv=bandgap_mv))
    assert drive_is_on(pilot, value, value)
    assert number(pilot, "drive_mv", 2) == 5000
    assert not drive_is_on(pilot, value - 1, value - 1)
    assert not drive_is_on(pilot, 0, 0), "with nothing connected"
    assert not drive_is_on(pilot, 0, value - 1)


def test_the_drive_is_on_from_three_quarters_of_the_battery_on(native_bench: Bench) -> None:
    exact = [
        (drive, battery)
        for battery in range(500, 700)
        for drive in range(350, 550)
        if millivolts(drive, 1100) // 3 == millivolts(battery, 1100) // 4
    ]
    drive, battery = exact[0]
    pilot = native_bench.pilot()
    pilot.get_ready()
    assert drive_is_on(pilot, battery, drive)
    assert not drive_is_on(pilot, battery, drive - 1)


def test_an_input_without_its_wire_reads_nothing(native_bench: Bench) -> None:
    for cut in ({BATTERY}, {DRIVE}, {BATTERY, DRIVE}):
        pilot = native_bench.pilot().get_ready()
        pilot.simulation.inputs_v = dict.fromkeys(cut)
        pilot.simulation.run(MEASURED_S)
        seen = pilot.telemetry()
        assert seen.battery_mv == (0 if BATTERY in cut else pytest.approx(12000, abs=60))
        assert seen.drive_mv == (0 if DRIVE in cut else pytest.approx(12000, abs=60))
        assert seen.drive_on == (DRIVE not in cut)


def test_a_board_that_does_not_measure_its_supply_has_no_power(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    pilot.simulation.board.set_supply(2000.0)  # The bandgap is less than one step of it.
    pilot.simulation.run(MEASURED_S)
    seen = pilot.telemetry()
    assert (seen.supply_mv, seen.drive_mv, seen.battery_mv, seen.drive_on) == (0, 0, 0, 0)


def test_voltages_are_measured_within_24_ms(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    random = np.random.default_rng(3)
    for volts in (11.0, 12.0, 10.5, 12.5):
        pilot.simulation.run(random.uniform(0.0, 0.03))
        pilot.simulation.set_battery(volts)
        pilot.simulation.run(2 * 0.024 + 0.002)
        assert number(pilot, "battery_mv", 2) == pytest.approx(1000.0 * volts, abs=60)


def test_a_battery_is_high_enough_from_its_threshold_on(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    measured_mv = number(pilot, "battery_mv", 2)
    for arm_mv, refusal in ((measured_mv + 1, Refusal.BATTERY), (measured_mv, Refusal.NONE)):
        assert pilot.set_up(Setup(battery_arm_mv=arm_mv)) == 0
        pilot.simulation.run(HOLD_S)
        assert pilot.arm().refusal == refusal
    assert pilot.mode() == BoardMode.ARMED


def test_a_battery_is_empty_after_a_second_below_its_threshold(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    measured_mv = number(pilot, "battery_mv", 2)
    assert pilot.set_up(Setup(battery_stop_mv=measured_mv)) == 0
    pilot.simulation.run(HOLD_S)
    assert pilot.arm().mode == BoardMode.ARMED
    assert pilot.drive(1.2).mode == BoardMode.ARMED, "at the threshold"
    pilot.simulation.set_battery(11.9)
    low_ms = 0
    while number(pilot, "mode") == BoardMode.ARMED:
        pilot.simulation.board.send(pilot.command(1, CRUISE))
        for _ in range(10):
            pilot.simulation.run(0.001)
            if not low_ms and number(pilot, "battery_mv", 2) < measured_mv:
                low_ms = number(pilot, "millis", 4)
            if number(pilot, "mode") != BoardMode.ARMED:
                break
        assert number(pilot, "millis", 4) < 20000
    assert number(pilot, "trip") == Trip.BATTERY
    assert number(pilot, "millis", 4) - low_ms == pytest.approx(1000, abs=1)


def test_the_stop_is_proven_by_a_drive_without_power_beside_a_battery(native_bench: Bench) -> None:
    exact = next(
        (bandgap_mv, value)
        for bandgap_mv in range(1000, 1201)
        for value in range(200, 300)
        if millivolts(value, bandgap_mv) == 5000
    )
    bandgap_mv, value = exact
    for battery, drive, proven in (
        (value, value, 0),
        (value - 1, 0, 0),
        (value, value - 1, 1),
    ):
        pilot = native_bench.pilot()
        pilot.get_ready(Setup(bandgap_mv=bandgap_mv))
        drive_is_on(pilot, value, value)
        pilot.simulation.board.reset(power=True)
        drive_is_on(pilot, battery, drive)
        assert number(pilot, "stop_proven") == proven, (battery, drive)
