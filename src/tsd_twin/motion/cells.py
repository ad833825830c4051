"""The limits of a robot along a route, cut into short cells.

With u the squared speed and a the acceleration along the path, twist and twist rate are linear in
(a, u), and every limit is a convex function of them that grows in proportion. So the limits of a
cell, at both its ends, are one convex set around (0, 0).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsd_twin.drives import Drive
from tsd_twin.lie import Array
from tsd_twin.motion.route import Route, RoutePoints
from tsd_twin.robots.robot import Limits

_INSIDE_M = 1e-9
"""A cell looks at its ends from within: at a corner each has its own direction."""


class Cells:
    """The limits of all cells: speeds at their ends, and the convex set of (a, u) of each."""

    def __init__(
        self, route: Route, drive: Drive[Any], limits: Limits, s: Array, share: float
    ) -> None:
        self._drive, self._limits, self._share = drive, limits, share
        starts, ends = s[:-1] + _INSIDE_M, s[1:] - _INSIDE_M
        self._points: RoutePoints = route.at(np.stack([starts, ends], axis=-1))
        self.lengths_m: Array = np.diff(s)
        self.slowing = -0.5 / self.lengths_m
        """(n,): lowest a / u: that which ends a cell at rest."""

    def fastest(self) -> Array:
        """Return the highest speed (n + 1,) at each end of the cells, m/s."""
        per_m = self._points.per_m
        with np.errstate(divide="ignore", over="ignore"):
            turning = self._limits.turn_rate_rad_per_s / np.abs(per_m[..., 2])
            tilting = 1.0 / self._drive.demand(per_m)
        both = np.minimum(self._share * tilting, turning)
        inner = np.minimum(both[:-1, 1], both[1:, 0])
        return np.concatenate([both[:1, 0], inner, both[-1:, 1]])

    def usage(self, cell: Any, a: Array, u: Array) -> Array:
        """Return how much of the limits of change (a, u) use at both ends of `cell`.

        `cell` is an index; a and u have its shape, or one more dimension after it.
        """
        after = np.maximum(u + 2.0 * a * self.lengths_m[cell], 0.0)
        return np.maximum(self._usage(cell, 0, a, u), self._usage(cell, 1, a, after))

    def _usage(self, cell: Any, end: int, a: Array, u: Array) -> Array:
        points, limits = self._points, self._limits
        change = points.per_m[cell, end] * a[..., None] + points.bend[cell, end] * u[..., None]
        # Both have `a` along the way; across it, what the curve takes of the ground or of the body.
        bend = points.bend[cell, end]
        aside = np.maximum(
            np.abs(points.curvature[cell, end]), np.hypot(bend[..., 0], bend[..., 1])
        )
        across = aside * u
        linear = np.where(a < 0.0, limits.deceleration_mps2, limits.acceleration_mps2)
        turn = np.abs(change[..., 2]) / limits.angular_acceleration_rad_per_s2
        joints = self._drive.rate_demand(change, 1.0)
        # Braking is no licence to bend more: without the second, the set would not be convex.
        used = np.maximum(np.hypot(a, across) / linear, across / limits.acceleration_mps2)
        return np.maximum(used, np.maximum(turn, joints)) / self._share

    def crests(self) -> tuple[Array, Array]:
        """Return the highest u (n,) that each cell allows at its start, and the a it goes with.

        The least of a convex function of a / u, by golden sections in all cells at once.
        """
        every = np.arange(len(self.lengths_m))
        one = np.ones(len(every))
        golden = (math.sqrt(5.0) - 1.0) / 2.0
        bound = self._widest()
        low, high = np.maximum(self.slowing, -bound), bound
        for _ in range(60):
            left, right = high - golden * (high - low), low + golden * (high - low)
            lower = self.usage(every, left, one) < self.usage(every, right, one)
            low, high = np.where(lower, low, left), np.where(lower, right, high)
        # Among flat valleys and corners, zero is the slope to prefer when it is as good.
        slope = 0.5 * (low + high)
        used, at_zero = self.usage(every, slope, one), self.usage(every, 0.0 * one, one)
        slope = np.where(at_zero <= used * (1.0 + 1e-9), 0.0, slope)
        with np.errstate(divide="ignore", over="ignore"):
            u = 1.0 / np.minimum(used, at_zero)
        return u, slope

    def _widest(self) -> Array:
        """Return a bound (n,) of |a / u| where the usage is least: beyond, `a` alone uses more."""
        bends = np.abs(self._points.bend).max(axis=(1, 2)) + np.abs(self._points.curvature).max(1)
        return 1e-6 + 1e3 * bends
