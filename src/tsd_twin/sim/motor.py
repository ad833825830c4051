"""Drive motors: measured curves, a dead zone, and first-order spin-up and spin-down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots import RPM, SingularityRobot


@dataclass(frozen=True, slots=True, eq=False)
class Motors:
    """The laws of a robot's motors and speed controllers, on arrays (..., k): one entry a motor."""

    signals: Array
    """(r,): throttle signals of the calibration table, rising; the first is zero throttle."""
    speeds_rad_per_s: Array
    """(k, r): measured speed of each motor at each signal."""
    start_speed_rad_per_s: float
    """A motor whose curve gives less than this stands still."""
    time_constant_up_s: float
    time_constant_down_s: float
    pulses_us: tuple[float, float]
    """Pulse widths of the first and of the last signal."""

    @staticmethod
    def of(robot: SingularityRobot) -> Motors:
        """Return the motors of `robot`, as measured at its nominal voltage."""
        motor = robot.motor
        return Motors(
            signals=np.array(motor.signal),
            speeds_rad_per_s=np.array(motor.speed_rpm) * RPM,
            start_speed_rad_per_s=motor.start_speed_rpm * RPM,
            time_constant_up_s=motor.time_constant_up_s,
            time_constant_down_s=motor.time_constant_down_s,
            pulses_us=(motor.pulse_low_us, motor.pulse_high_us),
        )

    def signal(self, speed_rad_per_s: Array) -> Array:
        """Return the throttle signal that makes each motor turn at `speed_rad_per_s` (..., k).

        The inverse of the measured curve, kept within the table. Zero and below is zero throttle.
        """
        signal = np.empty(np.shape(speed_rad_per_s))
        for i, curve in enumerate(self.speeds_rad_per_s):
            signal[..., i] = np.interp(speed_rad_per_s[..., i], curve, self.signals)
        # The curve starts flat, so its inverse at zero could be any signal of the dead zone.
        return np.where(speed_rad_per_s > 0.0, signal, self.signals[0])

    def speed(self, signal: Array) -> Array:
        """Return the speed, rad/s, that each motor settles at for its `signal` (..., k)."""
        speed = np.empty(np.shape(signal))
        for i, curve in enumerate(self.speeds_rad_per_s):
            speed[..., i] = np.interp(signal[..., i], self.signals, curve)
        # Rounding must not stop a motor that is commanded to turn at its starting speed.
        start = self.start_speed_rad_per_s * (1.0 - 1e-9)
        return np.where(speed < start, 0.0, speed)

    def pulse_us(self, signal: Array) -> Array:
        """Return the pulse width, microseconds, that stands for `signal`."""
        first, last = self.signals[0], self.signals[-1]
        low, high = self.pulses_us
        return low + (signal - first) / (last - first) * (high - low)

    def after(self, speed: Array, goal: Array, elapsed_s: Array) -> Array:
        """Return the speed `elapsed_s` later of motors that settle at `goal`, exactly; rad/s."""
        up_s, down_s = self.time_constant_up_s, self.time_constant_down_s
        time_constant_s = np.where(goal > speed, up_s, down_s)
        return goal + (speed - goal) * np.exp(-elapsed_s / time_constant_s)
