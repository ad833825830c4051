"""What an operator wants: a place to go to, or a line drawn on the floor, and a route for it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import interpolate  # pyright: ignore

from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.motion.arc import line
from tsd_twin.motion.curve import Curve
from tsd_twin.motion.heading import FixedHeading, HeadingLaw, HeadingProfile
from tsd_twin.motion.path import Path
from tsd_twin.motion.route import Route

LONGEST_M = 50.0
"""Nobody sees further, and holds a button for it."""
THERE_M = 0.005
"""Nearer than this is there."""
_THERE_RAD = 0.01
_STEP_M = 0.02
_MOST_STEPS = 400
_HAND_M = 0.015
"""How far, root mean square, a smooth line may pass from where a hand has drawn, to begin with."""
_ASIDE_M = 0.03
"""And how far anywhere: a corner must not use up what the rest leaves."""
_CLOSER = 8
"""As many times it is made to pass at half the distance, until it does."""
_TURN_M = 0.001
"""A turn in place is a way this short: routes are measured by their length."""


@dataclass(frozen=True, slots=True, eq=False)
class Errand:
    """Where to go, seen from `odom`."""

    points: Array
    """(n, 2): metres; one is a place to go to, more are a line that was drawn."""
    heading_rad: float | None = None
    """Where to look at the end; None keeps the heading."""

    def route(self, start: SE2) -> Route:
        """Return the way from where the robot stands.

        Raises:
            PathError: it is there already, it is too far, the line has no smooth way along it, or
                something is no number.
        """
        here, goal = start.xy_heading, np.asarray(self.points[-1], dtype=float)
        if not (np.isfinite(here).all() and math.isfinite(self.heading_rad or 0.0)):
            raise PathError("where the robot is, or shall look, is no number")
        turn = 0.0 if self.heading_rad is None else float(wrap(self.heading_rad - here[2]))
        way = np.concatenate([here[None, :2], self.points])
        length_m = float(np.hypot(*np.diff(way, axis=0).T).sum())
        if not np.isfinite(length_m) or length_m > LONGEST_M:
            raise PathError(f"a way may have {LONGEST_M:g} m at most")
        if self.is_done(start):
            raise PathError("the robot is there already")
        path: Path
        if length_m >= THERE_M:
            path = line(here[:2].tolist(), goal.tolist()) if len(way) == 2 else _smooth(way)
        else:
            ahead = here[:2] + _TURN_M * np.array([np.cos(here[2]), np.sin(here[2])])
            path = line(here[:2].tolist(), ahead.tolist())
        heading: HeadingLaw = FixedHeading(float(here[2]))
        if turn:
            heading = HeadingProfile([0.0, path.length_m], [float(here[2]), float(here[2]) + turn])
        return Route(path, heading)

    def is_done(self, here: SE2) -> bool:
        """Return whether a robot that stands there has nothing left to do."""
        x, y, heading = here.xy_heading
        turn = 0.0 if self.heading_rad is None else float(wrap(self.heading_rad - heading))
        way = np.concatenate([[[x, y]], self.points])
        return bool(np.hypot(*np.diff(way, axis=0).T).sum() < THERE_M and abs(turn) < _THERE_RAD)

    def rest(self, path: Path, done_m: float) -> Errand:
        """Return what is left of it after `done_m` of a path that was made for it."""
        if len(self.points) == 1:
            return self
        left_m: Array = np.linspace(min(done_m, path.length_m), path.length_m, len(self.points) + 1)
        return Errand(path.at(left_m[1:]).xy, self.heading_rad)


def _smooth(points: Array) -> Path:
    """Return a smooth curve from the first to the last of `points` (n, 2), near all others."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = int(np.clip(np.ceil(along[-1] / _STEP_M), 8, _MOST_STEPS))
    even: Array = np.linspace(0.0, float(along[-1]), count)
    drawn = np.stack([np.interp(even, along, points[:, axis]) for axis in (0, 1)], axis=-1)
    weights = np.ones(count)
    weights[[0, -1]] = 1e3  # The ends are meant.
    spline = _fit(drawn, weights, even, _HAND_M)
    for halved in range(1, _CLOSER + 1):
        if np.hypot(*(spline(even) - drawn).T).max() <= _ASIDE_M:
            break
        spline = _fit(drawn, weights, even, _HAND_M * 0.5**halved)
    # Its third derivative is continuous, so nobody has to stand, or to look closer, at a knot.
    return Curve(spline, np.unique(spline.t))


def _fit(points: Array, weights: Array, at: Array, rms_m: float) -> Any:
    # scipy has no types for it. With the full output it does not warn when it is only nearly there.
    scipy: Any = interpolate
    fit = scipy.splprep(points.T, w=weights, u=at, s=len(at) * rms_m**2, k=5, full_output=1)
    knots, coefficients, degree = fit[0][0]
    return scipy.BSpline(knots, np.array(coefficients).T, degree)
