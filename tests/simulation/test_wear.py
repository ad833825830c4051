"""Injected wear: effects of slower joints and a weaker battery on a simulated robot."""

from __future__ import annotations

import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.robots import RPM
from tsd_twin.simulation import PLANTS, DegradedRobot, SimRobot, Wear

ROBOT = robots.load_robot("tsd")
DRIVE = ROBOT.kinematics()
REST = DRIVE.inverse(np.zeros(3))
OFF = np.where(np.arange(9) % 3 == 2, 0.0, REST)
FORWARD = DRIVE.inverse(np.array([-0.8, 0.5, 0.0]))


def run(robot: SimRobot, setpoint: Array, start_s: float, seconds: float) -> float:
    for i in range(round(seconds / 0.01)):
        robot.read(start_s + 0.01 * i)
        robot.write(setpoint, start_s + 0.01 * i)
    return start_s + seconds


def spinning(robot: SimRobot) -> float:
    """Arm and spin up; return the time."""
    return run(robot, REST, run(robot, OFF, 0.0, 2.5), 1.5)


@pytest.mark.parametrize("plant", PLANTS)
def test_a_servo_that_lost_30_percent_lags_as_much_more(plant: str) -> None:
    """It lags a ramp by the slope over its rate, and yields to loads in proportion.

    The inertia of the rotor, in MuJoCo only, does not grow.
    """
    lags: list[float] = []
    for worn in False, True:
        robot = DegradedRobot(ROBOT, seed=1, plant=plant)
        now_s = spinning(robot)
        if worn:
            robot.wear(Wear("module2_alpha", 0.3))
        behind: list[float] = []
        for i in range(1, 41):
            goal = REST + 0.02 * i * (FORWARD - REST)
            behind.append(float((goal - robot.truth(now_s).joints)[3]))
            now_s = run(robot, goal, now_s, 0.01)
        lags.append(float(np.mean(behind[20:])))
    assert lags[0] / lags[1] == pytest.approx(0.7, abs=0.08)


def test_a_wheel_settles_at_what_is_left_of_its_speed_and_the_battery_slows_all() -> None:
    robot = DegradedRobot(ROBOT, seed=1)
    now_s = spinning(robot)
    np.testing.assert_allclose(robot.truth(now_s).joints[2::3], 2500.0 * RPM, rtol=1e-3)
    robot.wear(Wear("module2_wheel", 0.05))
    now_s = run(robot, FORWARD, now_s, 3.0)
    speeds = robot.truth(now_s).joints[2::3] / (2500.0 * RPM)
    np.testing.assert_allclose(speeds, [1.0, 0.95, 1.0], rtol=1e-3)
    robot.wear(Wear("battery", 1.0))
    now_s = run(robot, FORWARD, now_s, 3.0)
    speeds = robot.truth(now_s).joints[2::3] / (2500.0 * RPM)
    np.testing.assert_allclose(speeds, np.array([1.0, 0.95, 1.0]) * 11.0 / 12.0, rtol=1e-3)
    assert robot.hardware()["battery_v"] == pytest.approx(11.0)


@pytest.mark.parametrize("name", ["kiwi", "atlas"])
def test_a_geared_wheel_is_slower_by_as_much(name: str) -> None:
    description = robots.load_robot(name)
    setpoint = description.kinematics().inverse(np.array([0.4, 0.2, 0.0]))
    speeds: list[Array] = []
    for wear in [], [Wear("wheel2", 0.05)]:
        robot = DegradedRobot(description, wear, seed=1)
        run(robot, setpoint, 0.0, 2.0)
        speeds.append(robot.truth(2.0).joints)
    np.testing.assert_allclose(speeds[1] / speeds[0], [1.0, 0.95, 1.0], atol=0.01)


def test_wear_waits_for_its_time_of_driving() -> None:
    robot = DegradedRobot(ROBOT, [Wear.parse("module1_wheel=-50%@1.5", ROBOT)], seed=1)
    now_s = run(robot, REST, spinning(robot), 5.0)
    now_s = run(robot, FORWARD, now_s, 1.4)
    assert robot.truth(now_s).joints[2] == pytest.approx(2500.0 * RPM, rel=1e-3)
    now_s = run(robot, FORWARD, now_s, 3.0)
    assert robot.truth(now_s).joints[2] == pytest.approx(1250.0 * RPM, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("module2_alpha", "is not like module1_alpha=-30%@10 or battery=-1V"),
        ("module2_alpha=30%", "is not like"),
        ("module2_alpha=-1V", "is not like"),
        ("battery=-8%", "is not like"),
        ("battery=-.V", "is not like"),
        ("wheel2=-5%", "no joint of tsd: there are module1_alpha"),
        ("module2_wheel=-100%", "more than 0 and less than 100 %"),
        ("battery=-12V", "more than 0 and less than 12 V"),
        ("module2_wheel=-5%@soon", "is not like"),
    ],
)
def test_a_mistake_is_named(text: str, words: str) -> None:
    with pytest.raises(TwinError, match=words):
        Wear.parse(text, ROBOT)
