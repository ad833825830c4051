"""Gimbal servos: steps, a speed limit, and an exponential approach to the goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots import RPM, SingularityRobot


@dataclass(frozen=True, slots=True)
class Servos:
    """The law that all servos of a robot obey, on arrays of any shape.

    A servo turns towards its goal at `approach_rate_per_s` times the error, and never faster than
    its speed limit: position control with a proportional gain, as the MX-64 has it. The load of
    the gimbals is neglected.
    """

    step_rad: float
    """Goals and measurements are whole numbers of this."""
    speed_limit_rad_per_s: float
    approach_rate_per_s: float
    angle_limit_rad: float
    """A goal beyond this, on either side, is taken for the last step within it."""

    @staticmethod
    def of(robot: SingularityRobot, battery_v: float) -> Servos:
        """Return the servos of `robot`; their top speed follows the voltage."""
        share = battery_v / robot.battery.nominal_v
        return Servos(
            step_rad=2.0 * np.pi / robot.servo.steps_per_turn,
            speed_limit_rad_per_s=robot.servo.no_load_speed_rpm * RPM * share,
            approach_rate_per_s=robot.servo.approach_rate_per_s,
            angle_limit_rad=float(np.radians(robot.drive.max_tilt_deg)),
        )

    def quantise(self, angle: Array) -> Array:
        """Return `angle`, radians, at the nearest step."""
        return np.round(angle / self.step_rad) * self.step_rad

    def goal(self, setpoint: Array) -> Array:
        """Return the angle that a servo goes for when told `setpoint`, radians."""
        last = np.floor(self.angle_limit_rad / self.step_rad) * self.step_rad
        return np.clip(self.quantise(setpoint), -last, last)

    def rate(self, angle: Array, goal: Array) -> Array:
        """Return the speed, rad/s, of servos at `angle` on their way to `goal`."""
        limit = self.speed_limit_rad_per_s
        return np.clip(self.approach_rate_per_s * (goal - angle), -limit, limit)

    def after(self, angle: Array, goal: Array, elapsed_s: Array) -> Array:
        """Return the angle `elapsed_s` later, exactly: top speed first, then exponential."""
        error = goal - angle
        distance = np.abs(error)
        limit, rate = self.speed_limit_rad_per_s, self.approach_rate_per_s
        near = np.minimum(distance, limit / rate)
        at_top_speed_s = np.minimum(elapsed_s, (distance - near) / limit)
        left = distance - limit * at_top_speed_s
        left += near * np.expm1(-rate * (elapsed_s - at_top_speed_s))
        return goal - np.copysign(left, error)
