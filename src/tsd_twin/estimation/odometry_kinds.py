"""Odometry from tracking wheels, a sphere's dual-row model and external poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from tsd_twin.estimation.outage import CoastStep
from tsd_twin.estimation.pose_uncertainty import PoseErrors, TwistErrors
from tsd_twin.estimation.sensor_fusion import GyroOdometry, SensorOdometry
from tsd_twin.estimation.wheel_odometry import OrientationOdometry, PlanarOdometry
from tsd_twin.kinematics import SphereKinematics, TwistSolution
from tsd_twin.lie import SE2, Array
from tsd_twin.registry import KindTable
from tsd_twin.robots import (
    ExternalDescription,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)
from tsd_twin.sensors.dead_wheels import DEAD_WHEELS

_PULSE_S = 1.0
"""Time over which pulse rounding persists."""


class DeadWheelOdometry(PlanarOdometry):
    """Odometry from two perpendicular tracking wheels and a rate gyro, immune to drive-wheel slip.

    Source: Savnani et al. 2019, Eq. 12 to 16: distances from pulses, heading from the gyro.
    Corrected: Eq. 14 and 15 as printed hold only for straight lines; here twist and pose are
    computed in the robot frame. A step without these sensors uses the driven wheels.
    """

    def __init__(self, robot: OmniDescription) -> None:
        """Initialize the odometry for a `robot` with tracking wheels.

        Raises:
            ValueError: If the robot has no tracking wheels.
        """
        if robot.dead_wheels is None:
            raise ValueError(f"{robot.name} has no dead wheels")
        super().__init__(robot.kinematics(), robot.joint_errors(), 5)
        self._sensors = sensors = robot.dead_wheels
        wheels = np.array(sensors.rows()) / sensors.radius_m
        self._twist_from_rates = np.linalg.inv(np.vstack([wheels, [0.0, 0.0, 1.0]]))
        self._across = np.array(sensors.rows(0.5 * math.pi)) / sensors.radius_m
        self._angles: Array | None = None
        self._rate = 0.0
        self._between_rad2 = 0.0
        """Heading variance from turning between two readings, since the last refresh."""
        self._between_s = 0.0
        self._rates: Array | None = None

    def bias_rows(self) -> Mapping[str, Array]:
        """Return the Jacobian row (m,) of each robot parameter w.r.t. the biases."""
        unit = np.eye(self.uncertainty.bias_count)[self._joint_biases.count :]
        biases = zip(DEAD_WHEELS.biases(self._sensors), unit, strict=False)
        own = {bias.name: bias.sigma * row for bias, row in biases}
        return {**super().bias_rows(), **own}

    def follow(self, joints: Array, sensors: Array, motion: TwistSolution, dt_s: float) -> None:
        """Update with both angles and the rate, (3,), measured `dt_s` after the last ones."""
        before, self._rates = self._rates, None
        if len(sensors) == 3 and np.isfinite(sensors).all():
            if self._angles is not None:
                turned = (sensors[:2] - self._angles) / dt_s
                rate = 0.5 * (self._rate + sensors[2])
                # The rate may have changed at any time between its two readings.
                self._between_rad2 += (dt_s * (float(sensors[2]) - self._rate)) ** 2 / 12.0
                self._between_s += dt_s
                self._rates = np.array([turned[0], turned[1], rate])
                motion = TwistSolution(self._twist_from_rates @ self._rates, np.zeros(0))
            self._angles, self._rate = sensors[:2].copy(), float(sensors[2])
        else:
            self._angles = None
        if (before is None) is not (self._rates is None):
            self._until_refresh = 0
        self._move(motion, joints, dt_s)

    def coast(self, step: CoastStep, dt_s: float) -> None:
        """Advance by a step without measurements, also of the tracking wheels.

        They keep counting, but the heading at each count is unknown.
        """
        super().coast(step, dt_s)
        self._angles = self._rates = None

    def _twist_errors(self, joints: Array, dt_s: float) -> TwistErrors:
        if self._rates is None:
            return super()._twist_errors(joints, dt_s)
        sensors, by_rates = self._sensors, self._twist_from_rates
        bias_jacobian = np.zeros_like(self.errors.bias_jacobian)
        own = bias_jacobian[:, self._joint_biases.count :]
        own[:, :2] = by_rates[:, :2] * (sensors.radius_share * self._rates[:2])
        # A misaligned wheel also measures part of the lateral motion.
        across = self._across @ self.motion.twist
        own[:, 2:4] = -by_rates[:, :2] * (math.radians(sensors.mounting_deg) * across)
        own[:, 4] = -by_rates[:, 2] * math.radians(sensors.gyro_drift_deg_per_h) / 3600.0
        # Uniform rounding to a pulse, at both ends of each step.
        pulses = by_rates[:, :2] * (2.0 * math.pi / sensors.pulses_per_turn / math.sqrt(12.0))
        rounding = pulses @ pulses.T
        turned = (
            self._between_rad2
            / max(self._between_s, dt_s)
            * np.outer(by_rates[:, 2], by_rates[:, 2])
        )
        self._between_rad2 = self._between_s = 0.0
        covariance = bias_jacobian @ bias_jacobian.T + 2.0 / dt_s**2 * rounding + turned / dt_s
        return TwistErrors(bias_jacobian, rounding / _PULSE_S + turned, covariance)


class ReportedOdometry(PlanarOdometry):
    """Pose reported by another program; the twist comes from the joints.

    Setting the pose fixes an offset to the reported poses. Without a report the pose is held.
    """

    def __init__(self, robot: ExternalDescription) -> None:
        super().__init__(robot.kinematics(), robot.joint_errors())
        self._reported = SE2.identity()
        self._offset = SE2.identity()

    def set_pose(self, pose: SE2, errors: PoseErrors | None = None) -> None:
        """Set the estimate to `pose`."""
        super().set_pose(pose, errors)
        self._offset = pose @ self._reported.inverse()

    def follow(self, joints: Array, sensors: Array, motion: TwistSolution, dt_s: float) -> None:
        """Update with a report: x, y and heading are the first three of `sensors`."""
        before = self.pose
        self._move(motion, joints, dt_s)
        if len(sensors) >= 3 and np.isfinite(sensors[:3]).all():
            self._reported = SE2(sensors[:3].copy())
            self.pose = self._offset @ self._reported
        else:
            self.pose = before

    def coast(self, step: CoastStep, dt_s: float) -> None:
        """Hold the pose in a step without a report."""
        before = self.pose
        super().coast(step, dt_s)
        self.pose = before


class DualRowOdometry(OrientationOdometry):
    """Dual-row odometry of a sphere: the wheel angle determines the supporting row.

    Source: Weiss et al. 2008, Eq. 8 to 12 and 25. The angle is the integrated wheel speed, starting
    at zero.
    """

    def __init__(self, robot: SphereDescription) -> None:
        self._sphere: SphereKinematics = robot.kinematics()
        super().__init__(self._sphere, robot.joint_errors())
        self.angles_rad: Array = np.zeros(self._sphere.wheels)
        """(k,): angle of each wheel."""

    def follow(self, joints: Array, sensors: Array, motion: TwistSolution, dt_s: float) -> None:  # noqa: ARG002  Common signature.
        """Update with the wheel speeds (k,) measured `dt_s` after the last ones."""
        self.advance(joints, dt_s)

    def coast(self, step: CoastStep, dt_s: float) -> None:
        """Advance by a step without measurements, in which wheels roll with the sphere."""
        self.angles_rad = self.angles_rad + dt_s * self._sphere.inverse(step.twist)
        super().coast(step, dt_s)

    def _forward(self, joints: Array, rates: Array, dt_s: float) -> TwistSolution:  # noqa: ARG002  Common signature.
        turned = self.angles_rad + dt_s * joints
        side = self._sphere.mean_side(self.angles_rad, turned)
        self.angles_rad = turned
        twist = self._sphere.true_twist(joints, side)
        left = joints - self._sphere.true_inverse(twist, side)
        return TwistSolution(twist, self._sphere.wheel_radius_m * left)


_Factory: TypeAlias = Callable[[Any], "tuple[SensorOdometry, bool] | None"]


def odometry_by_gyro(
    robot: SingularityDescription | OmniDescription,
) -> tuple[SensorOdometry, bool] | None:
    """Return odometry from wheels and yaw gyro, or None for a robot without a gyro."""
    return None if robot.gyro is None else (GyroOdometry(robot), True)


def odometry_of_platform(robot: OmniDescription) -> tuple[SensorOdometry, bool] | None:
    """Return odometry from tracking wheels or a yaw gyro, or None for a robot without them."""
    if robot.dead_wheels is None:
        return odometry_by_gyro(robot)
    return DeadWheelOdometry(robot), True


def odometry_by_rows(robot: SphereDescription) -> tuple[SensorOdometry, bool]:
    """Return dual-row odometry, and whether the description prefers it."""
    return DualRowOdometry(robot), robot.estimate.model == "dual"


def odometry_of_another(robot: ExternalDescription) -> tuple[SensorOdometry, bool]:
    """Return the odometry reported by the robot itself."""
    return ReportedOdometry(robot), True


def no_odometry(_robot: RobotDescription) -> None:
    """Return None: the robot has only the odometry of its joints."""


_ODOMETRIES = KindTable[_Factory](
    {
        SingularityDescription: odometry_by_gyro,
        OmniDescription: odometry_of_platform,
        SphereDescription: odometry_by_rows,
        ExternalDescription: odometry_of_another,
    },
    lambda kind: kind.odometry,
    no_odometry,
)


def sensor_odometry_of(robot: RobotDescription) -> tuple[SensorOdometry | None, bool]:
    """Return the robot's alternative odometry or None, and whether it is preferred."""
    made = _ODOMETRIES.of(robot)(robot)
    return (None, False) if made is None else made
