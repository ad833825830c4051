"""Twist limiter: speed, acceleration, gimbal angle and gimbal rate, on the twist as a whole."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import Array
from tsd_twin.robots.description import Limits

_LARGEST = 1e100
"""Beyond this, in m/s or rad/s, a request is scaled first so that no square overflows."""


class TwistLimiter:
    """Limiter of twists and changes of twist; it scales them and keeps direction and curvature.

    The path from one twist to another is a straight line in twist space. All limits are convex, so
    a line between allowed twists is allowed.
    """

    def __init__(self, kinematics: Kinematics[Any], limits: Limits) -> None:
        self._kinematics = kinematics
        self._limits = limits
        self._squared_lever = kinematics.twist_scale_m**2

    def cap(self, twist: Array, share: Array | float = 1.0) -> Array:
        """Return `twist` (..., 3) scaled to the limits of speed, turn rate and tilt.

        `share` in (0, 1] lowers the limits of speed and turn rate.
        """
        limits = self._limits
        twist = clip_to_finite(twist)
        return twist / _most(
            np.sqrt(self._speed_squared(twist)) / (limits.speed_mps * share),
            np.abs(twist[..., 2]) / (limits.turn_rate_rad_per_s * share),
            self._kinematics.joint_utilization(twist),
        )

    def advance(
        self, current: Array, request: Array, dt_s: float, share: Array | float = 1.0
    ) -> Array:
        """Twist (..., 3) that follows `current` after `dt_s` on the way to `request`."""
        return self.approach(current, self.cap(request, share), dt_s)

    def approach(self, current: Array, goal: Array, dt_s: float) -> Array:
        """Twist (..., 3) that follows `current` after `dt_s` on the way to `goal`.

        The goal is within the limits already. A goal within reach is reached exactly, so that a
        stop ends at zero.
        """
        limits = self._limits
        step = goal - current
        slower = self._speed_squared(goal) < self._speed_squared(current)
        acceleration = np.where(slower, limits.deceleration_mps2, limits.acceleration_mps2)
        over = _most(
            np.sqrt(self._speed_squared(step)) / (acceleration * dt_s),
            np.abs(step[..., 2]) / (limits.angular_acceleration_rad_per_s2 * dt_s),
            self._kinematics.rate_utilization(step, dt_s),
        )
        return np.where(over <= 1.0, goal, current + step / over)

    def _speed_squared(self, twist: Array) -> Array:
        squared = twist[..., 0] * twist[..., 0] + twist[..., 1] * twist[..., 1]
        return self._squared_lever * squared


def _most(speed: Array, turn: Array, kinematics: Array) -> Array:
    """Largest utilization of three limits (...), at least 1: (..., 1)."""
    shares = np.ones((*np.shape(speed), 4))
    shares[..., 0], shares[..., 1], shares[..., 2] = speed, turn, kinematics
    return np.maximum.reduce(shares, axis=-1, keepdims=True)


def clip_to_finite(twist: Array) -> Array:
    """Return `twist` (..., 3), finite, scaled so that its numbers can be squared and added."""
    largest = np.maximum.reduce(np.abs(twist), axis=-1, keepdims=True)
    return twist / np.maximum(1.0, largest / _LARGEST)
