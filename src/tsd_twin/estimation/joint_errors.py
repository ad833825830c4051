"""Joint and floor-contact errors: white noise and biases, as errors of the twist.

Biases cover joint zeros, wheel speeds, friction on spinning wheels, and roller creep.
`wheel_odometry.py` assembles them into `TwistErrors`, whose effect on the pose grows in
`pose_uncertainty.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tsd_twin.kinematics import JointKind, Kinematics
from tsd_twin.lie import Array
from tsd_twin.robots import FloorErrors, JointErrors


class JointNoise:
    """Noise model of joints: absolute for angles, relative for speeds."""

    def __init__(self, kinematics: Kinematics[Any], noise: JointErrors) -> None:
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in kinematics.joints])
        self._angle = is_angle * noise.angle_rad
        self.white: Array = is_angle * math.hypot(noise.angle_rad, noise.rounding_rad)
        """(n,): standard deviations of the white noise."""
        self._speed_scale_sigma = ~is_angle * noise.speed_scale_sigma
        self._is_speed = ~is_angle
        self._walk_rad = noise.random_walk_rad

    def walk(self, joints: Array) -> Array:
        """Return the random walk (n,) of the joints per square root of a second, radians."""
        turns = self._walk_rad > 0.0 and bool(joints[self._is_speed].any())
        return self._is_speed * (self._walk_rad if turns else 0.0)

    def sigma(self, joints: Array) -> Array:
        """Return the standard deviations (..., n) of `joints` (..., n), radians and rad/s."""
        return self._angle + self._speed_scale_sigma * np.abs(joints)


def acceleration(before: Array, twist: Array, elapsed_s: float) -> Array:
    """Return the acceleration (3,) over the ground between two twists, in body axes."""
    vx, vy, omega = twist.tolist()
    return (twist - before) / elapsed_s + np.array([-omega * vy, omega * vx, 0.0])


def slip_of(push: Array, lag_s: float, elapsed_s: float, grip_per_s2: Sequence[float]) -> Array:
    """Return the slip (3,) between wheels and body after a step in which they gain on the body.

    Wheels gain `push` (3,) per second, and the floor accelerates the body by `grip_per_s2` times
    s / (s + `lag_s`), with the slip s in units of `grip_per_s2`. The step is implicit, so that the
    body slides equally far in steps of any length.
    """
    pushed = float(np.linalg.norm(push / grip_per_s2))
    if lag_s * pushed < _NO_SLIP_S:
        return np.zeros(3)
    half = 0.5 * (lag_s + elapsed_s * (1.0 - pushed))
    root = math.sqrt(half * half + elapsed_s * lag_s * pushed)
    slip_s = elapsed_s * lag_s * pushed / (half + root) if half > 0.0 else root - half
    return slip_s / pushed * push


class FloorEffects:
    """Systematic floor effects on a robot with continuously spinning wheels (1σ).

    Drag: the floor slows the wheels and turns the robot against their spin. Lag: when the floor
    accelerates the robot, wheels slip; when wheel speeds change, the floor also counteracts the
    motors' reaction torque. Lost energy: driving wheels lose speed for a while. Lag grows as
    friction falls and drag shrinks, so their causes are independent.
    """

    count = 3
    """Number of causes: drag, lag, lost energy."""

    def __init__(self, is_speed: npt.NDArray[np.bool_], errors: FloorErrors) -> None:
        self._is_speed = is_speed
        self.errors = errors
        self._twist: Array = np.zeros(3)
        self._spin_rad_per_s: Array | None = None
        self._slip: Array = np.zeros(3)
        """Slip: twist by which the body lags its wheels."""
        self._droop = 0.0
        """Relative speed lost by driving wheels, at `at_rad_per_s`."""

    @property
    def is_steady(self) -> bool:
        """Whether all transients have decayed."""
        return self._droop == 0.0 and not self._slip.any()

    def follow(self, twist: Array, joints: Array, elapsed_s: float) -> None:
        """Advance by `elapsed_s`, ending with `twist` (3,) and `joints` (n,)."""
        errors, before = self.errors, self._twist
        spin = joints[self._is_speed]
        last_spin = spin if self._spin_rad_per_s is None else self._spin_rad_per_s
        self._twist, self._spin_rad_per_s = twist, spin
        push = acceleration(before - self._slip, twist, elapsed_s)
        push[2] += errors.turn_per_spin * float((spin - last_spin).sum()) / elapsed_s
        speed = 0.5 * float((spin + last_spin).mean()) / errors.at_rad_per_s
        self._slip = slip_of(push, speed * errors.slip_lag_s, elapsed_s, errors.grip_per_s2)
        # Kinetic energy gained by the robot is taken from the wheels until the motors restore it.
        gained = errors.droop_s2_per_m2 * float(twist[:2] @ twist[:2] - before[:2] @ before[:2])
        restore_s = errors.restore_up_s if self._droop + gained > 0.0 else errors.restore_down_s
        half = math.exp(-0.5 * elapsed_s / restore_s)
        self._droop = half * (half * self._droop + gained)
        if abs(self._droop) < _NO_DROOP:
            self._droop = 0.0

    def of_joints(self, joints: Array) -> Array:
        """Return the errors (c, n) of `joints` (n,): friction slows spinning wheels."""
        loss_rad_per_s = self.errors.speed_scale_sigma * self.errors.at_rad_per_s
        rows = np.zeros((self.count, len(joints)))
        rows[0] = np.where(self._is_speed & (joints > 0.0), -loss_rad_per_s, 0.0)
        return rows

    def of_twist(self, joints: Array) -> Array:
        """Return the errors (3, c) of the twist at `joints` (n,), in addition to joint errors."""
        errors = self.errors
        speed = float(joints[self._is_speed].mean()) / errors.at_rad_per_s
        effects = np.zeros((3, self.count))
        effects[2, 0] = self.turn_rad_per_s(joints)
        effects[:, 1] = -self._slip
        effects[:, 2] = -self._droop / max(speed, _MIN_SPEED) ** 2 * self._twist
        return effects

    def creep(self, joints: Array, heading_rad: float) -> Array:
        """Return the twists (3, 2) per acceleration along X and Y of a sloping floor."""
        speed = float(joints[self._is_speed].mean()) / self.errors.at_rad_per_s
        return speed * self.errors.slip_lag_s * _axes(heading_rad)

    @property
    def uneven_per_s(self) -> Array:
        """(3, 3): covariance per second of slip that does not cancel, see `_UNEVEN_SHARE`."""
        return _uneven_per_s(self._slip)

    def turn_rad_per_s(self, joints: Array) -> float:
        """Return the turn-rate error at `joints` (n,) in steady motion."""
        speed = float(joints[self._is_speed].mean()) / self.errors.at_rad_per_s
        return -speed * self.errors.turn_rad_per_s


_NO_SLIP_S = 1e-9
"""Time for which a floor accelerates a body at full grip, below which slip is treated as zero."""
_MIN_SPEED = 0.1
"""Wheel speed relative to `at_rad_per_s` below which wheels do not drive the robot."""
_NO_DROOP = 1e-6
"""Relative speed loss treated as zero."""


class RollerCreep:
    """Modelled creep of a robot on rollers, proportional to the contact force."""

    count = 1
    """Number of causes."""

    def __init__(self, lag_s: Array) -> None:
        self._lag_s = lag_s
        self._twist: Array = np.zeros(3)
        self._creep: Array = np.zeros(3)
        """Twist by which the body lags its wheels."""

    @property
    def is_steady(self) -> bool:
        """Whether all transients have decayed."""
        return not self._creep.any()

    def follow(self, twist: Array, joints: Array, elapsed_s: float) -> None:  # noqa: ARG002  As in `FloorEffects`.
        """Advance by `elapsed_s`, after which the robot moves with `twist` (3,)."""
        push = acceleration(self._twist, twist, elapsed_s)
        self._twist, self._creep = twist, self._lag_s @ push

    def of_joints(self, joints: Array) -> Array:
        """Return zero joint errors (1, n), because encoders measure the wheels."""
        return np.zeros((1, len(joints)))

    def of_twist(self, joints: Array) -> Array:  # noqa: ARG002  As in `FloorEffects`.
        """Return the errors (3, 1) of the twist."""
        return -self._creep[:, None]

    def creep(self, joints: Array, heading_rad: float) -> Array:  # noqa: ARG002  As in `FloorEffects`.
        """Return the twists (3, 2) per acceleration along X and Y of a sloping floor."""
        return self._lag_s @ _axes(heading_rad)

    @property
    def uneven_per_s(self) -> Array:
        """(3, 3): covariance per second of creep that does not cancel, see `_UNEVEN_SHARE`."""
        return _uneven_per_s(self._creep)


_UNEVEN_SHARE = 0.25
"""Slip during one acceleration that does not cancel in the next, relative to its size: hard braking
slides further than a gentle start, in a proportion that depends on friction. Tuned on seeds 5000
and up."""
_UNEVEN_S = 0.2
"""Typical duration of an acceleration."""


def _uneven_per_s(slip: Array) -> Array:
    """Return the covariance (3, 3) per second of the part of a `slip` (3,) that does not cancel."""
    uneven = _UNEVEN_SHARE * slip
    return _UNEVEN_S * np.outer(uneven, uneven)


def _axes(heading_rad: float) -> Array:
    """Return the axes X and Y of `odom` (3, 2) in the frame of a robot with this heading."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return np.array([[c, s], [-s, c], [0.0, 0.0]])


class JointBiases:
    """Joint biases in terms of independent, standard normal numbers."""

    def __init__(self, kinematics: Kinematics[Any], noise: JointErrors) -> None:
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in kinematics.joints])
        self._kinematics = kinematics
        joints = len(is_angle)
        zeros = noise.zero_rad * np.eye(joints)[is_angle]
        self._zeros = zeros[zeros.any(axis=1)]
        scales = noise.speed_scale_sigma * np.eye(joints)[~is_angle]
        scales = np.vstack([scales, noise.common_spin_share * ~is_angle])
        self._speed_scales = scales[scales.any(axis=1)]
        self._has_common = noise.common_spin_share > 0.0
        self._is_speed = ~is_angle
        self._layout = getattr(kinematics, "contact_layout", None)
        self._built: Array = np.zeros(0)
        """(4 k,): standard deviations of the errors of the layout; empty if it is exact."""
        if self._layout is not None and (noise.mount_rad > 0.0 or noise.place_m > 0.0):
            one = [noise.mount_rad, noise.mount_rad, noise.place_m, noise.place_m]
            self._built = np.tile(one, len(self._layout.places_m))
        self._slope_mps2 = noise.slope_mps2
        self.floor: FloorEffects | RollerCreep | None = None
        """Floor whose effects are the last biases, or None without effects."""
        if noise.creep_lag_s is not None:
            self.floor = RollerCreep(np.array(noise.creep_lag_s))
        elif noise.floor.slip_lag_s > 0.0:
            self.floor = FloorEffects(~is_angle, noise.floor)

    def set_common_speed_share(self, share: float) -> None:
        """Set the standard deviation of the common error of all wheel speeds, if there is one."""
        if self._has_common:
            self._speed_scales[-1] = share * self._is_speed

    @property
    def count(self) -> int:
        """Number of biases, m."""
        slopes = 2 if self.follows_heading else 0
        return self._built_from + len(self._built) + slopes

    @property
    def follows_heading(self) -> bool:
        """Whether the errors of the twist change as the robot turns, even with constant joints."""
        return self._slope_mps2 > 0.0 and self.floor is not None

    @property
    def common(self) -> int | None:
        """Index of the common error of all wheel speeds, or None without one."""
        return self._floor_from - 1 if self._has_common else None

    @property
    def _floor_from(self) -> int:
        return len(self._zeros) + len(self._speed_scales)

    @property
    def _built_from(self) -> int:
        return self._floor_from + (0 if self.floor is None else self.floor.count)

    def of_twist(self, joints: Array, slopes: Array, twist: Array, heading_rad: float) -> Array:
        """Return the errors (3, m) of the `twist` (3,) at `joints` (n,), heading in `odom`.

        `slopes` (3, n) is its Jacobian with respect to the joints.
        """
        errors = slopes @ self.of_joints(joints)
        first, end = self._built_from, self._built_from + len(self._built)
        if self.floor is not None:
            errors[:, self._floor_from : first] += self.floor.of_twist(joints)
            if end < self.count:
                errors[:, end:] = self._slope_mps2 * self.floor.creep(joints, heading_rad)
        if self._layout is not None and end > first:
            errors[:, first:end] = self._layout.slopes(twist) * self._built
        return errors

    def of_joints(self, joints: Array) -> Array:
        """Return the errors (n, m) of `joints` (n,)."""
        rows = [self._zeros, self._speed_scales * joints]
        if self.floor is not None:
            rows.append(self.floor.of_joints(joints))
        rows.append(np.zeros((self.count - self._built_from, len(joints))))
        return np.concatenate(rows).T

    def rows(self) -> dict[str, Array]:
        """Return the Jacobian row (m,) of each robot parameter; names contain units.

        A wheel's speed error is the sum of its individual and the common error. Creep is the twist
        of a robot whose commanded gimbals are upright.
        """
        rows: dict[str, Array] = {}
        zeros, scales = len(self._zeros), self._floor_from
        by_joint = np.zeros((len(self._is_speed), self.count))
        by_joint[:, :zeros], by_joint[:, zeros:scales] = self._zeros.T, self._speed_scales.T
        at_rest = self._kinematics.inverse(np.zeros(3))
        creep = np.zeros((3, self.count))
        creep[:, :zeros] = jacobians(self._kinematics, at_rest)[0] @ by_joint[:, :zeros]
        if isinstance(self.floor, FloorEffects):
            by_joint[self._is_speed, scales] = -self.floor.errors.speed_scale_sigma
            creep[2, scales] = self.floor.turn_rad_per_s(at_rest)
            rows["slip_lag_s"] = self.floor.errors.slip_lag_s * np.eye(self.count)[scales + 1]
        names = [joint.name for joint in self._kinematics.joints]
        for name, is_speed, row in zip(names, self._is_speed, by_joint, strict=True):
            if row.any():
                rows[f"{name}_share" if is_speed else f"{name}_rad"] = row
        for name, row in zip(("x_mps", "y_mps", "turn_rad_per_s"), creep, strict=True):
            if row.any():
                rows[f"creep_{name}"] = row
        return rows | self._mounting_rows()

    def _mounting_rows(self) -> dict[str, Array]:
        """Return the Jacobian row (m,) of the mounting angle of each wheel or module."""
        if not self._built.any():
            return {}
        unit = np.eye(self.count)[self._built_from :]
        names = self._kinematics.actuators
        return {
            f"{name}_mounting_rad": self._built[4 * i] * unit[4 * i] for i, name in enumerate(names)
        }


def jacobians(
    kinematics: Kinematics[Any], joints: Array, step: float = 1e-6
) -> tuple[Array, Array]:
    """Return the Jacobians (3, n) and (r, n) of twist and residual at `joints` (n,).

    `step` of the finite differences is in radians, or a fraction of the speed.
    """
    steps = step * np.maximum(1.0, np.abs(joints))
    nudged = np.empty((len(joints) + 1, len(joints)))
    nudged[:] = joints
    # This slice is the diagonal of all rows but the first, so each row perturbs one joint.
    nudged.reshape(-1)[len(joints) :: len(joints) + 1] += steps
    motion = kinematics.forward(nudged)
    slopes = ((motion.twist[1:] - motion.twist[0]) / steps[:, None]).T
    return slopes, ((motion.residual[1:] - motion.residual[0]) / steps[:, None]).T
