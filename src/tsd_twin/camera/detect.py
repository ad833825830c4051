"""Corners of tags in a picture, in the whole of it or in windows."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsd_twin.camera.lens import Lens
from tsd_twin.camera.tags import dictionary, side_cells
from tsd_twin.lie import Array

Gray: TypeAlias = NDArray[np.uint8]
"""(rows, columns): brightness of each pixel."""

THRESHOLD_WINDOWS = 15, 31
"""Sides of the threshold windows, in pixels (docs/camera.md).

They find 38 of 47 tags in photographs, most of them below 20 px; a single one finds 32, and
OpenCV's three, 3, 13 and 23, find 36 in twice the time.
"""
_CORRECTED_SHARE = 0.6
"""Wrong cells that are corrected, relative to the most that the dictionary permits.

Three of the 36 cells of 36h11, whose numbers differ in eleven or more.
"""
_NESTED_SHARE = 0.02
"""Distance between outlines that count as one, relative to the circumference.

With OpenCV's 0.125, the edge of the white border on a dark robot may replace the tag inside it: 3
of 100 tags of 65 px and more are not found, most of them near the edge of the picture.
"""
LEAST_SIDE_PX = 12.0
"""Smallest side of a tag, with 1.5 px per cell."""
_SIZE_STEP_PX = 32
"""Sizes of windows are rounded up to it, so that few detectors are kept."""
_EDGE_POINTS = 32
"""Number of profiles across each edge, without half a cell at both ends."""
_REACH_CELLS = 0.8, 0.5
"""Half length of a profile across an edge, within the white border.

The second round measures across the lines of the first, so that all profiles are centred.
"""
_STEP_PX = 0.5
"""Distance of the samples of a profile."""
_NEXT, _BEFORE = [1, 2, 3, 0], [3, 0, 1, 2]
"""Order of the corners that follow, and of the sides before; `np.roll` is slower."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """Tag found in a picture."""

    family: str
    number: int
    corners: Array
    """(4, 2): pixels, from the top left of the tag, clockwise."""

    @property
    def side_px(self) -> float:
        """Root of the area that the tag covers."""
        return side_px(self.corners)


@dataclass(frozen=True, slots=True)
class Window:
    """Part of a picture, in whole pixels."""

    left: int
    top: int
    right: int
    bottom: int

    @staticmethod
    def around(points: Array, margin_px: float, shape: tuple[int, ...]) -> Window:
        """Return the window around points (n, 2), cut off at the edge of a picture."""
        low = np.floor(points.min(axis=0) - margin_px)
        high = np.ceil(points.max(axis=0) + margin_px) + 1
        left, top = np.clip(low, 0, [shape[1], shape[0]]).astype(int)
        right, bottom = np.clip(high, 0, [shape[1], shape[0]]).astype(int)
        return Window(int(left), int(top), int(right), int(bottom))

    @property
    def is_empty(self) -> bool:
        """Whether it lies outside the picture."""
        return self.right <= self.left or self.bottom <= self.top

    def of(self, picture: Gray) -> Gray:
        """Return this part of a picture, not a copy."""
        return picture[self.top : self.bottom, self.left : self.right]


def find_tags(picture: Gray, families: Iterable[str], lens: Lens) -> list[Sighting]:
    """Find all tags of these families in a picture."""
    rows, columns = picture.shape
    whole = Window(0, 0, columns, rows)
    return refined(picture, [s for each in families for s in detect(picture, whole, each)], lens)


def side_px(corners: Array) -> float:
    """Return the root of the area of a quadrilateral (4, 2) in pixels."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners.tolist()
    return math.sqrt(0.5 * abs((cx - ax) * (dy - by) - (cy - ay) * (dx - bx)))  # By its diagonals.


def detect(picture: Gray, window: Window, family: str) -> list[Sighting]:
    """Return the tags in a part of a picture, with corners within 2 px or so."""
    if window.is_empty:
        return []
    part = np.ascontiguousarray(window.of(picture))
    size = _SIZE_STEP_PX * math.ceil(max(part.shape) / _SIZE_STEP_PX)
    corners, numbers, _ = _detector(family, size).detectMarkers(part)
    if not corners:
        return []  # OpenCV returns None for the numbers of nothing.
    offset = [window.left, window.top]
    return [
        Sighting(family, int(number), np.asarray(found, float).reshape(4, 2) + offset)
        for number, found in zip(numbers.ravel(), corners, strict=True)
    ]


def refined(picture: Gray, sightings: Sequence[Sighting], lens: Lens) -> list[Sighting]:
    """Return sightings with refined corners, without those whose edges are not a tag's."""
    if not sightings:
        return []
    corners = np.stack([each.corners for each in sightings])
    cells = np.array([side_cells(each.family) for each in sightings])
    found, is_tag = refine_corners(picture, corners, cells, lens)
    return [replace(each, corners=found[i]) for i, each in enumerate(sightings) if is_tag[i]]


def refine_corners(
    picture: Gray, corners: Array, cells: Array, lens: Lens
) -> tuple[Array, NDArray[np.bool_]]:
    """Return corners (n, 4, 2) where the lines through the edges of n tags meet.

    `cells` (n,) is the number of cells along a side of each tag. The second result (n,) is False
    if a corner is more than a cell from the one that was found: the edges are not the tag's.

    Edges are lines in the picture of a lens without distortion. `cornerSubPix` is ten times worse
    (docs/camera.md): it sees a corner's surroundings only, and the outer edge of the white border
    may draw it 4 px away. CORNER_REFINE_APRILTAG is half a pixel off.
    """
    # Refine all tags at once, because the overhead of calls takes most of the time.
    cell_px = np.array([side_px(each) for each in corners]) / cells
    found, is_tag = corners, np.ones(len(corners), bool)
    for reach_cells in _REACH_CELLS:
        lines = _fitted_lines(*_edge_points(picture, found, cells, reach_cells * cell_px), lens)
        ends = np.cross(lines[:, _BEFORE], lines).reshape(-1, 3)  # Homogeneous.
        found = lens.pixels(ends).reshape(corners.shape)
        off_px = np.hypot(*np.moveaxis(found - corners, 2, 0)).max(axis=1)
        is_tag &= off_px <= cell_px
        found = np.where(is_tag[:, None, None], found, corners)
    return found, is_tag


def _edge_points(
    picture: Gray, corners: Array, cells: Array, reach_px: Array
) -> tuple[Array, Array]:
    """Return points (n, 4, m, 2) on the edges near the sides of n tags, and weights (n, 4, m).

    Each is the centroid of squared slopes from dark to light along a profile across the side. The
    edges next to it are from light to dark.
    """
    along = corners[:, _NEXT] - corners
    outward = along[..., ::-1] * [1.0, -1.0] / np.hypot(along[..., 0], along[..., 1])[..., None]
    shares = np.linspace(0.5, cells - 0.5, _EDGE_POINTS, axis=1) / cells[:, None]
    points = corners[:, :, None] + shares[:, None, :, None] * along[:, :, None]
    half = np.ceil(reach_px / _STEP_PX)
    most = int(half.max())
    offsets = _STEP_PX * np.arange(-most, most + 1, dtype=float)
    x, y = (
        (points[..., axis, None] + outward[..., axis, None, None] * offsets)
        .reshape(4 * len(corners), -1)
        .astype(np.float32)
        for axis in (0, 1)
    )
    pixels = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profiles = pixels.reshape(-1, len(offsets))
    slopes = cv2.subtract(profiles[:, 1:], profiles[:, :-1])  # Not below 0.
    middles = offsets[1:] - 0.5 * _STEP_PX
    within = np.abs(middles) < (_STEP_PX * half)[:, None]
    squares = np.square(slopes, dtype=float).reshape(*points.shape[:3], -1)
    squares *= within[:, None, None]
    weights = squares.sum(axis=3) + 1e-9  # Without any edge, the side remains where it was.
    aside = squares @ middles / weights
    return points + aside[..., None] * outward[:, :, None], weights


def _fitted_lines(points: Array, weights: Array, lens: Lens) -> Array:
    """Return lines (n, 4, 3) a x + b y + c = 0 through the rays of points (n, 4, m, 2)."""
    rays = lens.rays(points.reshape(-1, 2))[:, :2].reshape(points.shape)
    weights = (weights / weights.sum(axis=2, keepdims=True))[..., None, :]
    middles = weights @ rays
    spread = rays - middles
    moments = weights * spread.swapaxes(2, 3) @ spread
    # The normal of each line is the direction of the least spread.
    angles = 0.5 * np.arctan2(-2.0 * moments[..., 0, 1], moments[..., 1, 1] - moments[..., 0, 0])
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    return np.concatenate([normals, -(middles @ normals[..., None])[..., 0]], axis=2)


@functools.cache
def _detector(family: str, size: int) -> cv2.aruco.ArucoDetector:
    """Return the detector for pictures with a longer side of at most `size`."""
    parameters = cv2.aruco.DetectorParameters()
    smallest, largest = THRESHOLD_WINDOWS
    parameters.adaptiveThreshWinSizeMin = smallest
    parameters.adaptiveThreshWinSizeMax = largest
    parameters.adaptiveThreshWinSizeStep = largest - smallest
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE  # `refine_corners` does it.
    # OpenCV's 0.03 of the longer side lets noise in a small window become thousands of candidates.
    parameters.minMarkerPerimeterRate = 4.0 * LEAST_SIDE_PX / size
    parameters.errorCorrectionRate = _CORRECTED_SHARE
    parameters.minMarkerDistanceRate = _NESTED_SHARE
    return cv2.aruco.ArucoDetector(dictionary(family), parameters)
