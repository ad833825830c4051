"""Odometry by forward kinematics of the measured joints, with covariance; model of unmeasured wheel
speeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Generic

import numpy as np

from tsd_twin.kinematics import JointKind, Kinematics, TwistSolution
from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import JointErrors, SpinUp


class JointNoise:
    """Noise model of joints: standard deviations of angles, and of speeds as a share."""

    def __init__(self, kinematics: Kinematics[Any], noise: JointErrors) -> None:
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in kinematics.joints])
        self._angle = is_angle * noise.angle_rad
        self._share = ~is_angle * noise.spin_share

    def sigma(self, joints: Array) -> Array:
        """Return the standard deviations (..., n) of `joints` (..., n), radians and rad/s."""
        return self._angle + self._share * np.abs(joints)


_PREDICTIONS_KEPT = 16


class SpinModel:
    """First-order model of unmeasured wheel speeds that follow their set-points."""

    def __init__(self, spin_up: SpinUp, joints: int) -> None:
        self._spin_up = spin_up
        self.spin_rad_per_s: Array = np.zeros(joints)
        """(m,): modelled speeds."""
        self._predictions: dict[tuple[bytes, float], Array] = {}
        """Results of `after`, by its arguments, while the modelled speeds are the same."""

    def advance(self, setpoint_rad_per_s: Array, dt_s: float) -> Array:
        """Return the speeds (m,) after `dt_s` of a set-point (m,)."""
        speeds = self.after(setpoint_rad_per_s, dt_s)
        if speeds.tobytes() != self.spin_rad_per_s.tobytes():
            self._predictions.clear()
        self.spin_rad_per_s = speeds
        return speeds

    def after(self, setpoint_rad_per_s: Array, dt_s: float) -> Array:
        """Predict the speeds (m,) after `dt_s` of a set-point (m,), without changing the state."""
        key = (setpoint_rad_per_s.tobytes(), dt_s)
        found = self._predictions.get(key)
        if found is None:
            found = self._predicted(setpoint_rad_per_s, dt_s)
            if len(self._predictions) >= _PREDICTIONS_KEPT:
                self._predictions.clear()
            self._predictions[key] = found
        return found

    def _predicted(self, setpoint_rad_per_s: Array, dt_s: float) -> Array:
        law = self._spin_up
        up, down = math.exp(-dt_s / law.up_s), math.exp(-dt_s / law.down_s)

        # In plain floats: for a few wheels, numpy would take four times as long.
        start, told = law.start_speed_rad_per_s, setpoint_rad_per_s.tolist()
        goals = [speed if abs(speed) >= start else 0.0 for speed in told]
        pairs = zip(goals, self.spin_rad_per_s.tolist(), strict=True)
        speeds = np.array(
            [goal + (spin - goal) * (up if abs(goal) > abs(spin) else down) for goal, spin in pairs]
        )
        speeds.setflags(write=False)
        return speeds


CORRELATION_S = 1.0
"""Time over which an error of the joints persists: quantisation and a wrong spin do not average
out from one sample to the next, so the variance grows with this time, not with the period."""
_ROUNDING = 1e-18
"""Squared m/s: rounding level of the residual of joints without redundancy."""
_REFRESH_EVERY = 10
"""Steps for which the covariance of the twist is cached, since it changes slowly."""


class JointOdometry(Generic[PoseT]):
    """Wheel odometry: pose, twist and their covariances from a stream of joint vectors.

    Joints are interpolated linearly between two samples, so that the terms in the gimbal rates add
    up to the exact displacement; the pose moves by the exponential of the twist.
    """

    def __init__(self, kinematics: Kinematics[PoseT], noise: JointErrors) -> None:
        self._kinematics = kinematics
        self._noise = JointNoise(kinematics, noise)
        self._previous: Array | None = None
        self._solved_for = b""
        self._refreshed_for: tuple[object, object] = (None, None)
        self._grows = False
        self._until_refresh = 0
        self._growth_per_s: Array = np.zeros((3, 3))
        self.pose: PoseT = kinematics.pose_type.identity()
        self.motion = TwistSolution(np.zeros(3), np.zeros(0))
        self.pose_covariance: Array = np.zeros((3, 3))
        """(3, 3): covariance of the pose, in `odom`."""
        self.twist_covariance: Array = np.zeros((3, 3))
        """(3, 3): covariance of the twist, in `base_link`; larger when joints are inconsistent."""

    def set_pose(self, pose: PoseT, covariance: Array | None = None) -> None:
        """Set the estimate to `pose`, with `covariance` (3, 3); zero if not given."""
        self.pose = pose
        self.pose_covariance = np.zeros((3, 3)) if covariance is None else covariance

    def advance(self, joints: Array, dt_s: float) -> TwistSolution:
        """Update with joints (n,) measured `dt_s` after the last ones, and return the motion."""
        previous = joints if self._previous is None else self._previous
        self._previous = joints
        step = joints - previous
        middle = previous + 0.5 * step
        self.motion = motion = self._forward(middle, step / dt_s, dt_s)
        moved = self.pose
        if any(motion.twist.tolist()):
            moved = self._kinematics.integrate(self.pose, motion.twist, dt_s)
        self._spread(moved, middle, dt_s)
        self.pose = moved
        return motion

    def _forward(self, joints: Array, rates: Array, dt_s: float) -> TwistSolution:  # noqa: ARG002  The shape.
        """Return the motion over a step of `dt_s`, from the joints (n,) half-way through it."""
        # Of a robot that stands, the same equations need not be solved again.
        same = joints.tobytes() + rates.tobytes()
        if same == self._solved_for:
            return self.motion
        self._solved_for = same
        return self._kinematics.forward(joints, rates)

    def _spread(self, moved: PoseT, joints: Array, dt_s: float) -> None:
        """Grow the covariances: first-order error propagation along the step."""
        if self._refreshed_for[0] is self.motion and self._refreshed_for[1] is moved:
            # It stands where it was: nothing is carried, and a refresh would find the same.
            self._until_refresh = (self._until_refresh + 1) % _REFRESH_EVERY
            if self._grows:
                self.pose_covariance = self.pose_covariance + dt_s * self._growth_per_s
            return
        if self._until_refresh == 0:
            self._refreshed_for = (self.motion, moved)
            self.twist_covariance = self._twist_covariance(joints)
            turn = self._axes(moved)
            self._growth_per_s = turn @ self.twist_covariance @ turn.T * CORRELATION_S
            self._grows = bool(self._growth_per_s.any())
        self._until_refresh = (self._until_refresh + 1) % _REFRESH_EVERY
        carry = self._carry(moved, dt_s)
        carried = carry @ self.pose_covariance @ carry.T
        self.pose_covariance = carried + dt_s * self._growth_per_s

    def _axes(self, pose: PoseT) -> Array:
        """Return the Jacobian (3, 3) from a twist error to an error of the pose rate."""
        raise NotImplementedError

    def _carry(self, moved: PoseT, dt_s: float) -> Array:
        """Return the Jacobian (3, 3) from an error of `self.pose` to one of the pose `moved` to."""
        raise NotImplementedError

    def _twist_covariance(self, joints: Array) -> Array:
        # The Jacobian of the forward kinematics by differences, all joints in one batch.
        nudged = np.tile(joints, (len(joints) + 1, 1))
        nudged[1:] += np.diag(np.maximum(self._noise.sigma(joints), 1e-9))
        motion = self._kinematics.forward(nudged)
        shift = motion.twist[1:] - motion.twist[0]
        return self._disbelief(motion.residual[1:] - motion.residual[0]) * (shift.T @ shift)

    def _disbelief(self, shift: Array) -> float:
        """Return the Birge ratio: squared residual over its expectation, at least 1.

        Measurements that differ by more than their errors have larger errors than stated: Birge,
        "The calculation of errors by the method of least squares" (1932).
        """
        residual = self.motion.residual
        explained = float(np.square(shift).sum())
        found = float(residual @ residual)
        return found / explained if found > explained > _ROUNDING else 1.0


class PlanarOdometry(JointOdometry[SE2]):
    """Wheel odometry of a robot on a floor: covariance of x, y, heading and of vx, vy, omega."""

    def _axes(self, pose: SE2) -> Array:
        heading = float(pose.xy_heading[2])
        c, s = math.cos(heading), math.sin(heading)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def _carry(self, moved: SE2, dt_s: float) -> Array:  # noqa: ARG002  The shape.
        dx, dy, _ = (moved.xy_heading - self.pose.xy_heading).tolist()
        return np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])


class OrientationOdometry(JointOdometry[SO3]):
    """Wheel odometry of a turning sphere: covariance of a small turn about the axes of the base.

    Twist and error are both in the axes of the base; an error turns along with the sphere.
    """

    def _axes(self, pose: SO3) -> Array:  # noqa: ARG002  The shape.
        return np.eye(3)

    def _carry(self, moved: SO3, dt_s: float) -> Array:  # noqa: ARG002  The shape.
        return SO3.exp(dt_s * self.motion.twist).as_matrix()


ODOMETRY: dict[type[Any], Callable[[Kinematics[Any], JointErrors], JointOdometry[Any]]] = {
    SE2: PlanarOdometry,
    SO3: OrientationOdometry,
}
"""Wheel odometry for each pose type."""
