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
_STEP_PX = 32
"""Sizes of windows are rounded up to it, so that few detectors are kept."""
_WINDOW_CELLS = 0.7, 0.5
"""Half sides of the windows in which a corner is refined, in cells.

A turned window of 0.7 reaches to the end of the white border.
"""


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


def find_tags(picture: Gray, families: Iterable[str]) -> list[Sighting]:
    """Find all tags of these families in a picture."""
    return [
        Sighting(family, int(number), corners.reshape(4, 2).astype(float))
        for family in families
        for number, corners in _detect(picture, family)
    ]


def find_in_window(picture: Gray, window: Window, families: Iterable[str]) -> list[Sighting]:
    """Find the tags in a part of a picture; corners are in pixels of the whole one."""
    if window.is_empty:
        return []
    offset = np.array([window.left, window.top], float)
    part = np.ascontiguousarray(window.of(picture))
    return [
        Sighting(seen.family, seen.number, seen.corners + offset)
        for seen in find_tags(part, families)
    ]


def side_px(corners: Array) -> float:
    """Return the root of the area of a quadrilateral (4, 2) in pixels."""
    x, y = (corners - corners[0]).T
    return float(np.sqrt(0.5 * abs(x @ np.roll(y, 1) - y @ np.roll(x, 1))))


def _detect(picture: Gray, family: str) -> list[tuple[int, Array]]:
    size = _STEP_PX * math.ceil(max(picture.shape) / _STEP_PX)
    corners, numbers, _ = _detector(family, size).detectMarkers(picture)
    if not corners:
        return []  # OpenCV returns None for the numbers of nothing.
    cells = dictionary(family).markerSize + 2
    return [
        (int(number), _refined(picture, np.asarray(found, float).reshape(4, 2), cells))
        for number, found in zip(numbers.ravel(), corners, strict=True)
    ]


def _refined(picture: Gray, corners: Array, cells: int) -> Array:
    """Return corners (4, 2) moved to where edges meet, as CORNER_REFINE_SUBPIX does.

    Its window is 0.3 of a cell, too small for corners that are 2 px off in tags of 40 px. Windows
    here stay inside the white border of a cell. CORNER_REFINE_APRILTAG is half a pixel off, and
    contours are twice as noisy.
    """
    points = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    cell = side_px(corners.reshape(4, 2)) / cells
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.005)
    for share in _WINDOW_CELLS:
        half = max(2, round(share * cell))
        cv2.cornerSubPix(picture, points, (half, half), (-1, -1), criteria)
    return points.reshape(4, 2).astype(float)


@functools.cache
def _detector(family: str, size: int) -> cv2.aruco.ArucoDetector:
    """Return the detector for pictures with a longer side of at most `size`."""
    parameters = cv2.aruco.DetectorParameters()
    smallest, largest = THRESHOLD_WINDOWS
    parameters.adaptiveThreshWinSizeMin = smallest
    parameters.adaptiveThreshWinSizeMax = largest
    parameters.adaptiveThreshWinSizeStep = largest - smallest
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE  # `_refined` does it.
    # OpenCV's 0.03 of the longer side lets noise in a small window become thousands of candidates.
    parameters.minMarkerPerimeterRate = 4.0 * LEAST_SIDE_PX / size
    parameters.errorCorrectionRate = _CORRECTED_SHARE
    parameters.minMarkerDistanceRate = _NESTED_SHARE
    return cv2.aruco.ArucoDetector(dictionary(family), parameters)
