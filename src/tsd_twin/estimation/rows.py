"""The orientation of a sphere by the rows of rollers that carry it."""

from __future__ import annotations

import numpy as np

from tsd_twin.drives import Motion, SphereDrive
from tsd_twin.estimation.odometry import OrientationOdometry
from tsd_twin.lie import Array
from tsd_twin.robots import SphereRobot


class RowOdometry(OrientationOdometry):
    """Dual-row kinematics: which row of a wheel carries follows from how far it has turned.

    Source: Weiss et al. 2008, Eq. 8 to 12 and 25. The angle is the integral of the wheel's speed,
    from zero at the start.
    """

    def __init__(self, robot: SphereRobot) -> None:
        self._sphere: SphereDrive = robot.kinematics()
        super().__init__(self._sphere, robot.joint_errors())
        self.angles_rad: Array = np.zeros(self._sphere.wheels)
        """(k,): how far each wheel has turned."""

    def follow(self, joints: Array, sensors: Array, motion: Motion, dt_s: float) -> None:  # noqa: ARG002  The shape.
        """Take in the wheel speeds (k,) measured `dt_s` after the last ones."""
        self.advance(joints, dt_s)

    def _forward(self, joints: Array, rates: Array, dt_s: float) -> Motion:  # noqa: ARG002  The shape.
        turned = self.angles_rad + dt_s * joints
        side = self._sphere.mean_side(self.angles_rad, turned)
        self.angles_rad = turned
        twist = self._sphere.true_twist(joints, side)
        left = joints - self._sphere.true_inverse(twist, side)
        return Motion(twist, self._sphere.wheel_radius_m * left)
