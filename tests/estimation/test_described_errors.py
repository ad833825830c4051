"""Error keys of a description enter the covariance, or are exempt with a reason."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

from tests.support.markdown_pages import page, section, tables
from tsd_twin import robots
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.robots import OmniDescription, RobotDescription, SingularityDescription
from tsd_twin.sensors.gyro import Gyro

TABLES = ("errors", "noise", "gyro")
PLAY = ("errors", "backlash_deg")
"""The encoder is behind the gear, so backlash is measured."""
PERIOD_S = 0.01


def keys() -> Iterator[tuple[str, str, str]]:
    for name in ("tsd", "kiwi"):
        robot = with_gyro(name)
        for table in TABLES:
            for field in msgspec.structs.fields(getattr(robot, table)):
                yield name, table, field.encode_name


def with_gyro(name: str) -> Any:
    robot = robots.load_robot(name)
    assert isinstance(robot, SingularityDescription | OmniDescription)
    return msgspec.structs.replace(robot, gyro=Gyro())


LEAST = {"speed_scale_sigma": 0.01, "noise_rad_per_s": 1e-5, "gimbal_angle_deg": 0.01}
"""Without these errors, there would be nothing for a gyro to correct, no noise to weigh it by, and
unexplained interpolation residuals.
"""


def with_only(robot: Any, table: str, key: str) -> Any:
    """Return a robot with almost no errors except for one key."""
    changed = {}
    for name in TABLES:
        given = getattr(robot, name)
        own = {f.encode_name: LEAST.get(f.encode_name, 0.0) for f in msgspec.structs.fields(given)}
        if name == table:
            own[key] += 0.01
        changed[name] = msgspec.structs.replace(given, **own)
    return msgspec.structs.replace(robot, **changed)


def spread(robot: RobotDescription) -> np.ndarray[Any, Any]:
    """Variances after 1 s of turning while driving, and of starting to."""
    estimator, kinematics = StateEstimator(robot), robot.kinematics()
    for i in range(100):
        share = min(1.0, 0.1 * i)
        heading = 0.8 * PERIOD_S * i
        twist = share * np.array([0.3 * np.cos(heading), -0.3 * np.sin(heading), 0.8])
        joints = kinematics.inverse(twist)
        estimator.advance(PERIOD_S * (i + 1), np.append(joints, twist[2]), joints, PERIOD_S)
        if i == 5:
            estimator.set_pose(kinematics.pose_type.identity())
    return np.diag(estimator.odometry(0).pose_covariance)


@pytest.mark.parametrize(("name", "table", "key"), list(keys()))
def test_a_robot_with_one_thing_wrong_is_less_certain_of_its_pose(
    name: str, table: str, key: str
) -> None:
    robot = with_gyro(name)
    exact, wrong = spread(with_only(robot, "", "")), spread(with_only(robot, table, key))
    if (table, key) == PLAY:
        np.testing.assert_array_equal(wrong, exact)
    else:
        assert (wrong > (1.0 + 1e-6) * exact).any()


@pytest.mark.parametrize(("name", "table", "key"), list(keys()))
def test_the_page_has_a_row_for_it(name: str, table: str, key: str) -> None:
    (rows, *_) = tables(section(page("estimation.md"), "## The covariance"))
    said = [row[2] for row in rows if f"[{table}]" in row[2]]
    assert any(f"`[{table}] {key}`" in text or f"`{key}`" in text for text in said), name
