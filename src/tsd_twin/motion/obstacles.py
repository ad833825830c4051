"""Obstacles on the floor: discs around other robots, and shortest paths around them."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import path_refusal

_SIDES = 16
"""Sides of the polygon around a disc along which a path may bend."""
_CORNER = 1.0 / math.cos(math.pi / _SIDES)
"""Radius of its corners, relative to the disc."""
_ROUNDING = 1e-9
_MAX_SHRINK = 0.999
"""Radius of a disc in which the path starts, relative to the distance of the start."""


@dataclass(frozen=True, slots=True)
class Disc:
    """Part of the floor that the centre of a robot must not enter, in `odom`, metres."""

    robot: str
    """Id of the robot inside."""
    xy: tuple[float, float]
    radius_m: float


def first_entered(points: Array, discs: Sequence[Disc]) -> str | None:
    """Return the robot whose disc a polyline (n, 2) enters first, or None."""
    if not discs or len(points) < 2:
        return None
    inside = _distances(points[:-1], points[1:], discs) < _radii(discs)
    where = np.argwhere(inside)
    return discs[int(where[0, 1])].robot if len(where) else None


def detour(start: Array, goal: Array, discs: Sequence[Disc], clearance_m: float = 0.0) -> Array:
    """Return the corners (n, 2) of a short path from `start` (2,) to `goal` (2,), goal included.

    It keeps `clearance_m` from all discs, as far as start and goal do. A disc that contains the
    start is shrunk, so that the robot can leave.

    Raises:
        PathError: If the goal is inside a disc, or the discs leave no path.
    """
    for disc in discs:
        if math.dist(goal, disc.xy) < disc.radius_m:
            raise path_refusal(because(Code.PATH_BLOCKED, robot=disc.robot))
    widened = [_widened(disc, start, goal, clearance_m) for disc in discs]
    near: list[Disc] = []
    while True:  # Each pass adds at least one disc.
        path = _shortest(start, goal, near)
        whole = np.concatenate([start[None], path])
        gaps = _distances(whole[:-1], whole[1:], widened) - _radii(widened)
        added = [
            disc
            for disc, gap_m in zip(widened, gaps.min(axis=0).tolist(), strict=True)
            if gap_m < -_ROUNDING and disc not in near
        ]
        if not added:
            return path
        near += added


def _widened(disc: Disc, start: Array, goal: Array, clearance_m: float) -> Disc:
    least_m = min(math.dist(start, disc.xy), math.dist(goal, disc.xy))
    radius_m = min(disc.radius_m + clearance_m, _MAX_SHRINK * least_m)
    return Disc(disc.robot, disc.xy, radius_m)


def _shortest(start: Array, goal: Array, discs: Sequence[Disc]) -> Array:
    """Return the shortest path over corners of polygons around the discs (Dijkstra 1959)."""
    angles = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    ring = _CORNER * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    corners = [np.array(disc.xy) + disc.radius_m * ring for disc in discs]
    nodes = np.concatenate([start[None], goal[None], *corners])
    n = len(nodes)
    first, second = (each.ravel() for each in np.meshgrid(range(n), range(n), indexing="ij"))
    free = np.ones(n * n, dtype=bool)
    if discs:
        apart = _distances(nodes[first], nodes[second], discs)
        free = (apart >= _radii(discs) - _ROUNDING).all(axis=1)
    free = free.reshape(n, n)
    lengths = np.hypot(*np.moveaxis(nodes[:, None] - nodes[None], -1, 0))
    reached, before = {0: 0.0}, {0: 0}
    queue, done = [(0.0, 0)], set[int]()
    while queue and 1 not in done:
        so_far, node = heapq.heappop(queue)
        done.add(node)
        for after in np.flatnonzero(free[node]).tolist():
            length = so_far + float(lengths[node, after])
            if length < reached.get(after, math.inf):
                reached[after], before[after] = length, node
                heapq.heappush(queue, (length, after))
    if 1 not in done:
        raise path_refusal(because(Code.PATH_BLOCKED, robot=_nearest(start, discs).robot))
    path = [1]
    while path[-1] != 0:
        path.append(before[path[-1]])
    return nodes[path[-2::-1]]


def _nearest(start: Array, discs: Sequence[Disc]) -> Disc:
    return min(discs, key=lambda disc: math.dist(start, disc.xy) - disc.radius_m)


def _radii(discs: Sequence[Disc]) -> Array:
    return np.array([disc.radius_m for disc in discs])


def _distances(starts: Array, ends: Array, discs: Sequence[Disc]) -> Array:
    """Return the distances (n, k) of segments (n, 2) to the centres of discs."""
    centres = np.array([disc.xy for disc in discs]).reshape(-1, 2)
    along = (ends - starts)[:, None]
    offset = centres - starts[:, None]
    squared = np.maximum((along * along).sum(axis=-1), 1e-18)
    share = np.clip((offset * along).sum(axis=-1) / squared, 0.0, 1.0)
    return np.hypot(*np.moveaxis(offset - share[..., None] * along, -1, 0))
