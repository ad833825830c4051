"""Picture of a camera above the floor, as seen from straight above; no I/O."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tsd_twin.lie import Array
from tsd_twin.messages.pictures import UNKNOWN_PLACE, GroundGrid

MOST_PX = 320
"""Pixels along the longer side; a robot drives by the picture of the pane, not by this one."""


def seen_from_above(picture: NDArray[np.uint8], grid: GroundGrid) -> NDArray[np.uint8]:
    """Return a picture (h, w, 3) of the floor of a grid, x to the right and y upwards.

    `picture` (height, width, 3) is the camera's. What it does not show has its mean colour.
    """
    width_m, depth_m = grid.size_m
    scale = MOST_PX / max(width_m, depth_m)
    width, height = max(1, math.ceil(width_m * scale)), max(1, math.ceil(depth_m * scale))
    places: Array = np.array(grid.places)
    across = _weights(width, places.shape[1])
    upwards = _weights(height, places.shape[0])[::-1]
    shares = np.einsum("ai,ijk,bj->abk", upwards, places, across, optimize=True)
    size = np.array(picture.shape[1::-1])
    pixels = np.floor(shares * size).astype(int)
    is_unknown = np.any(places <= UNKNOWN_PLACE, axis=-1).astype(float)
    shown = ((pixels >= 0) & (pixels < size)).all(axis=-1)
    shown &= upwards @ is_unknown @ across.T == 0.0
    flat = np.empty((height, width, 3), np.uint8)
    flat[:] = picture[::16, ::16].mean(axis=(0, 1))
    columns, rows = pixels[shown].T
    flat[shown] = picture[rows, columns]
    return flat


def _weights(count: int, points: int) -> Array:
    """Return the weights (count, points) that interpolate between points of a grid."""
    at = (np.arange(count) + 0.5) / count * (points - 1)
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - np.arange(points)))
