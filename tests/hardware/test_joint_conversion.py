"""Conversion between joints and values on the wire."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.errors import RobotFileError
from tsd_twin.hardware.joints import JointCommand, JointConverter, padded
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, because
from tsd_twin.safety import Heartbeat
from tsd_twin.simulation import Motors

ROBOT = robots.description_of_kind(robots.load_robot("tsd"), robots.SingularityDescription)
JOINTS = JointConverter(ROBOT, Motors.of(ROBOT))
STEP_RAD = 2 * np.pi / 4096
ANGLES = st.lists(st.floats(-0.5, 0.5), min_size=6, max_size=6)


def setpoint(angles: list[float], speed_rpm: float = 0.0) -> Array:
    """The nine joints of the robot: alpha, beta and wheel of each module."""
    joints = np.full(9, speed_rpm * np.pi / 30)
    joints[[0, 1, 3, 4, 6, 7]] = angles
    return joints


@given(ANGLES)
def test_goals_are_the_nearest_steps_within_the_tilt_limit(angles: list[float]) -> None:
    expected = np.clip(np.round(np.array(angles) / STEP_RAD), -341, 341)
    assert JOINTS.goals(setpoint(angles)) == tuple(expected)
    assert JOINTS.goal_limit == 341  # 30 degrees of 4096 / 360 steps each


@given(ANGLES, st.integers(0, 63))
def test_measured_angles_are_those_of_the_goals_where_servos_live(
    angles: list[float], alive: int
) -> None:
    measured = JOINTS.measured(JOINTS.goals(setpoint(angles)), alive)
    lives = np.array([bool(alive >> i & 1) for i in range(6)])
    gimbals = measured[[0, 1, 3, 4, 6, 7]]
    assert np.isnan(measured[[2, 5, 8]]).all()
    assert np.isnan(gimbals[~lives]).all()
    np.testing.assert_allclose(gimbals[lives], np.array(angles)[lives], atol=STEP_RAD / 2 + 1e-9)


def test_throttles_follow_the_table_of_the_thesis() -> None:
    """Table 1: signal 60 turns the motors at 4137, 4762 and 4322 rpm; 60 / 180 is 1333 us."""
    joints = setpoint([0.0] * 6)
    joints[[2, 5, 8]] = np.array([4137, 4762, 4322]) * np.pi / 30
    assert JOINTS.throttles(joints) == (2667, 2667, 2667)
    assert JOINTS.throttles(setpoint([0.0] * 6)) == (2000, 2000, 2000)
    assert JOINTS.throttles(setpoint([0.0] * 6, 1e6)) == (4000, 4000, 4000)


@given(rpm=st.floats(2000.0, 13409.0))
def test_each_motor_gets_the_pulse_for_the_drive_speed_by_its_own_curve(rpm: float) -> None:
    """Table 1, column by column, whatever speed is chosen; the pulse is a step of half a us."""
    table = {
        0: [0, 0, 2892, 4137, 5895, 7264, 8419, 10113, 11927, 13603],
        1: [0, 0, 2938, 4762, 5768, 7019, 9016, 10205, 11898, 13445],
        2: [0, 0, 2856, 4322, 6147, 7121, 8804, 10353, 11785, 13409],
    }
    pulses = JOINTS.throttles(setpoint([0.0] * 6, rpm))
    for motor, pulse in enumerate(pulses):
        signal = (pulse / 2.0 - 1000.0) * 180.0 / 1000.0
        turns = np.interp(signal, np.arange(0, 181, 20), table[motor])
        # The steepest of these curves rises by 147 rpm for a unit of the signal.
        assert turns == pytest.approx(rpm, abs=0.5 * 0.09 * 147 + 0.1)


def test_a_calibration_is_taken_off_goals_and_throttles_and_put_onto_what_is_measured() -> None:
    """At goal zero, module 1 is off by 1 degree, 11.4 steps; wheel 2 turns 10 % too fast."""
    text = robots.read_description("tsd") + (
        "\n[calibration]\ntilt_offset_deg = [[1.0, -2.0], [0.0, 0.0], [0.0, 0.5]]\n"
        "spin_scale = [1.0, 1.1, 1.0]\n"
    )
    robot = robots.description_of_kind(
        robots.parse_description(text, "mine"), robots.SingularityDescription
    )
    joints = JointConverter(robot, Motors.of(robot))
    assert joints.goals(setpoint([0.0] * 6)) == (-11, 23, 0, 0, 0, -6)
    measured = joints.measured((-11, 23, 0, 0, 0, -6), 63)[[0, 1, 3, 4, 6, 7]]
    np.testing.assert_allclose(measured, 0.0, atol=STEP_RAD / 2)
    np.testing.assert_allclose(
        np.degrees(joints.measured((0,) * 6, 63)[[0, 1, 3, 4, 6, 7]]), [1, -2, 0, 0, 0, 0.5]
    )
    told = setpoint([0.0] * 6)
    told[[2, 5, 8]] = np.array([4137, 4762 * 1.1, 4322]) * np.pi / 30
    assert joints.throttles(told) == (2667, 2667, 2667)
    assert joints.throttles(setpoint([0.0] * 6)) == (2000, 2000, 2000)


def test_a_gimbal_whose_servo_stands_beside_it_tilts_as_far_as_any_and_no_further() -> None:
    """Cut off at 30 degrees of the servo it would stay 3 away, which is a fault."""
    found = "\n[calibration]\ntilt_offset_deg = [[3.0, 0.0], [-3.0, 0.0], [0.0, 0.0]]\n"
    robot = robots.description_of_kind(
        robots.parse_description(robots.read_description("tsd") + found, "mine"),
        robots.SingularityDescription,
    )
    joints = JointConverter(robot, Motors.of(robot))
    assert joints.goal_limit == 375  # 33 degrees
    for way in (-1.0, 1.0):
        for wanted_deg in (29.9, 40.0):
            goals = joints.goals(setpoint([np.radians(way * wanted_deg)] * 6))
            assert max(map(abs, goals)) <= joints.goal_limit
            tilts = np.degrees(joints.measured(goals, 63)[[0, 1, 3, 4, 6, 7]])
            np.testing.assert_allclose(tilts, way * min(wanted_deg, 30.0), atol=0.1)
            assert np.abs(tilts).max() <= 30.0 + 1e-9


@pytest.mark.parametrize("bad", [np.zeros(8), np.full(9, np.nan), np.full(9, np.inf)])
def test_what_is_no_set_point_is_refused(bad: Array) -> None:
    with pytest.raises(ValueError, match="9 finite numbers"):
        JointCommand.checked(bad, JOINTS.count, Heartbeat(True, 0), 0.0)


def test_a_set_point_that_is_kept_is_a_copy() -> None:
    given_one = np.zeros(9)
    kept = JointCommand.checked(given_one, JOINTS.count, Heartbeat(True, 0), 0.0).setpoint
    given_one[0] = 1.0
    assert not kept.any()


def test_a_robot_with_too_many_joints_is_refused() -> None:
    text = robots.read_description("tsd").replace(
        "[90.0, 210.0, 330.0]", "[45.0, 135.0, 225.0, 315.0]"
    )
    row = "  [0, 0, 2892, 4137, 5895, 7264, 8419, 10113, 11927, 13603],\n"
    four = robots.description_of_kind(
        robots.parse_description(text.replace(row, 2 * row), "four"), robots.SingularityDescription
    )
    with pytest.raises(HardwareError, match="8 gimbals and 4 wheels, the board has 6 servos and 3"):
        JointConverter(four, Motors.of(four))


def test_servos_are_named_by_number_and_joint() -> None:
    assert JOINTS.named(0b000100) == "3 (module2_alpha)"
    assert JOINTS.named(0b100001) == "1 (module1_alpha), 6 (module3_beta)"


def test_what_the_robot_does_not_have_is_filled_up() -> None:
    assert padded((1, 2), 4, 7) == (1, 2, 7, 7)


def test_silent_servos_are_named_and_all_of_them_are_the_bus() -> None:
    joints = JointConverter(ROBOT, Motors.of(ROBOT))
    assert joints.silent(8) == because(Code.SERVOS_SILENT, servos="4 (module2_beta)")
    assert joints.silent(63) == because(Code.ALL_SERVOS_SILENT)
    several = "5 (module3_alpha), 6 (module3_beta)"
    assert joints.silent(0b110000) == because(Code.SERVO_BUS_SILENT, servos=several)


@pytest.mark.parametrize("neutral_us", [1100.0, 1500.0])
def test_speed_controllers_that_run_both_ways_are_refused(neutral_us: float) -> None:
    motors = replace(Motors.of(ROBOT), pulses_us=(neutral_us, 2000.0))
    with pytest.raises(HardwareError, match=f"tsd has zero throttle at {neutral_us:g} us"):
        JointConverter(ROBOT, motors)


def test_the_throttle_limit_is_that_of_the_fastest_speed_that_can_be_selected() -> None:
    text = robots.read_description("tsd").replace(
        "cruise_speed_rpm = 2500.0", "cruise_speed_rpm = 2500.0\nmax_speed_rpm = 5000.0"
    )
    slow = robots.description_of_kind(
        robots.parse_description(text, "slow"), robots.SingularityDescription
    )
    joints = JointConverter(slow, Motors.of(slow))
    speeds = np.zeros(9)
    speeds[2::3] = 5000.0 * robots.RPM
    assert joints.throttle_limit == joints.throttles(speeds)
    assert 2700 < max(joints.throttle_limit) < 2900
    assert joints.throttle_rise == pytest.approx((max(joints.throttle_limit) - 2000) / 25, abs=1.0)
    refused = text.replace("max_speed_rpm = 5000.0", "max_speed_rpm = 2000.0")
    with pytest.raises(RobotFileError, match=r"drive\.max_speed_rpm is 2000"):
        robots.parse_description(refused, "slow")
