"""`[motor]` of robots whose wheels stand when the robot does: geared motors under speed control."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots.robot import JointErrors, NotNegative, Positive, Robot, SpinUp, Table
from tsd_twin.robots.units import RPM


class GearedMotor(Table, frozen=True):
    """`[motor]`: one drive motor with gearbox, encoder and speed control; all are alike."""

    power_w: Positive
    """The most that it can give, at half its no-load speed."""
    gear_ratio: Positive
    """Turns of the motor for one of the wheel."""
    no_load_speed_rpm: Positive
    """Of the motor, at the nominal voltage of the battery."""
    rotor_inertia_kg_m2: Positive
    """Of the motor's own rotor."""
    time_constant_s: Positive
    """Of the speed control: how fast a wheel follows its set-point."""
    current_limit: Positive = 1.0
    """Most torque that the driver lets through, as a share of the stall torque."""

    @property
    def top_speed_rad_per_s(self) -> float:
        """Of the wheel, without load."""
        return self.no_load_speed_rpm * RPM / self.gear_ratio

    @property
    def stall_torque_nm(self) -> float:
        """At the wheel: a straight torque curve has its most power at half speed and torque."""
        return 4.0 * self.power_w / self.top_speed_rad_per_s

    @property
    def rotor_at_wheel_kg_m2(self) -> float:
        """Inertia of the rotor as the wheel feels it."""
        return self.rotor_inertia_kg_m2 * self.gear_ratio**2

    def acceleration_rad_per_s2(self, inertia_kg_m2: float) -> float:
        """Return what a wheel that feels an inertia can do from standing."""
        return self.stall_torque_nm * min(1.0, self.current_limit) / inertia_kg_m2

    def spin_up(self) -> SpinUp:
        """Return how a wheel follows its set-point, as long as torque and grip suffice."""
        return SpinUp(0.0, self.time_constant_s, self.time_constant_s)


def carried_kg_m2(twist_from_speeds: Array, body: Array) -> float:
    """Return the most inertia that a wheel feels of a body with masses and inertias `body` (3,).

    The largest over all motions: the kinetic energy of the body in terms of the wheel speeds.
    """
    by_wheels = twist_from_speeds.T @ (body[:, None] * twist_from_speeds)
    return float(np.linalg.eigvalsh(by_wheels)[-1])


class WheelNoise(Table, frozen=True):
    """`[noise]`: standard deviations, for the covariance and as the simulator's default."""

    spin_share: NotNegative = 0.0
    """Of a measured wheel speed."""


class GearedRobot(Robot, frozen=True, kw_only=True):
    """A robot whose wheels, all alike, turn by geared motors."""

    motor: GearedMotor
    noise: WheelNoise = WheelNoise()

    def joint_errors(self) -> JointErrors:
        """Return the noise of the wheel speeds."""
        return JointErrors(spin_share=self.noise.spin_share)

    def spin_up(self) -> SpinUp:
        """Return how wheels follow their set-points."""
        return self.motor.spin_up()
