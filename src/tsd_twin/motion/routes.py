"""Routes (a path with a heading profile), and navigation goals that they are planned for."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import path_refusal
from tsd_twin.motion.obstacles import Disc, detour, first_entered
from tsd_twin.motion.paths import Curve, Path, PathPoints, line, scipy_splines

_HEADING_ASIDE_M = 1e-9
_JUMP_PER_M = 1e-4


Headings: TypeAlias = tuple[Array, Array, Array]
"""Headings (...), radians, not wrapped, and their first and second derivative by the arc length."""


class HeadingProfile(ABC):
    """Heading as a function of the arc length."""

    __slots__ = ()

    def stops_m(self, path: Path) -> tuple[float, ...]:  # noqa: ARG002  Common signature.
        """Return the arc lengths at which following the heading requires a stop."""
        return ()

    @abstractmethod
    def at(self, s_m: Array, points: PathPoints) -> Headings:
        """Return the headings at arc lengths `s_m` (...), where the path has `points`."""


@dataclass(frozen=True, slots=True)
class FixedHeading(HeadingProfile):
    """Constant heading along the path."""

    heading_rad: float = 0.0

    def at(self, s_m: Array, points: PathPoints) -> Headings:  # noqa: ARG002  Common signature.
        """Return the heading for each of `s_m`."""
        zero = np.zeros(np.shape(s_m))
        return zero + self.heading_rad, zero, zero


@dataclass(frozen=True, slots=True)
class TangentHeading(HeadingProfile):
    """Heading along the tangent of the path, plus a constant offset.

    Raises:
        PathError: If the path has a sharp corner.
    """

    offset_rad: float = 0.0

    def stops_m(self, path: Path) -> tuple[float, ...]:
        """Return the arc lengths of curvature jumps, where the turn rate would jump too."""
        if path.corners_m:
            raise PathError(
                f"a tangent heading cannot follow the sharp corner at {path.corners_m[0]:.3f} m: "
                "round the corner, or fix the heading"
            )
        knots = np.array(path.knots_m)
        before, after = path.at(knots - _HEADING_ASIDE_M), path.at(knots + _HEADING_ASIDE_M)
        jumps = np.abs(after.curvature - before.curvature) > _JUMP_PER_M
        return tuple(knots[jumps].tolist())

    def at(self, s_m: Array, points: PathPoints) -> Headings:  # noqa: ARG002  Common signature.
        """Return direction plus offset at `points`."""
        return points.direction + self.offset_rad, points.curvature, points.sharpness


class SampledHeading(HeadingProfile):
    """Cubic spline through given headings, with zero slope at both ends.

    `s_m` (n,) increases; `heading_rad` (n,) is not wrapped, so that full turns are possible.
    """

    def __init__(self, s_m: Sequence[float], heading_rad: Sequence[float]) -> None:
        if len(s_m) != len(heading_rad) or len(s_m) < 2 or np.min(np.diff(s_m)) <= 0.0:
            raise PathError("a heading profile needs two rising arc lengths or more, with headings")
        self._s, self._heading = np.array(s_m, float), np.array(heading_rad, float)
        steps, slopes = np.diff(self._s), np.zeros(len(s_m))
        chords = np.diff(self._heading) / steps
        # Continuous second derivative at the inner points; the slopes of the outer ones are zero.
        before, after = steps[:-1], steps[1:]
        rows = np.diag(2.0 * (before + after)) + np.diag(after[1:], -1) + np.diag(before[:-1], 1)
        slopes[1:-1] = np.linalg.solve(rows, 3.0 * (after * chords[:-1] + before * chords[1:]))
        start, end = slopes[:-1], slopes[1:]
        self._cubics = np.stack(
            [
                start,
                (3.0 * chords - 2.0 * start - end) / steps,
                (start + end - 2.0 * chords) / steps**2,
            ]
        )
        """(3, n - 1): coefficients of the powers 1 to 3 between two points."""

    def at(self, s_m: Array, points: PathPoints) -> Headings:  # noqa: ARG002  Common signature.
        """Return the headings at `s_m`, clamped to the ends."""
        s = np.clip(s_m, self._s[0], self._s[-1])
        row = np.clip(np.searchsorted(self._s, s, side="right") - 1, 0, len(self._s) - 2)
        x, (a, b, c) = s - self._s[row], self._cubics[:, row]
        inside = (s_m >= self._s[0]) & (s_m <= self._s[-1])
        return (
            self._heading[row] + x * (a + x * (b + x * c)),
            (a + x * (2.0 * b + 3.0 * x * c)) * inside,
            (2.0 * b + 6.0 * x * c) * inside,
        )


@dataclass(frozen=True, slots=True, eq=False)
class RoutePoints:
    """Points of a route with their derivatives; shaped like the arc lengths."""

    pose: Array
    """(..., 3): x, y, heading."""
    per_m: Array
    """(..., 3): body twist at 1 m/s along the path."""
    bend: Array
    """(..., 3): d per_m / ds, in the turning body frame."""
    direction: Array
    """(...): tangent angle, radians."""
    curvature: Array
    """(...): curvature of the path, 1/m."""

    def twist(self, speed_mps: Array) -> Array:
        """Return the body twist (..., 3) at `speed_mps` (...)."""
        return self.per_m * speed_mps[..., None]

    def twist_rate(self, speed_mps: Array, acceleration_mps2: Array) -> Array:
        """Return the time derivative (..., 3) of the body twist."""
        squared = (speed_mps * speed_mps)[..., None]
        return self.per_m * acceleration_mps2[..., None] + self.bend * squared


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Path with a heading profile."""

    path: Path
    heading: HeadingProfile = field(default_factory=FixedHeading)

    @property
    def length_m(self) -> float:
        """Arc length of the path."""
        return self.path.length_m

    @property
    def stops_m(self) -> tuple[float, ...]:
        """Increasing arc lengths at which the robot must stop, without the ends."""
        stops = {*self.path.corners_m, *self.heading.stops_m(self.path)}
        return tuple(sorted(stops))

    @property
    def breaks_m(self) -> tuple[float, ...]:
        """Arc lengths of stops and curvature jumps."""
        return tuple(sorted({*self.stops_m, *self.path.knots_m}))

    def at(self, s_m: Array) -> RoutePoints:
        """Return the points at arc lengths `s_m` (...)."""
        points = self.path.at(s_m)
        heading, per_m, per_m2 = self.heading.at(s_m, points)
        sideslip = points.direction - heading
        c, s = np.cos(sideslip), np.sin(sideslip)
        off_per_m = points.curvature - per_m
        return RoutePoints(
            pose=np.concatenate([points.xy, heading[..., None]], axis=-1),
            per_m=np.stack([c, s, per_m], axis=-1),
            bend=np.stack([-s * off_per_m, c * off_per_m, per_m2], axis=-1),
            direction=points.direction,
            curvature=points.curvature,
        )


LONGEST_M = 50.0
"""Maximum route length, because the operator must see the robot and hold a button throughout."""
ARRIVAL_TOLERANCE_M = 0.005
"""Tolerances within which a goal counts as reached."""
_ARRIVAL_TOLERANCE_RAD = 0.01
_STEP_M = 0.02
_MAX_STEPS = 400
_SMOOTHING_M = 0.015
"""Initial RMS distance between the smoothed line and the drawn points."""
_CHECK_M = 0.02
"""Step at which a path is compared with obstacles."""
_MAX_DEVIATION_M = 0.03
"""Maximum distance anywhere, which the RMS would not bound at a corner."""
_MAX_HALVINGS = 8
"""Maximum number of times the RMS distance is halved to satisfy the bound."""
_TURN_M = 0.001
"""Path length of a turn in place, needed because routes are parameterized by arc length."""


@dataclass(frozen=True, slots=True, eq=False)
class NavigationGoal:
    """Navigation goal in `odom`: a position or a drawn line, and an optional final heading."""

    points: Array
    """(n, 2): metres; a position if n = 1, otherwise a drawn line."""
    heading_rad: float | None = None
    """Final heading; None keeps the current one."""

    def route(self, start: SE2, discs: Sequence[Disc] = ()) -> Route:
        """Plan the route from the pose `start`; to a position, around `discs`.

        Raises:
            PathError: If the goal is already reached or too far, the line cannot be smoothed, a
                disc is on a drawn line or at the goal, or a value is not finite.
        """
        here = start.xy_heading
        if not (np.isfinite(here).all() and math.isfinite(self.heading_rad or 0.0)):
            raise path_refusal(because(Code.PATH_NOT_FINITE))
        way, length_m, turn = self._way(start)
        if not np.isfinite(length_m) or length_m > LONGEST_M:
            raise path_refusal(because(Code.PATH_TOO_LONG, limit_m=LONGEST_M))
        if self.is_done(start):
            raise path_refusal(because(Code.ALREADY_THERE))
        path: Path
        if length_m >= ARRIVAL_TOLERANCE_M:
            if len(way) == 2:
                around = detour(way[0], way[1], discs, _MAX_DEVIATION_M)
                way = np.concatenate([way[:1], around])
            path = line(way[0].tolist(), way[1].tolist()) if len(way) == 2 else _smooth(way)
            check_free(path, discs)
        else:
            ahead = here[:2] + _TURN_M * np.array([np.cos(here[2]), np.sin(here[2])])
            path = line(here[:2].tolist(), ahead.tolist())
        heading: HeadingProfile = FixedHeading(float(here[2]))
        if turn:
            heading = SampledHeading([0.0, path.length_m], [float(here[2]), float(here[2]) + turn])
        return Route(path, heading)

    def is_done(self, here: SE2) -> bool:
        """Return whether a robot at `here` has reached the goal."""
        _, length_m, turn = self._way(here)
        return length_m < ARRIVAL_TOLERANCE_M and abs(turn) < _ARRIVAL_TOLERANCE_RAD

    def _way(self, here: SE2) -> tuple[Array, float, float]:
        """Return the points (n + 1, 2) from `here` to the goal, their length and the final turn."""
        x, y, heading = here.xy_heading
        way = np.concatenate([[[x, y]], self.points])
        turn = 0.0 if self.heading_rad is None else float(wrap(self.heading_rad - heading))
        return way, float(np.hypot(*np.diff(way, axis=0).T).sum()), turn

    def remaining(self, path: Path, done_m: float) -> NavigationGoal:
        """Return the remaining goal after `done_m` of the path planned for it."""
        if len(self.points) == 1:
            return self
        left_m: Array = np.linspace(min(done_m, path.length_m), path.length_m, len(self.points) + 1)
        return NavigationGoal(path.at(left_m[1:]).xy, self.heading_rad)


def check_free(path: Path, discs: Sequence[Disc], from_m: float = 0.0, to_m: float = 1e9) -> None:
    """Check that a part of a path enters no disc, and leads no deeper into one it starts in.

    Raises:
        PathError: If it does.
    """
    to_m = min(to_m, path.length_m)
    at_m = np.linspace(min(from_m, to_m), to_m, max(2, math.ceil((to_m - from_m) / _CHECK_M) + 1))
    points = path.at(at_m).xy
    shrunk = [
        replace(disc, radius_m=min(disc.radius_m, math.dist(points[0], disc.xy) - _MAX_DEVIATION_M))
        for disc in discs
    ]
    if (robot := first_entered(points, shrunk)) is not None:
        raise path_refusal(because(Code.PATH_BLOCKED, robot=robot))


def _smooth(points: Array) -> Path:
    """Return a smooth curve from the first to the last of `points` (n, 2), close to the others."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = int(np.clip(np.ceil(along[-1] / _STEP_M), 8, _MAX_STEPS))
    even: Array = np.linspace(0.0, float(along[-1]), count)
    drawn = np.stack([np.interp(even, along, points[:, axis]) for axis in (0, 1)], axis=-1)
    weights = np.ones(count)
    weights[[0, -1]] = 1e3  # Interpolate the ends.
    spline = _fitted(drawn, weights, even, _SMOOTHING_M)
    for halved in range(1, _MAX_HALVINGS + 1):
        if np.hypot(*(spline(even) - drawn).T).max() <= _MAX_DEVIATION_M:
            break
        spline = _fitted(drawn, weights, even, _SMOOTHING_M * 0.5**halved)
    # The third derivative is continuous, so knots need neither stops nor a finer time grid.
    return Curve(spline, np.unique(spline.t))


def _fitted(points: Array, weights: Array, at: Array, rms: float) -> Any:
    """Return a quintic spline within a weighted RMS distance of `points` (n, 2) at `at` (n,)."""
    scipy = scipy_splines()
    # With the full output scipy does not warn about a near-convergence.
    options: dict[str, Any] = {"s": len(at) * rms**2, "k": 5, "full_output": 1}
    knots, coefficients, degree = scipy.splprep(points.T, w=weights, u=at, **options)[0][0]
    return scipy.BSpline(knots, np.array(coefficients).T, degree)
