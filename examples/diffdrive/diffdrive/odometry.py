"""Odometry of a differential drive: wheel odometry whose wheels may skid sideways."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diffdrive.kind import DiffDriveDescription
from tsd_twin.estimation import PlanarOdometry, TwistErrors
from tsd_twin.lie import Array


class DiffDriveOdometry(PlanarOdometry):
    """Wheel odometry; the skid adds to the covariance of `vy`, with the distance driven."""

    def __init__(self, robot: DiffDriveDescription) -> None:
        super().__init__(robot.kinematics(), robot.joint_errors())
        self._skid_share = robot.noise.skid_share

    def _twist_errors(self, joints: Array, dt_s: float) -> TwistErrors:
        errors = super()._twist_errors(joints, dt_s)
        skid = np.zeros((3, 3))
        skid[1, 1] = (self._skid_share * self.motion.twist[0]) ** 2
        return replace(
            errors,
            white_per_s=errors.white_per_s + skid,
            covariance=errors.covariance + skid / dt_s,
        )
