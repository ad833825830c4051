"""Time-optimal path parameterization (TOPP) of a route within all limits.

The route is divided into short cells. Backward and forward passes find the highest speed at each
boundary allowed by the limits of speed, acceleration and joints; smoothing then bounds the jerk.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from tsd_twin.errors import PathError
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import path_refusal
from tsd_twin.motion.routes import Route, RoutePoints
from tsd_twin.robots.description import Limits

_INSIDE_M = 1e-9
"""Cells evaluate their ends from inside, because directions differ across a corner."""


class PathConstraints:
    """TOPP constraints of all cells: speeds at their ends, and the convex set of (a, u) in each."""

    def __init__(
        self, route: Route, kinematics: Kinematics[Any], limits: Limits, s: Array, share: float
    ) -> None:
        self._kinematics, self._limits, self._share = kinematics, limits, share
        starts, ends = s[:-1] + _INSIDE_M, s[1:] - _INSIDE_M
        self._points: RoutePoints = route.at(np.stack([starts, ends], axis=-1))
        bend = self._points.bend
        # In both frames `a` acts along the path; the lateral part is centripetal over ground or in
        # the body.
        self._aside: Array = np.maximum(
            np.abs(self._points.curvature), np.hypot(bend[..., 0], bend[..., 1])
        )
        self.lengths_m: Array = np.diff(s)
        self.slowing = -0.5 / self.lengths_m
        """(n,): smallest a / u, for which a cell ends at rest."""

    def highest_speeds(self) -> Array:
        """Return the maximum speed (n + 1,) at the cell ends, m/s."""
        per_m = self._points.per_m
        with np.errstate(divide="ignore", over="ignore"):
            turning = self._limits.turn_rate_rad_per_s / np.abs(per_m[..., 2])
            tilting = 1.0 / self._kinematics.joint_utilization(per_m)
        both = np.minimum(self._share * tilting, turning)
        inner = np.minimum(both[:-1, 1], both[1:, 0])
        return np.concatenate([both[:1, 0], inner, both[-1:, 1]])

    def usage(self, cell: Any, a: Array, u: Array) -> Array:
        """Return the utilization of the acceleration limits by (a, u) at both ends of `cell`.

        `cell` is an index; a and u have its shape, or one additional trailing dimension.
        """
        after = np.maximum(u + 2.0 * a * self.lengths_m[cell], 0.0)
        return np.maximum(self._usage(cell, 0, a, u), self._usage(cell, 1, a, after))

    def _usage(self, cell: Any, end: int, a: Array, u: Array) -> Array:
        points, limits = self._points, self._limits
        change = points.per_m[cell, end] * a[..., None] + points.bend[cell, end] * u[..., None]
        across = self._aside[cell, end] * u
        linear = np.where(a < 0.0, limits.deceleration_mps2, limits.acceleration_mps2)
        turn = np.abs(change[..., 2]) / limits.angular_acceleration_rad_per_s2
        joints = self._kinematics.rate_utilization(change, 1.0)
        # Braking must not allow more curvature; without the second term, the set would not be
        # convex.
        used = np.maximum(np.hypot(a, across) / linear, across / limits.acceleration_mps2)
        return np.maximum(used, np.maximum(turn, joints)) / self._share

    def max_velocity_curve(self) -> tuple[Array, Array]:
        """Return the maximum u (n,) at the start of each cell, and the corresponding a.

        Minimizes a convex function of a / u by golden-section search, vectorized over cells.
        """
        every = np.arange(len(self.lengths_m))
        one = np.ones(len(every))
        golden = (math.sqrt(5.0) - 1.0) / 2.0
        points = self._points
        bends: Array = np.abs(points.bend).max(axis=(1, 2)) + np.abs(points.curvature).max(1)
        bound = 1e-6 + 1e3 * bends  # Beyond it, `a` dominates the usage.
        low, high = np.maximum(self.slowing, -bound), bound
        for _ in range(60):
            left, right = high - golden * (high - low), low + golden * (high - low)
            lower = self.usage(every, left, one) < self.usage(every, right, one)
            low, high = np.where(lower, low, left), np.where(lower, right, high)
        # In flat minima and at kinks, prefer zero slope if it is as good.
        slope = 0.5 * (low + high)
        used, at_zero = self.usage(every, slope, one), self.usage(every, 0.0 * one, one)
        slope = np.where(at_zero <= used * (1.0 + 1e-9), 0.0, slope)
        with np.errstate(divide="ignore", over="ignore"):
            u = 1.0 / np.minimum(used, at_zero)
        return u, slope


_MIN_CELLS = 100
"""Minimum number of cells between two breaks."""
_TRIES = 25
_ROUNDS = 4
"""Each search round narrows an interval to 1/24, all rounds to 3e-6."""


@dataclass(frozen=True, slots=True, eq=False)
class SpeedProfile:
    """Speed along a route, with constant acceleration in each cell between two of `s_m`."""

    s_m: Array
    """(n + 1,): ends of the cells."""
    speed_mps: Array
    """(n + 1,): at the ends of the cells."""
    acceleration_mps2: Array
    """(n,): within each cell."""
    at_s: Array
    """(n + 1,): time at each end, seconds."""

    def place_m(self, t_s: Array) -> Array:
        """Return the arc lengths (...) at times `t_s` (...) from start to end."""
        cell, since = self.since(t_s)
        s = self.s_m[cell] + since * (
            self.speed_mps[cell] + 0.5 * since * self.acceleration_mps2[cell]
        )
        return np.minimum(s, self.s_m[cell + 1])

    def since(self, t_s: Array) -> tuple[npt.NDArray[np.intp], Array]:
        """Return the cell at each of `t_s` (...), and the time since its start."""
        last = len(self.acceleration_mps2) - 1
        cell = np.clip(np.searchsorted(self.at_s, t_s, side="right") - 1, 0, last)
        return cell, t_s - self.at_s[cell]


def _graded(start_m: float, end_m: float, cell_m: float) -> Array:
    """Return the cell starts in a segment, denser near its ends, where speed changes."""
    cells = max(_MIN_CELLS, math.ceil(0.5 * math.pi * (end_m - start_m) / cell_m))
    share = 0.5 - 0.5 * np.cos(np.pi * np.arange(cells) / cells)
    return start_m + (end_m - start_m) * share


def _backward(cells: PathConstraints, cap: Array) -> tuple[Array, Array]:
    """Return the maximum u (n + 1,) from which the end is reachable, and its a (n,)."""
    crest, slope = cells.max_velocity_curve()
    u_top = np.minimum(cap[:-1], crest)
    a_top = slope * u_top
    highest, acceleration = np.zeros(len(cap)), np.zeros(len(u_top))
    for i in range(len(u_top) - 1, -1, -1):
        twice, u, a, k = (
            2.0 * float(cells.lengths_m[i]),
            float(u_top[i]),
            float(a_top[i]),
            highest[i + 1],
        )
        if u + twice * a > k:
            # The line of all (a, u) that lead to k passes between (0, 0) and the maximum velocity.
            inside = k / (u + twice * a) * u
            u = _last(cells, i, inside, u, partial(_towards, k, twice))
            a = (k - u) / twice
        highest[i], acceleration[i] = u, a
    return highest, acceleration


def _forward(cells: PathConstraints, highest: Array, safe: Array) -> tuple[Array, Array]:
    """Return u (n + 1,) and a (n,) of the fastest profile."""
    squared, acceleration = np.zeros(len(highest)), np.zeros(len(safe))
    for i in range(len(safe)):
        u, twice = float(squared[i]), 2.0 * float(cells.lengths_m[i])
        wanted = (float(highest[i + 1]) - u) / twice
        # The set is convex, so a feasible point at the highest speed scales to lower speeds.
        inside = float(safe[i]) * (u / float(highest[i]) if highest[i] > 0.0 else 0.0)
        a = _last(cells, i, inside, wanted, partial(_from, u))
        acceleration[i] = a
        # Make stops exactly zero, because smoothing splits the trajectory there.
        squared[i + 1] = max(0.0, u + twice * a) if highest[i + 1] > 0.0 else 0.0
    return squared, acceleration


def _towards(end: float, twice: float, u: Array) -> tuple[Array, Array]:
    """Return the (a, u) that lead from each of `u` to `end`, over half of `twice`."""
    return (end - u) / twice, u


def _from(u: float, a: Array) -> tuple[Array, Array]:
    """Return (a, u) for each of `a`."""
    return a, np.full(a.shape, u)


def _last(
    cells: PathConstraints,
    cell: int,
    inside: float,
    outside: float,
    point: Callable[[Array], tuple[Array, Array]],
) -> float:
    """Return the last number from `inside` to `outside` within the limits of a cell.

    `point` maps numbers to (a, u). The set is convex, so the feasible numbers form an interval.
    """
    low, high = inside, outside
    for _ in range(_ROUNDS):
        tries: Array = np.linspace(low, high, _TRIES)
        a, u = point(tries)
        holds = cells.usage(cell, a, u) <= 1.0
        last = int(np.flatnonzero(holds)[-1]) if holds.any() else 0
        if last == _TRIES - 1:
            return float(tries[last])
        low, high = float(tries[last]), float(tries[last + 1])
    return low


_CELL_S = 0.002


def smoothed(profile: SpeedProfile, over_s: float) -> SpeedProfile:
    """Smooth a profile: its speed becomes the moving average over the last `over_s`.

    An acceleration step becomes a ramp over `over_s`, and the maximum acceleration does not
    increase. Each motion from rest to rest takes `over_s` longer. On straight segments all limits
    still hold; on curves the speed at a point changes slightly.
    """
    if not over_s > 0.0:
        return profile
    at_s, s_m, speed = [np.zeros(1)], [profile.s_m[:1]], [np.zeros(1)]
    rests = np.flatnonzero(profile.speed_mps == 0.0)
    for first, last in itertools.pairwise(rests):
        begin_s, end_s = float(profile.at_s[first]), float(profile.at_s[last])
        cells = int(np.ceil((end_s - begin_s + over_s) / _CELL_S))
        t_s = np.linspace(begin_s, end_s + over_s, cells + 1)
        now_m, before_m = (profile.place_m(np.clip(t, begin_s, end_s)) for t in (t_s, t_s - over_s))
        mean = (now_m - before_m) / over_s
        mean[-1] = 0.0
        # Interpolating linearly between speeds, the sum matches the path length to within 1e-4.
        way_m = np.cumsum(0.5 * (mean[1:] + mean[:-1]) * np.diff(t_s))
        length_m = float(profile.s_m[last] - profile.s_m[first])
        s_m.append(profile.s_m[first] + way_m * (length_m / way_m[-1]))
        at_s.append(at_s[-1][-1] + t_s[1:] - begin_s)
        speed.append(mean[1:])
    speeds, times = np.concatenate(speed), np.concatenate(at_s)
    return SpeedProfile(np.concatenate(s_m), speeds, np.diff(speeds) / np.diff(times), times)


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Reference of a trajectory at one or many times; shaped like the times."""

    pose: Array
    """(..., 3): x, y, heading."""
    twist: Array
    """(..., 3): twist in the body frame of `pose`."""
    twist_rate: Array
    """(..., 3): time derivative of the body twist."""
    direction: Array
    """(...): direction of the path, radians."""
    s_m: Array
    """(...): arc length."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Route with its speed profile; constant before the start and after the end."""

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
        """Return the reference at times `t_s` (...), seconds after the start."""
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
    kinematics: Kinematics[SE2],
    limits: Limits,
    *,
    share: float = 1.0,
    speed_mps: float | None = None,
    cell_m: float = 0.005,
    smooth_s: float = 0.0,
) -> Trajectory:
    """Plan the time-optimal trajectory from rest to rest, stopping at each of `route.stops_m`.

    It respects the limits of speed, turn rate, acceleration, deceleration and angular acceleration,
    and the joint limits (`joint_utilization` and `rate_utilization` of the kinematics).
    Accelerations are limited both over the ground, where friction bounds them, and in body axes,
    where the control loop limits them.

    Args:
        route: Route to follow.
        kinematics: Kinematics of the robot.
        limits: Limits of the robot.
        share: Factor in (0, 1] on all limits except speed, as a margin for feedback.
        speed_mps: Additional speed limit.
        cell_m: Cell length.
        smooth_s: Ramp duration of acceleration steps; see `smoothed`.

    Raises:
        PathError: If the share is out of range, or the route cannot be followed at any speed.
    """
    if not 0.0 < share <= 1.0 or not cell_m > 0.0:
        raise PathError(f"the share of the limits must be in (0, 1], not {share}")
    ends = [0.0, *route.breaks_m, route.length_m]
    pieces = [_graded(a, b, cell_m) for a, b in itertools.pairwise(ends)]
    s = np.concatenate([*pieces, [route.length_m]])
    top = limits.speed_mps if speed_mps is None else min(speed_mps, limits.speed_mps)
    cells = PathConstraints(route, kinematics, limits, s, share)
    cap = np.square(np.minimum(top, cells.highest_speeds()))
    cap[np.isin(s, [0.0, *route.stops_m, route.length_m])] = 0.0
    squared, acceleration = _forward(cells, *_backward(cells, cap))
    speed = np.sqrt(squared)
    mean = 0.5 * (speed[:-1] + speed[1:])
    if not mean.min() > 0.0:
        raise path_refusal(because(Code.PATH_CANNOT_BE_FOLLOWED, at_m=float(s[int(mean.argmin())])))
    at_s = np.concatenate([[0.0], np.cumsum(np.diff(s) / mean)])
    profile = SpeedProfile(s, speed, acceleration, at_s)
    return Trajectory(route, smoothed(profile, smooth_s))
