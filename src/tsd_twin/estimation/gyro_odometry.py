"""The pose of a robot by its wheels, and a yaw gyro for how it turns."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.drives import Motion
from tsd_twin.estimation.gyro import with_gyro
from tsd_twin.estimation.odometry import PlanarOdometry
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityRobot

_RANGE_RAD_PER_S = math.radians(2000.0)
"""No small gyro measures faster turns: a reading beyond is none."""


class GyroOdometry(PlanarOdometry):
    """Each step is that of the wheels, corrected by the gyro as their covariances weigh them.

    In a step without a reading the robot is taken to move as its wheels say. While wheels are shut
    off they know better than the gyro that the robot stands, so its bias does not turn the pose.
    """

    def __init__(self, robot: SingularityRobot) -> None:
        """Prepare for the gyro of `robot`.

        Raises:
            ValueError: it has none.
        """
        if robot.gyro is None:
            raise ValueError(f"{robot.name} has no gyro")
        super().__init__(robot.kinematics(), robot.joint_errors())
        self._bias = robot.gyro.bias_rad_per_s
        self._sigma = math.hypot(robot.gyro.noise_rad_per_s, self._bias)
        self._rate = math.nan
        self._reads = False
        self._wheels: Array = np.zeros((3, 3))
        self._followed_s = 0.0

    def set_pose(self, pose: SE2, covariance: Array | None = None) -> None:
        """Take the robot to be at `pose`, exactly, unless a `covariance` (3, 3) says how well."""
        super().set_pose(pose, covariance)
        self._followed_s = 0.0

    def follow(self, joints: Array, sensors: Array, motion: Motion, dt_s: float) -> None:
        """Take in joints (n,) and the turn rate (1,), measured `dt_s` after the last ones."""
        rate = self._mean_rate(sensors)
        reads, followed_s = math.isfinite(rate), self._followed_s
        if reads:
            twist, _ = with_gyro(motion.twist, self._wheels, np.array(rate), self._sigma)
            motion = Motion(twist, motion.residual)
            variance = float(self._wheels[2, 2])
            self._followed_s += dt_s * variance / (variance + self._sigma**2)
        if reads is not self._reads:
            self._reads, self._until_refresh = reads, 0
        self.motion = motion
        moved = self._drive.move(self.pose, motion.twist, dt_s)
        self._spread(moved, joints, dt_s)
        # The bias stays: what it does to the heading grows with the time, not with its root.
        self.pose_covariance[2, 2] += self._bias**2 * (self._followed_s**2 - followed_s**2)
        self.pose = moved

    def _mean_rate(self, sensors: Array) -> float:
        """Return the mean turn rate of the step, NaN when there is no reading at its end."""
        before, now = self._rate, float(sensors[0]) if len(sensors) else math.nan
        self._rate = now if abs(now) <= _RANGE_RAD_PER_S else math.nan
        return 0.5 * (before + self._rate) if math.isfinite(before) else self._rate

    def _twist_covariance(self, joints: Array) -> Array:
        self._wheels = super()._twist_covariance(joints)
        if not self._reads:
            return self._wheels
        return with_gyro(np.zeros(3), self._wheels, np.array(0.0), self._sigma)[1]
