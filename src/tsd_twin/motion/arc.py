"""Lines and arcs: paths of constant curvature."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsd_twin.errors import PathError
from tsd_twin.lie import Array, sinc
from tsd_twin.motion.path import PathPoints


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """A piece of a circle, or of a line when the curvature is zero."""

    start_m: tuple[float, float]
    direction_rad: float
    """Of the tangent at the start."""
    curvature_per_m: float
    """Left is positive."""
    length_m: float
    corners_m: tuple[float, ...] = ()
    knots_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        numbers = (*self.start_m, self.direction_rad, self.curvature_per_m, self.length_m)
        if not (all(math.isfinite(number) for number in numbers) and self.length_m > 0.0):
            raise PathError(f"a line or arc needs finite numbers and a length above zero: {self}")

    def at(self, s_m: Array) -> PathPoints:
        """Return the points at arc lengths `s_m` (...)."""
        s = np.asarray(s_m, dtype=float)
        half = 0.5 * self.curvature_per_m * s
        # The chord of an arc points half the angle further, and is shortened by sinc.
        chord, along = s * sinc(half), self.direction_rad + half
        xy = np.stack([chord * np.cos(along), chord * np.sin(along)], axis=-1)
        return PathPoints(
            xy + np.array(self.start_m),
            self.direction_rad + 2.0 * half,
            np.full(s.shape, self.curvature_per_m),
            np.zeros(s.shape),
        )


def line(start_m: Sequence[float], end_m: Sequence[float]) -> Arc:
    """Return the straight way from one point to another, metres."""
    dx, dy = end_m[0] - start_m[0], end_m[1] - start_m[1]
    return Arc((start_m[0], start_m[1]), math.atan2(dy, dx), 0.0, math.hypot(dx, dy))


def arc(start_m: Sequence[float], direction_rad: float, radius_m: float, angle_rad: float) -> Arc:
    """Return the arc that turns by `angle_rad`, left positive, at `radius_m` above zero."""
    if not radius_m > 0.0:
        raise PathError(f"the radius of an arc must be above zero, not {radius_m}")
    curvature = math.copysign(1.0 / radius_m, angle_rad)
    return Arc((start_m[0], start_m[1]), direction_rad, curvature, radius_m * abs(angle_rad))
