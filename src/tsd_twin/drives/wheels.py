"""What drives on wheels have in common whose speeds are linear in the twist."""

from __future__ import annotations

import numpy as np

from tsd_twin.drives.drive import Joint, JointKind, Motion
from tsd_twin.lie import Array


class Wheels:
    """Limits, inverse and forward kinematics from one matrix, by least squares.

    Subclasses have these as fields.
    """

    __slots__ = ()

    wheel_radius_m: float
    max_speed_rad_per_s: float
    """Of a wheel."""
    max_acceleration_rad_per_s2: float
    """Of a wheel that takes the robot along."""
    speeds_from_twist: Array
    """(k, 3): wheel speeds from the twist."""
    twist_from_speeds: Array
    """(3, k): its pseudo-inverse."""
    _leave_out: Array
    """(k,): inverse of each wheel's own part of the residual projection; 0 where it has none."""

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return len(self.speeds_from_twist)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """`wheel1`, `wheel2`, ..."""
        return tuple(Joint(name, JointKind.VELOCITY) for name in self.actuators)

    @property
    def actuators(self) -> tuple[str, ...]:
        """`wheel1`, `wheel2`, ..."""
        return tuple(f"wheel{i + 1}" for i in range(self.wheels))

    def demand(self, twist: Array) -> Array:
        """Return the speed of the fastest wheel over its limit, (...); 1 is at the limit."""
        return self._fastest(twist) / self.max_speed_rad_per_s

    def rate_demand(self, step: Array, dt_s: float) -> Array:
        """Return the acceleration of the worst wheel over its limit, (...), for a twist `step`."""
        return self._fastest(step) / (self.max_acceleration_rad_per_s2 * dt_s)

    def _fastest(self, twist: Array) -> Array:
        return np.maximum.reduce(np.abs(twist @ self.speeds_from_twist.T), axis=-1)

    def inverse(self, twist: Array) -> Array:
        """Return the wheel speeds (..., k) for `twist` (..., 3), scaled to the speed limit."""
        speeds = twist @ self.speeds_from_twist.T
        worst = np.maximum.reduce(np.abs(speeds), axis=-1, keepdims=True)
        return speeds * (self.max_speed_rad_per_s / np.maximum(worst, self.max_speed_rad_per_s))

    def forward(self, joints: Array, rates: Array | None = None) -> Motion:  # noqa: ARG002  The shape.
        """Return the least-squares twist, and the residual (..., k) in m/s that no twist explains.

        It is zero when the wheels agree; three wheels always do. It cannot see all wheels slide
        alike. Rates of wheel speeds say nothing about the twist.
        """
        twist = joints @ self.twist_from_speeds.T
        left = joints - twist @ self.speeds_from_twist.T
        return Motion(twist, self.wheel_radius_m * left)

    def blame(self, residual: Array) -> Array:
        """Return how much of the squared `residual` (..., k) each wheel explains alone, (..., k).

        The drop of the squared residual when the equation of a wheel is left out.
        """
        return residual * residual * self._leave_out


def leave_out(rows: Array, back: Array) -> Array:
    """Return `_leave_out` (k,) of wheels with the matrix `rows` (k, 3) and its pseudo-inverse."""
    own = 1.0 - np.einsum("ij,ji->i", rows, back)
    # A wheel that nothing else can stand in for leaves no residual.
    return np.where(own > 1e-9, 1.0 / np.maximum(own, 1e-9), 0.0)
