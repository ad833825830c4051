"""Odometry from a yaw gyro, tracking wheels, a sphere's dual-row model and external poses."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from statistics import fmean, variance
from typing import Any, TypeAlias

import numpy as np

from tsd_twin.estimation.outage import CoastStep
from tsd_twin.estimation.pose_uncertainty import PoseErrors, TwistErrors
from tsd_twin.estimation.sensor_correction import LinearReading
from tsd_twin.estimation.wheel_odometry import PlanarOdometry, WheelOdometry
from tsd_twin.kinematics import SphereKinematics, TwistSolution
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.registry import KindTable
from tsd_twin.robots import (
    ExternalDescription,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)
from tsd_twin.sensors.base import Bias
from tsd_twin.sensors.dead_wheels import DEAD_WHEELS, DeadWheels
from tsd_twin.sensors.gyro import GYRO, Gyro


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
_VARYING_SHARE = 0.07
"""Fraction of the errors of the velocity from the wheels that is not constant."""
_VARYING_S = 1.0
"""Time for which that fraction persists."""
_REFRESH_RAD = 0.03
"""Angle after which the errors are updated early: the gyro corrects the velocity in body axes, and
a correction of an earlier direction errs to the same side throughout a turn."""
_STEADY_S = 2.0
"""Typical time in which the motion of a sphere changes."""
_RANGE_RAD_PER_S = math.radians(2000.0)
"""Range limit of a small gyro; larger readings are discarded."""


AGE_SHARE = 0.3
"""Standard deviation of the age of joint measurements, relative to the described delay."""


class DelayedReadings:
    """Delay line that interpolates a sensor's readings at the time of older joint measurements."""

    def __init__(self, delay_s: float) -> None:
        self._delay_s = delay_s
        self._past: deque[tuple[float, float]] = deque()
        self._now_s = 0.0

    def add(self, reading: float, dt_s: float) -> float:
        """Add a reading taken `dt_s` after the last, and return the one a delay ago, or NaN."""
        if self._delay_s == 0.0:
            return reading
        self._now_s += dt_s
        at_s = self._now_s - self._delay_s
        self._past.append((self._now_s, reading))
        while len(self._past) > 1 and self._past[1][0] <= at_s:
            self._past.popleft()
        first_s, first = self._past[0]
        if len(self._past) == 1 or at_s <= first_s:
            return first if at_s >= first_s else math.nan
        after_s, after = self._past[1]
        return first + (at_s - first_s) / (after_s - first_s) * (after - first)

    def clear(self) -> None:
        """Discard all readings, after an interruption."""
        self._past.clear()


class GyroOdometry(PlanarOdometry):
    """Odometry from wheels and yaw gyro, weighted by their covariances in each step.

    A step without a gyro reading uses the wheels only. While the wheels are off the robot is at
    rest, so the gyro bias does not turn the pose. If joints arrive late, the gyro is delayed by
    their described age.
    """

    def __init__(self, robot: RobotDescription, gyro: Gyro) -> None:
        biases = GYRO.biases(gyro)
        self._age_s = AGE_SHARE * robot.delay_s
        ages = (Bias("joint_age_s", self._age_s),) if robot.delay_s > 0.0 else ()
        super().__init__(robot.kinematics(), robot.joint_errors(), (*biases, *ages))
        self._common_share = robot.joint_errors().common_spin_share
        self._delayed = DelayedReadings(robot.delay_s)
        self._at_refresh: tuple[Array, Array] = (np.zeros(3), np.zeros(3))
        """Twist at the last refresh, and its rate of change in body axes."""
        self._wheel_twist_at_refresh: Array = np.zeros(3)
        self._turned_rad = 0.0
        """Angle turned since the last refresh."""
        self._bias, self._noise_rad_per_s = gyro.bias_rad_per_s, gyro.noise_rad_per_s
        self._scale_share = gyro.scale_share
        self._rate = math.nan
        self._reads = False
        self._wheels = TwistErrors.none(self.uncertainty.bias_count)
        self._compared: list[float] = []
        self._compared_from = 0.0
        """Turn rate from the wheels at the first comparison."""
        self.comparison: LinearReading | None = None
        """Gyro minus wheels, if a comparison ended with the last step; independent of the pose."""

    def follow(self, joints: Array, sensors: Array, motion: TwistSolution, dt_s: float) -> None:
        """Update with joints (n,) and turn rate (1,), measured `dt_s` after the last ones."""
        rate, by_wheels = self._mean_rate(sensors, dt_s), motion.twist
        reads = math.isfinite(rate)
        self._compare(rate, float(by_wheels[2]))
        if reads:
            covariance = self._wheels_covariance(by_wheels)
            twist, _ = with_gyro(by_wheels, covariance, np.array(rate), self._sigma(rate))
            motion = TwistSolution(twist, motion.residual)
        self._turned_rad += abs(float(motion.twist[2])) * dt_s
        if reads is not self._reads or self._turned_rad > _REFRESH_RAD:
            self._reads, self._until_refresh = reads, 0
        self._move(motion, joints, dt_s, by_wheels)

    def coast(self, step: CoastStep, dt_s: float) -> None:
        """Advance by a step in which neither joints nor gyro were measured."""
        super().coast(step, dt_s)
        self._rate, self.comparison = math.nan, None
        self._delayed.clear()
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
        difference, wheels = np.array([fmean(self._compared)]), self._wheels
        by_biases = wheels.bias_jacobian[2:].copy()
        by_biases[0, self._joint_biases.count] = self._bias
        by_biases[0, self._joint_biases.count + 1] = self._scale_share * by_wheels
        # Rounded angles stay constant for many steps, so their error does not average out.
        by_wheels_alone = wheels.covariance[2, 2] - np.square(wheels.bias_jacobian[2]).sum()
        # Also account for gimbal noise, seen as a turn rate, and for accelerating wheels.
        noise = self._noise_rad_per_s**2
        seen = variance(self._compared) / _COMPARED
        faster = by_wheels - self._compared_from
        total = max(float(by_wheels_alone), seen, 0.0) + noise / _COMPARED
        total += (_MAX_LAG_S * faster / _COMPARED_S) ** 2
        self._compared.clear()
        noise_cov = np.array([[total]])
        self.comparison = LinearReading(difference, np.zeros((1, 3)), by_biases, noise_cov)

    def _sigma(self, rate: float) -> float:
        """Return the standard deviation of a reading at a turn rate."""
        return math.hypot(self._noise_rad_per_s, self._bias, self._scale_share * rate)

    def _wheels_covariance(self, twist: Array) -> Array:
        """Return the covariance of the wheel twist at `twist`.

        The errors are updated at 10 Hz, in which time a turning robot may change its direction. The
        common error of all wheels, proportional to the twist, must not lag behind, because it would
        always err to the same side.
        """
        wheels, column = self._wheels, self._joint_biases.common
        if column is None or not wheels.covariance.any():
            return wheels.covariance  # Wheels that are off have no errors.
        before = wheels.bias_jacobian[:, column]
        now = before + self._common_share * (twist - self._wheel_twist_at_refresh)
        return wheels.covariance + np.outer(now, now) - np.outer(before, before)

    def set_common_speed_share(self, share: float) -> None:
        """Set the standard deviation of the common error of all wheel speeds, before they turn."""
        super().set_common_speed_share(share)
        if self._common_share > 0.0:
            self._common_share = share

    def _mean_rate(self, sensors: Array, dt_s: float) -> float:
        """Return the mean turn rate of the step, or NaN without a reading at its end."""
        now = float(sensors[0]) if len(sensors) else math.nan
        now = now if abs(now) <= _RANGE_RAD_PER_S else math.nan
        before, self._rate = self._rate, self._delayed.add(now, dt_s)
        return 0.5 * (before + self._rate) if math.isfinite(before) else self._rate

    def _twist_errors(self, joints: Array, dt_s: float) -> TwistErrors:
        wheels = super()._twist_errors(joints, dt_s)
        self._wheels, self._wheel_twist_at_refresh = wheels, self._wheel_twist
        self._turned_rad = 0.0
        before, twist = self._at_refresh[0], self.motion.twist
        changed_s = self._refreshed_after_s or dt_s
        self._at_refresh = twist, (twist - before) / changed_s
        if not self._reads:
            return wheels
        sigma, first = self._sigma(float(twist[2])), self._joint_biases.count
        gain = wheels.covariance[:, 2] / (wheels.covariance[2, 2] + sigma**2)
        keep = np.eye(3)
        keep[:, 2] -= gain
        bias_jacobian = keep @ wheels.bias_jacobian
        bias_jacobian[:, first] = -gain * self._bias
        bias_jacobian[:, first + 1] = -gain * self._scale_share * twist[2]
        if self._age_s > 0.0:
            # Joints that are older than assumed give the velocity of an earlier heading.
            late = np.array([*self._at_refresh[1][:2], 0.0])
            bias_jacobian[:, first + 2] = self._age_s * late
        noise = dt_s * self._noise_rad_per_s**2 * np.outer(gain, gain)
        white_per_s = keep @ wheels.white_per_s @ keep.T + noise
        # Second-order terms keep combinations of velocity errors from being known as well as the
        # gyro and first-order terms suggest, most of all after whole turns.
        varying = _VARYING_SHARE * wheels.bias_jacobian[:2]
        white_per_s[:2, :2] += _VARYING_S * varying @ varying.T
        _, covariance = with_gyro(np.zeros(3), wheels.covariance, np.array(0.0), sigma)
        return TwistErrors(bias_jacobian, white_per_s, covariance)


_PULSE_S = 1.0
"""Time over which pulse rounding persists."""


class DeadWheelOdometry(PlanarOdometry):
    """Odometry from two perpendicular tracking wheels and a rate gyro, immune to drive-wheel slip.

    Source: Savnani et al. 2019, Eq. 12 to 16: distances from pulses, heading from the gyro.
    Corrected: Eq. 14 and 15 as printed hold only for straight lines; here twist and pose are
    computed in the robot frame. A step without these sensors uses the driven wheels.
    """

    def __init__(self, robot: RobotDescription, sensors: DeadWheels) -> None:
        super().__init__(robot.kinematics(), robot.joint_errors(), DEAD_WHEELS.biases(sensors))
        self._sensors = sensors
        wheels = np.array(sensors.rows()) / sensors.radius_m
        self._twist_from_rates = np.linalg.inv(np.vstack([wheels, [0.0, 0.0, 1.0]]))
        self._across = np.array(sensors.rows(0.5 * math.pi)) / sensors.radius_m
        self._angles: Array | None = None
        self._rate = 0.0
        self._between_rad2 = 0.0
        """Heading variance from turning between two readings, since the last refresh."""
        self._between_s = 0.0
        self._rates: Array | None = None

    def follow(self, joints: Array, sensors: Array, motion: TwistSolution, dt_s: float) -> None:
        """Update with joints (n,) and sensors, measured `dt_s` after the last ones.

        The first three of `sensors` are both angles and the turn rate.
        """
        before, self._rates = self._rates, None
        sensors = sensors[:3]
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


class DualRowOdometry(WheelOdometry[SO3]):
    """Dual-row odometry of a sphere: the wheel angle determines the supporting row.

    Source: Weiss et al. 2008, Eq. 8 to 12 and 25. The angle is the integrated wheel speed, starting
    at zero. As its error grows, so does the probability that the other row supports the sphere.
    """

    def __init__(self, robot: SphereDescription) -> None:
        self._sphere: SphereKinematics = robot.kinematics()
        errors = robot.joint_errors()
        super().__init__(self._sphere, errors)
        self._speed_scale_sigma = errors.speed_scale_sigma
        self.angles_rad: Array = np.zeros(self._sphere.wheels)
        """(k,): angle of each wheel."""
        self._coasted_rad: Array = np.zeros(self._sphere.wheels)
        """(k,): standard deviation of the angles turned in outages."""

    def coast(self, step: CoastStep, dt_s: float) -> None:
        """Advance by a step without measurements, in which wheels roll with the sphere."""
        rows = self._sphere.speeds_from_twist
        sigmas = np.sqrt(((rows @ step.twist_covariance) * rows).sum(axis=-1))
        self._coasted_rad = self._coasted_rad + dt_s * sigmas
        self.angles_rad = self.angles_rad + dt_s * self._sphere.inverse(step.twist)
        super().coast(step, dt_s)

    def _twist_errors(self, joints: Array, dt_s: float) -> TwistErrors:
        errors = super()._twist_errors(joints, dt_s)
        sphere, twist = self._sphere, self.motion.twist
        sigmas = np.hypot(self._speed_scale_sigma * self.angles_rad, self._coasted_rad)
        wrong = sphere.wrong_side(self.angles_rad, sigmas)
        # A wheel on the other row errs by these speeds, alternately to both sides. This cancels in
        # steady motion; the remainder is white noise.
        side = np.ones(sphere.wheels)
        changes = sphere.true_inverse(twist, side) - sphere.true_inverse(twist, -side)
        row_s = sphere.row_rad / np.maximum(np.abs(joints), sphere.row_rad / _STEADY_S)
        lasting_s = np.minimum(sigmas / sphere.row_rad, 1.0) * row_s**2 / _STEADY_S
        by_wheels = sphere.twist_from_speeds * (changes * np.sqrt(wrong))
        white = (by_wheels * lasting_s) @ by_wheels.T
        return TwistErrors(
            errors.bias_jacobian,
            errors.white_per_s + white,
            errors.covariance + by_wheels @ by_wheels.T,
        )

    def _forward(self, joints: Array, rates: Array, dt_s: float) -> TwistSolution:  # noqa: ARG002  Common signature.
        turned = self.angles_rad + dt_s * joints
        side = self._sphere.mean_side(self.angles_rad, turned)
        self.angles_rad = turned
        twist = self._sphere.true_twist(joints, side)
        left = joints - self._sphere.true_inverse(twist, side)
        return TwistSolution(twist, self._sphere.wheel_radius_m * left)


_Made: TypeAlias = tuple[WheelOdometry[Any], bool] | None


def _gyro_odometry(robot: SingularityDescription | OmniDescription) -> _Made:
    return None if robot.gyro is None else (GyroOdometry(robot, robot.gyro), True)


def _platform_odometry(robot: OmniDescription) -> _Made:
    if robot.dead_wheels is None:
        return _gyro_odometry(robot)
    return DeadWheelOdometry(robot, robot.dead_wheels), True


_ODOMETRIES = KindTable[Callable[[Any], _Made]](
    {
        SingularityDescription: _gyro_odometry,
        OmniDescription: _platform_odometry,
        SphereDescription: lambda robot: (DualRowOdometry(robot), robot.estimate.model == "dual"),
        ExternalDescription: lambda robot: (ReportedOdometry(robot), True),
    },
    lambda kind: kind.odometry,
    lambda _robot: None,
)


def sensor_odometry_of(robot: RobotDescription) -> tuple[WheelOdometry[Any] | None, bool]:
    """Return the robot's alternative odometry or None, and whether it is preferred."""
    return _ODOMETRIES.of(robot)(robot) or (None, False)
