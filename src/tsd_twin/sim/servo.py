"""Gimbal servos: steps, a speed limit, an exponential approach, friction and play in the gears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots import RPM, SingularityRobot


@dataclass(frozen=True, slots=True)
class Servos:
    """The law that all servos of a robot obey, on arrays of any shape.

    A servo turns towards its goal at `approach_rate_per_s` times the error, and never faster than
    its speed limit: position control with a proportional gain, as the MX-64 has it. Close to the
    goal the voltage is too low for the friction of the gears, and it stays where it is. Its encoder
    is on the output shaft; between that and the motor is play, and a motor that reverses crosses it
    alone. The load of the gimbals is neglected.
    """

    step_rad: float
    """Goals and measurements are whole numbers of this."""
    speed_limit_rad_per_s: float | Array
    approach_rate_per_s: float
    angle_limit_rad: float
    """A goal beyond this, on either side, is taken for the last step within it."""
    dead_band_rad: float = 0.0
    """A servo that is this close to its goal stands."""
    backlash_rad: float = 0.0
    """Play, in all."""

    @staticmethod
    def of(robot: SingularityRobot, battery_v: float | Array) -> Servos:
        """Return the servos of `robot`; their top speed follows the voltage."""
        share = battery_v / robot.battery.nominal_v
        return Servos(
            step_rad=2.0 * np.pi / robot.servo.steps_per_turn,
            speed_limit_rad_per_s=robot.servo.no_load_speed_rpm * RPM * share,
            approach_rate_per_s=robot.servo.approach_rate_per_s,
            angle_limit_rad=float(np.radians(robot.drive.max_tilt_deg)),
            dead_band_rad=float(np.radians(robot.errors.dead_band_deg)),
            backlash_rad=float(np.radians(robot.errors.backlash_deg)),
        )

    def quantise(self, angle: Array) -> Array:
        """Return `angle`, radians, at the nearest step."""
        return np.round(angle / self.step_rad) * self.step_rad

    def goal(self, setpoint: Array) -> Array:
        """Return the angle that a servo goes for when told `setpoint`, radians."""
        last = np.floor(self.angle_limit_rad / self.step_rad) * self.step_rad
        return np.clip(self.quantise(setpoint), -last, last)

    def rate(self, angle: Array, goal: Array) -> Array:
        """Return the speed, rad/s, of motors whose gimbals are at `angle` on the way to `goal`."""
        limit, error = self.speed_limit_rad_per_s, goal - angle
        # A servo stops right at the edge of the dead band, give or take a rounding.
        moves = np.abs(error) > self.dead_band_rad * (1.0 + 1e-9)
        return np.clip(self.approach_rate_per_s * error * moves, -limit, limit)

    def after(self, angle: Array, goal: Array, elapsed_s: Array) -> Array:
        """Return the angle `elapsed_s` later, exactly: top speed first, then exponential.

        Without play; see `cross`.
        """
        error = goal - angle
        distance = np.abs(error)
        limit, rate = self.speed_limit_rad_per_s, self.approach_rate_per_s
        near = np.minimum(distance, limit / rate)
        at_top_speed_s = np.minimum(elapsed_s, (distance - near) / limit)
        left = distance - limit * at_top_speed_s
        left += near * np.expm1(-rate * (elapsed_s - at_top_speed_s))
        left = np.maximum(left, np.minimum(distance, self.dead_band_rad))
        return goal - np.copysign(left, error)

    def cross(
        self, angle: Array, goal: Array, play: Array, elapsed_s: Array
    ) -> tuple[Array, Array]:
        """Return what is left of `elapsed_s` once the motor has crossed its play, and the play.

        `play`, radians, is how far the motor is ahead of its gimbal, at most half the backlash on
        either side. The gimbal stands meanwhile, so the motor turns evenly.
        """
        speed, edge_rad = self.rate(angle, goal), 0.5 * self.backlash_rad
        # Rounding may leave the play beyond its edge by a little; that must not grow.
        to_go = np.maximum(edge_rad - np.sign(speed) * play, 0.0)
        crossing_s = to_go / np.maximum(np.abs(speed), 1e-300)
        spent_s = np.where(speed == 0.0, elapsed_s, np.minimum(elapsed_s, crossing_s))
        return elapsed_s - spent_s, np.clip(play + speed * spent_s, -edge_rad, edge_rad)
