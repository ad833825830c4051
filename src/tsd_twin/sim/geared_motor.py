"""Geared motors under speed control: what torque a wheel gets, and when there is no more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots.geared_motor import GearedMotor


@dataclass(frozen=True, slots=True)
class GearedMotors:
    """The law that all wheels of a robot obey, on arrays of any shape; torques at the wheel.

    The torque that a voltage gives falls along a straight line from stall to the no-load speed; the
    driver can reverse the voltage, and cuts off at its current limit.
    """

    stall_torque_nm: float
    """At the voltage there is."""
    top_speed_rad_per_s: float
    """At the voltage there is, without load."""
    torque_limit_nm: float
    gain_nm_s: float
    """Of the speed control: torque for each rad/s that a wheel is too slow."""

    @staticmethod
    def of(motor: GearedMotor, inertia_kg_m2: float, voltage_share: float) -> GearedMotors:
        """Return the motors of wheels that feel `inertia_kg_m2`, at a share of nominal voltage."""
        return GearedMotors(
            stall_torque_nm=motor.stall_torque_nm * voltage_share,
            top_speed_rad_per_s=motor.top_speed_rad_per_s * voltage_share,
            torque_limit_nm=motor.stall_torque_nm * motor.current_limit,
            gain_nm_s=inertia_kg_m2 / motor.time_constant_s,
        )

    def bounds(self, speed: Array) -> tuple[Array, Array]:
        """Return the least and the most torque there is at wheel speeds `speed`, rad/s."""
        share = speed / self.top_speed_rad_per_s
        limit = self.torque_limit_nm
        low = np.maximum(-self.stall_torque_nm * (1.0 + share), -limit)
        high = np.minimum(self.stall_torque_nm * (1.0 - share), limit)
        return low, high
