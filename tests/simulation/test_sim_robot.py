"""Interface of the simulated robot: times, setpoints, measurements, truth."""

from __future__ import annotations

import functools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin.calibration.collect import with_calibration
from tsd_twin.errors import RobotFileError
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription, description_of_kind, load_robot
from tsd_twin.simulation import SimRobot

ROBOT = load_robot("tsd")
DRIVE = ROBOT.kinematics()
STEP = 2.0 * np.pi / 4096
IDLE = np.zeros(9)
CRUISE = DRIVE.inverse(np.zeros(3))
AHEAD = DRIVE.inverse(np.array([0.5, 0.2, 1.0]))
TURN = DRIVE.inverse(np.array([0.0, -0.4, -2.0]))


def ready(at_s: float = 0.0, **options: float | bool) -> SimRobot:
    """A robot at the origin, armed and spun up by the time `at_s`."""
    robot = SimRobot(ROBOT, **options)
    robot.read(at_s - 12.0)
    robot.write(IDLE, at_s - 12.0)
    robot.write(CRUISE, at_s - 10.0)
    robot.read(at_s)
    return robot


def test_measured_angles_are_steps_and_wheel_speeds_are_not_measured() -> None:
    robot = ready(noise=1.0)
    robot.write(AHEAD, 0.0)
    for now_s in (0.013, 0.1, 0.5):
        measured = robot.read(now_s).reshape(3, 3)
        assert np.isnan(measured[:, 2]).all()
        steps = measured[:, :2] / STEP
        np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=1e-9)
        true = robot.truth(now_s).joints.reshape(3, 3)
        assert np.isfinite(true).all()
        # Half a step, and seven standard deviations of the noise.
        assert np.abs(measured[:, :2] - true[:, :2]).max() < STEP / 2 + np.radians(7 * 0.025)


def test_a_robot_with_encoders_on_its_wheels_measures_their_speed() -> None:
    robot = ready(measures_spin=True)
    np.testing.assert_allclose(robot.read(0.0)[2::3], 2500.0 * np.pi / 30.0, rtol=1e-9)


def test_the_first_call_says_what_time_it_is() -> None:
    robot = SimRobot(ROBOT)
    robot.write(AHEAD, 1e6)
    np.testing.assert_array_equal(robot.truth(1e6).joints, 0.0)


def test_time_that_goes_back_moves_nothing() -> None:
    robot, reference = ready(), ready()
    for each in (robot, reference):
        each.write(AHEAD, 0.0)
        each.read(0.2)
    before = robot.truth(0.2)
    for now_s in (0.1, -5.0):
        after = robot.truth(now_s)
        np.testing.assert_array_equal(after.joints, before.joints)
        np.testing.assert_array_equal(after.pose.xy_heading, before.pose.xy_heading)
    robot.read(0.3)
    reference.read(0.3)
    np.testing.assert_array_equal(robot.truth(0.3).joints, reference.truth(0.3).joints)


def drive_around(robot: SimRobot, reads: list[float]) -> Array:
    """Apply three commands at set times, with reads in between; return the final true pose."""
    writes = [(0.0, AHEAD), (0.3, TURN), (0.7, CRUISE)]
    for now_s in sorted({*reads, *(time for time, _ in writes)}):
        robot.read(now_s)
        for time, setpoint in writes:
            if time == now_s:
                robot.write(setpoint, now_s)
    return robot.truth(1.2).pose.xy_heading


@functools.cache
def read_each_millisecond() -> Array:
    return drive_around(ready(), [i / 1000.0 for i in range(1200)])


@pytest.mark.parametrize("period_s", [0.003, 0.0073, 0.01, 0.02, 0.1, 2.0])
def test_how_often_it_is_read_changes_nothing(period_s: float) -> None:
    """Within 10 µm of reading every millisecond."""
    reads = [i * period_s for i in range(int(1.2 / period_s))]
    end = drive_around(ready(), reads)
    np.testing.assert_allclose(end, read_each_millisecond(), rtol=0, atol=1e-5)


@settings(max_examples=25)
@given(reads=st.lists(st.floats(0.0, 1.2), max_size=60))
def test_when_it_is_read_changes_nothing(reads: list[float]) -> None:
    end = drive_around(ready(), reads)
    np.testing.assert_allclose(end, read_each_millisecond(), rtol=0, atol=1e-5)


def test_a_long_pause_is_simulated_in_full() -> None:
    """After an hour without a call, the robot has driven its circle for an hour."""
    robot = ready()
    robot.write(AHEAD, 0.0)
    start = robot.truth(60.0)
    hour_s = 3600.0
    later = robot.truth(60.0 + hour_s)
    expected = DRIVE.integrate(start.pose, start.twist, hour_s)
    assert abs(later.pose.xy_heading[2]) > 3000.0
    np.testing.assert_allclose(later.pose.xy_heading, expected.xy_heading, rtol=0, atol=1e-4)


def test_the_same_seed_is_the_same_run() -> None:
    runs = []
    for seed in (7, 7, 8):
        robot = ready(seed=seed, noise=1.0)
        robot.write(AHEAD, 0.0)
        measured = np.array([robot.read(i * 0.01) for i in range(100)])
        runs.append((measured, robot.truth(1.0).pose.xy_heading))
    np.testing.assert_array_equal(runs[0][0], runs[1][0])
    np.testing.assert_array_equal(runs[0][1], runs[1][1])
    assert not np.array_equal(runs[0][0], runs[2][0], equal_nan=True)
    assert not np.array_equal(runs[0][1], runs[2][1])


def test_truth_has_the_twist_that_the_pose_moves_by() -> None:
    """Halfway through a change of command, with gimbals turning, and after settling."""
    robot = ready()
    robot.write(AHEAD, 0.0)
    for now_s in (0.02, 1.0):
        twist = robot.truth(now_s).twist
        h = 1e-6
        before, after = robot.truth(now_s), robot.truth(now_s + h)
        moved = (before.pose.inverse() @ after.pose).log() / h
        np.testing.assert_allclose(moved, twist, rtol=0, atol=1e-3)


def test_motors_do_not_turn_before_they_have_seen_zero_throttle() -> None:
    robot = SimRobot(ROBOT)
    robot.read(0.0)
    for i in range(500):
        robot.write(AHEAD, i * 0.01)
    np.testing.assert_array_equal(robot.truth(5.0).joints[2::3], 0.0)
    assert robot.hardware()["esc_armed"] is False
    robot.write(IDLE, 5.0)
    robot.write(AHEAD, 5.0 + ROBOT.motor.arming_hold_s)
    assert robot.hardware()["esc_armed"] is True
    assert robot.truth(10.0).joints[2::3].min() > 200.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_set_points_that_are_no_numbers_are_refused(bad: float) -> None:
    robot = ready()
    setpoint = AHEAD.copy()
    setpoint[5] = bad
    with pytest.raises(ValueError, match="must be finite"):
        robot.write(setpoint, 0.0)
    np.testing.assert_array_equal(robot.truth(1.0).pose.xy_heading, 0.0)


@pytest.mark.parametrize("shape", [(), (1,), (8,), (1, 9), (3, 3)])
def test_set_points_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="shape"):
        ready().write(np.zeros(shape), 0.0)


def test_what_is_returned_and_given_belongs_to_the_caller() -> None:
    robot = ready()
    setpoint = AHEAD.copy()
    robot.write(setpoint, 0.0)
    setpoint[:] = 0.0
    robot.read(0.1)[:] = 0.0
    truth = robot.truth(0.1)
    truth.joints[:] = 0.0
    reference = ready()
    reference.write(AHEAD, 0.0)
    reference.read(0.1)
    np.testing.assert_array_equal(robot.truth(1.0).joints, reference.truth(1.0).joints)


def test_facts_about_the_hardware_go_into_json() -> None:
    robot = ready(battery_v=11.1, seed=3)
    facts = json.loads(json.dumps(robot.hardware()))
    assert facts["kind"] == "sim"
    assert facts["battery_v"] == 11.1
    assert facts["esc_armed"] is True
    # 2,500 rpm lie between the signals 20 and 40, of 180, by Table 1 of the thesis.
    signals = [20.0 + 20.0 * 2500.0 / top for top in (2892.0, 2938.0, 2856.0)]
    np.testing.assert_allclose(facts["pulse_us"], [1000.0 + s / 0.18 for s in signals], rtol=1e-9)
    robot.close()


def test_rigid_bodies_stand_behind_the_same_face() -> None:
    robot = SimRobot(ROBOT, plant="mujoco")
    robot.write(IDLE, 0.0)
    robot.write(CRUISE, 2.2)
    robot.write(AHEAD, 4.0)
    measured, truth = robot.read(4.5), robot.truth(4.5)
    assert measured.shape == AHEAD.shape
    assert robot.hardware()["plant"] == "mujoco"
    np.testing.assert_allclose(
        measured.reshape(3, 3)[:, :2], truth.joints.reshape(3, 3)[:, :2], atol=STEP
    )
    np.testing.assert_allclose(truth.twist, [0.5, 0.2, 1.0], rtol=0, atol=0.05)


def test_a_robot_that_no_such_plant_moves_is_refused_in_one_sentence() -> None:
    with pytest.raises(RobotFileError, match=r"kiwi: the plant `mujoco` cannot move it \(only"):
        SimRobot(load_robot("kiwi"), plant="mujoco")


def test_machine_with_another_calibration_than_its_controller_is_off_by_the_difference() -> None:
    robot = description_of_kind(ROBOT, SingularityDescription)
    offset_deg = np.array([[0.5, -0.3], [0.2, 0.6], [-0.4, 0.1]])
    own = with_calibration(robot, offset_deg, np.ones(3), 0.04, 0.15)
    simulated = SimRobot(own, believed=robot)
    assert simulated.read(0.0).reshape(3, 3)[:, :2] == pytest.approx(0.0)
    joints = simulated.truth(0.0).joints.reshape(3, 3)[:, :2]
    assert np.degrees(joints) == pytest.approx(offset_deg)
    alone = SimRobot(own)
    assert np.degrees(alone.read(0.0).reshape(3, 3)[:, :2]) == pytest.approx(offset_deg, abs=0.05)
