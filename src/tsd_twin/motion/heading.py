"""Where a robot looks while it follows a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline  # pyright: ignore

from tsd_twin.errors import PathError
from tsd_twin.lie import Array
from tsd_twin.motion.path import Path, PathPoints

_ASIDE_M = 1e-9
_JUMP_PER_M = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Headings:
    """Headings along a path; shapes are those of the arc lengths."""

    heading: Array
    """(...): radians, not wrapped."""
    per_m: Array
    """(...): d heading / ds."""
    per_m2: Array
    """(...): second derivative."""


class HeadingLaw(Protocol):
    """Heading as a function of the arc length."""

    def stops_m(self, path: Path) -> tuple[float, ...]:
        """Return the arc lengths at which the heading cannot be followed without a stop."""
        ...

    def at(self, s_m: Array, points: PathPoints) -> Headings:
        """Return the headings at arc lengths `s_m` (...), where the path has `points`."""
        ...


@dataclass(frozen=True, slots=True)
class FixedHeading:
    """The same heading all the way, as an omnidirectional robot can."""

    heading_rad: float = 0.0

    def stops_m(self, path: Path) -> tuple[float, ...]:  # noqa: ARG002  The law's shape.
        """Return none."""
        return ()

    def at(self, s_m: Array, points: PathPoints) -> Headings:  # noqa: ARG002  The law's shape.
        """Return the heading for each of `s_m`."""
        zero = np.zeros(np.shape(s_m))
        return Headings(zero + self.heading_rad, zero, zero)


@dataclass(frozen=True, slots=True)
class TangentHeading:
    """The robot looks where it goes, or to a side of it, as a car does.

    Raises:
        PathError: the path has a sharp corner.
    """

    offset_rad: float = 0.0

    def stops_m(self, path: Path) -> tuple[float, ...]:
        """Return where the curvature jumps: there the turn rate would have to."""
        if path.corners_m:
            raise PathError(
                f"a tangent heading cannot follow the sharp corner at {path.corners_m[0]:.3f} m: "
                "round the corner, or fix the heading"
            )
        knots = np.array(path.knots_m)
        before, after = path.at(knots - _ASIDE_M), path.at(knots + _ASIDE_M)
        jumps = np.abs(after.curvature - before.curvature) > _JUMP_PER_M
        return tuple(knots[jumps].tolist())

    def at(self, s_m: Array, points: PathPoints) -> Headings:  # noqa: ARG002  The law's shape.
        """Return direction plus offset at `points`."""
        return Headings(points.direction + self.offset_rad, points.curvature, points.sharpness)


class HeadingProfile:
    """A smooth heading through given ones (cubic spline, at rest at both ends).

    `s_m` (n,) rises; `heading_rad` (n,) is not wrapped, so that turns can be asked for.
    """

    def __init__(self, s_m: Sequence[float], heading_rad: Sequence[float]) -> None:
        if len(s_m) != len(heading_rad) or len(s_m) < 2 or np.min(np.diff(s_m)) <= 0.0:
            raise PathError("a heading profile needs two rising arc lengths or more, with headings")
        spline: Any = CubicSpline(s_m, heading_rad, bc_type="clamped")
        self._by_order = [spline, spline.derivative(1), spline.derivative(2)]
        self._ends = float(s_m[0]), float(s_m[-1])

    def stops_m(self, path: Path) -> tuple[float, ...]:  # noqa: ARG002  The law's shape.
        """Return none."""
        return ()

    def at(self, s_m: Array, points: PathPoints) -> Headings:  # noqa: ARG002  The law's shape.
        """Return the headings at `s_m`; beyond the ends, those of the ends."""
        s = np.clip(s_m, *self._ends)
        inside = (s_m >= self._ends[0]) & (s_m <= self._ends[1])
        heading, per_m, per_m2 = (np.asarray(order(s), dtype=float) for order in self._by_order)
        return Headings(heading, per_m * inside, per_m2 * inside)
