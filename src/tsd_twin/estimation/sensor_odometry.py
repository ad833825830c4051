"""Odometry from gyros, tracking wheels, a sphere's dual-row model and external poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from statistics import fmean, variance
from typing import Any, Protocol, TypeAlias

import numpy as np

from tsd_twin.estimation.learned import Comparison
from tsd_twin.estimation.outage import OutageStep
from tsd_twin.estimation.pose_spread import PoseErrors, PoseSpread, TwistErrors
from tsd_twin.estimation.wheel_odometry import OrientationOdometry, PlanarOdometry
from tsd_twin.kinematics import SphereKinematics, TwistSolution
from tsd_twin.lie import SE2, Array
from tsd_twin.registry import KindTable
from tsd_twin.robots import (
    ImportedDescription,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)


def with_gyro(
    twist: Array, covariance: Array, turn_rate: Array, sigma_rad_per_s: float
) -> tuple[Array, Array]:
    """Return planar twists (..., 3) and covariances, corrected by a yaw gyro's `turn_rate` (...).

    The gyro is weighted by its variance. The correction extends to correlated wheel errors, such as
    a slow wheel that both turns and shifts the robot.
    """
    column = covariance[..., :, 2]
    gain = column / (column[..., 2:] + sigma_rad_per_s**2)
    off = turn_rate - twist[..., 2]
    return twist + gain * off[..., None], covariance - gain[..., :, None] * column[..., None, :]


_COMPARED = 10
"""Steps over which gyro and wheels are compared."""
_COMPARED_S = 0.1
"""Approximate duration of these steps."""
_MAX_LAG_S = 0.01
"""Maximum lag of the joints behind the gyro."""
_RANGE_RAD_PER_S = math.radians(2000.0)
"""Range limit of a small gyro; larger readings are discarded."""


class GyroOdometry(PlanarOdometry):
    """Odometry from wheels and yaw gyro, weighted by their covariances in each step.

    A step without a gyro reading uses the wheels only. While the wheels are off the robot is at
    rest, so the gyro bias does not turn the pose.
    """

    def __init__(self, robot: SingularityDescription | OmniDescription) -> None:
        """Initialize the odometry for a `robot` with a gyro.

        Raises:
            ValueError: If the robot has no gyro.
        """
        if robot.gyro is None:
            raise ValueError(f"{robot.name} has no gyro")
        super().__init__(robot.kinematics(), robot.joint_errors(), 1)
        self._bias, self._noise_rad_per_s = robot.gyro.bias_rad_per_s, robot.gyro.noise_rad_per_s
        self._sigma = math.hypot(self._noise_rad_per_s, self._bias)
        self._rate = math.nan
        self._reads = False
        self._wheels = TwistErrors.none(self.spread.constants)
        self._compared: list[float] = []
        self._compared_from = 0.0
        """Turn rate from the wheels at the first comparison."""
        self.comparison: Comparison | None = None
        """Comparison of gyro and wheels that ended with the last step, or None."""

    def constant_rows(self) -> Mapping[str, Array]:
        """Return the Jacobian row (m,) of each robot parameter w.r.t. the biases."""
        bias = self._bias * np.eye(self.spread.constants)[self._constants.count]
        return {**super().constant_rows(), "gyro_bias_rad_per_s": bias}

    def follow(self, joints: Array, sensors: Array, motion: TwistSolution, dt_s: float) -> None:
        """Update with joints (n,) and turn rate (1,), measured `dt_s` after the last ones."""
        rate = self._mean_rate(sensors)
        reads = math.isfinite(rate)
        self._compare(rate, float(motion.twist[2]))
        if reads:
            covariance = self._wheels.covariance
            twist, _ = with_gyro(motion.twist, covariance, np.array(rate), self._sigma)
            motion = TwistSolution(twist, motion.residual)
        if reads is not self._reads:
            self._reads, self._until_refresh = reads, 0
        self._move(motion, joints, dt_s)

    def coast(self, step: OutageStep, dt_s: float) -> None:
        """Advance by a step in which neither joints nor gyro were measured."""
        super().coast(step, dt_s)
        self._rate, self.comparison = math.nan, None
        self._compared.clear()

    def _compare(self, rate: float, by_wheels: float) -> None:
        self.comparison = None
        if not math.isfinite(rate):
            self._compared.clear()
            return
        if not self._compared:
            self._compared_from = by_wheels
        self._compared.append(rate - by_wheels)
        if len(self._compared) < _COMPARED:
            return
        difference, wheels = fmean(self._compared), self._wheels
        row = wheels.by_constants[2].copy()
        row[self._constants.count] = self._bias
        # Rounded angles stay constant for many steps, so their error does not average out.
        by_wheels_alone = wheels.covariance[2, 2] - np.square(wheels.by_constants[2]).sum()
        # Also account for gimbal noise, seen as a turn rate, and for accelerating wheels.
        noise = self._noise_rad_per_s**2
        seen = variance(self._compared) / _COMPARED
        faster = by_wheels - self._compared_from
        total = max(float(by_wheels_alone), seen, 0.0) + noise / _COMPARED
        total += (_MAX_LAG_S * faster / _COMPARED_S) ** 2
        self._compared.clear()
        self.comparison = Comparison(difference, row, total)

    def _mean_rate(self, sensors: Array) -> float:
        """Return the mean turn rate of the step, or NaN without a reading at its end."""
        before, now = self._rate, float(sensors[0]) if len(sensors) else math.nan
        self._rate = now if abs(now) <= _RANGE_RAD_PER_S else math.nan
        return 0.5 * (before + self._rate) if math.isfinite(before) else self._rate

    def _twist_errors(self, joints: Array, dt_s: float) -> TwistErrors:
        wheels = super()._twist_errors(joints, dt_s)
        self._wheels = wheels
        if not self._reads:
            return wheels
        gain = wheels.covariance[:, 2] / (wheels.covariance[2, 2] + self._sigma**2)
        keep = np.eye(3)
        keep[:, 2] -= gain
        by_constants = keep @ wheels.by_constants
        by_constants[:, self._constants.count] = -gain * self._bias
        noise = dt_s * self._noise_rad_per_s**2 * np.outer(gain, gain)
        white_per_s = keep @ wheels.white_per_s @ keep.T + noise
        _, covariance = with_gyro(np.zeros(3), wheels.covariance, np.array(0.0), self._sigma)
        return TwistErrors(by_constants, white_per_s, covariance)


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

    def constant_rows(self) -> Mapping[str, Array]:
        """Return the Jacobian row (m,) of each robot parameter w.r.t. the biases."""
        sensors, first = self._sensors, self._constants.count
        mounting = math.radians(sensors.mounting_deg)
        drift = math.radians(sensors.gyro_drift_deg_per_h) / 3600.0
        sizes = {
            "dead_wheel1_share": sensors.radius_share,
            "dead_wheel2_share": sensors.radius_share,
            "dead_wheel1_mounting_rad": mounting,
            "dead_wheel2_mounting_rad": mounting,
            "gyro_bias_rad_per_s": drift,
        }
        unit = np.eye(self.spread.constants)[first:]
        own = {name: size * row for (name, size), row in zip(sizes.items(), unit, strict=False)}
        return {**super().constant_rows(), **own}

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

    def coast(self, step: OutageStep, dt_s: float) -> None:
        """Advance by a step without measurements, also of the tracking wheels.

        They keep counting, but the heading at each count is unknown.
        """
        super().coast(step, dt_s)
        self._angles = self._rates = None

    def _twist_errors(self, joints: Array, dt_s: float) -> TwistErrors:
        if self._rates is None:
            return super()._twist_errors(joints, dt_s)
        sensors, by_rates = self._sensors, self._twist_from_rates
        by_constants = np.zeros_like(self.errors.by_constants)
        own = by_constants[:, self._constants.count :]
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
        covariance = by_constants @ by_constants.T + 2.0 / dt_s**2 * rounding + turned / dt_s
        return TwistErrors(by_constants, rounding / _PULSE_S + turned, covariance)


class ReportedOdometry(PlanarOdometry):
    """Pose reported by another program; the twist comes from the joints.

    Setting the pose fixes an offset to the reported poses. Without a report the pose is held.
    """

    def __init__(self, robot: ImportedDescription) -> None:
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

    def coast(self, step: OutageStep, dt_s: float) -> None:
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

    def coast(self, step: OutageStep, dt_s: float) -> None:
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


class Estimate(Protocol):
    """Estimate of pose and twist with covariances."""

    @property
    def pose(self) -> Any:
        """Estimated pose in `odom`."""
        ...

    @property
    def end_twist(self) -> Array:
        """(3,): twist in `base_link` at the end of the last step."""
        ...

    @property
    def pose_covariance(self) -> Array:
        """(3, 3): covariance of the pose, in exponential coordinates about the axes of `odom`."""
        ...

    @property
    def twist_covariance(self) -> Array:
        """(3, 3): covariance of the twist, in `base_link`."""
        ...

    def set_pose(self, pose: Any) -> None:
        """Set the estimate to `pose`, without errors."""
        ...


class DeadReckoning(Estimate, Protocol):
    """Estimate that a pose sensor can correct."""

    def coast(self, step: OutageStep, dt_s: float) -> None:
        """Advance by a step of `dt_s` without measurements."""
        ...

    @property
    def motion(self) -> TwistSolution:
        """Mean motion during the last step, with its residual."""
        ...

    def constant_rows(self) -> Mapping[str, Array]:
        """Return the Jacobian row (m,) of each robot parameter w.r.t. the biases."""
        ...

    @property
    def errors(self) -> TwistErrors:
        """Errors of the twist."""
        ...

    @property
    def spread(self) -> PoseSpread[Any, Any]:
        """Uncertainty of the pose."""
        ...

    def set_pose(self, pose: Any, errors: PoseErrors | None = None) -> None:
        """Set the estimate to `pose`, with pose `errors` (zero by default)."""
        ...


class SensorOdometry(DeadReckoning, Protocol):
    """Alternative estimate, using sensors in addition to the drive joints."""

    def follow(self, joints: Array, sensors: Array, motion: TwistSolution, dt_s: float) -> None:
        """Update with joints (n,) and other sensors (s,), NaN without a reading.

        They were measured `dt_s` after the last ones; `motion` is the forward-kinematics solution
        for the joints.
        """
        ...


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


def odometry_of_another(robot: ImportedDescription) -> tuple[SensorOdometry, bool]:
    """Return the odometry reported by the robot itself."""
    return ReportedOdometry(robot), True


def no_odometry(_robot: RobotDescription) -> None:
    """Return None: the robot has only the odometry of its joints."""


_ODOMETRIES = KindTable[_Factory](
    {
        SingularityDescription: odometry_by_gyro,
        OmniDescription: odometry_of_platform,
        SphereDescription: odometry_by_rows,
        ImportedDescription: odometry_of_another,
    },
    lambda kind: kind.odometry,
    no_odometry,
)


def sensor_odometry_of(robot: RobotDescription) -> tuple[SensorOdometry | None, bool]:
    """Return the robot's alternative odometry or None, and whether it is preferred."""
    made = _ODOMETRIES.of(robot)(robot)
    return (None, False) if made is None else made
