"""What the robot does, estimated from what is measured of its joints."""

from __future__ import annotations

import math
from statistics import fmean
from typing import Any

import numpy as np

from tsd_twin.core.outside_poses import OutsidePoses
from tsd_twin.drives import JointKind
from tsd_twin.estimation import (
    ODOMETRY,
    ConflictMonitor,
    CorrectedEstimate,
    Estimate,
    SpinModel,
    second_estimate,
)
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.ros import Odometry
from tsd_twin.messages.status import ConflictStatus
from tsd_twin.robots import Robot

NEUTRAL_RAD = math.radians(1.0)
"""Gimbals within this of upright count as neutral."""
AT_SPEED = 0.02
"""Wheels within this share of their set-point count as at speed."""
AT_REST_RAD_PER_S = 0.1
"""Wheels slower than this count as at speed when they shall stand."""


class Estimator:
    """Joints, pose, twist and conflict of one robot."""

    def __init__(self, robot: Robot) -> None:
        self.drive = robot.kinematics()
        self.is_angle = np.array([j.kind is JointKind.POSITION for j in self.drive.joints])
        """(n,): which joints are angles; the others are speeds."""
        self._angles = np.flatnonzero(self.is_angle)
        self._wheels = np.flatnonzero(~self.is_angle)
        self._needed = np.flatnonzero(self.is_angle | robot.measures_spin)
        self._spin = SpinModel(robot.spin_up(), len(self._wheels))
        self._plain = ODOMETRY[self.drive.space](self.drive, robot.joint_errors())
        self._second, prefer_second = second_estimate(robot)
        self._inner: Estimate = self._second if prefer_second and self._second else self._plain
        self._corrected = None
        if self.drive.space is SE2:
            self._corrected = CorrectedEstimate(self.drive, self._inner, robot.outside_pose)
        self._best: Estimate = self._corrected or self._inner
        self.outside = OutsidePoses(self._corrected)
        """What somebody else sees of the robot."""
        self._conflict = ConflictMonitor(self.drive, robot.joint_errors())
        self.measured_s = -math.inf
        """When the joints were measured last."""
        self.joints = np.where(self.is_angle, self.drive.inverse(np.zeros(3)), 0.0)
        """(n,): measured joints; speeds that are not measured come from the model of the motors."""
        self._before, self._step_s = self.joints, 1.0
        self._unmeasured = np.full(len(robot.sensors), np.nan)
        self._unmeasured.setflags(write=False)
        self.sensors = self._unmeasured
        """(s,): what the other sensors measured last, NaN where they do not."""

    def advance(self, now_s: float, measured: Array | None, setpoint: Array, dt_s: float) -> None:
        """Take in what was measured now, `dt_s` after the last time; None: there is nothing.

        `measured` (n + s,) are the joints and the other sensors, `setpoint` (n,) is what the joints
        were told meanwhile.
        """
        spin = self._spin.advance(setpoint[self._wheels], dt_s)
        if measured is not None and np.isfinite(measured[self._needed]).all():
            self.measured_s = now_s
            joints = measured[: len(self.joints)].copy()
            others = measured[len(joints) :]
            self.sensors = others.copy() if len(others) else self._unmeasured
            speeds = joints[self._wheels]
            np.copyto(speeds, spin, where=~np.isfinite(speeds))
            joints[self._wheels] = speeds
        elif math.isfinite(self.measured_s):
            # Without news the gimbals are taken to stay, but wheels that are shut off run down.
            joints = self.joints.copy()
            joints[self._wheels] = spin
            self.sensors = self._unmeasured
        else:
            return
        self._before, self._step_s, self.joints = self.joints, dt_s, joints
        motion = self._plain.advance(joints, dt_s)
        if self._second is not None:
            self._second.follow(joints, self.sensors, motion, dt_s)
        if self._corrected is not None:
            self._corrected.follow(now_s)
        self._conflict.advance(motion.residual, dt_s)

    @property
    def rates(self) -> Array:
        """(n,): how fast the joints change, of wheels the acceleration."""
        return (self.joints - self._before) / self._step_s

    def neutral_and_at_speed(self, at_rest: Array) -> tuple[bool, bool]:
        """Return whether all gimbals are upright, and whether all wheels turn as they shall.

        `at_rest` (n,) is what the joints do when the robot is ready and stands.
        """
        at_speed = np.maximum(AT_SPEED * np.abs(at_rest), AT_REST_RAD_PER_S)
        tolerance = np.where(self.is_angle, NEUTRAL_RAD, at_speed)
        near = np.abs(self.joints - at_rest) <= tolerance
        return bool(near[self._angles].all()), bool(near[self._wheels].all())

    def spin_after(self, speeds: Array, dt_s: float) -> float:
        """Return how fast motors told `speeds` (m,) are expected to turn after `dt_s`: their mean.

        By their model also where speeds are measured: a sensor that fails must tilt nothing.
        """
        return fmean(self._spin.after(speeds, dt_s).tolist())

    @property
    def pose(self) -> Any:
        """The pose in `odom`, of the drive's space."""
        return self._best.pose

    def set_pose(self, pose: SE2 | SO3) -> None:
        """Take the robot to be at `pose`, exactly."""
        self._plain.set_pose(pose)
        if self._second is not None:
            self._second.set_pose(pose)
        self._best.set_pose(pose)

    def odometry(self, stamp_ns: int) -> Odometry:
        """Return pose in `odom` and twist in `base_link`, with covariances."""
        return _message(self._best, stamp_ns)

    def other_odometry(self, stamp_ns: int) -> Odometry | None:
        """Return the estimate that `odometry` is not, where there are two.

        Of a robot that has one of its own, that is this one, while outside poses correct the other.
        """
        if self._second is not None:
            return _message(self._plain if self._inner is self._second else self._second, stamp_ns)
        corrected = self._corrected is not None and self._corrected.is_corrected
        return _message(self._plain, stamp_ns) if corrected else None

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


def _message(estimate: Estimate, stamp_ns: int) -> Odometry:
    return Odometry.of(
        estimate.pose,
        estimate.motion.twist,
        estimate.pose_covariance,
        estimate.twist_covariance,
        stamp_ns,
    )
