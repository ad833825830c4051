"""Wheel speeds that the board measures: joints, fault, status and the robot file."""

from __future__ import annotations

import math
import time
from collections.abc import Generator

import msgspec
import numpy as np
import pytest

from tests.hardware.test_mega import PORT, ROBOT, Bench, bench, plugged, refused
from tests.hardware.wired_machines import Wires
from tests.support.pty_devices import PretendBoard, ServoChain
from tsd_twin.hardware.arduino_mega import ArduinoMegaIO
from tsd_twin.hardware.dynamixel.control_table import BoardMode, Trip, Wheels
from tsd_twin.hardware.u2d2 import U2D2IO
from tsd_twin.messages.codes import Code, because
from tsd_twin.robots import RPM
from tsd_twin.robots.singularity_parts import WheelSensor
from tsd_twin.simulation import Motors

pytestmark = pytest.mark.computes

MEASURING = msgspec.structs.replace(ROBOT, wheel_sensor=WheelSensor(pulses_per_turn=4))
WHEELS = [2, 5, 8]


@pytest.fixture
def it(wires: Wires) -> Generator[Bench]:
    with bench(wires, robot=MEASURING) as made:
        yield made


def measured(it: Bench) -> np.ndarray:
    """Return joints that the board measured after this call."""
    seen: list[np.ndarray] = []
    end_s = time.monotonic() + 10.0
    while len(seen) < 3:
        assert time.monotonic() < end_s
        it.write()
        time.sleep(0.002)
        joints = it.robot.read(time.monotonic())
        seen += [] if joints is None else [joints]
    return seen[-1]


def test_the_robot_file_sets_up_the_sensors_of_the_board(it: Bench) -> None:
    assert (it.board.setups[-1].wheel_sensor, it.board.setups[-1].wheel_pulses) == (1, 4)


TELEMETRY = msgspec.structs.replace(ROBOT, wheel_sensor=WheelSensor("telemetry", pole_pairs=7))


def test_telemetry_is_set_up_with_the_pole_pairs_and_named_if_it_is_missing(wires: Wires) -> None:
    board = PretendBoard()
    board.wheels = Wheels(wheel_measured=0b011, wheel_rpm=(2500, 2510, 0))
    with bench(wires, board, TELEMETRY) as it:
        measured(it)
        assert (board.setups[-1].wheel_sensor, board.setups[-1].wheel_pulses) == (2, 7)
        (warning,) = [text for text in it.robot.hardware()["warnings"] if "telemetry" in text]
        assert "module3_wheel" in warning


def test_a_mega_that_refuses_telemetry_is_not_used_and_the_reason_is_named(wires: Wires) -> None:
    board = PretendBoard()
    board.error = 4
    refused(wires, board, "a Mega has one free serial input for three wires", TELEMETRY)


@pytest.mark.parametrize(
    ("keys", "well"),
    [
        ("pulses_per_turn = 4", True),
        ('kind = "hall"\npulses_per_turn = 4', True),
        ('kind = "telemetry"\npole_pairs = 7', True),
        ("pole_pairs = 7", False),
        ('kind = "telemetry"', False),
        ('kind = "telemetry"\npulses_per_turn = 4', False),
        ('kind = "telemetry"\npulses_per_turn = 4\npole_pairs = 7', False),
    ],
)
def test_each_kind_of_sensor_has_its_number(keys: str, well: bool) -> None:
    if well:
        assert msgspec.toml.decode(keys, type=WheelSensor).per_turn in (4, 7)
        return
    with pytest.raises(msgspec.ValidationError, match="'telemetry' pole_pairs"):
        msgspec.toml.decode(keys, type=WheelSensor)


def test_measured_speeds_are_joints_and_unmeasured_ones_are_nan(it: Bench) -> None:
    assert np.isnan(measured(it)[WHEELS]).all()
    it.board.wheels = Wheels(0b101, (2500, 0, 2510), (7, 255, 255))
    joints = measured(it)[WHEELS]
    assert joints[[0, 2]] == pytest.approx([2500 * RPM, 2510 * RPM])
    assert math.isnan(joints[1])
    status = it.robot.hardware()
    assert status["wheels"] == {
        "measured": [True, False, True],
        "rpm": [2500, None, 2510],
        "age_ms": [7, None, None],
    }
    (warning,) = [text for text in status["warnings"] if "speed sensor" in text]
    assert "module2_wheel" in warning


def test_a_wheel_that_does_not_follow_is_named_with_its_speeds(it: Bench) -> None:
    it.arm()
    it.board.obeys_arm = False
    it.board.wheels = Wheels(
        7, (2500, 300, 2500), wheel_stuck=2, stuck_rpm=400, stuck_wanted_rpm=2501
    )
    it.board.report(mode=int(BoardMode.DISARMED), trip=int(Trip.WHEEL))
    stuck = because(Code.WHEEL_STUCK, wheel="module2_wheel", rpm=400.0, wanted_rpm=2501.0)
    it.until(lambda: it.fault == stuck, "the wheel is named", armed=True)
    it.disarm()
    it.until(lambda: it.fault is None, "it can be armed again")


@pytest.mark.parametrize(
    ("pulses", "most_rpm", "well"), [(4, None, True), (7, None, False), (7, 8500.0, True)]
)
def test_more_pulses_than_the_board_can_count_are_a_problem_of_the_file(
    pulses: int, most_rpm: float | None, well: bool
) -> None:
    drive = msgspec.structs.replace(ROBOT.drive, max_speed_rpm=most_rpm)
    sensor = WheelSensor(pulses_per_turn=pulses)
    robot = msgspec.structs.replace(ROBOT, wheel_sensor=sensor, drive=drive)
    assert [problem for problem, _ in robot.problems() if "wheel_sensor" in problem] == (
        [] if well else ["wheel_sensor.pulses_per_turn is 7, 1587 pulses per second at 13603 rpm"]
    )


def test_speeds_of_a_board_beside_servos_on_a_u2d2_are_joints_too(wires: Wires) -> None:
    chain, board, motors = ServoChain(), PretendBoard(), Motors.of(ROBOT)
    board.wheels = Wheels(wheel_measured=0b111, wheel_rpm=(2500, 2490, 2510))
    wires.plug_in("servos", chain.answer)
    with plugged(wires, board):
        wheels = ArduinoMegaIO(MEASURING, PORT, motors, servos=False)
        robot = U2D2IO(MEASURING, wheels, "servos", motors)
        try:
            end_s, joints = time.monotonic() + 10.0, None
            while joints is None or np.isnan(joints[WHEELS]).any():
                assert time.monotonic() < end_s, joints
                robot.write(np.zeros(9), time.monotonic())
                time.sleep(0.005)
                joints = robot.read(time.monotonic())
            assert joints[WHEELS] == pytest.approx([2500 * RPM, 2490 * RPM, 2510 * RPM])
        finally:
            robot.close()
