"""Stuck gimbals: commanded and actual motion."""

from __future__ import annotations

import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.errors import TwinError
from tsd_twin.simulation import DegradedRobot, SimRobot, StuckJoint

ROBOT = robots.load_robot("tsd")
DRIVE = ROBOT.kinematics()
FORWARD = DRIVE.inverse(np.array([-0.8, 0.5, 0.0]))


def run(robot: SimRobot, seconds: float, start_s: float, sign: float = 1.0) -> np.ndarray:
    for i in range(round(seconds / 0.01)):
        robot.read(start_s + 0.01 * i)
        robot.write(sign * FORWARD, start_s + 0.01 * i)
    return robot.truth(start_s + seconds).joints


def test_it_sticks_where_it_leaned_so_far_and_the_others_go_on() -> None:
    jam = StuckJoint.parse("module2_alpha@1.5", ROBOT)
    joints = run(DegradedRobot(ROBOT, jams=[jam]), 1.0, 0.0)
    # The jam is checked every 10 ms, in which a servo approaches its goal by a third.
    stuck = abs(np.degrees(joints[3]))
    assert 1.5 - 0.05 <= stuck < abs(np.degrees(FORWARD[3]))
    free = [0, 1, 4, 6, 7]
    np.testing.assert_allclose(joints[free], FORWARD[free], atol=np.radians(0.05))


def test_once_stuck_it_stays_whatever_it_is_told() -> None:
    robot = DegradedRobot(ROBOT, jams=[StuckJoint("module2_alpha", np.radians(1.0))])
    held = run(robot, 1.0, 0.0)[3]
    assert run(robot, 1.0, 1.0, -1.0)[3] == pytest.approx(held, abs=1e-3)


def test_before_it_leans_so_far_it_is_a_robot_like_any_other() -> None:
    sound, jammed = SimRobot(ROBOT), DegradedRobot(ROBOT, jams=[StuckJoint("module2_alpha", 1.0)])
    np.testing.assert_array_equal(run(sound, 1.0, 0.0), run(jammed, 1.0, 0.0))


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        ("module4_alpha", "tsd", "no gimbal of tsd: there are module1_alpha, module1_beta"),
        ("module1_wheel", "tsd", "no gimbal of tsd"),
        ("wheel1", "omni4", "no gimbal of omni4: it has none"),
        ("module1_beta@far", "tsd", "has to be degrees"),
        ("module1_beta@-1", "tsd", "has to be degrees"),
        ("module1_beta@nan", "tsd", "has to be degrees"),
    ],
)
def test_a_mistake_is_named(text: str, name: str, words: str) -> None:
    with pytest.raises(TwinError, match=words):
        StuckJoint.parse(text, robots.load_robot(name))
