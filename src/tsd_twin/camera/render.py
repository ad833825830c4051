"""Simulated camera: floor, robots and tags as a lens and a sensor with noise show them.

The floor is drawn once. Each frame copies it and draws windows around robots only: bodies as the
outlines of their convex parts, tags with 4 x 4 samples a pixel, each at its own time of the
exposure. Not modelled: rolling shutter, reflections, vignetting, compression in the camera.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tsd_twin.camera.detect import Gray, Window
from tsd_twin.camera.lens import View, pixel_grid, rotation_matrix
from tsd_twin.camera.tags import QUIET_CELLS, Tag, side_cells, with_quiet_zone
from tsd_twin.lie import SE2, Array

_SAMPLES = 4
"""Samples per pixel in each direction."""
_OFFSETS = (np.indices((_SAMPLES, _SAMPLES)).reshape(2, -1)[::-1].T + 0.5) / _SAMPLES - 0.5
"""(16, 2): places of the samples in a pixel."""
_TIMES = np.array([15, 2, 1, 12, 4, 9, 10, 7, 8, 5, 6, 11, 3, 14, 13, 0])
"""Order in which the samples are taken during an exposure.

An associative magic square: rows and columns have the same mean, and samples opposite in the pixel
are opposite in time, so that edges are blurred evenly on both sides, whichever way they move.
"""
_TEXEL_CELLS = 16
"""Texels of a texture per cell of a tag."""
_SHIFT = 4
"""Fractional bits of the vertices of outlines."""
_MARGIN_PX = 6.0
_BANK_MARGIN = 256
"""The bank of noise is larger than a picture by so many pixels, for random offsets."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """Optics and electronics of a webcam.

    Blur and noise have the values of the measurements in docs/camera.md.
    """

    blur_px: float = 0.8
    """Standard deviation of the point spread."""
    noise: float = 4.0
    """Standard deviation of a pixel, of 255."""
    exposure_s: float = 0.008
    delay_s: float = 0.05
    """From the middle of the exposure to the picture in the program."""
    rate_hz: float = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Convex part of a body: vertices (n, 3) in the frame of the robot on the floor, brightness."""

    vertices_m: Array
    brightness: int


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Robot as a camera sees it: parts from bottom to top, and its tags."""

    solids: Sequence[Solid]
    tags: Sequence[Tag]


def cylinder(radius_m: float, height_m: float, brightness: int = 70) -> Solid:
    """Return an upright cylinder on the floor."""
    turn = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    ring = radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
    levels = [np.column_stack([ring, np.full(len(ring), z)]) for z in (0.0, height_m)]
    return Solid(np.concatenate(levels), brightness)


class SimulatedCamera:
    """Draws frames of robots on a floor; not thread-safe."""

    def __init__(
        self,
        view: View,
        floor_tags: Sequence[Tag] = (),
        sensor: Sensor | None = None,
        seed: int = 0,
    ) -> None:
        """Draw the floor with its tags."""
        self.view = view
        self.sensor = sensor or Sensor()
        self._random = np.random.default_rng(seed)
        lens = view.lens
        self._shape = lens.height, lens.width
        rays = lens.rays(pixel_grid(lens.width, lens.height)).astype(np.float32)
        self._rays = np.ascontiguousarray(rays.T).reshape(3, *self._shape)
        self._textures: dict[tuple[str, int], Gray] = {}
        size = (lens.height + _BANK_MARGIN, lens.width + _BANK_MARGIN)
        bank = self.sensor.noise * self._random.standard_normal(size, dtype=np.float32)
        self._bank = np.rint(bank).astype(np.int16)
        self._floor = self._draw_floor(floor_tags)

    def draw(self, robots: Sequence[tuple[Body, Sequence[Array] | Array]]) -> Gray:
        """Return a picture (height, width) of robots.

        Each has the poses (n, 3) of its centre on the floor at equal steps of the exposure; one
        pose is a robot at rest. A row of five adds roll and pitch in radians.
        """
        picture = self._floor.copy()
        for body, poses in robots:
            self._draw_body(picture, body, np.asarray(poses, float))
        return self.add_noise(picture)

    def add_noise(self, picture: Gray) -> Gray:
        """Return the picture with the noise of the sensor."""
        if self.sensor.noise <= 0.0:
            return picture
        top, left = self._random.integers(0, _BANK_MARGIN, 2)
        rows, columns = self._shape
        part = self._bank[top : top + rows, left : left + columns]
        return np.asarray(cv2.add(picture, part, dtype=cv2.CV_8U), np.uint8)

    def _draw_floor(self, tags: Sequence[Tag]) -> Gray:
        """Return the floor: coarse texture, lines each half metre, and tags."""
        rows, columns = self._shape
        where = self.view.on_plane(pixel_grid(columns, rows)).reshape(rows, columns, 2)
        cloud = self._random.standard_normal((rows // 16 + 1, columns // 16 + 1), np.float32)
        brightness = 128.0 + 10.0 * cv2.resize(
            cloud, (columns, rows), interpolation=cv2.INTER_CUBIC
        )
        with np.errstate(invalid="ignore"):
            off_line = np.abs(np.mod(where + 0.25, 0.5) - 0.25).min(axis=2)
        brightness -= 30.0 * np.clip(1.0 - off_line / 0.008, 0.0, 1.0)
        brightness[~np.isfinite(where).all(axis=2)] = 200.0  # Above the horizon.
        picture = np.clip(brightness, 0.0, 255.0).astype(np.uint8)
        for tag in tags:
            self._draw_tag(picture, tag, np.zeros((1, 3)))
        return self._blurred(picture)

    def _draw_body(self, picture: Gray, body: Body, poses: Array) -> None:
        # The middle of the exposure is enough for bodies; their tags are what is measured.
        vertices = np.concatenate([np.zeros((0, 3)), *(solid.vertices_m for solid in body.solids)])
        pixels = self.view.project(placed(vertices, poses[[len(poses) // 2]])[0])
        points = [pixels, *(self._plate(tag, poses) for tag in body.tags)]
        window = Window.around(np.concatenate(points), _MARGIN_PX, picture.shape)
        if window.is_empty:
            return
        part = window.of(picture)
        fixed = np.rint((pixels - [window.left, window.top]) * 2**_SHIFT).astype(np.int32)
        end = 0
        for solid in body.solids:
            start, end = end, end + len(solid.vertices_m)
            outline = cv2.convexHull(fixed[start:end])
            cv2.fillConvexPoly(part, outline, solid.brightness, cv2.LINE_AA, _SHIFT)
        for tag in body.tags:
            self._draw_tag(picture, tag, poses)
        part[:] = self._blurred(part)

    def _plate(self, tag: Tag, poses: Array) -> Array:
        """Return the pixels (8, 2) of a tag's white border in the first and the last pose."""
        corners = tag.corners_m * (1.0 + 2.0 * QUIET_CELLS / side_cells(tag.family))
        return self.view.project(np.concatenate(placed(on_robot(tag, corners), poses[[0, -1]])))

    def _draw_tag(self, picture: Gray, tag: Tag, poses: Array) -> None:
        """Draw a tag with 4 x 4 samples a pixel, averaged over the exposure."""
        window = Window.around(self._plate(tag, poses), 2.0, picture.shape)
        if window.is_empty:
            return
        scale = _TEXEL_CELLS * side_cells(tag.family) / tag.size_m
        axes = self._tag_axes(tag, poses)
        self._draw_plane(window.of(picture), window, self._texture(tag), scale, axes)

    def draw_sheet(self, texture: Gray, texels_per_m: float, axes: Array) -> Gray:
        """Return a picture of a sheet of paper in front of a gray wall.

        `axes` (3, 3) has its X and Y axes and its centre as columns, in the camera frame.
        """
        picture = np.full(self._shape, 150, np.uint8)
        window = Window(0, 0, self._shape[1], self._shape[0])
        self._draw_plane(picture, window, texture, texels_per_m, axes[None])
        return self.add_noise(self._blurred(picture))

    def _draw_plane(
        self, part: Gray, window: Window, texture: Gray, scale: float, axes: Array
    ) -> None:
        """Draw a texture into a part of the picture, averaged over pixels and the exposure.

        `axes` (n, 3, 3) belong to equal steps of the exposure. Each of the samples of a pixel is
        taken at its own place in the pixel and at its own time.
        """
        middle = 0.5 * (np.array(texture.shape[::-1]) - 1.0)
        texels = np.array([[scale, 0.0, middle[0]], [0.0, -scale, middle[1]], [0.0, 0.0, 1.0]])
        steps = (2 * _TIMES + 1) * len(axes) // (2 * len(_TIMES))
        # The inverse maps rays to coordinates on the plane.
        by_ray = (texels @ np.linalg.inv(axes))[steps]
        aside = _OFFSETS @ self._pitch(window)
        by_ray[:, :, 2:] += by_ray[:, :, :2] @ aside[:, :, None]
        rays = self._rays[:, window.top : window.bottom, window.left : window.right].reshape(3, -1)
        total = np.zeros(part.shape, np.uint16)
        for each in by_ray.astype(np.float32):
            columns, rows, depths = (each @ rays).reshape(3, *part.shape)
            drawn = cv2.remap(
                texture,
                columns / depths,
                rows / depths,
                cv2.INTER_NEAREST,
                dst=part.copy(),
                borderMode=cv2.BORDER_TRANSPARENT,
            )
            total += drawn
        part[:] = (total + len(_TIMES) // 2) // len(_TIMES)

    def _pitch(self, window: Window) -> Array:
        """Return the steps (2, 2) of rays to the next column and row, in the middle of a window."""
        row = min((window.top + window.bottom) // 2, self._shape[0] - 2)
        column = min((window.left + window.right) // 2, self._shape[1] - 2)
        rays = self._rays[:2, row : row + 2, column : column + 2].astype(float)
        return np.stack([rays[:, 0, 1], rays[:, 1, 0]]) - rays[:, 0, 0]

    def _tag_axes(self, tag: Tag, poses: Array) -> Array:
        """Return axes and centre of a tag as columns (n, 3, 3), in the camera frame."""
        corners = placed(on_robot(tag, np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])), poses)
        centre = corners[:, 0]
        columns = [
            corners[:, 1] - centre,
            corners[:, 2] - centre,
            centre - self.view.place.position_m,
        ]
        return np.asarray(self.view.place.matrix @ np.stack(columns, axis=2), float)

    def _texture(self, tag: Tag) -> Gray:
        key = tag.family, tag.number
        if key not in self._textures:
            cells = 25 + 205 * with_quiet_zone(*key).astype(np.uint8)
            self._textures[key] = np.kron(cells, np.ones((_TEXEL_CELLS,) * 2, np.uint8))
        return self._textures[key]

    def _blurred(self, part: Gray) -> Gray:
        if self.sensor.blur_px <= 0.0:
            return part
        return np.asarray(cv2.GaussianBlur(part, (0, 0), self.sensor.blur_px), np.uint8)


def exposure_poses(before: SE2, after: SE2) -> Array:
    """Return the poses (16, 3) of a robot at the times of the samples of an exposure."""
    shares = (np.arange(len(_TIMES)) + 0.5) / len(_TIMES)
    return (before @ SE2.exp(shares[:, None] * (before.inverse() @ after).log())).xy_heading


def on_robot(tag: Tag, points_m: Array) -> Array:
    """Return points (n, 2) of a tag in the frame of its robot: (n, 3)."""
    level = tag.place.transform(points_m)
    return np.column_stack([level, np.full(len(level), tag.height_m)])


def placed(points_m: Array, poses: Array) -> Array:
    """Return points (m, 3) of a robot in the floor frame, in n poses: (n, m, 3).

    `poses` is (n, 3): x, y, heading; or (n, 5), with roll and pitch in radians about the robot's
    axes.
    """
    tilts = [rotation_matrix(np.append(each, 0.0)) for each in poses[:, 3:] if len(each)]
    turned = points_m @ np.stack(tilts).swapaxes(1, 2) if tilts else points_m[None]
    level = SE2(poses[:, None, :3]).transform(turned[..., :2])
    heights = np.broadcast_to(turned[..., 2:], (*level.shape[:2], 1))
    return np.concatenate([level, heights], axis=2)
