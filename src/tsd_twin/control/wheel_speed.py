"""Wheel-speed controller: the speed of wheels that always spin, changed while the robot drives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tsd_twin.kinematics import JointKind, Kinematics
from tsd_twin.lie import Array
from tsd_twin.messages.status import WheelSpeedStatus
from tsd_twin.robots import RPM, RobotDescription, WheelSpeedRange

_REST = np.zeros(3)
_SAME = 1e-9
"""Relative tolerance within which two wheel speeds are equal."""


class WheelSpeedController:
    """Ramps the wheel speed to the chosen one, and adapts the kinematics to it.

    The ground speed of a wheel is r_w spin sin(tilt). Motors follow a set-point with a lag, so the
    tilt is computed for the spin that the motor model predicts for the time when the gimbals reach
    it, not for the set-point: the ground speed then stays constant while the spin changes. A robot
    without a wheel-speed range keeps its kinematics.

    A chosen speed is kept until the wheels are shut off, or, while they stand, until its operator
    has lost the lease; then the speed of the description applies again.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self.kinematics: Kinematics[Any] = robot.kinematics()
        """Kinematics at the present wheel speed."""
        self._range, self._law = robot.wheel_speed_range, robot.spin_up()
        self._lag_s = robot.lag_s
        self._deceleration_mps2 = robot.limits.deceleration_mps2
        self._wheels = np.flatnonzero(
            [j.kind is JointKind.VELOCITY for j in self.kinematics.joints]
        )
        self._mean_ratio = float(self._range.kinematics.spin_ratio.mean()) if self._range else 1.0
        usual = self._range.kinematics.spin_rad_per_s if self._range else 0.0
        self._usual = self._requested = self._commanded = self._at = usual
        self._chosen_by: bytes | None = None
        self._was_armed = False
        self._solution = (self.kinematics, b"", np.zeros(0))
        """Newest kinematics, twist and joints (n,) of `inverse`: while a robot stands or drives
        steadily, the same ones are asked for again."""

    @property
    def refusal(self) -> str:
        """Reason why no wheel speed can be set, or ""."""
        if self._range is not None:
            return ""
        return "the wheels of this robot stand when it does, so they have no speed to choose"

    def choose(self, spin_rpm: float, lease: bytes) -> str:
        """Set the wheel speed for the holder of `lease`; return the reason of a refusal, or ""."""
        if self._range is None:
            return self.refusal
        if refusal := self._range.refusal(spin_rpm * RPM):
            return refusal
        self._requested, self._chosen_by = spin_rpm * RPM, lease
        return ""

    def advance(
        self,
        dt_s: float,
        lease: bytes | None,
        spin_after: Callable[[Array, float], float],
        *,
        armed: bool,
        ramps: bool,
    ) -> bool:
        """Advance the ramp by `dt_s`; return whether the kinematics have changed.

        `lease` is the one in force, or None; `armed` is whether the wheels may spin, and `ramps`
        whether the robot may drive, so that the speed must not jump. `spin_after(speeds, dt_s)`
        predicts the mean spin for set-points (m,).
        """
        if self._range is None:
            return False
        if not armed and (self._was_armed or lease != self._chosen_by):
            self._requested, self._chosen_by = self._usual, None
        self._was_armed = armed
        if not ramps:
            self._commanded = self._requested
            return self._update_wheel_speed(self._commanded)
        if self._commanded != self._requested:
            self._ramp(self._range, dt_s)
        mean = spin_after(self._commanded * self._range.kinematics.spin_ratio, self._lag_s)
        return self._update_wheel_speed(mean / self._mean_ratio)

    def inverse(self, twist: Array) -> Array:
        """Joints (n,) that move the robot by `twist` (3,)."""
        if not any(twist.tolist()):
            twist = _REST  # A negative zero would be another twist.
        kinematics, asked, joints = self._solution
        if kinematics is not self.kinematics or asked != twist.tobytes():
            joints = self.kinematics.inverse(twist)
            self._solution = (self.kinematics, twist.tobytes(), joints)
        joints = joints.copy()
        if self._range is not None:
            joints[self._wheels] = self._commanded * self._range.kinematics.spin_ratio
        return joints

    def status(self, spin_rad_per_s: float) -> WheelSpeedStatus | None:
        """Wheel-speed part of the status, for a mean spin of `spin_rad_per_s`."""
        if self._range is None:
            return None
        spin = spin_rad_per_s / self._mean_ratio
        return WheelSpeedStatus(round(self._requested / RPM, 1), round(spin / RPM, 1))

    def _ramp(self, speed_range: WheelSpeedRange, dt_s: float) -> None:
        law, error = self._law, self._requested - self._commanded
        rate = speed_range.rate_rad_per_s2(
            self._commanded, law.up_s if error > 0.0 else law.down_s, self._deceleration_mps2
        )
        step = rate * dt_s
        # Reached exactly: half a turn less than the slowest one would be none.
        self._commanded = (
            self._requested if abs(error) <= step else self._commanded + math.copysign(step, error)
        )

    def _update_wheel_speed(self, spin: float) -> bool:
        assert self._range is not None  # noqa: S101  The callers have checked it.
        spin = min(max(spin, self._range.least_rad_per_s), self._range.most_rad_per_s)
        if abs(spin - self._at) <= _SAME * spin:
            return False
        self._at = spin
        self.kinematics = self._range.kinematics.with_spin(spin)
        return True
