"""Wheel speed of a robot whose wheels spin at all times."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tsd_twin.kinematics import JointKind, Kinematics
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.status import WheelSpeedStatus
from tsd_twin.robots import RPM, RobotDescription, WheelSpeedRange

_SAME = 1e-9
"""Relative tolerance for comparing wheel speeds."""


class WheelSpeedController:
    """Ramps the wheel speed to the requested one and adapts the kinematics.

    The ground speed of a wheel is r_w w sin(tilt) at wheel speed w. Motors lag behind their
    setpoint, so the tilt uses the wheel speed that the motor model predicts for when the gimbals
    reach it. This keeps the ground speed constant while the wheel speed changes. Without a
    wheel-speed range, the kinematics never change.

    A requested speed persists until the wheels are switched off or, at rest, until its operator
    loses the lease. The default from the description then applies again.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self.kinematics: Kinematics[Any] = robot.kinematics()
        """Kinematics at the current wheel speed."""
        self._range, self._law = robot.wheel_speed_range, robot.spin_up()
        self._lag_s = robot.lag_s
        self._deceleration_mps2 = robot.limits.deceleration_mps2
        self._wheels = np.flatnonzero(
            [j.kind is JointKind.VELOCITY for j in self.kinematics.joints]
        )
        self._mean_ratio = float(self._range.kinematics.spin_ratio.mean()) if self._range else 1.0
        usual = self._range.kinematics.spin_rad_per_s if self._range else 0.0
        self._default_speed = self._requested = self._commanded = self._at = usual
        self._chosen_by: bytes | None = None
        self._was_armed = False

    @property
    def refusal(self) -> Reason | None:
        """Reason why no wheel speed can be set, or None."""
        return because(Code.NO_WHEEL_SPEED) if self._range is None else None

    def choose(self, spin_rpm: float, lease: bytes) -> Reason | None:
        """Set the wheel speed for the holder of `lease`; return why it is refused, or None."""
        if self._range is None:
            return self.refusal
        if not self._range.allows(spin_rpm * RPM):
            return because(
                Code.WHEEL_SPEED_REFUSED,
                least_rpm=self._range.least_rad_per_s / RPM,
                most_rpm=self._range.most_rad_per_s / RPM,
            )
        self._requested, self._chosen_by = spin_rpm * RPM, lease
        return None

    def advance(
        self,
        dt_s: float,
        lease: bytes | None,
        spin_after: Callable[[Array, float], float],
        *,
        armed: bool,
        ramps: bool,
    ) -> bool:
        """Advance the ramp by `dt_s`; return whether the kinematics changed.

        `lease` is the active one or None. `armed` means that the wheels may spin, and `ramps` that
        the robot may drive, so the speed must not jump. `spin_after(speeds, dt_s)` predicts the
        mean wheel speed for setpoints (m,).
        """
        if self._range is None:
            return False
        if not armed and (self._was_armed or lease != self._chosen_by):
            self._requested, self._chosen_by = self._default_speed, None
        self._was_armed = armed
        if not ramps:
            self._commanded = self._requested
            return self._update_wheel_speed(self._commanded)
        if self._commanded != self._requested:
            self._ramp(self._range, dt_s)
        mean = spin_after(self._commanded * self._range.kinematics.spin_ratio, self._lag_s)
        return self._update_wheel_speed(mean / self._mean_ratio)

    def set_wheels(self, joints: Array) -> None:
        """Set the wheels in `joints` (n,) to the commanded speed, in place."""
        if self._range is not None:
            joints[self._wheels] = self._commanded * self._range.kinematics.spin_ratio

    def status(self, spin_rad_per_s: float) -> WheelSpeedStatus | None:
        """Return the wheel-speed part of the status for a mean speed of `spin_rad_per_s`."""
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
        # Reach it exactly, because half a rotation below the minimum speed is out of range.
        self._commanded = (
            self._requested if abs(error) <= step else self._commanded + math.copysign(step, error)
        )

    def _update_wheel_speed(self, spin: float) -> bool:
        assert self._range is not None  # noqa: S101  Checked by callers.
        spin = min(max(spin, self._range.least_rad_per_s), self._range.most_rad_per_s)
        if abs(spin - self._at) <= _SAME * spin:
            return False
        self._at = spin
        self.kinematics = self._range.kinematics.with_spin(spin)
        return True
