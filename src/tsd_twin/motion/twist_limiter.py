"""Limits of commanded twists."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import Array
from tsd_twin.robots.description import Limits

_MAX_COMPONENT = 1e100
"""Larger requests (m/s or rad/s) are scaled first, so that squares cannot overflow."""


class TwistLimiter:
    """Limits twists and their rates by scaling, which preserves direction and curvature.

    The path between two twists is a straight line in twist space. All limits are convex, so a line
    between allowed twists is allowed.
    """

    def __init__(self, kinematics: Kinematics[Any], limits: Limits) -> None:
        self._kinematics = kinematics
        self._limits = limits
        self._squared_lever = kinematics.twist_scale_m**2

    def cap(self, twist: Array, share: Array | float = 1.0) -> Array:
        """Scale `twist` (..., 3) to the limits of speed, turn rate and tilt.

        `share` in (0, 1] lowers the limits of speed and turn rate.
        """
        twist = clip_to_finite(twist)
        return twist / _max_utilization(*self.utilizations(twist, share))

    def utilizations(self, twist: Array, share: Array | float = 1.0) -> tuple[Any, Any, Any]:
        """Return the utilizations (...) of the speed, turn rate and joint limits by `twist`."""
        limits = self._limits
        _, _, turn_rate = _components(twist)
        return (
            np.sqrt(self._speed_squared(twist)) / (limits.speed_mps * share),
            abs(turn_rate) / (limits.turn_rate_rad_per_s * share),
            self._kinematics.joint_utilization(twist),
        )

    def approach(self, current: Array, goal: Array, dt_s: float) -> Array:
        """Return the twist (..., 3) after `dt_s`, from `current` towards `goal`.

        The goal must already be within the limits. A goal within reach is reached exactly, so that
        a stop ends at zero.
        """
        limits = self._limits
        step = goal - current
        if step.ndim == 1 and not any(step.tolist()):
            return goal.copy()
        _, _, turn_rate = _components(step)
        slower = self._speed_squared(goal) < self._speed_squared(current)
        either = limits.deceleration_mps2, limits.acceleration_mps2
        # For a single twist, `slower` is a bool, which is faster than an array of size one.
        acceleration = either[not slower] if step.ndim == 1 else np.where(slower, *either)
        over = _max_utilization(
            np.sqrt(self._speed_squared(step)) / (acceleration * dt_s),
            abs(turn_rate) / (limits.angular_acceleration_rad_per_s2 * dt_s),
            self._kinematics.rate_utilization(step, dt_s),
        )
        if isinstance(over, float):
            return goal.copy() if over <= 1.0 else current + step / over
        return np.where(over <= 1.0, goal, current + step / over)

    def _speed_squared(self, twist: Array) -> Any:
        x, y, _ = _components(twist)
        return self._squared_lever * (x * x + y * y)


def _components(twist: Array) -> Any:
    """Return the components (...) of `twist` (..., 3).

    For a single twist they are plain floats, which are faster than arrays of size one.
    """
    return twist.tolist() if twist.ndim == 1 else np.moveaxis(twist, -1, 0)


def _max_utilization(speed: Any, turn: Any, kinematics: Any) -> Any:
    """Return the largest of three utilizations (...), at least 1: (..., 1), or a float."""
    if isinstance(speed, float) and isinstance(turn, float) and isinstance(kinematics, float):
        # A NaN limit allows nothing, as in the reduction below.
        unknown = math.isnan(speed + turn + kinematics)
        return math.nan if unknown else float(max(1.0, speed, turn, kinematics))
    shares = np.ones((*np.shape(speed), 4))
    shares[..., 0], shares[..., 1], shares[..., 2] = speed, turn, kinematics
    return np.maximum.reduce(shares, axis=-1, keepdims=True)


def clip_to_finite(twist: Array) -> Array:
    """Scale `twist` (..., 3), finite, so that its squares can be summed."""
    if twist.ndim == 1 and all(abs(number) <= _MAX_COMPONENT for number in twist.tolist()):
        return twist.copy()
    largest = np.maximum.reduce(np.abs(twist), axis=-1, keepdims=True)
    return twist / np.maximum(1.0, largest / _MAX_COMPONENT)
