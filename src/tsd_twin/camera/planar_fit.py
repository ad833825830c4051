"""Pose of a robot from the corners of its tag, on the plane of known height.

Six unknowns fitted to four corners are ten times worse in the plane (docs/camera.md), and have a
mirrored second solution. The free pose therefore only names the reason of a refusal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from tsd_twin.camera.detect import Gray, Sighting, Window, side_px
from tsd_twin.camera.lens import View, rotation_matrix
from tsd_twin.camera.tags import Tag
from tsd_twin.lie import SE2, Array

_STEPS = 2
"""Steps of the fit; a third one moves poses by less than 2 um."""
_FREEDOM = 5
"""Eight coordinates of corners, less the three that are fitted."""


class Refusal(StrEnum):
    """Reason for which a tag that was found is not believed."""

    SMALL = "small"
    SLANTED = "slanted"
    HEIGHT = "height"
    COVERED = "covered"
    TWICE = "twice"
    BLURRED = "blurred"
    UNCERTAIN = "uncertain"


@dataclass(frozen=True, slots=True)
class MountingErrors:
    """Standard deviations of what pictures cannot tell: constant errors of a robot's tag."""

    height_m: float = 0.003
    tilt_rad: float = math.radians(0.5)
    place_m: float = 0.001
    """For x and y of the tag on the robot."""
    heading_rad: float = math.radians(0.2)


@dataclass(frozen=True, slots=True, eq=False)
class PlanarPose:
    """Pose of a robot in the floor frame, and its covariances (3, 3) in x, y and heading."""

    pose: SE2
    noise: Array
    """Differs from picture to picture."""
    mounting: Array
    """From errors of lens, place, height and mounting: constant while the robot is at rest."""
    side_px: float

    @property
    def covariance(self) -> Array:
        """(3, 3): sum of both."""
        return self.noise + self.mounting


def corner_points(tag: Tag, xy_heading: Array) -> Array:
    """Return the corners (4, 3) of a robot's tag in the floor frame, with the robot at a pose."""
    place = SE2(xy_heading) @ tag.place
    level = place.transform(tag.corners_m)
    return np.column_stack([level, np.full(4, tag.height_m)])


def fit_pose(view: View, tag: Tag, corners: Array) -> tuple[SE2, Array, Array] | None:
    """Fit x, y and heading of the robot to the corners (4, 2) of its tag.

    Returns the pose, the residuals (8,) in pixels and the derivatives (3, 8) of the pose by the
    corners, or None if the corners cannot lie on the plane of the tag.
    """
    seen = view.on_plane(corners, tag.height_m)
    if not np.isfinite(seen).all():
        return None
    guess = SE2(_rigid(tag.corners_m, seen)) @ tag.place.inverse()
    pose = np.asarray(guess.xy_heading, float).copy()
    residuals, gain = np.zeros(8), np.zeros((3, 8))
    for _ in range(_STEPS):
        points = corner_points(tag, pose)
        pixels, by_point = view.by_points(points)
        jacobian = _by_pose(points, by_point, pose)
        gain = np.asarray(np.linalg.solve(jacobian.T @ jacobian, jacobian.T), float)
        residuals = (corners - pixels).ravel()
        pose += gain @ residuals
    return SE2(pose), residuals, gain


def measure(
    view: View,
    view_covariance: Array,
    tag: Tag,
    sighting: Sighting,
    sigma_px: float,
    errors: MountingErrors,
) -> PlanarPose | Refusal:
    """Return the robot's pose with its covariance, or the reason for which it is not believed.

    `view_covariance` (14, 14) belongs to the parameters of the view; `sigma_px` is the smallest
    standard deviation of each coordinate of a corner.
    """
    side = sighting.side_px
    if side < LEAST_BELIEVED_PX:
        return Refusal.SMALL
    fitted = fit_pose(view, tag, sighting.corners)
    if fitted is None:
        return Refusal.SLANTED
    pose, residuals, gain = fitted
    residual_px = math.sqrt(float(residuals @ residuals) / _FREEDOM)
    if residual_px > _RESIDUAL_PX + _RESIDUAL_SHARE * side:
        return _named(view, tag, sighting.corners)
    mounting = _mounting(view, view_covariance, tag, pose, gain, errors)
    # A corner that was found in a wrong place, by the detector or its refinement, shows in the fit.
    noise = max(sigma_px, residual_px) ** 2 * (gain @ gain.T)
    return PlanarPose(pose, noise, mounting, side)


LEAST_BELIEVED_PX = 24.0
"""Three pixels for each cell of a tag with eight."""
_RESIDUAL_PX, _RESIDUAL_SHARE = 0.9, 0.006
"""Largest residual, and its growth with the side of the tag: lens, height, 3 degrees of tilt."""
_SLANTED_RAD = math.radians(12.0)
_SIZE_RATIO = 0.04


def upright_tilt_rad(view: View, tag: Tag, corners: Array) -> float:
    """Return the tilt of the free pose from the vertical, for the more upright of two solutions."""
    half = 0.5 * tag.size_m
    square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    found, turns, _, _ = cv2.solvePnPGeneric(
        square,
        np.ascontiguousarray(corners, float),
        view.lens.matrix,
        view.lens.distortion,
        flags=cv2.SOLVEPNP_IPPE_SQUARE,
    )
    if not found:
        return math.inf
    up = view.place.matrix[:, 2]
    cosines = [float(rotation_matrix(np.asarray(turn, float))[:, 2] @ up) for turn in turns]
    return math.acos(min(1.0, max(cosines)))


def _named(view: View, tag: Tag, corners: Array) -> Refusal:
    """Return the reason for corners that do not fit a level tag."""
    if upright_tilt_rad(view, tag, corners) > _SLANTED_RAD:
        return Refusal.SLANTED
    seen = view.on_plane(corners, tag.height_m)
    return (
        Refusal.HEIGHT if abs(side_px(seen) / tag.size_m - 1.0) > _SIZE_RATIO else Refusal.COVERED
    )


def _rigid(own: Array, seen: Array) -> Array:
    """Return the pose (3,) that moves points (4, 2) with their centre at 0 to others."""
    z, w = own @ np.array([1, 1j]), seen @ np.array([1, 1j])
    middle = w.mean()
    return np.array([middle.real, middle.imag, np.angle(np.sum(np.conj(z) * (w - middle)))])


def _by_pose(points: Array, by_point: Array, pose: Array) -> Array:
    """Return the derivatives (8, 3) of corners by x, y and heading of the robot."""
    level = by_point[:, :, :2]
    arm = points[:, :2] - pose[:2]
    by_heading = level @ (arm[:, ::-1] * [-1.0, 1.0])[:, :, None]
    return np.concatenate([level, by_heading], axis=2).reshape(8, 3)


def _mounting(
    view: View, view_covariance: Array, tag: Tag, pose: SE2, gain: Array, errors: MountingErrors
) -> Array:
    """Return the covariance (3, 3) of a pose from errors that pictures cannot tell.

    `gain` (3, 8) is the change of the pose with the corners.
    """
    points = corner_points(tag, pose.xy_heading)
    _, by_point, by_view = view.derivatives(points)
    arm = points[:, :2] - points[:, :2].mean(axis=0)
    # A robot tilts about its point on the floor, which moves its tag aside in proportion to height.
    by_tilt = tag.height_m * by_point[:, :, :2] - by_point[:, :, 2:] * arm[:, None]
    reach = pose.rotate(tag.place.xy_heading[:2])
    of_view = gain @ by_view.reshape(8, -1)
    independent = np.concatenate(
        [
            errors.height_m * gain @ by_point[:, :, 2:].reshape(8, 1),
            errors.tilt_rad * gain @ by_tilt.reshape(8, 2),
            errors.heading_rad * np.array([[-reach[1]], [reach[0]], [1.0]]),
            np.diag([errors.place_m, errors.place_m, 0.0]),
        ],
        axis=1,
    )
    return of_view @ view_covariance @ of_view.T + independent @ independent.T


CORNER_NOISE = 1.0
"""Standard deviation of a corner in pixels for noise as large as the contrast."""
CORNER_FLOOR_PX = 0.015
"""Standard deviation of a corner without noise: where its pixels lie (docs/camera.md)."""
BLUR_SHARE = 0.006
"""Standard deviation of a corner per pixel of motion during the exposure (docs/camera.md)."""


def corner_sigma_px(picture: Gray, sighting: Sighting, smear_px: float = 0.0) -> float:
    """Return the standard deviation of a corner from the noise and contrast around a tag.

    `smear_px` is the motion during the exposure.
    """
    window = Window.around(sighting.corners, 2.0, picture.shape)
    part = window.of(picture)
    dark, light = _quantiles(part[::2, ::2], 0.1, 0.9)
    contrast = light - dark
    share = noise_sigma(part) / max(contrast, 1.0)
    return math.hypot(CORNER_FLOOR_PX, CORNER_NOISE * share, BLUR_SHARE * smear_px)


_SECOND = np.array([1.0, -2.0, 1.0])


def noise_sigma(part: Gray) -> float:
    """Return the standard deviation of the pixels' noise, unaffected by the edges of a tag.

    Second differences in both directions are zero for smooth brightness; their median ignores the
    few pixels at edges.
    """
    both = cv2.sepFilter2D(part, cv2.CV_16S, _SECOND, _SECOND)
    (median,) = _quantiles(np.abs(both), 0.5)
    return 1.4826 * median / float(_SECOND @ _SECOND)


def _quantiles(values: NDArray[np.integer], *shares: float) -> list[float]:
    """Return quantiles of integers, without interpolation; `np.percentile` is ten times slower."""
    at = [int(share * (values.size - 1)) for share in shares]
    return np.partition(values, at, axis=None)[at].astype(float).tolist()
