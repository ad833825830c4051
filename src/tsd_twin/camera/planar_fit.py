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

from tsd_twin.camera.detect import Gray, Sighting, Window
from tsd_twin.camera.lens import View, rotation_matrix
from tsd_twin.camera.tags import Tag
from tsd_twin.lie import SE2, Array

_STEPS = 3
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
    residual_px: float
    """Root mean square of the corners' errors, per degree of freedom."""
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

    Returns the pose, the residuals (8,) in pixels and the derivatives (8, 3) of the corners by the
    pose, or None if the corners cannot lie on the plane of the tag.
    """
    seen = view.on_plane(corners, tag.height_m)
    if not np.isfinite(seen).all():
        return None
    guess = SE2(_rigid(tag.corners_m, seen)) @ tag.place.inverse()
    pose = np.asarray(guess.xy_heading, float).copy()
    residuals, jacobian = np.zeros(8), np.zeros((8, 3))
    for _ in range(_STEPS):
        points = corner_points(tag, pose)
        pixels, by_point, _ = view.derivatives(points)
        jacobian = _by_pose(points, by_point, pose)
        residuals = (corners - pixels).ravel()
        pose += np.linalg.lstsq(jacobian, residuals, rcond=None)[0]
    return SE2(pose), residuals, jacobian


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
    pose, residuals, jacobian = fitted
    residual_px = math.sqrt(float(residuals @ residuals) / _FREEDOM)
    if residual_px > largest_residual_px(side):
        return _named(view, tag, sighting.corners)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    mounting = _mounting(view, view_covariance, tag, pose, inverse @ jacobian.T, errors)
    # A corner that was found in a wrong place, by the detector or its refinement, shows in the fit.
    noise = np.asarray(max(sigma_px, residual_px) ** 2 * inverse, float)
    return PlanarPose(pose, noise, mounting, residual_px, side)


LEAST_BELIEVED_PX = 24.0
"""Three pixels for each cell of a tag with eight."""
_RESIDUAL_PX, _RESIDUAL_SHARE = 0.9, 0.006
"""Largest residual, and its growth with the side of the tag: lens, height, 3 degrees of tilt."""
_SLANTED_RAD = math.radians(12.0)
_SIZE_RATIO = 0.04


def largest_residual_px(side: float) -> float:
    """Return the largest residual of a level tag with a side of so many pixels."""
    return _RESIDUAL_PX + _RESIDUAL_SHARE * side


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
    ratio = math.sqrt(abs(_area(seen))) / tag.size_m
    return Refusal.HEIGHT if abs(ratio - 1.0) > _SIZE_RATIO else Refusal.COVERED


def _area(quad: Array) -> float:
    x, y = (quad - quad[0]).T
    return 0.5 * float(x @ np.roll(y, 1) - y @ np.roll(x, 1))


def _rigid(own: Array, seen: Array) -> Array:
    """Return the pose (3,) that moves points (4, 2) with their centre at 0 to others."""
    z, w = own @ np.array([1, 1j]), seen @ np.array([1, 1j])
    middle = w.mean()
    return np.array([middle.real, middle.imag, np.angle(np.sum(np.conj(z) * (w - middle)))])


def _by_pose(points: Array, by_point: Array, pose: Array) -> Array:
    """Return the derivatives (8, 3) of corners by x, y and heading of the robot."""
    arm = points[:, :2] - pose[:2]
    turned = np.column_stack([-arm[:, 1], arm[:, 0]])
    by_heading = np.einsum("nij,nj->ni", by_point[:, :, :2], turned)
    return np.concatenate([by_point[:, :, :2], by_heading[:, :, None]], axis=2).reshape(8, 3)


def _mounting(
    view: View, view_covariance: Array, tag: Tag, pose: SE2, gain: Array, errors: MountingErrors
) -> Array:
    """Return the covariance (3, 3) of a pose from errors that pictures cannot tell.

    `gain` (3, 8) is the change of the pose with the corners.
    """
    points = corner_points(tag, pose.xy_heading)
    _, by_point, by_view = view.derivatives(points)
    of_view = gain @ by_view.reshape(8, -1)
    of_height = gain @ by_point[:, :, 2].reshape(8)
    arm = points[:, :2] - points[:, :2].mean(axis=0)
    # A robot tilts about its point on the floor, which moves its tag aside in proportion to height.
    aside = tag.height_m * by_point[:, :, :2] + np.einsum("nk,ni->nik", arm, -by_point[:, :, 2])
    of_tilt = gain @ aside.reshape(8, 2)
    covariance = of_view @ view_covariance @ of_view.T
    covariance += errors.height_m**2 * np.outer(of_height, of_height)
    covariance += errors.tilt_rad**2 * of_tilt @ of_tilt.T
    reach = pose.rotate(tag.place.xy_heading[:2])
    swing = np.array([-reach[1], reach[0], 1.0])
    covariance += np.diag([errors.place_m**2, errors.place_m**2, 0.0])
    return covariance + errors.heading_rad**2 * np.outer(swing, swing)


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
    contrast = float(np.subtract(*np.percentile(part[::2, ::2], [90.0, 10.0])))
    share = noise_sigma(part) / max(contrast, 1.0)
    return math.hypot(CORNER_FLOOR_PX, CORNER_NOISE * share, BLUR_SHARE * smear_px)


_HORIZONTAL_SECOND = np.array([1.0, -2.0, 1.0]) / math.sqrt(6.0)


def noise_sigma(part: Gray) -> float:
    """Return the standard deviation of the pixels' noise, unaffected by the edges of a tag.

    Second differences in both directions are zero for smooth brightness; their median ignores the
    few pixels at edges.
    """
    both = cv2.sepFilter2D(part, cv2.CV_32F, _HORIZONTAL_SECOND, _HORIZONTAL_SECOND)
    return 1.4826 * float(np.median(np.abs(both)))
