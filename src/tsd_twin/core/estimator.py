"""What the robot does, estimated from what is measured of its joints."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.drives import JointKind
from tsd_twin.estimation import ConflictMonitor, PlanarOdometry, SpinModel
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.ros import Odometry
from tsd_twin.messages.status import ConflictStatus
from tsd_twin.robots import Robot

NEUTRAL_RAD = math.radians(1.0)
"""Gimbals within this of upright count as neutral."""
AT_SPEED = 0.02
"""Wheels within this share of their set-point count as at speed."""


class Estimator:
    """Joints, pose, twist and conflict of one robot."""

    def __init__(self, robot: Robot) -> None:
        self.drive = robot.kinematics()
        self.is_angle = np.array([j.kind is JointKind.POSITION for j in self.drive.joints])
        """(n,): which joints are angles; the others are speeds."""
        self._angles = np.flatnonzero(self.is_angle)
        self._wheels = np.flatnonzero(~self.is_angle)
        self._at_rest = self.drive.inverse(np.zeros(3))
        self._tolerance = np.where(self.is_angle, NEUTRAL_RAD, AT_SPEED * np.abs(self._at_rest))
        self._spin = SpinModel(robot.motor, len(self._wheels))
        self._odometry = PlanarOdometry(self.drive, robot.noise)
        self._conflict = ConflictMonitor(self.drive, robot.noise)
        self.measured_s = -math.inf
        """When the joints were measured last."""
        self.joints = np.where(self.is_angle, self._at_rest, 0.0)
        """(n,): measured joints; speeds that are not measured come from the model of the motors."""
        self.rates = np.zeros(len(self.is_angle))
        """(n,): how fast the joints change, of wheels the acceleration."""

    def advance(self, now_s: float, measured: Array | None, setpoint: Array, dt_s: float) -> None:
        """Take in the joints (n,) measured now, `dt_s` after the last ones; None: there are none.

        `setpoint` (n,) is what the joints were told meanwhile.
        """
        spin = self._spin.advance(setpoint[self._wheels], dt_s)
        if measured is not None and np.isfinite(measured[self._angles]).all():
            self.measured_s = now_s
            joints = measured.copy()
            speeds = joints[self._wheels]
            joints[self._wheels] = np.where(np.isfinite(speeds), speeds, spin)
        elif math.isfinite(self.measured_s):
            # Without news the gimbals are taken to stay, but wheels that are shut off run down.
            joints = self.joints.copy()
            joints[self._wheels] = spin
        else:
            return
        self.rates = (joints - self.joints) / dt_s
        self.joints = joints
        motion = self._odometry.advance(joints, dt_s)
        self._conflict.advance(motion.residual, dt_s)

    def neutral_and_at_speed(self) -> tuple[bool, bool]:
        """Return whether all gimbals are upright, and whether all wheels turn as they shall."""
        near = np.abs(self.joints - self._at_rest) <= self._tolerance
        return bool(near[self._angles].all()), bool(near[self._wheels].all())

    @property
    def pose(self) -> SE2:
        """The pose in `odom`."""
        return self._odometry.pose

    def set_pose(self, xy_heading: Array) -> None:
        """Take the robot to be at `xy_heading` (3,), exactly."""
        self._odometry.set_pose(xy_heading)

    def odometry(self, stamp_ns: int) -> Odometry:
        """Return pose in `odom` and twist in `base_link`, with covariances."""
        odometry = self._odometry
        return Odometry(
            odometry.pose.xy_heading,
            odometry.motion.twist,
            odometry.pose_covariance,
            odometry.twist_covariance,
            stamp_ns,
        )

    def conflict(self, *, wheels_spin: bool) -> ConflictStatus:
        """Return how well the joints agree; wheels that do not spin say nothing about gimbals."""
        verdict, names = self._conflict.judge(self.joints), self.drive.actuators
        level = verdict.level if wheels_spin else 0.0
        suspect = verdict.suspect if wheels_spin else None
        return ConflictStatus(
            residual_mps=round(verdict.residual_mps, 5),
            suspect=None if suspect is None else names[suspect],
            level=round(level, 4),
            explained=dict(zip(names, (level * verdict.shares).round(4).tolist(), strict=True)),
        )
