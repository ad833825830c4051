"""Gyro fused with wheel odometry, and the protocols of odometries."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import fmean, variance
from typing import Any, Protocol

import numpy as np

from tsd_twin.estimation.outage import CoastStep
from tsd_twin.estimation.pose_uncertainty import PoseErrors, PoseUncertainty, TwistErrors
from tsd_twin.estimation.sensor_correction import LinearReading
from tsd_twin.estimation.wheel_odometry import PlanarOdometry
from tsd_twin.kinematics import TwistSolution
from tsd_twin.lie import Array
from tsd_twin.robots import OmniDescription, SingularityDescription


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
        self._wheels = TwistErrors.none(self.uncertainty.bias_count)
        self._compared: list[float] = []
        self._compared_from = 0.0
        """Turn rate from the wheels at the first comparison."""
        self.comparison: LinearReading | None = None
        """Gyro minus wheels, if a comparison ended with the last step; independent of the pose."""

    def bias_rows(self) -> Mapping[str, Array]:
        """Return the Jacobian row (m,) of each robot parameter w.r.t. the biases."""
        bias = self._bias * np.eye(self.uncertainty.bias_count)[self._joint_biases.count]
        return {**super().bias_rows(), "gyro_bias_rad_per_s": bias}

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

    def coast(self, step: CoastStep, dt_s: float) -> None:
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
        difference, wheels = np.array([fmean(self._compared)]), self._wheels
        by_biases = wheels.bias_jacobian[2:].copy()
        by_biases[0, self._joint_biases.count] = self._bias
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
        bias_jacobian = keep @ wheels.bias_jacobian
        bias_jacobian[:, self._joint_biases.count] = -gain * self._bias
        noise = dt_s * self._noise_rad_per_s**2 * np.outer(gain, gain)
        white_per_s = keep @ wheels.white_per_s @ keep.T + noise
        _, covariance = with_gyro(np.zeros(3), wheels.covariance, np.array(0.0), self._sigma)
        return TwistErrors(bias_jacobian, white_per_s, covariance)


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

    def coast(self, step: CoastStep, dt_s: float) -> None:
        """Advance by a step of `dt_s` without measurements."""
        ...

    @property
    def motion(self) -> TwistSolution:
        """Mean motion during the last step, with its residual."""
        ...

    def bias_rows(self) -> Mapping[str, Array]:
        """Return the Jacobian row (m,) of each robot parameter w.r.t. the biases."""
        ...

    @property
    def errors(self) -> TwistErrors:
        """Errors of the twist."""
        ...

    @property
    def uncertainty(self) -> PoseUncertainty[Any, Any]:
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
