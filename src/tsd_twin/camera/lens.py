"""Lens and place of a camera: from the floor to pixels and back, with derivatives."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import cv2
import numpy as np

from tsd_twin.lie import Array

LENS_PARAMETERS = 8
"""fx, fy, cx, cy, k1, k2, p1, p2."""
PARAMETERS = LENS_PARAMETERS + 6
"""Those of the lens, then rotation vector and position of the camera in the floor frame."""
_PRECISE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
"""Steps and error in pixels; OpenCV's default stops 0.01 px off in a corner."""
_undistorted = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # Its name in OpenCV 4.


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """Pinhole with radial and tangential distortion, as in OpenCV's plumb-bob model."""

    width: int
    height: int
    parameters: Array
    """(8,): fx, fy, cx, cy in pixels, then k1, k2, p1, p2."""

    @staticmethod
    def ideal(width: int, height: int, across_deg: float) -> Lens:
        """Return a lens without distortion that sees `across_deg` in a row of pixels."""
        f = 0.5 * width / math.tan(0.5 * math.radians(across_deg))
        middle = [0.5 * (width - 1), 0.5 * (height - 1)]
        return Lens(width, height, np.array([f, f, *middle, 0, 0, 0, 0]))

    @property
    def matrix(self) -> Array:
        """(3, 3): camera matrix."""
        fx, fy, cx, cy = self.parameters[:4]
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

    @property
    def distortion(self) -> Array:
        """(5,): k1, k2, p1, p2 and k3, which is zero."""
        return np.append(self.parameters[4:8], 0.0)

    def rays(self, pixels: Array) -> Array:
        """Return the directions (n, 3) with z = 1 in the camera frame of pixels (n, 2)."""
        points = np.ascontiguousarray(pixels, float).reshape(-1, 1, 2)
        flat = _undistorted(points, self.matrix, self.distortion, R=None, P=None, criteria=_PRECISE)
        return np.column_stack([np.asarray(flat, float).reshape(-1, 2), np.ones(len(points))])

    def pixels(self, points: Array) -> Array:
        """Return the pixels (n, 2) of points (n, 3) in the camera frame.

        As OpenCV's `projectPoints`, which also computes derivatives; not finite where z = 0.
        """
        fx, fy, cx, cy, k1, k2, p1, p2 = self.parameters.tolist()
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
            xx, xy, yy = x * x, x * y, y * y
            square = xx + yy
            radial = 1.0 + square * (k1 + k2 * square)
            column = cx + fx * (x * radial + 2.0 * p1 * xy + p2 * (square + 2.0 * xx))
            row = cy + fy * (y * radial + p1 * (square + 2.0 * yy) + 2.0 * p2 * xy)
        return np.stack([column, row], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class CameraPlace:
    """Pose of a camera in the floor frame."""

    rotation: Array
    """(3,): rotation vector from the floor to the camera frame."""
    position_m: Array
    """(3,): the camera in the floor frame."""

    @staticmethod
    def looking_down(height_m: float) -> CameraPlace:
        """Return a camera above the origin that looks straight down, with floor X to the right."""
        down = np.diag([1.0, -1.0, -1.0])
        return CameraPlace(rotation_vector(down), np.array([0.0, 0.0, height_m]))

    @staticmethod
    def looking_at(position_m: Array, target_m: Array) -> CameraPlace:
        """Return a camera at `position_m` (3,) that looks at `target_m` (3,), upright."""
        ahead = target_m - position_m
        ahead = ahead / np.linalg.norm(ahead)
        up = np.array([0.0, 1.0, 0.0]) if abs(ahead[2]) > 0.999 else np.array([0.0, 0.0, 1.0])
        right = np.cross(ahead, up)
        right /= np.linalg.norm(right)
        matrix = np.stack([right, np.cross(ahead, right), ahead])
        return CameraPlace(rotation_vector(matrix), np.asarray(position_m, float))

    @property
    def matrix(self) -> Array:
        """(3, 3): from floor axes to camera axes."""
        return rotation_matrix(self.rotation)

    @property
    def offset_m(self) -> Array:
        """(3,): the origin of the floor in the camera frame."""
        return -self.matrix @ self.position_m


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Lens and place together."""

    lens: Lens
    place: CameraPlace

    @property
    def parameters(self) -> Array:
        """(14,): parameters of the lens, rotation vector, position."""
        return np.concatenate([self.lens.parameters, self.place.rotation, self.place.position_m])

    def project(self, points_m: Array) -> Array:
        """Return the pixels (n, 2) of points (n, 3) of the floor frame."""
        return self.lens.pixels(points_m @ self.place.matrix.T + self.place.offset_m)

    def by_points(self, points_m: Array) -> tuple[Array, Array]:
        """Return pixels (n, 2) with their derivatives (n, 2, 3) by the points."""
        pixels, jacobian = self._projected(points_m)
        # The points move as the camera does the other way.
        return pixels, (jacobian[:, 3:6] @ self.place.matrix).reshape(-1, 2, 3)

    def derivatives(self, points_m: Array) -> tuple[Array, Array, Array]:
        """Return pixels (n, 2) with their derivatives by the points and by the view.

        The shapes of these are (n, 2, 3) and (n, 2, 14). OpenCV differentiates the lens; its
        translation is converted to a position here.
        """
        pixels, jacobian = self._projected(points_m)
        place = self.place
        by_rotation, by_offset, by_lens = jacobian[:, :3], jacobian[:, 3:6], jacobian[:, 6:14]
        rotated = by_offset @ place.matrix
        # The offset -R p depends on the rotation vector as well.
        turned = np.asarray(cv2.Rodrigues(place.rotation)[1], float).reshape(3, 3, 3)
        by_rotation = by_rotation - by_offset @ (place.position_m @ turned.swapaxes(1, 2)).T
        by_view = np.concatenate([by_lens, by_rotation, -rotated], axis=1)
        return pixels, rotated.reshape(-1, 2, 3), by_view.reshape(-1, 2, PARAMETERS)

    def _projected(self, points_m: Array) -> tuple[Array, Array]:
        """Return pixels (n, 2) with OpenCV's derivatives (2n, 14 or more)."""
        points = np.ascontiguousarray(points_m, float).reshape(-1, 1, 3)
        place, lens = self.place, self.lens
        pixels, jacobian = cv2.projectPoints(
            points, place.rotation, place.offset_m, lens.matrix, lens.distortion
        )
        return np.asarray(pixels, float).reshape(-1, 2), np.asarray(jacobian, float)

    def on_plane(self, pixels: Array, height_m: float = 0.0) -> Array:
        """Return where pixels (n, 2) meet the plane z = `height_m`; NaN above the horizon."""
        rays = self.lens.rays(pixels) @ self.place.matrix
        position = self.place.position_m
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (height_m - position[2]) / rays[:, 2]
        reach[~(reach > 0.0)] = np.nan
        return (position + reach[:, None] * rays)[:, :2]


def rotation_matrix(vector: Array) -> Array:
    """Return the matrix (3, 3) of a rotation vector (3,)."""
    return np.asarray(cv2.Rodrigues(vector)[0], float)


def rotation_vector(matrix: Array) -> Array:
    """Return the rotation vector (3,) of a matrix (3, 3)."""
    return np.asarray(cv2.Rodrigues(matrix)[0], float).ravel()


@functools.cache
def pixel_grid(width: int, height: int) -> Array:
    """Return the centres (width * height, 2) of all pixels, row by row."""
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    return np.column_stack([columns.ravel(), rows.ravel()])
