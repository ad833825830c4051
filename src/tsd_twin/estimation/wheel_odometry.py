"""Odometry by forward kinematics of the measured joints, with covariance; model of unmeasured wheel
speeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Generic

import numpy as np

from tsd_twin.estimation.joint_errors import ConstantErrors, JointNoise, jacobians
from tsd_twin.estimation.outage import OutageStep
from tsd_twin.estimation.pose_spread import SPREADS, PoseErrors, PoseSpread, TwistErrors
from tsd_twin.kinematics import Kinematics, TwistSolution
from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import JointErrors, SpinUp

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


_CONTRADICTION = 10.0
"""Squared residual over its expectation beyond which joints contradict each other: a healthy robot
exceeds it once in thousands of samples."""
_ROUNDING = 1e-18
"""Squared m/s: rounding level of the residual of joints without redundancy."""
_REFRESH_EVERY = 10
"""Steps for which the errors of the twist are kept, since they change slowly."""


class JointOdometry(Generic[PoseT]):
    """Wheel odometry: pose, twist and their covariances from a stream of joint vectors.

    Joints are interpolated linearly between two samples, so that the terms in the gimbal rates add
    up to the exact displacement; the pose moves by the exponential of the twist.
    """

    def __init__(
        self, kinematics: Kinematics[PoseT], noise: JointErrors, other_constants: int = 0
    ) -> None:
        """`other_constants` is the number of constant errors beside those of the joints."""
        self._kinematics = kinematics
        self._noise = JointNoise(kinematics, noise)
        self._constants = ConstantErrors(kinematics, noise)
        count = self._constants.count + other_constants
        self._previous: Array | None = None
        self._solved_for = b""
        self._refreshed_for: tuple[object, object] = (None, None)
        self._jacobians: tuple[bytes, Array, Array] | None = None
        """Joints, and the Jacobians of twist and residual there: those of a robot at a steady
        twist stay the same while the floor restores the speed of its wheels."""
        self._until_refresh = 0
        self._since_refresh_s = 0.0
        self._means: tuple[Array | None, Array] = (None, np.zeros(3))
        """Mean twists of the last two steps."""
        self._moved = False
        self._before_outage: TwistErrors | None = None
        """Errors of the twist before an outage; None outside of one."""
        self.pose: PoseT = kinematics.pose_type.identity()
        self.motion = TwistSolution(np.zeros(3), np.zeros(0))
        """Mean motion during the last step."""
        self.errors = TwistErrors.none(count)
        """Errors of the twist; larger when joints contradict each other."""
        self.spread: PoseSpread[PoseT, Any] = SPREADS[kinematics.pose_type](count)
        """Spread of the pose error."""

    @property
    def pose_covariance(self) -> Array:
        """(3, 3): covariance of the pose, in exponential coordinates about the axes of `odom`."""
        return self.spread.covariance

    @property
    def twist_covariance(self) -> Array:
        """(3, 3): covariance of the twist, in `base_link`; larger when joints are inconsistent."""
        return self.errors.covariance

    def constant_rows(self) -> Mapping[str, Array]:
        """Return what the constants (m,) add to each parameter of the robot."""
        rows, count = self._constants.rows(), self.spread.constants
        return {name: np.pad(row, (0, count - len(row))) for name, row in rows.items()}

    @property
    def end_twist(self) -> Array:
        """(3,): twist at the end of the last step, by a straight line through the last two."""
        before, last = self._means
        return last if before is None else last + 0.5 * (last - before)

    def set_pose(self, pose: PoseT, errors: PoseErrors | None = None) -> None:
        """Set the estimate to `pose`, with pose `errors`; none if not given."""
        self.pose = pose
        self.spread.set(errors)
        self._until_refresh = 0

    def advance(self, joints: Array, dt_s: float) -> TwistSolution:
        """Update with joints (n,) measured `dt_s` after the last ones, and return the motion."""
        previous = joints if self._previous is None else self._previous
        self._previous = joints
        step = joints - previous
        middle = previous + 0.5 * step
        self._move(self._forward(middle, step / dt_s, dt_s), middle, dt_s)
        return self.motion

    def twist_of_last(self) -> Array:
        """Return the twist (3,) by the last joints, without their rates; zero before the first."""
        if self._previous is None:
            return np.zeros(3)
        return self._kinematics.forward(self._previous, np.zeros_like(self._previous)).twist

    def coast(self, step: OutageStep, dt_s: float) -> None:
        """Follow a step of `dt_s` in which the joints were not measured."""
        if step.share == 0.0 and self._before_outage is not None and not self.motion.twist.any():
            return  # It is at rest already.
        usual = self._before_outage = self._before_outage or self.errors
        by_constants, white_per_s = (
            step.share * usual.by_constants,
            step.share**2 * usual.white_per_s,
        )
        covariance = step.share**2 * usual.covariance + step.twist_covariance
        own = TwistErrors(by_constants, white_per_s, covariance)
        self.errors = replace(own, white_per_s=white_per_s + step.white_per_s)
        before, self.motion = self.pose, TwistSolution(step.twist, np.zeros(0))
        self._means = (None, step.twist)
        if any(step.twist.tolist()):
            self.pose = self._kinematics.integrate(before, step.twist, dt_s)
        # Blocks of the spread end before and after it: what it adds is no rate of the others.
        self.spread.refresh(self.errors)
        self.spread.step(before, self.pose, step.twist, dt_s)
        self.spread.refresh(own)
        self._previous = None  # How the joints have moved since is not known.
        self._solved_for, self._refreshed_for, self._until_refresh = b"", (None, None), 0
        self._since_refresh_s += dt_s

    def _forward(self, joints: Array, rates: Array, dt_s: float) -> TwistSolution:  # noqa: ARG002  The shape.
        """Return the motion over a step of `dt_s`, from the joints (n,) half-way through it."""
        # Of a robot that stands, the same equations need not be solved again.
        same = joints.tobytes() + rates.tobytes()
        if same == self._solved_for:
            return self.motion
        self._solved_for = same
        return self._kinematics.forward(joints, rates)

    def _move(self, motion: TwistSolution, joints: Array, dt_s: float) -> None:
        """Follow a step of `dt_s` with a mean `motion`; `joints` (n,) are those half-way."""
        before, twist = self.pose, motion.twist
        self._before_outage = None
        self._means = (self._means[1] if self._moved else None, twist)
        self._moved = True
        self.motion = motion
        if any(twist.tolist()):
            self.pose = self._kinematics.integrate(before, twist, dt_s)
        self.spread.step(before, self.pose, twist, dt_s)
        self._since_refresh_s += dt_s
        if self._until_refresh == 0:
            self.spread.refresh(self._refreshed(joints, dt_s))
        self._until_refresh = (self._until_refresh + 1) % _REFRESH_EVERY

    def _refreshed(self, joints: Array, dt_s: float) -> TwistErrors:
        """Return the errors of the twist; the same object for a robot that moves as before."""
        now, floor = (self.motion, joints.tobytes()), self._constants.floor
        was_steady = floor.is_steady
        if floor.any:
            floor.follow(self.motion.twist, joints, self._since_refresh_s)
        self._since_refresh_s = 0.0
        if now != self._refreshed_for or not (was_steady and floor.is_steady):
            self._refreshed_for = now
            self.errors = self._twist_errors(joints, dt_s)
        return self.errors

    def _twist_errors(self, joints: Array, dt_s: float) -> TwistErrors:
        """Return the errors of the twist at `joints` (n,), for samples every `dt_s`."""
        if self._jacobians is None or joints.tobytes() != self._jacobians[0]:
            self._jacobians = joints.tobytes(), *jacobians(self._kinematics, joints)
        _, slopes, left = self._jacobians
        constant, white = self._constants.of_joints(joints), self._noise.white
        explained = np.square(left @ constant).sum() + np.square(left * white).sum()
        doubt = self._doubt(float(explained))
        by_constants = np.zeros_like(self.errors.by_constants)
        own = self._constants.of_twist(joints, slopes)
        by_constants[:, : self._constants.count] = math.sqrt(doubt) * own
        noise, walk = math.sqrt(doubt) * slopes * white, slopes * self._noise.walk(joints)
        white_per_s = dt_s * noise @ noise.T + walk @ walk.T
        covariance = white_per_s / dt_s + by_constants @ by_constants.T
        return TwistErrors(by_constants, white_per_s, covariance)

    def _doubt(self, explained: float) -> float:
        """Return the Birge ratio, or 1 if the residual is no larger than errors make it.

        It is the squared residual over what errors `explained`. Measurements that contradict each
        other have larger errors than stated: Birge, "The calculation of errors by the method of
        least squares" (1932).
        """
        residual = self.motion.residual
        found = float(residual @ residual)
        return found / explained if found > _CONTRADICTION * explained > _ROUNDING else 1.0


POSE_SENSOR_CONSTANTS = 3
"""Constant errors of a pose sensor, the last ones of each planar odometry: x, y, heading."""


class PlanarOdometry(JointOdometry[SE2]):
    """Wheel odometry of a robot on a floor: covariance of x, y, heading and of vx, vy, omega.

    Its last constants are those of a pose sensor. They affect no twist, but a pose that was
    corrected by the sensor depends on them.
    """

    def __init__(
        self, kinematics: Kinematics[SE2], noise: JointErrors, other_constants: int = 0
    ) -> None:
        """`other_constants` is the number of constant errors of other sensors."""
        super().__init__(kinematics, noise, other_constants + POSE_SENSOR_CONSTANTS)


class OrientationOdometry(JointOdometry[SO3]):
    """Wheel odometry of a turning sphere: covariance of a small turn about the axes of the base.

    Twist and error are both in the axes of the base; an error turns along with the sphere.
    """


ODOMETRY: dict[type[Any], Callable[[Kinematics[Any], JointErrors], JointOdometry[Any]]] = {
    SE2: PlanarOdometry,
    SO3: OrientationOdometry,
}
"""Wheel odometry for each pose type."""
