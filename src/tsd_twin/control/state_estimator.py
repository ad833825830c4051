"""State estimation for the control loop: joints, odometry, pose fusion and consistency."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import fmean
from typing import Any

import numpy as np

from tsd_twin.control.sensor_inputs import PoseMeasurements
from tsd_twin.estimation import (
    AGE_SHARE,
    OUTAGE_S,
    CoastStep,
    ConsistencyMonitor,
    FusedEstimate,
    GyroOdometry,
    MeasurementOutage,
    ReportedOdometry,
    SensorCorrection,
    WheelOdometry,
    WheelSpeedModel,
    sensor_odometry_of,
)
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.cdr import Odometry
from tsd_twin.messages.status import BiasStatus, ConsistencyStatus
from tsd_twin.robots import RobotDescription

_LAST_STEP_S = 0.01
"""Length of the final step after an outage, which uses the new joint measurement."""
NEUTRAL_RAD = math.radians(1.0)
"""Neutral tolerance for gimbals."""
AT_SPEED = 0.02
"""Relative speed tolerance for wheels with a non-zero setpoint."""
AT_REST_RAD_PER_S = 0.1
"""Absolute speed tolerance for wheels with a zero setpoint."""
VOLT_STEP = 0.1
"""Resolution of the supply voltage reported by an MX-64 (Robotis e-Manual, present voltage)."""
_SUPPLY_FILTER_S = 1.0
"""Time constant of the filter of the reported voltage."""
_PLAUSIBLE_SUPPLY = (0.5, 1.5)
"""Reported voltages relative to nominal that are used."""


class SupplyVoltage:
    """Supply voltage relative to nominal, from reports in steps of 0.1 V.

    The speed of a drive motor on a given throttle is proportional to it, because the curves of
    `[motor]` are measured at nominal voltage.
    """

    def __init__(self, nominal_v: float) -> None:
        self._nominal_v = nominal_v
        self.is_known = False
        """Whether a voltage has been reported."""
        self.share = 1.0
        """Filtered voltage relative to nominal; 1 before a report."""

    @property
    def sigma(self) -> float:
        """Standard deviation of `share` by the resolution of the reports."""
        return VOLT_STEP / math.sqrt(12.0) / self._nominal_v

    def advance(self, battery_v: float | None, dt_s: float) -> None:
        """Advance by `dt_s` with the latest report, or None; implausible reports are ignored."""
        if battery_v is None:
            return
        share = battery_v / self._nominal_v
        if not _PLAUSIBLE_SUPPLY[0] <= share <= _PLAUSIBLE_SUPPLY[1]:
            return
        gain = 1.0 - math.exp(-dt_s / _SUPPLY_FILTER_S) if self.is_known else 1.0
        self.share += gain * (share - self.share)
        self.is_known = True


class StateEstimator:
    """State estimator of a robot: joints, pose, twist and consistency."""

    def __init__(self, robot: RobotDescription) -> None:
        self.kinematics = robot.kinematics()
        self._delay_s = robot.delay_s
        """Age of joint measurements; the estimate is of that time, extrapolated to now."""
        self.is_angle = np.array([j.kind is JointKind.POSITION for j in self.kinematics.joints])
        """(n,): True for position joints, False for velocity joints."""
        self._angles = np.flatnonzero(self.is_angle)
        self._wheels = np.flatnonzero(~self.is_angle)
        self._needed = np.flatnonzero(self.is_angle | robot.measures_spin)
        self._spin = WheelSpeedModel(robot.spin_up(), len(self._wheels))
        self._supply = SupplyVoltage(robot.battery.nominal_v)
        self._motor_share = robot.joint_errors().motor_share
        self._wheel_odom = WheelOdometry(self.kinematics, robot.joint_errors())
        self._aux_odom, prefer_second = sensor_odometry_of(robot)
        self._dead_reckoning = (
            self._aux_odom if prefer_second and self._aux_odom else self._wheel_odom
        )
        self._fused: FusedEstimate | None = None
        if self.kinematics.pose_type is SE2:
            own = sum(len(sensor.channels(table)) for sensor, table in robot.own_sensors)
            correction = SensorCorrection(
                own, robot.mounted_sensors, self._dead_reckoning.uncertainty.bias_count
            )
            self._fused = FusedEstimate(
                self.kinematics, self._dead_reckoning, robot.pose_sensor, correction
            )
        self._output = self._fused or self._dead_reckoning
        self.pose_sensor = PoseMeasurements(self._fused)
        """Measurements from an external pose sensor."""
        self._consistency = ConsistencyMonitor(
            self.kinematics, robot.joint_errors(), robot.joint_compliance()
        )
        self.measured_s = -math.inf
        """Time of the last joint measurement."""
        self.joints = np.where(self.is_angle, self.kinematics.inverse(np.zeros(3)), 0.0)
        """(n,): measured joints; unmeasured wheel speeds come from the motor model."""
        self._previous_joints, self._step_s = self.joints, 1.0
        speed = robot.limits.speed_mps / self.kinematics.twist_scale_m
        full_twist = np.array([speed, speed, robot.limits.turn_rate_rad_per_s])
        self._outage = MeasurementOutage(full_twist, robot.stopping_s)
        self._unmeasured = np.full(len(robot.sensors), np.nan)
        self._unmeasured.setflags(write=False)
        self.sensors = self._unmeasured
        """(s,): last readings of the other sensors, NaN where missing."""

    def advance(
        self,
        now_s: float,
        measured: Array | None,
        setpoint: Array,
        dt_s: float,
        battery_v: float | None = None,
    ) -> None:
        """Advance the estimate by `dt_s` to `now_s`.

        Args:
            now_s: End of the step.
            measured: (n + s,) joints and other sensors, or None if no measurement arrived.
            setpoint: (n,) joint setpoints during the step.
            dt_s: Time since the previous step.
            battery_v: Reported battery voltage, or None; scales unmeasured wheel speeds.
        """
        self._update_supply(battery_v, dt_s)
        spin = self._supply.share * self._spin.advance(setpoint[self._wheels], dt_s)
        if measured is not None and all(map(math.isfinite, measured[self._needed].tolist())):
            if dt_s > OUTAGE_S and math.isfinite(self.measured_s):
                self._coast(now_s - _LAST_STEP_S, dt_s - _LAST_STEP_S)
                dt_s = _LAST_STEP_S
            self._outage.end()
            self.measured_s = now_s
            joints = measured[: len(self.joints)].copy()
            others = measured[len(joints) :]
            self.sensors = others.copy() if len(others) else self._unmeasured
            modelled = ~np.isfinite(joints)
            unmeasured = modelled[self._wheels]
            joints[self._wheels[unmeasured]] = spin[unmeasured]
        elif math.isfinite(self.measured_s):
            # Hold gimbal angles; let the motor model spin the wheels down.
            joints, modelled = self.joints.copy(), ~self.is_angle
            joints[self._wheels] = spin
            self.sensors = self._unmeasured
        else:
            return
        self._previous_joints, self._step_s, self.joints = self.joints, dt_s, joints
        if self.measured_s < now_s:
            if self._outage.elapsed_s + dt_s > OUTAGE_S:
                self._coast(now_s, dt_s)
                return
            self._step_of_outage(dt_s)
        motion = self._wheel_odom.advance(joints, dt_s)
        if self._aux_odom is not None:
            self._aux_odom.follow(joints, self.sensors, motion, dt_s)
        if self._fused is not None:
            self._fuse(self._fused, now_s - self._delay_s)
        self._consistency.advance(joints, dt_s, modelled=modelled)

    def _update_supply(self, battery_v: float | None, dt_s: float) -> None:
        """Use a reported voltage; if the wheels are at rest, with its smaller uncertainty.

        The common error of wheels that turn already is partly learned and integrated, so its size
        does not change.
        """
        was_known = self._supply.is_known
        self._supply.advance(battery_v, dt_s)
        turning = bool(self._spin.spin_rad_per_s.any())
        if self._supply.is_known and not was_known and not turning:
            for odometry in filter(None, (self._wheel_odom, self._aux_odom)):
                odometry.set_common_speed_share(math.hypot(self._supply.sigma, self._motor_share))

    def _fuse(self, fused: FusedEstimate, at_s: float) -> None:
        """Fuse the sensor readings, and learn biases from the gyro."""
        fused.follow(at_s)
        fused.fuse_readings(self.sensors, at_s)
        if isinstance(self._aux_odom, GyroOdometry) and self._aux_odom.comparison is not None:
            comparison = self._aux_odom.comparison
            by = fused.sensors.padded(comparison.bias_jacobian)
            fused.learning.compare(at_s, comparison._replace(bias_jacobian=by))

    def _coast(self, now_s: float, dt_s: float) -> None:
        """Propagate an outage by `dt_s` to `now_s`, without measurements."""
        step = self._step_of_outage(dt_s)
        self._wheel_odom.coast(step, dt_s)
        if self._aux_odom is not None:
            self._aux_odom.coast(step, dt_s)
        if self._fused is not None:
            self._fused.follow(now_s - self._delay_s)

    def _step_of_outage(self, dt_s: float) -> CoastStep:
        if self._outage.elapsed_s == 0.0:
            self._outage.begin(self._wheel_odom.twist_of_last())
        return self._outage.advance(dt_s)

    @property
    def rates(self) -> Array:
        """(n,): joint rates; accelerations for wheels."""
        return (self.joints - self._previous_joints) / self._step_s

    def neutral_and_at_speed(self, at_rest: Array) -> tuple[bool, bool]:
        """Return whether all gimbals are neutral, and whether all wheels reached their setpoint.

        `at_rest` (n,) are the joints of a ready robot at rest.
        """
        at_speed = np.maximum(AT_SPEED * np.abs(at_rest), AT_REST_RAD_PER_S)
        tolerance = np.where(self.is_angle, NEUTRAL_RAD, at_speed)
        # The voltage of the supply changes the speed of a wheel at its setpoint.
        joints = self.joints.copy()
        if not len(np.intersect1d(self._needed, self._wheels)):
            joints[self._wheels] /= self._supply.share
        near = np.abs(joints - at_rest) <= tolerance
        return bool(near[self._angles].all()), bool(near[self._wheels].all())

    def spin_after(self, speeds: Array, dt_s: float) -> float:
        """Return the mean wheel speed predicted by the motor model after `dt_s` at `speeds` (m,).

        The model is used even if speeds are measured, so that a failed sensor cannot change the
        tilt.
        """
        return fmean(self._spin.after(speeds, dt_s).tolist())

    @property
    def pose(self) -> Any:
        """Estimated pose in `odom`: `SE2` or `SO3`, depending on the kinematics."""
        return self._now(self._output)

    def _now(self, estimate: FusedEstimate | WheelOdometry[Any]) -> Any:
        """Return the pose of an estimate, extrapolated by the age of the joint measurements."""
        if self._delay_s == 0.0 or not estimate.end_twist.any():
            return estimate.pose
        return self.kinematics.integrate(estimate.pose, estimate.end_twist, self._delay_s)

    @property
    def unfused_pose(self) -> Any:
        """Pose of dead reckoning alone, without poses of a pose sensor; in `odom`."""
        return self._now(self._dead_reckoning)

    @property
    def mean_twist(self) -> Array:
        """(3,): mean twist during the last step, used to integrate the pose."""
        return self._dead_reckoning.motion.twist

    @property
    def end_twist(self) -> Array:
        """(3,): twist in `base_link` at the end of the last step."""
        return self._output.end_twist

    def set_pose(self, pose: SE2 | SO3) -> None:
        """Set the estimate to `pose`, with zero covariance."""
        self._wheel_odom.set_pose(pose)
        if self._aux_odom is not None:
            self._aux_odom.set_pose(pose)
        self._output.set_pose(pose)

    def odometry(self, stamp_ns: int) -> Odometry:
        """Return pose in `odom` and twist in `base_link`, with covariances."""
        return self._message(self._output, stamp_ns)

    def alternative_odometry(self, stamp_ns: int) -> Odometry | None:
        """Return the second estimate, or None if there is only one.

        It is not corrected by pose measurements.
        """
        second = self._aux_odom
        corrected = self._fused is not None and self._fused.is_corrected
        if second is not None and not isinstance(second, ReportedOdometry):
            return self._message(
                self._wheel_odom if self._dead_reckoning is second else second, stamp_ns
            )
        return self._message(self._dead_reckoning, stamp_ns) if corrected else None

    def learned(self) -> Mapping[str, BiasStatus] | None:
        """Return estimated biases by name, or None before a pose sensor or gyro observed any."""
        if self._fused is None or not self._fused.learning.has_measured:
            return None
        rows = self._fused.sensors.bias_rows(self._dead_reckoning.bias_rows())
        found = self._fused.learning.learned(rows)
        return {name: BiasStatus(value, sigma) for name, (value, sigma) in found.items()}

    def consistency(self, *, wheels_spin: bool) -> ConsistencyStatus:
        """Return the joint consistency; wheels at rest carry no information on gimbals."""
        verdict, names = self._consistency.judge(self.joints), self.kinematics.actuators
        level = verdict.level if wheels_spin else 0.0
        suspect = verdict.suspect if wheels_spin else None
        return ConsistencyStatus(
            residual_mps=round(verdict.residual_mps, 5),
            suspect=None if suspect is None else names[suspect],
            level=round(level, 4),
            contributions=dict(zip(names, (level * verdict.shares).round(4).tolist(), strict=True)),
        )

    def _message(self, estimate: FusedEstimate | WheelOdometry[Any], stamp_ns: int) -> Odometry:
        pose, twist, covariance = self._now(estimate), estimate.end_twist, estimate.pose_covariance
        if self._delay_s > 0.0 and twist.any():
            moved = AGE_SHARE * self._delay_s * np.array([*pose.rotate(twist[:2]), twist[2]])
            covariance = covariance + np.outer(moved, moved)
        return Odometry.of(pose, twist, covariance, estimate.twist_covariance, stamp_ns)
