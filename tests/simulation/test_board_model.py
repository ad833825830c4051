"""The simulated board is transparent until setpoints cease."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin.lie import Array
from tsd_twin.robots import load_robot
from tsd_twin.simulation import BoardModel, SimRobot
from tsd_twin.simulation.robot import TIMEOUT_S

ROBOT = load_robot("tsd")
DRIVE = ROBOT.kinematics()
IDLE = np.zeros(9)
CRUISE = DRIVE.inverse(np.zeros(3))
AHEAD = DRIVE.inverse(np.array([1.0, 0.0, 0.0]))
PERIOD_S = 0.01
SPIN_UP_S = 5.0


def feed(robot: BoardModel | SimRobot, setpoint: Array, start_s: float, end_s: float) -> float:
    """Write a setpoint each period, and return the time of the last one."""
    for i in range(round((end_s - start_s) / PERIOD_S) + 1):
        robot.read(start_s + i * PERIOD_S)
        robot.write(setpoint, start_s + i * PERIOD_S)
    return start_s + round((end_s - start_s) / PERIOD_S) * PERIOD_S


def driving(robot: BoardModel | SimRobot) -> float:
    """Arm, spin up, drive at 1 m/s, and return the time of the last setpoint."""
    feed(robot, IDLE, 0.0, 2.5)
    feed(robot, CRUISE, 2.5, SPIN_UP_S)
    return feed(robot, AHEAD, SPIN_UP_S, SPIN_UP_S + 1.0)


def board() -> BoardModel:
    return BoardModel(ROBOT, SimRobot(ROBOT))


@settings(max_examples=10)
@given(gaps_s=st.lists(st.floats(0.0, TIMEOUT_S), min_size=1, max_size=20))
def test_as_long_as_set_points_come_it_is_not_there(gaps_s: list[float]) -> None:
    fed, bare = board(), SimRobot(ROBOT)
    now_s = driving(fed)
    assert driving(bare) == now_s
    for i, gap_s in enumerate(gaps_s):
        now_s += gap_s
        for robot in (fed, bare):
            measured = robot.read(now_s)
            assert measured is not None
            robot.write((AHEAD, CRUISE)[i % 2], now_s)
    np.testing.assert_array_equal(fed.truth(now_s).joints, bare.truth(now_s).joints)
    np.testing.assert_array_equal(
        fed.truth(now_s).pose.xy_heading, bare.truth(now_s).pose.xy_heading
    )
    assert fed.hardware() == {**bare.hardware(), "tripped": False}


@settings(max_examples=20)
@given(looks_s=st.lists(st.floats(0.0, 6.0), max_size=10))
def test_it_stops_a_robot_whose_set_points_cease_whenever_it_is_looked_at(
    looks_s: list[float],
) -> None:
    """1 m/s until the timeout, then the distance while gimbals return upright."""
    robot = board()
    last_s = driving(robot)
    before = robot.truth(last_s).pose
    for look_s in sorted(looks_s):
        measured = robot.read(last_s + look_s)
        assert (measured is None) == (look_s > TIMEOUT_S)
    after = robot.truth(last_s + 6.0).pose
    way_m = (before.inverse() @ after).xy_heading[0]
    # Gimbals approach upright at 32 /s: 1/32 m more at 1 m/s, less the slowing of the motors.
    assert (
        1.0 * TIMEOUT_S < way_m < 1.0 * (TIMEOUT_S + 1.0 / ROBOT.servo.approach_rate_per_s) + 0.01
    )
    np.testing.assert_allclose(robot.truth(last_s + 6.0).twist, 0.0, atol=1e-6)
    assert robot.hardware()["tripped"] is True


def test_it_obeys_again_only_after_zero_throttle() -> None:
    robot = board()
    now_s = driving(robot) + 1.0
    robot.read(now_s)
    still = robot.truth(now_s).pose
    now_s = feed(robot, AHEAD, now_s, now_s + 1.0)
    assert robot.read(now_s) is None
    np.testing.assert_allclose(robot.truth(now_s).pose.xy_heading, still.xy_heading, atol=1e-3)
    robot.write(IDLE, now_s)
    assert robot.read(now_s) is not None
    now_s = feed(robot, CRUISE, now_s, now_s + SPIN_UP_S)
    now_s = feed(robot, AHEAD, now_s, now_s + 1.0)
    assert robot.truth(now_s).twist[0] == pytest.approx(1.0, abs=0.05)


def test_with_all_throttles_at_zero_there_is_nothing_to_trip() -> None:
    robot = board()
    assert robot.read(-100.0) is not None
    feed(robot, IDLE, 0.0, 3.0)
    assert robot.read(1000.0) is not None
    assert not robot.tripped


def test_what_is_given_belongs_to_the_caller() -> None:
    robot = board()
    now_s = driving(robot)
    setpoint = AHEAD.copy()
    robot.write(setpoint, now_s)
    setpoint[:] = 0.0
    assert robot.read(now_s + 2.0 * TIMEOUT_S) is None


@pytest.mark.parametrize("bad", [np.full(9, np.nan), np.zeros(3)])
def test_what_is_no_set_point_feeds_nothing(bad: Array) -> None:
    robot = board()
    last_s = driving(robot)
    with pytest.raises(ValueError, match="must"):
        robot.write(bad, last_s + TIMEOUT_S)
    assert robot.read(last_s + TIMEOUT_S * 1.01) is None
