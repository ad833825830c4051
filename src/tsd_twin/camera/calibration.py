"""Calibration of a camera: its lens from views of a board, its place from tags on the floor.

Both fits return the covariance of what they found, because errors of lens and place are the
largest of a pose: millimetres, where noise is a tenth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import cv2
import numpy as np
from scipy import optimize

from tsd_twin.camera.detect import side_px
from tsd_twin.camera.lens import (
    LENS_PARAMETERS,
    PARAMETERS,
    CameraPlace,
    Lens,
    View,
    rotation_matrix,
    rotation_vector,
)
from tsd_twin.camera.tags import Tag
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, Array

LEAST_VIEWS = 8
_FLAGS = cv2.CALIB_FIX_K3
"""A third radial term is not observable on lenses of webcams, and bends the edge of the picture."""
_LEAST_SIGMA_PX = 0.02
COMMON_ERROR = 2.0
"""Corners of a view share errors of printing and paper, so residuals understate their effect
(docs/camera.md).
"""
CORNER_SIGMA_PX = 0.03
"""Assumed error of a corner of a tag on the floor, constant over all pictures."""
OUTWARD_SIGMA_PX = 0.15
"""Displacement of all corners outward or inward by ink and the brightness curve of the camera."""
DISTANCE_SIGMA_M = 0.001
"""Error of a distance measured with a tape."""
_LEAST_TAGS = 3
_LEAST_CORNERS = 8
_OUTLIER_MEDIANS, _LEAST_OUTLIER_PX = 5.0, 0.3
Distances: TypeAlias = Mapping[tuple[int, int], float]
"""Distances between the centres of two tags each, measured with a tape, m."""
_least_squares: Any = optimize.least_squares  # pyright: ignore  scipy is untyped.
_NO_LENS = "the views do not determine a lens: hold the board at a slant, near and far"


@dataclass(frozen=True, slots=True, eq=False)
class LensFit:
    """Lens with the covariance (8, 8) of its parameters."""

    lens: Lens
    covariance: Array
    rms_px: float
    residuals: Array
    """(n, 4): column and row of each corner, then its error."""


def fit_lens(views: Sequence[tuple[Array, Array]], size: tuple[int, int]) -> LensFit:
    """Fit a lens to views of a board: corners on it (n, 3), and in the picture (n, 2).

    Raises:
        TwinError: If there are fewer than eight views, or they do not determine a lens.
    """
    if len(views) < LEAST_VIEWS:
        raise TwinError(f"{len(views)} views of the board are too few: {LEAST_VIEWS} or more")
    _, errors = _fit_views(views, size)
    kept = [_without_outliers(*view, off) for view, off in zip(views, errors, strict=True)]
    fit, _ = _fit_views([view for view in kept if len(view[0]) >= _LEAST_CORNERS], size)
    return fit


def _without_outliers(board: Array, seen: Array, errors: Array) -> tuple[Array, Array]:
    """Return the corners that fit: markers cut off by the edge of the picture give wrong ones."""
    size = np.hypot(*errors.T)
    kept = size <= max(_OUTLIER_MEDIANS * float(np.median(size)), _LEAST_OUTLIER_PX)
    return board[kept], seen[kept]


def _fit_views(
    views: Sequence[tuple[Array, Array]], size: tuple[int, int]
) -> tuple[LensFit, list[Array]]:
    """Return the fit and the errors (n, 2) of the corners of each view."""
    points = [np.asarray(board, np.float32) for board, _ in views]
    pixels = [np.asarray(seen, np.float32) for _, seen in views]
    try:
        _, matrix, distortion, turns, offsets = cv2.calibrateCamera(
            points, pixels, size, np.eye(3), np.zeros(5), flags=_FLAGS
        )
    except cv2.error as error:
        raise TwinError(_NO_LENS) from error
    found = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel()[:4]]
    lens = Lens(*size, np.array(found, float))
    information = np.zeros((LENS_PARAMETERS, LENS_PARAMETERS))
    errors: list[Array] = []
    for (board, seen), turn, offset in zip(views, turns, offsets, strict=True):
        shown, jacobian = cv2.projectPoints(board, turn, offset, lens.matrix, lens.distortion)
        errors.append(seen - shown.reshape(-1, 2))
        place, own = jacobian[:, :6], jacobian[:, 6 : 6 + LENS_PARAMETERS]
        # The pose of each board is unknown: what remains after it is the information on the lens.
        seen_by_place = np.linalg.lstsq(place, own, rcond=None)[0]
        information += own.T @ (own - place @ seen_by_place)
    together = np.concatenate(errors)
    freedom = max(1, together.size - 6 * len(views) - LENS_PARAMETERS)
    sigma = float(np.sqrt(np.square(together).sum() / freedom))
    try:
        inverse = np.linalg.inv(information)
    except np.linalg.LinAlgError as error:
        raise TwinError(_NO_LENS) from error
    if not (np.isfinite(inverse).all() and (np.diag(inverse) > 0.0).all()):
        raise TwinError(_NO_LENS)
    covariance = np.asarray((COMMON_ERROR * max(sigma, _LEAST_SIGMA_PX)) ** 2 * inverse, float)
    where = np.concatenate([seen for _, seen in views])
    return LensFit(lens, covariance, sigma, np.column_stack([where, together])), errors


@dataclass(frozen=True, slots=True, eq=False)
class FloorFit:
    """View of the floor with its covariance (14, 14), and the tags where they were found."""

    view: View
    covariance: Array
    tags: tuple[Tag, ...]
    rms_px: float
    residuals: Array
    """(n, 4): column and row of each corner of a tag, then its error."""


def fit_floor(
    lens: LensFit,
    sightings: Mapping[int, Array],
    tags: Mapping[int, Tag],
    origin: SE2,
    distances_m: Distances,
) -> FloorFit:
    """Fit the place of a camera, and the lens within its covariance, to tags on a level floor.

    Nobody has to measure where tags lie. The tag with the lowest number is at `origin` in the floor
    frame, and the next one is ahead of it along the X axis of `origin`, because the direction
    between two tags is ten times as accurate as the heading of a tag. Distances between centres of
    tags, measured with a tape, give the scale. Without them the size of the tags does, but blur
    moves all corners of a tag outward or inward by a tenth of a pixel, which is 10 mm of height
    (docs/camera.md).

    Args:
        lens: Fitted lens.
        sightings: Mean corners (4, 2) of each tag, by number.
        tags: Size of each tag, by number.
        origin: Pose of the first tag in the floor frame.
        distances_m: Measured distances; may be empty.

    Raises:
        TwinError: If fewer than three tags are seen, or one of the first two or of those with a
            distance is not, or they do not determine the place.
    """
    numbers = sorted(set(sightings) & set(tags))
    if len(numbers) < _LEAST_TAGS:
        raise TwinError(f"{len(numbers)} tags on the floor are too few: {_LEAST_TAGS} or more")
    # Others in their place would get their origin and distance.
    needed = {*sorted(tags)[:2], *(number for pair in distances_m for number in pair)}
    unseen = [str(number) for number in sorted(needed - set(numbers))]
    if unseen:
        raise TwinError(
            f"tag {' and '.join(unseen)} is not seen: the two lowest numbers define the origin, "
            "and tags with a measured distance the scale, so all of each must be in view"
        )
    problem = _FloorProblem(lens, numbers, sightings, tags, origin, distances_m)
    solution: Any = _least_squares(
        problem.residuals, problem.start(), jac=problem.jacobian, method="lm"
    )
    found = np.asarray(solution.x, float)
    jacobian = np.asarray(solution.jac, float)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    view = problem.view(found)
    errors = CORNER_SIGMA_PX * problem.residuals(found)[problem.priors :].reshape(-1, 2)
    seen = np.concatenate([sightings[number] for number in numbers])
    freedom = max(1, errors.size - (len(found) - problem.priors))
    rms_px = float(np.sqrt(np.square(errors).sum() / freedom))
    if not view.place.position_m[2] > 0.0:
        raise TwinError("the tags are seen from below: the floor must be level, tags face upward")
    scale = max(1.0, rms_px / CORNER_SIGMA_PX) ** 2
    return FloorFit(
        view,
        scale * inverse[:PARAMETERS, :PARAMETERS],
        problem.placed_tags(found),
        rms_px,
        np.column_stack([seen, errors]),
    )


_OUTWARD = PARAMETERS
"""Index of the displacement of corners."""


class _FloorProblem:
    """Unknowns: 14 of the view; how far all corners are displaced outward, in pixels; then the
    places of the tags: the heading of the first, distance along X and heading of the second, and x,
    y, heading of all others.
    """

    def __init__(
        self,
        lens: LensFit,
        numbers: Sequence[int],
        sightings: Mapping[int, Array],
        tags: Mapping[int, Tag],
        origin: SE2,
        distances_m: Distances,
    ) -> None:
        self._lens, self._origin = lens, origin
        pairs = [[numbers.index(number) for number in pair] for pair in distances_m]
        self._pairs = np.array(pairs, int).reshape(-1, 2)
        self._distances_m = np.array(list(distances_m.values()), float)
        self.priors = LENS_PARAMETERS + 1 + len(pairs)
        self._seen = np.concatenate([sightings[number] for number in numbers])
        outward = self._quads() - self._quads().mean(axis=1, keepdims=True)
        outward /= np.linalg.norm(outward, axis=2, keepdims=True)
        self._outward = outward.reshape(-1, 2)
        self._tags = [tags[number] for number in numbers]
        try:
            self._whiten = np.linalg.cholesky(np.linalg.inv(lens.covariance)).T
        except np.linalg.LinAlgError as error:
            raise TwinError("the covariance of the lens is missing: calibrate the lens") from error

    def start(self) -> Array:
        """Return a first guess: the pose of the camera above the largest tag, seen alone."""
        lens, first = self._lens.lens, int(np.argmax([side_px(c) for c in self._quads()]))
        half = 0.5 * self._tags[first].size_m
        square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
        # A single tag has two poses; the others, on the same plane, show which is right.
        _, turns, offsets, _ = cv2.solvePnPGeneric(
            square,
            np.ascontiguousarray(self._quads()[first]),
            lens.matrix,
            lens.distortion,
            flags=cv2.SOLVEPNP_IPPE_SQUARE,
        )
        guesses = [
            self._guess(np.asarray(turn, float), np.asarray(offset, float))
            for turn, offset in zip(turns, offsets, strict=True)
        ]
        return min(guesses, key=lambda guess: float(np.square(self.residuals(guess)).sum()))

    def _guess(self, turn: Array, offset: Array) -> Array:
        rotation = rotation_matrix(turn)
        view = View(self._lens.lens, CameraPlace(turn.ravel(), (-rotation.T @ offset).ravel()))
        poses = [_level_pose(view.on_plane(quad)) for quad in self._quads()]
        way = poses[1][:2] - poses[0][:2]
        frame = SE2(np.array([*poses[0][:2], np.arctan2(way[1], way[0])]))
        to_floor = self._origin @ frame.inverse()
        level = np.eye(3)
        cosine, sine = np.cos(to_floor.xy_heading[2]), np.sin(to_floor.xy_heading[2])
        level[:2, :2] = [[cosine, -sine], [sine, cosine]]
        position = level @ view.place.position_m + [*to_floor.xy_heading[:2], 0.0]
        moved = CameraPlace(rotation_vector(rotation @ level.T), position)
        local = [(frame.inverse() @ SE2(pose)).xy_heading for pose in poses]
        places = np.concatenate([[local[0][2]], [local[1][0], local[1][2]], *local[2:]])
        return np.concatenate([View(self._lens.lens, moved).parameters, [0.0], places])

    def residuals(self, x: Array) -> Array:
        """Return errors in standard deviations: lens (8,), displacement, distances, corners."""
        lens = self._whiten @ (x[:LENS_PARAMETERS] - self._lens.lens.parameters)
        outward_px = x[_OUTWARD]
        distances = (self._distances(x) - self._distances_m) / DISTANCE_SIGMA_M
        shown = self.view(x).project(self._corners(x)) + outward_px * self._outward
        corners = (self._seen - shown).ravel() / CORNER_SIGMA_PX
        return np.concatenate([lens, [outward_px / OUTWARD_SIGMA_PX], distances, corners])

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of `residuals`."""
        corners = self._corners(x)
        _, by_point, by_view = self.view(x).derivatives(corners)
        places = len(x) - PARAMETERS - 1
        moved = np.zeros((len(corners), 3, places))
        stretched = np.zeros((len(self._pairs), places))
        for i in range(places):
            step = np.zeros_like(x)
            step[_OUTWARD + 1 + i] = 1e-6
            moved[:, :, i] = (self._corners(x + step) - self._corners(x - step)) / 2e-6
            stretched[:, i] = (self._distances(x + step) - self._distances(x - step)) / 2e-6
        outward = self._outward[:, :, None]
        rows = np.concatenate([by_view, outward, by_point @ moved], axis=2).reshape(-1, len(x))
        priors = np.zeros((self.priors, len(x)))
        priors[:LENS_PARAMETERS, :LENS_PARAMETERS] = self._whiten
        priors[LENS_PARAMETERS, _OUTWARD] = 1.0 / OUTWARD_SIGMA_PX
        priors[LENS_PARAMETERS + 1 :, _OUTWARD + 1 :] = stretched / DISTANCE_SIGMA_M
        return np.concatenate([priors, -rows / CORNER_SIGMA_PX])

    def view(self, x: Array) -> View:
        """Return the view of the unknowns."""
        lens = replace(self._lens.lens, parameters=x[:LENS_PARAMETERS])
        return View(lens, CameraPlace(*np.split(x[LENS_PARAMETERS:PARAMETERS], 2)))

    def placed_tags(self, x: Array) -> tuple[Tag, ...]:
        """Return the tags at their places on the floor."""
        return tuple(
            replace(tag, robot=None, height_m=0.0, x_m=x, y_m=y, heading_rad=heading)
            for tag, pose in zip(self._tags, self._poses(x), strict=True)
            for x, y, heading in [pose.xy_heading.tolist()]
        )

    def _poses(self, x: Array) -> list[SE2]:
        places = x[_OUTWARD + 1 :]
        local = [np.array([0.0, 0.0, places[0]]), np.array([places[1], 0.0, places[2]])]
        local += list(places[3:].reshape(-1, 3))
        return [self._origin @ SE2(place) for place in local]

    def _distances(self, x: Array) -> Array:
        centres = np.array([pose.xy_heading[:2] for pose in self._poses(x)])
        return np.hypot(*(centres[self._pairs[:, 0]] - centres[self._pairs[:, 1]]).T)

    def _corners(self, x: Array) -> Array:
        level = np.concatenate(
            [
                pose.transform(tag.corners_m)
                for tag, pose in zip(self._tags, self._poses(x), strict=True)
            ]
        )
        return np.column_stack([level, np.zeros(len(level))])

    def _quads(self) -> Array:
        return self._seen.reshape(-1, 4, 2)


def _level_pose(quad: Array) -> Array:
    """Return centre and heading (3,) of a tag with corners (4, 2) on the floor."""
    right = quad[1] + quad[2] - quad[0] - quad[3]
    return np.array([*quad.mean(axis=0), np.arctan2(right[1], right[0])])
