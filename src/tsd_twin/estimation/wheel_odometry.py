"""Odometry by forward kinematics of the measured joints, with covariance; model of unmeasured wheel
speeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Generic

import numpy as np
import numpy.typing as npt

from tsd_twin.estimation.pose_spread import SPREADS, PoseErrors, PoseSpread, TwistErrors
from tsd_twin.kinematics import JointKind, Kinematics, TwistSolution
from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import FloorErrors, JointErrors, SpinUp


class JointNoise:
    """Noise model of joints: standard deviations of angles, and of speeds as a share."""

    def __init__(self, kinematics: Kinematics[Any], noise: JointErrors) -> None:
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in kinematics.joints])
        self._angle = is_angle * noise.angle_rad
        self._read_angle = is_angle * math.hypot(noise.angle_rad, noise.rounding_rad)
        self._share = ~is_angle * noise.spin_share
        self._is_speed = ~is_angle
        self._walk_rad = noise.walk_rad

    @property
    def white(self) -> Array:
        """(n,): standard deviations of what is new in each sample."""
        return self._read_angle

    def walk(self, joints: Array) -> Array:
        """Return the standard deviations (n,) of the ways of joints in a second, radians."""
        turns = self._walk_rad > 0.0 and bool(joints[self._is_speed].any())
        return self._is_speed * (self._walk_rad if turns else 0.0)

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


class FloorEffects:
    """What the floor does to a robot whose wheels always spin, for standard errors of one cause.

    It brakes wheels, and turns the robot against their spin. When it pushes, wheels slide, and
    those that drive the robot get slower for a while. It also pushes when wheels change their
    speed, against the turn that their motors give to the robot.
    """

    def __init__(self, is_speed: npt.NDArray[np.bool_], errors: FloorErrors) -> None:
        self._is_speed = is_speed
        self._errors = errors
        self.any = errors.slip_lag_s > 0.0
        """Whether it does anything."""
        self._twist: Array = np.zeros(3)
        self._spin_rad_per_s: Array | None = None
        self._slip: Array = np.zeros(3)
        """Twist by which the body is behind its wheels."""
        self._droop = 0.0
        """Share of the speed that wheels have lost by driving the robot, at `at_rad_per_s`."""

    @property
    def is_steady(self) -> bool:
        """Whether nothing has changed of late."""
        return self._droop == 0.0 and not self._slip.any()

    def follow(self, twist: Array, joints: Array, elapsed_s: float) -> None:
        """Follow `elapsed_s`, at whose end the robot moves with `twist` (3,) by `joints` (n,)."""
        errors, before = self._errors, self._twist
        spin = joints[self._is_speed]
        last_spin = spin if self._spin_rad_per_s is None else self._spin_rad_per_s
        self._twist, self._spin_rad_per_s = twist, spin
        vx, vy, omega = twist.tolist()
        push = (twist - before) / elapsed_s + np.array([-omega * vy, omega * vx, 0.0])
        push[2] += errors.turn_per_spin * float((spin - last_spin).sum()) / elapsed_s
        speed = 0.5 * float((spin + last_spin).mean()) / errors.at_rad_per_s
        self._slip = speed * errors.slip_lag_s * push
        # The energy that the robot has gained is missing in the wheels, until motors restore it.
        gained = errors.droop_s2_per_m2 * float(twist[:2] @ twist[:2] - before[:2] @ before[:2])
        restore_s = errors.restore_up_s if self._droop + gained > 0.0 else errors.restore_down_s
        half = math.exp(-0.5 * elapsed_s / restore_s)
        self._droop = half * (half * self._droop + gained)
        if abs(self._droop) < _NO_DROOP:
            self._droop = 0.0

    def of_joints(self, joints: Array) -> Array:
        """Return the errors (n,) of `joints` (n,): the floor brakes wheels that spin."""
        loss_rad_per_s = self._errors.spin_share * self._errors.at_rad_per_s
        return np.where(self._is_speed & (joints > 0.0), -loss_rad_per_s, 0.0)

    def of_twist(self, joints: Array) -> Array:
        """Return the errors (3,) of the twist at `joints` (n,), beside those that joints cause."""
        errors = self._errors
        speed = float(joints[self._is_speed].mean()) / errors.at_rad_per_s
        effect = -self._slip - self._droop / max(speed, _LEAST_SPEED) ** 2 * self._twist
        effect[2] += self.turn_rad_per_s(joints)
        return effect

    def turn_rad_per_s(self, joints: Array) -> float:
        """Return the error of the turn rate at `joints` (n,) of a robot that nothing pushes."""
        speed = float(joints[self._is_speed].mean()) / self._errors.at_rad_per_s
        return -speed * self._errors.turn_rad_per_s


_LEAST_SPEED = 0.1
"""Speed of wheels, as a share of `at_rad_per_s`, below which they do not drive the robot."""
_NO_DROOP = 1e-6
"""Share of a speed that is none."""


class ConstantErrors:
    """Constant errors of joints, in terms of independent, standard normal numbers."""

    def __init__(self, kinematics: Kinematics[Any], noise: JointErrors) -> None:
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in kinematics.joints])
        self._kinematics = kinematics
        joints = len(is_angle)
        zeros = noise.zero_rad * np.eye(joints)[is_angle]
        self._zeros = zeros[zeros.any(axis=1)]
        shares = noise.spin_share * np.eye(joints)[~is_angle]
        shares = np.vstack([shares, noise.common_spin_share * ~is_angle])
        self._shares = shares[shares.any(axis=1)]
        self._is_speed = ~is_angle
        self._floor_errors = noise.floor
        self.floor = FloorEffects(~is_angle, noise.floor)
        """The last constant, if the floor does anything."""

    @property
    def count(self) -> int:
        """Number of constants, m."""
        return len(self._zeros) + len(self._shares) + self.floor.any

    def of_twist(self, joints: Array, slopes: Array) -> Array:
        """Return the errors (3, m) of the twist at `joints` (n,), with its `slopes` (3, n)."""
        errors = slopes @ self.of_joints(joints)
        if self.floor.any:
            errors[:, -1] += self.floor.of_twist(joints)
        return errors

    def of_joints(self, joints: Array) -> Array:
        """Return the errors (n, m) of `joints` (n,)."""
        rows = [self._zeros, self._shares * joints]
        if self.floor.any:
            rows.append(self.floor.of_joints(joints)[None])
        return np.concatenate(rows).T

    def rows(self) -> dict[str, Array]:
        """Return what the constants add to each parameter of the robot, (m,); units are in names.

        A wheel's speed is off by its own share and the common one. The creep is the twist of a
        robot whose commanded gimbals are upright.
        """
        rows: dict[str, Array] = {}
        zeros, shares = len(self._zeros), len(self._zeros) + len(self._shares)
        by_joint = np.zeros((len(self._is_speed), self.count))
        by_joint[:, :zeros], by_joint[:, zeros:shares] = self._zeros.T, self._shares.T
        at_rest = self._kinematics.inverse(np.zeros(3))
        creep = np.zeros((3, self.count))
        creep[:, :zeros] = _slopes(self._kinematics, at_rest)[0] @ by_joint[:, :zeros]
        if self.floor.any:
            by_joint[self._is_speed, -1] = -self._floor_errors.spin_share
            creep[2, -1] = self.floor.turn_rad_per_s(at_rest)
            rows["slip_lag_s"] = self._floor_errors.slip_lag_s * np.eye(self.count)[-1]
        names = [joint.name for joint in self._kinematics.joints]
        for name, is_speed, row in zip(names, self._is_speed, by_joint, strict=True):
            if row.any():
                rows[f"{name}_share" if is_speed else f"{name}_rad"] = row
        for name, row in zip(("x_mps", "y_mps", "turn_rad_per_s"), creep, strict=True):
            if row.any():
                rows[f"creep_{name}"] = row
        return rows


_NUDGE = 1e-6
"""Step of finite differences: radians, or a share of a speed."""


def _slopes(kinematics: Kinematics[Any], joints: Array) -> tuple[Array, Array]:
    """Return the Jacobians (3, n) and (r, n) of twist and residual at `joints` (n,)."""
    # By differences, all joints in one batch.
    steps = _NUDGE * np.maximum(1.0, np.abs(joints))
    nudged = np.tile(joints, (len(joints) + 1, 1))
    nudged[1:] += np.diag(steps)
    motion = kinematics.forward(nudged)
    slopes = ((motion.twist[1:] - motion.twist[0]) / steps[:, None]).T
    return slopes, ((motion.residual[1:] - motion.residual[0]) / steps[:, None]).T


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
        self._until_refresh = 0
        self._since_refresh_s = 0.0
        self._means: tuple[Array | None, Array] = (None, np.zeros(3))
        """Mean twists of the last two steps."""
        self._moved = False
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
        slopes, left = _slopes(self._kinematics, joints)
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
