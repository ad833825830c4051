"""Paths one after the other, and polylines with their corners."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from tsd_twin.errors import PathError
from tsd_twin.lie import Array, wrap
from tsd_twin.motion.arc import line
from tsd_twin.motion.curve import blend
from tsd_twin.motion.path import Path, PathPoints

_GAP_M = 1e-6
_CORNER_RAD = 1e-6


class Chain:
    """Several paths as one; each starts where the one before ends.

    Raises:
        PathError: there is a gap, or there is no path.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        if not paths:
            raise PathError("a chain needs a path or more")
        self._paths = tuple(paths)
        self._starts = np.concatenate([[0.0], np.cumsum([path.length_m for path in paths])])
        turns = [0.0]
        corners, knots = list(paths[0].corners_m), list(paths[0].knots_m)
        for i, (before, after) in enumerate(itertools.pairwise(paths)):
            end, start = before.at(np.array(before.length_m)), after.at(np.array(0.0))
            if np.abs(end.xy - start.xy).max() > _GAP_M:
                raise PathError(f"part {i + 2} starts at {start.xy}, part {i + 1} ends at {end.xy}")
            step = float(wrap(start.direction - end.direction))
            # Directions go on where they were, so that full turns can be counted.
            turns.append(turns[-1] + float(end.direction - start.direction) + step)
            at = float(self._starts[i + 1])
            if abs(step) > _CORNER_RAD:
                corners.append(at)
            else:
                knots.append(at)
            corners += [at + corner for corner in after.corners_m]
            knots += [at + knot for knot in after.knots_m]
        self._turns = tuple(turns)
        self.corners_m: tuple[float, ...] = tuple(corners)
        self.knots_m: tuple[float, ...] = tuple(knots)

    @property
    def length_m(self) -> float:
        """Arc length."""
        return float(self._starts[-1])

    def at(self, s_m: Array) -> PathPoints:
        """Return the points at arc lengths `s_m` (...); at a joint, those that follow it."""
        s = np.asarray(s_m, dtype=float)
        part = np.clip(np.searchsorted(self._starts, s, side="right") - 1, 0, len(self._paths) - 1)
        out = PathPoints(np.empty((*s.shape, 2)), *(np.empty(s.shape) for _ in range(3)))
        for i in np.unique(part):
            here = part == i
            points = self._paths[int(i)].at(s[here] - self._starts[i])
            out.xy[here] = points.xy
            out.direction[here] = points.direction + self._turns[i]
            out.curvature[here] = points.curvature
            out.sharpness[here] = points.sharpness
        return out


def polyline(points_m: Array | Sequence[Sequence[float]], cut_m: float = 0.0) -> Chain:
    """Return the way along straight legs through `points_m` (n, 2), n above 1, metres.

    Corners are sharp, so the robot stops there; with `cut_m` it leaves a leg that far before a
    corner, at most half a leg, and rounds it by a smooth curve.
    """
    points = np.asarray(points_m, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not cut_m >= 0.0:
        raise PathError(f"a polyline needs two points (x, y) or more, not {points.shape}")
    legs = np.diff(points, axis=0)
    lengths = np.hypot(*legs.T)
    if not np.isfinite(points).all() or lengths.min() <= 0.0:
        raise PathError("the points of a polyline must be finite, each another than the last")
    along = legs / lengths[:, None]
    reach = np.minimum(cut_m, 0.5 * np.minimum(lengths[:-1], lengths[1:]))
    straight = np.abs(wrap(np.diff(np.arctan2(along[:, 1], along[:, 0])))) < _CORNER_RAD
    reach = np.where(straight, 0.0, reach)
    paths: list[Path] = []
    here = points[0]
    for i in range(len(legs)):
        cut = reach[i] if i < len(reach) else 0.0
        end = points[i + 1] - cut * along[i]
        if np.hypot(*(end - here)) > _GAP_M:
            paths.append(line(here.tolist(), end.tolist()))
        here = end
        if cut > 0.0:
            here = points[i + 1] + cut * along[i + 1]
            paths.append(blend(end, points[i + 1], here))
    return Chain(paths)
