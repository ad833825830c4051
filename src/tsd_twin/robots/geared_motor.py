"""Tables of robots with geared-motor wheels: motor, wheel-speed noise, inertia."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots.description import RPM, JointErrors, RobotDescription, WheelSpeedResponse
from tsd_twin.tables import NotNegative, Positive, Table


class GearedMotor(Table, frozen=True):
    """`[motor]`: drive motor with gearbox, encoder and speed control; identical for all wheels."""

    power_w: Positive
    """Maximum mechanical power, at half the no-load speed."""
    gear_ratio: Positive
    """Motor turns per wheel turn."""
    no_load_speed_rpm: Positive
    """No-load speed of the motor at nominal battery voltage."""
    rotor_inertia_kg_m2: Positive
    """Inertia of the rotor."""
    time_constant_s: Positive
    """Time constant of a wheel's speed control."""
    current_limit: Positive = 1.0
    """Torque limit of the motor driver, relative to the stall torque."""

    @property
    def top_speed_rad_per_s(self) -> float:
        """No-load speed of the wheel."""
        return self.no_load_speed_rpm * RPM / self.gear_ratio

    @property
    def stall_torque_nm(self) -> float:
        """Stall torque at the wheel, from the peak power of a linear torque curve."""
        return 4.0 * self.power_w / self.top_speed_rad_per_s

    @property
    def rotor_at_wheel_kg_m2(self) -> float:
        """Inertia of the rotor, reflected to the wheel."""
        return self.rotor_inertia_kg_m2 * self.gear_ratio**2

    def acceleration_rad_per_s2(self, inertia_kg_m2: float) -> float:
        """Return the acceleration of a wheel with this inertia from rest."""
        return self.stall_torque_nm * min(1.0, self.current_limit) / inertia_kg_m2

    def spin_up(self) -> WheelSpeedResponse:
        """Return a first-order model of a wheel speed, valid while torque and grip suffice."""
        return WheelSpeedResponse(0.0, self.time_constant_s, self.time_constant_s)


def carried_kg_m2(twist_from_speeds: Array, body: Array) -> float:
    """Return the maximum inertia at a wheel due to a body with masses and inertias (3,).

    This is the maximum over all motions of the kinetic energy in terms of the wheel speeds.
    """
    by_wheels = twist_from_speeds.T @ (body[:, None] * twist_from_speeds)
    return float(np.linalg.eigvalsh(by_wheels)[-1])


class WheelNoise(Table, frozen=True):
    """`[noise]`: standard deviations, for the covariance and as the simulator's default."""

    speed_scale_sigma: NotNegative = 0.0
    """Standard deviation of a measured wheel speed."""
    creep_m: NotNegative = 0.0002
    """Standard deviation of each contact's creep distance in a second, while wheels turn."""


class GearedMotorDescription(RobotDescription, frozen=True, kw_only=True):
    """Robot with identical geared-motor wheels."""

    motor: GearedMotor
    noise: WheelNoise = WheelNoise()

    @property
    def wheel_radius_m(self) -> float:
        """Radius of the wheels."""
        raise NotImplementedError

    def joint_errors(self) -> JointErrors:
        """Return the errors of the wheel speeds."""
        noise = self.noise
        return JointErrors(
            speed_scale_sigma=noise.speed_scale_sigma,
            random_walk_rad=noise.creep_m / self.wheel_radius_m,
        )

    def spin_up(self) -> WheelSpeedResponse:
        """Return the first-order model of the wheel speeds."""
        return self.motor.spin_up()
