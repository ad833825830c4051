"""Where the pictures of a camera show the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tsd_twin.camera.lens import View
from tsd_twin.lie import Array
from tsd_twin.messages.pictures import UNKNOWN_PLACE, GroundGrid

POINTS = 17
"""Points of the grid along a side."""
FARTHEST_HEIGHTS = 4.0
"""Farthest floor that is drawn from below the camera, in heights of the camera."""
_ALONG_EDGE = 33
_BEYOND = 1.05
"""Points outside the widest ray by this factor are not in the picture, whatever the lens's model
says: far outside it folds back.
"""


def ground_grid(view: View) -> GroundGrid | None:
    """Return the visible part of the floor as a grid; None if the camera does not see the floor."""
    edge = _edge(view.lens.width, view.lens.height)
    below, height_m = view.place.position_m[:2], float(view.place.position_m[2])
    floor = view.on_plane(edge)
    floor = floor[np.isfinite(floor).all(axis=1)]
    if len(floor) == 0 or not height_m > 0.0:
        return None
    reach_m = FARTHEST_HEIGHTS * height_m
    low = np.maximum(floor.min(axis=0), below - reach_m)
    high = np.minimum(floor.max(axis=0), below + reach_m)
    if np.any(high <= low):
        return None
    steps = np.linspace(0.0, 1.0, POINTS)
    across, upwards = np.meshgrid(steps, steps)
    shares = np.column_stack([across.ravel(), upwards.ravel()])
    points = np.column_stack([low + shares * (high - low), np.zeros(len(shares))])
    size = np.array([view.lens.width, view.lens.height])
    places = (view.project(points) + 0.5) / size
    is_known = _is_before(view, points, edge, places)
    places = np.where(is_known[:, None], np.round(places, 5), UNKNOWN_PLACE)
    pairs = [(float(u), float(v)) for u, v in places]
    rows = [pairs[i : i + POINTS] for i in range(0, len(pairs), POINTS)]
    width_m, depth_m = (float(side) for side in high - low)
    return GroundGrid((float(low[0]), float(low[1])), (width_m, depth_m), rows)


def _edge(width: int, height: int) -> Array:
    """Return pixels (n, 2) along the edge of a picture."""
    along = np.linspace(0.0, 1.0, _ALONG_EDGE)
    sides = [
        (along, 0 * along),
        (along, 0 * along + 1.0),
        (0 * along, along),
        (0 * along + 1.0, along),
    ]
    return np.concatenate([np.column_stack(side) for side in sides]) * [width - 1, height - 1]


def _is_before(view: View, points: Array, edge: Array, places: Array) -> NDArray[np.bool_]:
    """Return whether points (n, 3) are before the camera, and `places` (n, 2) theirs."""
    seen = points @ view.place.matrix.T + view.place.offset_m
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.hypot(seen[:, 0], seen[:, 1]) / seen[:, 2]
    widest = np.hypot(*view.lens.rays(edge)[:, :2].T).max()
    is_near = np.all(np.abs(places) < -UNKNOWN_PLACE, axis=1)
    is_shown = np.all((places >= 0.0) & (places <= 1.0), axis=1)
    folds_back = is_shown & (slope > _BEYOND * widest)
    return (seen[:, 2] > 0.0) & is_near & ~folds_back
