"""Plane curves by arc length: what all paths have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tsd_twin.lie import Array


@dataclass(frozen=True, slots=True, eq=False)
class PathPoints:
    """Points of a path, and how it runs through them; shapes are those of the arc lengths."""

    xy: Array
    """(..., 2): metres."""
    direction: Array
    """(...): angle of the tangent, radians; continuous along the path but for corners."""
    curvature: Array
    """(...): d direction / ds, 1/m; left is positive."""
    sharpness: Array
    """(...): d curvature / ds, 1/m^2."""


class Path(Protocol):
    """A curve in the plane, measured by its arc length from 0 to `length_m`."""

    @property
    def length_m(self) -> float:
        """Arc length."""
        ...

    @property
    def corners_m(self) -> tuple[float, ...]:
        """Arc lengths where the direction jumps: nobody with mass passes without a stop."""
        ...

    @property
    def knots_m(self) -> tuple[float, ...]:
        """Arc lengths where the curvature or its slope jumps, and the direction does not."""
        ...

    def at(self, s_m: Array) -> PathPoints:
        """Return the points at arc lengths `s_m` (...); at a corner, those that follow it."""
        ...
