"""Wheel odometry with covariance, and a model for unmeasured wheel speeds.

The errors of joints and floor come from `joint_errors.py`, growth of the pose uncertainty from
`pose_uncertainty.py`. `odometry_kinds.py` adds other sensors, `pose_fusion.py` a pose sensor.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic

import numpy as np

from tsd_twin.estimation.joint_errors import JointBiases, JointNoise, jacobians
from tsd_twin.estimation.outage import CoastStep
from tsd_twin.estimation.pose_uncertainty import (
    PoseErrors,
    PoseUncertainty,
    SE2Uncertainty,
    SO3Uncertainty,
    TwistErrors,
)
from tsd_twin.kinematics import Kinematics, TwistSolution
from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import JointErrors, WheelSpeedResponse
from tsd_twin.sensors.base import Bias


class WheelSpeedModel:
    """First-order model of unmeasured wheel speeds that follow their setpoints."""

    def __init__(self, response: WheelSpeedResponse, joints: int) -> None:
        self._response = response
        self.spin_rad_per_s: Array = np.zeros(joints)
        """(m,): modelled speeds."""

    def advance(self, setpoint_rad_per_s: Array, dt_s: float) -> Array:
        """Return the speeds (m,) after `dt_s` of a setpoint (m,)."""
        self.spin_rad_per_s = self.after(setpoint_rad_per_s, dt_s)
        return self.spin_rad_per_s

    def after(self, setpoint_rad_per_s: Array, dt_s: float) -> Array:
        """Predict the speeds (m,) after `dt_s` of a setpoint (m,), without changing the state."""
        speeds, goals = self.spin_rad_per_s.tolist(), setpoint_rad_per_s.tolist()
        return _speeds_after(self._response, tuple(speeds), tuple(goals), dt_s)


@functools.lru_cache(maxsize=16)
def _speeds_after(
    law: WheelSpeedResponse, speeds: tuple[float, ...], setpoints: tuple[float, ...], dt_s: float
) -> Array:
    """Predict wheel speeds; cached, because settled wheels repeat the same predictions."""
    up, down = math.exp(-dt_s / law.up_s), math.exp(-dt_s / law.down_s)
    # Plain floats, because numpy would take four times as long for a few wheels.
    goals = [goal if abs(goal) >= law.start_speed_rad_per_s else 0.0 for goal in setpoints]
    pairs = zip(goals, speeds, strict=True)
    after = np.array(
        [goal + (spin - goal) * (up if abs(goal) > abs(spin) else down) for goal, spin in pairs]
    )
    after.setflags(write=False)
    return after


_MAX_RESIDUAL_RATIO = 10.0
"""Ratio of squared residual to its expectation above which joints are inconsistent; a healthy robot
exceeds it once in thousands of samples."""
_ROUNDING = 1e-18
"""Squared m/s: rounding level of the residual of joints without redundancy."""
_REFRESH_STEPS = 10
"""Steps between updates of the twist errors, which change slowly."""
POSE_SENSOR_BIASES = 3
"""Biases of a pose sensor (x, y, heading), the last ones of each planar odometry.

They do not affect the twist, but a pose corrected by the sensor depends on them.
"""
_UNCERTAINTY: dict[type[Any], type[PoseUncertainty[Any, Any]]] = {
    SE2: SE2Uncertainty,
    SO3: SO3Uncertainty,
}


class WheelOdometry(Generic[PoseT]):
    """Wheel odometry: pose, twist and their covariances from a stream of joint vectors.

    Joints are interpolated linearly between samples, so that the gimbal-rate terms sum to the exact
    displacement; the pose moves by the exponential of the twist.
    """

    def __init__(
        self,
        kinematics: Kinematics[PoseT],
        noise: JointErrors,
        sensor_biases: Sequence[Bias] = (),
    ) -> None:
        """`sensor_biases` are the biases of other sensors that this odometry uses in each step."""
        self._kinematics: Kinematics[PoseT] = kinematics
        self._noise = JointNoise(kinematics, noise)
        self._joint_biases = JointBiases(kinematics, noise)
        self._sensor_biases = sensor_biases
        pose_type: type[Any] = kinematics.pose_type
        count = self._joint_biases.count + len(sensor_biases)
        count += POSE_SENSOR_BIASES if pose_type is SE2 else 0
        self._previous: Array | None = None
        self._solved_for = b""
        self._refreshed_for: tuple[object, object] = (None, None)
        self._jacobians: tuple[bytes, Array, Array] | None = None
        """Joints, and the Jacobians of twist and residual there. Cached because they are constant
        during steady motion, while the floor restores wheel speeds."""
        self._until_refresh = 0
        self._since_refresh_s = 0.0
        self._refreshed_after_s = 0.0
        """Time between the last two refreshes."""
        self._means: tuple[Array | None, Array] = (None, np.zeros(3))
        """Mean twists of the last two steps."""
        self._moved = False
        self._before_outage: TwistErrors | None = None
        """Errors of the twist before the current outage, or None without an outage."""
        self.pose: PoseT = kinematics.pose_type.identity()
        self.motion = TwistSolution(np.zeros(3), np.zeros(0))
        """Mean motion during the last step."""
        self._wheel_twist: Array = np.zeros(3)
        """(3,): mean twist during the last step from the wheels alone."""
        self.errors = TwistErrors.none(count)
        """Errors of the twist; larger if joints are inconsistent."""
        self.uncertainty: PoseUncertainty[PoseT, Any] = _UNCERTAINTY[pose_type](count)
        """Uncertainty of the pose."""

    def set_common_speed_share(self, share: float) -> None:
        """Set the standard deviation of the common error of all wheel speeds, before they turn."""
        self._joint_biases.set_common_speed_share(share)

    @property
    def pose_covariance(self) -> Array:
        """(3, 3): covariance of the pose, in exponential coordinates about the axes of `odom`."""
        return self.uncertainty.covariance

    @property
    def twist_covariance(self) -> Array:
        """(3, 3): covariance of the twist, in `base_link`; larger if joints are inconsistent."""
        return self.errors.covariance

    def bias_rows(self) -> Mapping[str, Array]:
        """Return the Jacobian row (m,) of each robot parameter w.r.t. the biases."""
        rows, count = self._joint_biases.rows(), self.uncertainty.bias_count
        unit = np.eye(count)[self._joint_biases.count :]
        sensors = zip(self._sensor_biases, unit, strict=False)
        return {
            **{name: np.pad(row, (0, count - len(row))) for name, row in rows.items()},
            **{bias.name: bias.sigma * row for bias, row in sensors},
        }

    @property
    def end_twist(self) -> Array:
        """(3,): twist at the end of the last step, extrapolated linearly from the last two."""
        before, last = self._means
        return last if before is None else last + 0.5 * (last - before)

    def set_pose(self, pose: PoseT, errors: PoseErrors | None = None) -> None:
        """Set the estimate to `pose`, with pose `errors` (zero by default)."""
        self.pose = pose
        self.uncertainty.set(errors)
        self._until_refresh = 0

    def advance(self, joints: Array, dt_s: float) -> TwistSolution:
        """Update with joints (n,) measured `dt_s` after the last ones, and return the motion."""
        previous = joints if self._previous is None else self._previous
        self._previous = joints
        step = joints - previous
        middle = previous + 0.5 * step
        self._move(self._forward(middle, step / dt_s, dt_s), middle, dt_s)
        return self.motion

    def follow(self, joints: Array, sensors: Array, motion: TwistSolution, dt_s: float) -> None:  # noqa: ARG002  Joints only.
        """Update with joints (n,) and other sensors (s,), NaN without a reading.

        They were measured `dt_s` after the last ones; `motion` is the forward-kinematics solution
        for the joints. The default uses the joints only.
        """
        self.advance(joints, dt_s)

    def twist_of_last(self) -> Array:
        """Return the twist (3,) at the last joints, without their rates; zero before the first."""
        if self._previous is None:
            return np.zeros(3)
        return self._kinematics.forward(self._previous, np.zeros_like(self._previous)).twist

    def coast(self, step: CoastStep, dt_s: float) -> None:
        """Advance by a step of `dt_s` in which the joints were not measured."""
        if step.share == 0.0 and self._before_outage is not None and not self.motion.twist.any():
            return  # Already at rest.
        nominal = self._before_outage = self._before_outage or self.errors
        own = TwistErrors(
            step.share * nominal.bias_jacobian,
            step.share**2 * nominal.white_per_s,
            step.share**2 * nominal.covariance + step.twist_covariance,
        )
        self.errors = replace(own, white_per_s=own.white_per_s + step.white_per_s)
        before, self.motion = self.pose, TwistSolution(step.twist, np.zeros(0))
        self._means = (None, step.twist)
        if any(step.twist.tolist()):
            self.pose = self._kinematics.integrate(before, step.twist, dt_s)
        # Isolate the step in its own block, so that its noise is not applied to other steps.
        self.uncertainty.refresh(self.errors)
        self.uncertainty.step(before, self.pose, step.twist, dt_s)
        self.uncertainty.refresh(own)
        self._previous = None  # Joint motion during the outage is unknown.
        self._solved_for, self._refreshed_for, self._until_refresh = b"", (None, None), 0
        self._since_refresh_s += dt_s

    def _forward(self, joints: Array, rates: Array, dt_s: float) -> TwistSolution:  # noqa: ARG002  Common signature.
        """Return the motion over a step of `dt_s`, from the joints (n,) at its midpoint."""
        # Skip the solution if nothing changed, as for a robot at rest.
        same = joints.tobytes() + rates.tobytes()
        if same == self._solved_for:
            return self.motion
        self._solved_for = same
        return self._kinematics.forward(joints, rates)

    def _move(
        self, motion: TwistSolution, joints: Array, dt_s: float, by_wheels: Array | None = None
    ) -> None:
        """Advance by `dt_s` with the mean `motion`; `joints` (n,) are at the midpoint.

        `by_wheels` (3,) is the twist from the wheels alone, if another sensor corrected the motion.
        """
        before, twist = self.pose, motion.twist
        self._wheel_twist = twist if by_wheels is None else by_wheels
        self._before_outage = None
        self._means = (self._means[1] if self._moved else None, twist)
        self._moved = True
        self.motion = motion
        if any(twist.tolist()):
            self.pose = self._kinematics.integrate(before, twist, dt_s)
        self.uncertainty.step(before, self.pose, twist, dt_s)
        self._since_refresh_s += dt_s
        if self._until_refresh == 0:
            self.uncertainty.refresh(self._refreshed(joints, dt_s))
        self._until_refresh = (self._until_refresh + 1) % _REFRESH_STEPS

    def _refreshed(self, joints: Array, dt_s: float) -> TwistErrors:
        """Return the errors of the twist; the same object in steady motion."""
        now, floor = (self.motion, joints.tobytes()), self._joint_biases.floor
        is_steady = not self._joint_biases.follows_heading
        if floor is not None:
            was_steady = floor.is_steady
            floor.follow(self._wheel_twist, joints, self._since_refresh_s)
            is_steady = is_steady and was_steady and floor.is_steady
        self._refreshed_after_s, self._since_refresh_s = self._since_refresh_s, 0.0
        if now != self._refreshed_for or not is_steady:
            self._refreshed_for = now
            self.errors = self._twist_errors(joints, dt_s)
        return self.errors

    def _twist_errors(self, joints: Array, dt_s: float) -> TwistErrors:
        """Return the errors of the twist at `joints` (n,), for samples every `dt_s`."""
        if self._jacobians is None or joints.tobytes() != self._jacobians[0]:
            self._jacobians = joints.tobytes(), *jacobians(self._kinematics, joints)
        _, slopes, left = self._jacobians
        by_bias, white = self._joint_biases.of_joints(joints), self._noise.white
        explained = np.square(left @ by_bias).sum() + np.square(left * white).sum()
        ratio = self._birge_ratio(float(explained))
        bias_jacobian = np.zeros_like(self.errors.bias_jacobian)
        heading = float(self.pose.xy_heading[2]) if isinstance(self.pose, SE2) else 0.0
        own = self._joint_biases.of_twist(joints, slopes, self.motion.twist, heading)
        bias_jacobian[:, : self._joint_biases.count] = math.sqrt(ratio) * own
        noise, walk = math.sqrt(ratio) * slopes * white, slopes * self._noise.walk(joints)
        white_per_s = dt_s * noise @ noise.T + walk @ walk.T
        covariance = white_per_s / dt_s + bias_jacobian @ bias_jacobian.T
        if self._joint_biases.floor is not None:
            white_per_s = white_per_s + self._joint_biases.floor.uneven_per_s
        return TwistErrors(bias_jacobian, white_per_s, covariance)

    def _birge_ratio(self, explained: float) -> float:
        """Return the Birge ratio, or 1 if errors explain the residual.

        The ratio of the squared residual to its `explained` expectation, because inconsistent
        measurements have larger errors than stated. Source: Birge, "The calculation of errors by
        the method of least squares" (1932).
        """
        residual = self.motion.residual
        found = float(residual @ residual)
        return found / explained if found > _MAX_RESIDUAL_RATIO * explained > _ROUNDING else 1.0


class PlanarOdometry(WheelOdometry[SE2]):
    """Wheel odometry on a floor: covariance of x, y, heading and of vx, vy, omega."""
