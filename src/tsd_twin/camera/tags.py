"""Printed tags: dictionaries, shapes, and where each is fixed."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, Array

Cells: TypeAlias = NDArray[np.bool_]
"""(n, n): cells of a tag, True where white."""

FAMILIES = {
    "36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "4x4_50": cv2.aruco.DICT_4X4_50,
    "5x5_100": cv2.aruco.DICT_5X5_100,
    "6x6_250": cv2.aruco.DICT_6X6_250,
}
"""Dictionaries: AprilTag 36h11, and ArUco ones with few numbers, which differ the most."""
DEFAULT_FAMILY = "36h11"
QUIET_CELLS = 1
"""White border that a tag needs, in cells."""


@dataclass(frozen=True, slots=True)
class Tag:
    """Tag of a dictionary, and its place on a robot or on the floor."""

    number: int
    size_m: float
    """Side of the black square."""
    robot: str | None = None
    """Bus id of the robot that carries it; None on the floor."""
    height_m: float = 0.0
    """Above the floor; tags are level."""
    x_m: float = 0.0
    """Centre in the frame of the robot or the floor; X of a tag is to the right."""
    y_m: float = 0.0
    heading_rad: float = 0.0
    """From the X axis of the robot or the floor to the X axis of the tag."""
    family: str = DEFAULT_FAMILY

    @property
    def place(self) -> SE2:
        """Pose of the tag in the frame of the robot or the floor."""
        return SE2(np.array([self.x_m, self.y_m, self.heading_rad]))

    @property
    def corners_m(self) -> Array:
        """(4, 2): corners in its own frame, in the order of OpenCV: from top left, clockwise."""
        return 0.5 * self.size_m * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])


@functools.cache
def dictionary(family: str) -> cv2.aruco.Dictionary:
    """Return the dictionary of a family.

    Raises:
        TwinError: If the family is unknown.
    """
    if family not in FAMILIES:
        raise TwinError(f"'{family}' is not a family of tags: {', '.join(FAMILIES)}")
    return cv2.aruco.getPredefinedDictionary(FAMILIES[family])


def side_cells(family: str) -> int:
    """Return the number of cells along a side of a tag, with its black border."""
    return dictionary(family).markerSize + 2


def cells(family: str, number: int) -> Cells:
    """Return the cells (n, n) of a tag with its black border, True where white.

    Raises:
        TwinError: If the family has no such number.
    """
    known = dictionary(family)
    if not 0 <= number < len(known.bytesList):
        raise TwinError(
            f"tag {number} does not exist: {family} has 0 to {len(known.bytesList) - 1}"
        )
    picture = known.generateImageMarker(number, side_cells(family), borderBits=1)
    return np.asarray(picture, np.uint8) > 0


def with_quiet_zone(family: str, number: int) -> Cells:
    """Return the cells (n + 2, n + 2) of a tag inside the white border that it needs."""
    return np.pad(cells(family, number), QUIET_CELLS, constant_values=True)
