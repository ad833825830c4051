"""A second estimate, of robots that can tell in more than one way where they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from tsd_twin.drives import Motion
from tsd_twin.estimation.dead_wheels import DeadWheelOdometry
from tsd_twin.estimation.gyro_odometry import GyroOdometry
from tsd_twin.estimation.rows import RowOdometry
from tsd_twin.lie import Array
from tsd_twin.robots import OmniRobot, Robot, SingularityRobot, SphereRobot


class Estimate(Protocol):
    """Where a robot is, and how it moves."""

    @property
    def pose(self) -> Any:
        """The pose in `odom`."""
        ...

    @property
    def motion(self) -> Motion:
        """The twist in `base_link`, and what it leaves unexplained."""
        ...

    @property
    def pose_covariance(self) -> Array:
        """(3, 3): of the pose, in `odom`."""
        ...

    @property
    def twist_covariance(self) -> Array:
        """(3, 3): of the twist, in `base_link`."""
        ...

    def set_pose(self, pose: Any, covariance: Array | None = None) -> None:
        """Take the robot to be at `pose`, exactly, unless a `covariance` (3, 3) says how well."""
        ...


class SecondEstimate(Estimate, Protocol):
    """An estimate beside that of the drive's own kinematics."""

    def follow(self, joints: Array, sensors: Array, motion: Motion, dt_s: float) -> None:
        """Take in joints (n,) and other sensors (s,), NaN where there is no number.

        They were measured `dt_s` after the last ones; `motion` is what the drive's own kinematics
        make of the joints.
        """
        ...


def _by_dead_wheels(robot: OmniRobot) -> tuple[SecondEstimate, bool] | None:
    return None if robot.dead_wheels is None else (DeadWheelOdometry(robot), True)


def _by_gyro(robot: SingularityRobot) -> tuple[SecondEstimate, bool] | None:
    return None if robot.gyro is None else (GyroOdometry(robot), True)


def _by_rows(robot: SphereRobot) -> tuple[SecondEstimate, bool]:
    return RowOdometry(robot), robot.estimate.model == "dual"


SECOND: dict[type[Robot], Callable[[Any], tuple[SecondEstimate, bool] | None]] = {
    OmniRobot: _by_dead_wheels,
    SingularityRobot: _by_gyro,
    SphereRobot: _by_rows,
}
"""From the kind of a robot to its second estimate, and whether that is the better one; kinds that
have none are not in here."""


def second_estimate(robot: Robot) -> tuple[SecondEstimate | None, bool]:
    """Return the second estimate of a robot, if it has one, and whether that is the better one."""
    make = SECOND.get(type(robot))
    made = None if make is None else make(robot)
    return (None, False) if made is None else made
