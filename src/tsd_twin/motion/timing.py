"""The fastest way to run along a route within all limits.

Reachability analysis: Pham and Pham, "A new approach to time-optimal path parameterization based on
reachability analysis" (2018, arXiv 1707.07239). A pass backward finds, for each place, the highest
speed from which the rest can still be done; a pass forward takes the highest acceleration that
stays below. The result is at each place the highest speed of all profiles that keep the limits.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from tsd_twin.drives import Drive
from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.cells import Cells
from tsd_twin.motion.route import Route
from tsd_twin.robots.robot import Limits

_LEAST_CELLS = 100
"""Between two breaks, however close they are."""
_TRIES = 25
_ROUNDS = 4
"""A search narrows an interval to 1 in 24, so many times: to 3e-6 of it."""


@dataclass(frozen=True, slots=True, eq=False)
class SpeedProfile:
    """Speed along a route: constant acceleration in each cell between two of `s_m`."""

    s_m: Array
    """(n + 1,): ends of the cells."""
    speed_mps: Array
    """(n + 1,): at the ends of the cells."""
    acceleration_mps2: Array
    """(n,): within each cell."""
    at_s: Array
    """(n + 1,): when each end is reached, seconds."""

    def place_m(self, t_s: Array) -> Array:
        """Return how far along (...) it is at times `t_s` (...) from start to end."""
        cell, since = self.since(t_s)
        s = self.s_m[cell] + since * (
            self.speed_mps[cell] + 0.5 * since * self.acceleration_mps2[cell]
        )
        return np.minimum(s, self.s_m[cell + 1])

    def since(self, t_s: Array) -> tuple[npt.NDArray[np.intp], Array]:
        """Return the cell at each of `t_s` (...), and the time since it was entered."""
        last = len(self.acceleration_mps2) - 1
        cell = np.clip(np.searchsorted(self.at_s, t_s, side="right") - 1, 0, last)
        return cell, t_s - self.at_s[cell]


def fastest(
    route: Route,
    drive: Drive[SE2],
    limits: Limits,
    *,
    share: float = 1.0,
    speed_mps: float | None = None,
    cell_m: float = 0.005,
) -> SpeedProfile:
    """Return the fastest profile from rest to rest, with a stop at each of `route.stops_m`.

    Kept are the limits of speed, turn rate, acceleration, deceleration and angular acceleration,
    and those of the joints by the drive's `demand` and `rate_demand`. Accelerations are limited
    twice: over the ground, which friction has to give, and in the body's axes, where the core
    limits them. `share` in (0, 1] lowers all limits but that of speed, and so leaves room to
    correct; `speed_mps` lowers that of speed.

    Raises:
        PathError: the share is out of range, or the route cannot be followed at any speed.
    """
    if not 0.0 < share <= 1.0 or not cell_m > 0.0:
        raise PathError(f"the share of the limits must be in (0, 1], not {share}")
    ends = [0.0, *route.breaks_m, route.length_m]
    pieces = [_graded(a, b, cell_m) for a, b in itertools.pairwise(ends)]
    s = np.concatenate([*pieces, [route.length_m]])
    top = limits.speed_mps if speed_mps is None else min(speed_mps, limits.speed_mps)
    cells = Cells(route, drive, limits, s, share)
    cap = np.square(np.minimum(top, cells.fastest()))
    cap[np.isin(s, [0.0, *route.stops_m, route.length_m])] = 0.0
    squared, acceleration = _forward(cells, *_backward(cells, cap))
    speed = np.sqrt(squared)
    mean = 0.5 * (speed[:-1] + speed[1:])
    if not mean.min() > 0.0:
        raise PathError(f"the route cannot be followed at {s[int(mean.argmin())]:.3f} m")
    at_s = np.concatenate([[0.0], np.cumsum(np.diff(s) / mean)])
    return SpeedProfile(s, speed, acceleration, at_s)


def _graded(start_m: float, end_m: float, cell_m: float) -> Array:
    """Return where the cells of a piece start, short near its ends, where speed changes most."""
    cells = max(_LEAST_CELLS, math.ceil(0.5 * math.pi * (end_m - start_m) / cell_m))
    share = 0.5 - 0.5 * np.cos(np.pi * np.arange(cells) / cells)
    return start_m + (end_m - start_m) * share


def _backward(cells: Cells, cap: Array) -> tuple[Array, Array]:
    """Return the highest u (n + 1,) from which the end can be reached, and the a (n,) for it."""
    crest, slope = cells.crests()
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
            # The line of all (a, u) that lead to k passes between (0, 0) and the crest.
            inside = k / (u + twice * a) * u
            u = _last(cells, i, inside, u, partial(_towards, k, twice))
            a = (k - u) / twice
        highest[i], acceleration[i] = u, a
    return highest, acceleration


def _forward(cells: Cells, highest: Array, safe: Array) -> tuple[Array, Array]:
    """Return u (n + 1,) and a (n,) of the profile that is as fast as can be everywhere."""
    squared, acceleration = np.zeros(len(highest)), np.zeros(len(safe))
    for i in range(len(safe)):
        u, twice = float(squared[i]), 2.0 * float(cells.lengths_m[i])
        wanted = (float(highest[i + 1]) - u) / twice
        # The set is convex: what can be done at the highest speed can be done in proportion below.
        inside = float(safe[i]) * (u / float(highest[i]) if highest[i] > 0.0 else 0.0)
        a = _last(cells, i, inside, wanted, partial(_from, u))
        acceleration[i] = a
        squared[i + 1] = max(0.0, u + twice * a)
    return squared, acceleration


def _towards(end: float, twice: float, u: Array) -> tuple[Array, Array]:
    """Return (a, u) that lead from each of `u` to `end`, over half of `twice`."""
    return (end - u) / twice, u


def _from(u: float, a: Array) -> tuple[Array, Array]:
    """Return (a, u) for each of `a`."""
    return a, np.full(a.shape, u)


def _last(
    cells: Cells,
    cell: int,
    inside: float,
    outside: float,
    point: Callable[[Array], tuple[Array, Array]],
) -> float:
    """Return the last number on the way from `inside` to `outside` at which a cell's limits hold.

    `point` maps numbers to (a, u). The set is convex, so that what holds is an interval.
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
