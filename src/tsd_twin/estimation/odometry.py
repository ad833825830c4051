"""The pose of a planar robot by forward kinematics of its measured joints."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.drives import Drive, Motion
from tsd_twin.estimation.joint_noise import JointNoise
from tsd_twin.lie import SE2, Array
from tsd_twin.robots.robot import Noise

CORRELATION_S = 1.0
"""Time over which an error of the joints persists: quantisation and a wrong spin do not average
out from one sample to the next, so the variance grows with this time, not with the period."""
_REFRESH_EVERY = 10
"""Steps for which the covariance of the twist is kept: it follows the joints slowly."""


class PlanarOdometry:
    """Pose, twist and their covariances from a stream of joint vectors.

    Between two samples the joints are taken to move evenly, so that the terms in the gimbal rates
    add up to the exact displacement; the pose moves by the exponential of the twist.
    """

    def __init__(self, drive: Drive[SE2], noise: Noise) -> None:
        self._drive = drive
        self._noise = JointNoise(drive, noise)
        self._previous: Array | None = None
        self._until_refresh = 0
        self._growth_per_s: Array = np.zeros((3, 3))
        self.pose = SE2.identity()
        self.motion = Motion(np.zeros(3), np.zeros(0))
        self.pose_covariance: Array = np.zeros((3, 3))
        """(3, 3): of x, y, heading, in `odom`."""
        self.twist_covariance: Array = np.zeros((3, 3))
        """(3, 3): of vx, vy, omega, in `base_link`; more when the joints contradict one another."""

    def set_pose(self, xy_heading: Array) -> None:
        """Take the robot to be at `xy_heading` (3,), exactly."""
        self.pose = SE2(np.array(xy_heading, dtype=float))
        self.pose_covariance = np.zeros((3, 3))

    def advance(self, joints: Array, dt_s: float) -> Motion:
        """Take in the joints (n,) measured `dt_s` after the last ones, and return the motion."""
        previous = joints if self._previous is None else self._previous
        self._previous = joints
        step = joints - previous
        middle = previous + 0.5 * step
        self.motion = motion = self._drive.forward(middle, step / dt_s)
        moved = self._drive.move(self.pose, motion.twist, dt_s)
        self._spread(moved, middle, dt_s)
        self.pose = moved
        return motion

    def _spread(self, moved: SE2, joints: Array, dt_s: float) -> None:
        """Grow the covariances: first-order error propagation along the step."""
        if self._until_refresh == 0:
            self.twist_covariance = self._twist_covariance(joints)
            heading = float(moved.xy_heading[2])
            c, s = math.cos(heading), math.sin(heading)
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            self._growth_per_s = turn @ self.twist_covariance @ turn.T * CORRELATION_S
        self._until_refresh = (self._until_refresh + 1) % _REFRESH_EVERY
        dx, dy, _ = (moved.xy_heading - self.pose.xy_heading).tolist()
        carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        carried = carry @ self.pose_covariance @ carry.T
        self.pose_covariance = carried + dt_s * self._growth_per_s

    def _twist_covariance(self, joints: Array) -> Array:
        # The Jacobian of the forward kinematics by differences, all joints in one batch.
        nudged = joints + np.diag(np.maximum(self._noise.sigma(joints), 1e-9))
        off, here = self._drive.forward(nudged), self._drive.forward(joints)
        shift = off.twist - here.twist
        return self._disbelief(off.residual - here.residual) * (shift.T @ shift)

    def _disbelief(self, shift: Array) -> float:
        """Return how many times the squared residual is what the noise makes of it; at least 1.

        Measurements that contradict one another by more than their errors have larger errors than
        was said: Birge, "The calculation of errors by the method of least squares" (1932).
        """
        residual = self.motion.residual
        explained = float(np.square(shift).sum())
        found = float(residual @ residual)
        return found / explained if found > explained > 0.0 else 1.0
