"""Where the pictures of a camera show the floor."""

from __future__ import annotations

import numpy as np

from tsd_twin.camera.lens import View
from tsd_twin.lie import Array
from tsd_twin.messages.pictures import GroundGrid

POINTS = 17
"""Points of the grid along a side."""
FARTHEST_HEIGHTS = 4.0
"""Farthest floor that is drawn from below the camera, in heights of the camera."""
_ALONG_EDGE = 33
_OUTSIDE = -10.0
_BEYOND = 1.05
"""Rays beyond the widest one of the picture by this factor: the model of the lens folds back."""


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
    x, y = (np.linspace(low[i], high[i], POINTS) for i in range(2))
    points = np.stack([*np.meshgrid(x, y), np.zeros((POINTS, POINTS))], axis=-1).reshape(-1, 3)
    size = np.array([view.lens.width, view.lens.height])
    places = (view.project(points) + 0.5) / size
    places[~_is_before(view, points, edge)] = _OUTSIDE
    rows = places.clip(_OUTSIDE, 1.0 - _OUTSIDE).round(5).reshape(POINTS, POINTS, 2).tolist()
    width_m, depth_m = (high - low).tolist()
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


def _is_before(view: View, points: Array, edge: Array) -> Array:
    """Return whether points (n, 3) are before the camera, within the widest ray of the picture."""
    seen = points @ view.place.matrix.T + view.place.offset_m
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.hypot(seen[:, 0], seen[:, 1]) / seen[:, 2]
    widest = np.hypot(*view.lens.rays(edge)[:, :2].T).max()
    return (seen[:, 2] > 0.0) & (slope <= _BEYOND * widest)
