"""Corners of tags in a picture, in the whole of it or in windows."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsd_twin.camera.lens import Lens
from tsd_twin.camera.tags import dictionary
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
    return find_in_window(picture, Window(0, 0, columns, rows), families, lens)


def find_in_window(
    picture: Gray, window: Window, families: Iterable[str], lens: Lens
) -> list[Sighting]:
    """Find the tags in a part of a picture; corners are in pixels of the whole one."""
    if window.is_empty:
        return []
    part = np.ascontiguousarray(window.of(picture))
    found: list[Sighting] = []
    for family in families:
        for number, corners in _detect(part, family):
            corners += [window.left, window.top]
            refined = refine_corners(picture, corners, dictionary(family).markerSize + 2, lens)
            if refined is not None:
                found.append(Sighting(family, number, refined))
    return found


def side_px(corners: Array) -> float:
    """Return the root of the area of a quadrilateral (4, 2) in pixels."""
    x, y = (corners - corners[0]).T
    return float(np.sqrt(0.5 * abs(x @ np.roll(y, 1) - y @ np.roll(x, 1))))


def _detect(part: Gray, family: str) -> list[tuple[int, Array]]:
    """Return the numbers of the tags in a part, and their corners (4, 2) within 2 px or so."""
    size = _SIZE_STEP_PX * math.ceil(max(part.shape) / _SIZE_STEP_PX)
    corners, numbers, _ = _detector(family, size).detectMarkers(part)
    if not corners:
        return []  # OpenCV returns None for the numbers of nothing.
    return [
        (int(number), np.asarray(found, float).reshape(4, 2))
        for number, found in zip(numbers.ravel(), corners, strict=True)
    ]


def refine_corners(picture: Gray, corners: Array, cells: int, lens: Lens) -> Array | None:
    """Return corners (4, 2) where the lines through the edges of a tag meet.

    None if one is more than a cell from the corner that was found: the edges are not the tag's.

    Edges are lines in the picture of a lens without distortion. `cornerSubPix` is ten times worse
    (docs/camera.md): it sees a corner's surroundings only, and the outer edge of the white border
    may draw it 4 px away. CORNER_REFINE_APRILTAG is half a pixel off.
    """
    cell_px = side_px(corners) / cells
    refined = corners
    for reach_cells in _REACH_CELLS:
        points, weights = _edge_points(picture, refined, cells, reach_cells * cell_px)
        refined = _meeting_points(points, weights, lens)
        if not (np.linalg.norm(refined - corners, axis=1) <= cell_px).all():
            return None
    return refined


def _edge_points(picture: Gray, corners: Array, cells: int, reach_px: float) -> tuple[Array, Array]:
    """Return points (4, n, 2) on the edges near the sides of a quadrilateral, and weights (4, n).

    Each is the centroid of squared slopes from dark to light along a profile across the side. The
    edges next to it are from light to dark.
    """
    along = np.roll(corners, -1, axis=0) - corners
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    outward /= np.linalg.norm(along, axis=1, keepdims=True)
    shares = np.linspace(0.5, cells - 0.5, _EDGE_POINTS) / cells
    points = corners[:, None] + shares[:, None] * along[:, None]
    half = math.ceil(reach_px / _STEP_PX)
    offsets = _STEP_PX * np.arange(-half, half + 1)
    samples = points[:, :, None] + offsets[:, None] * outward[:, None, None]
    x, y = np.moveaxis(samples.reshape(4 * _EDGE_POINTS, -1, 2).astype(np.float32), -1, 0)
    profiles = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    slopes = np.diff(profiles.reshape(4, _EDGE_POINTS, -1).astype(float), axis=2)
    squares = np.square(np.maximum(slopes, 0.0))
    weights = squares.sum(axis=2) + 1e-9  # Without any edge, the side remains where it was.
    aside = squares @ (0.5 * (offsets[1:] + offsets[:-1])) / weights
    return points + aside[:, :, None] * outward[:, None], weights


def _meeting_points(points: Array, weights: Array, lens: Lens) -> Array:
    """Return where lines through points (4, n, 2) of adjacent sides meet, in pixels (4, 2)."""
    rays = lens.rays(points.reshape(-1, 2))[:, :2].reshape(points.shape)
    weights = weights[..., None] / weights.sum(axis=1)[:, None, None]
    middles = (weights * rays).sum(axis=1)
    spread = rays - middles[:, None]
    # The normal of each line is the direction of the least spread.
    normals = np.linalg.eigh(spread.transpose(0, 2, 1) @ (weights * spread))[1][:, :, 0]
    lines = np.column_stack([normals, -(normals * middles).sum(axis=1)])  # Homogeneous.
    return lens.pixels(np.cross(np.roll(lines, 1, axis=0), lines))


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
