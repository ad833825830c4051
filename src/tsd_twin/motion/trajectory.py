"""A route with its timing: where the robot shall be, and how it shall move, at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.drives import Drive
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.route import Route
from tsd_twin.motion.smoothing import smoothed
from tsd_twin.motion.timing import SpeedProfile, fastest
from tsd_twin.robots.robot import Limits


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """What a robot shall do at one time, or at many; shapes are those of the times."""

    pose: Array
    """(..., 3): x, y, heading."""
    twist: Array
    """(..., 3): in the body frame of `pose`."""
    twist_rate: Array
    """(..., 3): how the body twist changes."""
    direction: Array
    """(...): of the path, radians."""
    s_m: Array
    """(...): arc length."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A route and the speed along it; it rests at its start before, and at its end after."""

    route: Route
    profile: SpeedProfile

    @property
    def duration_s(self) -> float:
        """Time from start to end."""
        return float(self.profile.at_s[-1])

    @property
    def length_m(self) -> float:
        """Arc length."""
        return self.route.length_m

    def at(self, t_s: Array | float) -> Reference:
        """Return what shall be at times `t_s` (...), seconds after the start."""
        profile = self.profile
        t = np.asarray(t_s, dtype=float)
        moving = (t > 0.0) & (t < self.duration_s)
        t = np.clip(t, 0.0, self.duration_s)
        cell, since = profile.since(t)
        acceleration = profile.acceleration_mps2[cell]
        s = profile.place_m(t)
        speed = np.maximum(profile.speed_mps[cell] + since * acceleration, 0.0) * moving
        points = self.route.at(s)
        return Reference(
            points.pose,
            points.twist(speed),
            points.twist_rate(speed, acceleration * moving),
            points.direction,
            s,
        )


def plan(
    route: Route,
    drive: Drive[SE2],
    limits: Limits,
    *,
    share: float = 1.0,
    speed_mps: float | None = None,
    cell_m: float = 0.005,
    smooth_s: float = 0.0,
) -> Trajectory:
    """Return `route` timed to the limits, as in `fastest`.

    Acceleration takes `smooth_s` to change where it would jump; see `smoothed`.

    Raises:
        PathError: as in `fastest`.
    """
    profile = fastest(route, drive, limits, share=share, speed_mps=speed_mps, cell_m=cell_m)
    return Trajectory(route, smoothed(profile, smooth_s))
