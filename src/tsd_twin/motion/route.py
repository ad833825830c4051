"""A path together with a heading: where the whole robot goes, before it is known how fast."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.motion.heading import FixedHeading, HeadingLaw
from tsd_twin.motion.path import Path


@dataclass(frozen=True, slots=True, eq=False)
class RoutePoints:
    """Places of a route; shapes are those of the arc lengths."""

    pose: Array
    """(..., 3): x, y, heading."""
    per_m: Array
    """(..., 3): body twist for a metre a second along the path."""
    bend: Array
    """(..., 3): d per_m / ds, in the body frame as it turns."""
    direction: Array
    """(...): of the tangent, radians."""
    curvature: Array
    """(...): of the path, 1/m."""

    def twist(self, speed_mps: Array) -> Array:
        """Return the body twist (..., 3) at `speed_mps` (...)."""
        return self.per_m * speed_mps[..., None]

    def twist_rate(self, speed_mps: Array, acceleration_mps2: Array) -> Array:
        """Return how the body twist (..., 3) changes in time."""
        squared = (speed_mps * speed_mps)[..., None]
        return self.per_m * acceleration_mps2[..., None] + self.bend * squared


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A path and a law of heading."""

    path: Path
    heading: HeadingLaw = field(default_factory=FixedHeading)

    @property
    def length_m(self) -> float:
        """Arc length of the path."""
        return self.path.length_m

    @property
    def stops_m(self) -> tuple[float, ...]:
        """Arc lengths at which the robot has to stand, rising, ends not included."""
        stops = {*self.path.corners_m, *self.heading.stops_m(self.path)}
        return tuple(sorted(stops))

    @property
    def breaks_m(self) -> tuple[float, ...]:
        """Arc lengths where something jumps: stops, and jumps of the curvature."""
        return tuple(sorted({*self.stops_m, *self.path.knots_m}))

    def at(self, s_m: Array) -> RoutePoints:
        """Return the places at arc lengths `s_m` (...)."""
        points = self.path.at(s_m)
        heading = self.heading.at(s_m, points)
        off = points.direction - heading.heading
        c, s = np.cos(off), np.sin(off)
        off_per_m = points.curvature - heading.per_m
        return RoutePoints(
            pose=np.concatenate([points.xy, heading.heading[..., None]], axis=-1),
            per_m=np.stack([c, s, heading.per_m], axis=-1),
            bend=np.stack([-s * off_per_m, c * off_per_m, heading.per_m2], axis=-1),
            direction=points.direction,
            curvature=points.curvature,
        )
