"""Tables of robots whose wheels turn by geared motors: motor, noise of wheel speeds, inertia."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots.description import (
    RPM,
    JointErrors,
    NotNegative,
    Positive,
    RobotDescription,
    SpinUp,
    Table,
)


class GearedMotor(Table, frozen=True):
    """`[motor]`: one drive motor with gearbox, encoder and speed control; all are alike."""

    power_w: Positive
    """Largest mechanical power, at half the no-load speed."""
    gear_ratio: Positive
    """Gear ratio: turns of the motor for one of the wheel."""
    no_load_speed_rpm: Positive
    """No-load speed of the motor at the nominal voltage of the battery."""
    rotor_inertia_kg_m2: Positive
    """Inertia of the rotor."""
    time_constant_s: Positive
    """Time constant of the speed control of a wheel."""
    current_limit: Positive = 1.0
    """Torque limit of the motor driver, as a share of the stall torque."""

    @property
    def top_speed_rad_per_s(self) -> float:
        """No-load speed of the wheel."""
        return self.no_load_speed_rpm * RPM / self.gear_ratio

    @property
    def stall_torque_nm(self) -> float:
        """Stall torque at the wheel, from the peak power of a straight torque curve."""
        return 4.0 * self.power_w / self.top_speed_rad_per_s

    @property
    def rotor_at_wheel_kg_m2(self) -> float:
        """Inertia of the rotor, reflected to the wheel."""
        return self.rotor_inertia_kg_m2 * self.gear_ratio**2

    def acceleration_rad_per_s2(self, inertia_kg_m2: float) -> float:
        """Acceleration of a wheel with this inertia from rest."""
        return self.stall_torque_nm * min(1.0, self.current_limit) / inertia_kg_m2

    def spin_up(self) -> SpinUp:
        """First-order model of a wheel speed, valid while torque and grip suffice."""
        return SpinUp(0.0, self.time_constant_s, self.time_constant_s)


def carried_kg_m2(twist_from_speeds: Array, body: Array) -> float:
    """Largest inertia that a body with masses and inertias `body` (3,) puts on a wheel.

    The largest over all motions: the kinetic energy of the body in terms of the wheel speeds.
    """
    by_wheels = twist_from_speeds.T @ (body[:, None] * twist_from_speeds)
    return float(np.linalg.eigvalsh(by_wheels)[-1])


class WheelNoise(Table, frozen=True):
    """`[noise]`: standard deviations, for the covariance and as the simulator's default."""

    spin_share: NotNegative = 0.0
    """Standard deviation of a measured wheel speed."""
    creep_m: NotNegative = 0.0002
    """Standard deviation of the distance that each contact creeps in a second, while wheels
    turn."""


class GearedMotorDescription(RobotDescription, frozen=True, kw_only=True):
    """A robot whose wheels, all alike, turn by geared motors."""

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
            spin_share=noise.spin_share, walk_rad=noise.creep_m / self.wheel_radius_m
        )

    def spin_up(self) -> SpinUp:
        """First-order model of the wheel speeds."""
        return self.motor.spin_up()
