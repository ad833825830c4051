"""Wheel speeds measured by the compiled firmware, through `tsd-bridge` to an operator."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np
import pytest

from tests.app.bridge_machine import Machine, wait_for_mode, wait_until
from tests.support.programs import Program
from tsd_twin.lie import Array

pytestmark = [pytest.mark.system, pytest.mark.busy]


@pytest.fixture
def machine(start: Callable[..., Program], tmp_path: Path) -> Generator[Machine]:
    made = Machine(start, tmp_path, wheel_pulses=4)
    yield made
    made.close()


def place(machine: Machine) -> Array:
    """Return the true position (2,) of the robot in the box, m."""
    return np.array(machine.box.show()["pose"][:2])


def positions_at_rest(machine: Machine) -> tuple[Array, Array]:
    """Return the true and the estimated position (2,), m, after the robot has come to rest.

    The stick is held at its centre. While the robot moves, the two are read at different times.
    """
    before: list[Array] = []

    def rest() -> bool:
        before.append(np.r_[place(machine), machine.pilot.odom.xy_heading[:2]])
        return len(before) > 10 and float(np.ptp(before[-10:], axis=0).max()) < 1e-4

    machine.stand(until=rest)
    return before[-1][:2], before[-1][2:]


def test_measured_speeds_arrive_and_a_jammed_wheel_stops_by_name(machine: Machine) -> None:
    machine.get_ready()

    def arrive() -> bool:
        true = [30.0 / math.pi * speed for speed in machine.box.show()["wheels_rad_per_s"]]
        wheels = machine.hardware["wheels"]
        return all(wheels["measured"]) and wheels["rpm"] == pytest.approx(true, rel=0.02)

    wait_until(arrive, "the speeds of the wheels")
    assert not any("sensor" in text for text in machine.hardware["warnings"])
    machine.drive()
    machine.box.tell("jam 2")
    machine.hold_until(lambda: machine.mode == "fault")
    assert machine.reason.startswith("module2_wheel does not follow: it turns at "), machine.reason
    wait_until(lambda: machine.box.shut_off, "zero throttle")
    machine.box.tell("loosen 2")
    machine.get_ready()


def test_a_sensor_without_pulses_is_replaced_by_the_curve_of_the_motor(machine: Machine) -> None:
    machine.box.tell("sensor 3 off")
    machine.drive()
    wait_until(lambda: machine.hardware["wheels"]["measured"] == [True, True, False], "two sensors")
    assert any("speed sensor of module3_wheel" in text for text in machine.hardware["warnings"])
    wait_for_mode(machine, "ready")
    assert 2300.0 < machine.pilot.status.wheel_speed.spin_rpm < 2700.0


def switch_sensors(machine: Machine, word: str) -> None:
    for number in (1, 2, 3):
        machine.box.tell(f"sensor {number} {word}")


def test_the_estimated_motion_follows_the_measured_speeds(
    start: Callable[..., Program], tmp_path: Path
) -> None:
    """With five pulses in the file and four at the wheel, all speeds are measured 20 % too low.

    With such speeds it would not arm, so the sensors begin afterwards.
    """
    machine = Machine(start, tmp_path, wheel_pulses=4, described_pulses=5)
    try:
        switch_sensors(machine, "off")
        machine.get_ready()
        switch_sensors(machine, "on")
        wait_until(lambda: all(machine.hardware["wheels"]["measured"]), "the speeds of the wheels")
        true, estimated = positions_at_rest(machine)
        machine.drive(until=lambda: np.hypot(*(place(machine) - true)) > 0.5)
        true_at_end, estimated_at_end = positions_at_rest(machine)
        rpm = 30.0 / math.pi * np.mean(machine.box.show()["wheels_rad_per_s"])
        assert machine.pilot.status.wheel_speed.spin_rpm == pytest.approx(0.8 * rpm, rel=0.02)
        went_m = np.hypot(*(estimated_at_end - estimated))
        assert went_m == pytest.approx(0.8 * np.hypot(*(true_at_end - true)), rel=0.1)
    finally:
        machine.close()
